"""What the degradations do to a frame."""

import numpy as np
import pytest

from hdn.benchmark.degradation import SETTINGS, degrade

CORNERS = np.array([[40.0, 20], [140, 20], [140, 80], [40, 80]])


@pytest.fixture
def frame() -> np.ndarray:
    return np.random.default_rng(0).integers(100, 200, (100, 180, 3), np.uint8)


def test_blur_spreads_a_line_over_25_px() -> None:
    line = np.zeros((40, 80, 3), np.uint8)
    line[:, 40] = 250
    blurred = degrade(line, "blur", 0, 0, CORNERS)
    assert np.flatnonzero(blurred[20, :, 0]).tolist() == list(range(28, 53))
    assert set(blurred[20, 28:53, 0]) == {10}


def test_dark_scales_and_adds_noise_of_its_own_to_each_frame(frame: np.ndarray) -> None:
    dark = degrade(frame, "dark", 3, 0, CORNERS).astype(float)
    assert abs(dark.mean() - 0.28 * frame.mean()) < 0.7
    assert abs((dark - 0.28 * frame).std() - 7) < 0.2
    assert np.array_equal(dark, degrade(frame, "dark", 3, 0, CORNERS))
    assert not np.array_equal(dark, degrade(frame, "dark", 4, 0, CORNERS))


def test_small_keeps_size_and_loses_detail(frame: np.ndarray) -> None:
    small = degrade(frame, "small", 0, 0, CORNERS)
    assert small.shape == frame.shape
    assert small.std() < 0.6 * frame.std()
    assert abs(small.mean() - frame.mean()) < 2


@pytest.mark.parametrize(("progress", "hidden"), [(0, 0.0), (0.5, 0.7), (1, 0.0), (0.35 / 1.7, 0.35)])
def test_the_bar_hides_up_to_70_percent_of_the_target(frame: np.ndarray, progress: float, hidden: float) -> None:
    original = frame.copy()
    barred = degrade(frame, "bar", 0, progress, CORNERS)
    target = barred[20:80, 40:140]
    assert abs((target == SETTINGS.bar_rgb).all(-1).mean() - hidden) < 0.03
    assert np.array_equal(frame, original)
