"""Scene cuts: found where there is one, and not where the camera only moves fast."""

import cv2
import numpy as np
import pytest

from ar_demo.tracking.cuts import CutDetector
from hdn.imaging.arrays import Image
from hdn.imaging.pyramid import Pyramid

from ..scenes import texture


def view(of: Image, x: float, y: float = 0.0, scale: float = 1.0) -> Image:
    """A 320x240 window of a large picture, grey."""
    matrix = np.array([[1 / scale, 0, x], [0, 1 / scale, y]])
    window = cv2.warpAffine(of, matrix, (320, 240), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    return np.asarray(cv2.cvtColor(window, cv2.COLOR_RGB2GRAY), np.uint8)


def cuts(views: list[Image]) -> list[int]:
    detector = CutDetector()
    return [i for i, image in enumerate(views) if detector.is_cut(i, Pyramid(image))]


@pytest.fixture(scope="module")
def panorama() -> Image:
    return texture(3, 1600, 400)


def test_finds_a_cut_either_way(panorama: Image) -> None:
    other = 255 - texture(8, 1600, 400)
    views = [view(panorama, 2.0 * i) for i in range(5)] + [view(other, 500 + 2.0 * i) for i in range(5)]
    assert cuts(views) == [5]
    detector = CutDetector()
    assert [i for i in reversed(range(10)) if detector.is_cut(i, Pyramid(views[i]))] == [4]


def test_finds_a_cut_to_black_and_back(panorama: Image) -> None:
    views = [view(panorama, 0)] * 3
    assert cuts([*views, *[np.zeros((240, 320), np.uint8)] * 3, *views]) == [3, 6]


@pytest.mark.parametrize("step", [5, 20, 45])
def test_a_fast_pan_is_no_cut(panorama: Image, step: float) -> None:
    assert cuts([view(panorama, step * i) for i in range(20)]) == []


def test_zoom_light_and_passers_by_are_no_cut(panorama: Image) -> None:
    zoom = [view(panorama, 200, 60, 1.12**i) for i in range(8)]
    flash = [np.clip(view(panorama, 200) * gain, 0, 255).astype(np.uint8) for gain in (1, 1.3, 1.8, 1.2, 0.7, 1)]
    passer = [view(panorama, 200) for _ in range(10)]
    for i, image in enumerate(passer):
        image[30:, 30 * i : 30 * i + 90] = 40
    for views in (zoom, flash, passer):
        assert cuts(views) == []


def test_only_neighbours_are_compared(panorama: Image) -> None:
    detector = CutDetector()
    assert not detector.is_cut(3, Pyramid(view(panorama, 0)))
    assert not detector.is_cut(9, Pyramid(np.zeros((240, 320), np.uint8)))
