"""Frames of a damaged file are tracked, and count for less."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ar_demo.tracking.joint import Shot
from ar_demo.tracking.measurements import Record
from ar_demo.tracking.runs import Run
from hdn.state import State

QUAD = np.array([[10.0, 10], [90, 10], [90, 70], [10, 70]])


@dataclass
class Told:
    corners: NDArray[np.float64]
    state: State = "tracked"
    confidence: float = 1.0
    deviation: float = 0.2
    covariance: NDArray[np.float64] = field(default_factory=lambda: 0.02 * np.eye(8))


def test_a_damaged_frame_yields_to_those_around() -> None:
    """The concealed picture of frames 8 to 10 is the one before them, while the surface moves on by 2 px a frame."""
    n, solved = 20, {}
    for damaged in (False, True):
        run = Run(0, QUAD, None)
        for k in range(n):
            concealed = 8 <= k <= 10
            shown = QUAD + np.array([2.0 * (7 if concealed else k), 0])
            run.add(Told(shown), damaged and concealed)
        found = Shot(Record.of([run], n).part(0, n, {0: QUAD}, {})).solve()
        right = np.stack([QUAD + np.array([2.0 * k, 0]) for k in range(n)]).reshape(n, 8)
        solved[damaged] = np.abs(found.corners - right)[8:11].max()
    assert solved[False] > 5
    assert solved[True] < 0.1
