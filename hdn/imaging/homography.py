"""Homographies: from corners, as transforms of points, and the quads that they carry.

Pixel coordinates: x right, y down, the centre of the top-left pixel is (0, 0).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Array


def from_corners(source: Array, target: Array) -> Array:
    """The homography (3, 3) that maps four points onto four points, each (4, 2); H[2, 2] = 1.

    Raises:
        ValueError: the points do not determine a homography (three of them on a line).
    """
    # OpenCV's getPerspectiveTransform takes single precision corners only.
    x, y = source[:, 0], source[:, 1]
    u, v = target[:, 0], target[:, 1]
    zero, one = np.zeros(4), np.ones(4)
    system = np.concatenate(
        [
            np.stack([x, y, one, zero, zero, zero, -u * x, -u * y], 1),
            np.stack([zero, zero, zero, x, y, one, -v * x, -v * y], 1),
        ]
    )
    try:
        solution = np.linalg.solve(system, np.concatenate([u, v]))
    except np.linalg.LinAlgError as error:
        raise ValueError("the corners do not determine a homography: three of them lie on a line") from error
    return np.append(solution, 1.0).reshape(3, 3)


def normalised(matrix: Array) -> Array:
    """The same homography with H[2, 2] = 1."""
    return matrix / matrix[2, 2]


def transform(matrix: Array, points: Array) -> Array:
    """Points (..., 2) through a homography (3, 3)."""
    p = points @ matrix[:, :2].T + matrix[:, 2]
    return p[..., :2] / p[..., 2:]


def derivative(matrix: Array, point: Array) -> Array:
    """How a homography (3, 3) moves what is about a point (2,): (2, 2), its columns for a step along x and along y."""
    x, y, w = matrix @ np.append(point, 1.0)
    return np.asarray((matrix[:2, :2] - np.outer([x / w, y / w], matrix[2, :2])) / w)


def parameter_rows(u: Array, v: Array, dx: NDArray[Any], dy: NDArray[Any]) -> Array:
    """What a warp's eight parameters, its difference to the identity, move points (N,) by: (N, 8), along (dx, dy)."""
    radial = u * dx + v * dy
    return np.stack([u * dx, v * dx, dx, u * dy, v * dy, dy, -u * radial, -v * radial], 1)


def translation(x: float, y: float) -> Array:
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def similarity(scale: float, rotation: float, x: float, y: float) -> Array:
    """The similarity group of the decomposition (paper, eq. 2); rotation in radians, from x to y."""
    c, s = scale * np.cos(rotation), scale * np.sin(rotation)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])
