"""A poster that is looked for: its picture, and clips that show it."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo.finding.pictures import read_pictures
from ar_demo.finding.search import Found, search
from ar_demo.media.reader import VideoReader
from ar_demo.options import TrackingOptions
from ar_demo.progress import silent
from ar_demo.stopping import StopSignal
from hdn.networks.engine import Engine

from ..clips import make_clip
from ..scenes import Scene, moved, path, texture

FRAMES = 24
Search = Callable[..., Found]


@pytest.fixture(scope="session")
def poster(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene's poster as a photograph of it: larger, paler, a little blurred."""
    picture = cv2.resize(Scene().poster, None, fx=1.7, fy=1.7, interpolation=cv2.INTER_CUBIC)
    pale = 60 + 0.6 * cv2.GaussianBlur(picture, (0, 0), 1.2).astype(np.float32)
    return written(tmp_path_factory.mktemp("pictures") / "poster.png", pale.astype(np.uint8))


@pytest.fixture(scope="session")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A picture of the same kind that no clip shows."""
    return written(tmp_path_factory.mktemp("other") / "other.png", texture(77, 240, 180))


@pytest.fixture(scope="session")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The poster on a wall, moving."""
    scene = Scene()
    images = [scene.draw(corners) for corners in path(scene.quad, FRAMES)]
    return make_clip(tmp_path_factory.mktemp("clips") / "street.mp4", images, rate=30)


@pytest.fixture(scope="session")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight frames with the poster twice, eight without it, eight with it once, elsewhere."""
    scene, bare = Scene(), Scene(seed=5)
    left, right, elsewhere = places(scene)
    scene.wall = scene.draw(left, noise=0)
    twice, once = scene.draw(right), bare
    once.poster = Scene().poster
    images = [twice] * 8 + [Scene(seed=9).draw(None)] * 8 + [once.draw(elsewhere)] * 8
    return make_clip(tmp_path_factory.mktemp("clips") / "shots.mp4", images, rate=30)


def places(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners (4, 2) of the poster in `shots`: on the left, on the right, and in the last shot."""
    return (
        moved(scene.quad, (-90, 0), 0.9),
        moved(scene.quad, (60, 40), 1.0, 0.1),
        moved(scene.quad, (0, 10), 1.2, -0.1),
    )


def written(file: Path, picture: np.ndarray) -> Path:
    """An RGB or RGBA picture as a file."""
    order = cv2.COLOR_RGBA2BGRA if picture.shape[2] == 4 else cv2.COLOR_RGB2BGR
    cv2.imwrite(str(file), cv2.cvtColor(picture, order))
    return file


@pytest.fixture(scope="session")
def find(engine: Engine) -> Search:
    """Searches a clip for pictures."""

    def call(video: Path, *pictures: Path, options: TrackingOptions | None = None) -> Found:
        with VideoReader(video) as reader:
            found = read_pictures(pictures)
            return search(reader, found, options or TrackingOptions(), lambda: engine, silent, StopSignal())

    return call
