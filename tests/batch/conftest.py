import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ar_demo.batch import process
from ar_demo.cli.entry import batch_main

from ..conftest import Main

QUAD = "0,0 90,0 90,90 0,90"
Write = Callable[..., Path]


@pytest.fixture
def main() -> Main:
    return batch_main


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """Jobs are done by `stand_in.py`."""
    program = (sys.executable, "-I", "-S", str(Path(__file__).with_name("stand_in.py")))
    monkeypatch.setattr(process, "PROGRAM", program)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes a manifest of jobs, each of which is given by the options that it has beside one input and ad."""
    (tmp_path / "a.mp4").write_text("a video")
    (tmp_path / "b.png").write_text("a picture")

    def call(*jobs: dict[str, Any], **content: Any) -> Path:
        usual = {"input": "a.mp4", "ad": "b.png", "quad": QUAD, "output": "out/{number}.mp4"}
        said = [usual | {"start": number} | job for number, job in enumerate(jobs)]  # so that each has its own track
        file = tmp_path / "jobs.json"
        file.write_text(json.dumps({"version": 1, "jobs": said} | content))
        return file

    return call


@pytest.fixture
def begun(tmp_path: Path) -> Callable[[], list[str]]:
    """The outputs that the stand-in began, since this was last asked."""

    def call() -> list[str]:
        file = tmp_path / "begun.txt"
        names = file.read_text().split() if file.exists() else []
        file.unlink(missing_ok=True)
        return names

    return call
