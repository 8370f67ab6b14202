"""Homographies (3, 3): made from corners or by kind, applied to points, differentiated.

Pixel coordinates: x right, y down, the centre of the top-left pixel is (0, 0).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .quads import cross


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
    """Points (..., 2) mapped by a homography (3, 3)."""
    p = points @ matrix[:, :2].T + matrix[:, 2]
    return p[..., :2] / p[..., 2:]


def unit_to_quad(quad: Array) -> Array:
    """The homography (3, 3) that maps the unit square (0,0), (1,0), (1,1), (0,1) onto a convex quad (4, 2).

    In closed form (Heckbert, Fundamentals of Texture Mapping and Image Warping, 1989, section 2.2.3): exact for quads
    that are very thin too, for which `from_corners` solves a badly conditioned system.
    """
    top_left, top_right, bottom_right, bottom_left = quad
    skew = top_left - top_right + bottom_right - bottom_left
    right, bottom = top_right - bottom_right, bottom_left - bottom_right
    g, h = cross(skew, bottom) / cross(right, bottom), cross(right, skew) / cross(right, bottom)
    x, y = np.column_stack((top_right - top_left + g * top_right, bottom_left - top_left + h * bottom_left, top_left))
    return np.array([x, y, [g, h, 1.0]])


def derivative(matrix: Array, points: Array, min_weight: float = -np.inf) -> Array:
    """The Jacobian of a homography (3, 3) at points (..., 2): d(image) / d(point), of shape (..., 2, 2).

    Its columns are the steps that the image takes for a step along x and along y.

    Args:
        min_weight: homogeneous weights below this are raised to it, which keeps points at or beyond the horizon finite.
    """
    x_y_w = points @ matrix[:, :2].T + matrix[:, 2]
    w = np.maximum(x_y_w[..., 2:], min_weight)
    image = x_y_w[..., :2] / w
    return np.asarray((matrix[:2, :2] - image[..., :, None] * matrix[2, :2]) / w[..., None])


def warp_jacobian(u: Array, v: Array, dx: NDArray[Any], dy: NDArray[Any]) -> Array:
    """How a warp's eight parameters move points, at the identity: the rows (N, 8) of the Jacobian.

    The parameters are the first eight entries, row by row, of the warp's difference to the identity.

    Args:
        u, v: (N,) the points.
        dx, dy: (N,) the direction along which each point's motion counts; an image's gradient gives the steepest
            descent of Lucas and Kanade.
    """
    radial = u * dx + v * dy
    return np.stack([u * dx, v * dx, dx, u * dy, v * dy, dy, -u * radial, -v * radial], 1)


def translation(x: float, y: float) -> Array:
    """The homography (3, 3) that moves points by (x, y)."""
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def similarity(scale: float, rotation: float, x: float, y: float) -> Array:
    """The similarity group of the decomposition (paper, eq. 2); rotation in radians, from x to y."""
    c, s = scale * np.cos(rotation), scale * np.sin(rotation)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])
