"""Standard output as a place for a stream, and Ctrl-C as a way to end one."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import BinaryIO

from hdn.signals import Ended, heard

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
    """Calls `stop` on Ctrl-C and on a request to terminate; the second time they end the work at once."""
    asked = False

    def ask(number: int) -> None:
        nonlocal asked
        if asked:
            raise Ended(number)
        asked = True
        stop()

    with heard(ask):
        yield
