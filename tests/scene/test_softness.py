"""Softness is measured as what it was blurred by, and an ad takes it on."""

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo.compositing.opencv import CvCompositor
from ar_demo.media.pictures import write_picture
from ar_demo.rendering.painting import Painter
from ar_demo.scene.conditions import Appearance
from ar_demo.scene.softness import MODEL, SoftnessMeter, sharpest_edges
from ar_demo.surface import Surface
from hdn.imaging.arrays import Image
from hdn.networks.loading import load_matte

QUAD = np.array([[60.0, 40], [260, 44], [256, 200], [64, 196]])


def poster(sigma: float, seed: int = 1) -> Image:
    """A frame (240, 320, 3) of shapes with hard edges, as pixels cover them in part, out of focus."""
    rng = np.random.default_rng(seed)
    large = np.full((960, 1280, 3), 110, np.uint8)
    for _ in range(60):
        corners = rng.uniform(0, 1, (3, 2)) * 300 + rng.uniform(0, 1, 2) * [1100, 800]
        cv2.fillPoly(large, [corners.astype(np.int32)], rng.integers(20, 235, 3).tolist())
    frame = cv2.resize(large, (320, 240), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(frame, (0, 0), sigma) if sigma else frame, np.uint8)


@pytest.mark.parametrize("sigma", [0.7, 1.0, 1.6])
def test_the_sharpest_edges_tell_the_blur(sigma: float) -> None:
    variance = SoftnessMeter().see(poster(sigma), QUAD)
    assert np.sqrt(variance) == pytest.approx(sigma, rel=0.2)


def test_a_sharp_frame_leaves_a_picture_as_sharp_as_it_is() -> None:
    assert SoftnessMeter().see(poster(0), QUAD) < 0.3


def test_soft_things_among_sharp_ones_and_motion_do_not_count() -> None:
    frame = poster(0)
    frame[:, 150:] = cv2.GaussianBlur(frame, (0, 0), 3)[:, 150:]
    assert SoftnessMeter().see(frame, QUAD) < 0.3
    moved = cv2.blur(poster(0), (9, 1))
    assert SoftnessMeter().see(np.asarray(moved, np.uint8), QUAD) < 0.6  # the streaks have a variance of 6.7


def test_nothing_is_told_without_edges_and_what_is_known_stays() -> None:
    flat = np.full((240, 320, 3), 128, np.uint8)
    assert sharpest_edges(flat) is None
    meter = SoftnessMeter()
    assert meter.see(flat, QUAD) == 0
    known = meter.see(poster(1.2), QUAD)
    assert meter.see(flat, QUAD) == known
    meter.forget()
    assert meter.variance == 0


def test_focus_that_changes_is_followed_within_some_frames() -> None:
    meter = SoftnessMeter()
    meter.see(poster(0), QUAD)
    for _ in range(10):
        variance = meter.see(poster(1.5), QUAD)
    assert np.sqrt(variance) == pytest.approx(1.5, rel=0.25)
    assert variance < MODEL.most_px2


@pytest.mark.parametrize("sigma", [0.6, 1.3])
def test_an_ad_is_as_soft_as_the_video(tmp_path: Path, sigma: float) -> None:
    matte, ad = load_matte(), np.zeros((400, 400, 3), np.uint8)
    ad[:, 200:] = 255
    write_picture(tmp_path / "ad.png", ad)
    widths = []
    for softness in (True, False):
        frame = poster(sigma)
        appearance = Appearance(frame, QUAD, matte, grain=False, softness=softness)
        painter = Painter(Surface(tmp_path / "ad.png", QUAD), QUAD, (320, 240), CvCompositor())
        painter.draw(frame, QUAD, 1.0, Fraction(0), appearance.see(frame.copy(), QUAD, 0.3))
        row = frame[118:122, 140:182].mean((0, 2))
        slope = np.abs(np.diff(row)) / np.ptp(row)
        place = np.arange(len(slope))
        widths.append(float((slope * (place - (slope * place).sum()) ** 2).sum()))  # variance of the edge
    assert widths[0] - widths[1] == pytest.approx(sigma**2, rel=0.35, abs=0.08)
