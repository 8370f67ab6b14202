"""The motion of a plane between two frames, by the parts of it that are seen in both."""

import cv2
import numpy as np
import pytest

from hdn.alignment.refinement import Refiner
from hdn.imaging.arrays import Array, Floats, Image
from hdn.imaging.homography import transform, translation
from hdn.imaging.observation import Observation
from hdn.imaging.pyramid import Pyramid
from hdn.plane.motion import LEAST_COVARIANCE, Step, StepSearch
from hdn.plane.plane_map import PlaneMap

from ..scenes import error
from .drawing import POSTER, Wall, camera, mapped, motion, rms


@pytest.fixture(scope="module")
def wall() -> Wall:
    return Wall()


BEFORE = camera(500, 360)
AFTER = camera(491, 365, 0.02, 5e-5)


def grey(frame: Image) -> Pyramid:
    return Observation(frame).grey


def streaked(frame: Image, length: int) -> Image:
    """The frame blurred along x by so many px."""
    return np.asarray(cv2.blur(frame, (length, 1), borderType=cv2.BORDER_REFLECT_101), np.uint8)


def whole(plane: PlaneMap) -> Floats:
    return np.ones((4 * plane.level.cells,) * 2, np.float32)


def step_error(step: Step, before: Array, after: Array) -> float:
    """How far a step has the poster's corners from where they are, px."""
    return error(transform(step.homography, transform(before, POSTER)), transform(after, POSTER))


def test_a_step_between_blurred_frames_while_a_bar_moves_otherwise(wall: Wall) -> None:
    plane = mapped(wall, BEFORE)
    first, second = wall.view(BEFORE), wall.view(AFTER)
    stripes = cv2.resize(np.random.default_rng(3).integers(0, 255, (12, 4, 3), np.uint8), (150, 360))
    first[:, 260:410], second[:, 280:430] = stripes, stripes  # over most of the poster, to the right; it goes left
    before, after = (grey(streaked(frame, 21)) for frame in (first, second))
    corners = transform(BEFORE, POSTER)
    step = StepSearch(plane, before, after, corners, whole(plane)).best([np.eye(3)])
    assert step is not None
    assert error(corners, transform(AFTER, POSTER)) > 9
    assert step_error(step, BEFORE, AFTER) < 1


def test_the_best_of_several_starts_counts(wall: Wall) -> None:
    plane = mapped(wall, BEFORE)
    far = camera(440, 330)
    views = grey(wall.view(BEFORE)), grey(wall.view(far))
    corners = transform(BEFORE, POSTER)
    near = translation(3, -2) @ motion(BEFORE, far)
    steps = StepSearch(plane, *views, corners, whole(plane))
    assert steps.best([np.eye(3)]) is None
    step = steps.best([np.eye(3), near])
    assert steps.best([np.eye(3)], step) is step
    assert step is not None
    assert step_error(step, BEFORE, far) < 0.3


def test_only_trusted_parts_count(wall: Wall) -> None:
    """The left half moves otherwise than the right half."""
    plane = mapped(wall, BEFORE)
    first, second = wall.view(BEFORE), wall.view(AFTER)
    second[:, :320] = wall.view(camera(505, 357))[:, :320]
    corners = transform(BEFORE, POSTER)
    trust = whole(plane)
    trust[:, : trust.shape[1] // 2 + 2] = 0
    step = StepSearch(plane, grey(first), grey(second), corners, trust).best([np.eye(3)])
    assert step is not None
    assert step_error(step, BEFORE, AFTER) < 0.6


def test_nothing_is_told_where_nothing_is_seen_in_both(wall: Wall) -> None:
    plane = mapped(wall, BEFORE)
    first, corners = wall.view(BEFORE), transform(BEFORE, POSTER)
    other = Wall(seed=500).view(BEFORE)
    assert StepSearch(plane, grey(first), grey(other), corners, whole(plane)).best([np.eye(3)]) is None
    assert StepSearch(plane, grey(first), grey(first), corners, 0 * whole(plane)).best([np.eye(3)]) is None
    assert StepSearch(plane, grey(first), grey(first), corners, whole(plane)).best([]) is None


def test_the_covariance_of_a_step_is_honest(wall: Wall) -> None:
    """But for the least that any step has."""
    plane = mapped(wall, BEFORE)
    trust = whole(plane)
    trust[:, : trust.shape[1] * 5 // 8] = 0  # what lies right of the poster's middle has to do
    reference, quad = wall.view(BEFORE), transform(BEFORE, POSTER)
    refiner = Refiner(Observation(reference), quad)
    erred, told = [], []
    for i in range(12):
        after = camera(498 + 0.7 * i, 362 - 0.6 * i)
        views = (grey(wall.view(pose, noise=10)) for pose in (BEFORE, after))
        step = StepSearch(plane, *views, quad, trust).best([motion(BEFORE, after)])
        assert step is not None
        told.append(refiner.deviation(step.homography, step.covariance - LEAST_COVARIANCE))
        erred.append(step_error(step, BEFORE, after))
    assert 1 / 3 < rms(erred) / rms(told) < 3
