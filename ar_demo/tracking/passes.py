"""Tracking of surfaces through a video: forward and backward between the frames where their corners are given."""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from pathlib import Path

import numpy as np

from hdn import Observation, Tracker
from hdn.better_template import TemplateBuilder
from hdn.imaging.arrays import Array

from ..errors import InputError
from ..media.reader import Frame, VideoReader
from ..options import Options, Placing
from ..progress import Progress, counted, renamed, silent
from ..track import Source, Track
from .moments import find, keyframes_of, timed, until_end
from .runs import Run, backward_runs, blank, bridge, forward_runs, gap_runs, is_uncertain, join, lay
from .sweep import Walker, clusters, walk

log = logging.getLogger(__name__)


def track(input: Path | str, options: Options, progress: Progress = silent) -> Track:
    """Tracks the surface of `options.quad` through a video.

    Frames stream: memory does not grow with the video's length.

    Returns:
        The track as measured, not yet smoothed, from the video's first frame to `options.end`.

    Raises:
        InputError: no video, no quad or an impossible one, a frame named that is beyond the end, bad weights.
    """
    return track_surfaces(input, [options], options, progress)[0]


def track_surfaces(
    input: Path | str, surfaces: Sequence[Placing], options: Options, progress: Progress = silent
) -> list[Track]:
    """Tracks several surfaces of a video, which is decoded once for all of them; see `track`."""
    quads = [np.asarray(surface.quad, np.float64) for surface in surfaces if surface.quad is not None]
    if len(quads) < len(surfaces):
        raise InputError("tracking needs the surface's corners in the reference frame: give --quad or --track")
    with VideoReader(input) as reader:
        frames = until_end(reader.frames(), options.end)
        times, references, frame = find(input, frames, surfaces, progress)
        starts = [reference.index for reference in references]
        keyframes = [keyframes_of(s, q, start, times) for s, q, start in zip(surfaces, quads, starts, strict=True)]
        trackers = load_trackers(options, len(surfaces))
        seen = {reference.index: Observation(reference.image) for reference in references}
        targets = []
        for tracker, quad, start, corners in zip(trackers, quads, starts, keyframes, strict=True):
            tracker.init(seen[start], quad)
            targets.append(Target(tracker, start, quad, corners, TemplateBuilder(seen[start], quad)))
        del references, seen

        if earliest(targets) < frame.index:
            frames = until_end(reader.frames(earliest(targets)), options.end, times[0])
            frame = next(frames)
        tracks = both_ways(reader, str(input), chain([frame], frames), targets, times, progress)
        learn(reader, targets, tracks, options, progress)
        for new in tracks:
            bridge(new, range(len(new)))
            new.warnings = list(reader.warnings)
        return tracks


@dataclass
class Target:
    """What is tracked on one way through the video, and from where.

    Attributes:
        tracker: it has its target; start, quad: a frame's index and the corners (4, 2) in it.
        keyframes: corners known in other frames.
        builder: puts a better template together from the target's good views; None where none is to be.
    """

    tracker: Tracker
    start: int
    quad: Array
    keyframes: dict[int, Array]
    builder: TemplateBuilder | None = None

    @property
    def known(self) -> dict[int, Array]:
        return {self.start: self.quad, **self.keyframes}


def earliest(targets: Sequence[Target]) -> int:
    """Index of the first frame with a known pose."""
    return min(min(target.known) for target in targets)


