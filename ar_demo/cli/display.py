"""How far the work is, on the terminal or for a program that reads along."""

import json
import sys
import time
from abc import ABC, abstractmethod
from argparse import Namespace
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any

from tqdm import tqdm

from ..progress import Progress
from ..words import counted

SECONDS_BETWEEN_LINES = 5.0
SECONDS_BETWEEN_EVENTS = 0.1
SHARE_OF_THE_REST = 0.8  # that a stage of tracking takes, since it is not known how many come
RENDER = "render"


class Display(AbstractContextManager["Display"]):
    """Listens to progress; this one shows nothing."""

    def __call__(self, event: Progress) -> None:
        """Takes the next event."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Takes note of the end, good or bad."""


class Bar(Display):
    """A bar on stderr for each stage, with frames per second."""

    def __init__(self) -> None:
        self._stage = ""
        self._bar: tqdm[None] | None = None

    def __call__(self, event: Progress) -> None:
        if self._bar is None or event.stage != self._stage:
            self._close()
            self._stage = event.stage
            self._bar = tqdm(total=event.total, desc=event.stage, unit=" frames", file=sys.stderr)
        self._bar.set_postfix_str(event.state or "", refresh=False)
        self._bar.update(event.done - self._bar.n)

    def __exit__(self, *error: Any) -> None:
        self._close()

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None


class _NowAndThen(Display, ABC):
    """Tells events of a stage at intervals, its first and its last among them."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._last: Progress | None = None
        self._told: Progress | None = None
        self._next = 0.0

    def __call__(self, event: Progress) -> None:
        now = time.monotonic()
        if self._last is not None and self._last.stage != event.stage:
            self._tell_last()
            self._next = 0.0
        self._last = event
        if now >= self._next or event.done == event.total:
            self._next = now + self._seconds
            self._told = event
            self.tell(event)

    def __exit__(self, *error: Any) -> None:
        self._tell_last()

    def _tell_last(self) -> None:
        if self._last is not None and self._last is not self._told:
            self._told = self._last
            self.tell(self._last)

    @abstractmethod
    def tell(self, event: Progress) -> None:
        """Tells an event."""


class Lines(_NowAndThen):
    """A line on stderr every few seconds, as for a log file."""

    def __init__(self) -> None:
        super().__init__(SECONDS_BETWEEN_LINES)

    def tell(self, event: Progress) -> None:
        done = counted(event.done, "frame")
        if event.total is not None:
            done = f"{event.done} of {counted(event.total, 'frame')}"
        print(f"{event.stage}: {done}{f', {event.state}' if event.state else ''}", file=sys.stderr, flush=True)


class JsonLines(_NowAndThen):
    """An object on stdout, a line each: stage, done, total (null where it is not known), state of the frame."""

    def __init__(self) -> None:
        super().__init__(SECONDS_BETWEEN_EVENTS)

    def tell(self, event: Progress) -> None:
        content = {"stage": event.stage, "done": event.done, "total": event.total, "state": event.state}
        print(json.dumps(content), flush=True)


class OpenJob(Display):
    """The lines of Open Job Description on stdout: progress in percent, status, and why it failed.

    Tracking takes the first half and rendering the second, or either takes all where it comes alone.
    Source: Open Job Description 2023-09, "How Jobs Are Run", stdout messages.
    """

    def __init__(self, renders: bool) -> None:
        """Args: renders: whether there will be rendering."""
        self._renders, self._stage = renders, ""
        self._percent = self._begin = self._end = 0.0
        self._shown = -1

    def __call__(self, event: Progress) -> None:
        if event.stage != self._stage:
            self._stage, self._begin = event.stage, self._percent
            limit = 50.0 if self._renders and event.stage != RENDER else 100.0
            self._end = limit if event.stage == RENDER else self._begin + SHARE_OF_THE_REST * (limit - self._begin)
            print(f"openjd_status: {event.stage}", flush=True)
        if event.total:
            share = min(event.done / event.total, 1.0)
            self._show(self._begin + share * (self._end - self._begin))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self._show(100.0)
        else:
            reason = " ".join(str(error).split()) or type(error).__name__
            print(f"openjd_fail: {reason}", flush=True)

    def _show(self, percent: float) -> None:
        self._percent = max(self._percent, percent)
        if int(self._percent) > self._shown:
            self._shown = int(self._percent)
            print(f"openjd_progress: {self._shown}", flush=True)


def display_of(given: Namespace, renders: bool) -> Display:
    """What is asked for; without a word a bar, where stderr is a terminal and it shall not be quiet.

    Args:
        renders: whether there will be rendering.
    """
    kind = getattr(given, "progress", None)
    if kind is None:
        return Bar() if sys.stderr.isatty() and "quiet" not in given else Display()
    return {"bar": Bar, "plain": Lines, "json": JsonLines, "openjd": lambda: OpenJob(renders)}[kind]()
