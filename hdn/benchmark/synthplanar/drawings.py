"""SynthPlanar's drawings: posters, streets behind them, people and posts before them, the shadows over them."""

import cv2
import numpy as np
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from ...imaging.arrays import Floats, Image

# fmt: off
WORDS = [
    "NORTH", "RIVER", "MARKET", "SUMMER", "FESTIVAL", "COFFEE", "JAZZ", "NIGHT", "OPEN", "LIGHT", "GARDEN",
    "MUSEUM", "CITY", "TRAIN", "ATLAS", "HARBOUR", "SINCE", "1924", "ORCHARD", "CINEMA", "RADIO", "FRESH",
    "PAPER", "MOUNTAIN", "STUDIO", "48", "HOURS",
]
# fmt: on


def draw_poster(size: tuple[int, int], rng: np.random.Generator) -> Image:
    """A printed poster (height, width, 3): flat shapes, a painted panel, lettering."""
    width, height = size
    colours = palette(5, rng)
    down = np.linspace(0, 1, height, dtype=np.float32)[:, None, None]
    image = colours[0] + (colours[1] - colours[0]) * down + np.zeros((height, width, 1), np.float32)
    image = np.ascontiguousarray(image)
    for _ in range(int(rng.integers(4, 9))):
        _add_shape(image, colours[int(rng.integers(2, 5))], rng)

    # A panel painted with clouds of two colours stands for the photograph that most posters have.
    w, h = int(width * rng.uniform(0.4, 0.7)), int(height * rng.uniform(0.3, 0.5))
    x, y = int(rng.integers(width - w)), int(rng.integers(height - h))
    cloud = 1 / (1 + np.exp(-2.5 * noise((h, w), max(w, h) / 3, rng, 6)))[..., None]
    one, other = colours[2] * 0.35, 255 - (255 - colours[3]) * 0.4
    image[y : y + h, x : x + w] = one + (other - one) * cloud

    image = image * (1 + 0.02 * noise((height, width), 3, rng, 2))[..., None]
    page = Pillow.fromarray(np.clip(image, 0, 255).astype(np.uint8))
    draw = ImageDraw.Draw(page)
    top = height * rng.uniform(0.05, 0.15)
    for line in range(3):
        letters = height * (0.13, 0.09, 0.04)[line]
        text = " ".join(rng.choice(WORDS, (1, 2, 4)[line]))
        face = ImageFont.load_default(max(8.0, min(letters, 1.5 * width * 0.9 / len(text))))
        ink = (245, 243, 235) if image[int(top) : int(top + letters)].mean() < 128 else (24, 22, 28)
        draw.text((width * 0.06, top), text, ink, face, stroke_width=round(letters / 40))
        top = top + 1.2 * letters if line == 0 else height * (0.72 + 0.1 * line)
    return np.asarray(page, np.uint8).copy()


def _add_shape(image: Floats, colour: Floats, rng: np.random.Generator) -> None:
    height, width = image.shape[:2]
    centre = rng.uniform(0, 1, 2) * [width, height]
    size = min(width, height) * rng.uniform(0.06, 0.3)
    kind, ink = int(rng.integers(3)), [float(c) for c in colour]
    if kind == 0:
        cv2.circle(image, [int(c) for c in centre], int(size), ink, -1, cv2.LINE_AA)
    elif kind == 1:
        angles = rng.uniform(0, 2 * np.pi) + np.arange(int(rng.integers(3, 6))) * 2 * np.pi / 5
        corners = centre + size * np.stack([np.cos(angles), np.sin(angles)], 1)
        cv2.fillPoly(image, [corners.astype(np.int32)], ink, cv2.LINE_AA)
    else:
        turn = rng.uniform(0, np.pi)
        along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
        for stripe in range(int(rng.integers(2, 6))):
            middle = centre + across * size * 0.35 * stripe
            ends = [(middle + along * size * s).astype(int).tolist() for s in (-1.5, 1.5)]
            cv2.line(image, ends[0], ends[1], ink, max(1, int(size * 0.12)), cv2.LINE_AA)


