"""The old surface's colour goes from beside its edge, and what lies behind it stays."""

import cv2
import numpy as np
import pytest

from ar_demo.compositing.layer import Layer, as_box
from ar_demo.compositing.merge import blurred_layer, merge
from ar_demo.compositing.spill import without_spill
from ar_demo.scene.occlusion import Occluder
from hdn.imaging.arrays import Array, Picture

QUAD = np.array([[29.5, 19.5], [89.5, 19.5], [89.5, 59.5], [29.5, 59.5]])
GREEN, GREY, RED = (20, 200, 40), (110, 100, 90), (200, 30, 60)


def scene(colour: tuple[int, int, int], sigma: float, off: int = 0) -> Picture:
    """A surface of one colour on grey (80, 120, 3), out of focus."""
    frame = np.full((80, 120, 3), GREY, np.uint8)
    frame[20:60, 30 + off : 90 + off] = colour
    return np.asarray(cv2.GaussianBlur(frame, (0, 0), sigma), np.uint8)


def drawn(frame: Picture, sigma: float, clean: bool, occluder: Occluder | None = None) -> Picture:
    """With a red layer on the surface."""
    frame = frame.copy()
    rgba = np.full((40, 60, 4), (*RED, 255), np.uint8)
    layer = blurred_layer(Layer(as_box(30, 20, 90, 60), rgba), (sigma**2 - 0.2) * np.eye(2), frame.shape[:2])
    if clean:
        without_spill(frame, layer, QUAD, sigma**2, occluder)
    merge(frame, layer)
    return frame


def error(a: Array, b: Array) -> float:
    return float(np.abs(a.astype(float) - b).max())


@pytest.mark.parametrize("sigma", [1.0, 1.8])
def test_an_ad_s_edge_is_as_if_it_had_always_been_there(sigma: float) -> None:
    frame, truth = scene(GREEN, sigma), scene(RED, sigma)
    assert error(drawn(frame, sigma, clean=True), truth) < 0.5 * error(drawn(frame, sigma, clean=False), truth)
    far = np.ones(truth.shape[:2], bool)
    far[12:68, 22:98] = False
    np.testing.assert_array_equal(drawn(frame, sigma, clean=True)[far], frame[far])


def test_an_edge_beside_where_it_is_taken_to_be_gets_no_line_of_another_colour() -> None:
    for off in (-1, 1):
        frame, truth = scene(GREEN, 1.0, off), scene(RED, 1.0, off)
        assert error(drawn(frame, 1.0, clean=True), truth) < 1.15 * error(drawn(frame, 1.0, clean=False), truth)


def test_frames_of_16_bits_alike() -> None:
    frame = scene(GREEN, 1.5)
    deep = (frame.astype(np.uint16) * 257).copy()
    layer = blurred_layer(Layer(as_box(30, 20, 90, 60), np.full((40, 60, 4), 255, np.uint8)), 2 * np.eye(2), (80, 120))
    shallow = frame.copy()
    without_spill(shallow, layer, QUAD, 2.0)
    without_spill(deep, layer, QUAD, 2.0)
    assert np.abs(deep / 257 - shallow).max() < 1.5


def test_an_occluder_is_left_alone() -> None:
    frame = scene(GREEN, 1.5)
    share = np.ones((40, 12, 3), np.float32)
    occluder = Occluder(as_box(24, 20, 36, 60), share, share * 99, share)
    before = frame.copy()
    layer = blurred_layer(Layer(as_box(30, 20, 90, 60), np.full((40, 60, 4), 255, np.uint8)), 2 * np.eye(2), (80, 120))
    without_spill(frame, layer, QUAD, 2.0, occluder)
    np.testing.assert_array_equal(frame[20:60, 24:36], before[20:60, 24:36])
    assert (frame[20:60, 84:96] != before[20:60, 84:96]).any()
