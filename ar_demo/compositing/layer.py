"""A layer: the part of a frame that a picture drawn in perspective takes, with its transparency."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Box, Floats, Image, Picture

Frame = Image | NDArray[np.uint16]
"""(H, W, 3) RGB, uint8 0..255 or uint16 0..65535."""


@dataclass(frozen=True)
class Layer:
    """What is laid on a frame.

    Attributes:
        box: the rows and columns of the frame that it takes; all inside the frame.
        rgba: (h, w, 4) RGB times alpha, and alpha: uint8 0..255, or float32 0..1.
    """

    box: Box
    rgba: Image | Floats


def as_box(x0: int, y0: int, x1: int, y1: int) -> Box:
    """The box of a frame from (x0, y0) up to, not including, (x1, y1)."""
    return slice(y0, y1), slice(x0, x1)


def peak(dtype: np.dtype[Any]) -> float:
    """The value that stands for white, or for opaque, in pixels of this type."""
    return float(np.iinfo(dtype).max) if dtype.kind == "u" else 1.0


def in_float(pixels: Picture) -> Floats:
    """Pixels of any type as float32, 0..1; the same array where they are already."""
    if pixels.dtype == np.float32:
        return np.asarray(pixels, np.float32)
    return np.multiply(pixels, 1 / peak(pixels.dtype), dtype=np.float32)


def overlap(a: Box, b: Box) -> Box | None:
    """What two boxes share; None for nothing."""
    top, left = max(a[0].start, b[0].start), max(a[1].start, b[1].start)
    bottom, right = min(a[0].stop, b[0].stop), min(a[1].stop, b[1].stop)
    return as_box(left, top, right, bottom) if top < bottom and left < right else None


def within(inner: Box, outer: Box) -> Box:
    """A box of the frame as rows and columns of a box that contains it."""
    rows, columns = inner
    top, left = outer[0].start, outer[1].start
    return slice(rows.start - top, rows.stop - top), slice(columns.start - left, columns.stop - left)
