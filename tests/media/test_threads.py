"""Decoding ahead and encoding behind: in order, bounded, errors whole, and no thread left."""

import threading
import traceback
import weakref
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo.media.reader import VideoReader
from ar_demo.media.threads import ahead, behind
from ar_demo.media.writer import VideoWriter

from .. import clips


@pytest.fixture(autouse=True)
def _no_thread_is_left() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    assert set(threading.enumerate()) == before


class Item:
    """Something whose life can be watched."""


class Counted:
    """Makes items, and counts how many live at most, and how many it made."""

    def __init__(self, count: int) -> None:
        self.most = self.made = 0
        self.closed_in = ""
        self._count = count
        self._living: weakref.WeakSet[Item] = weakref.WeakSet()

    def items(self) -> Iterator[Item]:
        try:
            for _ in range(self._count):
                item = Item()
                self._living.add(item)
                self.made += 1
                self.most = max(self.most, len(self._living))
                yield item
                del item
        finally:
            self.closed_in = threading.current_thread().name

    @property
    def living(self) -> int:
        return len(self._living)


def failing(count: int, error: BaseException) -> Iterator[int]:
    yield from range(count)
    raise error


def test_items_come_in_order_from_another_thread() -> None:
    names = []

    def numbers() -> Iterator[int]:
        for number in range(100):
            names.append(threading.current_thread().name)
            yield number

    with ahead(numbers(), 3) as taken:
        assert list(taken) == list(range(100))
    assert set(names) == {"ahead"}


def test_any_iterable_will_do() -> None:
    with ahead([1, 2, 3]) as taken:
        assert list(taken) == [1, 2, 3]
    with ahead(()) as nothing:
        assert list(nothing) == []


def test_no_more_than_depth_items_wait() -> None:
    counted = Counted(200)
    with ahead(counted.items(), 4) as taken:
        for item in taken:
            assert isinstance(item, Item)
    assert counted.made == 200
    assert counted.most <= 4 + 2  # and two at the moment when one is let go of and the next taken
    del item
    assert counted.living == 0


def test_the_producer_waits_for_who_takes() -> None:
    counted = Counted(100)
    full = threading.Event()

    def watched() -> Iterator[Item]:
        for item in counted.items():
            if counted.made == 5:
                full.set()
            yield item

    with ahead(watched(), 5):
        assert full.wait(10)
    assert counted.made == 5


@pytest.mark.parametrize("kind", [ValueError, KeyError, SystemExit])
def test_the_producers_error_arrives_whole_and_in_its_place(kind: type[BaseException]) -> None:
    error, got = kind("what was wrong"), []

    def work() -> None:
        with ahead(failing(7, error), 3) as taken:
            for number in taken:
                got.append(number)  # noqa: PERF402

    with pytest.raises(kind) as caught:
        work()
    assert caught.value is error
    assert "failing" in [frame.name for frame in traceback.extract_tb(caught.value.__traceback__)]
    assert got == list(range(7))


@pytest.mark.parametrize("error", [None, ValueError, KeyboardInterrupt])
def test_leaving_early_stops_and_closes_the_iterator(error: type[BaseException] | None) -> None:
    counted = Counted(10**9)

    def work() -> None:
        with ahead(counted.items(), 3) as taken:
            for number, _ in enumerate(taken):
                if number == 5:
                    if error is not None:
                        raise error
                    break

    if error is None:
        work()
    else:
        with pytest.raises(error):
            work()
    assert counted.made <= 6 + 3
    assert counted.closed_in == "ahead"
    assert counted.living == 0


def test_nothing_comes_after_the_end_of_the_context() -> None:
    with ahead(iter(range(100)), 3) as taken:
        assert next(taken) == 0
    assert list(taken) == []


def test_calls_run_in_order_in_another_thread() -> None:
    seen: list[tuple[int, str, str]] = []

    def note(number: int, *, word: str) -> None:
        seen.append((number, word, threading.current_thread().name))

    with behind(note, 3) as later:
        for number in range(100):
            later(number, word="w")
    assert seen == [(number, "w", "behind") for number in range(100)]


def test_no_more_than_depth_calls_wait() -> None:
    counted = Counted(100)
    with behind(lambda item: None, 4) as later:
        for item in counted.items():
            later(item)
            del item
    assert counted.most <= 4 + 3  # one that runs, one that is made, and one being handed over
    assert counted.living == 0


