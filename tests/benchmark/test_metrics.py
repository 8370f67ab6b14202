"""Each metric against a value computed by hand."""

import numpy as np
import pytest

from hdn.benchmark import metrics
from hdn.benchmark.metrics import Measures, figures, mean_figures, measure, pooled
from hdn.errors import InputError
from hdn.imaging.arrays import Array

SQUARE = np.array([[0.0, 0], [100, 0], [100, 100], [0, 100]])


def shifted(x: float, y: float) -> Array:
    return SQUARE + np.array([x, y])


def still(frames: int, offsets: dict[int, tuple[float, float]] | None = None) -> Array:
    """A square that rests (N, 4, 2), moved by offsets in some frames."""
    corners = np.repeat(SQUARE[None], frames, 0)
    for frame, offset in (offsets or {}).items():
        corners[frame] += offset
    return corners


def compare(
    truth: Array, corners: Array, lost: list[int] | None = None, seconds: float = 0.01, held: list[int] | None = None
) -> Measures:
    said = [
        "lost" if frame in (lost or []) else "held" if frame in (held or []) else "tracked"
        for frame in range(len(truth))
    ]
    return measure(truth, corners, said, np.full(len(truth) - 1, seconds))


def test_alignment_error_is_the_root_mean_square_over_the_corners() -> None:
    corners = SQUARE.copy()
    corners[0] += (3, 4)  # 5 px off
    corners[2] += (0, 5)  # 5 px off
    assert metrics.alignment_errors(SQUARE[None], corners[None])[0] == pytest.approx(np.sqrt(50 / 4))


def test_precision_and_its_average() -> None:
    # 1.5, 4, 30 and 80 px off: the given first frame, however wrong, does not count.
    m = compare(still(5), still(5, {0: (0, 0), 1: (1.5, 0), 2: (0, 4), 3: (30, 0), 4: (0, 80)}))
    assert m.errors == pytest.approx([1.5, 4, 30, 80])
    f = figures(m)
    assert (f["P<=2"], f["P<=5"], f["P<=10"], f["P<=20"]) == (0.25, 0.5, 0.5, 0.5)
    # Thresholds 0..50: the first counts from 2 on (49 of 51), the second from 4 (47), the third from 30 (21).
    assert f["avg Prec"] == pytest.approx((49 + 47 + 21) / 51 / 4)
    assert f["median error"] == pytest.approx(17)


def test_homography_discrepancy_of_a_shift_is_its_length_and_of_a_scale_that_of_the_unit_corners() -> None:
    assert metrics.discrepancy(SQUARE, SQUARE, shifted(3, 4)) == pytest.approx(5)
    # H_truth . H_tracked^-1 halves: (1, 1) goes to (0.5, 0.5), a distance of sqrt(2) / 2.
    assert metrics.discrepancy(SQUARE, SQUARE, SQUARE * 2) == pytest.approx(np.sqrt(0.5))


def test_homography_success_rate() -> None:
    f = figures(compare(still(3), still(3, {1: (15, 0), 2: (0, 150)})))
    assert f["avg HSR"] == pytest.approx((19 + 6) / 21 / 2)  # thresholds 0, 10 .. 200


def test_centroid_is_that_of_the_area() -> None:
    # A trapezium with parallel sides 4 (below) and 2 (above), height 3: its centroid is 3 * (4 + 2*2)/(3 * 6) up.
    trapezium = np.array([[1.0, 0], [3, 0], [4, 3], [0, 3]])
    assert metrics.centroids(trapezium[None])[0] == pytest.approx([2, 3 - 3 * 8 / 18])
    flat = np.array([[0.0, 0], [2, 0], [4, 0], [2, 0]])
    assert metrics.centroids(flat[None])[0] == pytest.approx([2, 0])


def test_centroid_precision_forgives_what_keeps_the_centre() -> None:
    turned = still(2)
    turned[1] = np.roll(SQUARE, 1, 0)  # a quarter turn: the corners are 100 px off
    f = figures(compare(still(2), turned))
    assert f["avg CP"] == 1
    assert f["avg Prec"] == 0


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (SQUARE, 1),
        (SQUARE[::-1], 1),
        (shifted(50, 0), 1 / 3),
        (shifted(50, 50), 2500 / 17500),
        (shifted(100, 0), 0),
        (SQUARE / 2, 0.25),
        (SQUARE[[0, 2, 1, 3]], 0),  # crosses itself
    ],
)
def test_overlap(other: Array, expected: float) -> None:
    assert metrics.overlap(SQUARE, other) == pytest.approx(expected, abs=1e-6)
    assert metrics.overlap(SQUARE + 5000.25, other + 5000.25) == pytest.approx(expected, abs=1e-6)


