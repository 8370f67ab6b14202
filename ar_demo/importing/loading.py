"""A track from a file, ours or another program's."""

import logging
from fractions import Fraction
from pathlib import Path

import numpy as np

from hdn.imaging.arrays import Array
from hdn.imaging.quads import is_drawable, side
from hdn.state import State

from ..errors import InputError
from ..media.reader import VideoReader
from ..media.sequences import ImageSequence
from ..tracks import Source, Track
from ..words import counted
from . import after_effects, csv_table, nuke
from .curves import Corners

log = logging.getLogger(__name__)

DEVIATION = 1.0  # px, what corners of another program are taken to be off by


def load_track(path: Path | str, video: Path | str | ImageSequence | None, first_frame: int | None = None) -> Track:
    """Reads a track file; or corners of another program, which get the times of the video.

    Nuke's CornerPin2D, After Effects' keys of Corner Pin and CC Power Pin, and tables as `ar-export` writes them are
    told by what is in the file.

    Args:
        video: the video; only another program's corners need it.
        first_frame: the number of the video's first frame in the other program; None for what the file says, the number
            of an image sequence's first picture, or the program's usual: 1 in Nuke, else 0.

    Raises:
        InputError: the file cannot be read, is none of these, or fits the video in no frame.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot read track file {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a track file (no text): make one with ar-track") from error
    kind = next((k for k in (nuke, after_effects, csv_table) if k.is_ours(text)), None)
    if kind is None:
        if first_frame is not None and text.lstrip().startswith("{"):
            raise InputError(f"first_frame makes no difference to {path}, which counts from 0: leave it out")
        return Track.load(path)
    if video is None:
        raise InputError(f"{path} has corners without a video's times: name the video")
    with VideoReader(video) as reader:
        try:
            corners = kind.read(text, reader.info.width, reader.info.height)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        said = (first_frame, corners.first_frame, reader.first_number, kind.FIRST_FRAME)
        return _of_video(path, corners, reader, next(number for number in said if number is not None))


def _of_video(path: Path, corners: Corners, reader: VideoReader, first_frame: int) -> Track:
    """The track with the video's times."""
    times = _all_times(reader)
    count, info = len(times), reader.info
    placed = np.full((count, 4, 2), np.nan)
    states: list[State] = ["lost"] * count
    for frame, points in corners.points.items():
        index = frame - first_frame
        state = corners.states.get(frame, "held" if frame in corners.between else "tracked")
        if 0 <= index < count and state != "lost":
            placed[index], states[index] = points, state
    if all(state == "lost" for state in states):
        raise InputError(
            f"{path} has keys from frame {min(corners.points)} to {max(corners.points)}, and {reader.path} has frames "
            f"{first_frame} to {first_frame + count - 1}: say with --first-frame which number its first frame has"
        )
    for index in (crossing := [i for i, quad in enumerate(placed) if states[i] != "lost" and not is_drawable(quad)]):
        placed[index], states[index] = np.nan, "lost"
    if all(state == "lost" for state in states):
        raise InputError(f"{path} has no quad in any frame: its corners cross, or lie on a line")
    start = _clearest(placed, info.width, info.height)
    mark = reader.fingerprint(count)
    source = Source(
        reader.given, info.width, info.height, info.rate, count, mark, info.pixel_aspect, reader.first_number
    )
    measured = np.array([state == "tracked" for state in states], np.float64)
    deviation = np.where(measured > 0, DEVIATION, np.inf)
    warnings = _warnings(path, corners, first_frame, count, reader)
    if crossing:
        warnings.append(
            f"{path.name} has corners that cross or lie on a line at {counted(len(crossing), 'frame')}: lost there"
        )
    return Track(source, start, placed[start], times, placed, states, measured, deviation, warnings)


def _all_times(reader: VideoReader) -> list[Fraction]:
    if not reader.seekable:
        for _ in reader.frames():
            pass
    return list(reader.times)


def _clearest(corners: Array, width: int, height: int) -> int:
    """The frame whose quad, wholly inside the picture where one is, is the largest."""

    def rank(index: int) -> tuple[bool, float]:
        quad = corners[index]
        return bool((quad >= 0).all() and (quad <= [width - 1, height - 1]).all()), side(quad)

    return max(np.flatnonzero(np.isfinite(corners).all((1, 2))).tolist(), key=rank)


def _warnings(path: Path, corners: Corners, first_frame: int, count: int, reader: VideoReader) -> list[str]:
    inside = range(first_frame, first_frame + count)
    warnings = list(reader.warnings)
    if beyond := [frame for frame in corners.points if frame not in inside]:
        many = counted(len(beyond), "frame")
        warnings.append(f"{path.name} has corners at {many} that {reader.path.name} does not have: they are left out")
    if between := [frame for frame in corners.between if frame in inside]:
        warnings.append(
            f"{path.name} has no key at {counted(len(between), 'frame')}: corners there are on a line between keys"
        )
    return warnings
