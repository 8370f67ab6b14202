"""The motion of a target's plane from one frame to the next, by the parts of it that are seen in both.

Both frames are blurred and lit alike, and most of what is seen in one is seen in the other: so a step is measured well
where the reference frame says little. Its errors add up from frame to frame, though.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np

from ..alignment.agreement import CELLS
from ..alignment.lucas_kanade import Level
from ..alignment.refinement import START_COVARIANCE
from ..imaging.arrays import Array, Floats, Grey
from ..imaging.homography import transform
from ..imaging.pyramid import Pyramid
from ..imaging.quads import is_convex
from .plane_map import PlaneMap


@dataclass(frozen=True)
class PlaneMotionModel:
    """Constants of the measurement of a step; px are those of a crop, whose target's longer side has `sides_px`."""

    sides_px: tuple[int, ...] = (40, 80)  # of the crops, coarse to fine
    points: tuple[int, ...] = (2000, 4000)  # that are compared in each
    blur_px: float = 1.0  # standard deviation of the Gaussian that both frames are blurred by
    steps: int = 3  # per crop, each with the frame rectified anew
    settled_px: float = 0.2  # of the standard crop, corner motion under which the next step would not tell more

    # Which cells count: by their correlation with the frame before, once enough of them agree.
    agreeing: float = 0.6  # correlation from which a cell agrees
    correlation_range: tuple[float, float] = (0.3, 0.7)  # over which a cell comes to count in full
    min_agreeing_nearly: float = 0.3  # share of the trusted cells that agree, from which they are nearly aligned
    min_trust: float = 3.0  # cells, by their trust, that have to be in both frames
    min_agreement: float = 0.5  # share of the trusted cells that agree, for a step to be believed
    sure_agreement: float = 0.9  # from which no other start is tried
    # Standard deviation that a step has at least, in its eight parameters, px at the edge of the standard crop.
    least_deviation_px: tuple[float, ...] = (0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.12, 0.12)


MODEL = PlaneMotionModel()
LEAST_COVARIANCE = np.diag(np.square(MODEL.least_deviation_px))


class Step(NamedTuple):
    """The plane's motion between two frames.

    Attributes:
        homography: (3, 3) pixels of the frame before to those of this one.
        covariance: (8, 8) of it, as `Alignment` tells it.
        agreement: share of the trusted parts that agree, 0..1.
    """

    homography: Array
    covariance: Array
    agreement: float

    @property
    def is_sure(self) -> bool:
        """Whether so much agrees that no other step can be the right one."""
        return self.agreement > MODEL.sure_agreement


class StepSearch:
    """The measurement of a plane's motion from one grey frame to the next, from starts that are likely.

    Example:
        step = StepSearch(plane, before, after, corners, trust).best([np.eye(3)])
    """

    def __init__(self, plane: PlaneMap, before: Pyramid, after: Pyramid, corners: Array, trust: Floats) -> None:
        """Args:
        plane: the target's map, for its layout.
        before, after: grey pyramids of the two frames.
        corners: (4, 2) the target in the frame before, px.
        trust: (m, m) 0..1, which parts of the map the frame before is known to show.
        """
        self._after, self._corners = after, corners
        self._trust, margin = _without_empty_rim(trust, plane.margin)
        self._levels = [
            Level(before, corners, plane.size(side), MODEL.blur_px, plane.standard_side, points, margin)
            for side, points in zip(MODEL.sides_px, MODEL.points, strict=True)
        ]

    def best(self, starts: Iterable[Array], so_far: Step | None = None) -> Step | None:
        """The best step from motions (3, 3) that are likely, and the one so far.

        Returns:
            None where too little is seen in both frames, or does not move as a plane.
        """
        best = so_far
        for start in starts:
            if best is not None and best.is_sure:
                break
            found = _aligned(self._levels, self._after, start, self._trust)
            if found is None or not is_convex(transform(found.homography, self._corners)):
                continue
            if best is None or found.agreement > best.agreement:
                best = found
        return best


def _aligned(levels: Sequence[Level], frame: Pyramid, start: Array, trust: Floats) -> Step | None:
    """A step from one start; see `StepSearch`."""
    count = levels[0].cells
    trusted = np.asarray(cv2.resize(trust, (count, count), interpolation=cv2.INTER_AREA), np.float32)
    pose, covariance = start, START_COVARIANCE
    for level in levels:
        weigh = partial(_weights, level, frame, trust, trusted)
        found = level.settle(frame, pose, start, START_COVARIANCE, weigh, MODEL.steps, MODEL.settled_px)
        if found is None:
            return None
        pose, covariance = found[0], found[1].covariance
    seen = level.in_frame(frame, pose).astype(np.float32)
    agreement = _agreement(level.correlation(level.rectify(frame, pose)), trusted * seen)
    return Step(pose, covariance + LEAST_COVARIANCE, agreement) if agreement >= MODEL.min_agreement else None


def _weights(level: Level, frame: Pyramid, trust: Floats, trusted: Floats, search: Grey, pose: Array) -> Floats | None:
    """Weights of the parts, where a frame is rectified at a pose (3, 3); None where it shows too little.

    Args:
        trust: (m, m) of the parts; trusted: (n, n) of the cells.
    """
    correlation = level.correlation(search)
    seen = level.in_frame(frame, pose).astype(np.float32)
    if (trusted * seen).sum() < MODEL.min_trust:
        return None
    if _agreement(correlation, trusted * seen) > MODEL.min_agreeing_nearly:
        low, high = MODEL.correlation_range
        seen *= np.clip((correlation - low) / (high - low), 0, 1)
    return trust * cv2.resize(seen, trust.shape, interpolation=cv2.INTER_NEAREST)


def _agreement(correlation: Floats, weights: Floats) -> float:
    """Share of the cells, by their weights, that agree."""
    return float((weights * (correlation > MODEL.agreeing)).sum() / max(weights.sum(), 1e-6))


def _without_empty_rim(trust: Floats, margin: int) -> tuple[Floats, int]:
    """Trust (m, m) without the outer cells that have none all around, and how many cells of margin are left."""
    parts = len(trust) // (CELLS + 2 * margin)  # to a cell
    while margin and not trust.sum() > trust[parts:-parts, parts:-parts].sum():
        trust, margin = trust[parts:-parts, parts:-parts], margin - 1
    return np.ascontiguousarray(trust), margin
