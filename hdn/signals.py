"""Ctrl-C, a request to terminate and a terminal that closes all end the work by an exception, so that it cleans up."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Timer, current_thread, main_thread
from types import FrameType
from typing import Any

AT_ONCE_SECONDS = 1.0  # in which further signals mean the one that is being heeded
AGAIN_SECONDS = 0.01  # after which one that was lost comes again

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")  # of which Windows has two


class Ended(KeyboardInterrupt):
    """A signal asked the work to end.

    Attributes:
        number: of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


def numbers() -> list[int]:
    """The signals that ask to end; without those that whoever started this process wants ignored, as nohup does."""
    known = [int(getattr(signal, name)) for name in _NAMES if hasattr(signal, name)]
    return [number for number in known if signal.getsignal(number) != signal.SIG_IGN]


@contextmanager
def heard(act: Callable[[int], object]) -> Iterator[None]:
    """Calls `act` with the number of each signal that asks to end, in the main thread; elsewhere nothing changes."""
    if current_thread() is not main_thread():
        yield  # signals come to the main thread only
        return
    process, usual = os.getpid(), {number: signal.getsignal(number) for number in numbers()}

    def hear(number: int, frame: FrameType | None) -> None:
        if os.getpid() != process:  # a child ends as children do
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        act(number)

    for number in usual:
        signal.signal(number, hear)
    try:
        yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)


@contextmanager
def ending() -> Iterator[None]:
    """Raises `Ended` where a signal asks to end, wherever the main thread is then.

    Not again at once, so that an impatient second Ctrl-C does not end the cleaning up. Where Python cannot let an
    exception through, as in a finaliser, the signal comes again.
    """
    last, usual = -AT_ONCE_SECONDS, sys.unraisablehook

    def end(number: int) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= AT_ONCE_SECONDS:
            last = now
            raise Ended(number)

    def again(unraisable: "sys.UnraisableHookArgs") -> None:
        nonlocal last
        if not isinstance(unraisable.exc_value, Ended):
            usual(unraisable)
            return
        last = -AT_ONCE_SECONDS
        Timer(AGAIN_SECONDS, os.kill, (os.getpid(), unraisable.exc_value.number)).start()

    with heard(end):
        sys.unraisablehook = again
        try:
            yield
        finally:
            sys.unraisablehook = usual


def leaving(message: str) -> Callable[[int], Any]:
    """What ends the process on the spot, with a message: where there is nothing to clean up."""

    def leave(number: int) -> None:
        os.write(2, f"{message}\n".encode())
        os._exit(status(number))

    return leave


def status(number: int) -> int:
    """The exit status of what a signal ended, as shells have it."""
    return 128 + number