def both_ways(
    reader: VideoReader,
    path: str,
    frames: Iterator[Frame],
    targets: Sequence[Target],
    times: list[Fraction],
    progress: Progress,
) -> list[Track]:
    """Tracks forward and backward from the known poses, and fills the gaps from both of their ends.

    Args:
        path: of the video, as the tracks shall name it.
        frames: from the earliest with a known pose on.
        times: of the frames read so far; is added to.
    """
    info, first = reader.info, earliest(targets)
    forward = [Walker(target.tracker, forward_runs(target.known), target.builder) for target in targets]
    cuts: set[int] = set()
    walk(timed(frames, times), forward, cuts, counted(progress, "track", first, info.frames))

    source = Source(path, info.width, info.height, info.rate, len(times))
    tracks = []
    for target, walker in zip(targets, forward, strict=True):
        new = blank(source, target.start, target.quad, times, target.keyframes)
        for run in walker.runs:
            lay(new, run)
        tracks.append(new)
    look_back(reader, forward, tracks, [backward_runs(target.known) for target in targets], cuts, progress)
    return tracks


def learn(
    reader: VideoReader, targets: Sequence[Target], tracks: Sequence[Track], options: Options, progress: Progress
) -> None:
    """Tracks again what is uncertain and was seen more clearly later than at first, with a template made of that.

    It goes from the frame that shows the target best; a pose that is more certain then replaces the one there.
    """
    again: list[Target] = []
    old: list[Track] = []
    for target, track in zip(targets, tracks, strict=True):
        learnt = target.builder.build() if target.builder is not None and is_uncertain(track) else None
        if learnt is not None:
            tracker = Tracker(engine=target.tracker.engine)
            tracker.init(learnt.image, learnt.quad)
            again.append(Target(tracker, learnt.index, learnt.corners, target.keyframes))
            old.append(track)
    if again:
        log.info("tracking again, with a template of what was seen more clearly after the reference frame")
        times = tracks[0].times
        frames = until_end(reader.frames(earliest(again)), options.end, times[0])
        new = both_ways(reader, tracks[0].source.path, frames, again, times, renamed(progress, "again: "))
        for track, other, target in zip(old, new, again, strict=True):
            # The pose it began with was measured as well, and as surely as the one beside it.
            beside = target.start + (1 if target.start + 1 < len(track) else -1)
            for values in (other.confidence, other.deviation):
                values[target.start] = values[beside]
            join(track, other)


def load_trackers(options: Options, count: int) -> list[Tracker]:
    """Trackers that share one set of networks."""
    first = Tracker(options.weights, options.device)
    log.info("networks run on %s", first.engine.description)
    return [first, *(Tracker(engine=first.engine) for _ in range(count - 1))]


def look_back(
    reader: VideoReader,
    forward: Sequence[Walker],
    tracks: Sequence[Track],
    back: Sequence[list[Run]],
    cuts: set[int],
    progress: Progress,
) -> None:
    """After the runs forward: those backward, and gaps that they or these leave, looked at from their other end."""
    for walker, track, runs in zip(forward, tracks, back, strict=True):
        if walker.runs and walker.runs[-1].stop is None:
            runs += gap_runs(track, max(track.given), len(track) - 1, backward=True)
    walkers = [Walker(walker.tracker, runs, walker.builder) for walker, runs in zip(forward, back, strict=True)]
    stretches = clusters(chain.from_iterable(back))
    show = counted(progress, "track back", 0, sum(high + 1 - low for low, high in stretches))
    for low, high in stretches:
        walk(reader.backward(high + 1, low), walkers, cuts, show)
    gaps = []
    for track, walker in zip(tracks, walkers, strict=True):
        for run in walker.runs:
            lay(track, run)
        to_beginning = any(run.end is None for run in walker.runs)
        gaps.append(gap_runs(track, 0, min(track.given), backward=False) if to_beginning else [])
    if stops := [run.stop or 0 for runs in gaps for run in runs]:
        first = min(run.anchor for runs in gaps for run in runs)
        walkers = [Walker(walker.tracker, runs, walker.builder) for walker, runs in zip(forward, gaps, strict=True)]
        show = counted(progress, "fill gaps", 0, max(stops) + 1 - first)
        walk(reader.frames(first, max(stops) + 1), walkers, cuts, show)
        for track, runs in zip(tracks, gaps, strict=True):
            for run in runs:
                lay(track, run)
    for track in tracks:
        track.cuts = sorted(cuts)
