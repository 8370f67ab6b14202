"""Homographies: from corners, as transforms of points, and the quads that they carry.

Pixel coordinates: x right, y down, the centre of the top-left pixel is (0, 0).
"""

from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

Array = NDArray[np.float64]


def square(size: float) -> Array:
    """Outline of a size x size crop as a quad (4, 2): from the outer edge of the first pixel to that of the last."""
    lo, hi = -0.5, size - 0.5
    return np.array([[lo, lo], [hi, lo], [hi, hi], [lo, hi]])


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


def dlt(offsets: Tensor, corners: Tensor) -> Tensor:
    """Direct linear transform, differentiable: corners (4, 2) and their offsets (B, 4, 2) to homographies (B, 3, 3)."""
    b = offsets.shape[0]
    source = corners.to(offsets).expand(b, 4, 2)
    target = source + offsets
    x, y = source.unbind(2)  # (B, 4) each
    u, v = target.unbind(2)
    zero, one = torch.zeros_like(x), torch.ones_like(x)
    system = torch.cat(
        [
            torch.stack([x, y, one, zero, zero, zero, -u * x, -u * y], 2),
            torch.stack([zero, zero, zero, x, y, one, -v * x, -v * y], 2),
        ],
        1,
    )  # (B, 8, 8)
    solution = torch.linalg.solve(system, torch.cat([u, v], 1))  # (B, 8)
    return torch.cat([solution, torch.ones_like(solution[:, :1])], 1).reshape(b, 3, 3)


def normalised(matrix: Array) -> Array:
    """The same homography with H[2, 2] = 1."""
    return matrix / matrix[2, 2]


def transform(matrix: Array, points: Array) -> Array:
    """Points (..., 2) through a homography (3, 3)."""
    p = points @ matrix[:, :2].T + matrix[:, 2]
    return p[..., :2] / p[..., 2:]


def project(matrix: Tensor, points: Tensor) -> Tensor:
    """Points (M, 2) or (B, M, 2) through homographies (B, 3, 3), differentiable: (B, M, 2)."""
    p = F.pad(points, (0, 1), value=1.0) @ matrix.transpose(1, 2)
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


def area(quad: Array) -> float:
    """Signed area of a polygon (n, 2) in square pixels: positive when its corners run clockwise on the screen."""
    x, y = quad[:, 0], quad[:, 1]  # asked for many times a frame: `np.roll` would take six times as long
    return 0.5 * float(x[:-1] @ y[1:] - y[:-1] @ x[1:] + x[-1] * y[0] - y[-1] * x[0])


def side(quad: Array) -> float:
    """Side of the square of the same area as a polygon (n, 2), px: its size, whatever its shape."""
    return float(np.sqrt(abs(area(quad))))


def is_convex(quad: Array) -> bool:
    """Whether a quad (4, 2) is convex and not self-crossing: all its turns go the same way."""
    edges = quad[[1, 2, 3, 0]] - quad
    following = edges[[1, 2, 3, 0]]
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    return bool(np.all(turns > 0) or np.all(turns < 0))
