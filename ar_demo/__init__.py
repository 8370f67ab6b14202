"""Puts an ad on a planar surface of a video."""

from hdn.errors import InputError, RunError

from .options import Moment, Options, parse_quad
from .pipeline import replace
from .rendering import Result, render
from .smoothing import smooth
from .trackfile import Track
from .tracking import track

__all__ = [
    "InputError",
    "Moment",
    "Options",
    "Result",
    "RunError",
    "Track",
    "parse_quad",
    "render",
    "replace",
    "smooth",
    "track",
]
