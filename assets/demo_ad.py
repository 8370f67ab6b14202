"""The demo ad: a turning can of a made-up citrus drink, five seconds that loop without a seam."""

from collections.abc import Iterator

import cv2
import numpy as np
from demo_paint import Bytes, Colour, Floats, floats, lettering, noise, opaque, ramp
from PIL import Image, ImageDraw

AD_FPS, AD_FRAMES = 30, 150
WIDTH, HEIGHT = 640, 800
CAN_WIDTH, CAN_HEIGHT, CAN_TOP = 216, 440, 206
INK: Colour = (92, 26, 40)
CREAM: Colour = (255, 246, 226)


def sunburst(turn: float) -> Floats:
    """A warm sky with rays round the can, turned by `turn` of one ray; (H, W, 3)."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    dx, dy = x - WIDTH / 2, y - 430
    radius = np.hypot(dx, dy)
    wave = np.sin(14 * (np.arctan2(dy, dx) + 2 * np.pi * turn / 14))
    rays = ramp(-0.06, 0.06, wave * radius / 160) * (0.25 + 0.75 * ramp(620, 60, radius))
    down = (y / HEIGHT)[..., None]
    sky = floats([255, 122, 92]) * (1 - down) + floats([255, 196, 88]) * down
    sky += (floats([255, 226, 150]) - sky) * (0.34 * rays)[..., None]
    return np.asarray(sky + (floats([255, 250, 214]) - sky) * (0.8 * np.exp(-((radius / 190) ** 2)))[..., None])


def citrus(size: int, peel: Colour, flesh: Colour) -> Floats:
    """A round slice seen from the front, (size, size, 4), colours 0..255 and alpha 0..1."""
    y, x = np.mgrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j].astype(np.float32)
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    soft = 2.5 / size
    colour = np.broadcast_to(floats(peel), (size, size, 3)).copy()
    colour += (floats([255, 244, 214]) - colour) * ramp(0.92 + soft, 0.92 - soft, radius)[..., None]
    wedge = np.abs(np.sin(4.5 * angle)) * radius * 0.22
    inside = ramp(0.82 + soft, 0.82 - soft, radius) * ramp(0.018, 0.018 + 2 * soft, wedge)
    fibre = 0.9 + 0.1 * np.sin(60 * angle + 9 * np.sin(8 * radius)) * radius + 0.14 * (1 - radius)
    colour += (floats(flesh) * fibre[..., None] - colour) * inside[..., None]
    return np.dstack([colour, ramp(0.99, 0.99 - 2 * soft, radius)])


def can_label() -> Bytes:
    """The printed wrap of the can, twice around for a plain look-up: (CAN_HEIGHT, 1400, 3)."""
    width, s = 700, 3
    image = Image.new("RGB", (width * s, CAN_HEIGHT * s), (24, 128, 116))
    draw = ImageDraw.Draw(image)
    for x in range(-600, width + 600, 50):
        draw.line([(x * s, CAN_HEIGHT * s), ((x + 300) * s, 0)], (30, 142, 126), 22 * s)
    draw.rectangle([0, 292 * s, width * s, 308 * s], (255, 196, 88))
    draw.rectangle([0, 308 * s, width * s, CAN_HEIGHT * s], (244, 92, 72))
    for middle in (175, 525):
        draw.ellipse([(middle - 66) * s, 62 * s, (middle + 66) * s, 194 * s], (255, 214, 110))
        for spoke in np.arange(12) * np.pi / 6:
            end = (middle + 54 * np.cos(spoke)) * s, (128 + 54 * np.sin(spoke)) * s
            draw.line([(middle * s, 128 * s), end], (255, 236, 180), 5 * s)
        draw.ellipse([(middle - 22) * s, 106 * s, (middle + 22) * s, 150 * s], (244, 92, 72))
        lettering(draw, middle * s, 238 * s, "ORELLA", 48 * s, CREAM, 4 * s)
        lettering(draw, middle * s, 348 * s, "BLOOD ORANGE", 19 * s, CREAM, 1.5 * s)
        lettering(draw, middle * s, 374 * s, "& LIME", 19 * s, CREAM, 1.5 * s)
    label = cv2.resize(np.asarray(image), (width, CAN_HEIGHT), interpolation=cv2.INTER_AREA)
    return np.hstack([label, label])


class Can:
    """The can's outline, shading and look-up into its wrap; `drawn` turns it."""

    def __init__(self) -> None:
        self.label = can_label()
        y, x = np.mgrid[0:CAN_HEIGHT, 0:CAN_WIDTH].astype(np.float32)
        u = (x - (CAN_WIDTH - 1) / 2) / (CAN_WIDTH / 2)
        # The shoulders draw in towards the lid and the foot; `body` is the half width there, 1 in the middle.
        body = 1 - 0.16 * ramp(34, 0, y) - 0.12 * ramp(CAN_HEIGHT - 22, CAN_HEIGHT, y)
        across = np.clip(u / body, -0.999, 0.999)
        bow = 15 * np.sqrt(1 - across**2)  # seen from a little above: the rings bow downwards
        self.angle = (np.arcsin(across) / (2 * np.pi) * 700).astype(np.float32)
        self.row = np.clip(y - bow + 15, 0, CAN_HEIGHT - 1).astype(np.float32)
        side = ramp(1.0, 0.985, np.abs(u) / body)
        self.alpha = side * ramp(-1, 1, y - 15 + bow * 0.9) * ramp(1, -1, y - (CAN_HEIGHT - 18) - bow)
        self.alpha = np.maximum(self.alpha, ramp(1.04, 0.97, (u / 0.84) ** 2 + ((y - 15) / 15) ** 2))
        self.lid = ramp(1.03, 0.97, (u / 0.82) ** 2 + ((y - 15) / 13) ** 2)
        self.lid_tone = 190 + 40 * np.sin(7 * u + y / 5)
        self.metal = np.maximum(ramp(20, 17, self.row), ramp(CAN_HEIGHT - 20, CAN_HEIGHT - 17, self.row))
        shade = 0.42 + 0.62 * np.sqrt(1 - across**2)
        self.shade = shade - 0.12 * ramp(0.1, 0.9, across)
        self.gloss = 0.55 * np.exp(-(((across + 0.52) / 0.1) ** 2)) + 0.22 * np.exp(-(((across - 0.7) / 0.06) ** 2))
        drops = np.random.default_rng(8)
        self.dew = np.clip(noise((CAN_HEIGHT, CAN_WIDTH), 9, drops, 2) - 1.25, 0, 1) * ramp(1.0, 0.8, np.abs(across))

    def drawn(self, turn: float) -> tuple[Floats, Floats]:
        """Colours (CAN_HEIGHT, CAN_WIDTH, 3) and alpha at `turn` of a full rotation."""
        column = (self.angle + np.float32(175 + 700 * turn)) % 700
        wrap = cv2.remap(self.label, column, self.row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        colour = wrap.astype(np.float32)
        colour += (floats([206, 210, 214]) - colour) * self.metal[..., None]
        colour = colour * self.shade[..., None] + (255 - colour) * (self.gloss + 0.2 * self.dew)[..., None]
        colour += (np.repeat(self.lid_tone[..., None], 3, 2) - colour) * self.lid[..., None]
        return np.clip(colour, 0, 255), self.alpha


def lay(frame: Floats, colour: Floats, alpha: Floats, matrix: Floats) -> None:
    """Blend a picture into the frame through a (2, 3) affine map from its pixels to the frame's."""
    size = (WIDTH, HEIGHT)
    cover = cv2.warpAffine(alpha, matrix, size, flags=cv2.INTER_LINEAR)[..., None]
    paint = cv2.warpAffine(colour * alpha[..., None], matrix, size, flags=cv2.INTER_LINEAR)
    frame *= 1 - cover
    frame += paint


def spun(size: int, x: float, y: float, turn: float, scale: float) -> Floats:
    """Affine map that puts a square picture's middle at (x, y), turned by `turn` of a circle."""
    matrix = cv2.getRotationMatrix2D(((size - 1) / 2, (size - 1) / 2), 360 * turn, scale)
    matrix[:, 2] += [x - (size - 1) / 2, y - (size - 1) / 2]
    return np.asarray(matrix, np.float32)


def captions() -> tuple[Floats, Floats]:
    """The words that stand still: colours (H, W, 3) and alpha, drawn at three times the size."""
    s = 3
    mask = Image.new("RGBA", (WIDTH * s, HEIGHT * s), (*CREAM, 0))
    draw = ImageDraw.Draw(mask)
    lettering(draw, 320 * s, 84 * s, "ORELLA", 112 * s, CREAM, 14 * s)
    lettering(draw, 320 * s, 156 * s, "SPARKLING CITRUS", 30 * s, INK, 7 * s)
    lettering(draw, 320 * s, 722 * s, "Sip the sunshine.", 58 * s, INK, 1 * s)
    lettering(draw, 320 * s, 768 * s, "REAL FRUIT / NO SUGAR ADDED", 20 * s, INK, 3 * s)
    small = cv2.resize(np.asarray(mask, np.float32), (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    return small[..., :3], small[..., 3] / 255


def ad_frames() -> Iterator[Bytes]:
    """The ad's frames, (800, 640, 3) RGB."""
    can, (words, word_alpha) = Can(), captions()
    size = 190
    slices = [citrus(size, (240, 110, 40), (255, 120, 70)), citrus(size, (110, 170, 50), (176, 214, 92))]
    placed = ((0, 92, 300, 0.86), (1, 552, 262, 0.62), (0, 566, 560, 1.0), (1, 78, 590, 0.74))
    rng = np.random.default_rng(12)
    bubbles = rng.uniform((20, 0, 3, 1), (620, 1, 13, 3.99), (26, 4))
    for index in range(AD_FRAMES):
        t = index / AD_FRAMES
        wave = np.sin(2 * np.pi * t)
        frame = sunburst(2 * t)
        for x, start, radius, speed in bubbles:
            y = HEIGHT + 20 - ((start + int(speed) * t) % 1) * (HEIGHT + 40)
            at = (round((x + 7 * np.sin(2 * np.pi * (start + 2 * t))) * 16), round(y * 16))
            cv2.circle(frame, at, round(radius * 16), (255, 236, 190), 2, cv2.LINE_AA, 4)
        for number, (kind, x, y, scale) in enumerate(placed):
            bob = 13 * np.sin(2 * np.pi * (t + number / 4))
            picture, turn = slices[kind], (t if number % 2 else -t) + number / 7
            dark = np.zeros_like(picture[..., :3]) + floats([150, 50, 30])
            lay(
                frame,
                dark,
                cv2.GaussianBlur(picture[..., 3], (0, 0), 5) * 0.25,
                spun(size, x + 8, y + bob + 16, turn, scale),
            )
            lay(
                frame,
                np.ascontiguousarray(picture[..., :3]),
                np.ascontiguousarray(picture[..., 3]),
                spun(size, x, y + bob, turn, scale),
            )
        y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
        pool = np.exp(-(((x - 330) / 120) ** 2) - ((y - CAN_TOP - CAN_HEIGHT + 2) / 13) ** 2)
        frame *= 1 - (0.42 - 0.05 * wave) * pool[..., None]
        colour, alpha = can.drawn(t)
        lay(frame, colour, alpha, floats([[1, 0, (WIDTH - CAN_WIDTH) / 2], [0, 1, CAN_TOP + 5 * wave]]))
        lay(frame, words, word_alpha, floats([[1, 0, 0], [0, 1, 0]]))
        glint = np.exp(-(((x + 0.5 * y - 1600 * t + 150) / 46) ** 2)) * word_alpha * (y < 138)
        frame += (255 - frame) * (0.75 * glint)[..., None]
        yield opaque(frame + 0.5)
