"""What the page knows of a project and sends back, and the job file that says the same.

Whatever can be in a job file and not on the page stays in it. A surface that is not finished yet, without an ad or
corners, is in the file as well: what is missing is said by whoever renders it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import fields
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import UNSET, Meta, Struct

from hdn.imaging.arrays import Array

from ..choices import (
    AudioMode,
    Blend,
    Depth,
    Effect,
    FirstLight,
    Fit,
    Grain,
    Lost,
    Playback,
    Softness,
    SurfaceKind,
)
from ..cli.jobs import JobEntry, KeyframeEntry, SurfaceEntry
from ..errors import InputError
from ..frame_range import FrameRange
from ..options import OutputOptions, TrackingOptions
from ..surface import ADS_ALONE, IN_SCENE_ALONE, Keyframe, Moment, Span, Surface, parse_polygon, parse_quad
from ..tracking.moments import index_of
from ..tracks import Track

Point = tuple[float, float]
Corners = Annotated[list[Point], Meta(min_length=4, max_length=4)]
Polygon = Annotated[list[Point], Meta(min_length=3, max_length=200)]
Number = Annotated[int, Meta(ge=0)]
NotNegative = Annotated[float, Meta(ge=0)]

LOOK = (
    *("fit", "playback", "blend", "opacity", "feather", "lost", "effect", "flat", "shutter", "grain"),
    *("inset", "radius", "softness", "first_light", "surface_kind"),
)
_DEFAULTS: dict[str, Any] = {f.name: f.default for f in fields(Surface) if f.name in LOOK}


class KeyframeState(Struct):
    """Corners in another frame than the surface's own."""

    frame: Number
    corners: Corners


class TrackState(Struct):
    """Which track a surface has, by its id."""

    id: str


class Place(Struct, frozen=True):
    """Where a surface is, as somebody gave it: what a track is made from."""

    quad: tuple[Point, ...] | None = None
    start: int = 0
    snap: bool = False
    region: tuple[Point, ...] | None = None
    exclude: tuple[tuple[Point, ...], ...] = ()
    time: str | None = None
    smooth: float = 1.0


class SurfaceState(Struct):
    """A surface as the page has it. ad, matte, find: a file's id; the last is kept for whoever renders the job."""

    ad: str | None = None
    find: str | None = None
    quad: Corners | None = None
    start: Number = 0
    snap: bool = False
    region: Polygon | None = None
    exclude: list[Polygon] = []
    keyframes: list[KeyframeState] = []
    fit: Fit = "stretch"
    playback: Playback = "loop"
    blend: Blend = "normal"
    opacity: Annotated[float, Meta(ge=0, le=1)] = 1.0
    feather: NotNegative = 0.0
    lost: Lost = "fade"
    effect: Effect = "replace"
    flat: bool = False
    shutter: Annotated[float, Meta(ge=0, le=360)] | None = None
    grain: Grain = "auto"
    inset: NotNegative = 0.0
    radius: NotNegative = 0.0
    softness: Softness = "auto"
    first_light: FirstLight = "auto"
    surface_kind: SurfaceKind = "print"
    matte: str | None = None
    track: TrackState | None = None

    def place(self, tracking: TrackingState) -> Place:
        """Where it is given to be."""
        return Place(
            None if self.quad is None else tuple(self.quad),
            self.start,
            self.snap,
            None if self.region is None else tuple(self.region),
            tuple(map(tuple, self.exclude)),
            tracking.time,
            tracking.smooth,
        )

    @property
    def given(self) -> dict[int, Array]:
        """The keyframes' corners (4, 2), by frame."""
        return {k.frame: np.array(k.corners, np.float64) for k in self.keyframes}

    def look(self) -> dict[str, Any]:
        """The fields of `Surface` that say how the ad looks, without those that do nothing beside the others."""
        idle = {
            *(ADS_ALONE if self.effect != "replace" else ()),
            *(("inset", "radius") if self.effect == "outline" else ()),
            *(IN_SCENE_ALONE if self.flat else ()),
        }
        return {name: getattr(self, name) for name in LOOK if name not in idle}

    def surface(
        self, ad: Path | None, track: Track | None, keyframes: Mapping[int, Array], matte: Path | None = None
    ) -> Surface:
        """The surface, with its track where there is one, else with its corners.

        Raises:
            InputError: values that cannot be.
        """
        shown: dict[str, Any] = {} if ad is None or self.effect != "replace" else {"ad": ad}
        if matte is not None and self.effect == "replace" and not self.flat:
            shown["matte"] = matte
        marked = tuple(Keyframe(Moment(frame=frame), corners) for frame, corners in sorted(keyframes.items()))
        if track is not None:
            return Surface(**self.look(), **shown, track=track, keyframes=marked)
        return Surface(
            **self.look(),
            **shown,
            quad=None if self.quad is None else parse_quad(self.quad),
            start=Moment(frame=self.start),
            snap=self.snap,
            region=None if self.region is None else parse_polygon(self.region),
            exclude=tuple(map(parse_polygon, self.exclude)),
            keyframes=marked,
        )


