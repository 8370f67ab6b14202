from .errors import InputError, NotFound, RunError, Stopped
from .export.exporting import ExportOptions, export_track
from .export.formats import Exporter
from .export.keys import Keys
from .frame_range import FrameRange
from .importing.loading import load_track
from .joining import join
from .live import LiveSession
from .media.limits import limited
from .media.sequences import ImageSequence
from .options import OutputOptions, TrackingOptions
from .pipeline import replace, track
from .progress import Progress
from .report.report import Report
from .results import Result
from .session import Session
from .surface import Keyframe, Moment, Span, Surface, parse_quad
from .tracking.protocol import PlanarTracker
from .tracks import Track
from .verdict import Limits, Verdict, judge

__all__ = [
    "ExportOptions",
    "Exporter",
    "FrameRange",
    "ImageSequence",
    "InputError",
    "Keyframe",
    "Keys",
    "Limits",
    "LiveSession",
    "Moment",
    "NotFound",
    "OutputOptions",
    "PlanarTracker",
    "Progress",
    "Report",
    "Result",
    "RunError",
    "Session",
    "Span",
    "Stopped",
    "Surface",
    "Track",
    "TrackingOptions",
    "Verdict",
    "export_track",
    "join",
    "judge",
    "limited",
    "load_track",
    "parse_quad",
    "replace",
    "track",
]
