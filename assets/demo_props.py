"""What stands and walks before the demo clip's wall: the framed poster, a bicycle, someone with an umbrella."""

from collections.abc import Sequence

import cv2
import numpy as np
from demo_paint import (
    CREAM,
    FRAME_EDGE,
    POSTER,
    POSTER_PROUD,
    Bytes,
    Colour,
    Floats,
    Layer,
    floats,
    font,
    lettering,
    noise,
    opaque,
    premultiplied,
    ramp,
    upright,
)
from PIL import Image, ImageDraw


def poster_print(rng: np.random.Generator) -> Bytes:
    """The printed sheet, 800 x 1000: a festival poster with a lake, ridges under a ringed sun, and small print."""
    width, height = 1600, 2000
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    sky = np.array([[18, 38, 72], [46, 84, 120], [226, 140, 92], [250, 206, 138]], np.float32)
    level = np.interp(y[:, 0], [0, 520, 980, 1180], [0, 1, 2, 3])
    art = np.stack([np.interp(level, range(4), sky[:, c]) for c in range(3)], -1)[:, None].repeat(width, 1)
    radius = np.hypot(x - 960, y - 820)
    for ring, shade in ((430, 0.13), (360, 0.16), (290, 0.22)):
        art += (floats([255, 214, 150]) - art) * (shade * ramp(ring + 3, ring - 3, radius))[..., None]
    art += (floats([255, 236, 190]) - art) * ramp(222, 216, radius)[..., None]
    ridges: Sequence[tuple[float, float, Colour]] = (
        (1010, 150, (168, 122, 122)),
        (1120, 120, (104, 92, 116)),
        (1230, 100, (52, 66, 98)),
        (1330, 70, (22, 40, 66)),
    )
    for base, tall, colour in ridges:
        crest = base - tall * (0.4 + noise((1, width), 420, rng, 6)[0])
        mist = np.clip((y - crest) / 420, 0, 0.45)[..., None]
        tone = floats(colour) * (1 - mist) + floats([238, 170, 130]) * mist
        art += (tone - art) * ramp(-1.5, 1.5, y - crest)[..., None]
    lake = slice(1400, 1660)
    ripple = noise((260, width // 8), 14, rng, 2).repeat(8, 1)[:, :width]
    glow = np.exp(-(((x[lake] - 960) / (150 + 0.8 * (y[lake] - 1400))) ** 2)) * ramp(-0.2, 0.7, ripple)
    water = floats([30, 66, 100]) + ripple[..., None] * floats([5, 7, 9])
    art[lake] = water + (floats([252, 190, 128]) - water) * glow[..., None]
    image = Image.fromarray(opaque(art))
    draw = ImageDraw.Draw(image)
    for star in rng.uniform((0, 0, 1.0), (width, 560, 4.0), (90, 3)):
        draw.ellipse([star[0] - star[2], star[1] - star[2], star[0] + star[2], star[1] + star[2]], (232, 226, 214))
    draw.polygon([(520, 1500), (520, 1215), (680, 1490)], (246, 236, 214))
    draw.polygon([(505, 1490), (505, 1265), (400, 1485)], (222, 84, 62))
    draw.polygon([(380, 1508), (700, 1508), (640, 1556), (430, 1556)], (20, 30, 50))
    for bx, by, span in ((1180, 560, 46), (1290, 610, 34), (1110, 640, 28), (420, 760, 36), (510, 720, 26)):
        draw.arc([bx - 2 * span, by, bx, by + span], 200, 345, (24, 34, 58), 7)
        draw.arc([bx, by, bx + 2 * span, by + span], 195, 340, (24, 34, 58), 7)
    draw.rectangle([0, 1660, width, height], CREAM)
    draw.rectangle([0, 1660, width, 1676], (222, 84, 62))
    lettering(draw, 800, 215, "LAKESIDE", 250, CREAM, 24)
    lettering(draw, 800, 400, "SUMMER NIGHTS FESTIVAL", 92, (250, 190, 120), 14)
    lettering(draw, 470, 1752, "12 - 15 JULY", 128, (24, 40, 72), 6)
    lettering(draw, 470, 1858, "FOLK / JAZZ / STRINGS / BRASS", 50, (222, 84, 62), 4)
    lettering(draw, 470, 1930, "OPEN AIR BY THE OLD BOATHOUSE", 46, (60, 70, 90), 3)
    for line, names in enumerate(("Ada Fenwick Trio", "The Heron Quartet", "Brass on Barges", "Ottoline & Rook")):
        draw.text((936, 1716 + 62 * line), names, (24, 40, 72), font(50))
    for cell in np.argwhere(rng.random((11, 11)) < 0.5):
        px, py = 1416 + 12 * cell[1], 1730 + 12 * cell[0]
        draw.rectangle([px, py, px + 11, py + 11], (24, 40, 72))
    draw.rectangle([1404, 1718, 1559, 1873], None, (24, 40, 72), 6)
    lettering(draw, 1482, 1915, "TICKETS", 38, (24, 40, 72), 3)
    sheet = np.asarray(image, np.float32) * (1 + 0.018 * noise((height, width), 6, rng))[..., None]
    return cv2.resize(opaque(sheet), (800, 1000), interpolation=cv2.INTER_AREA)


def framed_poster(poster: Bytes) -> Layer:
    """The print in its metal frame, on the plane z = POSTER_PROUD, with the inner edge's soft shadow on the sheet."""
    scale = poster.shape[1] / (POSTER[2] - POSTER[0])
    edge = round(FRAME_EDGE * scale)
    height, width = poster.shape[:2]
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    inner = np.minimum(
        ramp(-6, 16, y), np.minimum(ramp(-6, 14, x), ramp(-14, 6, np.minimum(width - 1 - x, height - 1 - y)))
    )
    sheet = poster * (0.62 + 0.38 * inner)[..., None]
    full = cv2.copyMakeBorder(sheet, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=(52, 54, 58)).astype(np.float32)
    y, x = np.mgrid[0 : full.shape[0], 0 : full.shape[1]].astype(np.float32)
    for distance, gain in ((y, 0.9), (x, 0.5), (full.shape[0] - 1 - y, -0.3), (full.shape[1] - 1 - x, -0.2)):
        full += full * (gain * ((distance < 5) & (distance < edge)))[..., None]
    bright = cv2.copyMakeBorder(
        premultiplied(full, np.ones(full.shape[:2], np.float32)), 1, 1, 1, 1, cv2.BORDER_CONSTANT
    )
    pad = (edge + 1) / scale
    return upright(bright, POSTER[0] - pad, POSTER[3] + pad, POSTER_PROUD, scale)


def rounded(mask: Bytes, reach: float) -> Floats:
    """Shading in 0..1.4 of a flat shape puffed up to a body: its distance field as height, lit from above left."""
    bump = np.sqrt(np.minimum(cv2.distanceTransform(mask, cv2.DIST_L2, 5), reach) / reach)
    bump = cv2.GaussianBlur(bump, (0, 0), reach / 6) * reach
    slope_x, slope_y = cv2.Sobel(bump, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(bump, cv2.CV_32F, 0, 1, scale=1 / 8)
    lit = (0.5 * slope_x + 0.62 * slope_y + 0.75) / np.sqrt(1 + slope_x**2 + slope_y**2)
    return np.asarray(np.clip(0.3 + 0.85 * lit, 0.12, 1.4), np.float32)


def bicycle(scale: int = 420) -> tuple[Layer, Layer]:
    """A bicycle leaning at the wall, and its soft shadow on the wall; drawn at twice the size."""
    s, width, height = 2 * scale, 1.9, 1.2
    shape = (int(height * s), int(width * s))
    colour, alpha = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.uint8)

    def at(point: Sequence[float]) -> tuple[int, int]:
        return round(point[0] * s), round((height - point[1]) * s)

    def stroke(mask: Bytes, tint: Colour, reach: float) -> None:
        nonlocal colour, alpha
        colour = np.where(mask[..., None] > 0, floats(tint) * rounded(mask, reach * s)[..., None], colour)
        alpha = np.maximum(alpha, mask)

    def lines(points: Sequence[Sequence[float]], thick: float, tint: Colour) -> None:
        mask = np.zeros(shape, np.uint8)
        cv2.polylines(mask, [np.array([at(p) for p in points], np.int32)], False, 255, round(thick * s), cv2.LINE_8)
        stroke(mask, tint, thick / 2)

    back, front, pedal, seat, head, fork = (
        (0.38, 0.35),
        (1.46, 0.35),
        (0.84, 0.31),
        (0.68, 0.82),
        (1.27, 0.84),
        (1.31, 0.72),
    )
    for hub in (back, front):
        for spoke in np.arange(0, 2 * np.pi, 2 * np.pi / 18):
            lines([hub, (hub[0] + 0.31 * np.cos(spoke), hub[1] + 0.31 * np.sin(spoke))], 0.003, (150, 150, 150))
        for radius, thick, tint in (
            (0.335, 0.03, (26, 26, 28)),
            (0.31, 0.014, (170, 170, 168)),
            (0.02, 0.03, (120, 120, 120)),
        ):
            ring = np.zeros(shape, np.uint8)
            cv2.circle(ring, at(hub), round(radius * s), 255, round(thick * s))
            stroke(ring, tint, thick / 2)
    teal: Colour = (44, 124, 128)
    for path in ([back, pedal, seat, back], [pedal, fork, head], [(0.71, 0.74), (1.275, 0.8)], [fork, front]):
        lines(path, 0.03, teal)
    lines([seat, (0.655, 0.92)], 0.024, (160, 160, 160))
    lines([(0.54, 0.935), (0.63, 0.95), (0.78, 0.925)], 0.055, (86, 52, 34))
    lines([head, (1.255, 0.97), (1.36, 1.0), (1.38, 0.94)], 0.024, (160, 160, 160))
    lines([(1.36, 1.0), (1.27, 0.99)], 0.036, (86, 52, 34))
    lines([(0.76, 0.26), (0.92, 0.36)], 0.02, (60, 60, 62))
    crank = np.zeros(shape, np.uint8)
    cv2.circle(crank, at(pedal), round(0.085 * s), 255, round(0.018 * s))
    stroke(crank, (110, 110, 112), 0.009)
    half = (shape[1] // 2, shape[0] // 2)
    cover = cv2.resize(alpha, half, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    paint = cv2.resize(premultiplied(colour, floats(alpha / 255)), half, interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(cover, (0, 0), 0.02 * scale) * 0.7
    shadow = premultiplied(np.zeros((*soft.shape, 3), np.float32), soft)
    return upright(shadow, -2.5, height - 0.06, 0.004, scale), upright(paint, -2.6, height, 0.22, scale)


def passer_by(scale: int = 300) -> tuple[Bytes, float]:
    """Someone in a coat under an umbrella, seen from the side and out of focus: premultiplied texture and its scale.

    The texture is 1.8 m wide and 2.4 m tall; its bottom is the pavement.
    """
    s, width, height = scale, 1.8, 2.4
    shape = (int(height * s), int(width * s))
    colour, alpha = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.uint8)

    def part(points: Sequence[Sequence[float]], tint: Colour, reach: float) -> None:
        """A closed outline through the points, rounded off, with a body's shading."""
        nonlocal colour, alpha
        mask = np.zeros(shape, np.uint8)
        cv2.fillPoly(mask, [np.array([(x * s, (height - y) * s) for x, y in points], np.int32)], 255)
        mask = np.where(cv2.GaussianBlur(mask, (0, 0), 0.018 * s) > 127, 255, 0).astype(np.uint8)
        colour = np.where(mask[..., None] > 0, floats(tint) * rounded(mask, reach * s)[..., None], colour)
        alpha = np.maximum(alpha, mask)

    navy, skin = (52, 62, 92), (196, 146, 118)
    part([(0.74, 0.02), (0.84, 0.02), (0.9, 0.7), (0.74, 0.7)], (44, 44, 50), 0.06)
    part([(0.98, 0.04), (1.14, 0.04), (1.06, 0.7), (0.9, 0.7)], (38, 38, 44), 0.06)
    coat = [
        (0.64, 0.56),
        (1.16, 0.54),
        (1.13, 0.95),
        (1.1, 1.3),
        (1.07, 1.43),
        (0.95, 1.5),
        (0.8, 1.49),
        (0.7, 1.4),
        (0.67, 1.0),
    ]
    part(coat, navy, 0.2)
    part([(0.88, 1.5), (0.9, 1.72), (1.02, 1.75), (1.055, 1.7), (1.085, 1.625), (1.05, 1.53), (0.94, 1.49)], skin, 0.09)
    hair = [(0.83, 1.48), (0.8, 1.6), (0.83, 1.72), (0.98, 1.74), (1.0, 1.68), (0.97, 1.56), (0.93, 1.48)]
    part(hair, (88, 54, 38), 0.08)
    part([(0.815, 1.69), (0.83, 1.8), (0.92, 1.855), (1.02, 1.83), (1.065, 1.74), (1.06, 1.7)], (170, 72, 58), 0.07)
    part([(0.8, 1.665), (0.81, 1.715), (0.94, 1.735), (1.07, 1.735), (1.075, 1.69), (0.94, 1.69)], (148, 58, 48), 0.03)
    part([(0.77, 1.41), (1.07, 1.4), (1.08, 1.47), (1.05, 1.53), (0.81, 1.54)], (186, 62, 52), 0.05)
    part([(0.78, 1.45), (0.86, 1.44), (0.84, 1.08), (0.74, 1.1)], (176, 56, 48), 0.04)
    part(
        [(0.84, 1.38), (0.97, 1.4), (1.1, 1.14), (1.2, 1.26), (1.26, 1.22), (1.14, 1.0), (1.04, 1.0)],
        (46, 56, 84),
        0.07,
    )
    part([(1.18, 1.2), (1.27, 1.2), (1.27, 1.29), (1.19, 1.3)], skin, 0.04)
    part([(1.13, 2.2), (1.16, 2.2), (1.235, 1.16), (1.205, 1.16)], (40, 36, 34), 0.012)
    angle = np.linspace(0, np.pi, 60)
    dome = [(1.1 - 0.68 * np.cos(a), 1.76 + 0.5 * np.sin(a) ** 0.85) for a in angle]
    hem = [(1.1 + 0.68 * (1 - 2 * t), 1.76 + 0.035 * abs(np.sin(5 * np.pi * t))) for t in np.linspace(0, 1, 50)]
    part(dome + hem, (222, 164, 44), 0.3)
    for rib in (-0.62, -0.22, 0.22, 0.62):
        curve = [
            (round((1.1 + 0.68 * rib * np.sin(a)) * s), round((height - 1.78 - 0.48 * np.cos(a)) * s))
            for a in angle[:31]
        ]
        cv2.polylines(colour, [np.array(curve, np.int32)], False, (150, 102, 22), 2, cv2.LINE_AA)
    blurred = cv2.GaussianBlur(premultiplied(colour, floats(alpha / 255)), (0, 0), 0.013 * s)
    return blurred, scale