def draw_scene(size: tuple[int, int], rng: np.random.Generator) -> Image:
    """A street (height, width, 3): house fronts with windows between sky and pavement."""
    width, height = size
    horizon = int(height * rng.uniform(0.62, 0.8))
    down = np.linspace(0, 1, height, dtype=np.float32)[:, None]
    cloud = 0.5 + 0.2 * noise((height, width), width / 4, rng, 5)
    sky = np.array([150, 178, 205], np.float32) + 60 * (cloud * (0.4 + 0.6 * down))[..., None]
    image = np.ascontiguousarray(sky)
    x = 0
    while x < width:
        w = int(width * rng.uniform(0.08, 0.2))
        top = int(height * rng.uniform(0.02, 0.4))
        _add_house(image[top:horizon, x : x + w], rng)
        x += w
    grey = rng.uniform(70, 120)
    ground = image[horizon:]
    ground[:] = grey + np.float32(12) * noise(ground.shape[:2], 40, rng, 5)[..., None]
    for _ in range(14):  # people, cars and bushes, as far as one makes them out
        half = [int(width * rng.uniform(0.01, 0.05)), int(height * rng.uniform(0.04, 0.14))]
        place = [int(rng.uniform(0, width)), int(horizon + rng.uniform(-0.3, 0.4) * half[1])]
        muted = palette(1, rng)[0] * 0.35 + rng.uniform(10, 70)
        cv2.ellipse(image, place, half, 0, 0, 360, muted.tolist(), -1, cv2.LINE_AA)
    image *= (1 + 0.1 * noise((height, width), 60, rng, 5))[..., None]
    return np.clip(image, 0, 255).astype(np.uint8)


def _add_house(wall: Floats, rng: np.random.Generator) -> None:
    height, width = wall.shape[:2]
    colour = palette(1, rng)[0] * 0.25 + rng.uniform(60, 140)
    wall[:] = colour * (1 + 0.07 * noise((height, width), 30, rng, 4))[..., None]
    columns, rows = int(rng.integers(2, 5)), int(rng.integers(3, 7))
    w, h = width / columns, height / rows
    for row in range(rows):
        for column in range(columns):
            x, y = int((column + 0.25) * w), int((row + 0.2) * h)
            pane = wall[y : y + int(0.6 * h), x : x + int(0.5 * w)]
            pane[:] = rng.uniform(25, 70) if rng.random() < 0.8 else np.array([225, 200, 140])
            wall[y + int(0.6 * h) : y + int(0.66 * h), x : x + int(0.5 * w)] = colour * 1.25
    wall[:, :2] *= 0.6


PERSON, ARM, POST = range(3)
Stroke = tuple[tuple[float, float], tuple[float, float], int, Floats]  # from, to, width, colour


def draw_occluder(rng: np.random.Generator, kind: int | None = None) -> Image:
    """Somebody or something passing by: premultiplied RGBA (1024, 256, 4), what matters in the upper half.

    kind: PERSON, ARM or POST; by chance where it is not given.
    """
    mask = np.zeros((1024, 256), np.uint8)
    kind = int(rng.integers(3)) if kind is None else kind
    if kind == PERSON:  # from the hips up
        cv2.ellipse(mask, (128, 90), (46, 62), 0, 0, 360, 255, -1)
        cv2.rectangle(mask, (102, 130), (154, 190), 255, -1)
        cv2.ellipse(mask, (128, 300), (116, 130), 0, 180, 360, 255, -1)
        cv2.rectangle(mask, (12, 300), (244, 1000), 255, -1)
    elif kind == ARM:  # raised
        cv2.line(mask, (128, 1100), (128, 190), 255, 84)
        cv2.ellipse(mask, (128, 150), (56, 70), 0, 0, 360, 255, -1)
        for x, y in ((84, 60), (110, 36), (138, 34), (166, 56)):
            cv2.line(mask, (128, 140), (x, y), 255, 24)
        cv2.line(mask, (120, 190), (60, 140), 255, 28)
    else:  # a post with a sign
        cv2.rectangle(mask, (112, 20), (144, 1100), 255, -1)
        cv2.circle(mask, (128, 110), 90, 255, -1)
    # Cloth below, skin or paint above; light from one side, folds, soft edges.
    cloth, top = palette(2, rng) * 0.4 + 25
    skin = np.array([205, 158, 130], np.float32) * rng.uniform(0.45, 1.0) if kind < 2 else top
    split = (185, 250, 0)[kind]
    colour = np.where(np.arange(1024)[:, None, None] < split, skin, cloth)
    across = np.linspace(-1, 1, 256, dtype=np.float32)[None, :, None]
    folds = noise((1024, 256), 50, rng, 4)[..., None]
    colour = colour * (0.85 - 0.3 * across * rng.choice([-1, 1]) + 0.08 * folds)
    alpha = cv2.GaussianBlur(mask, (0, 0), 2.0)[..., None]
    premultiplied = np.clip(colour, 0, 255) * (alpha / 255)
    return np.concatenate([premultiplied.astype(np.uint8), alpha], 2)


