"""Single frames look as the rendered video does."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo import Moment, OutputOptions, Session, Surface
from ar_demo.errors import InputError
from ar_demo.media.reader import VideoReader
from hdn.imaging.arrays import Image

from ..clips import make_clip
from ..scenes import Scene, path, texture

FRAMES = 12
QUADS = path(Scene().quad, FRAMES)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    images = [Scene().draw(corners) for corners in QUADS]
    return make_clip(tmp_path_factory.mktemp("clip") / "a.mp4", images)


@pytest.fixture(scope="module")
def ad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("ad") / "ad.png"
    cv2.imwrite(str(file), texture(2, 80, 60))
    return file


@pytest.fixture
def session(clip: Path, shared_networks: None) -> Iterator[Session]:
    with Session(clip) as session:
        yield session


def frames_of(video: Path) -> list[Image]:
    with VideoReader(video) as reader:
        return [frame.image for frame in reader.frames()]


def apart(a: Image, b: Image) -> float:
    return float(np.abs(a.astype(int) - b).mean())


def test_frames_are_those_that_are_rendered(session: Session, ad: Path, tmp_path: Path) -> None:
    surfaces = session.track([Surface(ad, QUADS[0])])
    options = OutputOptions(backend="opencv", codec="libx264rgb", crf=0)
    session.render(surfaces, tmp_path / "o.mkv", options)
    rendered, plain = frames_of(tmp_path / "o.mkv"), frames_of(session.reader.path)
    with session.preview(surfaces) as preview:
        one_by_one = [preview.frame(index) for index in range(FRAMES)]
        there = [preview.frame(index) for index in (9, 3)]
        assert preview.frame(FRAMES) is None
    for seen, expected in zip(one_by_one, rendered, strict=True):
        assert seen is not None
        np.testing.assert_array_equal(seen, expected)
    for seen, index in zip(there, (9, 3), strict=True):
        assert seen is not None
        assert apart(seen, rendered[index]) < 0.5 < 5 < apart(seen, plain[index])


def test_a_surface_without_a_track_is_drawn_in_its_own_frame_alone(session: Session, ad: Path) -> None:
    plain = frames_of(session.reader.path)
    unfinished = Surface(ad)
    with session.preview([unfinished, Surface(ad, QUADS[4], start=Moment(frame=4), lost="hold")]) as preview:
        changed = [apart(plain[i], image) for i in range(FRAMES) if (image := preview.frame(i)) is not None]
    assert changed[4] > 5
    assert max(changed[:4] + changed[5:]) == 0
    with session.preview([unfinished]) as preview:
        image = preview.frame(3)
        assert image is not None
        assert apart(plain[3], image) == 0


def test_a_surface_that_shall_snap_is_drawn_where_it_will_be(session: Session, ad: Path) -> None:
    seen = []
    for quad, snap in ((QUADS[0], False), (QUADS[0] + [2, 0], True), (QUADS[0] + [2, 0], False)):
        with session.preview([Surface(ad, quad, snap=snap, flat=True)]) as preview:
            image = preview.frame(0)
        assert image is not None
        seen.append(image)
    right, snapped, beside = seen
    assert apart(right, snapped) < apart(right, beside) / 2


def test_what_cannot_be_drawn_is_said(session: Session, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        session.preview([Surface(tmp_path / "gone.png", QUADS[0])])
