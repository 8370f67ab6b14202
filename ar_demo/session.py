"""A session: one video, from opening to the finished output."""

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from dataclasses import replace as changed
from fractions import Fraction
from inspect import GEN_CLOSED, getgeneratorstate
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from hdn.networks.engine import Engine
from hdn.networks.loading import load_engine
from hdn.plane.picture import PlanePicture

from .choices import Backend
from .compositing.compositor import open_compositor
from .errors import InputError, Stopped
from .finding.pictures import Picture, read_pictures
from .finding.search import Found, search
from .finding.surfaces import Wanted
from .frame_range import FrameRange
from .media.claims import Claim, check_name, claimed
from .media.codecs import holds_sound, is_picture
from .media.joining import is_joinable, join
from .media.mattes import GivenMatte
from .media.numbering import Numbering
from .media.reader import IndexDropped, VideoReader
from .media.sequences import ImageSequence, pictures_of
from .media.space import warn_of_space
from .media.streams import Streams
from .media.threads import ahead, behind
from .media.writer import VideoWriter
from .options import OutputOptions, TrackingOptions
from .progress import Listener, Stage, silent
from .rendering.loop import Renderer, run_up
from .rendering.outputs import OF_SOUND, Outputs, OutputWriters
from .rendering.painting import check_ad
from .rendering.parts import divided
from .rendering.preview import Preview
from .rendering.steady import SteadyView
from .rendering.study import Frames
from .results import Plan, Result, total
from .stopping import Steps, StopSignal
from .surface import FIRST, Moment, Span, Surface
from .tracking.corrections import needs_correction
from .tracking.moments import frames_until, index_of, is_within, until
from .tracking.passes import Passes
from .tracking.pictures import plane_pictures
from .tracking.protocol import MakeTracker, hdn_trackers
from .tracks import Track
from .verdict import judge
from .words import counted
from .workers import Workers, frame_done

log = logging.getLogger(__name__)

T = TypeVar("T")

TIME_TOLERANCE = Fraction(1, 500)  # s: times in a track file are rounded


