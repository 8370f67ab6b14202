from fractions import Fraction

import numpy as np
import pytest

from ar_demo.tracking.smoothing import segments, smooth
from ar_demo.tracks import Source, Track


def make_track(corners: np.ndarray, states: list[str] | None = None) -> Track:
    n = len(corners)
    measured = np.array([s == "tracked" for s in states or ["tracked"] * n])
    return Track(
        Source("clip.mp4", 640, 480, Fraction(30), n),
        0,
        corners[0],
        [Fraction(i, 30) for i in range(n)],
        corners,
        states or ["tracked"] * n,  # type: ignore[arg-type]
        np.ones(n),
        np.where(measured, 0.3, np.inf),
    )


def motion(frames: int) -> np.ndarray:
    t = np.arange(frames) / 30
    centre = np.stack([300 + 80 * np.sin(1.5 * t), 200 + 40 * np.cos(2.2 * t)], 1)
    return centre[:, None] + np.array([[-50.0, -30], [50, -30], [50, 30], [-50, 30]])


def jitter(errors: np.ndarray) -> float:
    return float(np.abs(np.diff(errors, 2, axis=0)).mean())


def test_removes_jitter_without_lag() -> None:
    truth = motion(120)
    noisy = truth + np.random.default_rng(0).normal(0, 0.7, truth.shape)
    out = smooth(make_track(noisy)).corners
    assert jitter(out - truth) < 0.2 * jitter(noisy - truth)
    assert np.abs(out - truth).mean() < 0.6 * np.abs(noisy - truth).mean()


def test_leaves_a_clean_track_alone() -> None:
    truth = motion(120)
    assert np.abs(smooth(make_track(truth)).corners - truth).max() < 0.05


def test_keeps_real_shake() -> None:
    shaking = motion(120) + np.random.default_rng(1).normal(0, 4, (120, 1, 2)).cumsum(0)
    noisy = shaking + np.random.default_rng(2).normal(0, 0.05, shaking.shape)
    assert np.abs(smooth(make_track(noisy)).corners - shaking).mean() < 0.3


def test_zero_is_off() -> None:
    track = make_track(motion(10))
    assert smooth(track, 0) is track


def test_never_smooths_across_a_loss() -> None:
    truth = motion(60)
    truth[30:] += 200
    states = ["tracked"] * 25 + ["lost"] * 5 + ["tracked"] * 30
    truth[25:30] = np.nan
    out = smooth(make_track(truth, states)).corners
    assert np.isnan(out[25:30]).all()
    assert np.abs(out[:25] - truth[:25]).max() < 0.05
    assert np.abs(out[30:] - truth[30:]).max() < 0.05


def test_bridges_held_frames_along_the_motion() -> None:
    truth = motion(60)
    held = truth.copy()
    held[30:36] = truth[29]
    states = ["tracked"] * 30 + ["held"] * 6 + ["tracked"] * 24
    out = smooth(make_track(held, states)).corners
    assert np.abs(out[30:36] - truth[30:36]).max() < 1.0 < np.abs(held[30:36] - truth[30:36]).max()


def test_held_frames_at_the_end_stay_put() -> None:
    corners = motion(40)
    corners[35:] = corners[34]
    out = smooth(make_track(corners, ["tracked"] * 35 + ["held"] * 5)).corners
    np.testing.assert_array_equal(out[35:], np.broadcast_to(out[34], (5, 4, 2)))


def test_never_smooths_across_a_cut() -> None:
    truth = motion(60)
    truth[30:] += 200
    track = make_track(truth + np.random.default_rng(0).normal(0, 0.7, truth.shape))
    across = np.abs(smooth(track).corners - truth).mean()
    track.cuts = [30]
    apart = np.abs(smooth(track).corners - truth).mean()
    assert apart < 0.5 * np.abs(track.corners - truth).mean() < across


def test_given_corners_stay_as_they_are() -> None:
    truth = motion(90)
    track = make_track(truth + np.random.default_rng(0).normal(0, 0.7, truth.shape))
    track.quad, track.keyframes = truth[0], {40: truth[40] + 2}
    track.corners[40] = track.keyframes[40]
    out = smooth(track).corners
    np.testing.assert_array_equal(out[40], truth[40] + 2)
    np.testing.assert_array_equal(out[0], truth[0])
    assert np.abs(np.diff(out - truth, axis=0))[35:45].max() < 1.5  # its neighbours come along


def test_smooths_only_where_it_shall() -> None:
    truth = motion(90)
    track = make_track(truth + np.random.default_rng(0).normal(0, 0.7, truth.shape))
    where = np.zeros(90, bool)
    where[30:60] = True
    out = smooth(track, where=where).corners
    np.testing.assert_array_equal(out[~where], track.corners[~where])
    assert jitter((out - truth)[31:59]) < 0.3 * jitter((track.corners - truth)[31:59])


@pytest.mark.parametrize(
    ("flags", "cuts", "runs"),
    [
        ([], [], []),
        ([True], [], [(0, 1)]),
        ([False, True, True, False, True], [], [(1, 3), (4, 5)]),
        ([False, True, True, False, True], [1, 2, 3], [(1, 2), (2, 3), (4, 5)]),
    ],
)
def test_segments(flags: list[bool], cuts: list[int], runs: list[tuple[int, int]]) -> None:
    assert segments(flags, cuts) == runs


def test_what_is_uncertain_counts_less() -> None:
    """Half hidden for a while, the surface is led by what is known before and after."""
    truth = motion(120)
    noisy = truth + np.random.default_rng(0).normal(0, 0.1, truth.shape)
    noisy[40:60] += np.random.default_rng(1).normal(0, 4, (20, 4, 2))
    track = make_track(noisy)
    alike = np.abs(smooth(track).corners - truth)[40:60].mean()
    track.deviation[40:60] = 10
    weighed = np.abs(smooth(track).corners - truth)[40:60].mean()
    assert weighed < 0.6 * alike
