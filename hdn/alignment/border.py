"""The target's border, where it stands out from what lies behind: it places a target of little texture.

A print without much on it is placed by the light on it more than by itself, and light moves. Its border stays. So the
sides are looked at across, at a few places each, for the step from outside to inside; in later frames the step is
found again, whatever lies behind the target then.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..imaging.arrays import Array, Grey
from ..imaging.blur import tukey
from ..imaging.homography import parameter_rows, translation
from ..imaging.pyramid import Pyramid
from .agreement import CELLS

REACH = 8  # px of the crop that is looked across the border, to either side
AT_FIRST, LATER = 2.5, 5.0  # px from the quad, or from where it is expected, within which a step is the border's
STEP = 1.8  # times as steep as is usual across a place, plus LEAST, is what counts as a step
LEAST = 0.5  # grey levels per px
CLEARLY = 0.6  # of the steepest step in reach; of such ones, the nearest counts
ENOUGH, FEWEST = 0.4, 6  # share of the places with a step at first; steps that have to be found again
DEVIATION = 0.3  # px of a side's place: of what all of its steps may have in common
THERE = 1.0  # px
ROUGH = 0.4  # px, the least spread of steps about where they would lie together
INWARD = np.array([[0.0, 1], [0, -1], [1, 0], [-1, 0]])  # of the top, bottom, left and right side


class Pull(NamedTuple):
    """What draws the eight parameters of a warp: information (8, 8), and that times where it draws them (8,).

    Parameters are the warp's difference to the identity, in centred coordinates whose unit is half the longer side.
    """

    information: Array
    weighted: Array


NOTHING = Pull(np.zeros((8, 8)), np.zeros(8))


class Border:
    """The border of a target, in crops of one size."""

    def __init__(self, frame: Pyramid, to_template: Array, width: int, height: int) -> None:
        """Args:
        frame: colour pyramid of the reference frame.
        to_template: (3, 3) pixels of a rectified crop of the target to the frame's; width, height: of that crop.
        """
        self._size = width, height
        self._to_template = to_template @ translation(-REACH, -REACH)
        along, there = (np.arange(CELLS) + 0.5) / CELLS * 2 - 1, np.ones(CELLS)
        x, y = np.array([width, height]) / max(width, height)
        sides = (along * x, -there * y), (along * x, there * y), (-there * x, along * y), (there * x, along * y)
        u, v = np.concatenate(sides, 1)
        nx, ny = np.repeat(INWARD, CELLS, 0).T
        # How the places move inward, px, with the parameters.
        self._rows = parameter_rows(u, v, nx, ny) * max(width, height) / 2
        self._at, self._stands_out = self._steps(frame, np.eye(3), np.zeros(4 * CELLS), AT_FIRST)

    @property
    def exists(self) -> bool:
        """Whether enough of it stands out to place a target by."""
        return bool(self._stands_out.mean() >= ENOUGH)

    def share(self, frame: Pyramid, homography: Array) -> float:
        """Share of it, 0..1, that is where a pose (3, 3) has it in a colour frame, to a pixel of the crop."""
        at, found = self._steps(frame, homography, self._at, LATER)
        there = found & (np.abs(at - self._at) < THERE)
        return float(there[self._stands_out].mean())

    def pull(self, frame: Pyramid, homography: Array, seen: Grey) -> Pull:
        """Where the border is seen in a colour frame, relative to a pose (3, 3), template to frame.

        Args: seen: (8, 8) 0..1, which cells of the target may be looked at.
        """
        at, found = self._steps(frame, homography, self._at, LATER)
        clear = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
        found &= self._stands_out & (clear > 0.5)
        if found.sum() < FEWEST:
            return NOTHING
        rows, off = self._rows[found], (at - self._at)[found]
        weight = np.ones(len(off))
        ridge = 0.01 * (rows**2).mean() * np.eye(8)  # what the steps leave open stays as it is
        for _ in range(4):
            weighted = rows * weight[:, None]
            error = off - rows @ np.linalg.solve(weighted.T @ rows + ridge, weighted.T @ off)
            weight = tukey(error / max(ROUGH, 1.4826 * float(np.median(np.abs(error)))))
        weighted = rows * weight[:, None] / (CELLS * DEVIATION**2)
        return Pull(weighted.T @ rows, weighted.T @ off)

    def _steps(
        self, frame: Pyramid, homography: Array, expected: Array, within: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Where the steps are, px inward from the quad, (4 * CELLS,), and whether there are any."""
        width, height = self._size
        crop = frame.crop(homography @ self._to_template, width + 2 * REACH, height + 2 * REACH).astype(np.float32)
        inner, outer = slice(REACH, -REACH), slice(0, 2 * REACH)
        columns, rows = crop.swapaxes(0, 1)[inner], crop[inner]
        strips = columns[:, outer], columns[:, ::-1][:, outer], rows[:, outer], rows[:, ::-1][:, outer]
        # Across each place, from outside inward: (4 * CELLS, 2 * REACH, 3).
        profiles = np.concatenate([s.reshape(CELLS, -1, 2 * REACH, 3).mean(1) for s in strips])
        slope = cv2.blur(np.abs(np.diff(profiles, axis=1)).max(2), (3, 1), borderType=cv2.BORDER_REPLICATE)
        place = np.arange(1 - REACH, REACH, dtype=float)
        away = np.abs(place - expected[:, None])
        near = np.where(away <= within, slope, 0)
        steep = near > np.maximum(STEP * (np.median(slope, 1) + LEAST), CLEARLY * near.max(1))[:, None]
        steep[:, 1:-1] &= (slope[:, 1:-1] >= slope[:, :-2]) & (slope[:, 1:-1] >= slope[:, 2:])
        nearest = np.where(steep, away, np.inf).argmin(1)
        around = np.clip(nearest[:, None] + np.arange(-2, 3), 0, len(place) - 1)
        weight = np.square(np.take_along_axis(slope, around, 1))
        return (weight * place[around]).sum(1) / np.maximum(weight.sum(1), 1e-6), steep.any(1)
