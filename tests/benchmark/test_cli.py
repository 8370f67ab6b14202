"""`hdn-eval` end to end: what it writes, what it keeps, what it refuses."""

import csv
import json
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from hdn.benchmark import cli, evaluation, identity, trackers
from hdn.benchmark.trackers import Answer
from hdn.errors import InputError
from hdn.imaging.arrays import Array
from hdn.networks.pytorch import load, save
from hdn.networks.weights import shipped

from ..clips import make_clip
from ..conftest import Main, Run
from ..scenes import Scene, path

FRAMES = 10
UNKNOWN = 4  # the frame whose truth is null


@pytest.fixture
def main() -> Main:
    return cli.main


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two clips of posters, one with an attribute."""
    folder = tmp_path_factory.mktemp("posters")
    for seed, name in enumerate(("left", "right")):
        scene = Scene(seed=seed)
        truth = path(scene.quad, FRAMES)
        make_clip(folder / f"{name}.mp4", [scene.draw(corners) for corners in truth], rate=30)
        corners = [None if i == UNKNOWN else c.tolist() for i, c in enumerate(truth)]
        (folder / f"{name}.json").write_text(json.dumps({"corners": corners, "attributes": [name, "poster"][seed:]}))
    return folder


class Fake:
    """Answers with the given quad, moved by so many px to the right."""

    def __init__(self, right: float = 0) -> None:
        self.right = right

    def init(self, frame: np.ndarray, quad: Array) -> None:
        self.quad = quad
        self.calls = 0

    def track(self, frame: np.ndarray) -> Answer:
        self.calls += 1
        return Answer(self.quad + np.array([self.right, 0]), "tracked")


class Failing(Fake):
    def track(self, frame: np.ndarray) -> Answer:
        raise ValueError("no luck\nat all")


class Refusing(Fake):
    def init(self, frame: np.ndarray, quad: Array) -> None:
        raise InputError("the quad is too small")


class Silent(Fake):
    """Says nothing but in the frame that does not count."""

    def track(self, frame: np.ndarray) -> Answer:
        super().track(frame)
        return Answer(self.quad if self.calls == UNKNOWN else None, "lost")


def table(file: Path) -> list[dict[str, str]]:
    with file.open(encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


def test_everything_is_written(run: Run, clips: Path, tmp_path: Path) -> None:
    status, out, err = run(clips, "--trackers", "flow", "sift", "--out", tmp_path)
    assert (status, err) == (0, "")
    summary = table(tmp_path / "summary.csv")
    assert [(r["dataset"], r["average"], r["tracker"]) for r in summary] == [
        (clips.name, average, tracker) for average in ("sequences", "frames") for tracker in ("flow", "sift")
    ]
    assert all(float(r["P<=5"]) == 1 and float(r["ms"]) > 0 for r in summary)
    assert len(table(tmp_path / "sequences.csv")) == 4
    assert (tmp_path / "summary.md").read_text(encoding="utf-8") in out
    assert "2 sequences, 16 frames that count" in out  # 10 less the first and the unknown, twice
    written = {p.name for p in (tmp_path / clips.name).iterdir()}
    plots = {"precision.png", "hsr.png", "robustness.png", "attributes.png"}
    assert written == plots | {"failures-flow.jpg", "failures-sift.jpg"}
    track = json.loads((tmp_path / "tracks" / clips.name / "sift" / "left.json").read_text())
    assert len(track["corners"]) == len(track["states"]) == FRAMES
    assert len(track["seconds"]) == FRAMES - 1


def test_goes_on_where_it_stopped(run: Run, clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[Fake] = []
    monkeypatch.setattr(evaluation, "write_plots", lambda *_: None)  # they take longest

    def fake() -> Fake:
        started.append(Fake())
        return started[-1]

    monkeypatch.setitem(trackers.PEERS, "fake", fake)
    command = (clips, "--trackers", "fake", "--out", tmp_path, "--quiet")

    def runs(*more: object) -> int:
        started.clear()
        assert run(*command, *more)[0] == 0
        return len(started) - 1  # one is made to see whether it can be

    assert runs() == 2
    assert runs() == 0
    (tmp_path / "tracks" / clips.name / "fake" / "left.json").unlink()
    assert runs() == 1
    assert runs("--fresh") == 2
    assert runs("--limit", 5) == 2  # tracks of other frames do not serve
    assert runs("--degrade", "dark") == 2
    assert runs("--degrade", "dark", "--only", "le*") == 0


def test_tracks_by_other_code_or_weights_do_not_serve(
    run: Run, clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[Fake] = []
    monkeypatch.setattr(evaluation, "write_plots", lambda *_: None)

    def fake(*_: Path) -> Fake:
        started.append(Fake())
        return started[-1]

    monkeypatch.setitem(trackers.PEERS, "fake", fake)
    monkeypatch.setitem(trackers.OURS, "hdn", trackers.Ours("compact", fake))
    sources = tmp_path / "hdn"
    names = (
        *("tracker", "imaging/homography", "alignment/border", "training/loop"),
        *("benchmark/trackers", "benchmark/sequences", "benchmark/degradation"),
    )
    for name in names:
        (sources / name).parent.mkdir(parents=True, exist_ok=True)
        (sources / f"{name}.py").write_text("x = 1")
    monkeypatch.setattr(identity, "ROOT", tmp_path)
    monkeypatch.setattr(identity, "HERE", sources / "benchmark")
    weights = tmp_path / "weights"
    shutil.copy(shipped(), weights)

    def runs(tracker: str) -> int:
        started.clear()
        given = ["--weights", weights] if tracker == "hdn" else []
        assert run(clips, "--trackers", tracker, "--out", tmp_path, "--quiet", *given) == (0, "", "")
        return len(started) - 1

    def change(name: str) -> None:
        (sources / f"{name}.py").write_text("x = 2")

    assert [runs("fake"), runs("hdn"), runs("fake"), runs("hdn")] == [2, 2, 0, 0]
    change("training/loop")
    assert [runs("fake"), runs("hdn")] == [0, 0]
    for name in ("tracker", "alignment/border"):
        change(name)
        assert [runs("fake"), runs("hdn")] == [0, 2]
    (sources / "alignment" / "border.py").rename(sources / "border.py")  # what moved may be imported by others
    assert [runs("fake"), runs("hdn")] == [0, 2]
    change("benchmark/trackers")
    assert [runs("fake"), runs("hdn")] == [2, 2]
    network = load(weights)
    next(network.parameters()).add_(1e-3)
    save(network, tmp_path / "other", {})  # not over a file that the network's tensors may be mapped from
    (tmp_path / "other").replace(weights)
    assert [runs("fake"), runs("hdn")] == [0, 2]


def test_an_interruption_keeps_what_is_done(
    run: Run, clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Interrupted(Fake):
        def init(self, frame: np.ndarray, quad: Array) -> None:
            super().init(frame, quad)
            if (tmp_path / "tracks" / clips.name / "fake" / "left.json").exists():
                raise KeyboardInterrupt

    monkeypatch.setitem(trackers.PEERS, "fake", Interrupted)
    status, _, err = run(clips, "--trackers", "fake", "--out", tmp_path)
    assert status == 130
    assert "goes on from there" in err
    assert [p.name for p in (tmp_path / "tracks" / clips.name / "fake").iterdir()] == ["left.json"]


def test_a_failing_tracker_does_not_stop_the_others(
    run: Run, clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(trackers.PEERS, "failing", Failing)
    status, _, err = run(clips, "--trackers", "failing", "flow", "--out", tmp_path)
    assert status == 1
    assert err == f"error: 2 of 4 runs failed; the first: failing on {clips.name}/left failed in frame 1: at all\n"
    assert [r["tracker"] for r in table(tmp_path / "summary.csv")] == ["flow", "flow"]


@pytest.mark.parametrize("tracker", [Refusing, Silent])
def test_no_answer_is_a_failure_but_where_the_truth_is_unknown(
    run: Run, clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tracker: type[Fake]
) -> None:
    monkeypatch.setitem(trackers.PEERS, "fake", tracker)
    assert run(clips, "--trackers", "fake", "--out", tmp_path)[0] == 0
    row = table(tmp_path / "summary.csv")[0]
    assert (row["avg Prec"], row["lost wrongly"], row["median error"]) == ("0.000", "1.000", "inf")


def test_the_sheet_shows_both_quads(run: Run, clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(trackers.PEERS, "fake", lambda: Fake(right=40))
    run(clips, "--trackers", "fake", "--out", tmp_path)
    sheet = cv2.imread(str(tmp_path / clips.name / "failures-fake.jpg"))
    assert sheet is not None
    blue, green, red = (sheet[..., i].astype(int) for i in range(3))
    assert ((green - red > 60) & (green - blue > 60)).sum() > 200
    assert ((red - green > 90) & (red - blue > 90)).sum() > 200


def test_two_workers_find_what_one_finds(run: Run, clips: Path, tmp_path: Path) -> None:
    for workers in (1, 2):
        out = tmp_path / str(workers)
        assert run(clips, "--trackers", "orb", "--limit", 4, "--workers", workers, "--out", out)[0] == 0
    one, two = (
        [{k: v for k, v in row.items() if k != "ms"} for row in table(tmp_path / n / "sequences.csv")] for n in "12"
    )
    assert one == two


def test_without_matplotlib_there_are_no_plots_and_the_log_says_so(
    run: Run, clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert run(clips, "--trackers", "flow", "--limit", 3, "--out", tmp_path)[0] == 0
    assert "Matplotlib is not installed" in caplog.text
    assert [p.name for p in (tmp_path / clips.name).iterdir()] == ["failures-flow.jpg"]


def test_a_clip_that_ends_early_is_measured_as_far_as_it_goes(
    run: Run, clips: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    scene = Scene()
    truth = path(scene.quad, FRAMES)
    folder = tmp_path / "short"
    folder.mkdir()
    make_clip(folder / "a.mp4", [scene.draw(corners) for corners in truth[:6]], rate=30)
    (folder / "a.json").write_text(json.dumps({"corners": [c.tolist() for c in truth]}))
    status, out, _ = run(folder, "--trackers", "flow", "--out", tmp_path / "out")
    assert status == 0
    assert "ends after 6 frames, its truth after 10" in caplog.text
    assert "5 frames that count" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "nowhere is not a folder"),
        (["{clips}", "--trackers", "magic"], "no tracker 'magic'"),
        (["{clips}", "--trackers", "hdn-paper"], "hdn-paper needs weights of the configuration 'paper'"),
        (["{clips}", "--trackers", "hdn", "--weights", "none.safetensors"], "none.safetensors is missing"),
        (["{clips}", "--trackers", "flow", "--weights", "{weights}"], "none of the trackers takes"),
        (["{clips}", "--only", "x*"], "no sequence is called like 'x*'"),
        (["{clips}", "--degrade", "rain"], "invalid choice: 'rain'"),
        (["{clips}", "--limit", "1"], "--limit 2 or more"),
        (["{clips}", "--workers", "0"], "--workers takes 1 or more"),
        (["{clips}", "{clips}"], "same name"),
        ([], "required: DATASET"),
    ],
)
def test_wrong_input(run: Run, clips: Path, tmp_path: Path, arguments: list[str], message: str) -> None:
    given = [a.format(clips=clips, weights=shipped()) for a in arguments]
    if "--trackers" not in given:
        given += ["--trackers", "flow"] if given else []
    status, out, err = run(*given, *(["--out", tmp_path] if given else []))
    assert (status, out) == (2, "")
    assert message in err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
