"""Standard streams that are closed, full, or no longer read: no reason for the work to fail."""

import io
import os
import sys
from contextlib import suppress
from typing import TextIO, cast


class Forgiving(io.TextIOWrapper):
    """A text stream that loses what cannot be written.

    Attributes:
        failed: the first error, None where there was none.
    """

    failed: OSError | None = None

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError as error:
            self.failed = self.failed or error
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self.failed = self.failed or error


def make_harmless() -> None:
    """Leads closed standard streams nowhere, and makes standard output and error forgiving.

    Where a stream is closed, its number would go to the next file that is opened: and what libraries print, into that.
    Streams that were replaced, as tests do, are left alone.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # gets the lowest number that is free: this one
    if sys.stdin is None:
        sys.stdin = open(0, encoding="utf-8")  # noqa: SIM115
    for name, number in (("stdout", 1), ("stderr", 2)):
        stream = cast(TextIO | None, getattr(sys, name))
        if stream is getattr(sys, f"__{name}__") and not isinstance(stream, Forgiving):
            setattr(sys, name, _forgiving(stream, number))


def lost() -> OSError | None:
    """Why what was printed to standard output did not get there; None where it did."""
    with suppress(ValueError):  # closed
        sys.stdout.flush()
    return sys.stdout.failed if isinstance(sys.stdout, Forgiving) else None


def _forgiving(stream: TextIO | None, number: int) -> Forgiving:
    encoding = stream.encoding if stream is not None else "utf-8"
    raw = io.FileIO(number, "wb", closefd=False)
    return Forgiving(cast(io.BufferedWriter, raw), encoding, "backslashreplace", write_through=True)
