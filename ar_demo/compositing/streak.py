"""Motion blur of a layer: the mean of all that it shows while the shutter is open."""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Floats
from hdn.imaging.homography import from_corners, translation

from .layer import Layer, as_box, peak


@dataclass(frozen=True)
class StreakModel:
    """How finely the way is sampled."""

    least_px: float = 0.7  # of a corner's way, below which nothing is done
    step_px: float = 1.5  # between two samples, at most ...
    most: int = 24  # ... but no more samples


MODEL = StreakModel()


def smeared(layer: Layer, pose: Array, way: Array, frame_shape: tuple[int, int]) -> Layer:
    """A layer drawn at a pose, along the way of its corners; each point moves as perspective has it.

    Args:
        pose: (4, 2) px, the corners in the middle of the exposure.
        way: (4, 2) px, from where they are at its beginning to where they are at its end.
        frame_shape: height and width, px.
    """
    longest = float(np.linalg.norm(way, axis=1).max())
    if longest < MODEL.least_px:
        return layer
    reach = int(np.ceil(longest / 2)) + 1
    rows, columns = layer.box
    top, left = max(rows.start - reach, 0), max(columns.start - reach, 0)
    bottom, right = min(rows.stop + reach, frame_shape[0]), min(columns.stop + reach, frame_shape[1])
    size = right - left, bottom - top
    count = min(int(np.ceil(longest / MODEL.step_px)) + 1, MODEL.most)
    total: Floats = np.zeros((size[1], size[0], 4), np.float32)
    for part in (np.arange(count) + 0.5) / count - 0.5:
        moved = (
            translation(-left, -top) @ from_corners(pose, pose + part * way) @ translation(columns.start, rows.start)
        )
        cv2.accumulate(cv2.warpPerspective(layer.rgba, moved, size), total)
    total *= np.float32(1 / (count * peak(layer.rgba.dtype)))
    return Layer(as_box(left, top, right, bottom), total)
