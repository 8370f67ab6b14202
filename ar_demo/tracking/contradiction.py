"""Where passes over a video were sure of different places: not all of them can be right."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdn.imaging.arrays import Array
from hdn.imaging.homography import transform

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
        leap_px: the like from a frame to the next, beyond what moved.
    """

    frames: int = 5
    px: float = 5.0
    leap_px: float = 10.0


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
    steps: dict[int, list[Array]] = {}  # from each frame to the next
    for run in runs:
        for index, estimate in zip(run.frames, run.estimates, strict=True):
            if (step := getattr(estimate, "step", None)) is not None and index != run.anchor:
                k = index if run.backward else index - 1
                steps.setdefault(k, []).append(np.linalg.inv(step.homography) if run.backward else step.homography)
    known = track.known
    leaps = {
        k: min(_distance(transform(h, track.corners[k]), track.corners[k + 1]) for h in homographies)
        for k, homographies in steps.items()
        if known[k] and known[k + 1]
    }
    k = max(leaps, key=lambda k: leaps[k], default=-1)
    if k < 0 or leaps[k] < MODEL.leap_px:
        return None
    beside = k + 1 if k >= track.reference_frame else k
    return beside, track.corners[beside]


def _distance(corners: Array, others: Array) -> float:
    """Of two quads (4, 2), the root of the mean square, px; NaN where one has no pose."""
    return float(np.sqrt(np.square(corners - others).sum(1).mean()))
