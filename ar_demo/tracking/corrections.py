"""Keyframes that are put into a finished track, and which of them it was not made with."""

import logging
from collections.abc import Sequence

import numpy as np

from hdn.imaging.arrays import Array

from ..surface import Keyframe, Moment
from ..tracks import Track
from .moments import keyframes_of

log = logging.getLogger(__name__)

WORTH_TELLING_PX = 1.0  # distance of a track from a keyframe, root of the mean square
SAME_PX = 1e-6  # within which corners are the same


def merged_keyframes(track: Track, keyframes: Sequence[Keyframe]) -> dict[int, Array]:
    """The track's keyframes and those that are given, by frame index; the latter count where both name a frame.

    Raises:
        InputError: one of them is not possible.
    """
    merged: dict[int, Array] = {}
    kept = [Keyframe(Moment(frame=i), corners) for i, corners in track.keyframes.items()]
    for given in (kept, keyframes):
        merged |= keyframes_of(given, track.quad, track.reference_frame, track.times)
    return merged


def new_keyframes(track: Track, keyframes: dict[int, Array]) -> dict[int, Array]:
    """Those of the keyframes that a track was not made with, as after one was added, or edited in its file."""
    used = track.used
    return {i: c for i, c in keyframes.items() if i not in used or np.abs(used[i] - c).max() > SAME_PX}


def tell(track: Track) -> None:
    """Tells the log how a track goes by its keyframes, where that is not as near as nobody sees."""
    for index, corners in track.keyframes.items():
        beside = float(np.sqrt(np.square(track.corners[index] - corners).sum() / 4))
        if beside > WORTH_TELLING_PX:
            log.info("frame %d: the track is %.1f px beside the keyframe: what was measured is surer", index, beside)


def needs_correction(track: Track, keyframes: Sequence[Keyframe]) -> bool:
    """Whether something has to be tracked anew for a track to be made with its keyframes and those given.

    Raises:
        InputError: a keyframe is not possible.
    """
    return bool(new_keyframes(track, merged_keyframes(track, keyframes)))
