"""The plane's picture: what is learnt from a clip, and that nothing is where it cannot be."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from hdn import Observation
from hdn.imaging.arrays import Array, Image
from hdn.imaging.homography import from_corners, transform
from hdn.imaging.quads import square
from hdn.plane.picture import MODEL, PictureBuilder, PlanePicture

from ..scenes import Scene, error, path, texture

FRAMES = 18
BAD = 4  # frames at the beginning that show the target badly
SCENE = Scene(seed=3)
TRUTH = path(SCENE.quad, FRAMES)
SHARP = SCENE.draw(SCENE.quad, noise=0)
LETTERS = texture(77, 60, 120)


def blurred(image: Image) -> Image:
    return np.asarray(cv2.blur(image, (15, 1)), np.uint8)


def dimmed(image: Image) -> Image:
    return np.asarray(image // 8, np.uint8)


def as_it_is(image: Image) -> Image:
    return image


def hidden(image: Image) -> Image:
    """Something with texture of its own before the right third of the target, where it is in the first frames."""
    out = image.copy()
    out[50:170, 180:240] = LETTERS
    return out


FIRST_VIEWS = {"blurred": blurred, "dimmed": dimmed, "hidden": hidden}


def frames_of(spoil: Callable[[Image], Image]) -> list[Image]:
    return [spoil(image) if i < BAD else image for i, image in enumerate(map(SCENE.draw, TRUTH))]


def learnt(images: list[Image], poses: list[Array], deviation: float = 0.5) -> PlanePicture:
    """What is learnt from images in which the target was found at these poses."""
    builder = PictureBuilder(0, Observation(images[0]), SCENE.quad, 130.0)
    for index, (image, corners) in enumerate(zip(images[1:], poses[1:], strict=True), 1):
        builder.offer(index, Observation(image), corners, deviation)
    return builder.build()


def difference(picture: PlanePicture, image: Image, left: float = 0.0, right: float = 1.0) -> float:
    """Of a picture from an image of the scene's reference frame, a part of the target's width: mean, grey levels."""
    to_picture = np.asarray(np.linalg.inv(picture.to_reference))
    wanted = cv2.warpPerspective(image, to_picture, picture.count.shape[::-1], flags=cv2.INTER_LINEAR)
    part = transform(
        from_corners(square(1) + 0.5, SCENE.quad), np.array([[left, 0], [right, 0], [right, 1], [left, 1]])
    )
    inside = np.zeros(picture.count.shape, np.uint8)
    cv2.fillConvexPoly(inside, np.round(transform(to_picture, part)).astype(np.int32), 1)
    shown = cv2.erode(inside, np.ones((9, 9), np.uint8)) > 0
    return float(np.abs(picture.image[shown] - wanted[shown].astype(float)).mean())


@pytest.mark.parametrize("first", FIRST_VIEWS)
def test_a_picture_is_better_than_the_first_view_and_lies_where_that_does(first: str) -> None:
    """Though every view was tracked 1.5 px off, the whole is aligned with the first view."""
    rng = np.random.default_rng(0)
    found = learnt(frames_of(FIRST_VIEWS[first]), [c + rng.normal(0, 1.5, (4, 2)) for c in TRUTH])
    assert found.is_better
    assert found.index >= BAD
    assert error(found.corners, TRUTH[found.index]) < 1.0
    np.testing.assert_allclose(transform(found.to_reference, found.quad), SCENE.quad, atol=1e-6)
    assert difference(found, SHARP) < 0.5 * difference(found, FIRST_VIEWS[first](SHARP))


def test_what_hides_most_of_the_target_in_every_view_is_not_in_the_picture() -> None:
    """A patterned bar over half of the target slides across, so that parts are hidden more often than seen."""
    bar = texture(5, 60, 130)
    images = []
    for i, corners in enumerate(TRUTH):
        image = SCENE.draw(corners)
        if i > 0:
            left = 70 + round(120 * i / FRAMES)
            image[50:180, left : left + 60] = bar
        images.append(image)
    found = learnt(images, TRUTH)
    assert found.views == FRAMES
    assert difference(found, SHARP) < 6
    assert found.count.max() > 5


def test_what_does_not_move_with_the_target_is_told() -> None:
    found = learnt(frames_of(as_it_is), TRUTH)
    inner = np.s_[8:16, 8:16]
    around = found.agreement.copy()
    around[7:17, 7:17] = 1  # the wall comes by behind the poster
    assert found.agreement[inner].min() > 0.8
    assert (around < MODEL.min_on_plane).mean() > 0.2
    mask = found.on_plane > 0
    assert mask.mean() < 0.5
    assert found.drawn[mask].mean() > 1.5 * found.drawn[~mask].mean()
    assert (found.image[found.count == 0] > 0).any()  # carried on, for what looks at it


def test_nothing_is_gained_from_views_no_better_than_the_first() -> None:
    assert not learnt(frames_of(as_it_is), TRUTH).is_better
    few = 8  # in which it does not come much closer
    assert not learnt([blurred(image) for image in frames_of(as_it_is)][:few], TRUTH[:few]).is_better


def test_frames_that_are_not_sure_are_not_used() -> None:
    found = learnt(frames_of(blurred), TRUTH, deviation=10.0)
    assert found.views == 1
    assert not found.is_better
    assert difference(found, blurred(SHARP)) < 5


def test_nothing_is_learnt_from_something_else_than_the_target() -> None:
    """The tracker has drifted to another place of the wall, which is as sharp as can be."""
    elsewhere = [c + np.array([60.0, 0]) if i >= BAD else c for i, c in enumerate(TRUTH)]
    assert learnt(frames_of(blurred), elsewhere).views == 1
    other = Scene(seed=8)
    images = [other.draw(c) if i >= BAD else blurred(SCENE.draw(c)) for i, c in enumerate(TRUTH)]
    assert not learnt(images, TRUTH).is_better


def test_nothing_is_learnt_about_pieces_that_change() -> None:
    """As on a screen: in the changing third the first view stays, and the pieces about it are learnt."""
    images = frames_of(blurred)
    third = transform(from_corners(square(1) + 0.5, SCENE.quad), np.array([[0.0, 0], [0.35, 0], [0.35, 1], [0, 1]]))
    for i in range(BAD, FRAMES):
        shown = texture(200 + i, 320, 240)
        mask = np.zeros((240, 320), np.uint8)
        there = transform(from_corners(SCENE.quad, TRUTH[i]), third)
        cv2.fillConvexPoly(mask, np.round(there).astype(np.int32), 1)
        images[i] = np.where(mask[..., None] > 0, shown, images[i])
    found = learnt(images, TRUTH)
    assert found.is_better
    assert difference(found, images[0], 0.0, 0.25) < 0.5 * difference(found, shown, 0.0, 0.25)
    assert difference(found, SHARP, 0.5, 1.0) < 0.5 * difference(found, blurred(SHARP), 0.5, 1.0)


def test_memory_is_bounded_and_the_sharpest_views_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    builder = PictureBuilder(0, Observation(frames_of(blurred)[0]), SCENE.quad, 130.0)
    shown = [(frames_of(as_it_is)[i], TRUTH[i]) for i in (5, 6, 7)]
    poor = (blurred(shown[0][0]), TRUTH[5])
    for index in range(MODEL.max_views + 8):
        image, corners = shown[index % 3] if index % 2 else poor
        builder.offer(index + 1, Observation(image), corners, 0.5)
    assert len(builder._views) == MODEL.max_views + 1
    assert builder._views[0].index == 0
    assert sum(view.index % 2 for view in builder._views) < (MODEL.max_views + 1) / 2
