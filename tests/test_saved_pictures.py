"""What `track` writes beside the track: a picture of the plane's map, and the steady view."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo import OutputOptions, Surface, track
from ar_demo.errors import InputError
from ar_demo.media.reader import VideoReader
from hdn.imaging.arrays import Image

from .clips import make_clip
from .scenes import Scene, path
from .test_session import Still

FRAMES = 5


class Mapping(Still):
    """A tracker with a map: a picture of the one colour."""

    def map_picture(self) -> Image:
        return np.full((30, 50, 3), (200, 100, 50), np.uint8)


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
    track(clip, surface, make_tracker=Mapping, save_map=out)
    picture = cv2.imread(str(out))
    assert picture is not None
    assert picture.shape == (30, 50, 3)
    assert (picture == (50, 100, 200)).all()  # OpenCV's order is BGR
    assert list(tmp_path.iterdir()) == [out]


def test_our_tracker_has_a_map(clip: Path, surface: Surface, tmp_path: Path) -> None:
    out = tmp_path / "map.png"
    track(clip, surface, save_map=out)
    picture = cv2.imread(str(out))
    assert picture is not None
    assert picture.std() > 10  # it shows something


def test_a_tracker_without_a_map_is_refused(clip: Path, surface: Surface, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="keeps no map of the plane"):
        track(clip, surface, make_tracker=Still, save_map=tmp_path / "map.png")


def test_a_complete_track_has_no_map(clip: Path, surface: Surface, tmp_path: Path) -> None:
    done = track(clip, surface, make_tracker=Still)
    with pytest.raises(InputError, match="nothing was tracked"):
        track(clip, Surface(effect="blur", track=done), make_tracker=Mapping, save_map=tmp_path / "map.png")


def test_the_steady_view_is_saved_as_a_video(clip: Path, surface: Surface, tmp_path: Path) -> None:
    out = tmp_path / "steady.mp4"
    track(clip, surface, make_tracker=Still, save_steady=out)
    with VideoReader(out) as reader:
        assert sum(1 for _ in reader.frames()) == FRAMES


@pytest.mark.parametrize("kind", ["save_map", "save_steady"])
def test_existing_files_are_kept_and_names_are_looked_at_first(
    clip: Path, surface: Surface, tmp_path: Path, kind: str
) -> None:
    trackers: list[Mapping] = []

    def make() -> Mapping:
        trackers.append(Mapping())
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