def draw_long_hair(rng: np.random.Generator) -> Image:
    """Somebody with loose hair, as `draw_occluder` draws a person: strands as thin as one sees them apart."""
    drawn = draw_occluder(rng, PERSON)
    colour = np.array([95, 62, 38], np.float32) * rng.uniform(0.3, 2.2)
    for _ in range(220):
        turn, length = rng.uniform(-2.6, 2.6), rng.uniform(60, 170)  # from upright, rad
        x, y = 128 + 44 * np.sin(turn), 90 - 60 * np.cos(turn)
        steps = np.linspace(0, 1, 9)
        across = x + 40 * np.sin(turn) * steps**0.7 + 6 * np.sin(5 * steps + rng.uniform(0, 6))
        strand = np.stack([across, y + length * steps**1.4 - 14 * steps], 1).round().astype(np.int32)
        ink = [float(c) for c in np.clip(colour * rng.uniform(0.6, 1.3), 0, 255)]
        cv2.polylines(drawn, [strand], False, [*ink, 255], 1, cv2.LINE_AA)
    return drawn


def draw_hand(rng: np.random.Generator) -> Image:
    """A hand with its forearm, fingers upward: premultiplied RGBA (2048, 512, 4), the hand around row 512."""
    height, width = 2048, 512
    skin = np.array([222, 175, 146], np.float32) * rng.uniform(0.3, 1.05)
    sleeve = palette(1, rng)[0] * 0.5 + 20
    spread, left = rng.uniform(0.5, 1.2), rng.random() < 0.5
    strokes: list[Stroke] = [((256, 780), (256, 2300), 170, skin), ((256, 900), (256, 2300), 230, sleeve)]
    for finger, length in enumerate((235, 285, 270, 200)):
        x, y = 172 + 56 * finger, 586
        lean, reach = spread * (finger - 1.5) * 0.22 + rng.normal(0, 0.05), length * rng.uniform(0.85, 1)
        strokes.append(((x, y), (x + reach * np.sin(lean), y - reach * np.cos(lean)), 54, skin))
    strokes += [((180, 690), (100 - 50 * spread, 530), 60, skin), ((256, 640), (256, 710), 210, skin)]  # thumb, palm
    image, alpha = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.uint8)
    for start, end, thickness, colour in strokes:
        mask = np.zeros((height, width), np.uint8)
        cv2.line(mask, [int(c) for c in start], [int(c) for c in end], 255, thickness)
        depth = np.minimum(cv2.distanceTransform(mask, cv2.DIST_L2, 3) / (thickness / 2), 1)
        shade = (0.6 + 0.4 * np.sqrt(depth))[..., None]  # round: darker to its sides
        image = np.where(mask[..., None] > 0, colour * shade, image)
        alpha |= mask
    image = image * (1 + 0.04 * noise((height, width), 24, rng, 4))[..., None]
    soft = cv2.GaussianBlur(alpha, (0, 0), 2.0)[..., None]
    drawn = np.concatenate([(np.clip(image, 0, 255) * (soft / 255)).astype(np.uint8), soft], 2)
    return np.ascontiguousarray(drawn[:, ::-1] if left else drawn)


