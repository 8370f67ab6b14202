"""A video with its surfaces, as pages show and change it; all of it is in the job file on disk."""

import logging
import math
import secrets
from collections.abc import Callable, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from itertools import chain, count
from pathlib import Path
from threading import RLock
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

from hdn import Observation
from hdn.alignment.rectangles import find_rectangles
from hdn.alignment.snapping import snap
from hdn.imaging.arrays import Array
from hdn.imaging.quads import check_quad

from ..choices import CHOICES
from ..cli.defaults import Defaults
from ..cli.jobs import JobEntry, SurfaceEntry
from ..errors import InputError, Stopped
from ..importing.loading import load_track
from ..media import codecs
from ..media.claims import check_name, write_whole
from ..pipeline import beside, default_output
from ..session import Session
from ..surface import Surface
from ..tracking.moments import index_of
from ..tracks import Track
from .composites import Composites
from .errors import Refusal, on_page
from .events import Events
from .files import Files
from .frames import Frames
from .shell import command
from .state import (
    Change,
    Place,
    State,
    SurfaceState,
    TrackingState,
    TrackState,
    points,
    put_options,
    relative,
    state_of,
    surface_entry,
)
from .tasks import Task, Tasks

log = logging.getLogger(__name__)

JOB, TRACK = ".job.json", ".track.json"
SAME_PX = 2e-3  # within which corners are the same: the page gets them to a thousandth
# What the page offers, by the names of `CHOICES`.
OFFERED = (
    *("fit", "playback", "blend", "lost", "effect", "grain", "softness", "first_light", "surface_kind"),
    *("audio", "depth"),
)


@dataclass
class Kept:
    """A track and the file that it is in.

    Attributes:
        place: what it was made from; None where that was before this server.
        first_frame: of another program's file.
    """

    track: Track
    file: Path
    place: Place | None = None
    first_frame: int | None = None

    @property
    def own(self) -> Place:
        """The place that its file tells, but for how it was tracked."""
        region = self.track.region
        return Place(
            _tuple(self.track.quad),
            self.track.reference_frame,
            False,
            None if region.include is None else _tuple(region.include),
            tuple(map(_tuple, region.exclude)),
        )


