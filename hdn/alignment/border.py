"""The target's border, where it stands out from what lies behind: it places a target of little texture.

A print without much on it is placed by the light on it more than by itself, and light moves. Its border stays. So the
sides are looked at across, at a few places each, for the step in colour from outside to inside; in later frames the
step is found again, whatever lies behind the target then.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from ..imaging.arrays import Array, Floats, Mask
from ..imaging.homography import translation, warp_jacobian
from ..imaging.photometry import MAD_TO_DEVIATION, tukey
from ..imaging.pyramid import Pyramid
from .agreement import CELLS

INWARD = np.array([[0.0, 1], [0, -1], [1, 0], [-1, 0]])  # of the top, bottom, left and right side


@dataclass(frozen=True)
class BorderModel:
    """Constants of the search for a border; lengths are px of the rectified crop."""

    reach_px: int = 8  # that is looked across the border, to either side
    first_reach_px: float = 2.5  # from the quad, within which a step is the border's in the reference frame
    later_reach_px: float = 5.0  # from where the pose has the step, in later frames
    step_ratio: float = 1.8  # to the median slope across a place (and `slope_floor`), from which a slope is a step
    slope_floor_grey_per_px: float = 0.5  # added to that median
    rival_ratio: float = 0.6  # to the steepest slope in reach, from which another counts too; the nearest is taken
    centroid_reach_px: int = 2  # to either side of a step, over which its place is averaged
    min_distinct: float = 0.4  # share of the places that have a step at first, for a border to place the target by
    min_steps: int = 6  # that have to be found again
    same_place_px: float = 1.0  # up to which a step is where the pose has it
    min_visibility: float = 0.5  # of the cell inside a place, for it to be looked at
    side_deviation_px: float = 0.3  # standard deviation of a side's place: the error that all of its steps share
    min_spread_px: float = 0.4  # least standard deviation of the steps about where they would lie together
    ridge: float = 0.01  # of the steps' mean square Jacobian: what the steps leave open stays as it is
    robust_steps: int = 4  # of reweighting


MODEL = BorderModel()


class WarpConstraint(NamedTuple):
    """What is known of a warp's eight parameters: a Gaussian in information form.

    Parameters are the warp's difference to the identity, in centred coordinates whose unit is half the longer side.

    Attributes:
        information: (8, 8) inverse of the covariance.
        weighted_mean: (8,) the information times the mean.
    """

    information: Array
    weighted_mean: Array


UNCONSTRAINED = WarpConstraint(np.zeros((8, 8)), np.zeros(8))


class Border:
    """The border of a target, in rectified crops of one size."""

    def __init__(self, frame: Pyramid, to_template: Array, width: int, height: int) -> None:
        """Finds the border in the reference frame.

        Args:
            frame: colour pyramid of the reference frame.
            to_template: (3, 3) pixels of a rectified crop of the target to the frame's.
            width, height: of that crop, px.
        """
        self._size = width, height
        self._to_template = to_template @ translation(-MODEL.reach_px, -MODEL.reach_px)
        along, across = (np.arange(CELLS) + 0.5) / CELLS * 2 - 1, np.ones(CELLS)
        x, y = np.array([width, height]) / max(width, height)
        sides = (along * x, -across * y), (along * x, across * y), (-across * x, along * y), (across * x, along * y)
        u, v = np.concatenate(sides, 1)
        nx, ny = np.repeat(INWARD, CELLS, 0).T
        # How the places move inward, px, with the parameters.
        self._jacobian = warp_jacobian(u, v, nx, ny) * max(width, height) / 2
        at_quad = np.zeros(4 * CELLS)
        self._places, self._stands_out = self._steps(frame, np.eye(3), at_quad, MODEL.first_reach_px)

    @property
    def is_distinct(self) -> bool:
        """Whether enough of it stands out to place a target by."""
        return bool(self._stands_out.mean() >= MODEL.min_distinct)

    def matching_share(self, frame: Pyramid, homography: Array) -> float:
        """Share of it, 0..1, that is in a colour frame where a pose (3, 3) has it, to a pixel of the crop."""
        places, found = self._steps(frame, homography, self._places, MODEL.later_reach_px)
        there = found & (np.abs(places - self._places) < MODEL.same_place_px)
        return float(there[self._stands_out].mean())

    def constraint(self, frame: Pyramid, homography: Array, visibility: Floats) -> WarpConstraint:
        """What the border in a colour frame tells of the warp that mends a pose.

        Args:
            frame: colour pyramid.
            homography: (3, 3) the pose, template to frame.
            visibility: (8, 8) 0..1, which cells of the target may be looked at.

        Returns:
            `UNCONSTRAINED` where too little of the border is found.
        """
        places, found = self._steps(frame, homography, self._places, MODEL.later_reach_px)
        beside = np.concatenate([visibility[0], visibility[-1], visibility[:, 0], visibility[:, -1]])
        found &= self._stands_out & (beside > MODEL.min_visibility)
        if found.sum() < MODEL.min_steps:
            return UNCONSTRAINED
        jacobian, moved = self._jacobian[found], (places - self._places)[found]
        weight = np.ones(len(moved))
        ridge = MODEL.ridge * (jacobian**2).mean() * np.eye(8)
        for _ in range(MODEL.robust_steps):
            weighted = jacobian * weight[:, None]
            error = moved - jacobian @ np.linalg.solve(weighted.T @ jacobian + ridge, weighted.T @ moved)
            spread = max(MODEL.min_spread_px, MAD_TO_DEVIATION * float(np.median(np.abs(error))))
            weight = tukey(error / spread)
        weighted = jacobian * weight[:, None] / (CELLS * MODEL.side_deviation_px**2)
        return WarpConstraint(weighted.T @ jacobian, weighted.T @ moved)

    def _steps(self, frame: Pyramid, homography: Array, expected: Array, reach: float) -> tuple[Array, Mask]:
        """Steps in colour across the border.

        Args:
            expected: (4 * CELLS,) where they are looked for, px inward from the quad.
            reach: px from there, within which they are looked for.

        Returns:
            Where the steps are, px inward from the quad, (4 * CELLS,), and at which places there is one.
        """
        width, height = self._size
        margin = MODEL.reach_px
        crop = frame.crop(homography @ self._to_template, width + 2 * margin, height + 2 * margin).astype(np.float32)
        inner, outer = slice(margin, -margin), slice(0, 2 * margin)
        columns, rows = crop.swapaxes(0, 1)[inner], crop[inner]
        strips = columns[:, outer], columns[:, ::-1][:, outer], rows[:, outer], rows[:, ::-1][:, outer]
        # Across each place, from outside inward: (4 * CELLS, 2 * margin, 3).
        profiles = np.concatenate([s.reshape(CELLS, -1, 2 * margin, 3).mean(1) for s in strips])
        slope = cv2.blur(np.abs(np.diff(profiles, axis=1)).max(2), (3, 1), borderType=cv2.BORDER_REPLICATE)
        position = np.arange(1 - margin, margin, dtype=float)
        away = np.abs(position - expected[:, None])
        near = np.where(away <= reach, slope, 0)
        usual = MODEL.step_ratio * (np.median(slope, 1) + MODEL.slope_floor_grey_per_px)
        is_step = near > np.maximum(usual, MODEL.rival_ratio * near.max(1))[:, None]
        is_step[:, 1:-1] &= (slope[:, 1:-1] >= slope[:, :-2]) & (slope[:, 1:-1] >= slope[:, 2:])
        nearest = np.where(is_step, away, np.inf).argmin(1)
        offsets = np.arange(-MODEL.centroid_reach_px, MODEL.centroid_reach_px + 1)
        around = np.clip(nearest[:, None] + offsets, 0, len(position) - 1)
        weight = np.square(np.take_along_axis(slope, around, 1))
        return (weight * position[around]).sum(1) / np.maximum(weight.sum(1), 1e-6), is_step.any(1)
