"""What the degradations do to a frame."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from hdn.benchmark.degradation import SETTINGS, blur_along_motion, degrade, line_kernel
from hdn.benchmark.sequences import Sequence
from hdn.imaging.arrays import Array

CORNERS = np.array([[40.0, 20], [140, 20], [140, 80], [40, 80]])
STILL = np.stack([CORNERS] * 81)  # in a clip of 81 frames


@pytest.fixture
def frame() -> np.ndarray:
    return np.random.default_rng(0).integers(100, 200, (100, 180, 3), np.uint8)


def test_blur_spreads_a_line_over_25_px() -> None:
    line = np.zeros((40, 80, 3), np.uint8)
    line[:, 40] = 250
    blurred = degrade(line, "blur", 0, STILL)
    assert np.flatnonzero(blurred[20, :, 0]).tolist() == list(range(28, 53))
    assert set(blurred[20, 28:53, 0]) == {10}


def test_dark_scales_and_adds_noise_of_its_own_to_each_frame(frame: np.ndarray) -> None:
    dark = degrade(frame, "dark", 3, STILL).astype(float)
    assert abs(dark.mean() - 0.28 * frame.mean()) < 0.7
    assert abs((dark - 0.28 * frame).std() - 7) < 0.2
    assert np.array_equal(dark, degrade(frame, "dark", 3, STILL))
    assert not np.array_equal(dark, degrade(frame, "dark", 4, STILL))


def test_small_keeps_size_and_loses_detail(frame: np.ndarray) -> None:
    small = degrade(frame, "small", 0, STILL)
    assert small.shape == frame.shape
    assert small.std() < 0.6 * frame.std()
    assert abs(small.mean() - frame.mean()) < 2


@pytest.mark.parametrize(("index", "hidden"), [(0, 0.0), (40, 0.7), (80, 0.0), (16, 0.34)])
def test_the_bar_hides_up_to_70_percent_of_the_target(frame: np.ndarray, index: int, hidden: float) -> None:
    original = frame.copy()
    barred = degrade(frame, "bar", index, STILL)
    target = barred[20:80, 40:140]
    assert abs((target == SETTINGS.bar_rgb).all(-1).mean() - hidden) < 0.03
    assert np.array_equal(frame, original)


@pytest.mark.parametrize(
    ("index", "left", "right"),
    [(1, 0.0, 0.36), (20, 1 / 6, 5 / 6), (40, 2 / 3, 1.0), (60, 1 / 6, 5 / 6), (80, 0, 1 / 3)],
)
def test_the_chequered_bar_slides_across_and_back(frame: np.ndarray, index: int, left: float, right: float) -> None:
    original = frame.copy()
    hidden = (degrade(frame, "bar2", index, STILL) != frame).any(-1)
    columns = np.flatnonzero(hidden[20:80, 40:140].mean(0) > 0.95)
    assert np.abs([columns[0] - 100 * left, columns[-1] + 1 - 100 * right]).max() < 2
    rows = np.flatnonzero(hidden.any(1))
    assert (rows[0], rows[-1]) == (0, 99)  # 30 px above and below the target, as far as the frame goes
    assert np.array_equal(frame, original)


def test_the_chequered_bar_is_of_strong_contrast(frame: np.ndarray) -> None:
    drawn = cv2.cvtColor(degrade(frame, "bar2", 20, STILL), cv2.COLOR_RGB2GRAY)[20:80, 60:120]
    assert (drawn < 80).mean() > 0.4
    assert (drawn > 180).mean() > 0.4


def moving(x: float, y: float) -> Array:
    """The target's corners in 81 frames, moved by so many px a frame."""
    return STILL + np.arange(81)[:, None, None] * np.array([x, y])


@pytest.mark.parametrize("motion", [(2.0, 1.0), (-1.5, 2.0), (0.0, -2.5)])
def test_blur2_goes_along_the_motion(motion: tuple[float, float]) -> None:
    lines = np.array([blur_along_motion(index, moving(*motion)) for index in range(1, 81)])
    across = lines @ [motion[1], -motion[0]] / np.hypot(*motion)
    lengths = np.linalg.norm(lines, axis=1)
    assert np.abs(across).max() <= SETTINGS.blur2_least_px
    assert 10 < lengths.min() < 20
    assert 30 < lengths.max() < 50


def test_blur2_of_a_fast_target_is_60_px_and_of_one_at_rest_turns() -> None:
    assert np.linalg.norm(blur_along_motion(7, moving(30, 4))) == pytest.approx(60)
    lines = np.array([blur_along_motion(index, STILL) for index in range(1, 81)])
    np.testing.assert_allclose(np.linalg.norm(lines, axis=1), 8)
    assert np.ptp(np.unwrap(2 * np.arctan2(lines[:, 1], lines[:, 0]))) > np.pi  # more than a right angle


def test_a_line_s_kernel_is_its_length_and_direction() -> None:
    kernel = line_kernel(np.array([12.0, -16.0]))
    y, x = np.indices(kernel.shape) - len(kernel) // 2
    assert kernel.sum() == pytest.approx(1)
    assert abs((kernel * x).sum()) < 1e-9
    covariance = [[(kernel * a * b).sum() for a in (x, y)] for b in (x, y)]
    expected = np.outer([12, -16], [12, -16]) / 12  # of an even density along the line
    np.testing.assert_allclose(covariance, expected, atol=0.3)


@pytest.mark.parametrize("kind", ["bar2", "blur2"])
def test_the_first_frame_is_left_as_it_is(frame: np.ndarray, kind: str) -> None:
    assert np.array_equal(degrade(frame, kind, 0, STILL), frame)
    assert not np.array_equal(degrade(frame, kind, 1, STILL), frame)


def test_between_known_corners_the_target_is_taken_to_move_evenly(tmp_path: Path) -> None:
    truth = moving(3, 1)
    frame = np.random.default_rng(0).integers(0, 255, (100, 180, 3), np.uint8)
    for index in range(81):
        cv2.imwrite(str(tmp_path / f"{index}.png"), frame)
    files = tuple(tmp_path / f"{index}.png" for index in range(81))
    rare = np.full_like(truth, np.nan)
    rare[::20] = truth[::20]
    for kind in ("bar2", "blur2"):
        all_known, few_known = (Sequence("set", "name", files, truth[0], t).degraded(kind) for t in (truth, rare))
        for one, other in zip(all_known.frames(), few_known.frames(), strict=True):
            assert np.array_equal(one, other)


def test_start_blurs_the_first_quarter_as_blur_does() -> None:
    frame = np.random.default_rng(3).integers(0, 256, (40, 60, 3), np.uint8)
    corners = np.zeros((8, 4, 2))
    for index in (0, 1):
        np.testing.assert_array_equal(degrade(frame, "start", index, corners), degrade(frame, "blur", index, corners))
    for index in (2, 7):
        np.testing.assert_array_equal(degrade(frame, "start", index, corners), frame)
