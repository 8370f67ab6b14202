"""Standard output as a place for a stream, and Ctrl-C as a way to end one."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from types import FrameType
from typing import Any, BinaryIO

from ..errors import InputError


def standard_output() -> BinaryIO:
    """Where a stream goes; what is printed meanwhile goes to stderr, so that it does not get in between."""
    if sys.stdout.isatty():
        raise InputError("the output - is a terminal: lead it into a program or a file, as in | ffplay -")
    pipe = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    sys.stdout = sys.stderr
    return pipe


@contextmanager
def stopped_by_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Calls `stop` on Ctrl-C and on a request to terminate; the second time they act as usual."""
    if current_thread() is not main_thread():
        yield  # signals come to the main thread only
        return
    usual: dict[int, Any] = {}

    def ask(number: int, frame: FrameType | None) -> None:
        stop()
        signal.signal(number, usual[number])

    for number in (int(signal.SIGINT), int(signal.SIGTERM)):
        usual[number] = signal.signal(number, ask)
    try:
        yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)
