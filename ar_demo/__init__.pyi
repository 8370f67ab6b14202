from .errors import InputError, RunError
from .options import Keyframe, Moment, Options, Placing, parse_quad
from .pipeline import Surface, replace, replace_surfaces
from .rendering.loop import render
from .results import Result
from .track import Track
from .tracking.corrections import retrack
from .tracking.passes import track
from .tracking.smoothing import smooth

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
