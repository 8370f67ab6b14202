"""What the demo's drawings share: the scene's measures, flat layers in the world, noise, lettering.

World axes are in metres: x along the wall to the right, y up from the pavement, z out of the wall towards the camera.
Textures hold gamma-2 values (linear light = value squared), so that the renderer can average light by summing squares.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import ImageDraw, ImageFont

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Colour = tuple[int, int, int]

POSTER = (-0.6, 0.82, 0.6, 2.32)  # the print: left, bottom, right, top in metres, a 4:5 sheet
POSTER_PROUD = 0.05  # the frame stands this far off the wall
FRAME_EDGE = 0.045  # width of the metal frame around the print
FRAME = (POSTER[0] - FRAME_EDGE, POSTER[1] - FRAME_EDGE, POSTER[2] + FRAME_EDGE, POSTER[3] + FRAME_EDGE)
WALL_LEFT, WALL_RIGHT, WALL_TOP, MIRROR_DEPTH = -4.0, 10.0, 5.0, 2.4
WALL_SCALE = 360  # texture pixels per metre
CREAM: Colour = (238, 226, 198)


@dataclass(frozen=True)
class Layer:
    """A flat texture in the world. Pixel (i, j) has its centre at `origin + right * (i + 0.5) + down * (j + 0.5)`."""

    texture: Bytes  # (H, W, 3) opaque, or (H, W, 4) with premultiplied alpha
    origin: Floats  # (3,) the world point of the texture's top-left outer corner
    right: Floats  # (3,) one texture pixel to the right, in metres
    down: Floats  # (3,) one texture pixel down, in metres


def upright(texture: Bytes, left: float, top: float, z: float, scale: float) -> Layer:
    """A layer parallel to the wall, `scale` pixels per metre."""
    step = np.float32(1 / scale)
    return Layer(
        texture,
        np.array([left, top, z], np.float32),
        np.array([step, 0, 0], np.float32),
        np.array([0, -step, 0], np.float32),
    )


def noise(shape: tuple[int, ...], cell: float, rng: np.random.Generator, octaves: int = 3) -> Floats:
    """Smooth fractal noise of zero mean and unit deviation; `cell` is the largest blob's size in pixels."""
    height, width = shape
    total = np.zeros((height, width), np.float32)
    for octave in range(octaves):
        size = max(cell / 2**octave, 1.0)
        grid = rng.standard_normal((int(height / size) + 2, int(width / size) + 2)).astype(np.float32)
        total += cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC) / 2**octave
    return np.asarray((total - total.mean()) / total.std(), np.float32)


def floats(values: ArrayLike) -> Floats:
    return np.array(values, np.float32)


def ramp(low: float, high: float, value: Floats) -> Floats:
    """0 below `low`, 1 above `high`, smooth between."""
    t = np.clip((value - low) / (high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), np.float32)


def font(size: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def lettering(draw: ImageDraw.ImageDraw, x: float, y: float, text: str, size: float, fill: Colour, gap: float) -> None:
    """Text centred at x with `gap` pixels between the letters; y is the letters' middle."""
    face = font(size)
    widths = [draw.textlength(letter, face) for letter in text]
    x -= (sum(widths) + gap * (len(text) - 1)) / 2
    for letter, width in zip(text, widths, strict=True):
        draw.text((x, y), letter, fill, face, anchor="lm", stroke_width=size / 60)
        x += width + gap


def opaque(values: Floats) -> Bytes:
    return np.asarray(np.clip(values, 0, 255), np.uint8)


def premultiplied(colour: Floats, alpha: Floats) -> Bytes:
    """(H, W, 3) colours and (H, W) cover in 0..1 as (H, W, 4) bytes."""
    return opaque(np.dstack([colour * alpha[..., None], alpha * 255]))
