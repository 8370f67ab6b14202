"""Motion blur by the motion: the shutter's share, and what streaks a layer shows."""

import cv2
import numpy as np
import pytest

from ar_demo.compositing.layer import Layer, as_box
from ar_demo.compositing.streak import smeared
from ar_demo.scene.conditions import Appearance
from ar_demo.scene.shutter import Shutter
from hdn.networks.loading import load_matte

from ..scenes import Scene, moved

SQUARE = np.array([[20.0, 20], [59, 20], [59, 49], [20, 49]])


def streak(length: float, along: np.ndarray) -> np.ndarray:
    return np.outer(along, along) * length**2 / 12


def test_the_shutter_is_told_by_streaks() -> None:
    shutter = Shutter()
    assert shutter.share == 0
    for speed in (6.0, 9, 12):
        along = np.array([0.6, 0.8])
        shutter.learn(streak(0.5 * speed, along) + 1.5 * np.eye(2), speed * along)  # a little out of focus as well
    assert shutter.share == pytest.approx(0.5)
    shutter.learn(np.diag([4.0, 4.0]), np.array([20.0, 0]))  # focus alone
    assert shutter.share == pytest.approx(0.5, abs=0.01)


def test_slow_motion_tells_nothing() -> None:
    shutter = Shutter()
    shutter.learn(np.diag([9.0, 0]), np.array([1.0, 0]))
    assert shutter.share == 0


def test_the_shutter_of_drawn_frames() -> None:
    """A poster that moves by 12 px a frame, blurred over half of that."""
    scene = Scene(640, 480, seed=3)
    scene.quad = np.array([[120.0, 140], [360, 148], [352, 332], [124, 320]])
    appearance = Appearance(scene.draw(scene.quad), scene.quad, load_matte())
    motion = np.tile([12.0, 0], (4, 1))
    for number in range(1, 6):
        pose = moved(scene.quad, (12 * number, 0))
        frame = cv2.blur(scene.draw(pose, noise=0), (7, 1))
        conditions = appearance.conditions(frame, pose, 0.2, False, False, motion)
    assert np.linalg.norm(conditions.way, axis=1) == pytest.approx(7, abs=2.5)


def test_a_layer_is_smeared_along_its_way() -> None:
    rgba = np.zeros((30, 40, 4), np.uint8)
    rgba[:] = (0, 128, 255, 255)
    layer = Layer(as_box(20, 20, 60, 50), rgba)
    found = smeared(layer, SQUARE, np.tile([8.0, 0], (4, 1)), (80, 100))
    alpha = np.zeros((80, 100))
    alpha[found.box] = found.rgba[..., 3]
    assert alpha.sum() == pytest.approx(30 * 40, rel=0.01)  # nothing is lost
    assert alpha[35, 40] == pytest.approx(1)
    assert alpha[35, 19] == pytest.approx(0.44, abs=0.12)  # half of the way lies on each side
    assert alpha[35, 14] == 0
    assert alpha[18, 40] == 0
    assert np.allclose(found.rgba[..., 2], found.rgba[..., 3])


def test_what_stands_still_is_left_alone() -> None:
    layer = Layer(as_box(0, 0, 4, 4), np.zeros((4, 4, 4), np.uint8))
    assert smeared(layer, SQUARE, np.zeros((4, 2)), (80, 100)) is layer


def test_a_layer_that_turns_is_smeared_most_at_its_ends() -> None:
    rgba = np.full((30, 40, 4), 255, np.uint8)
    way = np.array([[0.0, -8], [0, 8], [0, 8], [0, -8]])  # the left side goes up, the right one down
    found = smeared(Layer(as_box(20, 20, 60, 50), rgba), SQUARE, way, (80, 100))
    alpha = np.zeros((80, 100))
    alpha[found.box] = found.rgba[..., 3]
    soft = (alpha > 0.05) & (alpha < 0.95)
    assert soft[:, 22].sum() > 2 * soft[:, 40].sum()