def draw_wall(size: tuple[int, int], rng: np.random.Generator) -> Image:
    """A wall (height, width, 3) of modest texture: plaster with the joints of bricks or of panels, and some stains."""
    width, height = size
    colour = palette(1, rng)[0] * 0.2 + rng.uniform(90, 160)
    wall = np.ascontiguousarray(colour * (1 + 0.05 * noise((height, width), width / 5, rng, 7))[..., None])
    bricks = rng.random() < 0.5
    h = int(width * (rng.uniform(0.025, 0.04) if bricks else rng.uniform(0.18, 0.3)))
    w, joint = int(h * rng.uniform(1.6, 2.6)), max(1, h // (10 if bricks else 40))
    for row, y in enumerate(range(0, height, h)):
        for x in range(-w + (w // 2) * (row % 2), width, w):
            wall[y : y + h, max(x, 0) : max(x + w, 0)] *= 1 + rng.normal(0, 0.04)
            wall[y : y + h, max(x, 0) : max(x + joint, 0)] *= 0.8
        wall[y : y + joint] *= 0.8
    stains = np.clip(noise((height, width), width / 8, rng, 5) - 1.5, 0, 1)
    return np.clip(wall * (1 - 0.3 * stains)[..., None], 0, 255).astype(np.uint8)


def draw_shadows(size: int, rng: np.random.Generator) -> Image:
    """What share of the sun's light (255: all) falls where, (size, size): edges of houses, boughs and leaves."""
    light = np.full((size, size), 255, np.uint8)
    turn = rng.uniform(0, np.pi)
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    for _ in range(int(rng.integers(2, 5))):
        middle = rng.uniform(0.1, 0.9, 2) * size
        ends = [(middle + along * 2 * size * s + across * size * rng.uniform(-0.3, 0.3)).astype(int) for s in (-1, 1)]
        cv2.line(light, ends[0].tolist(), ends[1].tolist(), 0, int(size * rng.uniform(0.03, 0.16)), cv2.LINE_AA)
    leaves = noise((size, size), size / 8, rng, 3) + 1.5 * noise((size, size), size / 2, rng, 2)
    light[leaves > 2.2] = 0
    return np.asarray(cv2.GaussianBlur(light, (0, 0), size * rng.uniform(0.004, 0.015)), np.uint8)


def draw_edge(size: int, rng: np.random.Generator) -> Image:
    """What share of the sun's light falls where, as `draw_shadows`: a house's and a post's edge through the middle."""
    light = np.full((size, size), 255, np.uint8)
    for width, offset in ((rng.uniform(0.15, 0.4), 0.04), (rng.uniform(0.015, 0.04), 0.12)):
        turn = rng.uniform(0, 2 * np.pi)
        along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
        middle = size * (0.5 + across * (width / 2 + rng.uniform(-offset, offset)))
        ends = [(middle + along * 2 * size * s).astype(int).tolist() for s in (-1, 1)]
        cv2.line(light, ends[0], ends[1], 0, int(size * width), cv2.LINE_AA)
    return np.asarray(cv2.GaussianBlur(light, (0, 0), size * rng.uniform(0.0015, 0.006)), np.uint8)


def noise(shape: tuple[int, ...], cell: float, rng: np.random.Generator, octaves: int) -> Floats:
    """Smooth fractal noise (height, width) of zero mean and unit deviation; the largest blobs are `cell` px wide."""
    height, width = shape
    total = np.zeros((height, width), np.float32)
    for octave in range(octaves):
        step = max(cell / 2**octave, 1.0)
        grid = rng.standard_normal((int(height / step) + 2, int(width / step) + 2)).astype(np.float32)
        total += cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC) / 2**octave
    return np.asarray((total - total.mean()) / (total.std() + 1e-6), np.float32)


def palette(count: int, rng: np.random.Generator) -> Floats:
    """Colours (count, 3), 0..255, that differ in hue and lightness as printed ones do."""
    hue = (rng.uniform(0, 180) + rng.uniform(15, 75) * np.arange(count)) % 180
    tones = np.stack([hue, rng.uniform(50, 220, count), rng.permutation(np.linspace(45, 245, count + 1))[:count]], 1)
    return np.asarray(cv2.cvtColor(tones[None].astype(np.uint8), cv2.COLOR_HSV2RGB)[0], np.float32)
