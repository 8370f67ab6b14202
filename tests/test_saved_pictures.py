"""What `track` writes beside the track: a picture of the plane's map, and the steady view."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo import OutputOptions, Surface, track
from ar_demo.errors import InputError
from ar_demo.media.reader import VideoReader
from hdn import Observation
from hdn.tracker import Estimate

from .clips import make_clip
from .scenes import Scene, path
from .test_session import Still

FRAMES = 5


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = Scene()
    images = [scene.draw(corners) for corners in path(scene.quad, FRAMES)]
    return make_clip(tmp_path_factory.mktemp("clip") / "a.mp4", images, rate=25)


@pytest.fixture
def surface() -> Surface:
    return Surface(effect="blur", quad=Scene().quad)


def test_the_map_is_saved_as_a_picture(clip: Path, surface: Surface, tmp_path: Path) -> None:
    out = tmp_path / "map.png"
    done = track(clip, surface, save_map=out)
    picture = cv2.imread(str(out))
    assert picture is not None
    assert picture.std() > 10  # it shows something
    assert list(tmp_path.iterdir()) == [out]
    # A track that is complete has one as well, the same.
    track(clip, Surface(effect="blur", track=done), save_map=tmp_path / "again.png")
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "again.png")), picture)


def test_a_map_of_the_reference_frame_alone_is_told(
    clip: Path, surface: Surface, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    class Unsure(Still):
        def track(self, frame: Observation) -> Estimate:
            return replace(super().track(frame), deviation=30.0)

    track(clip, surface, make_tracker=Unsure, save_map=tmp_path / "map.png")
    assert "that of the reference frame alone" in caplog.text
    assert (tmp_path / "map.png").exists()


def test_the_steady_view_is_saved_as_a_video(clip: Path, surface: Surface, tmp_path: Path) -> None:
    out = tmp_path / "steady.mp4"
    track(clip, surface, make_tracker=Still, save_steady=out)
    with VideoReader(out) as reader:
        assert sum(1 for _ in reader.frames()) == FRAMES


def test_the_steady_views_encoder_is_tried_before_the_work(clip: Path, surface: Surface, tmp_path: Path) -> None:
    trackers: list[Still] = []

    def make() -> Still:
        trackers.append(Still())
        return trackers[-1]

    options = OutputOptions(codec="prores")
    with pytest.raises(InputError, match="cannot hold"):
        track(clip, surface, make_tracker=make, save_steady=tmp_path / "o.mp4", options=options)
    assert not trackers
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["save_map", "save_steady"])
def test_existing_files_are_kept_and_names_are_looked_at_first(
    clip: Path, surface: Surface, tmp_path: Path, kind: str
) -> None:
    trackers: list[Still] = []

    def make() -> Still:
        trackers.append(Still())
        return trackers[-1]

    taken = tmp_path / ("taken.png" if kind == "save_map" else "taken.mp4")
    taken.write_bytes(b"precious")
    for name, message in (
        (taken, "--overwrite"),
        (clip, "is an input"),
        (tmp_path / "no" / taken.name, "does not exist"),
        (tmp_path / "map.xyz", "must end in one of"),
    ):
        with pytest.raises(InputError, match=message):
            track(clip, surface, make_tracker=make, **{kind: name})  # type: ignore[arg-type]
    assert not trackers
    assert taken.read_bytes() == b"precious"
    track(clip, surface, make_tracker=make, options=OutputOptions(overwrite=True), **{kind: taken})  # type: ignore[arg-type]
    assert taken.read_bytes() != b"precious"
