"""ar-export and `ar-track --export`, from the video to the file."""

import json
from pathlib import Path

import numpy as np
import pytest

from ar_demo.cli import entry
from ar_demo.tracks import Track

from .. import clips
from ..conftest import Run
from ..export import parsers
from ..export.tracks import TRACKS
from ..scenes import Scene, error, path

pytestmark = pytest.mark.usefixtures("shared_networks")


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    TRACKS["lost"]().save(tmp_path / "t.json")
    return tmp_path / "t.json"


def test_a_turned_video_is_tracked_and_exported_upright(run: Run, tmp_path: Path) -> None:
    scene = Scene(240, 320)
    quad = scene.quad - [60, 0]
    truth = path(quad, 6)
    images = [np.ascontiguousarray(np.rot90(scene.draw(corners))) for corners in truth]
    clip = clips.make_clip(tmp_path / "phone.mp4", images, rate=30, rotation=270)
    corners = [f"{x},{y}" for x, y in quad]
    code, _, err = run(
        clip, "--quad", *corners, "--export", tmp_path / "p.nk", "--export", tmp_path / "p.csv", main=entry.track_main
    )
    assert code == 0, err
    track = Track.load(tmp_path / "phone.track.json")
    assert (track.source.width, track.source.height) == (240, 320)
    found = parsers.nuke((tmp_path / "p.nk").read_text(), 240, 320)
    assert list(found) == list(range(1, 7))
    assert max(np.abs(found[i + 1] - track.corners[i]).max() for i in range(6)) < 0.01
    assert max(error(found[i + 1], truth[i]) for i in range(6)) < 1
    assert len(parsers.table((tmp_path / "p.csv").read_text(), 240, 320)) == 6


def test_several_files_at_once(run: Run, saved: Path) -> None:
    files = [saved.with_name(name) for name in ("a.nk", "b.txt", "c.setting")]
    code, out, err = run(
        saved, *files, "--first-frame", 1001, "--size", "64x36", "--lost", "omit", "--json", main=entry.export_main
    )
    assert code == 0, err
    assert json.loads(out)["outputs"] == [str(file) for file in files]
    assert "from3 {64 36}" in files[0].read_text()
    assert "\t1001\t" in files[1].read_text()
    assert "[1004]" not in files[2].read_text()
    code, _, err = run(saved, *files, main=entry.export_main)
    assert code == 2
    assert "--overwrite" in err
    assert run(saved, *files, "--overwrite", main=entry.export_main)[0] == 0


def test_a_format_is_named(run: Run, saved: Path) -> None:
    file = saved.with_name("pin.txt")
    assert run(saved, file, "--format", "ae-power-pin", main=entry.export_main)[0] == 0
    assert "CC Power Pin-0005" in file.read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.xyz"], "no format is known by its ending"),
        (["a.nk", "--size", "big"], "size 'big'"),
        (["a.nk", "--size", "0x4"], "size 0x4"),
        (["a.nk", "--lost", "fade"], "invalid choice: 'fade'"),
        (["a.nk", "--format", "maya"], "format 'maya' is unknown"),
        (["a.nk", "./a.nk"], "same name"),
        (["a.json", "--first-frame", "3"], "makes no difference"),
        (["none/a.nk"], "folder"),
        ([], "FILE"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    run: Run, saved: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(saved.parent)
    code, out, err = run("t.json", *arguments, main=entry.export_main)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert message in err
    assert list(saved.parent.iterdir()) == [saved]


def test_what_cannot_be_exported_is_known_before_tracking(run: Run, tmp_path: Path) -> None:
    clip = clips.make_clip(tmp_path / "c.mp4", clips.numbered(2, 320, 240))
    quad = ["--quad", "100,70", "220,74", "216,166", "102,160"]
    for arguments in (["--export", "x.xyz"], ["--export", "none/x.nk"], ["--size", "9x9"], ["--lost", "omit"]):
        code, _, err = run(clip, *quad, *arguments, main=entry.track_main)
        assert code == 2, err
    assert list(tmp_path.iterdir()) == [clip]
