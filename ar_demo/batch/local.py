"""Tasks done on this machine, some at a time."""

import os
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager
from threading import Event

from .process import Outcome
from .staging import Place
from .task import Task, execute

CORES_A_JOB = 2  # that one keeps busy, about


def usual_workers() -> int:
    """As many jobs at a time as keep this machine busy."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, cores // CORES_A_JOB)


class LocalPool(AbstractContextManager["LocalPool"]):
    """Threads that each watch a process. A context manager; leaving it ends what is under way."""

    def __init__(self, workers: int, place: Place, kept_open: Sequence[int] = ()) -> None:
        """Args: workers: tasks at a time. kept_open: descriptors that the processes hold open."""
        self.capacity, self._place, self._kept_open = workers, place, kept_open
        self._stop = Event()
        self._threads = ThreadPoolExecutor(workers, "job")

    def submit(self, task: Task) -> "Future[Outcome]":
        """See `Pool`."""
        return self._threads.submit(execute, task, self._place, self._stop.is_set, self._kept_open)

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._threads.shutdown(cancel_futures=True)
