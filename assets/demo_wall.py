"""The demo clip's brick facade with its windows, door and signs, and the wet pavement before it."""

from collections.abc import Sequence

import cv2
import numpy as np
from demo_paint import (
    FRAME,
    MIRROR_DEPTH,
    POSTER,
    WALL_LEFT,
    WALL_RIGHT,
    WALL_SCALE,
    WALL_TOP,
    Bytes,
    Colour,
    Floats,
    Layer,
    floats,
    lettering,
    noise,
    opaque,
    premultiplied,
    ramp,
)
from PIL import Image, ImageDraw


class Facade:
    """The wall's picture above the pavement while it is painted; rectangles are (left, bottom, right, top)."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.height, self.width = int(WALL_TOP * WALL_SCALE), int((WALL_RIGHT - WALL_LEFT) * WALL_SCALE)
        y, x = np.mgrid[0 : self.height, 0 : self.width].astype(np.float32) / WALL_SCALE
        self.x, self.y = x + WALL_LEFT, WALL_TOP - y
        self.image = self._bricks()

    def _bricks(self) -> Floats:
        rng, shape = self.rng, (self.height, self.width)
        wobble = noise(shape, 40, rng) * 0.0016
        row = np.floor((self.y + wobble) / 0.083)
        along = (self.x + wobble) / 0.25 + 0.5 * (row % 2)
        inside_x, inside_y = along % 1, ((self.y + wobble) / 0.083) % 1
        edge = np.minimum(np.minimum(inside_x, 1 - inside_x) * 0.25, np.minimum(inside_y, 1 - inside_y) * 0.083)
        brick = ramp(0.003, 0.009, edge + 0.001 * noise(shape, 7, rng, 2))
        index = (row * 389 + np.floor(along) * 97).astype(np.int64) % 4096
        tone, bulge = rng.random(4096).astype(np.float32)[index], rng.random(4096).astype(np.float32)[index]
        palette = np.array([[112, 66, 54], [142, 82, 64], [158, 96, 74], [168, 116, 92], [128, 88, 80]], np.float32)
        red = np.stack([np.interp(tone, np.linspace(0, 1, 5), palette[:, c]) for c in range(3)], -1)
        grain, blotch = noise(shape, 5, rng, 2), noise(shape, 30, rng)
        red = red * (1 + 0.045 * grain + 0.05 * blotch)[..., None]
        mortar = floats([150, 140, 126]) * (1 + 0.05 * grain)[..., None]
        relief = cv2.GaussianBlur(brick * (1 + 0.35 * bulge) + 0.07 * grain + 0.05 * blotch, (0, 0), 1.0)
        slope = cv2.Sobel(relief, cv2.CV_32F, 1, 0) * 0.6 + cv2.Sobel(relief, cv2.CV_32F, 0, 1) * 0.8
        stain = 1 + 0.07 * noise(shape, 500, rng, 4)
        image = (mortar + (red - mortar) * brick[..., None]) * ((1 + 0.085 * np.clip(slope, -3, 3)) * stain)[..., None]
        return np.asarray(image, np.float32)

    def box(self, rect: Sequence[float]) -> tuple[slice, slice]:
        left, bottom, right, top = rect
        rows = slice(max(0, round((WALL_TOP - top) * WALL_SCALE)), round((WALL_TOP - bottom) * WALL_SCALE))
        return rows, slice(round((left - WALL_LEFT) * WALL_SCALE), round((right - WALL_LEFT) * WALL_SCALE))

    def shade(self, rect: Sequence[float], blur: float, strength: float, dx: float = 0, dy: float = 0) -> None:
        """Darken the wall under a rectangle moved by (dx, dy), soft over `blur` metres: a shadow or an occlusion."""
        left, bottom, right, top = rect[0] + dx, rect[1] + dy, rect[2] + dx, rect[3] + dy
        box = self.box((left - 2 * blur, bottom - 2 * blur, right + 2 * blur, top + 2 * blur))
        x, y = self.x[box], self.y[box]
        across = ramp(left - blur, left + blur, x) * ramp(right + blur, right - blur, x)
        self.image[box] *= (
            1 - strength * (across * ramp(bottom - blur, bottom + blur, y) * ramp(top + blur, top - blur, y))[..., None]
        )

    def slab(self, rect: Sequence[float], colour: Colour, grain: float = 0.03, bevel: float = 0.012) -> None:
        """A raised flat piece with its own grain, bevelled: lit above and left, dark below and right."""
        self.shade(rect, 0.05, 0.55, 0.02, -0.035)
        box = self.box(rect)
        x, y = self.x[box], self.y[box]
        light = 1 + grain * noise(x.shape, 12, self.rng) + grain * noise(x.shape, 120, self.rng)
        light += 0.22 * ramp(rect[3] - bevel, rect[3], y) - 0.3 * ramp(rect[1] + bevel, rect[1], y)
        light += 0.1 * ramp(rect[0] + bevel, rect[0], x) - 0.18 * ramp(rect[2] - bevel, rect[2], x)
        self.image[box] = floats(colour) * light[..., None]

    def hollow(self, rect: Sequence[float], colour: Colour, depth: float = 0.05) -> None:
        """A sunk panel: the edge above and left throws its shadow into it."""
        box = self.box(rect)
        x, y = self.x[box], self.y[box]
        lit = ramp(0, depth, rect[3] - y) * (0.5 + 0.5 * ramp(0, depth, x - rect[0]))
        self.image[box] = floats(colour) * (0.45 + 0.55 * lit)[..., None]

    def glass(self, rect: Sequence[float], warmth: float) -> None:
        """A pane: a dim room with a lamp's glow, curtains, and the bright sky's reflection above."""
        box = self.box(rect)
        u = (self.x[box] - rect[0]) / (rect[2] - rect[0])
        v = (self.y[box] - rect[1]) / (rect[3] - rect[1])
        room = (
            floats([34, 36, 42])
            + floats([150, 96, 40]) * (warmth * np.exp(-(((u - 0.6) / 0.35) ** 2) - ((v - 0.35) / 0.4) ** 2))[..., None]
        )
        fold = 0.75 + 0.25 * np.sin(u * 70 + 2 * np.sin(v * 3))
        curtain = (ramp(0.3, 0.22, np.minimum(u, 1 - u) + 0.12 * (0.5 - v) ** 2) * 0.8)[..., None]
        room += (floats([166, 156, 140]) * fold[..., None] - room) * curtain
        sheen = ramp(-0.25, 0.7, v + 0.5 * u - 0.55 + 0.05 * noise(u.shape, 160, self.rng))
        sky = floats([168, 190, 208]) * (0.75 + 0.25 * v)[..., None]
        pane = room + (sky - room) * (0.16 + 0.5 * sheen)[..., None]
        shadow = 0.5 + 0.5 * ramp(0.0, 0.09, 1 - v) * ramp(0.0, 0.06, u)
        self.image[box] = pane * shadow[..., None]

    def window(self, left: float, bottom: float, right: float, top: float, warmth: float) -> None:
        wood: Colour = (222, 216, 202)
        self.slab((left - 0.12, top, right + 0.12, top + 0.2), (176, 166, 148))
        self.shade((left, bottom, right, top), 0.05, 0.5)
        self.slab((left, bottom, right, top), wood, 0.012)
        middle, rail = (left + right) / 2, bottom + 0.62 * (top - bottom)
        for x0, x1 in ((left + 0.07, middle - 0.03), (middle + 0.03, right - 0.07)):
            self.glass((x0, bottom + 0.07, x1, rail - 0.03), warmth)
            self.glass((x0, rail + 0.03, x1, top - 0.07), 0.4 * warmth)
        self.shade((left, top - 0.1, right, top), 0.06, 0.55, 0.0, 0.03)
        self.slab((left - 0.1, bottom - 0.1, right + 0.1, bottom), (182, 172, 154))
        for streak in self.rng.uniform(left - 0.08, right + 0.08, 7):
            self.shade((streak - 0.012, bottom - 0.5, streak + 0.012, bottom - 0.1), 0.05, 0.2)

    def door(self, left: float, right: float, top: float) -> None:
        green: Colour = (38, 74, 66)
        self.slab((left - 0.14, 0, left, top + 0.14), (186, 176, 158))
        self.slab((right, 0, right + 0.14, top + 0.14), (186, 176, 158))
        self.slab((left - 0.14, top, right + 0.14, top + 0.16), (186, 176, 158))
        self.slab((left, 0.12, right, top), green, 0.02)
        self.glass((left + 0.1, top - 0.42, right - 0.1, top - 0.09), 0.9)
        middle = (left + right) / 2
        for x0, x1 in ((left + 0.1, middle - 0.05), (middle + 0.05, right - 0.1)):
            for y0, y1 in ((0.28, 0.86), (1.0, top - 0.56)):
                self.hollow((x0, y0, x1, y1), (30, 60, 54))
                self.slab((x0 + 0.06, y0 + 0.06, x1 - 0.06, y1 - 0.06), (42, 82, 72), 0.02)
        self.slab((right - 0.085, 0.98, right - 0.05, 1.14), (206, 168, 92))
        self.shade((left, top - 0.1, right, top), 0.08, 0.6, 0, 0.03)
        self.slab((left - 0.2, 0, right + 0.2, 0.12), (150, 144, 134))

    def pipe(self, x: float) -> None:
        """A cast-iron downpipe with its brackets."""
        self.shade((x - 0.05, 0, x + 0.05, WALL_TOP), 0.05, 0.55, 0.06, 0)
        for low, high, half in [(0.0, WALL_TOP, 0.05)] + [(h, h + 0.09, 0.066) for h in (0.35, 1.75, 3.3)]:
            box = self.box((x - half, low, x + half, high))
            across = (self.x[box] - x) / half
            light = (
                0.35
                + 0.65 * np.sqrt(np.clip(1 - (across + 0.35) ** 2, 0, 1))
                + 0.5 * np.exp(-(((across + 0.4) / 0.16) ** 2))
            )
            self.image[box] = floats([58, 62, 66]) * (light * (1 + 0.04 * noise(across.shape, 30, self.rng)))[..., None]

    def sign(self, rect: Sequence[float], text: str, size: float, board: Colour, ink: Colour, gap: float) -> None:
        """A lettered board; `size` is the letters' height in metres."""
        self.slab(rect, board, 0.015)
        box = self.box(rect)
        image = Image.fromarray(opaque(self.image[box]))
        draw, (width, height) = ImageDraw.Draw(image), image.size
        draw.rectangle([7, 7, width - 8, height - 8], None, ink, 3)
        lettering(draw, width / 2, height * 0.49, text, size * WALL_SCALE, ink, gap * WALL_SCALE)
        self.image[box] = np.asarray(image, np.float32)

    def texture(self, poster: Bytes) -> Bytes:
        """Everything painted, far parts softened against shimmer, and the mirror image below for the wet pavement."""
        for rect in ((-2.75, 1.12, -1.5, 2.55), (3.65, 1.0, 4.9, 2.5), (5.7, 1.0, 6.95, 2.5), (7.9, 1.0, 9.15, 2.5)):
            self.window(*rect, warmth=0.8)
        for left in (-2.75, -0.62, 1.55, 3.65, 5.7, 7.9):
            self.window(left, 3.7, left + 1.25, 4.75, warmth=0.2)
        self.slab((WALL_LEFT, 3.2, WALL_RIGHT, 3.34), (178, 168, 150))
        self.slab((WALL_LEFT, 0, WALL_RIGHT, 0.4), (132, 128, 122), 0.05)
        self.door(1.72, 2.78, 2.3)
        self.sign((1.5, 2.62, 3.0, 2.98), "FINCH & SON BAKERS", 0.115, (30, 62, 56), (226, 196, 132), 0.006)
        self.sign((-0.42, 2.6, 0.42, 2.78), "MILL LANE", 0.11, (34, 52, 98), (236, 236, 230), 0.014)
        self.sign((3.06, 1.62, 3.22, 1.78), "27", 0.1, (34, 52, 98), (236, 236, 230), 0.0)
        self.pipe(1.12)
        self.shade(FRAME, 0.16, 0.35)
        self.shade(FRAME, 0.06, 0.6, 0.045, -0.06)
        self.slab(FRAME, (46, 48, 52))
        box = self.box(POSTER)
        size = (box[1].stop - box[1].start, box[0].stop - box[0].start)
        self.image[box] = cv2.resize(poster, size, interpolation=cv2.INTER_AREA)
        self.shade((WALL_LEFT - 1, -0.5, WALL_RIGHT + 1, 0.02), 0.3, 0.5)
        self.image *= 1 - 0.12 * ramp(2.4, 4.6, self.y)[..., None]
        for start, sigma in ((2.6, 1.2), (4.2, 2.4)):  # these parts are only ever seen from afar, at a slant
            columns = slice(round((start - WALL_LEFT) * WALL_SCALE), None)
            self.image[:, columns] = cv2.GaussianBlur(self.image[:, columns], (0, 0), sigmaX=sigma, sigmaY=sigma / 2)
        mirror = self.image[-int(MIRROR_DEPTH * WALL_SCALE) :][::-1]
        return opaque(np.vstack([self.image, cv2.GaussianBlur(mirror, (0, 0), sigmaX=3, sigmaY=16)]))


