"""Parts of a video that processes of their own render, and that are joined."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from ar_demo.media.reader import VideoReader
from ar_demo.rendering import parts

from ..clips import make_clip, numbered, sound_packets, tone
from ..conftest import Run

FRAMES = 40
ROWS = "".join(f"{frame},10,10,50,10,50,50,10,50\n" for frame in range(FRAMES))


def test_seams_are_where_groups_of_pictures_begin() -> None:
    edges = [0, 550, 1050, 1560, 2000]
    assert parts.divided(2000, [300, 1310], 2) == [range(a, b) for a, b in pairwise(edges)]
    assert parts.divided(2000, [], 1) == [range(0, 1000), range(1000, 2000)]


@pytest.mark.parametrize(("frames", "processes"), [(1, 8), (249, 8), (499, 8), (1000, 1), (100_000, 64)])
def test_parts_are_all_frames_once(frames: int, processes: int) -> None:
    found = parts.divided(frames, [77, 1111], processes)
    assert [frame for part in found for frame in part] == [*range(frames)]
    assert len(found) <= max(1, 2 * processes)


@pytest.fixture
def clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(parts, "MODEL", replace(parts.MODEL, group_frames=10, least_frames=20))
    make_clip(tmp_path / "in.mp4", numbered(FRAMES), rate=25, sound=tone(FRAMES / 25))
    (tmp_path / "t.csv").write_text("frame,x1,y1,x2,y2,x3,y3,x4,y4\n" + ROWS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_output_is_that_of_one_process(run: Run, clip: Path) -> None:
    given = ["in.mp4", "--effect", "outline", "--track", "t.csv", "--codec", "ffv1", "--quiet"]
    for name, more in (("one.mkv", []), ("two.mkv", ["--parallel", "2", "--progress", "json"])):
        code, out, err = run(*given, "-o", name, *more)
        assert code == 0, err
    assert out.count('"stage": "render"') >= 2
    with VideoReader("one.mkv") as one, VideoReader("two.mkv") as two:
        assert two.times == one.times
        for frame, other in zip(one.frames(), two.frames(), strict=True):
            np.testing.assert_array_equal(frame.image, other.image)
    assert sound_packets(clip / "two.mkv") == sound_packets(clip / "one.mkv")
    assert sorted(file.name for file in clip.iterdir()) == ["in.mp4", "one.mkv", "t.csv", "two.mkv"]


def test_what_is_written_in_one_go_says_so(run: Run, clip: Path) -> None:
    given = ["in.mp4", "--effect", "outline", "--track", "t.csv", "--parallel", "2", "--frames", "0-3"]
    assert run(*given, "-o", "o.mp4")[0] == 2
    code, _, err = run(*given[:-2], "-o", "o.gif")
    assert code == 0
    assert ".gif is written in one go: rendering goes on without --parallel" in err
