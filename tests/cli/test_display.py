"""What the commands show of their progress, and to whom."""

import json
import re
from argparse import Namespace
from collections.abc import Callable
from typing import Any

import pytest

from ar_demo.cli import commands, display, entry
from ar_demo.cli.display import Bar, Display, JsonLines, Lines, OpenJob, display_of
from ar_demo.errors import RunError
from ar_demo.progress import Progress

from ..conftest import Run
from . import test_applicability
from .test_applicability import MODES

done = test_applicability.done  # what the commands ask for, in place of doing it


def work(show: Display, *stages: tuple[str, int, int | None]) -> None:
    for stage, count, total in stages:
        for number in range(1, count + 1):
            show(Progress(stage, number, total, ("tracked",)))


ALL = (("track", 40, 40), ("track back", 10, 10), ("render", 50, 50))


def test_lines_come_now_and_then(capsys: pytest.CaptureFixture[str]) -> None:
    with Lines() as show:
        work(show, ("track", 30, 40), ("render", 50, None))
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "track: 1 of 40 frames, tracked",
        "track: 30 of 40 frames, tracked",
        "render: 1 frame, tracked",
        "render: 50 frames, tracked",
    ]


def test_json_lines(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(display, "SECONDS_BETWEEN_EVENTS", 0.0)
    with JsonLines() as show:
        work(show, ("render", 3, 3))
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert events == [{"stage": "render", "done": n, "total": 3, "state": "tracked"} for n in (1, 2, 3)]


@pytest.mark.parametrize(
    ("renders", "stages"), [(True, ALL), (True, ALL[2:]), (False, ALL[:2]), (True, (("track", 9, None), *ALL[2:]))]
)
def test_open_job_description(
    capsys: pytest.CaptureFixture[str], renders: bool, stages: tuple[tuple[str, int, int | None], ...]
) -> None:
    with OpenJob(renders) as show:
        work(show, *stages)
    lines = capsys.readouterr().out.splitlines()
    numbers = [int(line.removeprefix("openjd_progress: ")) for line in lines if "progress" in line]
    assert numbers == sorted(set(numbers))
    assert (numbers[-1], max(numbers[:-1]) <= 100) == (100, True)
    assert [line.removeprefix("openjd_status: ") for line in lines if "status" in line] == [s for s, *_ in stages]
    if len(stages) == 3:
        rendering = [n for n in numbers if lines.index(f"openjd_progress: {n}") > lines.index("openjd_status: render")]
        assert 50 >= max(n for n in numbers if n not in rendering) >= 40


def test_a_failure_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RunError), OpenJob(True):
        raise RunError("no space\nleft")
    assert capsys.readouterr().out == "openjd_fail: no space left\n"


@pytest.mark.parametrize(
    ("given", "terminal", "kind"),
    [
        ({}, True, Bar),
        ({}, False, Display),
        ({"quiet": True}, True, Display),
        ({"progress": "bar"}, False, Bar),
        ({"progress": "plain"}, True, Lines),
        ({"progress": "json", "quiet": True}, True, JsonLines),
        ({"progress": "openjd"}, True, OpenJob),
    ],
)
def test_what_is_shown(monkeypatch: pytest.MonkeyPatch, given: dict[str, Any], terminal: bool, kind: type) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal, raising=False)
    assert type(display_of(Namespace(**given), True)) is kind


@pytest.mark.parametrize("main", [entry.replace_main, entry.track_main])
def test_commands_take_it(
    run: Run, done: list[Any], main: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise RunError("no space left")

    files = ["in.mp4"] if main is entry.track_main else ["in.mp4", "ad.png"]
    quad = MODES["quad"][2:]
    code, out, _ = run(*files, *quad, "--progress", "openjd", main=main)
    assert (code, out.splitlines()[-1]) == (0, "openjd_progress: 100")
    monkeypatch.setattr(commands, "replace", fail)
    monkeypatch.setattr(commands, "track", fail)
    code, out, err = run(*files, *quad, "--progress", "openjd", "-o", "new.json", main=main)
    assert (code, out) == (1, "openjd_fail: no space left\n")
    assert re.fullmatch("error: no space left\n", err)
    code, _, err = run(*files, *quad, "--progress", "loud", main=main)
    assert code == 2
    assert "loud" in err
