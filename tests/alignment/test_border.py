"""Targets of little texture are placed by their border."""

import cv2
import numpy as np
import pytest

from hdn import Tracker
from hdn.alignment.border import UNCONSTRAINED, Border
from hdn.alignment.refinement import ALL_VISIBLE
from hdn.imaging.arrays import Array, Image
from hdn.imaging.homography import from_corners, transform
from hdn.imaging.pyramid import Pyramid
from hdn.imaging.quads import outline, square
from hdn.networks.engine import Engine

from ..scenes import Scene, error, moved, path, texture

SIZE = 128, 96  # of the rectified crop


@pytest.fixture
def plain() -> Scene:
    """A poster of one colour, but for a faint letter."""
    scene = Scene()
    scene.poster = np.full((180, 240, 3), (196, 150, 60), np.uint8)
    cv2.putText(scene.poster, "A", (90, 120), cv2.FONT_HERSHEY_SIMPLEX, 3, (200, 156, 66), 8, cv2.LINE_AA)
    return scene


def border(scene: Scene, quad: Array | None = None) -> Border:
    quad = scene.quad if quad is None else quad
    return Border(Pyramid(scene.draw(scene.quad)), from_corners(outline(*SIZE), quad), *SIZE)


def drawn_to(border: Border, frame: Image, start: Array, scene: Scene) -> Array:
    """The corners (4, 2) where the border alone puts them, from a start (3, 3)."""
    constraint = border.constraint(Pyramid(frame), start, ALL_VISIBLE)
    parameters = np.linalg.solve(constraint.information, constraint.weighted_mean)
    half = max(SIZE) / 2
    to_unit = np.array([[1 / half, 0, -(SIZE[0] - 1) / 2 / half], [0, 1 / half, -(SIZE[1] - 1) / 2 / half], [0, 0, 1]])
    warp = np.linalg.inv(to_unit) @ (np.append(parameters, 0).reshape(3, 3) + np.eye(3)) @ to_unit
    return transform(start @ from_corners(outline(*SIZE), scene.quad) @ warp, outline(*SIZE))


@pytest.mark.parametrize("change", [((2.4, -1.7), 1.0, 0.0), ((0, 0), 1.03, 0.0), ((-1, 1), 0.98, 0.02)])
def test_steps_tell_where_the_border_has_gone(plain: Scene, change: tuple[tuple[float, float], float, float]) -> None:
    """Whatever is behind it now."""
    truth = moved(plain.quad, *change)
    first = border(plain)
    plain.wall = cv2.GaussianBlur(texture(77, plain.width, plain.height), (0, 0), 2)
    found = drawn_to(first, plain.draw(truth), np.eye(3), plain)
    assert error(found, truth) < 0.35
    assert error(found, truth) < 0.3 * error(plain.quad, truth)


def test_something_before_a_side_does_not_pull(plain: Scene) -> None:
    frame = plain.draw(plain.quad)
    frame[60:120, 90:112] = (30, 30, 34)
    assert error(drawn_to(border(plain), frame, np.eye(3), plain), plain.quad) < 0.5


def test_a_region_inside_a_surface_has_no_border(plain: Scene) -> None:
    inside = (plain.quad - plain.quad.mean(0)) * 0.6 + plain.quad.mean(0)
    assert border(plain).is_distinct
    assert not border(plain, inside).is_distinct


def test_a_border_that_is_gone_does_not_pull(plain: Scene) -> None:
    assert border(plain).matching_share(Pyramid(plain.draw(plain.quad)), np.eye(3)) == 1
    assert border(plain).matching_share(Pyramid(plain.draw(None)), np.eye(3)) < 0.4
    assert (
        border(plain).constraint(Pyramid(np.full((240, 320, 3), 90, np.uint8)), np.eye(3), ALL_VISIBLE) is UNCONSTRAINED
    )


def test_a_plain_poster_is_tracked_though_a_light_wanders_over_it(engine: Engine, plain: Scene) -> None:
    tracker = Tracker(engine=engine)
    tracker.init(lit(plain, plain.quad, 0), plain.quad)
    errors = []
    for index, truth in enumerate(path(plain.quad, 30)[1:15], 1):
        estimate = tracker.track(lit(plain, truth, index))
        assert estimate.state == "tracked"
        errors.append(error(estimate.corners, truth))
    assert np.median(errors) < 1
    assert max(errors) < 3


def lit(scene: Scene, corners: Array, index: int) -> Image:
    """A frame with a highlight on the poster that moves 3 px of it a frame."""
    y, x = np.mgrid[:180, :240]
    light = 50 * np.exp(-((x - 60 - 3 * index) ** 2 + (y - 100) ** 2) / (2 * 18**2))
    plain = scene.poster
    scene.poster = np.clip(plain + light[..., None], 0, 255).astype(np.uint8)
    frame = scene.draw(corners)
    scene.poster = plain
    return frame


def test_quads_at_the_frames_edge(plain: Scene) -> None:
    """Nothing is known beyond it, and no step there."""
    quad = square(1) * [320, 240] + [159.5, 119.5]
    assert not border(plain, quad).is_distinct
