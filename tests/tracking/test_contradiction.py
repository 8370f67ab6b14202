"""Which places contradict a track, and where it leaps."""

from fractions import Fraction

import numpy as np

from ar_demo.tracking.contradiction import contradicting, leap
from ar_demo.tracking.runs import Run
from ar_demo.tracking.solution import blank
from ar_demo.tracks import Source, Track
from hdn.evidence import Evidence
from hdn.imaging.arrays import Array
from hdn.tracker import Estimate, PlaneStep

QUAD = np.array([[20.0, 20], [80, 22], [78, 70], [22, 68]])
N = 20


def track(offsets: Array) -> Track:
    """A track that is off by so many px along x in each of its frames."""
    found = blank(Source("a.mp4", 128, 96, Fraction(30), N), 0, QUAD, [Fraction(i, 30) for i in range(N)], {})
    found.corners = QUAD + np.stack([offsets, np.zeros(N)], 1)[:, None]
    return found


def run(anchor: int, offsets: dict[int, float], stop: int | None = None, step: PlaneStep | None = None) -> Run:
    """A run that was sure of such offsets, frame by frame."""
    made = Run(anchor, QUAD, stop, fills=stop is not None)
    for offset in offsets.values():
        corners = QUAD + np.array([offset, 0])
        seen = np.ones((8, 8), np.float32)
        made.estimates.append(Estimate(np.eye(3), corners, "tracked", 0.9, 0.5, seen, Evidence(), step=step))
    return made


def test_a_stretch_of_other_corners_contradicts_and_a_slip_does_not() -> None:
    there = track(np.zeros(N))
    other = {i: 30.0 if 8 <= i < 15 else 0.0 for i in range(N)}
    found = contradicting(there, [run(0, other)])
    assert found is not None
    assert 8 <= found[0] < 15
    np.testing.assert_allclose(found[1], QUAD + np.array([30, 0]))
    assert contradicting(there, [run(0, {i: 30.0 if 8 <= i < 11 else 1.0 for i in range(N)})]) is None


def test_where_a_run_into_a_gap_meets_another_fix_one_frame_is_enough() -> None:
    there = track(np.where(np.arange(N) <= 8, 30.0, 0.0))
    found = contradicting(there, [run(12, dict.fromkeys(range(12, 7, -1), 0.0), stop=8)])
    assert found is not None
    assert found[0] == 8
    np.testing.assert_allclose(found[1], QUAD)


def test_a_track_leaps_where_nothing_else_did() -> None:
    still = run(0, dict.fromkeys(range(N), 0.0), step=PlaneStep(np.eye(3), 0.01 * np.eye(8)))
    assert leap(track(np.zeros(N)), [still]) is None
    index, corners = leap(track(np.where(np.arange(N) < 7, 0.0, 40.0)), [still]) or (None, QUAD)
    assert index == 7
    np.testing.assert_allclose(corners, QUAD + np.array([40, 0]))
    assert leap(track(np.where(np.arange(N) < 7, 0.0, 40.0)), [run(0, dict.fromkeys(range(N), 0.0))]) is None