class Session(AbstractContextManager["Session"]):
    """One video that surfaces are tracked in and ads are laid on.

    `stop()`, from any thread, ends whatever is under way: it raises `Stopped`, and leaves nothing half made. Tracking
    that was stopped goes on where it was when the same is tracked next.

    Example:
        with Session("street.mp4", listen=print) as session:
            surfaces = session.track([Surface("ad.mp4", parse_quad("100,80 300,80 300,240 100,240"))])
            session.render(surfaces, "out.mp4")
    """

    def __init__(
        self, input: Path | str | ImageSequence, listen: Listener = silent, make_tracker: MakeTracker | None = None
    ) -> None:
        """Args:
            input: the video; or pictures, see `ImageSequence.find`.
            listen: called after each frame.
            make_tracker: makes a tracker for each surface; None makes HDN's, as the options for tracking say.

        Raises:
            InputError: the video cannot be read.
        """
        self.listen = listen
        self.reader = VideoReader(input)
        self._make_tracker, self._is_hdn = make_tracker, False
        self._stop = StopSignal()
        self._resting: _Resting | None = None

    def __exit__(self, *error: Any) -> None:
        self._rest(None)
        self.reader.close()

    def stop(self) -> None:
        """Ends tracking or rendering before the next frame, or the next that is begun; may be called from any thread.

        Once it has ended something, the session can be used again. If `track` is called next for the same surfaces with
        the same options, it goes on with the frame before which it was stopped, whatever else was done meanwhile; with
        `parallel` it begins anew.
        """
        self._stop.set()

    @property
    def stopping(self) -> StopSignal:
        """What `stop` sets, for work that belongs to this and is done elsewhere, as `Report.of`."""
        return self._stop

    def find(self, pictures: Sequence[Path | str], options: TrackingOptions | None = None) -> Found:
        """Where and when the video shows pictures: files, or folders of them.

        Raises:
            InputError: a file is no picture or shows too little, the time is beyond the end.
            Stopped: see `stop`.
        """
        return self._search(read_pictures(pictures), options or TrackingOptions())

    def located(self, surfaces: Sequence[Surface], options: TrackingOptions | None = None) -> list[Surface]:
        """The surfaces, those that have to be found by a picture with their quads instead: one for each copy of it.

        Raises:
            InputError: see `find`.
            NotFound: a picture is not seen, or never wholly inside the frame.
            Stopped: see `stop`.
        """
        wanted = Wanted(surfaces)
        if not wanted.pictures:
            return list(surfaces)
        return wanted.located(self._search(wanted.pictures, options or TrackingOptions()))

    def _search(self, pictures: Sequence[Picture], options: TrackingOptions) -> Found:
        def load() -> Engine:
            return load_engine(options.weights, options.device)

        return self._numbered_rightly(lambda: search(self.reader, pictures, options, load, self.listen, self._stop))

    def track(self, surfaces: Sequence[Surface], options: TrackingOptions | None = None) -> list[Surface]:
        """The surfaces with their tracks, as smooth as the options say.

        Those without one are tracked, all in one pass over the video; those that are to be found by a picture are found
        before, see `located`, and may become several. A track that was not made with all of its
        keyframes is tracked anew next to these, and stays as it is elsewhere.

        Raises:
            InputError: no quad or an impossible one, a track of another video, a frame named that is beyond the end.
            NotFound: see `located`.
            Stopped: see `stop`.
        """
        options = options or TrackingOptions()
        surfaces = self.located(surfaces, options)
        surfaces = self._fitting(surfaces, options)
        return self._numbered_rightly(lambda: self._track(surfaces, options))

    def plan(self, surfaces: Sequence[Surface], options: TrackingOptions, outputs: Sequence[Path]) -> Plan:
        """What `track` would do, once all has been checked that can be without it.

        Args:
            outputs: files that would be written.

        Raises:
            InputError: see `track`.
        """
        surfaces = self._fitting(self.located(surfaces, options), options)
        passes, info = self._passes(options), self.reader.info
        starts, first = passes.prepare([surface for surface in surfaces if surface.track is None])
        at, told = iter(starts), []
        times = self.reader.times
        last = [i for i, time in enumerate(times) if is_within(options.last, i, time - times[0])][-1]
        for surface in surfaces:
            track = surface.track
            if track is not None:
                needs_correction(track, surface.keyframes)
            told.append(
                {
                    "ad": surface.name,
                    "quad_frame": next(at) if track is None else track.reference_frame,
                    "first": first if track is None else track.first,
                    "last": (last if self.reader.seekable else None) if track is None else track.last,
                    "states": None if track is None else track.counts,
                }
            )
        frames = len(times) if self.reader.seekable else info.frames
        tracks = [surface.track for surface in surfaces if surface.track is not None]
        of_video = self.reader.warnings
        warnings = list(dict.fromkeys([*tracks_warnings(tracks, of_video), *of_video]))
        size = info.width, info.height
        return Plan(self.reader.path, size, float(info.rate), frames, told, list(outputs), warnings)

    def _fitting(self, surfaces: Sequence[Surface], options: TrackingOptions) -> Sequence[Surface]:
        """The surfaces, those with a track within the span.

        Raises:
            InputError: a track of another video, or without a frame in the span.
        """
        for surface in surfaces:
            if surface.track is not None:
                check_belongs_to(surface.track, self.reader)
        return surfaces if options.time is None else [_within(surface, options.time) for surface in surfaces]

    def _track(self, surfaces: Sequence[Surface], options: TrackingOptions) -> list[Surface]:
        new = [surface for surface in surfaces if surface.track is None]
        measured: Iterator[Track] = iter(())
        if new:
            with self._workers(options) as workers:
                passes = self._passes(options, workers)
                measured = iter(self._go_on(new, options, lambda: passes.track(new)))
        return [
            changed(
                surface, quad=None, snap=False, start=FIRST, region=None, exclude=(), track=next(measured).as_saved()
            )
            if surface.track is None
            else changed(surface, track=self._corrected(surface, surface.track, options))
            for surface in surfaces
        ]

    def check(
        self,
        surfaces: Sequence[Surface],
        outputs: Outputs,
        options: OutputOptions | None = None,
        end: Moment | None = None,
    ) -> None:
        """Opens once all that `render` will need, but the tracks: so it fails before the work, or not for this.

        Args: end: the last frame that will be tracked; None for the video's.

        Raises:
            InputError, RunError: see `render`.
        """
        options = options or OutputOptions()
        for surface in surfaces:
            check_ad(surface)
            if surface.matte is not None:
                times = self.reader.times
                least = frames_until(end or Moment(), times) if surface.track is None else len(surface.track)
                GivenMatte(surface.matte, self.reader.info, range(least, len(times) + 1)).close()
        if options.backend != "auto":
            open_compositor(options.backend).close()
        part = self._part(options)
        streams = self._streams(surfaces, outputs, options, Moment())
        OutputWriters(outputs, self.reader.info, options, streams, part).discard()
        if outputs.video is not None:
            warn_of_space(outputs.video.path, options.codec, self.reader.info)
        if outputs.layer is not None:
            warn_of_space(outputs.layer.path, options.layer_codec, self.reader.info, alpha=True)

    def render(
        self,
        surfaces: Sequence[Surface],
        output: Path | str | Claim | None = None,
        options: OutputOptions | None = None,
        end: Moment | None = None,
        layer: Path | str | Claim | None = None,
        matte: Path | str | Claim | None = None,
    ) -> Result:
        """Lays the ads on their tracked surfaces and writes the video; later ones lie over earlier ones.

        The sound of the ad, where the options ask for it, is the first ad's. What comes after a track's end is copied.

        Args:
            output: the video to write, or a claim on its name; None for none.
            end: the last frame; None for the video's.
            layer: video or image sequence to write what is laid on the video to, by itself, with alpha.
            matte: the same for the alpha alone, white on black.

        Raises:
            InputError: surfaces without tracks, tracks of another video, files that cannot be read, an output that
                exists, unknown codec.
            RunError: the output cannot be written, the compositing backend is not available.
            Stopped: see `stop`.
        """
        options = options or OutputOptions()
        inputs = self.reader.path, *(file for surface in surfaces for file in (surface.ad, surface.matte))
        with claimed_outputs((output, layer, matte), options, *inputs) as outputs:
            tracks = [surface.track for surface in surfaces if surface.track is not None]
            for track in tracks:
                check_belongs_to(track, self.reader)
            parts = self._parts(outputs, options, end or Moment(), tracks)
            if parts:
                try:
                    return self._render_parts(surfaces, tracks, outputs, options, end or Moment(), parts)
                except IndexDropped as error:
                    log.warning("%s: rendering it in one process instead", error)
            return self._numbered_rightly(lambda: self._render(surfaces, tracks, outputs, options, end or Moment()))

    def _render(
        self,
        surfaces: Sequence[Surface],
        tracks: Sequence[Track],
        outputs: Outputs,
        options: OutputOptions,
        end: Moment,
    ) -> Result:
        started, info, part = time.perf_counter(), self.reader.info, self._part(options)
        first, stop = (0, None) if part is None else (part.start, part.stop)
        streams = self._streams(surfaces, outputs, options, end)
        with (
            OutputWriters(outputs, info, options, streams, part) as writer,
            VideoReader(self.reader.source, 16 if writer.is_deep else 8, writer.tonemap) as reader,
            Renderer(self.reader, surfaces, options.backend) as renderer,
            ahead(until(reader.frames(run_up(first), stop), end, self.reader.times[0])) as frames,
            behind(writer.write) as write,
        ):
            length, count = renderer.length, 0
            in_all = len(part) if part is not None else info.frames if end == Moment() else length
            show = Stage(self.listen, "render", 0, in_all)
            for frame, insert in renderer.draw(self._stop.watch(frames), outputs.apart, first):
                write(frame, insert)
                count += 1
                show(tuple(t.states[frame.index] if frame.index < len(t) else None for t in tracks), frame.view)
            warnings = [*tracks_warnings(tracks, self.reader.warnings), *self.reader.warnings, *reader.warnings]
            warnings += [*writer.warnings, *renderer.warnings]
            video = outputs.video.path if outputs.video else None
            if streams and video and options.audio != "none" and info.has_audio and not holds_sound(video):
                log.info("%s holds no sound: it is left out", video.suffix)
            if part is None and count < length and end == Moment():
                of_track = counted(length, "frame")
                warnings.append(f"{self.reader.path} has only {count} of the track's {of_track}: the rest is left out")
            warnings += ends_warnings(tracks, count if part is None else len(self.reader.times))
            description, lights, blank = renderer.description, renderer.first_lights, renderer.blank
        return Result(
            video,
            count,
            total(track.counts_in(part) for track in tracks),
            time.perf_counter() - started,
            description,
            list(dict.fromkeys([*warnings, *(streams.warnings if streams else [])])),
            [
                {"ad": surface.name, "states": track.counts_in(part), "first_light": light, "blank": is_blank}
                for surface, track, light, is_blank in zip(surfaces, tracks, lights, blank, strict=True)
            ],
            layer=outputs.layer.path if outputs.layer else None,
            matte=outputs.matte.path if outputs.matte else None,
            verdict=judge(tracks),
        )

    def _part(self, options: OutputOptions) -> range | None:
        """Indices of the frames that are written; None for all.

        Raises:
            InputError: the video has none of those that are asked for.
        """
        if options.frames is None:
            return None
        numbers = self._numbers(options)
        part = options.frames.indices(numbers)
        if not part:
            raise InputError(
                f"{self.reader.path} has no frame of {options.frames}: its frames are {numbers[0]} to {numbers[-1]}"
            )
        if options.frames.last > numbers[-1]:
            log.warning("%s ends with frame %d, before %d", self.reader.path.name, numbers[-1], options.frames.last)
        return part

    def _numbers(self, options: OutputOptions) -> list[int]:
        """Of the video's frames, as of pictures of them."""
        info, times = self.reader.info, self.reader.times
        zero = info.first_number if options.start_number is None else options.start_number
        if info.is_pictures:
            return [zero + round((time - times[0]) * info.rate) for time in times]
        return [*range(zero, zero + len(times))]

    def _parts(self, outputs: Outputs, options: OutputOptions, end: Moment, tracks: Sequence[Track]) -> list[range]:
        """The parts that are rendered by themselves, by the indices of their frames; none for all in one go."""
        if options.parallel == 1 or options.frames is not None:
            return []
        why = None
        if outputs.video is None or outputs.apart:
            why = "layers and mattes are written in one go"
        elif not is_joinable(outputs.video.path):
            why = f"{outputs.video.path.suffix} is written in one go"
        elif not self.reader.seekable:
            why = f"{self.reader.path.name} cannot be entered but at its beginning"
        else:
            parts = divided(frames_until(end, self.reader.times), {c for t in tracks for c in t.cuts}, options.parallel)
            if len(parts) > 1:
                return parts
            why = "the video is too short for parts"
        log.warning("%s: rendering goes on without --parallel", why)
        return []

    def _render_parts(
        self,
        surfaces: Sequence[Surface],
        tracks: Sequence[Track],
        outputs: Outputs,
        options: OutputOptions,
        end: Moment,
        parts: Sequence[range],
    ) -> Result:
        """As `_render`, each part in another process, of the video alone."""
        started, times, numbers, video = time.perf_counter(), self.reader.times, self._numbers(options), outputs.video
        assert video is not None
        video.scratch.mkdir()
        tasks, usual = [], {name: getattr(OutputOptions, name) for name in OF_SOUND}
        for part in parts:
            frames = FrameRange(numbers[part.start], numbers[part.stop - 1])
            file = video.scratch / f"{part.start}{video.path.suffix}"
            own = changed(options, parallel=1, frames=frames, **usual)
            tasks.append(_Part(self.reader.source, surfaces, file, own))
        count = sum(map(len, parts))
        with Workers(options.parallel, self._stop) as workers:
            results = workers.map(_render_part, tasks, Stage(self.listen, "render", 0, count))
        streams = self._streams(surfaces, outputs, options, end)
        assert streams is not None
        [last] = self.reader.frames(count - 1, count)
        files, end_time = [task.file for task in tasks], last.time + last.duration
        join(files, video, times[:count], end_time, streams, self.reader.info)
        warnings = [warning for result in results for warning in result.warnings]
        return Result(
            video.path,
            count,
            total(track.counts for track in tracks),
            time.perf_counter() - started,
            results[0].compositor,
            list(dict.fromkeys([*warnings, *streams.warnings])),
            [{"ad": s.name, "states": track.counts} for s, track in zip(surfaces, tracks, strict=True)],
            verdict=judge(tracks),
        )

    def _streams(
        self, surfaces: Sequence[Surface], outputs: Outputs, options: OutputOptions, end: Moment
    ) -> Streams | None:
        """What goes along with the picture; None for a part of it, which others are joined to."""
        if options.frames is not None:
            return None
        heard = next((surface for surface in surfaces if surface.ad is not None), surfaces[0])
        times = self.reader.times
        return Streams(
            options.audio if outputs.video and holds_sound(outputs.video.path) else "none",
            self.reader.path,
            Path(heard.ad) if heard.ad else None,
            heard.playback,
            options.streams,
            options.location,
            next((time for i, time in enumerate(times) if not is_within(end, i, time - times[0])), None),
            (Fraction(0), None) if heard.track is None else heard.track.seconds,
        )

    def preview(
        self, surfaces: Sequence[Surface], backend: Backend = "opencv", frames: Frames | None = None
    ) -> Preview:
        """Draws single frames as `render` will, in any order; surfaces need no tracks yet. See `Preview`.

        Raises:
            InputError: a track of another video, an ad that cannot be read, a quad that is impossible.

        Example:
            with session.preview([surface]) as preview:
                picture = preview.frame(120)
        """
        for surface in surfaces:
            if surface.track is not None:
                check_belongs_to(surface.track, self.reader)
        return Preview(self.reader, surfaces, backend, frames)

    def steady(self, track: Track, output: Path | str | Claim, options: OutputOptions | None = None) -> None:
        """Writes the video with the surface standing still, as in the reference frame; see `SteadyView`.

        Args:
            output: the video to write, or a claim on its name.

        Raises:
            InputError: a track of another video, an output that exists, unknown codec.
            RunError: the output cannot be written.
            Stopped: see `stop`.
        """
        options = options or OutputOptions()
        with claimed_output(output, options, self.reader.path) as claim:
            check_belongs_to(track, self.reader)
            self._numbered_rightly(lambda: self._steady(track, claim, options))

    def check_steady(self, output: Claim, options: OutputOptions | None = None) -> None:
        """Opens the encoder that `steady` will need, once, before the work; it is not known yet for which size.

        Raises:
            InputError, RunError: see `steady`.
        """
        self._steady_writer(
            output, self.reader.info.width // 2 * 2, self.reader.info.height // 2 * 2, options
        ).discard()

    def _steady_writer(self, output: Claim, width: int, height: int, options: OutputOptions | None) -> VideoWriter:
        info, options = self.reader.info, options or OutputOptions()
        return VideoWriter(
            output,
            width,
            height,
            info.rate,
            codec=options.codec,
            crf=options.crf,
            time_base=info.time_base,
            pixel_aspect=info.pixel_aspect,
        )

    def _steady(self, track: Track, output: Claim, options: OutputOptions) -> None:
        view = SteadyView(track)
        show = Stage(self.listen, "steady view", 0, len(track))
        with (
            self._steady_writer(output, view.width, view.height, options) as writer,
            ahead(self.reader.frames(0, len(track))) as frames,
        ):
            for frame in self._stop.watch(frames):
                picture = view.of(frame.image, frame.index)
                writer.write(picture, frame.time, frame.duration)
                show((track.states[frame.index],), picture)

    def plane_picture(self, track: Track) -> PlanePicture:
        """What the whole video shows of a surface's plane, in one picture.

        Raises:
            InputError: a track of another video.
            Stopped: see `stop`.
        """
        check_belongs_to(track, self.reader)
        [picture] = self._numbered_rightly(lambda: self._stop.drive(plane_pictures(self.reader, [track], self.listen)))
        if picture.views == 1:
            log.warning(
                "the picture of the plane is that of the reference frame alone: too few frames agree with it; "
                "choose a --start that shows the surface better"
            )
        return picture

    def _corrected(self, surface: Surface, track: Track, options: TrackingOptions) -> Track:
        if not needs_correction(track, surface.keyframes):
            return track
        passes = self._passes(options)
        return self._go_on([surface], options, lambda: passes.correct(track, surface.keyframes)).as_saved()

    def _go_on(self, surfaces: Sequence[Surface], options: TrackingOptions, begin: Callable[[], Steps[T]]) -> T:
        """Tracks surfaces in steps: those that are left where it was stopped before, else all, which `begin` gives."""
        if self._resting is None or not self._resting.is_for(surfaces, options):
            self._rest(_Resting(surfaces, options, begin()))
        assert self._resting is not None
        steps, rests = self._resting.steps, False
        try:
            return self._stop.drive(steps)
        except Stopped:
            rests = getgeneratorstate(steps) != GEN_CLOSED and options.parallel == 1  # processes end with the work
            raise
        finally:
            if not rests:
                self._rest(None)

    def _rest(self, work: "_Resting | None") -> None:
        """Keeps work that was stopped, in place of what was kept, which ends."""
        if self._resting is not None:
            self._resting.steps.close()
        self._resting = work

    def _numbered_rightly(self, work: Callable[[], T]) -> T:
        """What the work gives; it starts over where the file's packets proved to number its frames wrongly."""
        try:
            return work()
        except IndexDropped:
            log.warning("%s: packets and frames do not agree: starting over by decoding alone", self.reader.path.name)
            return work()

    def _passes(self, options: TrackingOptions, workers: Workers | None = None) -> Passes:
        if self._make_tracker is None:
            self._make_tracker, self._is_hdn = hdn_trackers(options), True
        listen: Listener = lambda event: self.listen(event)  # noqa: E731 - it may be another when tracking goes on
        return Passes(self.reader, self._make_tracker, options, listen, self._stop, workers)

    def _workers(self, options: TrackingOptions) -> AbstractContextManager[Workers | None]:
        """The processes that track stretches of the video; None where this one does it."""
        if options.parallel == 1:
            return nullcontext()
        why = None
        if self._make_tracker is not None and not self._is_hdn:
            why = "a tracker of one's own works in one process"
        elif not self.reader.seekable:
            why = f"{self.reader.path.name} cannot be entered but at its beginning"
        if why is not None:
            log.warning("%s: tracking goes on without --parallel", why)
            return nullcontext()
        return Workers(options.parallel, self._stop)


