"""Keyframes that are put into a finished track, and which of them it does not pass through yet."""

from collections.abc import Sequence

import numpy as np

from hdn.imaging.arrays import Array

from ..surface import Keyframe, Moment
from ..tracks import Track
from .moments import keyframes_of

PASSED_PX = 1e-3  # within which a track passes through a keyframe


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


def not_passed(track: Track, keyframes: dict[int, Array]) -> dict[int, Array]:
    """Those of the keyframes that a track does not pass through, as after one was added, or edited in its file."""
    return {i: c for i, c in keyframes.items() if not np.abs(track.corners[i] - c).max() < PASSED_PX}


def needs_correction(track: Track, keyframes: Sequence[Keyframe]) -> bool:
    """Whether something has to be tracked anew for a track to pass through its keyframes and those given.

    Raises:
        InputError: a keyframe is not possible.
    """
    return bool(not_passed(track, merged_keyframes(track, keyframes)))
