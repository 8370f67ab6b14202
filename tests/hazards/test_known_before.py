"""What can be known before the work is found before it; and where writing fails all the same, the track is kept."""

import errno
from pathlib import Path
from typing import Any

import pytest

import ar_demo.session
from ar_demo import OutputOptions, Surface, pipeline, replace
from ar_demo.compositing.opencv import CvCompositor
from ar_demo.errors import InputError, RunError, Stopped
from ar_demo.media.writer import VideoWriter
from ar_demo.progress import Progress
from ar_demo.tracks import Track

from ..clips import make_clip
from ..scenes import Scene, path
from ..test_session import Still

FRAMES = 4
QUAD = Scene().quad
OPENCV = OutputOptions(backend="opencv")


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ar_demo.session, "hdn_trackers", lambda options: Still)


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    scene = Scene()
    (tmp_path / "in").mkdir()
    return make_clip(tmp_path / "in" / "a.mp4", [scene.draw(corners) for corners in path(scene.quad, FRAMES)])


@pytest.mark.parametrize(
    ("output", "options", "message"),
    [
        ("/proc/o.mp4", {}, "cannot write to the folder /proc"),
        ("o.mp4", {"codec": "h999"}, "h999"),
        ("o.webm", {"codec": "libx264"}, "webm|libx264"),
        ("o.mp4", {"codec": "qtrle"}, "cannot hold"),
        ("o.mov", {"codec": "prores_ks", "crf": 20}, "crf"),
        ("o.xyz", {}, "must end in one of"),
        ("a" * 252 + ".mp4", {}, "more than 255 bytes"),
        ("o.mp4", {"backend": "egl"}, "no such library"),
    ],
)
def test_the_output_is_tried_before_the_work(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, output: str, options: dict[str, Any], message: str
) -> None:
    def no_gl(backend: str) -> CvCompositor:
        if backend == "egl":
            raise RunError("egl does not work here: no such library")
        return CvCompositor()

    monkeypatch.setattr(ar_demo.session, "open_compositor", no_gl)
    seen: list[Progress] = []
    with pytest.raises((InputError, RunError), match=message) as caught:
        replace(clip, Surface(effect="blur", quad=QUAD), tmp_path / output, None, OutputOptions(**options), seen.append)
    assert seen == []
    assert "Errno" not in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["in"]


def test_a_missing_ad_and_a_bad_place_for_the_track_are_told_before_the_work(clip: Path, tmp_path: Path) -> None:
    seen: list[Progress] = []
    with pytest.raises(InputError, match=r"none\.png"):
        replace(clip, Surface(tmp_path / "none.png", QUAD), tmp_path / "o.mp4", None, OPENCV, seen.append)
    surface = Surface(effect="blur", quad=QUAD)
    for file, message in (("/proc/t.json", "cannot write to the folder /proc"), (tmp_path / "o.mp4", "the same name")):
        with pytest.raises(InputError, match=message):
            replace(clip, surface, tmp_path / "o.mp4", None, OPENCV, seen.append, save_track=file)
    assert seen == []
    assert [p.name for p in tmp_path.iterdir()] == ["in"]


def fail(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def write(*_: object) -> None:
        raise error

    monkeypatch.setattr(VideoWriter, "write", write)


@pytest.mark.parametrize("count", [1, 2])
def test_the_track_outlives_an_output_that_fails(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    fail(monkeypatch, RunError("cannot write o.mp4: no space left on the disk"))
    with pytest.raises(RunError, match=r"no space left.*its track is kept, see --track: .*json") as caught:
        replace(clip, [Surface(effect="blur", quad=QUAD)] * count, tmp_path / "o.mp4", None, OPENCV)
    kept = sorted(p for p in tmp_path.iterdir() if p.name != "in")
    assert [p.name for p in kept] == (["o.track.json"] if count == 1 else ["o.track.1.json", "o.track.2.json"])
    for file in kept:
        assert str(file) in str(caught.value)
        assert len(Track.load(file)) == FRAMES


def test_a_track_that_was_given_or_saved_is_not_saved_again(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = pipeline.track(clip, Surface(quad=QUAD), save_track=tmp_path / "in" / "t.json")
    fail(monkeypatch, RunError("broken"))
    with pytest.raises(RunError, match=r"broken$"):
        replace(clip, Surface(effect="blur", track=given), tmp_path / "o.mp4", None, OPENCV)
    surface = Surface(effect="blur", quad=QUAD)
    with pytest.raises(RunError, match=r"broken; its track is kept, see --track: .*s\.json$"):
        replace(clip, surface, tmp_path / "o.mp4", None, OPENCV, save_track=tmp_path / "s.json")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in", "s.json"]


def test_who_stops_wants_nothing_kept(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fail(monkeypatch, Stopped("stopped"))
    with pytest.raises(Stopped):
        replace(clip, Surface(effect="blur", quad=QUAD), tmp_path / "o.mp4", None, OPENCV)
    assert [p.name for p in tmp_path.iterdir()] == ["in"]


def test_no_place_for_the_track_either(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fail(monkeypatch, RunError("broken"))

    def save(*_: object) -> None:
        raise RunError(f"cannot write: {errno.ENOSPC}")

    monkeypatch.setattr(Track, "save", save)
    with pytest.raises(RunError, match="broken; its track could not be kept either"):
        replace(clip, Surface(effect="blur", quad=QUAD), tmp_path / "o.mp4", None, OPENCV)
