"""The causal filter: calm at rest, close behind in motion."""

import numpy as np
import pytest

from ar_demo.tracking.oneeuro import OneEuro
from hdn.imaging.arrays import Array

from ..scenes import moved

QUAD = np.array([[100.0, 70], [220, 74], [216, 166], [102, 160]])


def filtered(track: Array, rate: float = 30) -> Array:
    follow = OneEuro()
    return np.array([follow(corners, i / rate) for i, corners in enumerate(track)])


def test_calms_jitter_at_rest() -> None:
    noisy = QUAD + np.random.default_rng(0).normal(0, 0.3, (200, 4, 2))
    jitter = [np.abs(np.diff(track[30:], axis=0)).mean() for track in (noisy, filtered(noisy))]
    assert jitter[1] < 0.4 * jitter[0]


@pytest.mark.parametrize("speed", [1, 3, 10, 40])
def test_lags_by_less_than_a_frame_in_motion(speed: float) -> None:
    track = QUAD + np.arange(90)[:, None, None] * [speed, 0.0]
    assert np.abs(filtered(track)[30:] - track[30:]).max() < speed


@pytest.mark.parametrize("speed", [0.05, 0.2, 0.5])
def test_never_lags_by_more_than_a_pixel_when_slow(speed: float) -> None:
    track = QUAD + np.arange(200)[:, None, None] * [speed, 0.0]
    assert np.abs(filtered(track) - track).max() < 1


def test_turning_and_growing_lag_by_less_than_a_frame() -> None:
    track = np.array([moved(QUAD, scale=1.02**i, rotation=0.03 * i) for i in range(60)])
    step = np.abs(np.diff(track, axis=0)).max((1, 2))
    assert (np.abs(filtered(track) - track).max((1, 2))[20:] < step[19:]).all()


def test_a_reset_jumps_to_the_new_place() -> None:
    follow = OneEuro()
    for i in range(10):
        follow(QUAD, i / 30)
    follow.reset()
    np.testing.assert_array_equal(follow(QUAD + 50, 1.0), QUAD + 50)
