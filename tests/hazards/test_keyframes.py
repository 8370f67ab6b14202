"""Keyframes as a hand gives them, some px beside the truth: nothing gets worse, and what was wrong is mended."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo import Keyframe, Moment, OutputOptions, Surface, replace, track
from ar_demo.media.reader import VideoReader
from ar_demo.tracks import Track
from hdn.imaging.arrays import Array, Image

from ..clips import make_clip
from ..scenes import Scene, error, path

FRAMES, AT = 24, 12
QUAD = Scene().quad
DIAGONAL = np.array([1.0, 1]) / np.sqrt(2)
pytestmark = pytest.mark.usefixtures("shared_networks")


@pytest.fixture(scope="module")
def truth() -> list[Array]:
    return path(QUAD, FRAMES)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, truth: list[Array]) -> Path:
    scene = Scene()
    images = [scene.draw(corners) for corners in truth]
    return make_clip(tmp_path_factory.mktemp("clip") / "a.mp4", images, rate=30)


@pytest.fixture(scope="module")
def ad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("ad") / "ad.png"
    cv2.imwrite(str(file), np.full((60, 80, 3), (0, 0, 255), np.uint8))
    return file


def composite(clip: Path, ad: Path, tracked: Track, folder: Path) -> Image:
    """The frame of the keyframe, in a lossless file: what an encoder makes of two equal pictures differs by itself."""
    options = OutputOptions(backend="opencv", audio="none", codec="ffv1", overwrite=True)
    replace(clip, Surface(ad, track=tracked), folder / "o.mkv", options=options)
    with VideoReader(folder / "o.mkv") as reader:
        return next(reader.frames(AT, AT + 1)).image


def test_a_hand_that_is_some_px_beside_makes_nothing_worse(
    clip: Path, ad: Path, truth: list[Array], tmp_path: Path
) -> None:
    without = track(clip, Surface(quad=QUAD))
    picture = composite(clip, ad, without, tmp_path)
    for off in (0, 2, 3):
        given = Keyframe(Moment(frame=AT), truth[AT] + off * DIAGONAL)
        found = track(clip, Surface(quad=QUAD, keyframes=(given,)))
        for index in range(FRAMES):
            assert error(found.corners[index], truth[index]) < error(without.corners[index], truth[index]) + 0.15
        assert found.deviation[AT] > 0
        assert found.states == ["tracked"] * FRAMES
        shown = composite(clip, ad, found, tmp_path)
        assert np.abs(shown.astype(int) - picture).mean() < 0.05
        inside = cv2.erode(
            cv2.fillConvexPoly(np.zeros(shown.shape[:2], np.uint8), truth[AT].round().astype(int), 1),
            np.ones((7, 7), np.uint8),
        )
        assert (shown[inside > 0][:, 1:] < 60).all()  # red all over: the poster does not show through


def test_a_click_off_by_little_corrects_a_finished_track_by_little(clip: Path, truth: list[Array]) -> None:
    before = track(clip, Surface(quad=QUAD))
    after = track(clip, Surface(track=before, keyframes=(Keyframe(Moment(frame=AT), truth[AT] + 3 * DIAGONAL),)))
    assert max(error(a, t) for a, t in zip(after.corners, truth, strict=True)) < 0.4
    assert after.used.keys() == {AT}


def test_a_stretch_that_is_20_px_wrong_is_mended(clip: Path, truth: list[Array]) -> None:
    """As of a finished track that went astray, and claims to be as sure as ever."""
    wrong = track(clip, Surface(quad=QUAD))
    wrong.corners[8:17, :, 0] += 20
    for off in (0, 2, 3):
        given = Keyframe(Moment(frame=AT), truth[AT] + off * DIAGONAL)
        after = track(clip, Surface(track=wrong, keyframes=(given,)))
        assert max(error(a, t) for a, t in zip(after.corners, truth, strict=True)) < 0.5
