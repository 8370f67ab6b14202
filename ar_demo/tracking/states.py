"""What is told of a solved track: which frames are tracked, held or lost, and which a user had better look at."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Array
from hdn.imaging.quads import is_convex, side
from hdn.state import BOUNDS, State

from .segments import segments


@dataclass(frozen=True)
class JudgementModel:
    """What a held surface may be, and which stretches are worth a warning; how sure it is, `BOUNDS` says."""

    area_leap: float = 1.5  # ratio by which a held surface's area may differ from what tracked ones on both sides say
    worth_telling_frames: int = 8  # of a stretch that is not tracked, for a warning
    merged_frames: int = 15  # between two stretches, up to which they are told as one


MODEL = JudgementModel()


def judged(
    corners: Array, deviation: Array, agrees: NDArray[np.bool_], may_hold: NDArray[np.bool_], frame_side: int
) -> list[State]:
    """The states of n frames.

    Args:
        corners: (n, 4, 2) px. deviation: (n,) px; infinite where nothing is known.
        agrees: (n,) whether a tracker that was sure agrees with the corners. may_hold: (n,) whether they may be held.
        frame_side: longer side of the frames, px.
    """
    states: list[State] = ["lost"] * len(corners)
    sizes = np.array([side(c) for c in corners])
    tracked = agrees & (deviation <= np.minimum(BOUNDS.known(sizes), BOUNDS.sharp(frame_side)))
    held = may_hold & (deviation <= BOUNDS.held(sizes, frame_side))
    held &= np.array([is_convex(c) for c in corners], bool)
    if tracked.any():
        frames = np.arange(len(corners))
        expected = np.interp(frames, frames[tracked], np.log(sizes[tracked]))
        is_between = (frames >= frames[tracked][0]) & (frames <= frames[tracked][-1])
        leap = np.abs(2 * (np.log(np.maximum(sizes, 1e-9)) - expected))
        held &= ~is_between | (leap < np.log(MODEL.area_leap))
    for i in np.flatnonzero(tracked | held):
        states[i] = "tracked" if tracked[i] else "held"
    return states


def is_suspicion(warning: str) -> bool:
    """Whether a warning is one of `suspicions`, of one surface or of one of several."""
    return re.match(r"(surface \d+: )?frames \d+ to \d+: ", warning) is not None


def suspicions(states: Sequence[State], disagrees: NDArray[np.bool_]) -> list[str]:
    """Warnings, one for each stretch that is not tracked and not just a moment.

    Args:
        states: of n frames.
        disagrees: (n,) whether a tracker that was sure says otherwise than the track.
    """
    told = []
    doubtful = [state != "tracked" for state in states]
    stretches: list[tuple[int, int]] = []
    for start, stop in segments(doubtful):
        if stretches and start - stretches[-1][1] <= MODEL.merged_frames:
            stretches[-1] = stretches[-1][0], stop
        else:
            stretches.append((start, stop))
    for start, stop in stretches:
        if sum(doubtful[start:stop]) < MODEL.worth_telling_frames:
            continue
        frames = f"frames {start} to {stop - 1}: "
        if disagrees[start:stop].mean() > 0.5:
            told.append(
                frames + "what was measured contradicts the frames around; check them, or give a keyframe there"
            )
        elif all(state == "lost" for state in states[start:stop]):
            told.append(frames + "the surface is not found; if it is to be seen, give a keyframe there")
        else:
            told.append(frames + "the surface is hardly seen; check them, or give a keyframe there")
    return told
