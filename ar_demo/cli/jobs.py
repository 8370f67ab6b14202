"""The job file, version 1: a video, its surfaces with their ads, and how all is tracked and written, as JSON.

    {"version": 1,
     "input": "street.mp4", "output": "out.mp4", "save_track": "tracks.json",
     "layer": "ads.mov", "save_matte": "matte.%05d.png",
     "tracking": {"end": "20s", "smooth": 1.0},
     "rendering": {"audio": "mix", "crf": 20},
     "surfaces": [
        {"ad": "shop.mp4", "quad": [[476, 128], [759, 122], [759, 480], [482, 476]]},
        {"ad": "sale.png", "quad": "90,60 210,64 208,170 88,160", "start": "4.5s", "fit": "contain",
         "keyframes": [{"frame": 120, "corners": [[95, 61], [214, 66], [212, 171], [93, 162]]}]},
        {"effect": "blur", "quad": "90,60 210,64 208,170 88,160", "region": "60,40 250,40 250,200 60,200",
         "exclude": ["100,80 140,80 140,120"]},
        {"ad": "new.mp4", "find": "poster.png"},
        {"effect": "mosaic", "track": "plate.track.json"}]}

Only "version" and "surfaces" are needed: what the file does not say is as on the command line, where files that are
named count before the job's. Files are looked for beside the job file. `job.schema.json`, which
`python -m ar_demo.cli.jobs` writes, is its JSON Schema.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from ..choices import (
    Alpha,
    AudioMode,
    Backend,
    Blend,
    Depth,
    Device,
    Effect,
    FirstLight,
    Fit,
    Grain,
    KeptStreams,
    Lost,
    Playback,
    Softness,
    SurfaceKind,
)
from ..errors import InputError
from ..frame_range import FrameRange
from ..importing.loading import load_track
from ..media.download import is_url
from ..media.sequences import ImageSequence
from ..surface import Keyframe, Moment, Span, Surface, parse_polygon, parse_quad
from ..verdict import Limits, parse_share

SCHEMA = Path(__file__).with_name("job.schema.json")

Corners = str | list[tuple[float, float]]  # "x,y x,y x,y ...", or pairs of numbers
When = Annotated[int, Meta(ge=0)] | str  # a frame's number, or a time as "4.5s"
NotNegative = Annotated[float, Meta(ge=0)]


class KeyframeEntry(Struct, forbid_unknown_fields=True):
    """Corners in another frame than the surface's first."""

    frame: When
    corners: Corners


class SurfaceEntry(Struct, forbid_unknown_fields=True, omit_defaults=True):
    """A surface and what is laid on it; the fields are those of `Surface`."""

    ad: str | UnsetType | None = UNSET
    quad: Corners | UnsetType = UNSET
    find: str | UnsetType = UNSET  # a picture of it, or a folder of such
    snap: bool | UnsetType = UNSET
    start: When | UnsetType = UNSET
    region: Corners | UnsetType = UNSET
    exclude: list[Corners] | UnsetType = UNSET
    keyframes: list[KeyframeEntry] | UnsetType = UNSET
    track: str | UnsetType = UNSET
    first_frame: int | UnsetType = UNSET  # the number of the video's first frame in another program's track
    fit: Fit | UnsetType = UNSET
    playback: Playback | UnsetType = UNSET
    blend: Blend | UnsetType = UNSET
    opacity: Annotated[float, Meta(ge=0, le=1)] | UnsetType = UNSET
    feather: NotNegative | UnsetType = UNSET
    inset: NotNegative | UnsetType = UNSET
    radius: NotNegative | UnsetType = UNSET
    lost: Lost | UnsetType = UNSET
    effect: Effect | UnsetType = UNSET
    flat: bool | UnsetType = UNSET
    shutter: Annotated[float, Meta(ge=0, le=360)] | UnsetType | None = UNSET
    grain: Grain | UnsetType = UNSET
    softness: Softness | UnsetType = UNSET
    first_light: FirstLight | UnsetType = UNSET
    surface_kind: SurfaceKind | UnsetType = UNSET
    matte: str | UnsetType = UNSET

    def surface(
        self,
        folder: Path,
        common: Mapping[str, Any],
        video: Path | str | ImageSequence | None,
        defaults: Callable[[str], Mapping[str, Any]],
    ) -> Surface:
        """The surface of a video; `common` has what is not said here, `defaults`, by effect, what is said nowhere.

        Raises:
            InputError: corners, a frame or a file that cannot be read, or options that do not go together.
        """
        given = _given(self)
        for name in ("ad", "matte"):
            if given.get(name):
                given[name] = folder / given[name]
        if "quad" in given:
            given["quad"] = parse_quad(given["quad"])
        if "region" in given:
            given["region"] = parse_polygon(given["region"])
        if "exclude" in given:
            given["exclude"] = tuple(map(parse_polygon, given["exclude"]))
        if "start" in given:
            given["start"] = Moment.parse(given["start"])
        if "keyframes" in given:
            entries: list[KeyframeEntry] = given["keyframes"]
            given["keyframes"] = tuple(Keyframe(Moment.parse(k.frame), parse_quad(k.corners)) for k in entries)
        first_frame = given.pop("first_frame", None)
        if "track" in given:
            given["track"] = load_track(folder / given["track"], video, first_frame)
        elif first_frame is not None:
            raise InputError("first_frame does nothing without track: leave it out")
        elif "find" in given:
            given["find"] = folder / given["find"]
        elif "quad" not in given:
            raise InputError("it has neither quad, find nor track: give its corners")
        said = dict(common) | given
        return Surface(**dict(defaults(said.get("effect", "replace"))) | said)


