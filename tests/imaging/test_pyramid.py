import numpy as np
import pytest

from hdn.imaging.homography import similarity
from hdn.imaging.pyramid import Pyramid


def ramp(width: int, height: int) -> np.ndarray:
    """Red grows along x, green along y: the colour says where a pixel came from."""
    y, x = np.mgrid[:height, :width]
    return np.stack([x, y, 0 * x], -1).astype(np.uint8)


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0, 3.7, 8.0])
def test_crops_look_where_the_homography_says(scale: float) -> None:
    frame = ramp(256, 200)
    crop_to_frame = similarity(scale, 0.0, 40.3, 20.6)
    crop = Pyramid(frame).crop(crop_to_frame, 16, 16)
    x, y = np.arange(4, 12) * scale + 40.3, np.arange(4, 12) * scale + 20.6
    np.testing.assert_allclose(crop[8, 4:12, 0], x, atol=1.5)
    np.testing.assert_allclose(crop[4:12, 8, 1], y, atol=1.5)


def test_fine_patterns_do_not_alias() -> None:
    frame = np.zeros((256, 256, 3), np.uint8)
    frame[:, ::2] = 255
    crop = Pyramid(frame).crop(similarity(7.0, 0.0, 3.0, 3.0), 32, 32)
    assert np.abs(crop.astype(int) - 127).max() < 40


def test_outside_is_filled() -> None:
    crop = Pyramid(ramp(64, 64)).crop(similarity(1.0, 0.0, -20.0, 0.0), 32, 32, fill=(9, 8, 7))
    assert crop[5, 3].tolist() == [9, 8, 7]


def test_small_and_odd_frames() -> None:
    crop = Pyramid(ramp(37, 21)).crop(similarity(40.0, 0.0, 0.0, 0.0), 8, 8)
    assert crop.shape == (8, 8, 3)


def test_which_points_a_frame_shows() -> None:
    frame = Pyramid(ramp(64, 48))
    points = np.array([[-0.4, 0], [-0.6, 0], [63.4, 47.4], [63.6, 20], [20, 20]])
    assert frame.shows(np.eye(3), points).tolist() == [True, False, True, False, True]
    assert frame.shows(np.eye(3), points, margin=2).tolist() == [False, False, False, False, True]
    behind = np.array([[1.0, 0, 0], [0, 1, 0], [-0.1, 0, 1]])  # x beyond 10 lies behind the camera
    assert frame.shows(behind, np.array([[5.0, 5], [-15, -15], [15, 5]])).tolist() == [True, False, False]
