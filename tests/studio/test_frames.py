"""Frames by their numbers, in whichever order they are asked for, of files of all kinds."""

import random
import threading
import time
from collections.abc import Callable, Container, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ar_demo.media.reader import Frame, VideoReader
from ar_demo.studio import benchmark
from ar_demo.studio.errors import Refusal
from ar_demo.studio.frames import Bounded, Frames, FramesModel, Pile
from ar_demo.studio.pictures import from_jpeg

from .. import clips
from .conftest import Studio

COUNT = 120
LAZY = FramesModel(idle_seconds=1e6)  # decodes what is asked for


@pytest.fixture(scope="module")
def numbered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One long group of pictures, with B frames."""
    options = {"preset": "medium", "bf": "3", "sc_threshold": "0"}
    return clips.make_clip(tmp_path_factory.mktemp("n") / "n.mp4", clips.numbered(COUNT), gop=COUNT, options=options)


def number(data: bytes) -> int:
    return clips.number_of(from_jpeg(data))


@pytest.mark.parametrize("order", [lambda r: r, lambda r: r[::-1], lambda r: random.Random(1).sample(r, len(r))])
@pytest.mark.parametrize("model", [LAZY, FramesModel(before_frames=3, block_frames=8, idle_seconds=0.01)])
def test_each_number_has_its_frame(numbered: Path, order: Callable[[list[int]], list[int]], model: FramesModel) -> None:
    with VideoReader(numbered) as reader, Frames(reader, COUNT, model) as frames:
        for index in order([*range(0, COUNT, 3)]):
            assert number(frames.picture(index)) == index
            assert number(frames.picture(index, 32)) == index


def test_frames_of_one_group_come_in_one_pass(numbered: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As thumbnails, which are asked for all at once."""
    with VideoReader(numbered) as reader, Frames(reader, COUNT, LAZY) as frames:
        frames.picture(0)
        assert reader.key_before(COUNT - 1) == 0
        begun: list[int] = []
        decode = reader.frames
        may_go_on = threading.Event()

        def count(start: int, only: Container[int]) -> Iterator[Frame]:
            assert may_go_on.wait(20)
            begun.append(start)
            return decode(start, only=only)

        monkeypatch.setattr(reader, "frames", count)
        wanted = [*range(20, COUNT, 10)]
        with ThreadPoolExecutor(len(wanted)) as pool:
            found = [pool.submit(frames.picture, index, 32) for index in wanted]
            end = time.monotonic() + 20
            while len(frames._waiting) < len(wanted) and time.monotonic() < end:
                time.sleep(0.01)
            may_go_on.set()
            assert [number(each.result()) for each in found] == wanted
        assert len(begun) <= 2  # the first may have begun before the others were asked for


