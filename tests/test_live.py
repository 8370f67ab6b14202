"""Live use: a file played as a stream, dropped frames, Ctrl-C, and a stream on standard output."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise, takewhile
from pathlib import Path
from threading import Event, Thread
from typing import Any

import av
import cv2
import numpy as np
import pytest

from ar_demo.cli.stdio import stopped_by_signals
from ar_demo.live import LiveSession
from ar_demo.media.live_stream import Stream
from ar_demo.media.reader import Frame, VideoReader
from ar_demo.options import OutputOptions, TrackingOptions
from ar_demo.pace import PaceModel
from ar_demo.progress import Progress
from ar_demo.scene.conditions import Appearance, Conditions
from ar_demo.surface import Moment, Surface
from hdn.errors import InputError

from .clips import frame_times, make_clip, number_of, numbered
from .scenes import Scene, path

FRAMES = 20
RATE = 10


pytestmark = pytest.mark.usefixtures("shared_networks")
OPENCV = OutputOptions(backend="opencv")


@pytest.fixture
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stream waits until its last frame has been fetched, so that none is dropped on however slow a machine."""

    class Unhurried(Stream):
        def frames(self, stop: Event) -> Iterator[Frame]:
            with VideoReader(Path(self.name)) as reader:
                yield from takewhile(lambda _: not stop.is_set(), reader.frames())

    monkeypatch.setattr("ar_demo.live.Stream", Unhurried)


@pytest.fixture(scope="module")
def truth() -> list[np.ndarray]:
    return path(Scene().quad, FRAMES)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, truth: list[np.ndarray]) -> Path:
    scene = Scene()
    return make_clip(tmp_path_factory.mktemp("clip") / "s.mp4", [scene.draw(c) for c in truth], rate=RATE)


@pytest.fixture(scope="module")
def ad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("ad") / "ad.png"
    cv2.imwrite(str(file), np.full((60, 80, 3), (0, 0, 255), np.uint8))
    return file


def reds(file: Path) -> list[tuple[Fraction, np.ndarray]]:
    """Time and centre of the largest red area in each frame."""
    found = []
    with VideoReader(file) as reader:
        for frame in reader.frames():
            r, g, b = (frame.image[..., c].astype(int) for c in range(3))
            red = ((r > 180) & (g < 90) & (b < 90)).astype(np.uint8)
            _, _, stats, centres = cv2.connectedComponentsWithStats(red)
            found.append((frame.time, centres[1 + stats[1:, cv2.CC_STAT_AREA].argmax()]))
    return found