def test_success_rate() -> None:
    f = figures(compare(still(3), still(3, {2: (50, 0)})))
    assert f["avg SR"] == pytest.approx((20 + 7) / 21 / 2)  # overlaps 1 (over 0 .. 0.95) and 1/3 (over 0 .. 0.3)


@pytest.mark.parametrize(
    ("failed", "lengths", "fragments"),
    [
        ([], [30], 0),
        ([10], [10, 19], 0),
        ([5, 6, 7], [5, 0, 0, 22], 3 / 4),
        ([29], [29], 0),
    ],
)
def test_trajectories_and_fragments(failed: list[int], lengths: list[int], fragments: float) -> None:
    m = compare(still(30), still(30, dict.fromkeys(failed, (90.0, 0.0))))  # overlap 10 / 190 is a failure
    assert m.lengths.tolist() == lengths
    assert figures(m)["fragments"] == pytest.approx(fragments)


def test_trajectories_count_the_frames_between_annotations() -> None:
    truth = still(12)
    truth[2::2] = np.nan  # as in POT: frames 0, 1, 3, 5, ..
    m = compare(truth, still(12, {7: (200, 0)}))
    assert m.lengths.tolist() == [6, 3]


def test_jitter_is_the_median_second_difference_of_the_error() -> None:
    # 1 px to and fro: second differences of 4 px; the motion of the target itself is no jitter.
    truth = still(8, {i: (i * i, 5 * i) for i in range(8)})
    corners = truth + np.array([0, 1, -1, 1, -1, 1, -1, 1])[:, None, None] * (1.0, 0.0)
    m = compare(truth, corners)
    assert m.jitter == pytest.approx([4] * 5)
    drifting = truth + np.arange(8)[:, None, None] * (0.5, 0.0)
    assert figures(compare(truth, drifting))["jitter"] == pytest.approx(0)


def test_frames_lost_wrongly() -> None:
    truth = still(6)
    truth[4] = np.nan  # nothing to be seen there, so saying "lost" is right
    corners = still(6)
    corners[5] = np.nan  # no answer is as good as "lost"
    assert figures(compare(truth, corners, lost=[3, 4]))["lost wrongly"] == pytest.approx(2 / 4)


def test_frames_tracked_wrongly() -> None:
    corners = still(8, {1: (11, 0), 2: (9, 0), 3: (30, 0), 4: (0, 30), 5: (40, 0)})
    corners[6] = np.nan  # no answer is none that is wrong, whatever it is called
    m = compare(still(8), corners, lost=[3], held=[4])
    assert m.tracked.tolist() == [1, 1, 0, 0, 1, 0, 1]
    assert figures(m)["tracked wrongly"] == pytest.approx(2 / 4)
    assert np.isnan(figures(compare(still(3), still(3), lost=[1, 2]))["tracked wrongly"])


@pytest.mark.parametrize(
    ("offsets", "expected"),
    [
        ({}, []),
        ({3: 300, 4: 300, 5: 12}, [3]),  # 12 px is not yet recovered
        ({3: 300, 7: 300, 8: 300}, [1, 2]),
        ({8: 300, 9: 300}, [2]),  # never, so until after the last frame
    ],
)
def test_frames_to_recover(offsets: dict[int, float], expected: list[int]) -> None:
    m = compare(still(10), still(10, {i: (x, 0) for i, x in offsets.items()}))
    assert m.recoveries.tolist() == expected
    told = figures(m)["frames to recover"]
    assert np.isnan(told) if not expected else told == np.mean(expected)


def test_a_frame_without_answer_fails_at_every_threshold() -> None:
    corners = still(3)
    corners[2] = np.nan
    f = figures(compare(still(3), corners))
    assert (f["avg Prec"], f["avg HSR"], f["avg CP"]) == (0.5, 0.5, 0.5)
    assert f["avg SR"] == pytest.approx(20 / 21 / 2)


def test_means_over_sequences_and_over_frames_differ() -> None:
    good = compare(still(9), still(9), seconds=0.01)  # 8 frames
    bad = compare(still(3), still(3, {1: (60, 0), 2: (60, 0)}), seconds=0.05)  # 2 frames
    assert mean_figures([good, bad])["P<=5"] == 0.5
    assert figures(pooled([good, bad]))["P<=5"] == 0.8
    assert mean_figures([good, bad])["ms"] == pytest.approx(30)
    assert figures(pooled([good, bad]))["ms"] == pytest.approx(18)
    assert metrics.curves([good, bad])["precision"][5] == 0.5


def test_means_leave_out_sequences_that_have_nothing_to_tell() -> None:
    fine = compare(still(5), still(5))
    failed = compare(still(5), still(5, {2: (300, 0)}))
    assert mean_figures([fine, failed])["frames to recover"] == 1


def test_nothing_known_is_an_error() -> None:
    truth = still(3)
    truth[1:] = np.nan
    with pytest.raises(InputError, match="nothing can be measured"):
        compare(truth, still(3))
