"""Finding the frames that a user names: where tracking begins and ends, and those of keyframes."""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path

from hdn.imaging.arrays import Array
from hdn.imaging.quads import area, is_convex

from ..errors import InputError
from ..media.reader import Frame
from ..options import Moment, Placing
from ..progress import Progress


def until_end(frames: Iterator[Frame], end: Moment, zero: Fraction | None = None) -> Iterator[Frame]:
    """The frames up to and including `end`; zero: the time of the video's first frame, None takes that of these."""
    for frame in frames:
        zero = frame.time if zero is None else zero
        if end.time is not None and frame.time - zero > end.time:
            return
        yield frame
        if end.frame is not None and frame.index >= end.frame:
            return


def find(
    input: Path | str, frames: Iterator[Frame], surfaces: Sequence[Placing], progress: Progress
) -> tuple[list[Fraction], list[Frame], Frame]:
    """Reads on until all frames that are named by the surfaces are found.

    Returns: the times of the frames read, each surface's reference frame, and the frame that was read last.
    """
    times: list[Fraction] = []
    references: dict[int, Frame] = {}
    named = [("start", s.start) for s in surfaces] + [("keyframe", k.at) for s in surfaces for k in s.keyframes]
    for frame in frames:
        times.append(frame.time)
        elapsed = frame.time - times[0]
        for i, surface in enumerate(surfaces):
            if i not in references and surface.start.reached(frame.index, elapsed):
                references[i] = frame
        named = [(name, moment) for name, moment in named if not moment.reached(frame.index, elapsed)]
        if not named:
            return times, [references[i] for i in range(len(surfaces))], frame
        progress("seek", len(times), None, "")
    name, moment = named[0]
    raise InputError(f"{name} ({moment}) is beyond the end: {input} has {len(times)} frames up to there")


def keyframes_of(surface: Placing, quad: Array, start: int, times: Sequence[Fraction]) -> dict[int, Array]:
    """A surface's keyframes by frame index; raises InputError for what cannot be one."""
    found: dict[int, Array] = {}
    for keyframe in surface.keyframes:
        at, corners = keyframe.at, keyframe.corners
        index = next((i for i, time in enumerate(times) if at.reached(i, time - times[0])), None)
        if index is None:
            raise InputError(f"keyframe ({at}) is beyond the end: the track has {len(times)} frames")
        if index == start:
            raise InputError(f"keyframe ({at}) is the frame of the quad itself: give --quad anew to change it")
        if index in found:
            raise InputError(f"two keyframes are given for frame {index}: leave one out")
        if not is_convex(corners) or area(corners) * area(quad) <= 0:
            raise InputError(f"keyframe ({at}) has corners in another order than the quad's, or they cross: mend them")
        found[index] = corners
    return found


def timed(frames: Iterator[Frame], times: list[Fraction]) -> Iterator[Frame]:
    """Notes the times of frames that are new."""
    for frame in frames:
        if frame.index == len(times):
            times.append(frame.time)
        yield frame