class TrackingState(Struct, frozen=True):
    """How surfaces are tracked; the fields are those of `TrackingOptions`."""

    time: str | None = None
    smooth: Annotated[float, Meta(ge=0)] = 1.0

    def options(self, entry: JobEntry, folder: Path) -> TrackingOptions:
        """With what else the job file says.

        Raises:
            InputError: values that cannot be.
        """
        said = {name: value for name in ("device",) if (value := getattr(entry.tracking, name)) is not UNSET}
        if entry.tracking.weights is not UNSET:
            said["weights"] = folder / entry.tracking.weights
        if self.time is None and entry.tracking.end is not UNSET:
            said["end"] = Moment.parse(entry.tracking.end)
        return TrackingOptions(time=None if self.time is None else Span.parse(self.time), smooth=self.smooth, **said)


class RenderingState(Struct, frozen=True):
    """How the output is written; the fields are those of `OutputOptions`."""

    audio: AudioMode = "source"
    codec: str | None = None
    crf: Annotated[float, Meta(ge=0, le=63)] | None = None
    depth: Depth = "auto"

    def options(self, entry: JobEntry, **others: Any) -> OutputOptions:
        """With what else the job file says, and others that count before it."""
        own = set(self.__struct_fields__)
        said = {
            name: value
            for name in entry.rendering.__struct_fields__
            if name not in own and (value := getattr(entry.rendering, name)) is not UNSET
        }
        if "frames" in said:
            said["frames"] = FrameRange.parse(said["frames"])
        return OutputOptions(**{name: getattr(self, name) for name in own} | said | others)


class State(Struct):
    """All that the page can change."""

    surfaces: Annotated[list[SurfaceState], Meta(max_length=32)] = []
    tracking: TrackingState = TrackingState()
    rendering: RenderingState = RenderingState()


class Change(State):
    """What the page sends: the state, and the revision that it was made from."""

    revision: int = -1


# ---- from the job file, and into it ----


