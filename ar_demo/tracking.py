"""The track loop: one surface through a video, forward and backward from its reference frame."""

import logging
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

from hdn import Tracker
from hdn.errors import InputError
from hdn.homography import Array
from hdn.tracker import Estimate

from .options import Options
from .trackfile import Source, Track
from .video import Frame, VideoReader

log = logging.getLogger(__name__)

# Called after each frame with what is being done, frames done, frames in all if known, and the frame's state.
Progress = Callable[[str, int, int | None, str], None]


def silent(stage: str, done: int, total: int | None, state: str) -> None:
    """A progress callback that shows nothing."""


def track(input: Path | str, options: Options, progress: Progress = silent) -> Track:
    """Tracks the surface of `options.quad` through a video.

    Frames stream: memory does not grow with the video's length.

    Returns:
        The track as measured, not yet smoothed, from the video's first frame to `options.end`.

    Raises:
        InputError: no video, no quad or an impossible one, a reference frame beyond the end, bad weights.
    """
    if options.quad is None:
        raise InputError("tracking needs the surface's corners in the reference frame: give --quad or --track")
    with VideoReader(input) as reader:
        info = reader.info
        frames = until_end(reader.frames(), options)
        times: list[Fraction] = []
        for reference in frames:
            times.append(reference.time)
            if options.start.reached(reference.index, reference.time - times[0]):
                break
            progress("seek", len(times), info.frames, "")
        else:
            raise InputError(f"start ({options.start}) is beyond the end: {input} has {len(times)} frames up to there")
        start = reference.index

        tracker = Tracker(options.weights, options.device)
        log.info("networks run on %s", tracker.engine.description)
        tracker.init(reference.image, options.quad)
        corners, states = [np.asarray(options.quad, np.float64)], ["tracked"]
        confidence = [1.0]
        for frame in frames:
            estimate = tracker.track(frame.image)
            times.append(frame.time)
            corners.append(_pose(estimate))
            states.append(estimate.state)
            confidence.append(estimate.confidence)
            progress("track", start + len(states), info.frames, estimate.state)

        before: list[Estimate] = []
        if start:
            tracker.init(reference.image, options.quad)
            for frame in reader.backward(start):
                before.append(tracker.track(frame.image))
                progress("track back", len(before), start, before[-1].state)
        before.reverse()
        return Track(
            Source(str(input), info.width, info.height, info.rate, len(times)),
            start,
            np.asarray(options.quad, np.float64),
            times,
            np.array([*map(_pose, before), *corners]),
            [*(e.state for e in before), *states],  # type: ignore[list-item]
            np.array([*(e.confidence for e in before), *confidence]),
            list(reader.warnings),
        )


def until_end(frames: Iterator[Frame], options: Options) -> Iterator[Frame]:
    """The frames up to and including `options.end`."""
    first: Fraction | None = None
    for frame in frames:
        first = frame.time if first is None else first
        end = options.end
        if end.time is not None and frame.time - first > end.time:
            return
        yield frame
        if end.frame is not None and frame.index >= end.frame:
            return


def _pose(estimate: Estimate) -> Array:
    return np.full((4, 2), np.nan) if estimate.state == "lost" else estimate.corners