def test_the_caller_waits_while_depth_calls_wait() -> None:
    go = threading.Event()
    done: list[int] = []

    def slow(number: int) -> None:
        assert go.wait(10)
        done.append(number)

    called: list[int] = []

    def call_all() -> None:
        with behind(slow, 2) as later:
            for number in range(10):
                later(number)
                called.append(number)

    caller = threading.Thread(target=call_all)
    caller.start()
    while len(called) < 2:
        caller.join(0.01)
    caller.join(0.1)
    assert len(called) <= 3  # two that wait, one that runs
    go.set()
    caller.join(10)
    assert done == called == list(range(10))


def test_the_writers_error_arrives_whole_at_a_later_call() -> None:
    error = OSError("disk full")
    done = []

    def write(number: int) -> None:
        if number == 3:
            raise error
        done.append(number)

    def work() -> None:
        with behind(write, 2) as later:
            for number in range(100):
                later(number)

    with pytest.raises(OSError, match="disk full") as caught:
        work()
    assert caught.value is error
    assert "write" in [frame.name for frame in traceback.extract_tb(caught.value.__traceback__)]
    assert done == [0, 1, 2]


def test_the_writers_error_arrives_at_the_end_where_no_call_follows() -> None:
    error = OSError("disk full")

    def write(number: int) -> None:
        raise error

    with pytest.raises(OSError, match="disk full") as caught, behind(write) as later:
        later(0)
    assert caught.value is error


def test_an_error_of_the_work_drops_what_waits(caplog: pytest.LogCaptureFixture) -> None:
    begun, go = threading.Event(), threading.Event()
    done = []

    def write(number: int) -> None:
        begun.set()
        assert go.wait(10)
        done.append(number)

    def work() -> None:
        with behind(write, 4) as later:
            for number in range(4):
                later(number)
            assert begun.wait(10)
            threading.Timer(0.05, go.set).start()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == [0]
    assert caplog.text == ""


def test_a_second_error_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    failed = threading.Event()

    def write() -> None:
        failed.set()
        raise OSError("disk full")

    def work() -> None:
        with behind(write) as later:
            later()
            assert failed.wait(10)
            while "disk full" not in [str(error) for error in _raised(later)]:
                pass
            raise ValueError("the work's own")

    with pytest.raises(ValueError, match="own"):
        work()
    assert "disk full" in caplog.text


def _raised(later: object) -> list[BaseException]:
    try:
        later()  # type: ignore[operator]
    except OSError as error:
        return [error]
    return []


def test_a_video_through_three_threads_is_as_through_one(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    images = [np.kron(rng.integers(0, 256, (8, 12, 3)), np.ones((8, 8, 1))).astype(np.uint8) for _ in range(40)]
    source = clips.make_clip(tmp_path / "in.mp4", images)
    one, three = tmp_path / "one.mp4", tmp_path / "three.mp4"
    with VideoReader(source) as reader:  # crf 0 is lossless: x264's choices differ from run to run
        with VideoWriter(one, 96, 64, reader.info.rate, crf=0) as writer:
            for frame in reader.frames():
                writer.write(255 - frame.image, frame.time, frame.duration)
        with (
            ahead(reader.frames()) as frames,
            VideoWriter(three, 96, 64, reader.info.rate, crf=0) as writer,
            behind(writer.write) as write,
        ):
            for frame in frames:
                write(255 - frame.image, frame.time, frame.duration)
    for a, b in zip(VideoReader(one).frames(), VideoReader(three).frames(), strict=True):
        assert (a.time, a.duration) == (b.time, b.duration)
        assert np.array_equal(a.image, b.image)


def test_an_error_leaves_no_half_made_file(tmp_path: Path) -> None:
    source = clips.make_clip(tmp_path / "in.mp4", clips.numbered(40))

    def work() -> None:
        with (
            VideoReader(source) as reader,
            ahead(reader.frames()) as frames,
            VideoWriter(tmp_path / "out.mp4", 96, 64, Fraction(25)) as writer,
            behind(writer.write) as write,
        ):
            for frame in frames:
                write(frame.image, frame.time, frame.duration)
                if frame.index == 20:
                    raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert [path.name for path in tmp_path.iterdir()] == ["in.mp4"]
