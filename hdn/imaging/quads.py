"""Quads: four corners (4, 2), px, in the ad's reading order: top-left, top-right, bottom-right, bottom-left.

Pixel coordinates: x right, y down, the centre of the top-left pixel is (0, 0).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..errors import InputError
from .arrays import Array


@dataclass(frozen=True)
class QuadLimits:
    """What a quad may be."""

    min_side_px: int = 16  # of a target: a smaller one shows too little to track
    max_outside_px: int = 1  # of a target's corners beyond the frame: those on its very edge are fine
    min_drawn_area_px2: float = 0.5  # of a picture: of less, nothing would be seen
    min_turn_ratio: float = 1e-3  # smallest to largest corner's triangle of a picture: with less, it is flat


LIMITS = QuadLimits()


def square(size: float) -> Array:
    """Outline of a size x size crop as a quad (4, 2): from the outer edge of the first pixel to that of the last."""
    lo, hi = -0.5, size - 0.5
    return np.array([[lo, lo], [hi, lo], [hi, hi], [lo, hi]])


def outline(width: int, height: int) -> Array:
    """The corners (4, 2) of a crop of so many pixels: the outer edges of its first and last ones."""
    return square(1.0) * [width, height] + [(width - 1) / 2, (height - 1) / 2]


def area(quad: Array) -> float:
    """Signed area of a polygon (n, 2) in square pixels: positive when its corners run clockwise on the screen."""
    x, y = quad[:, 0], quad[:, 1]  # asked for many times a frame: `np.roll` would take six times as long
    return 0.5 * float(x[:-1] @ y[1:] - y[:-1] @ x[1:] + x[-1] * y[0] - y[-1] * x[0])


def side(quad: Array) -> float:
    """Side of the square of the same area as a polygon (n, 2), px: its size, whatever its shape."""
    return float(np.sqrt(abs(area(quad))))


def mean_size(quad: Array) -> Array:
    """Width and height (2,) of a quad (4, 2), px: each the mean of two opposite sides."""
    sides = np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1)
    return np.array([sides[0] + sides[2], sides[1] + sides[3]]) / 2


def cross(a: Array, b: Array) -> Array:
    """The third component of the cross product of vectors (..., 2) in the plane: (...)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def is_convex(quad: Array) -> bool:
    """Whether a quad (4, 2) is convex and not self-crossing: all its turns go the same way."""
    turns = _turns(quad)
    return bool(np.all(turns > 0) or np.all(turns < 0))


def is_drawable(quad: Array) -> bool:
    """Whether a quad (4, 2) can be a picture seen in perspective: finite, clearly convex and not below half a pixel.

    Clearly convex: no corner's triangle is under a thousandth of the largest one. A picture with a corner behind the
    camera projects to a concave or self-crossing quad, so it is told apart here too.
    """
    if not np.isfinite(quad).all():
        return False
    turns = _turns(quad)
    turns = turns * np.sign(turns.sum())
    return bool(abs(area(quad)) >= LIMITS.min_drawn_area_px2 and turns.min() > LIMITS.min_turn_ratio * turns.max())


def _turns(quad: Array) -> Array:
    """Twice the signed area of the triangle at each corner, (4,), from the second corner on."""
    edges = quad[[1, 2, 3, 0]] - quad
    return cross(edges, edges[[1, 2, 3, 0]])


def clip_polygon(polygon: Array, bounds: tuple[float, float, float, float]) -> Array:
    """The part (m, 2) of a convex polygon (n, 2) in x0, y0, x1, y1, empty if none (Sutherland and Hodgman, 1974)."""
    x0, y0, x1, y1 = bounds
    for normal, offset in (((1, 0), -x0), ((0, 1), -y0), ((-1, 0), x1), ((0, -1), y1)):
        kept: list[Array] = []
        inside = polygon @ np.array(normal) + offset  # px, the distance inward from this side of the bounds
        ring = [*zip(polygon, inside, strict=True)]
        for (a, a_inside), (b, b_inside) in pairwise([*ring, *ring[:1]]):
            if a_inside >= 0:
                kept.append(a)
            if (a_inside >= 0) != (b_inside >= 0):
                kept.append(a + (b - a) * (a_inside / (a_inside - b_inside)))
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def check_quad(quad: Array, width: int, height: int) -> None:
    """Checks that a quad (4, 2) can be a target in a frame of width x height px.

    Raises:
        InputError: it is not convex, lies outside the frame, or is under 16 px wide or high.
    """
    if quad.shape != (4, 2) or not np.isfinite(quad).all():
        raise InputError(f"the quad has {len(quad)} points: give four corners x,y, top-left first, clockwise")
    beyond = LIMITS.max_outside_px
    if ((quad < -beyond) | (quad > [width - 1 + beyond, height - 1 + beyond])).any():
        raise InputError(f"the quad lies outside the {width}x{height} frame: give corners inside it")
    sides = np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1)
    if not is_convex(quad):
        raise InputError(
            "the quad crosses itself, bends inward or is flat: give the corners in order around the surface"
        )
    smallest = LIMITS.min_side_px
    if sides.min() < smallest or abs(area(quad)) < smallest**2:
        raise InputError(f"the quad is under {smallest} px wide or high: choose a frame where the surface is larger")