def state_of(
    entry: JobEntry,
    times: Sequence[Fraction],
    file: Callable[[str], str | None],
    track: Callable[[SurfaceEntry], tuple[str, Track] | None],
    defaults: Callable[[str], Mapping[str, Any]],
) -> State:
    """What a job file says.

    Args:
        times: of the video's frames, seconds.
        file: the id of a picture or video that the file names; None where there is no such file.
        track: the id and the track of a surface; None where it has none.
        defaults: of a surface, by its effect.

    Raises:
        InputError: something in it cannot be.
    """

    def frame(moment: str | int) -> int:
        index = index_of(Moment.parse(moment), times)
        if index is None:
            raise InputError(f"frame {moment} is beyond the end of the video: mend the job file")
        return index

    surfaces = []
    for said in entry.surfaces:
        if not msgspec.to_builtins(said):
            continue
        effect = "replace" if said.effect is UNSET else said.effect
        look = dict(defaults(effect)) | {n: v for n in LOOK if (v := getattr(said, n)) is not UNSET}
        named: dict[str, Any] = {
            name: file(value) for name in ("ad", "find", "matte") if isinstance(value := getattr(said, name), str)
        }
        state = SurfaceState(**named, **look)
        marked = {} if said.keyframes is UNSET else {frame(k.frame): parse_quad(k.corners) for k in said.keyframes}
        found = track(said)
        if found is not None:
            id, known = found
            state.track = TrackState(id)
            state.quad, state.start = points(known.quad), known.reference_frame
            state.region = None if known.region.include is None else points(known.region.include)
            state.exclude = [points(polygon) for polygon in known.region.exclude]
            marked = known.keyframes | marked
        else:
            state.quad = None if said.quad is UNSET else points(parse_quad(said.quad))
            state.start = 0 if said.start is UNSET else frame(said.start)
            state.snap = said.snap is True
            state.region = None if said.region is UNSET else points(parse_polygon(said.region))
            state.exclude = [] if said.exclude is UNSET else [points(parse_polygon(p)) for p in said.exclude]
        state.keyframes = [KeyframeState(i, points(corners)) for i, corners in sorted(marked.items())]
        surfaces.append(state)
    tracking = TrackingState(**_said(entry.tracking, TrackingState))
    return State(surfaces, tracking, RenderingState(**_said(entry.rendering, RenderingState)))


def surface_entry(
    state: SurfaceState,
    ad: str | None,
    find: str | None,
    track: str | None,
    keyframes: Mapping[int, Array],
    defaults: Mapping[str, Any],
    matte: str | None = None,
) -> SurfaceEntry:
    """What a job file says of a surface.

    Args:
        ad, find, track, matte: files, as the job file names them.
        keyframes: those that the track was not made with.
        defaults: what this person has set for whatever is said nowhere, which the file must not depend on.
    """
    entry = SurfaceEntry()
    if ad is not None and state.effect == "replace":
        entry.ad = ad
    if matte is not None and state.effect == "replace" and not state.flat:
        entry.matte = matte
    if track is not None:
        entry.track = track
    elif state.quad is None and find is not None:
        entry.find = find
    else:
        if state.quad is not None:
            entry.quad = list(state.quad)
        if state.start:
            entry.start = state.start
        if state.snap:
            entry.snap = True
        if state.region is not None:
            entry.region = list(state.region)
        if state.exclude:
            entry.exclude = list(state.exclude)
    if keyframes:
        entry.keyframes = [KeyframeEntry(frame, points(corners)) for frame, corners in sorted(keyframes.items())]
    for name, value in state.look().items():
        if value != _DEFAULTS[name] or name in defaults:
            setattr(entry, name, value)
    return entry


def put_options(entry: JobEntry, state: State, defaults: Container[str]) -> None:
    """Says in a job file how is tracked and rendered; defaults: see `surface_entry`."""
    for own, there in ((state.tracking, entry.tracking), (state.rendering, entry.rendering)):
        for name in own.__struct_fields__:
            value, default = getattr(own, name), getattr(type(own)(), name)
            is_said = value is not None and (value != default or name in defaults)
            setattr(there, name, value if is_said else UNSET)
    if state.tracking.time is not None:
        entry.tracking.end = UNSET


def relative(file: Path, folder: Path) -> str:
    """How a job file in a folder names a file: relative to it where it is below."""
    return os.path.relpath(file, folder) if file.is_relative_to(folder) else str(file)


def points(corners: Any) -> list[Point]:
    """Points (n, 2) as JSON can hold them, to a thousandth of a pixel."""
    return [(round(float(x), 3), round(float(y), 3)) for x, y in corners]


def _said(entry: Struct, kind: type[Struct]) -> dict[str, Any]:
    return {n: v for n in kind.__struct_fields__ if (v := getattr(entry, n)) is not UNSET}