@dataclass(frozen=True)
class _Resting:
    """Tracking that may go on: of what, and the steps that are left."""

    surfaces: Sequence[Surface]
    options: TrackingOptions
    steps: Steps[Any]

    def is_for(self, surfaces: Sequence[Surface], options: TrackingOptions) -> bool:
        """Whether it tracks these, whatever they look like."""
        return options == self.options and [*map(_place, surfaces)] == [*map(_place, self.surfaces)]


def _place(surface: Surface) -> tuple[Any, ...]:
    """What of a surface its track is made from, to be compared."""
    keyframes = [(keyframe.at, keyframe.corners.tobytes()) for keyframe in surface.keyframes]
    polygons = [None if points is None else points.tobytes() for points in (surface.region, *surface.exclude)]
    quad = None if surface.quad is None else np.asarray(surface.quad, np.float64).tobytes()
    return id(surface.track), quad, surface.start, surface.snap, polygons, keyframes


@dataclass(frozen=True)
class _Part:
    """What one process renders of a video."""

    source: Path | ImageSequence
    surfaces: Sequence[Surface]
    file: Path
    options: OutputOptions


def _render_part(part: _Part) -> Result:
    """The work of a process."""
    with Session(part.source, lambda event: frame_done()) as session:
        return session.render(part.surfaces, part.file, part.options)


