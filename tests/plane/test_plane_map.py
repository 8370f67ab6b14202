"""The plane map: what it learns of a target's surroundings, how it grows, and the pose that they tell."""

import numpy as np
import pytest

from hdn.alignment.refinement import START_COVARIANCE, Refiner
from hdn.imaging.arrays import Array, Mask
from hdn.imaging.homography import transform, translation
from hdn.imaging.observation import Observation
from hdn.imaging.regions import Region
from hdn.plane.plane_map import BENT_COVARIANCE, MODEL, PlaneMap

from ..scenes import Scene, moved, texture
from .drawing import (
    POSTER,
    STANDARD_SIDE,
    Wall,
    camera,
    cover,
    learnt,
    mapped,
    motion,
    panned,
    pose_error,
    rms,
    shaken,
    truth,
)


@pytest.fixture(scope="module")
def wall() -> Wall:
    return Wall()


def around(plane: PlaneMap) -> Mask:
    """The map's pixels (h, w) outside the target."""
    mask = np.ones(plane.texture.known.shape, bool)
    m, n = plane.margin, plane.level.cells
    height, width = mask.shape
    mask[m * height // n : (n - m) * height // n, m * width // n : (n - m) * width // n] = False
    return mask


def everywhere(plane: PlaneMap) -> Array:
    return np.ones((plane.level.cells,) * 2, np.float32)


def test_a_wall_on_the_plane_proves_to_be(wall: Wall) -> None:
    poses = shaken(12)
    plane = mapped(wall, poses[0])
    learnt(plane, wall, poses)
    often = plane.seen > 8
    assert often.sum() > 100
    assert np.median(plane.coplanar[often]) > 0.95
    assert plane.agreed[often].sum() > 0.85 * plane.seen[often].sum()


def test_a_background_that_moves_otherwise_does_not() -> None:
    scene = Scene()
    scene.wall = texture(7, scene.width, scene.height)
    plane = PlaneMap(Observation(scene.draw(scene.quad)), scene.quad, 120)
    for i in range(1, 12):
        shift = (10 * np.sin(i), 8 * np.cos(i))
        frame = Observation(scene.draw(moved(scene.quad, shift)))
        shown = plane.look(frame, translation(*shift), learn=True)
    often = plane.seen > 8
    assert often.sum() > 50
    assert np.median(plane.coplanar[often]) < 0.05
    assert np.quantile(plane.coplanar[often], 0.75) < MODEL.trusted  # smooth cells seem to move with it
    trust = plane.trust(shown, np.zeros((8, 8), np.float32))
    assert (trust > 0).mean() < 0.05


def test_without_learning_nothing_changes(wall: Wall) -> None:
    poses = panned(12)
    plane = mapped(wall, poses[0])
    before, known = plane.coplanar.copy(), plane.texture.known.copy()
    for pose in poses[1:]:
        plane.look(Observation(wall.view(pose)), motion(poses[0], pose), learn=False)
    np.testing.assert_array_equal(plane.coplanar, before)
    np.testing.assert_array_equal(plane.texture.known, known)
    assert not plane.seen.any()


def test_a_target_that_is_wholly_hidden_is_placed_by_its_wall(wall: Wall) -> None:
    poses = shaken(10)
    plane = mapped(wall, poses[0])
    learnt(plane, wall, poses)
    there = camera(520, 350, 0.03, 1e-4)
    frame = Observation(cover(wall.view(there), there))
    start = translation(4, -3) @ motion(poses[0], there)
    found = plane.align(frame.grey, start, START_COVARIANCE, everywhere(plane), np.zeros((2, 2)))
    assert found is not None
    assert found.agreement > 0.7
    assert pose_error(start, poses[0], there) > 4
    assert pose_error(found.homography, poses[0], there) < 0.5


def test_the_covariance_of_a_pose_is_honest(wall: Wall) -> None:
    """But for what is added since real planes are a little bent."""
    reference = camera(500, 360)
    plane = mapped(wall, reference)
    refiner = Refiner(Observation(wall.view(reference)), transform(reference, POSTER))
    assert refiner.standard_side == plane.standard_side
    told, erred = [], []
    for i in range(16):
        there = camera(500 + 1.3 * i, 360 - 0.9 * i)
        frame = Observation(wall.view(there, noise=12))
        start = motion(reference, there)
        found = plane.align(frame.grey, start, START_COVARIANCE, everywhere(plane), np.zeros((2, 2)))
        assert found is not None
        told.append(refiner.deviation(found.homography, found.covariance - BENT_COVARIANCE))
        erred.append(pose_error(found.homography, reference, there))
    assert 1 / 3 < rms(erred) / rms(told) < 3


def test_nothing_is_told_where_nothing_of_the_plane_is_seen(wall: Wall) -> None:
    reference = camera(500, 360)
    plane = mapped(wall, reference)
    frame = Observation(wall.view(reference))
    hidden = np.zeros_like(everywhere(plane))
    blank = Observation(np.full_like(frame.image, 120))
    noise = Observation(np.random.default_rng(0).integers(0, 255, frame.image.shape, dtype=np.uint8))
    for seen, shown in ((hidden, frame), (everywhere(plane), blank), (everywhere(plane), noise)):
        assert plane.align(shown.grey, np.eye(3), START_COVARIANCE, seen, np.zeros((2, 2))) is None
    found = plane.align(frame.grey, np.eye(3), START_COVARIANCE, everywhere(plane), np.zeros((2, 2)))
    assert found is not None


def test_it_looks_where_the_region_lets_it(wall: Wall) -> None:
    pose = camera(500, 360)
    frame, quad = Observation(wall.view(pose)), transform(pose, POSTER)
    left, top = quad.min(0)
    right = quad[:, 0].max()
    above = np.array([[left - 60, top - 60], [right + 60, top - 60], [right + 60, top], [left - 60, top]])
    only = PlaneMap(frame, quad, STANDARD_SIDE, Region(include=above))
    without = PlaneMap(frame, quad, STANDARD_SIDE, Region(exclude=(above,)))
    freely = PlaneMap(frame, quad, STANDARD_SIDE)
    for plane, is_in in ((only, True), (without, False)):
        n = plane.level.cells
        trust = plane.trust(np.ones((n, n), bool), np.zeros((8, 8), np.float32))
        y, x = (np.mgrid[:n, :n] + 0.5) / n
        at = np.stack([x * plane.level.width, y * plane.level.height], -1) - 0.5
        at = transform(plane.level.to_template, at)
        inside = ((at > above.min(0)) & (at < above.max(0))).all(-1)
        assert (trust > 0).sum() > 10
        assert not trust[inside != is_in].any()
    n = freely.level.cells
    assert (freely.trust(np.ones((n, n), bool), np.zeros((8, 8), np.float32)) > 0).sum() > 100


def test_it_grows_by_what_the_first_frame_does_not_show(wall: Wall) -> None:
    poses = panned(40)
    plane = mapped(wall, poses[0])
    at_first = plane.texture.known.copy()
    for i, pose in enumerate(poses[1:]):
        frame = Observation(wall.view(pose, gain=1 - 0.006 * i))  # it gets darker
        plane.look(frame, motion(poses[0], pose), learn=True)
    known = plane.texture.known
    grown = known & ~at_first
    assert at_first.mean() < 0.8
    assert known.mean() > 0.97
    difference = np.abs(plane.texture.picture.astype(int) - truth(plane, wall, poses[0])).mean(-1)
    assert np.median(difference[grown]) < 6
    assert np.median(difference[grown]) < 2 * np.median(difference[at_first])
    n = plane.level.cells
    right = plane.coplanar[:, n - 4 :][plane.seen[:, n - 4 :] > 3]
    assert len(right) > 10
    assert np.median(right) > MODEL.trusted


def test_what_it_grew_places_the_target_once_the_rest_is_gone(wall: Wall) -> None:
    poses = panned(40)
    plane, stunted = mapped(wall, poses[0]), mapped(wall, poses[0])
    learnt(plane, wall, poses)
    for pose in poses[1:]:  # blurred frames: it learns, and takes no texture
        stunted.look(Observation(wall.view(pose)), motion(poses[0], pose), learn=True, blur=np.eye(2) * 9)
    assert stunted.texture.takes == 0
    there = poses[-1]
    image = wall.view(there)
    image[:, : int(transform(there, POSTER)[:, 0].max()) + 8] = (120, 125, 118)  # with all that was seen at first
    frame = Observation(image)
    start = translation(3, 2) @ motion(poses[0], there)
    none, seen = np.zeros((2, 2)), everywhere(plane)
    found = plane.align(frame.grey, start, START_COVARIANCE, seen, none)
    assert found is not None
    assert pose_error(found.homography, poses[0], there) < 1
    assert stunted.align(frame.grey, start, START_COVARIANCE, seen, none) is None


def test_it_does_not_grow_where_the_region_forbids_it(wall: Wall) -> None:
    poses = panned(30)
    quad = transform(poses[0], POSTER)
    right = quad[:, 0].max() + 20
    excluded = np.array([[right, -500], [right + 900, -500], [right + 900, 900], [right, 900]])
    plane = PlaneMap(Observation(wall.view(poses[0])), quad, STANDARD_SIDE, Region(exclude=(excluded,)))
    at_first = plane.texture.known.copy()
    learnt(plane, wall, poses)
    x, y = np.meshgrid(np.arange(plane.level.width), np.arange(plane.level.height))
    at = transform(plane.level.to_template, np.stack([x, y], -1).astype(float))
    assert not plane.texture.known[at[..., 0] > right + 2].any()
    assert (plane.texture.known & ~at_first).any()


def test_what_was_in_front_at_first_gives_way_to_the_plane(wall: Wall) -> None:
    poses = shaken(30)
    first = wall.view(poses[0])
    first[40:130, 60:150] = wall.picture[600:690, 1000:1090]
    plane = PlaneMap(Observation(first), transform(poses[0], POSTER), STANDARD_SIDE)
    expected = truth(plane, wall, poses[0]).astype(int)
    wrong = (np.abs(plane.texture.picture - expected).mean(-1) > 25) & plane.texture.known
    assert wrong.sum() > 200
    learnt(plane, wall, poses)
    assert np.median(np.abs(plane.texture.picture - expected).mean(-1)[wrong]) < 10


def test_what_passes_in_front_of_what_agreed_is_not_taken(wall: Wall) -> None:
    poses = shaken(40)
    plane = mapped(wall, poses[0])
    learnt(plane, wall, poses[:21])
    before, takes_around = plane.texture.picture.copy(), plane.texture.known.copy()
    for pose in poses[21:]:
        frame = wall.view(pose)
        frame[40:130, 60:150] = wall.picture[600:690, 1000:1090]
        plane.look(Observation(frame), motion(poses[0], pose), learn=True)
    hidden = plane.seen[: plane.margin] > 30
    assert hidden.any()
    np.testing.assert_array_equal(plane.texture.picture[takes_around], before[takes_around])


def test_its_picture_is_dim_where_nothing_is_proved(wall: Wall) -> None:
    poses = shaken(12)
    plane = mapped(wall, poses[0])
    unsure = plane.picture[around(plane)].mean()
    learnt(plane, wall, poses)
    assert plane.picture.shape == (plane.level.height, plane.level.width, 3)
    assert plane.picture[around(plane)].mean() > 1.3 * unsure
