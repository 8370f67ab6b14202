"""A track that ends before its video does: the rest of the video is copied, and that is said."""

from pathlib import Path

import numpy as np
import pytest

from ar_demo import Moment, OutputOptions, Surface, TrackingOptions, replace, track
from ar_demo.media.reader import VideoReader
from hdn.imaging.arrays import Image

from ..clips import make_clip, sound_packets, tone
from ..scenes import Scene, path
from ..test_session import Still

FRAMES = 12
OPTIONS = OutputOptions(backend="opencv", crf=8)
QUAD = Scene().quad


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = Scene()
    images = [scene.draw(corners) for corners in path(scene.quad, FRAMES)]
    return make_clip(tmp_path_factory.mktemp("clip") / "a.mp4", images, sound=tone(FRAMES / 25))


def images(file: Path) -> list[Image]:
    with VideoReader(file) as reader:
        return [frame.image for frame in reader.frames()]


def changed(output: Path, clip: Path) -> list[bool]:
    """Of each frame, whether the surface's middle is another than in the source."""
    x, y = QUAD.mean(0).astype(int)
    box = np.s_[y - 15 : y + 15, x - 15 : x + 15]
    return [
        float(np.abs(now[box].astype(int) - was[box]).mean()) > 5
        for now, was in zip(images(output), images(clip), strict=True)
    ]


def test_the_rest_is_copied_and_said(clip: Path, tmp_path: Path) -> None:
    short = track(clip, Surface(quad=QUAD), TrackingOptions(end=Moment(frame=4)), make_tracker=Still)
    result = replace(clip, Surface(effect="mosaic", track=short), tmp_path / "o.mp4", options=OPTIONS)
    assert result.frames == FRAMES
    assert result.warnings == [
        "the track ends with frame 4, and the video with frame 11: what comes after the track is copied as it is"
    ]
    assert changed(tmp_path / "o.mp4", clip) == [True] * 5 + [False] * 7
    assert sound_packets(tmp_path / "o.mp4") == sound_packets(clip)


def test_of_several_each_that_ends_is_named(clip: Path, tmp_path: Path) -> None:
    tracks = [
        track(clip, Surface(quad=QUAD), TrackingOptions(end=end), make_tracker=Still)
        for end in (Moment(frame=4), Moment())
    ]
    surfaces = [Surface(effect="mosaic", track=t) for t in tracks]
    result = replace(clip, surfaces, tmp_path / "o.mp4", options=OPTIONS)
    assert [warning.partition(":")[0] for warning in result.warnings] == ["surface 1"]
    assert changed(tmp_path / "o.mp4", clip) == [True] * FRAMES


def test_an_end_that_is_asked_for_ends_the_output(clip: Path, tmp_path: Path) -> None:
    whole = track(clip, Surface(quad=QUAD), make_tracker=Still)
    end = TrackingOptions(end=Moment(frame=4))
    result = replace(clip, Surface(effect="mosaic", track=whole), tmp_path / "o.mp4", end, OPTIONS)
    assert result.frames == len(images(tmp_path / "o.mp4")) == 5
    assert result.warnings == []