def tracks_warnings(tracks: Sequence[Track], of_video: Sequence[str]) -> list[str]:
    """The warnings of tracks of one video; with several surfaces, what concerns one of them says which."""
    common = set(of_video).union(set.intersection(*(set(track.warnings) for track in tracks))) if tracks else set()
    return [
        warning if warning in common else f"surface {number}: {warning}"
        for number, track in enumerate(tracks, 1)
        for warning in track.warnings
    ]


def ends_warnings(tracks: Sequence[Track], frames: int) -> list[str]:
    """Which of the tracks end before the output, of so many frames, does."""
    return [
        f"{f'surface {number}: ' if len(tracks) > 1 else ''}the track ends with frame {len(track) - 1}, and the video "
        f"with frame {frames - 1}: what comes after the track is copied as it is"
        for number, track in enumerate(tracks, 1)
        if len(track) < frames and track.span is None
    ]


def _within(surface: Surface, time: Span) -> Surface:
    """The surface with its track, if it has one, as far as it is within a span.

    Raises:
        InputError: there is nothing of the track.
    """
    track = surface.track
    if track is None:
        return surface
    elapsed = [at - track.times[0] for at in track.times]
    begin = index_of(time.begin or FIRST, track.times)
    within = [
        i for i, at in enumerate(elapsed) if begin is not None and i >= begin and is_within(time.end or Moment(), i, at)
    ]
    if not within:
        raise InputError(f"the track has no frame in the time {time}: name another")
    return changed(surface, track=track.within(within[0], within[-1]))