class Project:
    """One video that is open. Its methods may be called from any thread.

    Attributes:
        job_file: where its state is kept.
        revision: grows with each change.
    """

    def __init__(self, video: Path, job_file: Path, files: Files, defaults: Defaults, ad: Path | None = None) -> None:
        """Opens a video, with the job file where there is one.

        Args:
            ad: of the first surface, where the job file has no other.

        Raises:
            InputError: the video cannot be read, the job file is none, or is of another video.
        """
        self.id, self.video, self.job_file, self.files = secrets.token_urlsafe(6), video, job_file, files
        self.revision = 0
        self.events = Events()
        self._defaults, self._lock = defaults, RLock()
        self._tracks: dict[str, Kept] = {}
        self._stopped: list[Any] = []  # what was tracked when somebody stopped it
        self._made: set[Path] = set()  # track files of this server
        self.outputs: dict[str, Path] = {}
        self._content = self._content_on_disk()
        self._entry = JobEntry(1, []) if self._content is None else _parsed(job_file, self._content)
        self.session = Session(video)
        try:
            reader = self.session.reader
            if not reader.seekable:
                for _ in reader.frames():  # tells all times
                    pass
            self.frames = Frames(reader, len(reader.times))
            try:
                self._state = self._from_job()
                self._take_ad(ad)
                if self.output.is_file() and self._entry.output is not UNSET:
                    self._add_output(self.output)
            except BaseException:
                self.frames.close()
                raise
        except BaseException:
            self.session.reader.close()
            raise
        self.tasks = Tasks(self.session, self.events.send, self.frames.pause)
        self.composites = Composites(self.session, self.frames)

    def close(self) -> None:
        """Stops what is under way, and removes tracks that were replaced."""
        self.tasks.close()
        self.composites.close()
        self.frames.close()
        self.session.reader.close()
        named = {self._tracks[s.track.id].file for s in self._state.surfaces if s.track and s.track.id in self._tracks}
        for file in self._made - named:
            with suppress(OSError):
                file.unlink()

    @property
    def folder(self) -> Path:
        """Where the job file is, its tracks, and what is rendered."""
        return self.job_file.parent

    @property
    def name(self) -> str:
        return self.video.name

    @property
    def output(self) -> Path:
        """What is rendered to, where nobody says otherwise."""
        named = self._entry.output
        return self.folder / (default_output(self.video).name if named is UNSET else named)

    # ---- what the page sees, and changes ----

    @property
    def content(self) -> dict[str, Any]:
        """The whole project, as JSON can hold it."""
        with self._lock:
            info, times = self.session.reader.info, self.session.reader.times
            return {
                "id": self.id,
                "name": self.name,
                "revision": self.revision,
                "video": {
                    "file": self.files.admit(self.video),
                    "name": self.video.name,
                    "width": info.width,
                    "height": info.height,
                    "frames": self.frames.count,
                    "rate": float(info.rate),
                    "times": [round(float(time - times[0]), 6) for time in times],
                    "warnings": self.session.reader.warnings,
                },
                "surfaces": [self._surface_content(surface) for surface in self._state.surfaces],
                "tracking": msgspec.to_builtins(self._state.tracking),
                "rendering": msgspec.to_builtins(self._state.rendering),
                "choices": {name: CHOICES[name] for name in OFFERED},
                "job_file": self.job_file.name,
                "output": self.output.name,
                "command": self._command(),
                "task": None if self.tasks.last is None else self.tasks.last.content,
                "can_go_on": bool(self._stopped) and self._stopped == self._places(),
            }

    def _surface_content(self, surface: SurfaceState) -> dict[str, Any]:
        kept = self._kept(surface)
        ad = None if surface.ad is None else self.files.path(surface.ad).name
        track = None
        if kept is not None and surface.track is not None:
            track = {
                "id": surface.track.id,
                "counts": kept.track.counts,
                "reference_frame": kept.track.reference_frame,
                "stale": self._needs(surface, kept) != "nothing",
            }
        return msgspec.to_builtins(surface) | {"ad_name": ad, "track": track}

    def change(self, change: Change) -> None:
        """Takes a state from the page, and writes it to the job file.

        Raises:
            Refusal: it was made from an older revision, or something in it cannot be.
        """
        with self._lock:
            if change.revision != self.revision:
                raise Refusal(409, "this was changed elsewhere meanwhile: it is shown as it is there", **self.content)
            for number, surface in enumerate(change.surfaces):
                self._check(number, surface)
            _checked("tracking.time", lambda: change.tracking.options(self._entry, self.folder))
            _checked("rendering", lambda: change.rendering.options(self._entry))
            before, self._state = self._state, State(change.surfaces, change.tracking, change.rendering)
            try:
                self._changed()
            except BaseException:
                self._state = before
                raise

    def _check(self, number: int, surface: SurfaceState) -> None:
        """Refuses a surface that cannot be; one that is not finished can."""
        field = f"surfaces.{number}"
        ad = self._ad(surface)
        if surface.track is not None and surface.track.id not in self._tracks:
            raise Refusal(422, "there is no such track: track the surface again", f"{field}.track")
        if surface.start >= self.frames.count:
            raise Refusal(422, f"the video has frames 0 to {self.frames.count - 1}: name one", f"{field}.start")
        try:
            surface.surface(ad, None, surface.given)
        except InputError as error:
            first = str(error).split()[0].rstrip(":")
            raise Refusal(
                422, str(error), f"{field}.{first}" if first in surface.__struct_fields__ else field
            ) from error

    def _changed(self) -> None:
        """Writes the job file, and tells that there is something new."""
        self._write()
        self.revision += 1
        self.events.send({"type": "project", "revision": self.revision})

    # ---- the job file ----

    def _from_job(self) -> State:
        def file(name: str) -> str | None:
            path = self.folder / name
            if not path.exists():
                log.warning("%s names a file that is not there: %s", self.job_file, path)
                return None
            return self.files.admit(path)

        def track(said: SurfaceEntry) -> tuple[str, Track] | None:
            if not isinstance(said.track, str):
                return None
            file = self.folder / said.track
            first = said.first_frame if isinstance(said.first_frame, int) else None
            kept = Kept(load_track(file, self.video, first), file, first_frame=first)
            return self._keep(kept), kept.track

        times = self.session.reader.times
        state = state_of(self._entry, times, file, track, self._defaults.surface)
        return msgspec.structs.replace(state, tracking=self._with_defaults(state.tracking))

    def _with_defaults(self, tracking: TrackingState) -> TrackingState:
        own = self._defaults.tracking()
        return (
            TrackingState(tracking.time, own["smooth"])
            if tracking == TrackingState(tracking.time) and "smooth" in own
            else tracking
        )

    def _take_ad(self, ad: Path | None) -> None:
        """The ad that the command line names is that of the first surface."""
        if ad is None:
            return
        if not self._state.surfaces:
            self._state.surfaces = [SurfaceState(**self._defaults.surface())]
        self._state.surfaces[0].ad = self.files.admit(ad)

    def _write(self) -> None:
        """The job file, whole."""
        if self._content_on_disk() != self._content:
            told = f"{self.job_file.name} was changed by another program, or another ar-studio: start ar-studio anew"
            raise Refusal(409, told)
        entry = self._job()
        content = msgspec.json.format(msgspec.json.encode(entry), indent=2) + b"\n"
        write_whole(self.job_file, content)
        self._entry, self._content = entry, content

    def _content_on_disk(self) -> bytes | None:
        """What the job file says now; None where there is none."""
        try:
            return self.job_file.read_bytes()
        except FileNotFoundError:
            return None

    def _job(self) -> JobEntry:
        """What the job file is to say."""
        entry = deepcopy(self._entry)
        entry.input = relative(self.video, self.folder)
        entry.surfaces = [self._entry_of(surface) for surface in self._state.surfaces] or [SurfaceEntry()]
        put_options(entry, self._state, self._defaults.output() | self._defaults.tracking())
        return entry

    def _command(self) -> str:
        return command(self._job(), self.job_file, self.video, self.output)

    def _entry_of(self, surface: SurfaceState) -> SurfaceEntry:
        kept = self._kept(surface)
        needs = "all" if kept is None else self._needs(surface, kept)
        if kept is None or needs == "all":
            track, keyframes = None, surface.given
        else:
            track, keyframes = relative(kept.file, self.folder), self._new_keyframes(surface, kept)
        ad, find, matte = (
            None if id is None else relative(self.files.path(id), self.folder)
            for id in (surface.ad, surface.find, surface.matte)
        )
        entry = surface_entry(surface, ad, find, track, keyframes, self._defaults.surface(surface.effect), matte)
        if track is not None and kept is not None and kept.first_frame is not None:
            entry.first_frame = kept.first_frame
        return entry

    # ---- tracks ----

    def track(self, number: int) -> Track:
        """The track of a surface.

        Raises:
            Refusal: there is no such surface, or it has none.
        """
        with self._lock:
            surfaces = self._state.surfaces
            kept = self._kept(surfaces[number]) if 0 <= number < len(surfaces) else None
        if kept is None:
            raise Refusal(404, "this surface is not tracked yet: track it first")
        return kept.track

    def track_content(self, number: int) -> dict[str, Any]:
        """The track of a surface, as JSON can hold it; its lists have an entry for each frame of the video."""
        track, n = self.track(number), self.frames.count
        rest = max(n - len(track), 0)
        known = track.known
        states = "".join(state[0] for state in track.states)
        return {
            "first": track.first,
            "last": track.last,
            "reference_frame": track.reference_frame,
            "corners": [np.round(track.corners[i], 3).tolist() if known[i] else None for i in range(len(track))][:n]
            + [None] * rest,
            "states": (states + "l" * rest)[:n],
            "confidence": [round(float(c), 3) for c in track.confidence[:n]] + [0.0] * rest,
            "deviation": [round(float(d), 3) if math.isfinite(d) else None for d in track.deviation[:n]]
            + [None] * rest,
            "cuts": track.cuts,
            "keyframes": sorted(track.keyframes),
            "warnings": track.warnings,
        }

    def begin_tracking(self) -> Task:
        """Tracks all surfaces whose track is missing or stale.

        Raises:
            Refusal: nothing is to do, a surface has no corners, or there is work under way.
        """
        with self._lock:
            surfaces = list(self._state.surfaces)
            for number, surface in enumerate(surfaces):
                if surface.quad is None:
                    raise Refusal(422, "set the four corners of the surface first", f"surfaces.{number}.quad")
                _checked(f"surfaces.{number}.quad", partial(self._check_corners, surface))
            if not surfaces:
                raise Refusal(409, "there is no surface yet: set its four corners")
            if all((kept := self._kept(s)) is not None and self._needs(s, kept) == "nothing" for s in surfaces):
                raise Refusal(409, "all surfaces are tracked: move corners, or add a surface")
            tracking = self._state.tracking
            given = [self._to_track(surface) for surface in surfaces]
            options = _checked("tracking.time", lambda: tracking.options(self._entry, self.folder))
            places = self._places()
        new = [number for number, surface in enumerate(given) if surface.track is None]
        left = [[number] for number, surface in enumerate(given) if surface.keyframes and surface.track]
        left = [new, *left] if new else left

        def work(task: Task) -> None:
            self._stopped = []
            while left:
                task.surfaces = numbers = left[0]
                try:
                    tracked = self.session.track([given[n] for n in numbers], options)
                except Stopped:
                    self._stopped = places
                    raise
                with self._lock:
                    for number, after in zip(numbers, tracked, strict=True):
                        assert after.track is not None
                        self._take_track(surfaces[number], after.track, surfaces[number].place(tracking))
                        task.warnings = list(dict.fromkeys([*task.warnings, *after.track.warnings]))
                    self._changed()
                left.pop(0)

        return self.tasks.begin("track", work)

    def _places(self) -> list[Any]:
        """Where all surfaces are given to be, to be compared."""
        return [(s.place(self._state.tracking), s.keyframes) for s in self._state.surfaces]

    def begin_finding(self, picture: str) -> Task:
        """Looks for a surface by a picture of it, in the part of the video that is tracked.

        Args: picture: a file's id.

        Raises:
            Refusal: there is no such file, or there is work under way.
        """
        file = self.files.path(picture)
        with self._lock:
            options = _checked(
                "tracking.time", lambda: self._state.tracking.options(self._entry, self.folder), "give another part"
            )

        def work(task: Task) -> None:
            times = self.session.reader.times
            for surface in self.session.located([Surface(effect="blur", find=file)], options):
                marked = [(index_of(k.at, times), points(k.corners)) for k in surface.keyframes]
                task.found.append(
                    {
                        "quad": points(surface.quad),
                        "start": index_of(surface.start, times),
                        "keyframes": [{"frame": frame, "corners": corners} for frame, corners in marked],
                    }
                )

        return self.tasks.begin("find", work)

    def begin_rendering(self, name: str, overwrite: bool) -> Task:
        """Renders to a file beside the job file.

        Raises:
            Refusal: a surface is not ready, there is no such name, or there is work under way.
        """
        output = self.folder / name
        if output.name != name or name.startswith(".") or "\0" in name:
            raise Refusal(422, "give a file's name, as out.mp4", "name")
        ads = [ad for surface in self._state.surfaces if (ad := self._ad(surface)) is not None]
        if any(output.resolve() == path.resolve() for path in (self.video, self.job_file, *ads)):
            raise Refusal(422, f"{name} is what this is made from: give another name", "name")
        _checked("name", lambda: check_name(output, overwrite=True), "give another name")
        if output.exists() and not overwrite:
            raise Refusal(409, f"{name} is there already: replace it, or give another name", "name")
        with self._lock:
            surfaces = [self._to_render(number, surface) for number, surface in enumerate(self._state.surfaces)]
            if not surfaces:
                raise Refusal(409, "there is no surface yet: set its four corners")
            rendering, end = self._state.rendering, self._state.tracking.options(self._entry, self.folder).end
            options = _checked("rendering", lambda: rendering.options(self._entry, overwrite=overwrite))
            _checked("name", lambda: codecs.choose(output, options.codec), "give another name, or another codec")
            if self._entry.output is UNSET or self._entry.output != name:
                self._entry.output = name
                self._changed()

        def work(task: Task) -> None:
            result = self.session.render(surfaces, output, options, end)
            task.warnings = result.warnings
            task.output = self._add_output(output)

        return self.tasks.begin("render", work)

    def _to_render(self, number: int, surface: SurfaceState) -> Surface:
        kept, field = self._kept(surface), f"surfaces.{number}"
        if kept is None or self._needs(surface, kept) != "nothing":
            raise Refusal(409, "track the surfaces first", f"{field}.track")
        if surface.ad is None and surface.effect == "replace":
            raise Refusal(422, "choose an ad for the surface", f"{field}.ad")
        return surface.surface(self._ad(surface), kept.track, {}, self._matte(surface))

    def _ad(self, surface: SurfaceState) -> Path | None:
        return None if surface.ad is None else self.files.path(surface.ad)

    def _matte(self, surface: SurfaceState) -> Path | None:
        return None if surface.matte is None else self.files.path(surface.matte)

    def _add_output(self, path: Path) -> str:
        id = next((id for id, other in self.outputs.items() if other == path), secrets.token_urlsafe(6))
        self.outputs[id] = path
        return id

    # ---- what it would look like ----

    def composite(self, index: int, height: int | None) -> tuple[bytes, int]:
        """A frame with the ads on it, as JPEG, and the revision that it shows.

        Raises:
            Refusal: there is no such frame.
            InputError: a surface that cannot be drawn.
        """
        self.frames.check(index)
        with self._lock:
            revision, surfaces = self.revision, list(self._state.surfaces)
        return self.composites.composite(index, height, revision, lambda: self._to_show(surfaces)), revision

    def _to_show(self, surfaces: Sequence[SurfaceState]) -> list[Surface]:
        """The surfaces that there is something to be seen of."""
        shown = []
        for surface in surfaces:
            kept, ad = self._kept(surface), self._ad(surface)
            if (ad is not None or surface.effect != "replace") and (kept is not None or surface.quad is not None):
                shown.append(surface.surface(ad, None if kept is None else kept.track, {}, self._matte(surface)))
        return shown

    def steady(self, number: int, index: int, height: int | None) -> bytes:
        """A surface as it stands still, in a frame, as JPEG.

        Raises:
            Refusal: there is no such surface or frame, or it has no track there.
        """
        track = self.track(number)
        self.frames.check(index)
        if index >= len(track):
            raise Refusal(404, f"the track ends with frame {len(track) - 1}")
        return self.composites.steady(track, index, height)

    def _check_corners(self, surface: SurfaceState) -> None:
        info = self.session.reader.info
        check_quad(np.array(surface.quad, np.float64), info.width, info.height)

    def _to_track(self, surface: SurfaceState) -> Surface:
        kept = self._kept(surface)
        needs = "all" if kept is None else self._needs(surface, kept)
        if kept is None or needs == "all":
            return surface.surface(None, None, surface.given)
        return surface.surface(None, kept.track, self._new_keyframes(surface, kept))

    def _take_track(self, surface: SurfaceState, track: Track, place: Place) -> None:
        """Gives a track to the surface that it was made for, where that is there still."""
        stem = self.job_file.name.removesuffix(".json").removesuffix(".job")
        names = (self.folder / f"{stem}{number}{TRACK}" for number in chain([""], map(".{}".format, count(2))))
        file = next(name for name in names if not name.exists())
        track.save(file)
        self._made.add(file)
        id = self._keep(Kept(track, file, place))
        for other in self._state.surfaces:
            same_track = surface.track is not None and other.track is not None and other.track.id == surface.track.id
            if other is surface or same_track or other.place(self._state.tracking) == place:
                other.track = TrackState(id)
                return

    def _keep(self, kept: Kept) -> str:
        id = secrets.token_urlsafe(6)
        self._tracks[id] = kept
        return id

    def _kept(self, surface: SurfaceState) -> Kept | None:
        return None if surface.track is None else self._tracks.get(surface.track.id)

    def _needs(self, surface: SurfaceState, kept: Kept) -> str:
        """What of a track has to be tracked anew: 'nothing', 'keyframes' (next to them), or 'all'."""
        place = surface.place(self._state.tracking)
        own = msgspec.structs.replace(kept.own, time=place.time, smooth=place.smooth)
        if kept.place is not None:
            own = msgspec.structs.replace(own, time=kept.place.time, smooth=kept.place.smooth)
        if not (_same_place(place, own) or (kept.place is not None and _same_place(place, kept.place))):
            return "all"
        if any(frame not in surface.given for frame in kept.track.keyframes):
            return "all"
        return "keyframes" if self._new_keyframes(surface, kept) else "nothing"

    def _new_keyframes(self, surface: SurfaceState, kept: Kept) -> dict[int, Array]:
        used = kept.track.used
        return {i: c for i, c in surface.given.items() if i not in used or np.abs(used[i] - c).max() > SAME_PX}

    # ---- corners ----

    def snapped(self, frame: int, corners: Any) -> dict[str, Any]:
        """Corners moved to the edges beside them, and how far, px.

        Raises:
            Refusal: there is no such frame, or not yet, or the corners cannot be those of a surface.
        """
        image = self.frames.exact(frame)
        quad, moved = _checked("corners", lambda: snap(Observation(image), np.array(corners, np.float64)))
        return {"corners": np.round(quad, 3).tolist(), "moved": np.round(moved, 3).tolist()}

    def proposals(self, frame: int) -> dict[str, Any]:
        """Likely rectangles in a frame, best first.

        Raises:
            Refusal: there is no such frame, or not yet.
        """
        found = find_rectangles(Observation(self.frames.exact(frame)))
        return {"proposals": [{"corners": points(r.corners), "score": round(r.score, 3)} for r in found]}


