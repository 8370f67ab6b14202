"""What hides a plane, told by the matte network with the plane's picture for its template."""

import pytest

from hdn.imaging.homography import transform
from hdn.imaging.observation import Observation
from hdn.networks.engine import Engine
from hdn.plane.occlusion import Occlusion

from .drawing import HEIGHT, POSTER, WIDTH, Wall, camera, learnt, mapped, motion, panned

PARTS = 16


@pytest.fixture(scope="module")
def wall() -> Wall:
    return Wall()


@pytest.mark.parametrize("framed", [False, True])
def test_a_bar_is_told_from_what_it_hides(engine: Engine, wall: Wall, framed: bool) -> None:
    reference, there = camera(500, 360), camera(508, 352, 0.02)
    occlusion = Occlusion(engine.matte, Observation(wall.view(reference)), transform(reference, POSTER), PARTS, framed)
    frame = wall.view(there)
    homography = motion(reference, there)
    clear = occlusion.seen(Observation(frame), homography)
    left = int(transform(there, POSTER)[:, 0].min())
    frame[:, left : left + 80] = (150, 90, 60)
    hidden = occlusion.seen(Observation(frame), homography)
    assert clear.shape == (PARTS, PARTS)
    assert clear.mean() > 0.9
    assert hidden[:, : PARTS // 2 - 1].mean() < 0.25
    assert hidden[:, PARTS // 2 + 1 :].mean() > 0.9


def test_what_is_outside_of_the_frame_is_not_seen(engine: Engine, wall: Wall) -> None:
    reference = camera(500, 360)
    occlusion = Occlusion(engine.matte, Observation(wall.view(reference)), transform(reference, POSTER), PARTS)
    there = camera(500 + WIDTH / 2, 360)  # the frame's left edge is at the poster's middle
    seen = occlusion.seen(Observation(wall.view(there)), motion(reference, there))
    assert not seen[:, : PARTS // 2 - 1].any()
    assert seen[:, PARTS // 2 + 1 :].mean() > 0.9


def test_what_the_map_grew_by_can_be_seen(engine: Engine, wall: Wall) -> None:
    poses = panned(40)
    plane = mapped(wall, poses[0])
    occlusion = Occlusion(engine.matte, Observation(wall.view(poses[0])), plane.corners, PARTS)
    learnt(plane, wall, poses)
    last, homography = Observation(wall.view(poses[-1])), motion(poses[0], poses[-1])
    before = occlusion.seen(last, homography)
    occlusion.take(plane.texture.picture, plane.texture.known)
    after = occlusion.seen(last, homography)
    grown = (slice(4, -4), slice(-4, -1))  # the last columns
    assert not before[grown].any()
    assert after[grown].mean() > 0.8
    bar = last.image.copy()
    bar[: HEIGHT // 2] = (150, 90, 60)
    hidden = occlusion.seen(Observation(bar), homography)
    assert hidden[grown][:3].mean() < 0.2
    assert hidden[grown][-3:].mean() > 0.8
