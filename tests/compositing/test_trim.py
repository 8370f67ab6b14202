"""Insets and rounded corners: where they are by hand's measure, whatever the pose."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo.compositing.layer import Layer, as_box
from ar_demo.compositing.opencv import CvCompositor
from ar_demo.compositing.trim import inset_pose, rounded
from ar_demo.errors import InputError
from ar_demo.media.pictures import write_picture
from ar_demo.rendering.painting import Painter
from ar_demo.surface import Surface

SIZE = np.array([80.0, 60.0])
SQUARE = np.array([[9.5, 9.5], [89.5, 9.5], [89.5, 69.5], [9.5, 69.5]])
INWARD = np.array([[1.0, 1], [-1, 1], [-1, -1], [1, -1]])


def white() -> Layer:
    return Layer(as_box(10, 10, 90, 70), np.full((60, 80, 4), 255, np.uint8))


def test_an_inset_is_as_wide_on_all_sides() -> None:
    np.testing.assert_allclose(inset_pose(SQUARE, SIZE, 5), SQUARE + 5 * INWARD)
    twice = SQUARE * 2
    np.testing.assert_allclose(inset_pose(twice, SIZE, 5), twice + 10 * INWARD)
    assert inset_pose(SQUARE, SIZE, 0) is SQUARE


def test_corners_are_rounded_and_all_else_stays() -> None:
    alpha = rounded(white(), SQUARE, SIZE, 12).rgba[..., 3]
    assert alpha[0, 0] == 0
    assert (alpha[12:-12] == 1).all()
    assert (alpha[:, 12:-12] == 1).all()
    lacking = (1 - alpha[:12, :12]).sum()
    assert lacking == pytest.approx((1 - np.pi / 4) * 12**2, rel=0.03)
    assert 0.2 < ((alpha > 0.02) & (alpha < 0.98)).sum() / (2 * np.pi * 12) < 2.5  # edges are smooth, and no wider
    untouched = white()
    assert rounded(untouched, SQUARE, SIZE, 0) is untouched


def test_in_perspective_the_nearer_corner_is_larger() -> None:
    pose = np.array([[20.0, 30], [80, 10], [80, 70], [20, 50]])
    layer = Layer(as_box(10, 10, 90, 70), np.full((60, 80, 4), 255, np.uint8))
    alpha = rounded(layer, pose, SIZE, 15).rgba[..., 3]
    y, x = np.mgrid[10:70, 10:90]
    missing = 1 - alpha
    inside = np.abs(y - 40) < 10 + (x - 20) / 3
    assert (missing * inside)[:, 40:].sum() > 1.5 * (missing * inside)[:, :40].sum()


def test_an_ad_is_drawn_so(tmp_path: Path) -> None:
    write_picture(tmp_path / "ad.png", np.full((60, 80, 3), 255, np.uint8))
    frame = np.zeros((80, 100, 3), np.uint8)
    painter = Painter(Surface(tmp_path / "ad.png", SQUARE, inset=5, radius=10), SQUARE, (100, 80), CvCompositor())
    painter.draw(frame, SQUARE, 1.0, Fraction(0))
    assert (frame[12:15, 40] == [[0] * 3] * 3).all()
    assert (frame[16:64, 40] == 255).all()
    assert frame[16, 16].max() == 0  # the rounded corner
    with pytest.raises(InputError, match="do not go into"):
        Painter(Surface(tmp_path / "ad.png", SQUARE, inset=40), SQUARE, (100, 80), CvCompositor())
    with pytest.raises(InputError, match="outline"):
        Surface(None, SQUARE, effect="outline", radius=3)
