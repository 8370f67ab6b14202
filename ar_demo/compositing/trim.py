"""Less than the whole quad: an inset from its border, and rounded corners."""

import numpy as np

from hdn.imaging.arrays import Array, Floats
from hdn.imaging.homography import from_corners, transform

from .layer import Layer, in_float


def inset_pose(pose: Array, size: Array, inset: float) -> Array:
    """The corners (4, 2) of what is left of a surface at a pose (4, 2), px.

    Args:
        size: (2,) width and height of the surface in its reference frame, px. inset: from its border, px of that frame.
    """
    if not inset:
        return pose
    inner = _rectangle(size)
    inner += inset * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return transform(from_corners(_rectangle(size), pose), inner)


def rounded(layer: Layer, pose: Array, size: Array, radius: float, feather: float = 0.0) -> Layer:
    """A layer at a pose (4, 2) with rounded corners; edges as smooth as a pixel, or as the feather.

    Args:
        size: (2,) width and height of the surface in its reference frame, px. radius: px of that frame.
        feather: px of the frame over which the edge fades.
    """
    if not radius:
        return layer
    rows, columns = layer.box
    y, x = np.mgrid[rows, columns].astype(np.float64)
    to_surface = from_corners(pose, _rectangle(size))
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in to_surface)
    u, v = u / w, v / w
    # How far within the square of the nearest corner a pixel is, from the middle of the arc outward.
    across = np.maximum(radius - np.minimum(u, size[0] - u), 0)
    down = np.maximum(radius - np.minimum(v, size[1] - v), 0)
    frame_per_surface = np.sqrt(np.abs(w**3 / np.linalg.det(to_surface)))  # px, of the lengths
    beyond = (np.hypot(across, down) - radius) * frame_per_surface
    cover = np.where((across > 0) & (down > 0), np.clip(0.5 - beyond / max(feather, 1.0), 0, 1), 1)
    rgba: Floats = in_float(layer.rgba) * cover.astype(np.float32)[..., None]
    return Layer(layer.box, rgba)


def _rectangle(size: Array) -> Array:
    width, height = size
    return np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64)