def pavement(rng: np.random.Generator, scale: int = 220, depth: float = 2.4) -> Layer:
    """Wet flagstones: where the alpha is low, the mirrored wall behind shows through."""
    height, width = int(depth * scale), int((WALL_RIGHT - WALL_LEFT) * scale)
    z, x = np.mgrid[0:height, 0:width].astype(np.float32) / scale
    row = np.floor(z / 0.42)
    along = x / 0.62 + 0.43 * row
    edge = np.minimum(np.minimum(along % 1, 1 - along % 1) * 0.62, np.minimum(z / 0.42 % 1, 1 - z / 0.42 % 1) * 0.42)
    tone = rng.random(512).astype(np.float32)[(row * 61 + np.floor(along) * 13).astype(np.int64) % 512]
    joint = ramp(0.003, 0.012, edge)
    light = (0.86 + 0.2 * tone + 0.05 * noise((height, width), 6, rng) + 0.06 * noise((height, width), 90, rng)) * (
        0.4 + 0.6 * joint
    )
    stone = floats([118, 116, 114]) * (light * (0.5 + 0.5 * ramp(0, 0.35, z)))[..., None]
    wet = ramp(-0.7, 1.3, noise((height, width), 260, rng, 4))
    alpha = 0.86 - 0.5 * wet * joint
    step = np.float32(1 / scale)
    return Layer(
        premultiplied(stone * (1 - 0.25 * wet)[..., None], alpha),
        np.array([WALL_LEFT, 0, 0], np.float32),
        np.array([step, 0, 0], np.float32),
        np.array([0, 0, step], np.float32),
    )
