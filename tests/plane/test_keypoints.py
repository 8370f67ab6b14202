"""Keypoints of a plane, matched to frames that show little of it."""

import cv2
import numpy as np
import pytest

from hdn.alignment.refinement import Refiner
from hdn.imaging.arrays import Array
from hdn.imaging.homography import transform, translation
from hdn.imaging.observation import Observation, find_keypoints
from hdn.plane.keypoints import SHARED_COVARIANCE, PlaneKeypoints

from .drawing import POSTER, Wall, camera, cover, learnt, mapped, motion, panned, pose_error, rms, shaken

REFERENCE = camera(500, 360)
THERE = camera(478, 351, 0.1, 1e-4)


@pytest.fixture(scope="module")
def wall() -> Wall:
    return Wall()


@pytest.fixture(scope="module")
def refiner(wall: Wall) -> Refiner:
    return Refiner(Observation(wall.view(REFERENCE)), transform(REFERENCE, POSTER))


def keypoints(wall: Wall, reference: Array = REFERENCE) -> PlaneKeypoints:
    frame = Observation(wall.view(reference))
    return PlaneKeypoints(frame, transform(reference, POSTER), mapped(wall, reference))


def test_they_place_a_target_anywhere_in_a_frame(wall: Wall, refiner: Refiner) -> None:
    found = keypoints(wall).find(Observation(wall.view(THERE)), refiner)
    assert found is not None
    assert found.matches > 40
    assert pose_error(found.homography, REFERENCE, THERE) < 1


def test_about_an_expected_pose_only_what_is_near_counts(wall: Wall, refiner: Refiner) -> None:
    frame, points, there = Observation(wall.view(THERE)), keypoints(wall), motion(REFERENCE, THERE)
    near = points.find(frame, refiner, (translation(6, -4) @ there, 20.0))
    assert near is not None
    assert pose_error(near.homography, REFERENCE, THERE) < 1
    assert points.find(frame, refiner, (translation(60, 0) @ there, 20.0)) is None


def test_a_hidden_target_is_placed_by_what_surrounds_it(wall: Wall, refiner: Refiner) -> None:
    poses = shaken(12)
    plane = mapped(wall, poses[0])
    points = PlaneKeypoints(Observation(wall.view(poses[0])), transform(poses[0], POSTER), plane)
    learnt(plane, wall, poses)
    hidden = Observation(cover(wall.view(THERE), THERE))
    found = points.find(hidden, refiner)
    assert found is not None
    assert pose_error(found.homography, poses[0], THERE) < 2
    plane.coplanar[:] = 0  # as where the surroundings proved to move otherwise
    assert points.find(hidden, refiner) is None


def test_what_the_reference_frame_shows_twice_is_not_distinct(wall: Wall, refiner: Refiner) -> None:
    alone, quad = wall.view(REFERENCE), transform(REFERENCE, POSTER)
    (left, top), (right, bottom) = quad.min(0).astype(int), quad.max(0).astype(int) + 1
    twice = alone.copy()
    twice[top:bottom, 20 : 20 + right - left] = alone[top:bottom, left:right]
    frame = Observation(wall.view(THERE))
    found = [
        PlaneKeypoints(Observation(reference), quad, mapped(wall, REFERENCE)).find(frame, refiner)
        for reference in (alone, twice)
    ]
    assert found[0] is not None
    assert found[1] is not None
    assert found[0].distinct > 0.9 * found[0].matches
    assert found[0].distinct - found[1].distinct > 30


def test_they_grow_with_the_map(wall: Wall, refiner: Refiner) -> None:
    poses = panned(40)
    plane = mapped(wall, poses[0])
    points = PlaneKeypoints(Observation(wall.view(poses[0])), transform(poses[0], POSTER), plane)
    learnt(plane, wall, poses)
    last = wall.view(poses[-1])
    last[:, :90] = 120  # all that the first frame showed
    assert points.find(Observation(last), refiner) is None
    points.take()
    found = points.find(Observation(last), refiner)
    assert found is not None
    assert pose_error(found.homography, poses[0], poses[-1]) < 12


def test_the_covariance_of_their_pose_is_honest(wall: Wall, refiner: Refiner) -> None:
    """But for what errors have in common; with a quarter of the poster in view."""
    points, erred, told = keypoints(wall), [], []
    for i in range(12):
        there = camera(488 + 1.7 * i, 362 - 1.3 * i, 0.01 * i)
        frame = wall.view(there, noise=6)
        middle = int(transform(there, POSTER)[:, 0].mean())
        frame[:, middle:] = 120
        found = points.find(Observation(frame), refiner)
        if found is not None:
            told.append(refiner.deviation(found.homography, found.covariance - SHARED_COVARIANCE))
            erred.append(pose_error(found.homography, REFERENCE, there))
    assert len(told) > 8
    assert 1 / 3 < rms(erred) / rms(told) < 3


def test_two_estimates_of_a_pose_are_weighed_by_their_covariances(wall: Wall, refiner: Refiner) -> None:
    sure, vague = 0.1 * np.eye(8), 0.9 * np.eye(8)
    pose, covariance, distance = refiner.combined(np.eye(3), vague, translation(3, 0), sure)
    np.testing.assert_allclose(transform(pose, np.zeros((1, 2))), [[2.7, 0]], atol=0.05)
    np.testing.assert_allclose(covariance, 0.09 * np.eye(8), atol=1e-9)
    assert distance == pytest.approx(9, rel=0.1)


def test_keypoints_in_a_box_are_those_of_the_frame_in_it(wall: Wall) -> None:
    frame = Observation(wall.view(REFERENCE)).grey
    box = np.array([[100.0, 60], [400, 60], [400, 300], [100, 300]])
    points, descriptors = find_keypoints(frame, 500, within=box)
    everywhere, _ = find_keypoints(frame, 5000)
    assert len(points) == len(descriptors) > 50
    assert ((points >= box[0] - 1) & (points <= box[2] + 1)).all()
    nearest = np.linalg.norm(points[:, None] - everywhere, axis=2).min(1)
    assert np.median(nearest) < 0.1
    outside, _ = find_keypoints(frame, 500, within=box + 5000)
    assert len(outside) == 0


def test_reduced_keypoints_stay_where_they_are(wall: Wall) -> None:
    image = cv2.resize(wall.view(REFERENCE), None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    frame = Observation(np.asarray(image, np.uint8)).grey
    box = np.array([[200.0, 120], [800, 120], [800, 600], [200, 600]])
    full, _ = find_keypoints(frame, 3000, within=box)
    reduced, _ = find_keypoints(frame, 3000, within=box, longest=320)
    nearest = np.linalg.norm(reduced[:, None] - full, axis=2).min(1)
    assert len(reduced) < len(full)
    assert np.median(nearest) < 1
