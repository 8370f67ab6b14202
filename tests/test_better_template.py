"""The second pass: what is learnt from views that are better than the first, and that nothing is where it cannot be."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo.options import TrackingOptions
from ar_demo.pipeline import track
from ar_demo.progress import Progress
from ar_demo.surface import Surface
from ar_demo.tracking.passes import Passes
from ar_demo.tracks import Track
from hdn import Observation, Tracker
from hdn.better_template import MODEL, BetterTemplate, TemplateBuilder
from hdn.evidence import Evidence
from hdn.imaging.arrays import Array
from hdn.imaging.homography import from_corners, transform
from hdn.imaging.quads import area, square
from hdn.networks.engine import Engine
from hdn.state import State
from hdn.tracker import Estimate

from .clips import Image, make_clip
from .scenes import Scene, error, path

FRAMES = 18
BAD = 4  # frames at the beginning that show the target badly


def blurred(image: Image) -> Image:
    return np.asarray(cv2.blur(image, (15, 1)), np.uint8)


def dimmed(image: Image) -> Image:
    return np.asarray(image // 8, np.uint8)


def as_it_is(image: Image) -> Image:
    return image


def hidden(image: Image) -> Image:
    """Something grey before the right half of the target, where it is in the first frames."""
    out = image.copy()
    out[50:190, 165:250] = 120
    return out


SCENE = Scene(seed=3)
TRUTH = path(SCENE.quad, FRAMES)
WIDEST = max(np.sqrt(area(corners)) for corners in TRUTH)
FIRST_VIEWS = {"blurred": blurred, "dimmed": dimmed, "hidden": hidden}


def frames_of(spoil: object) -> list[Image]:
    assert callable(spoil)
    return [spoil(image) if i < BAD else image for i, image in enumerate(map(SCENE.draw, TRUTH))]


def estimate(corners: Array, state: State = "tracked", deviation: float = 0.5) -> Estimate:
    pose = from_corners(SCENE.quad, corners)
    return Estimate(pose, corners, state, 0.9, deviation, np.ones((8, 8), np.float32), Evidence())


def learnt(images: list[Image], poses: list[Array], **what: object) -> BetterTemplate | None:
    """What is learnt from images in which the target was found at these poses."""
    builder = TemplateBuilder(Observation(images[0]), SCENE.quad)
    for index, (image, corners) in enumerate(zip(images, poses, strict=True)):
        builder.offer(index, Observation(image), estimate(corners, **what))  # type: ignore[arg-type]
    return builder.build()


@pytest.mark.parametrize("first", FIRST_VIEWS)
def test_a_template_is_learnt_and_lies_where_the_first_view_does(first: str) -> None:
    """Though every view was tracked 1.5 px off, the whole is aligned with the first view."""
    rng = np.random.default_rng(0)
    found = learnt(frames_of(FIRST_VIEWS[first]), [c + rng.normal(0, 1.5, (4, 2)) for c in TRUTH])
    assert found is not None
    assert found.index >= BAD
    assert error(found.corners, TRUTH[found.index]) < 1.0
    # It shows the target as the best frame does.
    sharp = SCENE.draw(SCENE.quad, noise=0)
    target = from_corners(SCENE.quad, found.quad)
    size = found.image.shape[1::-1]
    inside = np.zeros(size[::-1], np.uint8)
    cv2.fillConvexPoly(inside, np.round(found.quad).astype(np.int32), 1)
    shown = cv2.erode(inside, np.ones((25, 25), np.uint8)) > 0
    wanted = cv2.warpPerspective(sharp, target, size, flags=cv2.INTER_LINEAR)[shown].astype(float)
    spoilt = cv2.warpPerspective(FIRST_VIEWS[first](sharp), target, size, flags=cv2.INTER_LINEAR)[shown].astype(float)
    assert np.abs(found.image[shown] - wanted).mean() < 0.6 * np.abs(spoilt - wanted).mean()


def test_nothing_is_learnt_from_views_no_better_than_the_first() -> None:
    assert learnt(frames_of(as_it_is), TRUTH) is None
    assert learnt([blurred(image) for image in frames_of(as_it_is)], TRUTH) is None


@pytest.mark.parametrize("what", [{"state": "held"}, {"deviation": 1.01 * MODEL.max_deviation * WIDEST}])
def test_nothing_is_learnt_from_frames_that_are_not_sure(what: dict[str, object]) -> None:
    assert learnt(frames_of(blurred), TRUTH, **what) is None


def test_nothing_is_learnt_from_something_else_than_the_target() -> None:
    """The tracker has drifted to another place of the wall, which is as sharp as can be."""
    elsewhere = [c + np.array([60.0, 0]) if i >= BAD else c for i, c in enumerate(TRUTH)]
    assert learnt(frames_of(blurred), elsewhere) is None
    other = Scene(seed=8)
    images = [other.draw(c) if i >= BAD else blurred(SCENE.draw(c)) for i, c in enumerate(TRUTH)]
    assert learnt(images, TRUTH) is None


def test_nothing_is_learnt_about_pieces_that_change() -> None:
    """As on a screen: in the changing half the first view stays, and the pieces about it are learnt."""
    images = frames_of(blurred)
    rng = np.random.default_rng(1)
    for image, corners in zip(images[BAD:], TRUTH[BAD:], strict=True):
        half = transform(from_corners(SCENE.quad, corners), (SCENE.quad[[0, 1, 1, 0]] + SCENE.quad[[0, 1, 2, 3]]) / 2)
        cv2.fillConvexPoly(image, np.round(half).astype(np.int32), tuple(float(v) for v in rng.uniform(0, 255, 3)))
    found = learnt(images, TRUTH)
    assert found is not None
    sharp = SCENE.draw(SCENE.quad, noise=0)
    expected = {0.25: images[0], 0.75: sharp}  # how far down: what shows there
    for down, wanted in expected.items():
        place = transform(from_corners(square(1) + 0.5, SCENE.quad), np.array([0.5, down]))
        here, there = from_corners(SCENE.quad, found.quad), transform(from_corners(SCENE.quad, found.quad), place)
        shown = cv2.warpPerspective(wanted, here, found.image.shape[1::-1])
        x, y = np.round(there).astype(int)
        piece = np.s_[y - 20 : y + 20, x - 60 : x + 60]
        assert np.abs(found.image[piece].astype(float) - shown[piece]).mean() < 8


def both(clip: Path, monkeypatch: pytest.MonkeyPatch, engine: Engine) -> tuple[Track, Track, list[str]]:
    """The clip's track without and with the second pass, and the stages of the latter."""
    events: list[Progress] = []

    def measured(listen: Callable[[Progress], None]) -> Track:
        options = TrackingOptions(smooth=0)
        return track(clip, Surface(quad=TRUTH[0]), options, listen, lambda: Tracker(engine=engine))

    second = measured(events.append)
    monkeypatch.setattr(Passes, "_again", lambda *_: None)
    return measured(lambda _: None), second, [event.stage for event in events]


def test_the_second_pass_mends_a_blurred_beginning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, engine: Engine
) -> None:
    clip = make_clip(tmp_path / "a.mp4", frames_of(blurred), rate=30, options={"crf": "16"})
    once, twice, stages = both(clip, monkeypatch, engine)
    errors = [np.array([error(c, t) for c, t in zip(track.corners, TRUTH, strict=True)]) for track in (once, twice)]
    assert "again: track" in stages
    assert twice.counts["tracked"] == FRAMES
    assert np.median(errors[1][BAD:]) < 0.6 * np.median(errors[0][BAD:])
    np.testing.assert_array_equal(twice.corners[0], TRUTH[0])
    assert twice.deviation[1:].min() > 0  # where the second pass began counts as measured, not as given


def test_a_good_first_view_costs_no_second_pass(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, engine: Engine
) -> None:
    clip = make_clip(tmp_path / "a.mp4", frames_of(as_it_is), rate=30, options={"crf": "16"})
    once, twice, stages = both(clip, monkeypatch, engine)
    assert set(stages) == {"track"}
    assert once.states == twice.states
    np.testing.assert_allclose(twice.corners, once.corners, atol=1e-3)
