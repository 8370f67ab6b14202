"""ar-report, and --report of the others: the page, the verdict as line, JSON and exit status."""

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo import Track
from ar_demo.cli import entry

from ..clips import make_clip
from ..conftest import Main, Run
from ..export.tracks import make
from ..scenes import Scene, path
from .test_commands import quad_arguments

FRAMES = 10


@pytest.fixture
def main() -> Main:
    return entry.report_main


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = Scene()
    images = [scene.draw(corners) for corners in path(scene.quad, FRAMES)]
    return make_clip(tmp_path_factory.mktemp("clip") / "street.mp4", images, rate=30)


@pytest.fixture
def file(clip: Path, tmp_path: Path) -> Path:
    """The clip's true track."""
    track = make(np.stack(path(Scene().quad, FRAMES)))
    track.times = [Fraction(i, 30) for i in range(FRAMES)]
    track.save(tmp_path / "t.json")
    return tmp_path / "t.json"


def changed(file: Path, held: int = 0, lost: int = 0) -> None:
    track = Track.load(file)
    track.states[-held - lost :] = ["held"] * held + ["lost"] * lost
    if lost:
        track.corners[-lost:], track.deviation[-lost:], track.confidence[-lost:] = np.nan, np.inf, 0
    track.save(file)


def test_the_page_lies_beside_the_track(run: Run, file: Path, clip: Path) -> None:
    status, out, err = run(file, clip)
    page = file.with_name("t.html")
    assert (status, out, err) == (0, f"{page}: pass\n", "")
    assert "data:image/jpeg" in page.read_text(encoding="utf-8")
    status, _, err = run(file)
    assert status == 2
    assert "exists already" in err
    assert run(file, "--overwrite", "--quiet")[0] == 0
    assert "data:image/jpeg" not in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("held", "lost", "options", "verdict", "status"),
    [
        (0, 0, [], "pass", 0),
        (6, 0, [], "check", 4),
        (2, 0, ["--max-held", "10%"], "check", 4),
        (2, 0, ["--max-held", "20%"], "pass", 0),
        (1, 6, [], "fail", 5),
        (1, 6, ["--fail-lost", "0.6"], "check", 4),
        (0, 0, ["--max-deviation", "0.1"], "check", 4),
    ],
)
def test_the_verdict_is_the_exit_status(
    run: Run, file: Path, held: int, lost: int, options: list[str], verdict: str, status: int
) -> None:
    if held or lost:
        changed(file, held, lost)
    code, out, _ = run(file, "--json", "--strict", *options)
    summary = json.loads(out)
    assert (code, summary["verdict"]["status"]) == (status, verdict)
    assert (summary["verdict"]["held"], summary["verdict"]["lost"]) == (held / FRAMES, lost / FRAMES)
    assert run(file, "--overwrite", *options)[0] == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--max-held", "5"], "'5' is no share: give one as 5% or 0.05"),
        (["--max-deviation", "-1"], "max_deviation -1 is out of range"),
        (["-o", "t.json"], "must end in .html"),
        (["nothing.mp4"], "nothing.mp4"),
        (["--composite", "out.mp4"], "--composite does nothing without the video"),
    ],
)
def test_what_is_refused(run: Run, file: Path, arguments: list[str], message: str) -> None:
    before = {*file.parent.iterdir()}
    status, out, err = run(file, *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert {*file.parent.iterdir()} == before


def test_ar_track_writes_one(run: Run, clip: Path, tmp_path: Path, shared_networks: None) -> None:
    page, track = tmp_path / "r.html", tmp_path / "t.json"
    given = [clip, *quad_arguments(Scene().quad), "--report", page, "-o", track, "--json"]
    status, out, err = run(*given, main=entry.track_main)
    assert status == 0, err
    assert json.loads(out)["verdict"]["status"] == "pass"
    text = page.read_text(encoding="utf-8")
    assert "quad" in text
    assert "joint solution" in text


def test_ar_replace_writes_one_with_stills_before_and_after(run: Run, clip: Path, file: Path, tmp_path: Path) -> None:
    page = tmp_path / "r.html"
    changed(file, held=6)
    given = [clip, "--effect", "mosaic", "--track", file, "-o", tmp_path / "o.mp4", "--report", page]
    status, out, err = run(*given, "--strict", main=entry.replace_main)
    assert status == 4, err
    assert "verdict: check: held in 6 of 10 frames" in out
    text = page.read_text(encoding="utf-8")
    assert text.count(", after'") == 3
    assert "mosaic" in text


def test_a_job_names_one_and_its_limits(run: Run, clip: Path, file: Path, tmp_path: Path) -> None:
    changed(file, held=6)
    job = {
        "version": 1, "input": str(clip), "output": "o.mp4", "report": "r.html",
        "limits": {"max_held": "60%"}, "surfaces": [{"effect": "blur", "track": "t.json"}],
    }  # fmt: skip
    (tmp_path / "job.json").write_text(json.dumps(job))
    status, out, err = run("--job", tmp_path / "job.json", "--strict", "--json", main=entry.replace_main)
    assert status == 0, err
    assert json.loads(out)["verdict"]["status"] == "pass"
    assert (tmp_path / "r.html").exists()
    (tmp_path / "job.json").write_text(json.dumps(job | {"limits": {"max_held": "30"}}))
    status, _, err = run("--job", tmp_path / "job.json", main=entry.replace_main)
    assert (status, "$.limits" in err) == (2, True)


def test_a_dry_run_names_it_and_writes_nothing(run: Run, clip: Path, file: Path, tmp_path: Path) -> None:
    given = [clip, "--effect", "blur", "--track", file, "--report", tmp_path / "r.html", "--dry-run"]
    status, out, err = run(*given, "-o", tmp_path / "o.mp4", main=entry.replace_main)
    assert status == 0, err
    assert f"would write {tmp_path / 'r.html'}" in out
    assert {p.name for p in tmp_path.iterdir()} == {"t.json"}


def test_a_default_of_ones_own(run: Run, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    changed(file, held=2)
    monkeypatch.setenv("AR_REPLACE_MAX_HELD", "10%")
    assert run(file, "--strict")[0] == 4
    assert run(file, "--strict", "--overwrite", "--max-held", "20%")[0] == 0
