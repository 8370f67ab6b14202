"""`hdn-bench`: that it measures what it says. Times themselves depend on the machine and are not tested."""

import json
import logging
import os
import sys

import numpy as np
import pytest

from hdn import Tracker
from hdn.benchmark import speed
from hdn.benchmark.speed import STAGES, Clocked, Compact, Footage, Subject, difference, limited
from hdn.errors import InputError
from hdn.imaging.arrays import Array
from hdn.imaging.homography import from_corners, transform
from hdn.imaging.observation import Observation
from hdn.networks import pytorch, torch_engine
from hdn.networks.engine import Engine

from ..scenes import Scene, path


@pytest.fixture(scope="module")
def footage() -> Footage:
    return Footage()


def test_engines_agree_on_a_moving_poster(network: pytorch.Hdn, engine: Engine) -> None:
    scene = Scene()
    truth = path(scene.quad, 8)
    frames = [scene.draw(corners) for corners in truth]
    answers: list[dict[int, Array]] = []
    for each in (engine, torch_engine.engine(network, "cpu")):
        tracker = Tracker(engine=each)
        tracker.init(frames[0], truth[0])
        answers.append({})
        for i in range(1, len(frames)):
            tracker.place(from_corners(truth[0], truth[i - 1]))
            answers[-1][i] = tracker.propose(Observation(frames[i])).homography
    assert difference(*answers, scene.quad) < speed.AGREEMENT


def test_difference_is_that_of_the_worst_corner_of_the_worst_frame() -> None:
    quad = np.array([[0.0, 0], [10, 0], [10, 10], [0, 10]])
    one = {0: np.eye(3), 1: np.eye(3), 2: 9 * np.eye(3)}
    other = {0: np.eye(3), 1: np.diag([1.3, 1.4, 1])}
    assert difference(one, other, quad) == pytest.approx(5)


def test_footage_moves_over_and_over(footage: Footage) -> None:
    np.testing.assert_allclose(footage.homographies[0], np.eye(3), atol=1e-12)
    corners = [transform(h, footage.quad) for h in footage.homographies]
    steps = [
        np.linalg.norm(c - before, axis=1).max() for c, before in zip(corners, corners[-1:] + corners, strict=False)
    ]
    assert min(steps) > 1
    assert max(steps) < 30
    assert {frame.shape for frame in footage.frames} == {(720, 1280, 3)}


def test_a_compact_tracker_follows_the_footage_and_its_parts_add_up(network: pytorch.Hdn, footage: Footage) -> None:
    compact = Compact(Clocked(network, "cpu", "torch"), footage)
    parts = compact.measure(1)
    assert parts[STAGES] == pytest.approx(parts["translation"] + parts["scale and rotation"] + parts["residual"])
    assert all(seconds > 0 for seconds in parts.values())
    truth = transform(footage.homographies[1], footage.quad)
    assert np.linalg.norm(transform(compact.proposals[1], footage.quad) - truth, axis=1).max() < 10


def test_the_authors_tracker_answers_that_nothing_moved(footage: Footage, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    track = speed.AuthorsTracker.track
    monkeypatch.setattr(speed.AuthorsTracker, "track", lambda self, frame: seen.append(track(self, frame)))
    parts = speed.authors(footage)(1)
    assert set(parts) == {STAGES}
    np.testing.assert_allclose(seen[0], footage.homographies[0], atol=1e-6)


def test_a_burst_leaves_out_its_first_frame() -> None:
    measured: list[int] = []

    def measure(i: int) -> dict[str, float]:
        measured.append(i)
        return {"part": float(i)}

    subject = Subject("", measure, burst=2)
    subject.run(speed.FRAMES - 1)
    assert measured == [speed.FRAMES - 1, 0, 1]
    assert subject.milliseconds() == {"part": {"best": 0, "p50": pytest.approx(500), "p90": pytest.approx(900)}}


@pytest.mark.parametrize("form", ["text", "json"])
def test_report(
    form: str, footage: Footage, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(speed, "Footage", lambda: footage)
    monkeypatch.setattr(speed, "Compact", FakeCompact)
    monkeypatch.setattr(speed, "Clocked", FakeEngine)
    monkeypatch.setattr(speed, "authors", lambda _: lambda i: {STAGES: 0.5})
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    with pytest.raises(SystemExit) as stop:
        speed.main(["--rounds", "2", *(["--json"] if form == "json" else [])])
    assert stop.value.code == 0
    out = capsys.readouterr().out
    if form == "text":
        for words in ("OpenVINO on the CPU", "paper, as its authors run it", "no CUDA device", "674 ms", "50.0", "2.0"):
            assert words in out
        return
    report = json.loads(out)
    assert report["rounds"] == 2
    assert report["cuda"] is None
    assert list(report["ratios"].values()) == pytest.approx([50, 67.4, 2])
    assert report["corner_difference_px"] == {"compact, PyTorch on the CPU": 0}
    assert report["machine"]["threads"] >= 1


class FakeEngine:
    def __init__(self, network: pytorch.Hdn, device: str, library: str) -> None:
        self.config = network.config
        self.description = "OpenVINO on the CPU" if library == "openvino" else f"PyTorch on {device}"


class FakeCompact:
    """10 ms a frame through OpenVINO, 20 ms through PyTorch."""

    def __init__(self, engine: FakeEngine, footage: Footage) -> None:
        self.engine, self.proposals = engine, {0: np.eye(3)}

    def measure(self, i: int) -> dict[str, float]:
        return {STAGES: 0.01 if "OpenVINO" in self.engine.description else 0.02}


def test_a_busy_machine_is_said(
    footage: Footage, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(speed, "Footage", lambda: footage)
    monkeypatch.setattr(speed, "Compact", FakeCompact)
    monkeypatch.setattr(speed, "Clocked", FakeEngine)
    monkeypatch.setattr(speed, "authors", lambda _: lambda i: {STAGES: 0.5})
    monkeypatch.setattr("os.getloadavg", lambda: (3.0, 1.0, 1.0))
    with caplog.at_level(logging.WARNING):
        speed.benchmark(1, threads=2)
    assert "busy" in caplog.text


@pytest.mark.skipif(sys.platform != "linux", reason="other systems keep no process to some processors")
def test_threads_keep_to_some_processors_and_are_given_back() -> None:
    every = os.sched_getaffinity(0)
    if len(every) < 2:
        pytest.skip("one processor alone")
    with limited(1) as threads:
        assert threads == len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == every


@pytest.mark.parametrize(
    ("arguments", "words"), [(["--threads", "9999"], "this machine has"), (["--threads", "0"], "0")]
)
def test_wrong_input(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        speed.main(arguments)
    assert stop.value.code == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_limited_refuses_more_than_there_are() -> None:
    with pytest.raises(InputError, match="this machine has"), limited(9999):
        pass
