"""Stretches of a video that are tracked by themselves: together they say what one way through all of it says."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ar_demo import Keyframe, Moment, Session, Surface, TrackingOptions
from ar_demo import session as sessions
from ar_demo.media.reader import VideoReader
from ar_demo.tracking import stretches
from ar_demo.tracking.runs import Run
from ar_demo.tracks import Track
from hdn import Tracker
from hdn.networks.engine import Engine

from ..clips import make_clip
from ..scenes import Scene, error, path, texture

SHOTS = 10, 4, 10  # frames: the surface, something else, the surface from elsewhere
SECOND = SHOTS[0] + SHOTS[1]


@pytest.fixture(scope="module")
def truth() -> dict[int, np.ndarray]:
    corners = path(Scene().quad, SHOTS[0] + SHOTS[2] + 20)
    first = dict(enumerate(corners[: SHOTS[0]]))
    return first | {SECOND + i: c for i, c in enumerate(corners[-SHOTS[2] :])}


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, truth: dict[int, np.ndarray]) -> Path:
    scene, other = Scene(), 255 - texture(7, 320, 240)
    images = [scene.draw(truth[i]) if i in truth else other for i in range(sum(SHOTS))]
    return make_clip(tmp_path_factory.mktemp("clip") / "a.mp4", images, rate=25)


class InThisProcess:
    """Stands in for the processes."""

    def __init__(self, count: int, stop: Any) -> None:
        self.count, self.tasks = count, 0

    def __enter__(self) -> "InThisProcess":
        return self

    def __exit__(self, *error: object) -> None:
        assert self.tasks > 2

    def map(self, work: Callable[[Any], Any], tasks: Sequence[Any], show: Callable[[], object]) -> list[Any]:
        self.tasks += len(tasks)
        return [work(task) for task in tasks]


@pytest.fixture
def divided(monkeypatch: pytest.MonkeyPatch, engine: Engine) -> None:
    """Stretches are short, and tracked here."""
    monkeypatch.setattr(stretches, "MODEL", replace(stretches.MODEL, least_frames=4, each_process=2))
    monkeypatch.setattr(stretches, "_trackers", lambda options: lambda: Tracker(engine=engine))
    monkeypatch.setattr(stretches, "_reader", VideoReader)
    monkeypatch.setattr(sessions, "Workers", InThisProcess)


def track(clip: Path, surface: Surface, parallel: int) -> Track:
    with Session(clip) as session:
        [found] = session.track([surface], TrackingOptions(parallel=parallel))
    assert found.track is not None
    return found.track


@pytest.mark.usefixtures("shared_networks", "divided")
@pytest.mark.parametrize("start", [0, SECOND + 3])
def test_the_same_track_as_in_one_go(clip: Path, truth: dict[int, np.ndarray], start: int) -> None:
    surface = Surface(quad=truth[start], start=Moment(frame=start))
    whole, parts = track(clip, surface, 1), track(clip, surface, 2)
    assert parts.cuts == whole.cuts == [SHOTS[0], SECOND]
    assert parts.states == whole.states
    assert whole.counts == {"tracked": SHOTS[0] + SHOTS[2], "held": 0, "lost": SHOTS[1]}
    known = whole.known
    assert np.abs(parts.corners - whole.corners)[known].max() < 0.05
    assert max(error(parts.corners[i], corners) for i, corners in truth.items()) < 0.5


@pytest.mark.usefixtures("shared_networks", "divided")
def test_keyframes_are_seams(clip: Path, truth: dict[int, np.ndarray]) -> None:
    at = (5, SECOND + 4)
    keyframes = tuple(Keyframe(Moment(frame=i), truth[i]) for i in at)
    surface = Surface(quad=truth[0], keyframes=keyframes)
    whole, parts = track(clip, surface, 1), track(clip, surface, 2)
    assert parts.states == whole.states
    assert np.abs(parts.corners - whole.corners)[whole.known].max() < 0.05


def run(anchor: int, stop: int | None, fills: bool = False) -> Run:
    return Run(anchor, np.zeros((4, 2)), stop, fills)


def test_each_run_begins_in_one_stretch_and_goes_through_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stretches, "MODEL", replace(stretches.MODEL, least_frames=10, each_process=2))
    runs = [[run(0, 25), run(25, None)], [run(5, 8, fills=True)]]
    found = stretches.divided(Path("a.mp4"), TrackingOptions(), [], runs, [(0, 39)], False, 2)
    assert [(s.first, s.stop) for s in found] == [(0, 10), (10, 20), (20, 30), (30, 40)]
    assert [[len(each) for each in s.runs] for s in found] == [[1, 1], [0, 0], [1, 0], [0, 0]]
    expected = [None, runs[0][0], runs[0][0], runs[0][1]]
    assert [[through is each for through in s.through] for s, each in zip(found, expected, strict=True)] == [
        [True, each is None] for each in expected
    ]
    back = stretches.divided(Path("a.mp4"), TrackingOptions(), [], [[run(39, 0)]], [(0, 39)], True, 2)
    assert [s.through[0] is not None for s in back] == [True, True, True, False]
    assert [len(s.runs[0]) for s in back] == [0, 0, 0, 1]


def test_a_short_video_is_one_stretch() -> None:
    [only] = stretches.divided(Path("a.mp4"), TrackingOptions(), [], [[run(0, None)]], [(0, 99)], False, 8)
    assert (only.first, only.stop, only.low, only.high) == (0, 100, 0, 100)
