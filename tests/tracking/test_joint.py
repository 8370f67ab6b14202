"""The joint solution on drawn measurements."""

import numpy as np
import pytest

from ar_demo.tracking.joint import CORNERS, Measurements, Shot, Solution

Given = dict[int, np.ndarray]


def motion(frames: int) -> np.ndarray:
    """(n, 8) corners of a quad that goes in a curve, px."""
    t = np.arange(frames) / 30
    centre = np.stack([300 + 80 * np.sin(1.5 * t), 200 + 40 * np.cos(2.2 * t)], 1)
    return (centre[:, None] + np.array([[-50.0, -30], [50, -30], [50, 30], [-50, 30]])).reshape(frames, CORNERS)


def still(frames: int) -> np.ndarray:
    return np.repeat(motion(1), frames, 0)


def noise(like: np.ndarray, px: float, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, px, like.shape)


def measured(
    *ways: np.ndarray,
    deviation: float | np.ndarray = 0.3,
    reference: Given | None = None,
    clicked: Given | None = None,
) -> Measurements:
    """Of ways (n, 8) through n frames, NaN where nothing was measured; deviation: px, of a corner."""
    z = np.array(ways)
    n = z.shape[1]
    covariance = np.broadcast_to(np.square(deviation) / 2, z.shape[:2])[..., None, None] * np.eye(CORNERS)
    linked = np.ones((len(ways), n - 1), bool)
    nothing = (np.full((len(ways), n - 1, side, side), np.nan) for side in (3, CORNERS))
    return Measurements(z, covariance, linked, *nothing, reference or {}, clicked or {})


def with_steps(measurements: Measurements, steps: np.ndarray, px: float = 0.2) -> Measurements:
    """With steps (n - 1, 3, 3) on each way, of so many px of standard deviation per coordinate."""
    m, ways = measurements, len(measurements.corners)
    covariance = np.tile(px**2 * np.eye(CORNERS), (ways, len(steps), 1, 1))
    steps = np.repeat(steps[None], ways, 0)
    return Measurements(m.corners, m.covariance, m.linked, steps, covariance, m.reference, m.clicked)


def shifts(corners: np.ndarray) -> np.ndarray:
    """(n - 1, 3, 3) the steps of a quad that only goes from place to place."""
    steps = np.repeat(np.eye(3)[None], len(corners) - 1, 0)
    steps[:, :2, 2] = np.diff(corners[:, :2], axis=0)
    return steps


def jitter(errors: np.ndarray) -> float:
    return float(np.abs(np.diff(errors, 2, axis=0)).mean())


def off(solution: Solution, truth: np.ndarray) -> np.ndarray:
    """(n,) px, the worst coordinate."""
    return np.abs(solution.corners - truth).max(1)


def deviation(solution: Solution) -> np.ndarray:
    return np.sqrt(np.trace(solution.covariance, axis1=1, axis2=2) / 4)


@pytest.mark.parametrize(("px", "claimed"), [(0.7, 0.3), (0.1, 0.3), (3.0, 3.0)])
def test_removes_jitter_without_lag(px: float, claimed: float) -> None:
    truth = motion(120)
    noisy = truth + noise(truth, px)
    errors = Shot(measured(noisy, deviation=claimed)).solve().corners - truth
    assert jitter(errors) < 0.4 * jitter(noisy - truth)
    assert np.abs(errors).mean() < 0.5 * np.abs(noisy - truth).mean()


def test_leaves_a_clean_track_alone() -> None:
    truth = motion(120)
    assert off(Shot(measured(truth)).solve(), truth).max() < 0.05


def test_a_still_camera_gives_a_still_track() -> None:
    truth = still(200)
    assert jitter(Shot(measured(truth + noise(truth, 0.2))).solve().corners) < 0.01


def test_keeps_real_shake_and_bursts_of_it() -> None:
    steps = np.random.default_rng(1).normal(0, 4, (300, 2)).cumsum(0)
    for shaken in (slice(0, 300), slice(100, 130)):
        truth = motion(300)
        truth[shaken] += np.tile(steps[shaken], 4)
        found = Shot(measured(truth + noise(truth, 0.05))).solve()
        assert np.abs(found.corners - truth).mean() < 0.1


def test_sudden_motion_is_followed_at_once() -> None:
    truth = still(200)
    truth[:, 0::2] += 6 * np.clip(np.arange(200) - 100, 0, 40)[:, None]
    assert off(Shot(measured(truth + noise(truth, 0.05))).solve(), truth).max() < 0.3


def test_gaps_are_bridged_along_the_motion_and_less_surely() -> None:
    truth = motion(60)
    seen = truth.copy()
    seen[30:36] = np.nan
    found = Shot(measured(seen)).solve()
    assert off(found, truth).max() < 0.3 < np.abs(truth[35] - truth[30]).max()
    assert deviation(found)[32] > 1.3 * deviation(found)[20]


def test_without_smoothing_only_gaps_are_bridged() -> None:
    truth = motion(60)
    noisy = truth + noise(truth, 0.3)
    noisy[30:36] = np.nan
    found = Shot(measured(noisy)).solve(0)
    seen = np.isfinite(noisy[:, 0])
    assert np.abs(found.corners - noisy)[seen].max() < 0.3  # at the gap's edges, which it hangs on
    assert off(found, truth)[~seen].max() < 2.5


