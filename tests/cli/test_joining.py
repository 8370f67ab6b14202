"""ar-join: from a track over parts to the whole, by the command lines."""

import json
from pathlib import Path

import numpy as np
import pytest

from ar_demo.cli import entry
from ar_demo.media.reader import VideoReader

from ..clips import make_clip, numbered, sound_packets, tone
from ..conftest import Main, Run

FRAMES = 40
ROWS = "".join(f"{frame},10,10,50,10,50,50,10,50\n" for frame in range(FRAMES))


@pytest.fixture
def main() -> Main:
    return entry.join_main


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run) -> Path:
    """A numbered clip, and two parts of it, rendered."""
    make_clip(tmp_path / "in.mp4", numbered(FRAMES), rate=25, sound=tone(FRAMES / 25))
    (tmp_path / "t.csv").write_text("frame,x1,y1,x2,y2,x3,y3,x4,y4\n" + ROWS)
    monkeypatch.chdir(tmp_path)
    for name, frames in (("a.mp4", "0-24"), ("b.mp4", "25-39")):
        given = ["in.mp4", "--effect", "outline", "--track", "t.csv", "--frames", frames, "-o", name, "--quiet"]
        code, _, err = run(*given, main=entry.replace_main)
        assert code == 0, err
    return tmp_path


def test_parts_make_the_whole(run: Run, folder: Path) -> None:
    code, out, err = run("in.mp4", "a.mp4", "b.mp4", "-o", "o.mp4", "--json")
    assert code == 0, err
    assert json.loads(out) == {"output": "o.mp4", "frames": FRAMES, "warnings": []}
    assert [p for _, p in sound_packets(folder / "o.mp4")] == [p for _, p in sound_packets(folder / "in.mp4")]
    with VideoReader("o.mp4") as reader, VideoReader("in.mp4") as source:
        assert reader.times == source.times
        frames = [frame.image for frame in reader.frames()]
    for frame in (frames[0], frames[24], frames[25], frames[39]):  # the outline is there
        assert np.ptp(frame[10, 12:48].astype(int), axis=0).max() < 60


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.mp4"], "the parts have 25 frames, and the video has 40"),
        (["a.mp4", "none.mp4"], "none.mp4 is no part of a video"),
        (["a.mp4", "b.mp4", "--audio", "mix"], "invalid choice: 'mix'"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(run: Run, folder: Path, arguments: list[str], message: str) -> None:
    code, out, err = run("in.mp4", *arguments, "-o", "o.mp4", "--quiet")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert not Path("o.mp4").exists()


def test_an_output_stays_unless_it_is_said(run: Run, folder: Path) -> None:
    Path("o.mp4").write_bytes(b"mine")
    assert run("in.mp4", "a.mp4", "b.mp4", "-o", "o.mp4")[0] == 2
    assert Path("o.mp4").read_bytes() == b"mine"
    assert run("in.mp4", "a.mp4", "b.mp4", "-o", "b.mp4", "--overwrite")[0] == 2  # an input as well
    assert run("in.mp4", "a.mp4", "b.mp4", "-o", "o.mp4", "--audio", "none", "--overwrite")[0] == 0
    with VideoReader("o.mp4") as reader:
        assert not reader.info.has_audio
