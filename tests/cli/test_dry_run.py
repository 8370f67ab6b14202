"""`--dry-run`: what is checked, what is told, and that nothing is left behind."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo.cli import entry
from ar_demo.tracking.passes import Passes

from ..clips import make_clip
from ..conftest import Run
from ..scenes import Scene

pytestmark = pytest.mark.usefixtures("shared_networks")

FRAMES = 6
QUAD = Scene().quad
CORNERS = ["--quad", *(f"{x},{y}" for x, y in QUAD)]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    make_clip(tmp_path / "in.mp4", [Scene().draw(QUAD)] * FRAMES, rate=25)
    cv2.imwrite(str(tmp_path / "ad.png"), np.full((60, 80, 3), 255, np.uint8))
    monkeypatch.chdir(tmp_path)

    def works(*_: object) -> None:
        raise AssertionError("it is not dry")

    monkeypatch.setattr(Passes, "_both_ways", works)
    return tmp_path


def contents(folder: Path) -> set[tuple[Path, bytes]]:
    return {(path, path.read_bytes()) for path in folder.iterdir()}


def test_what_would_be_replaced(run: Run, folder: Path) -> None:
    before = contents(folder)
    code, out, err = run("in.mp4", "ad.png", *CORNERS, "--time", "1..3", "--save-track", "t.json", "--dry-run")
    assert code == 0, err
    assert out.splitlines() == [
        "in.mp4: 320x240, 25 frames/s, 6 frames",
        "  surface 1, ad.png: corners in frame 1, tracked from frame 1 to 3",
        "would write in.ar.mp4",
        "would write t.json",
        "nothing was written",
    ]
    assert contents(folder) == before


def test_what_would_be_tracked(run: Run, folder: Path) -> None:
    before = contents(folder)
    given = ["in.mp4", *CORNERS, "--start", "2", "--export", "t.nk", "--save-map", "m.png", "--dry-run", "--json"]
    code, out, err = run(*given, main=entry.track_main)
    assert code == 0, err
    plan = json.loads(out)
    assert (plan["dry_run"], plan["frames"], plan["fps"]) == (True, FRAMES, 25)
    assert plan["surfaces"] == [{"ad": None, "quad_frame": 2, "first": 0, "last": 5, "states": None}]
    assert plan["outputs"] == ["in.track.json", "m.png", "t.nk"]
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["in.mp4", "none.png", *CORNERS], "none.png"),
        (["none.mp4", "ad.png", *CORNERS], "none.mp4"),
        (["in.mp4", "ad.png", "--quad", "1,1", "5,1", "5,5", "1,5"], "16 px"),
        (["in.mp4", "ad.png", *CORNERS, "--start", "99"], "beyond the end"),
        (["in.mp4", "ad.png", *CORNERS, "--keyframe", "99:1,1,9,1,9,9,1,9"], "beyond the end"),
        (["in.mp4", "ad.png", *CORNERS, "-o", "none/o.mp4"], "none"),
        (["in.mp4", "ad.png", *CORNERS, "-o", "ad.png"], "ad.png"),
        (["in.mp4", "ad.png", *CORNERS, "-o", "o.webm", "--codec", "h264"], "cannot hold"),
        (["in.mp4", "ad.png", *CORNERS, "--weights", "ad.png"], "safetensors"),
        (["in.mp4", "ad.png", *CORNERS, "--progress", "json"], "do not go together"),
        (["0", "ad.png", *CORNERS, "--live"], "do not go together"),
    ],
)
def test_everything_is_checked(run: Run, folder: Path, arguments: list[str], message: str) -> None:
    before = contents(folder)
    code, out, err = run(*arguments, "--dry-run", "--quiet")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert contents(folder) == before


def test_a_track_that_is_there(run: Run, folder: Path) -> None:
    rows = "".join(f"{frame},{','.join(str(v) for v in QUAD.ravel())}\n" for frame in range(4))
    (folder / "t.csv").write_text("frame,x1,y1,x2,y2,x3,y3,x4,y4\n" + rows)
    code, out, err = run("in.mp4", "--effect", "blur", "--track", "t.csv", "--time", "..2", "--dry-run")
    assert code == 0, err
    assert "warning: " not in err
    assert "  surface 1, no ad: has its track: 3 tracked, 0 held, 0 lost" in out.splitlines()
    (folder / "t.csv").write_text(
        "frame,x1,y1,x2,y2,x3,y3,x4,y4\n" + rows + rows.splitlines()[0].replace("0,", "99,", 1)
    )
    code, _, err = run("in.mp4", "--effect", "blur", "--track", "t.csv", "--dry-run", "--strict")
    assert code == 1
    assert "corners at 1 frame that in.mp4 does not have" in err
