"""The benchmark, on clips whose answer is known."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo.finding import benchmark
from hdn.networks.engine import Engine

from ..clips import make_clip
from ..scenes import Scene, path, texture
from .conftest import written

FRAMES = 12


@pytest.fixture(autouse=True)
def _loaded(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark, "load_engine", lambda: engine)


def call(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    with pytest.raises(SystemExit) as end:
        benchmark.main([str(argument) for argument in arguments])
    assert not end.value.code
    return capsys.readouterr().out


def test_clips_and_pairs_with_known_corners(tmp_path: Path, clip: Path, capsys: pytest.CaptureFixture[str]) -> None:
    corners = path(Scene().quad, FRAMES)
    make_clip(tmp_path / "a.mp4", [Scene().draw(quad) for quad in corners], rate=30)
    (tmp_path / "a.json").write_text(json.dumps({"corners": [quad.tolist() for quad in corners]}))
    views = tmp_path / "pairs" / "board"
    views.mkdir(parents=True)
    first = texture(3, 320, 240)
    to_second = np.array([[0.8, 0.1, 20], [-0.05, 0.9, 15], [1e-4, 0, 1]])
    for number, view in ((1, first), (2, cv2.warpPerspective(first, to_second, (320, 240)))):
        written(views / f"img{number}.webp", view)
    np.savetxt(views / "H1to2p", to_second)
    out = call(capsys, "seen", tmp_path)
    rows = {row.split("|")[1].strip(): row.split("|")[2:4] for row in out.splitlines() if row.startswith("| ")}
    found = {name: [int(cell) for cell in cells] for name, cells in rows.items() if cells[0].strip().isdecimal()}
    assert found == {
        "pairs, whole": [2, 2],
        "pairs, middle": [1, 1],
        "clips": [1, 1],
        "clips, bad photograph": [1, 1],
    }
    assert " 0 wrong" in out
    assert " 1 wrong" not in out


def test_what_no_clip_shows(clip: Path, other: Path, poster: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = call(capsys, "unseen", "--videos", clip.parent, "--pictures", other.parent)
    assert ": 0 false finds of" in out
    out = call(capsys, "unseen", "--videos", clip.parent, "--pictures", poster.parent)
    assert ": 0 false finds of" not in out


def test_speed(clip: Path, poster: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "ms of processor time a frame" in call(capsys, "speed", clip, poster)
