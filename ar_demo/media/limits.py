"""Bounds on what is read, for inputs that come from others: pictures that unpack to gigabytes, streams without end.

They hold for the whole process, since files are opened in many places and threads, and none may be forgotten.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from ..errors import InputError

_PADDING_PIXELS = 1 << 20
_STREAMS = 64  # of a file, whose decoders are bounded while it is looked into


class BeyondLimits(InputError):
    """An input has more frames, or larger pictures, than are allowed."""


@dataclass(frozen=True)
class Limits:
    """None for none.

    Attributes:
        frames: of a video, of a sequence or an ad. pixels: of a picture, width times height.
    """

    frames: int | None = None
    pixels: int | None = None


_current = Limits()


@contextmanager
def limited(frames: int | None = None, pixels: int | None = None) -> Iterator[None]:
    """Refuses inputs beyond these limits for as long as the context lasts, in all threads.

    Args:
        frames: that a video, an image sequence or an ad may have. pixels: that a picture may have; None for any number.
    """
    global _current
    before, _current = _current, Limits(frames, pixels)
    try:
        yield
    finally:
        _current = before


def current() -> Limits:
    """Those that hold."""
    return _current


def check_count(name: object, frames: int) -> None:
    """Raises BeyondLimits where an input has more frames than allowed."""
    if _current.frames is not None and frames > _current.frames:
        raise BeyondLimits(f"{name} has more than {_current.frames} frames: cut it, or allow more with --max-frames")


def check_size(name: object, width: int, height: int) -> None:
    """Raises BeyondLimits where a picture has more pixels than allowed; 0x0: its decoder has refused it."""
    if _current.pixels is not None and width * height == 0:
        raise BeyondLimits(
            f"{name} is damaged, or has more than {_current.pixels} pixels: shrink it, or allow more with --max-pixels"
        )
    if _current.pixels is not None and width * height > _current.pixels:
        raise BeyondLimits(
            f"{name} has {width}x{height} pixels, and no more than {_current.pixels} are allowed: shrink it, or allow "
            "more with --max-pixels"
        )


def for_probing() -> dict[str, Any]:
    """Arguments for `av.open`, by which FFmpeg's decoders refuse much larger pictures while it looks into a file."""
    return {"stream_options": [options] * _STREAMS} if (options := for_decoding()) else {}


def for_decoding() -> dict[str, str]:
    """Options by which FFmpeg's decoders refuse pictures that are much larger.

    They count what they pad a picture with, so they are given some room; `check_size` is exact.
    """
    return {} if _current.pixels is None else {"max_pixels": str(2 * _current.pixels + _PADDING_PIXELS)}