def job_file_of(video: Path) -> Path:
    """The job file that belongs to a video."""
    return beside(video, JOB)


def _parsed(path: Path, content: bytes) -> JobEntry:
    try:
        return msgspec.json.decode(content, type=JobEntry)
    except msgspec.DecodeError as error:
        raise InputError(f"{path} is not as a job file must be ({error}): mend it, or move it away") from error


def _checked(field: str, work: Callable[[], Any], advice: str = "change it here") -> Any:
    """What the work gives; advice: where its error names an option of the command line."""
    try:
        return work()
    except InputError as error:
        raise Refusal(422, on_page(str(error), advice), field) from error


def _same_place(a: Place, b: Place) -> bool:
    """Whether two places are the same, but for what is lost on the way to the page and back."""
    if (a.start, a.snap, a.time, a.smooth, len(a.exclude)) != (b.start, b.snap, b.time, b.smooth, len(b.exclude)):
        return False
    pairs = [(a.quad, b.quad), (a.region, b.region), *zip(a.exclude, b.exclude, strict=True)]
    return all(_same_points(one, other) for one, other in pairs)


def _same_points(a: Any, b: Any) -> bool:
    if a is None or b is None:
        return a is b
    return len(a) == len(b) and bool(np.abs(np.subtract(a, b)).max() <= SAME_PX)


def _tuple(points: Array) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in points)
