"""The ways through one video with the trackers of its surfaces: forward, backward, into gaps, and again."""

import logging
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from hdn import Observation, Tracker
from hdn.imaging.arrays import Array
from hdn.imaging.regions import EVERYWHERE, Region
from hdn.plane.picture import PlanePicture

from ..errors import InputError, RunError
from ..media.reader import IndexDropped, VideoReader
from ..media.threads import ahead
from ..options import TrackingOptions
from ..progress import Listener, Stage
from ..stopping import Steps, StopSignal
from ..surface import Keyframe, Surface
from ..tracks import Source, Track
from ..workers import Workers
from .contradiction import contradicting, leap
from .corrections import merged_keyframes, new_keyframes, tell
from .moments import frames_until, keyframes_of, starts, until
from .pictures import plane_pictures, reference_frame
from .protocol import MakeTracker, PlanarTracker
from .runs import Run, backward_runs, check_runs, fixes_of, forward_runs, gap_runs
from .solution import blank, is_uncertain, may_gain, solve
from .stretches import Aim, divided, follow
from .sweep import Follower, backward_stretches, sweep

log = logging.getLogger(__name__)

MOST_CHECKS = 3  # of places that contradict each other, in a surface's passes
NO_QUAD = "tracking needs the surface's corners in the reference frame: give --quad or --track"


class Undivided(RunError):
    """A video that is better tracked in one process, since the numbers of its frames may be wrong elsewhere."""


@dataclass
class Target:
    """One surface on its ways through the video.

    Attributes:
        tracker: it has its target, by the quad `template` (4, 2), px, of the reference frame or of a better picture.
        start, quad: index of a frame, and the target's corners (4, 2) in it, px.
        keyframes: corners (4, 2) given in other frames, by index.
        track: what is known so far.
        runs: that went through the video.
        region: where tracking may look, in the reference frame.
        aim: what its tracker began with, where other processes track it as well.
    """

    tracker: PlanarTracker
    template: Array
    start: int
    quad: Array
    keyframes: dict[int, Array]
    track: Track | None = None
    region: Region = EVERYWHERE
    runs: list[Run] = field(default_factory=list)
    aim: Aim | None = None

    @property
    def given(self) -> dict[int, Array]:
        """Corners (4, 2) that are not measured but given, by the frame's index."""
        return {self.start: self.quad, **self.keyframes}

    def follower(self, runs: Sequence[Run]) -> Follower:
        return Follower(self.tracker, self.template, runs)

    @property
    def known(self) -> Track:
        """The track; there is one after the first pass."""
        assert self.track is not None
        return self.track


