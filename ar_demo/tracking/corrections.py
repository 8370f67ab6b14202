"""A finished track with keyframes put in: tracked anew around these, and kept elsewhere."""

from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path

import numpy as np

from ..media.reader import VideoReader
from ..options import Keyframe, Moment, Options, Placing
from ..progress import Progress, counted, silent
from ..track import Track
from .moments import keyframes_of
from .passes import load_trackers, look_back
from .runs import backward_runs, bridge, clear, fix, forward_runs, lay
from .smoothing import segments, smooth
from .sweep import Walker, walk

SAME = 1e-3  # px within which a track passes through a keyframe


def retrack(
    input: Path | str, track: Track, keyframes: Sequence[Keyframe], options: Options, progress: Progress = silent
) -> Track:
    """A track with keyframes put in: tracked anew, and smoothed, next to the keyframes that are new to it.

    New are also keyframes in the track that it does not pass through, as after one was edited in the file. From the
    keyframe or reference frame before such a one to that after it the surface is tracked anew; all else is kept.

    Raises:
        InputError: the track is of another video, or a keyframe is not possible.
    """
    track, n, start = deepcopy(track), len(track), track.reference_frame
    kept = tuple(Keyframe(Moment(frame=i), corners) for i, corners in track.keyframes.items())
    for given in (kept, tuple(keyframes)):
        track.keyframes |= keyframes_of(Placing(keyframes=given), track.quad, start, track.times)
    changed = {i: c for i, c in track.keyframes.items() if not np.abs(track.corners[i] - c).max() < SAME}
    if not changed:
        return track
    forward, back = (
        [run for run in runs if run.anchor in changed or run.stop in changed]
        for runs in (forward_runs(track.given), backward_runs(track.given))
    )
    again = np.zeros(n, bool)
    for run in (*forward, *back):
        low, high = sorted((run.anchor, n - 1 if run.stop is None else run.stop))
        again[low : high + 1] = True

    with VideoReader(input) as reader:
        track.check_belongs_to(Path(input), reader.info.width, reader.info.height)
        [tracker] = load_trackers(options, 1)
        tracker.init(next(reader.frames(start, start + 1)).image, track.quad)
        clear(track, [i for i in np.flatnonzero(again).tolist() if i not in track.given])
        fix(track, changed)
        walker, cuts = Walker(tracker, forward), set(track.cuts)
        if forward:
            first, last = forward[0].anchor, max(n - 1 if run.stop is None else run.stop for run in forward)
            walk(reader.frames(first, last + 1), [walker], cuts, counted(progress, "track", 0, last + 1 - first))
        for run in forward:
            lay(track, run)
        look_back(reader, [walker], [track], [back], cuts, progress)
        for low, high in segments(again.tolist()):
            bridge(track, range(low, high))
        track.warnings = list(dict.fromkeys([*track.warnings, *reader.warnings]))
    return smooth(track, options.smooth, again)
