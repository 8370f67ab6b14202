"""Ending of work that is under way, from any thread."""

from collections.abc import Iterable, Iterator
from threading import Event
from typing import TypeVar

from .errors import Stopped

T = TypeVar("T")


class StopSignal:
    """Set by whichever thread; loops look at it before each frame. What it has stopped may be begun again."""

    def __init__(self) -> None:
        self.event = Event()

    def set(self) -> None:
        self.event.set()

    def watch(self, items: Iterable[T]) -> Iterator[T]:
        """The items, until the signal is set.

        Raises:
            Stopped: it is; it counts as heeded then.
        """
        for item in items:
            if self.event.is_set():
                self.event.clear()
                raise Stopped("stopped before it was done: nothing was written")
            yield item
