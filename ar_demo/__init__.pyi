from .errors import InputError, RunError, Stopped
from .live import LiveSession
from .options import OutputOptions, TrackingOptions
from .pipeline import replace, track
from .progress import Progress
from .results import Result
from .session import Session
from .surface import Keyframe, Moment, Surface, parse_quad
from .tracking.protocol import PlanarTracker
from .tracks import Track

__all__ = [
    "InputError",
    "Keyframe",
    "LiveSession",
    "Moment",
    "OutputOptions",
    "PlanarTracker",
    "Progress",
    "Result",
    "RunError",
    "Session",
    "Stopped",
    "Surface",
    "Track",
    "TrackingOptions",
    "parse_quad",
    "replace",
    "track",
]
