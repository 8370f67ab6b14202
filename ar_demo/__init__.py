"""Puts an ad on a planar surface of a video."""

from importlib import import_module
from typing import TYPE_CHECKING

from hdn.errors import InputError, RunError

if TYPE_CHECKING:
    from .options import Keyframe, Moment, Options, Placing, parse_quad
    from .pipeline import Surface, replace, replace_surfaces
    from .rendering import Result, render
    from .retracking import retrack
    from .smoothing import smooth
    from .trackfile import Track
    from .tracking import track
else:  # loaded when first asked for, since the libraries take seconds

    def __getattr__(name: str) -> object:
        for module, names in _HOMES.items():
            if name in names:
                return getattr(import_module(module, __name__), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


_HOMES = {
    ".options": ("Keyframe", "Moment", "Options", "Placing", "parse_quad"),
    ".pipeline": ("Surface", "replace", "replace_surfaces"),
    ".rendering": ("Result", "render"),
    ".retracking": ("retrack",),
    ".smoothing": ("smooth",),
    ".trackfile": ("Track",),
    ".tracking": ("track",),
}

__all__ = [
    "InputError",
    "Keyframe",
    "Moment",
    "Options",
    "Placing",
    "Result",
    "RunError",
    "Surface",
    "Track",
    "parse_quad",
    "render",
    "replace",
    "replace_surfaces",
    "retrack",
    "smooth",
    "track",
]