def test_follows_a_file_played_as_a_stream(clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    started = time.monotonic()
    result = LiveSession(str(clip), [Surface(ad, truth[0])]).run(out, options=OPENCV)
    assert time.monotonic() - started > (FRAMES - 1) / RATE  # at its own pace
    assert result.dropped is not None
    assert result.frames + result.dropped == FRAMES
    assert result.states["tracked"] == result.frames
    summary = result.summary()
    assert summary["dropped"] == result.dropped >= summary["dropped_at_start"]
    late = result.latency
    assert late is not None
    assert 0 < late.p50 <= late.p95 <= late.p99
    assert summary["latency_ms"]["p50"] == round(late.p50, 1)
    assert result.fps == pytest.approx(result.frames / result.seconds)
    found = reds(out)
    assert len(found) == result.frames
    last = 0
    for at, centre in found:
        index = round(at * RATE)
        assert at == Fraction(index, RATE)  # frames keep their times, whatever was dropped
        assert off_the_way(centre, truth[last].mean(0), truth[index].mean(0)) < 1.5  # no more than a frame behind
        last = index


def off_the_way(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """How far a point is from the straight way between two others, px along x or y."""
    way = end - start
    share = np.clip((point - start) @ way / max(float(way @ way), 1e-9), 0, 1)
    return float(np.abs(point - start - share * way).max())


def test_drops_what_comes_while_it_is_busy(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "n.mp4", numbered(30), rate=50)
    with Stream(str(clip)) as stream:
        seen = []
        for frame in stream.frames(Event()):
            assert number_of(frame.image) == frame.index
            seen.append(frame.index)
            busy_until = stream.dropped + min(3, 28 - frame.index)  # the last frame there is stays
            while stream.dropped < busy_until:
                time.sleep(0.001)
    assert seen[0] == 0
    assert seen[-1] == 29
    assert stream.dropped == 30 - len(seen)
    assert all(later - index > min(3, 28 - index) for index, later in pairwise(seen))  # the newest, nothing queues up


@pytest.mark.usefixtures("unhurried")
def test_a_loss_fades_and_a_find_comes_back(ad: Path, truth: list[np.ndarray], tmp_path: Path) -> None:
    """At a cut to another place the ad is gone at once; at the cut back it is there again."""
    scene, other = Scene(), Scene(seed=5)
    other.wall = 255 - cv2.GaussianBlur(other.wall, (0, 0), 1)
    images = [scene.draw(scene.quad)] * 6 + [other.draw(None)] * 6 + [scene.draw(scene.quad)] * 6
    clip = make_clip(tmp_path / "cut.mp4", images, rate=8)
    out = tmp_path / "out.mp4"
    result = LiveSession(str(clip), [Surface(ad, scene.quad)]).run(out, options=OPENCV)
    assert result.states["held"] == 0 < result.states["lost"]
    back = []
    with VideoReader(out) as reader:
        for frame in reader.frames():
            index = round(frame.time * 8)
            colour = frame.image[110:120, 150:160].reshape(-1, 3).astype(int).mean(0)
            red = bool(colour[0] - colour[1:].max() > 120)
            if index < 12:
                assert red == (index < 6), index
            else:
                back.append(red)
    assert back[3:] == [True] * len(back[3:])  # to be found and to appear takes a moment


@pytest.mark.usefixtures("unhurried")
def test_end_and_effect(clip: Path, truth: list[np.ndarray], tmp_path: Path) -> None:
    out = tmp_path / "o.mp4"
    session = LiveSession(str(clip), [Surface(quad=truth[0], effect="outline")])
    result = session.run(out, TrackingOptions(end=Moment(time=Fraction(1, 2))), OPENCV)
    assert frame_times(out) == [Fraction(i, RATE) for i in range(RATE // 2 + 1)]
    assert result.frames == RATE // 2 + 1


@pytest.mark.usefixtures("unhurried")
@pytest.mark.parametrize("by_ctrl_c", [False, True])
def test_is_stopped_with_a_finished_file(
    clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path, by_ctrl_c: bool
) -> None:
    out = tmp_path / "out.mp4"

    def press(event: Progress) -> None:
        if event.done == 3 and by_ctrl_c:
            signal.raise_signal(signal.SIGINT)
        elif event.done == 3:
            thread = Thread(target=session.stop)
            thread.start()
            thread.join()

    before = signal.getsignal(signal.SIGINT)
    session = LiveSession(str(clip), [Surface(ad, truth[0])], press)
    with stopped_by_signals(session.stop):
        result = session.run(out, options=OPENCV)
    assert result.frames == 3
    assert len(reds(out)) == result.frames
    assert [p.name for p in tmp_path.iterdir()] == ["out.mp4"]
    assert signal.getsignal(signal.SIGINT) is before


def test_a_stream_on_standard_output(clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from ar_demo.cli.entry import replace_main; replace_main()", "--live", clip, ad]
    quad = ["--quad", *(f"{x},{y}" for x, y in truth[0])]
    done = subprocess.run(
        [*command, *quad, "-o", "-", "--backend", "opencv", "--json", "--quiet"], capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stderr)
    assert summary["output"] == "-"
    (tmp_path / "s.ts").write_bytes(done.stdout)
    with av.open(str(tmp_path / "s.ts")) as container:
        assert container.format.name == "mpegts"
        assert sum(1 for _ in container.decode(video=0)) == summary["frames"]


def test_from_standard_input(ad: Path, truth: list[np.ndarray], tmp_path: Path) -> None:
    images = [Scene().draw(corners) for corners in truth]
    clip, out = make_clip(tmp_path / "s.mkv", images, rate=RATE), tmp_path / "o.mp4"
    command = [sys.executable, "-c", "from ar_demo.cli.entry import replace_main; replace_main()", "--live", "-", ad]
    quad = ["--quad", *(f"{x},{y}" for x, y in truth[0])]
    told = ["-o", out, "--backend", "opencv", "--json", "--quiet"]
    done = subprocess.run([*command, *quad, *told], input=clip.read_bytes(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["frames"] + summary["dropped"] == FRAMES  # as they came: at once
    assert len(frame_times(out)) == summary["frames"]


@pytest.mark.usefixtures("unhurried")
def test_where_it_is_too_slow_the_scene_is_not_measured(
    clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ar_demo.pace.MODEL", PaceModel(busy_share=0.0))
    measured = []
    see = Appearance.see

    def counted(self: Appearance, *given: Any) -> Conditions:
        measured.append(1)
        return see(self, *given)

    monkeypatch.setattr(Appearance, "see", counted)
    result = LiveSession(str(clip), [Surface(ad, truth[0])]).run(tmp_path / "o.mp4", options=OPENCV)
    assert len(measured) == 2  # the first frame is not counted, and the second one is found to have taken too long
    assert any("too slow" in warning and f"in 18 of {FRAMES} frames" in warning for warning in result.warnings)
    assert result.states["tracked"] == FRAMES


@pytest.mark.parametrize(
    ("source", "message"),
    [("none.mp4", "none.mp4"), ("/dev/video77", "/dev/video77"), ("rtsp://127.0.0.1:9/x", "rtsp://127.0.0.1:9/x")],
)
def test_a_source_that_is_not_there(ad: Path, tmp_path: Path, source: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        LiveSession(source, [Surface(ad, Scene().quad)]).run(tmp_path / "o.mp4", options=OPENCV)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("surface", "options", "message"),
    [
        ({}, OPENCV, "--quad"),
        ({"quad": Scene().quad}, OutputOptions(audio="mix"), "no sound"),
        ({"quad": Scene().quad, "start": Moment(frame=900)}, OPENCV, "not reached"),
    ],
)
def test_refuses_what_live_use_cannot_do(
    clip: Path, ad: Path, tmp_path: Path, surface: dict[str, Any], options: OutputOptions, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        LiveSession(str(clip), [Surface(ad, **surface)]).run(tmp_path / "o.mp4", options=options)
    assert list(tmp_path.iterdir()) == []
