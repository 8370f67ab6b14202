"""Where passes over a video were sure of different places: not all of them can be right."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdn.imaging.arrays import Array

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
    """

    frames: int = 5
    px: float = 5.0


MODEL = ContradictionModel()


def contradiction(track: Track, runs: Sequence[Run]) -> tuple[int, Array] | None:
    """Where a tracker was surest of other corners than the track has, or than another run.

    That is in the longest stretch of such frames, or where a run into a gap met another's fix and was sure of another.

    Returns:
        The frame's index and the corners (4, 2) there; None where it is a matter of a few frames.
    """
    by_frame: dict[int, list[tuple[Run, Estimate]]] = {}
    for run in runs:
        for index, estimate in zip(run.frames, run.estimates, strict=True):
            if estimate.state == "tracked":
                by_frame.setdefault(index, []).append((run, estimate))
    surest: dict[int, Estimate] = {}
    for index, found in by_frame.items():
        for run, estimate in found:
            if run.fills and index == run.stop and any(_differ(estimate.corners, e.corners) for _, e in found):
                return index, estimate.corners
        others = [e for _, e in found if _differ(e.corners, track.corners[index])]
        if others:
            surest[index] = min(others, key=lambda estimate: estimate.deviation)
    contradicting = [index in surest for index in range(len(track))]
    first, stop = max(segments(contradicting, track.cuts), key=lambda piece: piece[1] - piece[0], default=(0, 0))
    if stop - first < MODEL.frames:
        return None
    index = min(range(first, stop), key=lambda index: surest[index].deviation)
    return index, surest[index].corners


def _differ(corners: Array, others: Array) -> bool:
    """Whether two quads (4, 2) are not the same; one without a pose is like no other."""
    return not np.square(corners - others).sum(1).mean() < MODEL.px**2