def test_what_was_asked_for_last_comes_first(numbered: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with VideoReader(numbered) as reader, Frames(reader, COUNT, LAZY) as frames:
        frames.picture(0)
        came: list[int] = []
        put = frames._whole.put

        def slowly(index: int, *others: Any) -> None:
            came.append(index)
            time.sleep(0.002)
            put(index, *others)

        monkeypatch.setattr(frames._whole, "put", slowly)
        with ThreadPoolExecutor(2) as pool:
            late = pool.submit(frames.picture, COUNT - 1)
            while COUNT - 1 not in frames._waiting and not late.done():
                time.sleep(0.001)
            soon = pool.submit(frames.picture, 5)
            assert (number(soon.result()), number(late.result())) == (5, COUNT - 1)
        assert not {*range(20, 100)} & {*came}  # what lies between is of no use, and is not converted


def test_a_frame_is_as_high_as_it_is_asked_for(numbered: Path) -> None:
    with VideoReader(numbered) as reader, Frames(reader, COUNT) as frames:
        assert from_jpeg(frames.picture(5)).shape == (64, 96, 3)
        assert from_jpeg(frames.picture(5, 32)).shape == (32, 48, 3)
        assert from_jpeg(frames.picture(5, 500)).shape == (64, 96, 3)  # never more than there is
        for index in (-1, COUNT):
            with pytest.raises(Refusal, match=f"no frame {index}"):
                frames.picture(index)


def test_all_frames_are_kept_while_nothing_is_asked_for(numbered: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with VideoReader(numbered) as reader, Frames(reader, COUNT, FramesModel(idle_seconds=0.01)) as frames:
        end = time.monotonic() + 20
        while not frames.is_filled and time.monotonic() < end:
            time.sleep(0.01)
        monkeypatch.setattr(reader, "frames", None)  # nothing is decoded any more
        assert [number(frames.picture(index)) for index in (119, 0, 60)] == [119, 0, 60]


def test_a_full_disk_and_a_small_one_cost_time_alone(numbered: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with VideoReader(numbered) as reader, Frames(reader, COUNT, FramesModel(most_disk_bytes=1)) as frames:
        assert [number(frames.picture(index)) for index in (100, 99, 3)] == [100, 99, 3]
    pile = Pile()
    monkeypatch.setattr("os.pwrite", lambda *_: 0)
    pile.put(1, b"piece")
    assert pile.get(1) is None
    assert pile.is_full
    pile.close()


def test_a_file_that_breaks_off_is_told(numbered: Path, tmp_path: Path) -> None:
    """Its header promises more frames than there are."""
    broken = tmp_path / "b.mkv"
    clips.make_clip(broken, clips.numbered(60))
    clips.truncated(broken, 0.5)
    with VideoReader(broken) as reader, Frames(reader, 60, FramesModel(idle_seconds=0.01)) as frames:
        assert number(frames.picture(2)) == 2
        with pytest.raises(Refusal, match="cannot be decoded"):
            frames.picture(59)
        assert number(frames.picture(5)) == 5


def test_whoever_jumps_is_shown_what_is_nearest_until_the_frame_comes(
    numbered: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with VideoReader(numbered) as reader, Frames(reader, COUNT, replace(LAZY, patience_seconds=0.05)) as frames:
        decode, may_go_on = reader.frames, threading.Event()

        def slowly(start: int, only: Container[int]) -> Iterator[Frame]:
            for frame in decode(start, only=only):
                yield frame
                assert may_go_on.wait(20)

        monkeypatch.setattr(reader, "frames", slowly)
        shown, picture = frames.near(100, 32, None)
        while picture is None:
            shown, picture = frames.near(100, 32, None)
        assert (shown, number(picture)) == (0, 0), "the key frame before it"
        assert frames.near(100, 32, 0) == (0, None), "nothing nearer than that yet"
        assert [number(frames.rough(index, 32)[1]) for index in (0, 60)] == [0, 0]
        with pytest.raises(Refusal, match="not decoded yet"):
            frames.view(100, 0.05)
        may_go_on.set()
        end = time.monotonic() + 20
        while shown != 100 and time.monotonic() < end:
            shown, picture = frames.near(100, 32, 0)
        assert picture is not None
        assert number(picture) == 100
        while frames.rough(99, 32)[0] != 100 and time.monotonic() < end:
            time.sleep(0.01)  # it is given out before it is kept
        assert frames.rough(99, 32)[0] == 100


def test_a_frame_that_nobody_asks_for_any_more_is_not_decoded(numbered: Path) -> None:
    model = replace(LAZY, patience_seconds=0.0, renewal_seconds=0.0)
    with VideoReader(numbered) as reader, Frames(reader, COUNT, model) as frames:
        frames.near(COUNT - 1, None, None)
        assert number(frames.picture(3)) == 3
        assert [*frames._waiting] == []


def test_the_page_is_told_which_frame_is_near(studio: Studio) -> None:
    near = studio.get("/frames/9", near="3", height=60)
    while near.status_code == 202:
        assert near.headers["cache-control"] == "no-store"
        near = studio.get("/frames/9", near="3", height=60)
    assert near.headers["x-frame"] in "0123456789"
    assert int(studio.get("/frames/9", rough="", height=60).headers["x-frame"]) in range(16)


def test_the_benchmark_tells_of_each_way(numbered: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        benchmark.main(["--help"])
    assert "--scrub" in capsys.readouterr().out
    benchmark.main([str(numbered), "--scrub", "300"])
    told = [line for line in capsys.readouterr().out.splitlines() if not line.startswith("memory ")]
    assert [line.split(":")[0] for line in told[1:4]] == [
        f"{w}, nothing kept" for w in ("forward", "backward", "jumps")
    ]
    assert all(" ms of processor time a frame" in line for line in told[1:])
    assert told[-1].startswith("scrubbing through 300 frames: ")


def test_bounded_keeps_what_was_used_last() -> None:
    kept: Bounded[str] = Bounded(10)
    for key in "abc":
        kept.put(key, key, 4)
    assert (kept.get("a"), kept.get("b"), kept.get("c")) == (None, "b", "c")
    kept.get("b")
    kept.put("d", "d", 6)
    assert (kept.get("b"), kept.get("c"), kept.get("d")) == ("b", None, "d")
    kept.put("d", "D", 6)
    assert kept.get("b") == "b"


def test_the_page_gets_a_frame_with_its_number_and_time(studio: Studio) -> None:
    answer = studio.get("/frames/5", height=120)
    assert answer.headers["content-type"] == "image/jpeg"
    assert (answer.headers["x-frame"], answer.headers["x-time"]) == ("5", "0.200000")
    assert "immutable" in answer.headers["cache-control"]
    image = from_jpeg(answer.content)
    assert image.shape == (120, 160, 3)
    with VideoReader(studio.folder / "street.mp4") as reader:
        [frame] = reader.frames(5, 6)
    exact = from_jpeg(studio.get("/frames/5").content)
    assert np.abs(exact.astype(int) - frame.image).mean() < 3
    for query in ({"height": "0"}, {"height": "-1"}, {"height": "x"}, {"height": "100000"}):
        assert studio.get("/frames/5", **query).status_code == 400
    assert studio.get("/frames/16").status_code == 404
    assert studio.get("/frames/-1").status_code == 404
