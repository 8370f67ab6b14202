"""Tracking of surfaces through a video: forward and backward between the frames where their corners are given."""

import logging
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from hdn import Observation, Tracker
from hdn.errors import InputError

from .locating import find, keyframes_of, timed, until_end
from .options import Options, Placing
from .progress import Progress, counted, silent
from .spans import Run, backward_runs, blank, bridge, forward_runs, gap_runs, lay
from .trackfile import Source, Track
from .video import VideoReader
from .walking import Walker, clusters, walk

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
        info = reader.info
        frames = until_end(reader.frames(), options.end)
        times, references, frame = find(input, frames, surfaces, progress)
        starts = [reference.index for reference in references]
        keyframes = [keyframes_of(s, q, start, times) for s, q, start in zip(surfaces, quads, starts, strict=True)]
        trackers = load_trackers(options, len(surfaces))
        seen = {reference.index: Observation(reference.image) for reference in references}
        for tracker, quad, start in zip(trackers, quads, starts, strict=True):
            tracker.init(seen[start], quad)
        del references, seen

        known = [{start: quad, **k} for start, quad, k in zip(starts, quads, keyframes, strict=True)]
        first = min(min(poses) for poses in known)
        if first < frame.index:
            frames = until_end(reader.frames(first), options.end, times[0])
            frame = next(frames)
        forward = [Walker(tracker, forward_runs(poses)) for tracker, poses in zip(trackers, known, strict=True)]
        cuts: set[int] = set()
        walk(timed(chain([frame], frames), times), forward, cuts, counted(progress, "track", first, info.frames))

        source = Source(str(input), info.width, info.height, info.rate, len(times))
        tracks = []
        for start, corners, poses, walker in zip(starts, keyframes, known, forward, strict=True):
            new = blank(source, start, poses[start], times, corners)
            for run in walker.runs:
                lay(new, run)
            tracks.append(new)
        look_back(reader, forward, tracks, [backward_runs(poses) for poses in known], cuts, progress)
        for new in tracks:
            bridge(new, range(len(new)))
            new.warnings = list(reader.warnings)
        return tracks


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
    walkers = [Walker(walker.tracker, runs) for walker, runs in zip(forward, back, strict=True)]
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
        walkers = [Walker(walker.tracker, runs) for walker, runs in zip(forward, gaps, strict=True)]
        show = counted(progress, "fill gaps", 0, max(stops) + 1 - first)
        walk(reader.frames(first, max(stops) + 1), walkers, cuts, show)
        for track, runs in zip(tracks, gaps, strict=True):
            for run in runs:
                lay(track, run)
    for track in tracks:
        track.cuts = sorted(cuts)