class Passes:
    """Tracks surfaces of one video, in steps of a frame each, between which it may rest.

    Attributes:
        cuts: indices of the frames found so far that begin another shot.
        first: index of the first frame that is to be tracked.
    """

    def __init__(
        self,
        reader: VideoReader,
        make_tracker: MakeTracker,
        options: TrackingOptions,
        listen: Listener,
        stop: StopSignal,
        workers: Workers | None = None,
    ) -> None:
        """Args: workers: that track stretches of it, with HDN's trackers; None does all in this process."""
        self.workers = workers
        self.reader, self.make_tracker, self.options = reader, make_tracker, options
        self.listen, self.stop = listen, stop
        self.cuts: set[int] = set()
        self.first = 0

    def track(self, surfaces: Sequence[Surface]) -> Steps[list[Track]]:
        """Tracks surfaces from their quads, in the frames that the options say.

        Returns:
            The tracks: the joint solution of all that was measured.

        Raises:
            InputError: no quad or an impossible one, a frame named that is beyond the end.
            Stopped: somebody asked to.
        """
        if any(surface.quad is None for surface in surfaces):
            raise InputError(NO_QUAD)
        try:
            targets = yield from self._tracked(surfaces)
        except (Undivided, IndexDropped) as error:
            if self.workers is None:
                raise
            log.warning("%s: tracking it in one process instead", error)
            self.workers, self.cuts = None, set()
            targets = yield from self._tracked(surfaces)
        for target in targets:
            target.known.warnings = [*self.reader.warnings, *target.known.warnings]
            target.known.region = target.region
            tell(target.known)
        return [target.known for target in targets]

    def _tracked(self, surfaces: Sequence[Surface]) -> Steps[list[Target]]:
        targets = self._targets(surfaces)
        yield from self._both_ways(targets)
        yield from self._recheck(targets)
        yield from self._again(targets)
        return targets

    def prepare(self, surfaces: Sequence[Surface]) -> tuple[list[int], int]:
        """Does all that comes before the first pass: the frames of the surfaces' quads, and the first to be tracked.

        Raises:
            InputError: see `track`.
        """
        if any(surface.quad is None for surface in surfaces):
            raise InputError(NO_QUAD)
        return [target.start for target in self._targets(surfaces)] if surfaces else [], self.first

    def correct(self, track: Track, keyframes: Sequence[Keyframe]) -> Steps[Track]:
        """A track with keyframes put in: tracked anew next to the keyframes that are new to it; see `needs_correction`.

        From the keyframe or reference frame before such a one to that after it the surface is tracked anew, and solved
        for together with what the track says; all else is kept.

        Raises:
            InputError: a keyframe is not possible.
        """
        track, n, start = deepcopy(track), len(track), track.reference_frame
        self.first = track.first
        track.keyframes = merged_keyframes(track, keyframes)
        changed = new_keyframes(track, track.keyframes)
        forward, back = (
            [run for run in runs if run.anchor in changed or run.stop in changed]
            for runs in (forward_runs(track.given), backward_runs(track.given, self.first))
        )
        anew = np.zeros(n, bool)
        for run in (*forward, *back):
            low, high = sorted((run.anchor, n - 1 if run.stop is None else run.stop))
            anew[low : high + 1] = True
        anew[[i for i in track.given if i not in changed]] = False

        target = Target(self.make_tracker(), track.quad, start, track.quad, track.keyframes, track=track)
        target.tracker.init(reference_frame(self.reader, start, rough=True), track.quad, track.region)
        self.cuts = set(track.cuts)
        if forward:
            first, last = forward[0].anchor, max(n - 1 if run.stop is None else run.stop for run in forward)
            yield from self._forward([target], [forward], first, last + 1, "track")
        yield from self._back([target], [forward], [back])
        track.cuts = sorted(self.cuts)
        solve(track, target.runs, self.options.smooth, anew)
        track.warnings = list(dict.fromkeys([*self.reader.warnings, *track.warnings]))
        tell(track)
        return track

    def _targets(self, surfaces: Sequence[Surface]) -> list[Target]:
        found, self.first = starts(self.reader, surfaces, self.options, self.stop)
        seen = {start: reference_frame(self.reader, start, rough=True) for start in set(found)}
        targets = []
        for surface, start in zip(surfaces, found, strict=True):
            quad = surface.quad_in(seen[start])
            keyframes = keyframes_of(surface.keyframes, quad, start, self.reader.times)
            tracker = self.make_tracker()
            tracker.init(seen[start], quad, surface.tracking_region)
            region = surface.tracking_region
            aim = Aim(seen[start].image, quad, region)
            targets.append(Target(tracker, quad, start, quad, keyframes, region=region, aim=aim))
        return targets

    def _both_ways(self, targets: Sequence[Target], prefix: str = "") -> Steps[None]:
        """Tracks forward and backward from the known poses, and fills the gaps from both of their ends."""
        first = min(min(target.given) for target in targets)
        forward = [forward_runs(target.given) for target in targets]
        length = yield from self._forward(targets, forward, first, None, prefix + "track")
        info, times = self.reader.info, self.reader.times[:length]
        path, mark = self.reader.given, self.reader.fingerprint(length)
        number = self.reader.first_number
        source = Source(path, info.width, info.height, info.rate, length, mark, info.pixel_aspect, number)
        span = None if self.options.time is None else (self.first, length - 1)
        for target in targets:
            target.track = blank(source, target.start, target.quad, list(times), target.keyframes, span)
        yield from self._back(targets, forward, [backward_runs(target.given, self.first) for target in targets], prefix)
        for target in targets:
            target.known.cuts = sorted(self.cuts)
            solve(target.known, target.runs, self.options.smooth)

    def _recheck(self, targets: Sequence[Target]) -> Steps[None]:
        """Goes both ways from a place that contradicts the track, or from where it leaps, through what that disproves.

        Either side may be wrong: a tracker follows what moves on in front of the surface at first, and loses it, and
        finds the surface. What is right leads to the known poses.
        """
        for check in range(MOST_CHECKS):
            back: list[list[Run]] = [[] for _ in targets]
            forward: list[list[Run]] = [[] for _ in targets]
            for target, before, after in zip(targets, back, forward, strict=True):
                # What has proved wrong goes on to contradict what is right, but that does not leap.
                place = contradicting(target.known, target.runs) if check == 0 else None
                place = place or leap(target.known, target.runs)
                if place is not None:
                    runs = check_runs(*place, target.given, self.first, len(target.known) - 1)
                    before += [run for run in runs if run.backward]
                    after += [run for run in runs if not run.backward]
            doubted = [target for target, *runs in zip(targets, back, forward, strict=True) if any(runs)]
            if not doubted:
                return
            log.info("tracking both ways from a place that contradicts another")
            yield from self._sweep_back(targets, back, "check back")
            if there := list(chain.from_iterable(forward)):
                first, last = min(run.anchor for run in there), max(run.stop or 0 for run in there)
                yield from self._forward(targets, forward, first, last + 1, "check")
            for target in doubted:
                target.known.cuts = sorted(self.cuts)
                solve(target.known, target.runs, self.options.smooth)

    def _again(self, targets: Sequence[Target]) -> Steps[None]:
        """Tracks again what is uncertain and is seen more clearly later on than at first, with a picture of that.

        It goes from the frame that shows the target best, whose pose was measured, and is no surer than that.
        """
        old = [target for target in targets if is_uncertain(target.known) and isinstance(target.tracker, Tracker)]
        if not old:
            return
        pictures = yield from plane_pictures(self.reader, [target.known for target in old], self.listen)
        better = [
            (target, picture)
            for target, picture in zip(old, pictures, strict=True)
            if picture.is_better and may_gain(target.known, picture.deviation)
        ]
        new = [self._with_picture(target, picture) for target, picture in better]
        if not new:
            return
        log.info("tracking again, with a picture of what was seen more clearly than in the reference frame")
        yield from self._both_ways(new, "again: ")
        for (target, picture), other in zip(better, new, strict=True):
            for run in other.runs:
                run.template_deviation = picture.deviation
            target.runs += other.runs
            target.known.cuts = other.known.cuts
            solve(target.known, target.runs, self.options.smooth)

    def _with_picture(self, target: Target, picture: PlanePicture) -> Target:
        """The same target, whose tracker compares with a picture."""
        tracker = self.make_tracker()
        assert isinstance(tracker, Tracker)
        region = target.region.transformed(np.asarray(np.linalg.inv(picture.to_reference)))
        tracker.init(Observation(picture.image), picture.quad, region, picture.on_plane)
        aim = Aim(picture.image, picture.quad, region, picture.on_plane)
        return Target(tracker, picture.quad, picture.index, picture.corners, target.keyframes, aim=aim)

    def _forward(
        self, targets: Sequence[Target], runs: Sequence[Sequence[Run]], first: int, stop: int | None, stage: str
    ) -> Steps[int]:
        """Shows the frames first to stop - 1, or to the end for None, to the surfaces' runs.

        Returns:
            Index of the frame after the last that was seen.
        """
        if self.workers is not None:
            last = self._frames_in_all() - 1 if stop is None else stop - 1
            return self._divided(targets, runs, [(first, last)], False, stage)
        for target, r in zip(targets, runs, strict=True):
            target.runs += r
        followers = [target.follower(r) for target, r in zip(targets, runs, strict=True)]
        show = Stage(self.listen, stage, first if stop is None else 0, self._total(first, stop))
        with ahead(self.reader.frames(first, stop, rough=True)) as read:
            frames = read if stop is not None else until(read, self.options.last, self.reader.times[0])
            return (yield from sweep(frames, followers, self.cuts, show))

    def _total(self, first: int, stop: int | None) -> int | None:
        """Frames that a pass goes through, or all of the video's for one to the end, as far as that is known."""
        if stop is not None:
            return stop - first
        return self._frames_in_all() if self.reader.seekable else self.reader.info.frames

    def _frames_in_all(self) -> int:
        """Frames up to the last that is tracked."""
        return frames_until(self.options.last, self.reader.times)

    def _divided(
        self,
        targets: Sequence[Target],
        runs: Sequence[Sequence[Run]],
        spans: Sequence[tuple[int, int]],
        backward: bool,
        stage: str,
    ) -> int:
        """Has other processes do a pass, each a stretch of it.

        Args: spans: first and last frame of each part of the video that the runs go through.

        Returns:
            Index of the frame after the last that was seen.

        Raises:
            Undivided: the file is damaged.
        """
        assert self.workers is not None
        aims = [target.aim for target in targets if target.aim is not None]
        source, count = self.reader.source, self.workers.count
        stretches = divided(source, self.options, aims, runs, spans, backward, count)
        show = Stage(self.listen, stage, 0, sum(last + 1 - low for low, last in spans))
        followed = self.workers.map(follow, stretches, show)
        if any(found.is_damaged for found in followed):
            raise Undivided(f"{self.reader.path.name} is damaged")
        for found in followed:
            self.reader.take_note(found.warnings)
            self.cuts |= found.cuts
            for target, each in zip(targets, found.runs, strict=True):
                target.runs += each
        return max((found.end for found in followed), default=0)

    def _back(
        self, targets: Sequence[Target], forward: Sequence[list[Run]], back: Sequence[list[Run]], prefix: str = ""
    ) -> Steps[None]:
        """After the runs forward: those backward, and gaps that they or these leave, looked at from their other end."""
        for target, gone, runs in zip(targets, forward, back, strict=True):
            if gone and gone[-1].stop is None:
                last = len(target.known) - 1
                runs += gap_runs(fixes_of(target.runs, target.given), max(target.given), last, backward=True)
        yield from self._sweep_back(targets, back, prefix + "track back")
        gaps = []
        for target, runs in zip(targets, back, strict=True):
            first = min(target.given)
            to_beginning = any(run.anchor == first and run.stop == self.first and not run.fills for run in runs)
            fixes = fixes_of(target.runs, target.given)
            gaps.append(gap_runs(fixes, self.first, first, backward=False) if to_beginning else [])
        if stops := [run.stop or 0 for runs in gaps for run in runs]:
            first = min(run.anchor for runs in gaps for run in runs)
            yield from self._forward(targets, gaps, first, max(stops) + 1, prefix + "fill gaps")

    def _sweep_back(self, targets: Sequence[Target], runs: Sequence[Sequence[Run]], stage: str) -> Steps[None]:
        """Shows the frames of the surfaces' backward runs to them, the last one first."""
        stretches = backward_stretches(chain.from_iterable(runs))
        if self.workers is not None:
            self._divided(targets, runs, stretches, True, stage)
            return
        for target, r in zip(targets, runs, strict=True):
            target.runs += r
        followers = [target.follower(r) for target, r in zip(targets, runs, strict=True)]
        show = Stage(self.listen, stage, 0, sum(high + 1 - low for low, high in stretches))
        for low, high in stretches:
            with ahead(self.reader.backward(high + 1, low, rough=True)) as frames:
                yield from sweep(frames, followers, self.cuts, show)