class TrackingEntry(Struct, forbid_unknown_fields=True, omit_defaults=True):
    """How the surfaces are tracked; the fields are those of `TrackingOptions`."""

    end: When | UnsetType = UNSET
    time: str | UnsetType = UNSET  # as "10s..20s"
    smooth: NotNegative | UnsetType = UNSET
    device: Device | UnsetType = UNSET
    weights: str | UnsetType = UNSET
    parallel: Annotated[int, Meta(ge=1)] | UnsetType = UNSET


class RenderingEntry(Struct, forbid_unknown_fields=True, omit_defaults=True):
    """How the output is drawn and written; the fields are those of `OutputOptions`."""

    audio: AudioMode | UnsetType = UNSET
    streams: KeptStreams | UnsetType = UNSET
    location: bool | UnsetType = UNSET
    backend: Backend | UnsetType = UNSET
    codec: str | UnsetType = UNSET
    crf: Annotated[float, Meta(ge=0, le=63)] | UnsetType = UNSET
    depth: Depth | UnsetType = UNSET
    tonemap: bool | UnsetType = UNSET
    alpha: Alpha | UnsetType = UNSET
    layer_codec: str | UnsetType = UNSET
    frames: Annotated[str, Meta(pattern=r"^\d+(-\d+)?$")] | UnsetType = UNSET  # as "1-100"
    start_number: Annotated[int, Meta(ge=0)] | UnsetType = UNSET
    overwrite: bool | UnsetType = UNSET
    parallel: Annotated[int, Meta(ge=1)] | UnsetType = UNSET


class LimitsEntry(Struct, forbid_unknown_fields=True, omit_defaults=True):
    """By which the verdict is found; the fields are those of `Limits`, shares as "5%" or 0.05."""

    max_held: str | float | UnsetType = UNSET
    max_lost: str | float | UnsetType = UNSET
    fail_lost: str | float | UnsetType = UNSET
    max_deviation: NotNegative | UnsetType = UNSET


class JobEntry(Struct, forbid_unknown_fields=True, omit_defaults=True):
    """A whole job: see the module."""

    version: Literal[1]
    surfaces: Annotated[list[SurfaceEntry], Meta(min_length=1)]
    input: str | UnsetType = UNSET
    fps: Annotated[float, Meta(gt=0)] | str | UnsetType = UNSET  # of an image sequence
    output: str | UnsetType = UNSET
    save_track: str | UnsetType = UNSET
    layer: str | UnsetType = UNSET
    save_matte: str | UnsetType = UNSET
    report: str | UnsetType = UNSET
    tracking: TrackingEntry = msgspec.field(default_factory=TrackingEntry)
    rendering: RenderingEntry = msgspec.field(default_factory=RenderingEntry)
    limits: LimitsEntry | UnsetType = UNSET


