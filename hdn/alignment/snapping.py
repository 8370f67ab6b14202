"""A quad given by hand, moved to the straight edges that are there: those of a screen, a frame or a page.

Corners that somebody clicked on are off by one to three pixels. Across each side the frame is looked at, at many
places; a line near the side that runs along a step in colour at most of them is an edge, and the side moves there.
A side without one stays. The corners are where the sides meet.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from ..imaging.arrays import Array, Image
from ..imaging.observation import Observation
from ..imaging.photometry import tukey
from ..imaging.quads import LIMITS, check_quad, cross, is_convex


@dataclass(frozen=True)
class SnapModel:
    """Constants of the search for edges. Lengths are px of a frame up to `usual_frame_px` wide, and grow with it.

    What makes an edge was chosen on drawn posters (`hdn-synthplanar`, seeds 5 and 11): of the sides that it takes, a
    twentieth of the right ones is lost, and what is left of wrong ones is the other edge of a drawn frame.
    """

    usual_frame_px: int = 1280  # longer side of a frame
    reach_px: float = 4.0  # that a side may move at either end
    max_share: float = 0.1  # of the quad's shortest side that a side may move
    max_corner_ratio: float = 2.0  # of that, which a corner may move: its two sides move it
    places: int = 100  # along a side where the frame is looked at across
    end_share: float = 0.04  # of a side, left out at either end: corners may be round
    step_px: float = 0.5  # between the samples across
    blur_px: float = 0.8  # standard deviation of the Gaussian over the samples, against noise
    min_slope_grey_per_px: float = 2.0  # of a step
    full_slope_grey_per_px: float = 8.0  # from which a step counts fully
    line_step_px: float = 0.25  # between the lines that are tried, at either end
    width_px: float = 0.6  # standard deviation of the distance within which a step counts for a line
    min_support: float = 0.7  # share of the places, for an edge
    sections: int = 5  # of a side, each of which has to show some of the edge: others end in the middle of it
    min_section_support: float = 0.45  # share of a section's places
    min_distinct: float = 0.4  # by which that has to exceed the mean over all lines
    rival_ratio: float = 0.6  # to the best line's support (above that mean), from which the nearest line is taken
    robust_steps: int = 5  # of the fit to the steps


MODEL = SnapModel()


class Snapped(NamedTuple):
    """A quad after snapping.

    Attributes:
        quad: (4, 2) px.
        moved_px: (4,) how far each corner moved.
    """

    quad: Array
    moved_px: Array


def snap(frame: Observation, quad: Array, model: SnapModel = MODEL) -> Snapped:
    """Moves the sides of a quad (4, 2), px of a frame, to clear straight edges a few px beside them.

    Sides without such an edge stay where they are, and so does the whole quad where its sides would not meet near its
    corners, or beyond the frame. Of two edges beside each other, as of a picture's frame, the nearest counts.

    Raises:
        InputError: the quad is not convex, too small, or not wholly inside the frame.
    """
    check_quad(quad, *frame.colour.size)
    ends = np.roll(quad, -1, 0)
    lengths = np.linalg.norm(ends - quad, axis=1)
    unit = max(1.0, max(frame.colour.size) / model.usual_frame_px)
    reach = min(model.reach_px * unit, model.max_share * float(lengths.min()))
    begins, stops = quad.copy(), ends.copy()
    for i, length in enumerate(lengths):
        normal = np.array([-1.0, 1]) * (ends[i] - quad[i])[::-1] / length
        found = _edge(frame.image, quad[i], ends[i], normal, unit, reach, model)
        if found is not None:
            begins[i] += found[0] * normal
            stops[i] += found[1] * normal
    # The corner i is where the side before it meets its own.
    corners = _meetings(np.roll(begins, 1, 0), np.roll(stops, 1, 0), begins, stops)
    stays = np.isclose(corners, quad, rtol=0, atol=1e-6).all(1)  # but for rounding
    corners[stays] = quad[stays]
    moved = np.linalg.norm(corners - quad, axis=1)
    beyond = LIMITS.max_outside_px
    is_inside = ((corners >= -beyond) & (corners <= np.array(frame.colour.size) - 1 + beyond)).all()
    if not is_convex(corners) or not is_inside or moved.max() > model.max_corner_ratio * reach:
        return Snapped(quad, np.zeros(4))
    return Snapped(corners, moved)


def _edge(
    image: Image, begin: Array, end: Array, normal: Array, unit: float, reach: float, model: SnapModel
) -> Array | None:
    """How far, px along the normal, the ends (2,) of a side have to move onto the edge beside it; None for no edge."""
    along = np.linspace(model.end_share, 1 - model.end_share, model.places)
    steps = _steps(image, begin + along[:, None] * (end - begin), normal, unit, reach, model)
    offsets = np.arange(-reach, reach + 1e-9, model.line_step_px * unit)
    lines = np.stack(np.meshgrid(offsets, offsets), -1).reshape(-1, 2)
    support = _support(lines, along, steps, model.width_px * unit).mean(0)
    excess = support - support.mean()
    if support.max() < model.min_support or excess.max() < model.min_distinct:
        return None
    rivals = lines[excess >= model.rival_ratio * excess.max()]
    nearest = rivals[np.argmin(np.square(rivals).sum(1))]
    line = _fitted(nearest, along, steps, model.width_px * unit, model.robust_steps)
    sections = _support(line[None], along, steps, model.width_px * unit).reshape(model.sections, -1).mean(1)
    return line if sections.min() >= model.min_section_support and np.abs(line).max() <= reach else None


class _Steps(NamedTuple):
    """Steps in colour across a side, at each of n places the m samples' local maxima of slope.

    Attributes:
        offset: (n, m) px along the normal.
        weight: (n, m) 0..1; 0 where there is no step.
    """

    offset: Array
    weight: Array


def _steps(image: Image, at: Array, normal: Array, unit: float, reach: float, model: SnapModel) -> _Steps:
    """The steps across a side at the places (n, 2), px of the image."""
    step = model.step_px * unit
    margin = 3 * model.blur_px * unit
    distance = np.arange(-(reach + margin), reach + margin + step / 2, step)
    points = at[:, None] + distance[None, :, None] * normal
    x, y = (points[..., k].astype(np.float32) for k in (0, 1))
    profiles = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    smooth = cv2.GaussianBlur(profiles.astype(np.float32), (0, 0), model.blur_px / model.step_px, sigmaY=1e-3)
    difference = (smooth[:, 2:] - smooth[:, :-2]) / (2 * model.step_px)
    slope = np.sqrt(np.square(difference).max(2)).astype(np.float64)
    before, here, after = slope[:, :-2], slope[:, 1:-1], slope[:, 2:]
    is_step = (here >= before) & (here > after) & (here > model.min_slope_grey_per_px)
    curvature = np.minimum(before - 2 * here + after, -1e-9)
    shift = np.clip(0.5 * (before - after) / curvature, -0.5, 0.5)  # of a parabola's top
    offset = distance[2:-2] + shift * step
    weight = np.clip(here / model.full_slope_grey_per_px, 0, 1) * is_step
    return _Steps(offset, weight)


def _support(lines: Array, along: Array, steps: _Steps, width: float) -> Array:
    """How well there is a step at each of n places on each of the lines (k, 2), by their offsets at both ends: (n, k).

    Args:
        along: (n,) the places, 0..1 from end to end.
        width: px, standard deviation of the distance within which a step counts.
    """
    support = np.zeros((len(along), len(lines)))
    for row, place, offset, weight in zip(support, along, *steps, strict=True):
        there = weight > 0
        if there.any():
            away = (1 - place) * lines[:, 0] + place * lines[:, 1] - offset[there, None]
            row[:] = (np.exp(-0.5 * np.square(away / width)) * weight[there, None]).max(0)
    return support


def _fitted(line: Array, along: Array, steps: _Steps, width: float, rounds: int) -> Array:
    """The line (2,) through the steps next to a line, robustly."""
    design = np.stack([1 - along, along], 1)
    for _ in range(rounds):
        away = np.abs(steps.offset - (design @ line)[:, None]) + np.where(steps.weight > 0, 0, np.inf)
        nearest = away.argmin(1)[:, None]
        offset, weight = (np.take_along_axis(values, nearest, 1)[:, 0] for values in steps)
        weight = weight * tukey((offset - design @ line) / width)
        weighted = design * weight[:, None]
        line = np.asarray(np.linalg.solve(weighted.T @ design + 1e-9 * np.eye(2), weighted.T @ offset))
    return line


def _meetings(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Where the lines through the points a and b meet those through c and d, all (n, 2)."""
    along = b - a
    share = cross(c - a, d - c) / cross(along, d - c)
    return a + share[:, None] * along
