"""A stretch of a video that is tracked by itself, in a process of its own, as it would be on the way through all of it.

Frames are known to belong together only up to a scene cut: there a tracker counts its target as lost and searches the
whole frame, and the joint solution ends. So a stretch begins at the first cut in it, or at the first known pose, and
goes on up to the first cut after it, wherever that is; what lies before its first cut belongs to the stretch before. It
looks for the cuts itself. In one thing it differs: its tracker has not seen the frames before, and knows of the
surface's surroundings what its own frames and the reference frame show.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from hdn import Observation, Tracker
from hdn.imaging.arrays import Array, Image
from hdn.imaging.homography import from_corners
from hdn.imaging.regions import Region

from ..media.reader import Frame, VideoReader
from ..media.sequences import ImageSequence
from ..media.threads import ahead
from ..options import TrackingOptions
from ..workers import frame_done
from .cuts import CutDetector
from .protocol import MakeTracker, PlanarTracker, hdn_trackers
from .runs import Run


@dataclass(frozen=True)
class StretchModel:
    """How a video is divided."""

    least_frames: int = 250  # of a stretch: to seek into a video costs up to as many that are decoded in vain
    each_process: int = 3  # stretches for each, since some take longer than others


MODEL = StretchModel()


@dataclass(frozen=True)
class Aim:
    """What a tracker is given to begin with; see `hdn.Tracker.init`."""

    image: Image
    quad: Array
    region: Region
    known: Image | None = None

    def tracker(self, make: MakeTracker) -> PlanarTracker:
        """A tracker that has its target."""
        tracker = make()
        if self.known is None:
            tracker.init(Observation(self.image), self.quad, self.region)
        else:
            assert isinstance(tracker, Tracker)
            tracker.init(Observation(self.image), self.quad, self.region, self.known)
        return tracker


@dataclass(frozen=True)
class Stretch:
    """What one process does.

    Attributes:
        source, options: of the video, and of tracking.
        first, stop: frames first to stop - 1, which runs begin in.
        low, high: frames low to high - 1, which they may go on in.
        backward: whether they come the last one first.
        aims: of the targets.
        runs: of each target, those that begin in the stretch.
        through: of each target the run that comes into it, None for none.
    """

    source: Path | ImageSequence
    options: TrackingOptions
    first: int
    stop: int
    low: int
    high: int
    backward: bool
    aims: Sequence[Aim]
    runs: Sequence[Sequence[Run]]
    through: Sequence[Run | None]


@dataclass(frozen=True)
class Followed:
    """What came of a stretch: each target's runs, the cuts, the frame after the last, and what the reader told."""

    runs: list[list[Run]]
    cuts: set[int]
    end: int
    warnings: list[str]
    is_damaged: bool


def divided(
    source: Path | ImageSequence,
    options: TrackingOptions,
    aims: Sequence[Aim],
    runs: Sequence[Sequence[Run]],
    spans: Sequence[tuple[int, int]],
    backward: bool,
    processes: int,
) -> list[Stretch]:
    """The stretches of a pass.

    Args:
        runs: of each target.
        spans: first and last frame of each part of the video that they go through; a run without a stop ends with it.
    """
    found = []
    for low, last in spans:
        high = last + 1
        count = max(1, min(processes * MODEL.each_process, (high - low) // MODEL.least_frames))
        edges = np.linspace(low, high, count + 1).round().astype(int).tolist()
        for first, stop in pairwise(edges):
            entry = stop - 1 if backward else first
            begun = [[run for run in each if first <= run.anchor < stop] for each in runs]
            through = [next((run for run in each if _comes_into(run, entry, backward)), None) for each in runs]
            if any(begun) or any(through):
                found.append(Stretch(source, options, first, stop, low, high, backward, aims, begun, through))
    return found


def _comes_into(run: Run, entry: int, backward: bool) -> bool:
    """Whether a run began before a frame and goes on there; one that fills a gap ends where the target is lost."""
    if run.fills:
        return False
    if backward:
        return run.anchor > entry >= (run.stop or 0)
    return run.anchor < entry and (run.stop is None or run.stop >= entry)


def follow(stretch: Stretch) -> Followed:
    """Tracks a stretch; the work of a process."""
    reader = _reader(stretch.source)
    make = _trackers(stretch.options)
    followers = [
        _Follower(aim.tracker(make), aim.quad, runs, through)
        for aim, runs, through in zip(stretch.aims, stretch.runs, stretch.through, strict=True)
    ]
    detector, cuts, last, end = CutDetector(), set[int](), -1, -1
    with ahead(_frames(reader, stretch)) as frames:
        for frame in frames:
            is_before = frame.index >= stretch.stop if stretch.backward else frame.index < stretch.first
            is_after = frame.index < stretch.first if stretch.backward else frame.index >= stretch.stop
            seen = Observation(frame.image)
            # What a damaged file shows is now and then like nothing before it.
            cut = not frame.damaged and detector.is_cut(frame.index, seen.grey)
            if cut and not is_before:
                cuts.add(max(frame.index, last))
            last = frame.index
            if is_before:
                continue
            for follower in followers:
                follower.see(frame.index, seen, cut, frame.damaged, is_after)
            if is_after and not any(follower.is_active for follower in followers):
                break
            end = max(end, frame.index)
            if not is_after:  # others count those
                frame_done()
    return Followed([follower.done for follower in followers], cuts, end + 1, reader.warnings, reader.is_damaged)


def _frames(reader: VideoReader, stretch: Stretch) -> Iterator[Frame]:
    """The stretch's frames, the one before it, by which a cut is told, and what comes after it."""
    if not stretch.backward:
        return reader.frames(max(stretch.first - 1, stretch.low), stretch.high, rough=True)
    return reader.backward(min(stretch.stop + 1, stretch.high), stretch.low, rough=True)


class _Follower:
    """A target's tracker on its runs in a stretch. done: the runs that went through frames."""

    def __init__(self, tracker: PlanarTracker, quad: Array, runs: Sequence[Run], through: Run | None) -> None:
        self._tracker, self._quad = tracker, quad
        self._begin = {run.anchor: run for run in runs}
        self._through = through  # which goes on after a cut
        self._current: Run | None = None
        self.done: list[Run] = []

    @property
    def is_active(self) -> bool:
        return self._current is not None

    def see(self, index: int, frame: Observation, cut: bool, damaged: bool, is_after: bool) -> None:
        """Takes the next frame. is_after: whether it lies after the stretch, where nothing begins."""
        if cut and (self._current is None or not self._current.fills):
            self._current = None
            if self._through is not None and not is_after and index not in self._begin:
                self._tracker.lose()
                # The pose is not known: the quad stands for it, and is not looked at.
                self._add(replace(self._through, anchor=index, estimates=[], damaged=set()), frame, damaged)
                return
        elif self._current is not None:
            if cut:
                self._tracker.lose()
            if not self._current.add(self._tracker.track(frame), damaged):
                self._current = self._through = None
        if index in self._begin and not is_after:
            run = self._begin[index]
            self._through = None if run.fills else run
            self._tracker.place(from_corners(self._quad, run.pose))
            self._add(run, frame, damaged)

    def _add(self, run: Run, frame: Observation, damaged: bool) -> None:
        self.done.append(run)
        self._current = run if run.add(self._tracker.track(frame), damaged) else None
        if self._current is None:
            self._through = None


@cache
def _reader(source: Path | ImageSequence) -> VideoReader:
    return VideoReader(source)


@cache
def _trackers(options: TrackingOptions) -> MakeTracker:
    return hdn_trackers(options)
