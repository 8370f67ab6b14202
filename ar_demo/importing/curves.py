"""What was read of a file of another program: the corners of the frames that it has keys for."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Array
from hdn.state import State

from ..errors import InputError

MOST_FRAMES = 10_000_000  # four days at 25 frames a second
Curve = dict[float, float]  # value by frame; a curve that never changes has one at infinity


@dataclass(frozen=True)
class Corners:
    """Corners by frame, in our own coordinates.

    Attributes:
        points: (4, 2) px by the frame's number in the other program.
        first_frame: that of the video's first frame, None where the file does not say.
        between: frames without a key, whose corners lie on lines between those that have one.
        states: of frames that the file says it of.
    """

    points: dict[int, Array]
    first_frame: int | None
    between: frozenset[int] = frozenset()
    states: dict[int, State] = field(default_factory=dict)


def sampled(curves: Sequence[Sequence[Curve]]) -> tuple[dict[int, Array], frozenset[int]]:
    """(4, 2) of four points' two curves, from the first key to the last, and which of these frames have no key.

    Raises:
        InputError: the keys are too far apart to be a video's.
    """
    keyed = {frame for point in curves for curve in point for frame in curve if np.isfinite(frame)}
    if not keyed or not all(curve for point in curves for curve in point):
        return {}, frozenset()
    first, last = int(np.ceil(min(keyed))), int(np.floor(max(keyed)))
    if last - first > MOST_FRAMES:
        raise InputError(f"it has keys from frame {first} to {last}: that is no video's")
    at = np.arange(first, last + 1)
    values = np.stack([np.stack([_at(curve, at) for curve in point], -1) for point in curves], 1)
    return dict(zip(at.tolist(), values, strict=True)), frozenset(at.tolist()) - keyed


def _at(curve: Curve, frames: NDArray[np.int_]) -> Array:
    places = sorted(curve)
    return np.interp(frames, places, [curve[place] for place in places])
