"""Where passes over a video were sure of different places: not all of them can be right."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdn.imaging.arrays import Array
from hdn.imaging.homography import transform
from hdn.tracker import PlaneStep

from ..tracks import Track
from .protocol import Estimate
from .runs import Run
from .segments import segments


@dataclass(frozen=True)
class ContradictionModel:
    """What counts as a contradiction.

    Attributes:
        frames: in a row, from which a place other than the track's is no slip.
        px: from which corners are others, root of the mean square.
        leap_px, leap_deviations: the like from a frame to the next, beyond what moved, and in units of its deviation.
    """

    frames: int = 5
    px: float = 5.0
    leap_px: float = 10.0
    leap_deviations: float = 10.0


MODEL = ContradictionModel()


def contradicting(track: Track, runs: Sequence[Run]) -> tuple[int, Array] | None:
    """A place that contradicts the track: where a tracker was sure of other corners.

    That is where it was surest in the longest stretch of such frames; or where a run into a gap met another's fix.

    Returns:
        The frame's index and the corners (4, 2) there; None where it is a matter of a few frames.
    """
    surest: dict[int, Estimate] = {}
    ends = {}
    for run in runs:
        for index, estimate in zip(run.frames, run.estimates, strict=True):
            if estimate.state == "tracked" and not _distance(estimate.corners, track.corners[index]) < MODEL.px:
                if index not in surest or estimate.deviation < surest[index].deviation:
                    surest[index] = estimate
                if run.fills and index == run.stop:
                    ends[index] = estimate.corners
    there = [index in surest for index in range(len(track))]
    first, stop = max(segments(there, track.cuts), key=lambda piece: piece[1] - piece[0], default=(0, 0))
    if stop - first >= MODEL.frames:
        index = min(range(first, stop), key=lambda index: surest[index].deviation)
        return index, surest[index].corners
    return next(iter(ends.items()), None)


def leap(track: Track, runs: Sequence[Run]) -> tuple[int, Array] | None:
    """Where a track leaps furthest away from all that moved from frame to frame: one side of it is wrong.

    Returns:
        The frame beside the leap that is further from the reference frame, by its index, and the corners (4, 2) there.
    """
    known = track.known
    away: dict[int, float] = {}  # px, by the frame before
    for run in runs:
        for index, estimate in zip(run.frames, run.estimates, strict=True):
            step: PlaneStep | None = getattr(estimate, "step", None)
            before = index + 1 if run.backward else index - 1
            if step is None or index == run.anchor or not known[before] or not known[index]:
                continue
            px = _distance(transform(step.homography, track.corners[before]), track.corners[index])
            is_far = px > MODEL.leap_deviations * np.sqrt(np.trace(step.covariance) / 4)
            k = min(before, index)
            away[k] = min(px if is_far else 0.0, away.get(k, np.inf))
    k = max(away, key=lambda k: away[k], default=-1)
    if k < 0 or away[k] < MODEL.leap_px:
        return None
    beside = k + 1 if k >= track.reference_frame else k
    return beside, track.corners[beside]


def _distance(corners: Array, others: Array) -> float:
    """Of two quads (4, 2), the root of the mean square, px; NaN where one has no pose."""
    return float(np.sqrt(np.square(corners - others).sum(1).mean()))
