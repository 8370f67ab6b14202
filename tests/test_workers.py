"""Processes that share a job: results in order, errors, a process that dies, and being stopped."""

import os

import pytest

from ar_demo.errors import InputError, RunError, Stopped
from ar_demo.stopping import StopSignal
from ar_demo.workers import Workers, frame_done


def work(task: tuple[str, int]) -> int:
    what, number = task
    if what == "die":
        os._exit(9)
    if what == "refuse":
        raise InputError("not this")
    for _ in range(number if what == "count" else 10**9):
        frame_done()
    return 2 * number


def test_results_come_in_order_and_frames_are_counted() -> None:
    shown: list[None] = []
    with Workers(2, StopSignal()) as workers:
        assert workers.map(work, [("count", n) for n in (30, 1, 2)], lambda: shown.append(None)) == [60, 2, 4]
        with pytest.raises(InputError, match="not this"):
            workers.map(work, [("refuse", 1)], lambda: None)
    assert len(shown) == 33


def test_a_process_that_dies_is_a_failure() -> None:
    with Workers(1, StopSignal()) as workers, pytest.raises(RunError, match="a process that worked on a part ended"):
        workers.map(work, [("die", 1)], lambda: None)


def test_stopping_ends_them() -> None:
    stop = StopSignal()
    with Workers(1, stop) as workers, pytest.raises(Stopped):
        workers.map(work, [("for ever", 1)], stop.set)