class Job:
    """A job file that was read.

    Attributes:
        input: a file or an address, None where it does not name one.
        output, save_track, layer, save_matte, report: files, None where it does not name one.
        fps: of an image sequence, None where it does not say.
    """

    def __init__(self, path: Path, entry: JobEntry) -> None:
        self._path, self._entry = path, entry
        self.fps = None if entry.fps is UNSET else entry.fps
        self.input: Path | str | None
        self.input, self.output, self.save_track, self.layer, self.save_matte, self.report = (
            None if name is UNSET else path.parent / name
            for name in (entry.input, entry.output, entry.save_track, entry.layer, entry.save_matte, entry.report)
        )
        if is_url(entry.input):
            self.input = entry.input

    @property
    def files(self) -> list[Path]:
        """The files that are read for it, but for the input: ads, mattes, tracks and weights."""
        surfaces = self._entry.surfaces
        names = [self._entry.tracking.weights, *(n for s in surfaces for n in (s.ad, s.matte, s.find, s.track))]
        return [self._path.parent / name for name in names if isinstance(name, str)]

    def surfaces_with(
        self,
        common: Mapping[str, Any],
        video: Path | str | ImageSequence | None = None,
        defaults: Callable[[str], Mapping[str, Any]] = lambda effect: {},
    ) -> list[Surface]:
        """The surfaces of a video, by the names of `Surface`'s fields.

        Args:
            common: what they do not say. defaults: by effect, what is said nowhere.

        Raises:
            InputError: one that is not as described; the message says which.
        """
        found = []
        for number, entry in enumerate(self._entry.surfaces):
            try:
                found.append(entry.surface(self._path.parent, common, video, defaults))
            except InputError as error:
                raise InputError(f"{self._path}: {error} - at `$.surfaces[{number}]`") from error
        return found

    def tracking_options(self) -> dict[str, Any]:
        """What the job says of `TrackingOptions`."""
        given = _given(self._entry.tracking)
        if "end" in given:
            given["end"] = Moment.parse(given["end"])
        if "time" in given:
            given["time"] = Span.parse(given["time"])
        if "weights" in given:
            given["weights"] = self._path.parent / given["weights"]
        return given

    def limits(self) -> dict[str, Any]:
        """What the job says of `Limits`.

        Raises:
            InputError: a share that is none; the message says which.
        """
        try:
            return {} if self._entry.limits is UNSET else limits_of(_given(self._entry.limits))
        except InputError as error:
            raise InputError(f"{self._path}: {error} - at `$.limits`") from error

    def output_options(self) -> dict[str, Any]:
        """What the job says of `OutputOptions`."""
        given = _given(self._entry.rendering)
        if "frames" in given:
            given["frames"] = FrameRange.parse(given["frames"])
        return given


def limits_of(given: Mapping[str, Any]) -> dict[str, Any]:
    """What is given of `Limits`, by the names of its fields, as these take it.

    Raises:
        InputError: a share that is none.
    """
    values = {f.name: given[f.name] for f in fields(Limits) if f.name in given}
    return {name: value if name == "max_deviation" else parse_share(value) for name, value in values.items()}


def load_job(path: Path) -> Job:
    """Reads a job file.

    Raises:
        InputError: it cannot be read, is no JSON, or is not as described; the message has the path of what is wrong.
    """
    try:
        return Job(path, msgspec.json.decode(path.read_bytes(), type=JobEntry))
    except OSError as error:
        raise InputError(f"cannot read job file {path}: {error.strerror}") from error
    except msgspec.ValidationError as error:
        raise InputError(f"{path} is not as a job file must be: {error}; see the README for its form") from error
    except msgspec.DecodeError as error:
        raise InputError(f"{path} is not a job file (not JSON): see the README for its form") from error


def schema() -> str:
    """The JSON Schema of job files, as it is kept beside this module."""
    return json.dumps(msgspec.json.schema(JobEntry), indent=2) + "\n"


def _given(entry: Struct) -> dict[str, Any]:
    """The fields of an entry that were said."""
    return {name: value for name in entry.__struct_fields__ if (value := getattr(entry, name)) is not UNSET}


if __name__ == "__main__":
    SCHEMA.write_text(schema(), encoding="utf-8")