def check_output(output: Path, options: OutputOptions, *inputs: Path | str | ImageSequence | None) -> None:
    """Raises InputError where the output may not be written: it is an input, or `check_name` refuses it."""
    given = [Path(source) for source in inputs if source is not None]
    check_not_read([output], given, output)
    check_name(output, options.overwrite)
    if is_picture(output) and (there := pictures_of(output)):
        check_not_read(there, [*given, *(file for path in given for file in pictures_of(path))], output)
        numbering = Numbering.parse(output)
        if options.frames is not None and numbering is not None:
            there = [file for file in there if numbering.number_in(file) in options.frames]
        if there and not options.overwrite:
            raise InputError(f"{there[0]} exists already: choose another output with -o, or give --overwrite")


def check_not_read(files: Iterable[Path], inputs: Iterable[Path], output: Path) -> None:
    """Raises InputError where one of the files is among the inputs."""
    if {file.resolve() for file in files} & {file.resolve() for file in inputs}:
        raise InputError(f"{output} is an input as well: choose another output with -o")


@contextmanager
def claimed_output(
    output: Path | str | Claim, options: OutputOptions, *inputs: Path | str | ImageSequence | None
) -> Iterator[Claim]:
    """An output's claim for as long as the context lasts; one that was made earlier stays its owner's.

    Raises:
        InputError: see `check_output`; another run is writing to it.
    """
    if not isinstance(output, Claim):
        check_output(Path(output), options, *inputs)
    is_part = options.frames is not None and not isinstance(output, Claim) and is_picture(Path(output))
    with claimed(output, options.overwrite, str(options.frames) if is_part else "") as claim:
        yield claim


