"""A manifest that comes from others: what its jobs may touch, and that nothing in it reaches a shell."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ..conftest import Run
from .conftest import QUAD, Write

pytestmark = pytest.mark.usefixtures("stand_in")


@pytest.fixture
def outside(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("outside")
    (folder / "secret.png").write_text("a secret")
    return folder


def test_inside_the_root_all_is_well(run: Run, write: Write, tmp_path: Path) -> None:
    assert run(write({}, {"input": str(tmp_path / "a.mp4")}), "--root", tmp_path, "--quiet")[0] == 0


@pytest.mark.parametrize(
    "job",
    [
        {"input": "../x.mp4"},
        {"ad": "{outside}/secret.png"},
        {"output": "{outside}/o.mp4"},
        {"output": "out/../../o.mp4"},
        {"save_track": "/etc/t.json"},
        {"layer": "../l.mov"},
        {"track": "link/secret.png"},
        {"weights": "link/w.safetensors"},
        {"ad": "link.png"},
        {"input": "*/secret.png"},
        {"input": "/**/*.mp4"},
        {"ad": ["b.png", "../*"]},
        {"input": "shot"},
        {"surface": [["link.png", QUAD]]},
        {"find": ["b.png=link.png"]},
    ],
)
def test_what_leads_out_of_the_root_is_refused(
    run: Run, write: Write, tmp_path: Path, outside: Path, job: dict[str, Any], begun: Callable[[], list[str]]
) -> None:
    (tmp_path / "link").symlink_to(outside)
    (tmp_path / "link.png").symlink_to(outside / "secret.png")
    (tmp_path / "shot").mkdir()
    (tmp_path / "shot" / "1.png").symlink_to(outside / "secret.png")
    said = json.loads(json.dumps(job).replace("{outside}", str(outside)))
    status, _, err = run(write({}, said), "--root", tmp_path)
    assert (status, begun()) == (2, [])
    assert "line 1, column" in err
    assert "leads out of" in err
    assert [path.name for path in outside.iterdir()] == ["secret.png"]


def test_a_job_file_is_looked_into(run: Run, write: Write, tmp_path: Path, outside: Path) -> None:
    surface = {"ad": str(outside / "secret.png"), "quad": QUAD}
    (tmp_path / "job.json").write_text(json.dumps({"version": 1, "surfaces": [surface]}))
    manifest = tmp_path / "jobs.json"
    manifest.write_text(json.dumps({"version": 1, "jobs": [{"job": "job.json", "input": "a.mp4"}]}))
    status, _, err = run(manifest, "--root", tmp_path)
    assert status == 2
    assert "secret.png leads out of" in err


@pytest.mark.parametrize(
    "address", ["http://169.254.169.254/latest", "file:///etc/passwd", "FTP://a.b/c", "gopher://x/"]
)
def test_addresses_of_other_schemes_are_refused(run: Run, write: Write, address: str) -> None:
    for job in ({"input": address}, {"ad": address}, {"output": address}):
        status, _, err = run(write(job))
        assert (status, err.count("\n")) == (2, 1)
        assert "is not allowed: there are https, s3, gs" in err


def test_schemes_can_be_named(run: Run, write: Write) -> None:
    assert run(write({"input": "http://x/a.mp4"}), "--schemes", "http", "--dry-run")[0] == 0
    status, _, err = run(write({"input": "https://x/a.mp4"}), "--schemes", "http", "--dry-run")
    assert status == 2
    assert "there are http;" in err


def test_no_name_reaches_a_shell_or_becomes_an_option(run: Run, write: Write, tmp_path: Path) -> None:
    nasty = "$(touch pwned); `touch pwned` | touch pwned & \n--codec=fail"
    (tmp_path / nasty).write_text("odd")
    status, _, _ = run(write({"ad": nasty, "output": f"out/{nasty}.mp4"}), "--quiet")
    assert status == 0
    assert (tmp_path / "out" / f"{nasty}.mp4").read_text() == "a video\nodd\n"
    assert not list(tmp_path.rglob("pwned"))


def test_what_lies_in_the_current_folder_is_not_imported(
    run: Run, write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ar_demo.batch import process

    monkeypatch.undo()  # ar-replace itself
    assert "-P" in process.PROGRAM
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ar_demo").mkdir()
    (tmp_path / "ar_demo" / "__init__.py").write_text("open('pwned', 'w')")
    _, out, _ = run(write({}), "--quiet", "--json")
    assert json.loads(out)["jobs"][0]["ended"] == "wrong"
    assert not (tmp_path / "pwned").exists()


def test_limits_of_frames_and_pixels_hold_whatever_a_job_says(run: Run, write: Write, tmp_path: Path) -> None:
    jobs = {"max_frames": 10}, {"max_frames": 10**9}, {}
    assert run(write(*jobs), "--max-frames", 500, "--max-pixels", 9000, "--quiet")[0] == 0
    results = [json.loads((tmp_path / "out" / f"{n}.mp4.json").read_text()) for n in (1, 2, 3)]
    told = [[word for word in result["command"] if word.startswith("--max")] for result in results]
    assert told == [[f"--max-frames={n}", "--max-pixels=9000"] for n in (10, 500, 500)]
    status, out, _ = run(write(*jobs), "--max-frames", 600, "--dry-run")
    assert (status, [line.count("--max-frames=600") for line in out.splitlines()]) == (0, [0, 1, 1])
    _, out, _ = run(write(*jobs), "--max-frames", 600, "--quiet", "--json")
    assert {job["ended"] for job in json.loads(out)["jobs"]} == {"kept"}


@pytest.mark.parametrize(
    "job",
    [
        {"input": ""},
        {"input": "."},
        {"input": "x" * 5000},
        {"input": "a\0b.mp4"},
        {"input": "\ud800.mp4"},
        {"input": "[.mp4"},
        {"input": "folder"},
        {"ad": "folder"},
        {"output": "folder"},
        {"output": "a.mp4/o.mp4"},
        {"output": "x" * 300 + ".mp4"},
        {"output": ""},
        {"output": "a.mp4"},
        {"track": "x" * 5000},
        {"job": "a.mp4"},
        {"save_track": "a.mp4/t.json"},
        {"retries": 10**9},
        {"crf": 10**400},
        {"start": "9" * 5000},
    ],
)
def test_odd_names_and_numbers_spoil_nothing(run: Run, write: Write, tmp_path: Path, job: dict[str, Any]) -> None:
    """Such a manifest is refused with line and column, or the job is, and the others are done."""
    (tmp_path / "folder").mkdir()
    status, out, err = run(write(job, {}), "--quiet", "--json")
    if status == 2:
        assert (out, err.count("\n")) == ("", 1)
        assert "line 1, column" in err
    else:
        ended = {each["number"]: each["ended"] for each in json.loads(out)["jobs"]}
        assert ended[2] == "done"
        assert ended[1] in ("wrong", "failed", "done")
    assert "should not happen" not in err
    assert (tmp_path / "a.mp4").read_text() == "a video"


def test_a_file_whose_name_is_no_text_is_named(run: Run, write: Write, tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    try:
        (tmp_path / "x" / os.fsdecode(b"\xff.mp4")).touch()
    except OSError:
        pytest.skip("this file system takes only UTF-8")
    status, _, err = run(write({"input": "x/*.mp4"}))
    assert status == 2
    assert "\\udcff.mp4' is not UTF-8: rename it" in err
