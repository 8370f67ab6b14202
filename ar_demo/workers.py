"""Processes that share one job on one machine: they tell how far they are, and end with whoever started them."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_EXCEPTION, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from functools import partial
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait as wait_for
from threading import Thread
from typing import Any, TypeVar

from .errors import RunError
from .stopping import StopSignal

T = TypeVar("T")
Task = TypeVar("Task")

LOOK_SECONDS = 0.1  # from one look at what the processes tell to the next

_done: Any = (
    None  # of a process that works: how many frames each has done, which of them it is, and whether it shall stop
)
_slot = 0
_stop: Any = None


class Workers(AbstractContextManager["Workers"]):
    """So many processes, which are started when there is work and go on until the context ends."""

    def __init__(self, count: int, stop: StopSignal) -> None:
        """Args: stop: ends the work, see `map`."""
        context = get_context("spawn")  # a fork would copy threads' locks
        self.count = count
        self._done, self._ending, self._stop = context.RawArray("q", count), context.Event(), stop
        self._shown = 0
        self._pool = ProcessPoolExecutor(count, context, _begin, (self._done, context.Value("i", 0), self._ending))

    def map(self, work: Callable[[Task], T], tasks: Iterable[Task], show: Callable[[], object]) -> list[T]:
        """What the work gives for each task, in their order.

        Args:
            work: a function of a module; it, the tasks and what comes of them go from process to process. It calls
                `frame_done` after each frame.
            show: called for each frame that is done.

        Raises:
            Stopped: the signal was set.
            RunError: a process ended, as one that the system has no memory for.
            Exception: what the work raised, of one that did.
        """
        try:
            futures = [self._pool.submit(work, task) for task in tasks]
            left = set(futures)
            while left:
                done, left = wait(left, LOOK_SECONDS, FIRST_EXCEPTION)
                self._show(show)
                for future in done:
                    future.result()
            self._show(show)
            return [future.result() for future in futures]
        except BrokenProcessPool as error:
            raise RunError(
                "a process that worked on a part ended: there may be too little memory for so many, give a smaller "
                "--parallel (from Python: the program's own part belongs under if __name__ == '__main__')"
            ) from error

    def _show(self, show: Callable[[], object]) -> None:
        done = sum(self._done)
        for _ in self._stop.watch(range(self._shown, done)):
            show()
        self._shown = done
        list(self._stop.watch([None]))

    def __exit__(self, *error: object) -> None:
        self._ending.set()
        self._pool.shutdown(cancel_futures=True)


def frame_done() -> None:
    """Tells that a frame is done, from within work.

    Raises:
        RunError: the work is to end.
    """
    if _stop is not None:
        if _stop.is_set():
            raise RunError("stopped")
        _done[_slot] += 1


def _begin(done: Any, begun: Any, stop: Any) -> None:
    """What each process does first."""
    global _done, _slot, _stop
    with begun.get_lock():
        _slot, begun.value = begun.value, begun.value + 1
    _done, _stop = done, stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends it to all, and whoever started them decides
    logging.getLogger().addHandler(logging.NullHandler())  # what is worth telling comes back with the work
    Thread(target=partial(_end_with, parent_process()), daemon=True).start()


def _end_with(parent: Any) -> None:
    wait_for([parent.sentinel])
    os._exit(1)