@contextmanager
def claimed_outputs(
    names: Sequence[Path | str | Claim | None], options: OutputOptions, *inputs: Path | str | ImageSequence | None
) -> Iterator[Outputs]:
    """The outputs of a rendering: the video, the layer and the matte, None for what is not written; see above.

    Raises:
        InputError: see `claimed_output`; there is none.
    """
    with ExitStack() as held:
        yield Outputs(
            *(None if name is None else held.enter_context(claimed_output(name, options, *inputs)) for name in names)
        )


def check_belongs_to(track: Track, reader: VideoReader) -> None:
    """Checks that a track was measured on this video.

    Raises:
        InputError: the video has another size, other pictures, or other times.
    """
    source, info = track.source, reader.info
    advice = "give the video that it was made from, or track this one"
    if (source.width, source.height) != (info.width, info.height):
        raise InputError(
            f"the track is of {source.path} ({source.width}x{source.height}), not of {reader.path} "
            f"({info.width}x{info.height}): {advice}"
        )
    if source.fingerprint not in (None, reader.fingerprint(len(track))):
        raise InputError(f"the track is of {source.path}, and {reader.path} shows something else: {advice}")
    for index, (ours, theirs) in enumerate(zip(track.times, reader.times, strict=False)):
        if abs(ours - theirs) > TIME_TOLERANCE:
            raise InputError(
                f"the track is of {source.path}, and frame {index} of {reader.path} comes at {float(theirs):.3f} s "
                f"instead of {float(ours):.3f} s: {advice}"
            )
