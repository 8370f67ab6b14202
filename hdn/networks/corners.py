"""What the compact residual network says, from what it computed of two crops."""

import numpy as np

from ..imaging.arrays import Array, Floats
from ..imaging.quads import square


def conclude(size: int, normal: Floats, right: Floats, visible: Floats) -> tuple[Array, Floats]:
    """Corner offsets and visibility by what `ResidualNetwork.compare` gives.

    Args:
        size: of the residual crop, px.
        normal, right: (1, 8, 8) and (1, 8), the normal equations of the homography's parameters, see `equations`.
        visible: (1, m * m) logits.

    Returns:
        Offsets (4, 2) px from the crop's corners to the target's; probability (m, m) that each part of it is seen.
    """
    cells = round(visible.size**0.5)
    probability = 0.5 + 0.5 * np.tanh(visible[0] / 2)  # the logistic function, which cannot overflow
    return corner_offsets(size, normal[0], right[0]), probability.reshape(cells, cells)


def corner_offsets(size: int, normal: Floats, right: Floats) -> Array:
    """Offsets (4, 2) px of a crop's corners by normal equations (8, 8), (8,); as `ResidualNetwork.solve`."""
    parameters = np.linalg.solve(normal.astype(np.float64), right.astype(np.float64))
    matrix = np.append(parameters, 0.0).reshape(3, 3) + np.eye(3)  # of coordinates that are -1 and 1 at the corners
    corners = square(2) - 0.5
    moved = np.column_stack([corners, np.ones(4)]) @ matrix.T
    return (moved[:, :2] / np.maximum(moved[:, 2:], 0.1) - corners) * (size / 2)
