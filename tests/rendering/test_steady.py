"""The steady view: the surface stands still in it."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo import OutputOptions, Session
from ar_demo.errors import InputError
from ar_demo.media.reader import VideoReader
from ar_demo.rendering.steady import MODEL, SteadyView
from ar_demo.tracks import Source, Track
from hdn.imaging.arrays import Array

from ..clips import make_clip
from ..scenes import Scene, path

FRAMES = 10


def track_of(corners: list[Array], width: int = 320, height: int = 240) -> Track:
    """A track of known corners, which begins with the quad."""
    n = len(corners)
    times = [Fraction(i, 25) for i in range(n)]
    source = Source("street.mp4", width, height, Fraction(25), n)
    return Track(source, 0, corners[0], times, np.array(corners), ["tracked"] * n, np.ones(n), np.zeros(n))


def test_the_surface_stands_still_and_shows_its_surroundings() -> None:
    scene = Scene()
    truth = path(scene.quad, FRAMES)
    view = SteadyView(track_of(truth))
    first, last = (view.of(scene.draw(truth[i], 0), i).astype(int) for i in (0, FRAMES - 1))
    low, high = scene.quad.min(0), scene.quad.max(0)
    size = high - low
    assert (view.width, view.height) == tuple(2 * size)
    inner = tuple(slice(int(s / 2 + 8), int(1.5 * s - 8)) for s in size[::-1])
    assert np.abs(first[inner] - last[inner]).mean() < 8
    moving = np.abs(scene.draw(truth[0], 0).astype(int) - scene.draw(truth[-1], 0))
    assert moving[80:150, 115:205].mean() > 20
    # In the reference frame it is that frame about the quad, as far as that goes.
    left, top = (low - size / 2).astype(int)
    whole = scene.draw(truth[0], 0)[top : top + view.height, left : left + view.width]
    np.testing.assert_array_equal(first, whole)


def test_a_large_view_is_made_smaller_and_has_an_even_size() -> None:
    quad = np.array([[0.0, 0], [1901, 0], [1901, 1001], [0, 1001]])
    view = SteadyView(track_of([quad], 1920, 1080))
    assert view.width == MODEL.max_width_px
    assert view.height == 674
    picture = view.of(np.full((1080, 1920, 3), 200, np.uint8), 0)
    assert picture.shape == (674, 1280, 3)
    assert picture[337, 640].tolist() == [200] * 3
    assert not picture[:100].any()  # beyond the frame


def test_frames_without_a_pose_are_black() -> None:
    scene = Scene()
    track = track_of([scene.quad, np.full((4, 2), np.nan)])
    assert not SteadyView(track).of(scene.draw(scene.quad), 1).any()


def test_it_is_written_as_a_video(tmp_path: Path) -> None:
    scene = Scene()
    truth = path(scene.quad, FRAMES)
    clip = make_clip(tmp_path / "street.mp4", [scene.draw(corners) for corners in truth], rate=25)
    track, out = track_of(truth), tmp_path / "steady.mp4"
    with Session(clip) as session:
        session.steady(track, out)
        with pytest.raises(InputError, match="--overwrite"):
            session.steady(track, out)
        session.steady(track, out, OutputOptions(overwrite=True))
    with VideoReader(out) as reader, VideoReader(clip) as original:
        times = [frame.time for frame in original.frames()]
        view = SteadyView(track)
        images = []
        for frame in reader.frames():
            assert frame.time == times[frame.index]
            images.append(frame.image.astype(int))
    assert len(images) == FRAMES
    assert images[0].shape == (view.height, view.width, 3)
    middle = np.s_[view.height // 2 - 30 : view.height // 2 + 30, view.width // 2 - 40 : view.width // 2 + 40]
    assert np.abs(images[0][middle] - images[-1][middle]).mean() < 8