def test_a_keyframe_mends_where_the_error_arose_and_nowhere_else() -> None:
    """From frame 49 on the tracker is 20 px off, and as sure as ever: the frames before are none the worse."""
    truth = still(283)
    wrong = truth + noise(truth, 0.1)
    wrong[49:81, 0::2] += 20
    before = Shot(measured(wrong, reference={0: truth[0]})).solve()
    found = Shot(measured(wrong, reference={0: truth[0]}, clicked={66: truth[66]})).solve()
    assert off(before, truth)[49:81].max() > 10
    assert off(found, truth)[49:81].max() < 0.5
    assert off(found, truth)[:49].max() < off(before, truth)[:49].max() + 0.05
    assert found.weight[0, 50:80].max() < 0.01 < 0.5 < found.weight[0, :49].min()


def test_steps_unmask_a_wrong_stretch() -> None:
    truth = motion(200)
    wrong = truth + noise(truth, 0.1)
    wrong[60:95] += 15
    assert off(Shot(measured(wrong)).solve(), truth)[60:95].max() > 10
    assert off(Shot(with_steps(measured(wrong), shifts(truth))).solve(), truth).max() < 0.5


def test_of_ways_with_steps_the_one_that_does_not_break_is_right() -> None:
    """Two of three ways follow something else from the known frame on, which their steps do as well."""
    truth = motion(120)
    astray = truth + 6 * np.minimum(np.arange(120), 50)[:, None]
    astray[50:] = np.nan
    ways = np.array([astray, astray, truth]) + noise(np.array([truth] * 3), 0.1)
    m = with_steps(measured(*ways, reference={0: truth[0]}), shifts(truth))
    m.steps[:2] = shifts(np.where(np.isfinite(astray), astray, 0.0))
    m.step_covariance[:2, 49:] = np.nan
    assert off(Shot(m).solve(), truth).max() < 0.5


def test_steps_bridge_what_no_smooth_motion_would() -> None:
    truth = motion(120) + np.tile(np.random.default_rng(0).normal(0, 3, (120, 2)).cumsum(0), 4)
    seen = truth.copy()
    seen[50:70] = np.nan
    found = Shot(with_steps(measured(seen), shifts(truth))).solve()
    assert off(found, truth).max() < 0.5 < 5 < off(Shot(measured(seen)).solve(), truth).max()


def test_steps_that_follow_something_else_count_for_little() -> None:
    truth = motion(200)
    drifting = shifts(truth)
    drifting[:, 0, 2] += 0.5
    found = Shot(with_steps(measured(truth + noise(truth, 0.05)), drifting)).solve()
    assert off(found, truth).max() < 0.3


def test_what_a_person_says_otherwise_is_spread_between() -> None:
    truth = motion(120)
    found = Shot(measured(truth, reference={0: truth[0]}, clicked={40: truth[40] + 4})).solve()
    np.testing.assert_allclose((found.corners - truth)[:41].mean(1), np.arange(41) / 10, atol=0.25)
    assert np.abs((found.corners - truth)[40] - 4).max() < 0.05


def test_ways_that_agree_count_as_one_and_of_two_that_do_not_the_neighbours_choose() -> None:
    truth = motion(120)
    first = truth + noise(truth, 0.05)
    alone, twice = Shot(measured(first)).solve(), Shot(measured(first, first)).solve()
    np.testing.assert_allclose(deviation(twice), deviation(alone), rtol=0.05)
    second = first.copy()
    second[50:60] += 12
    both = Shot(measured(second, first)).solve()
    assert off(both, truth).max() < 0.3
    assert both.weight[0, 50:60].max() < 0.1 < 0.5 < both.weight[1].min()


def test_what_is_uncertain_counts_less() -> None:
    """Half hidden for a while, the surface is led by what is known before and after."""
    truth = motion(120)
    noisy = truth + noise(truth, 0.1)
    noisy[40:60] += noise(truth[40:60], 4, seed=1)
    sure = np.full(120, 0.3)
    weighed = sure.copy()
    weighed[40:60] = 10
    errors = [np.abs(Shot(measured(noisy, deviation=d)).solve().corners - truth)[40:60].mean() for d in (sure, weighed)]
    assert errors[1] < 0.6 * errors[0]


def test_the_deviation_is_no_smaller_than_errors_that_last() -> None:
    """Errors that go on from frame to frame do not average out, however many frames there are."""
    truth, rng = still(300), np.random.default_rng(0)
    error = np.zeros(CORNERS)
    drifting = truth.copy()
    for k in range(300):
        error = 0.97 * error + np.sqrt(1 - 0.97**2) * rng.normal(0, 1, CORNERS)
        drifting[k] += error
    found = Shot(measured(drifting, deviation=np.sqrt(2.0))).solve()
    rms = float(np.sqrt(np.square(found.corners - truth).sum(1).mean() / 4))
    assert 0.6 * rms < deviation(found).mean() < 1.6 * rms
