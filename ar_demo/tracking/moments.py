"""The frames that a user names: where tracking begins and ends, and those of keyframes."""

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction

from hdn.imaging.arrays import Array
from hdn.imaging.quads import area, is_convex

from ..errors import InputError
from ..media.reader import Frame, VideoReader
from ..options import TrackingOptions
from ..stopping import StopSignal
from ..surface import FIRST, Keyframe, Moment, Surface
from ..words import counted


def until(frames: Iterable[Frame], end: Moment, zero: Fraction) -> Iterator[Frame]:
    """The frames up to and including `end`; zero: the time of the video's first frame, seconds."""
    for frame in frames:
        if end.time is not None and frame.time - zero > end.time:
            return
        yield frame
        if end.frame is not None and frame.index >= end.frame:
            return


def index_of(moment: Moment, times: Sequence[Fraction]) -> int | None:
    """Index of the first frame at or after a moment; None where all of these are before it."""
    return next((i for i, time in enumerate(times) if moment.reached(i, time - times[0])), None)


def starts(
    reader: VideoReader, surfaces: Sequence[Surface], options: TrackingOptions, stop: StopSignal
) -> tuple[list[int], int]:
    """Indices of the surfaces' reference frames, and of the first frame that is to be tracked.

    Where the file has no index, it is decoded as far as the latest frame that the surfaces name.

    Raises:
        InputError: one of these is beyond the end, or outside the span of interest.
    """
    first, end = (options.time and options.time.begin) or FIRST, options.last
    at = [first if surface.start is FIRST else surface.start for surface in surfaces]
    named = [("time", first), *(("start", moment) for moment in at)]
    named += [("keyframe", keyframe.at) for surface in surfaces for keyframe in surface.keyframes]
    zero = reader.times[0]
    if not reader.seekable:
        for frame in until(stop.watch(reader.frames()), end, zero):
            if all(moment.reached(frame.index, frame.time - zero) for _, moment in named):
                break
    times = [time for i, time in enumerate(reader.times) if is_within(end, i, time - zero)]
    for name, moment in named:
        if index_of(moment, times) is None:
            raise InputError(
                f"{name} ({moment}) is beyond the end: {reader.path} has {counted(len(times), 'frame')} up to there"
            )
    begin = index_of(first, times) or 0
    for name, moment in named:
        if (index_of(moment, times) or 0) < begin:
            raise InputError(
                f"{name} ({moment}) is before the time that is tracked, {options.time}: name a frame in it"
            )
    return [index_of(moment, times) or 0 for moment in at], begin


def keyframes_of(keyframes: Sequence[Keyframe], quad: Array, start: int, times: Sequence[Fraction]) -> dict[int, Array]:
    """Keyframes by frame index.

    Args:
        quad: (4, 2) corners in the reference frame, whose index is `start`.
        times: of the frames, seconds.

    Raises:
        InputError: one that cannot be a keyframe.
    """
    found: dict[int, Array] = {}
    for keyframe in keyframes:
        at, corners = keyframe.at, keyframe.corners
        index = index_of(at, times)
        if index is None:
            raise InputError(f"keyframe ({at}) is beyond the end: the track has {counted(len(times), 'frame')}")
        if index == start:
            raise InputError(f"keyframe ({at}) is the frame of the quad itself: give --quad anew to change it")
        if index in found:
            raise InputError(f"two keyframes are given for frame {index}: leave one out")
        if not is_convex(corners) or area(corners) * area(quad) <= 0:
            raise InputError(f"keyframe ({at}) has corners in another order than the quad's, or they cross: mend them")
        found[index] = corners
    return found


def frames_until(end: Moment, times: Sequence[Fraction]) -> int:
    """How many of these frames there are up to the end."""
    return sum(is_within(end, index, time - times[0]) for index, time in enumerate(times))


def is_within(end: Moment, index: int, elapsed: Fraction) -> bool:
    """Whether a frame is not after the end."""
    return (end.frame is None or index <= end.frame) and (end.time is None or elapsed <= end.time)
