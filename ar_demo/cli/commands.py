"""What the command lines do: thin skins over the Python functions of the same names."""

import json
from argparse import Namespace
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path
from typing import Any

import cv2

from ..errors import InputError
from ..export.exporting import export_track
from ..frame_range import FrameRange
from ..importing.loading import load_track
from ..live import LiveSession
from ..media.claims import check_different
from ..media.download import is_url
from ..media.limits import limited
from ..media.reader import VideoReader
from ..media.sequences import ImageSequence, parse_rate
from ..options import OutputOptions, TrackingOptions
from ..pipeline import beside, default_output, plan_replacing, plan_tracking, replace, track
from ..rendering.outputs import OF_SOUND
from ..results import Plan, Result
from ..session import claimed_output
from ..surface import ADS_ALONE, Keyframe, Moment, Span, Surface, parse_polygon, parse_quad
from ..tracking.corrections import needs_correction
from ..verdict import Limits, judge
from ..words import counted
from .applicability import STDOUT, check_applicable, flag, inapplicable
from .defaults import Defaults, load_defaults
from .display import Display, display_of
from .exports import exports_of
from .jobs import Job, limits_of, load_job
from .reporting import Log, in_words, print_summary, set_up_logging, warn
from .stdio import standard_output, stopped_by_signals

NO_SURFACE = "say where the surface is: --quad x,y x,y x,y x,y, --find picture.png, or --track track.json"


def replace_command(given: Namespace) -> int:
    """ar-replace, by what is given on its command line."""
    cv2.setNumThreads(1)  # its threads wait for work in a loop, which takes processor time from the encoder's
    defaults = load_defaults().without(inapplicable(given))
    defaults.fill(given)
    with limited(*reading_limits(given)), display_of(given, renders=True) as display:
        return _replace(given, defaults, display)


def _replace(given: Namespace, defaults: Defaults, display: Display) -> int:
    log = set_up_logging("quiet" in given)
    check_applicable(given)
    job = load_job(given.job) if "job" in given else None
    input = _either("input", given, job.input if job else None)
    if input is None:
        raise InputError("name the video: ar-replace VIDEO AD --quad ...")
    if "live" not in given:
        input = source_of(input, _either("fps", given, job.fps if job else None))
        _check_strict(given, input)
    in_job = job.tracking_options() if job else {}
    tracking = TrackingOptions(**defaults.tracking() | in_job | _of(TrackingOptions, given))
    output = _either("output", given, job.output if job else None)
    save_track = _either("save_track", given, job.save_track if job else None)
    layer = _either("layer", given, job.layer if job else None)
    matte = _either("save_matte", given, job.save_matte if job else None)
    report = _either("report", given, job.report if job else None)
    limits = Limits(**defaults.limits() | (job.limits() if job else {}) | limits_of(vars(given)))
    said = (job.output_options() if job else {}) | _of(OutputOptions, given)
    if "live" not in given:
        if output is None and layer is None and matte is None:
            output = default_output(input)
        defaults = defaults.fitting(None if output is None else Path(output), said.get("codec"))
    if "frames" in said:
        defaults = defaults.without(OF_SOUND)
    options = OutputOptions(**defaults.output() | said)
    surfaces = _surfaces(given, job, input, defaults)
    _check_tracked(given, surfaces, options.frames)
    if "dry_run" in given:
        plan = plan_replacing(input, surfaces, output, tracking, options, save_track, layer, matte, report)
        return _tell(plan, given, log)
    if "live" in given:
        result = _live(str(input), surfaces, output, tracking, options, display)
    else:
        pages = {"layer": layer, "matte": matte, "report": report, "limits": limits}
        result = replace(input, surfaces, output, tracking, options, display, save_track, **pages)
    if "json" in given:
        print(json.dumps(result.summary()))
    else:
        print_summary(result)
    return warn(result.warnings, log, "strict" in given, result.verdict)


def track_command(given: Namespace) -> int:
    """ar-track, by what is given on its command line."""
    cv2.setNumThreads(1)  # see `replace_command`
    defaults = load_defaults()
    defaults.fill(given)
    with limited(*reading_limits(given)), display_of(given, renders=False) as display:
        return _track(given, defaults, display)


def _track(given: Namespace, defaults: Defaults, display: Display) -> int:
    log = set_up_logging("quiet" in given)
    check_applicable(given)
    exports, export_options = exports_of(given)
    input = source_of(given.input, getattr(given, "fps", None))
    _check_strict(given, input)
    surface, *others = _surfaces(given, None, input, Defaults())
    if others:
        raise InputError("ar-track tracks one surface: give --find once, or let ar-replace --save-track write them all")
    if surface.track is not None and "parallel" in given:
        raise InputError("--parallel does nothing for a track that is corrected: leave it out")
    _check_tracked(given, [surface])
    output = given.output if "output" in given else beside(given.input, ".track.json")
    defaults = defaults.fitting(getattr(given, "save_steady", None), None)
    options = OutputOptions(**defaults.output() | _of(OutputOptions, given))
    pictures = {name: getattr(given, name) for name in ("save_map", "save_steady", "report") if name in given}
    check_different([output, *pictures.values(), *exports])
    tracking = TrackingOptions(**defaults.tracking() | _of(TrackingOptions, given))
    limits = Limits(**defaults.limits() | limits_of(vars(given)))
    if "dry_run" in given:
        plan = plan_tracking(input, surface, tracking, options, exports, save_track=output, **pictures)
        return _tell(plan, given, log)
    with ExitStack() as held:
        claims = [held.enter_context(claimed_output(file, options, given.input)) for file in exports]
        result = track(input, surface, tracking, display, options=options, save_track=output, limits=limits, **pictures)
        warnings = result.warnings
        if exports:
            warnings = [*warnings, *export_track(result, claims, getattr(given, "format", ()), export_options)]
    verdict = judge(result, limits)
    if "json" in given:
        states = {"states": result.counts, "verdict": verdict.summary()}
        print(json.dumps({"output": str(output), "frames": len(result), **states, "warnings": warnings}))
    else:
        print(f"{output}: {counted(len(result), 'frame')} ({in_words(result.counts)})\nverdict: {verdict}")
    return warn(warnings, log, "strict" in given, verdict)


def _tell(plan: Plan, given: Namespace, log: Log) -> int:
    """Prints what would be done."""
    if "json" in given:
        print(json.dumps(plan.summary()))
    else:
        print("\n".join([*plan.lines(), "nothing was written"]))
    return warn(plan.warnings, log, "strict" in given)


def _live(
    source: str,
    surfaces: list[Surface],
    output: Any,
    tracking: TrackingOptions,
    options: OutputOptions,
    display: Display,
) -> Result:
    with ExitStack() as stack:
        session = LiveSession(source, surfaces, display)
        sink = stack.enter_context(standard_output()) if output == STDOUT else output or Path("live.mp4")
        stack.enter_context(stopped_by_signals(session.stop))
        return session.run(sink, tracking, options)


def _of(kind: type, given: Namespace) -> dict[str, Any]:
    """What is given of a dataclass of options, each value as its field takes it."""
    values = {f.name: getattr(given, f.name) for f in fields(kind) if f.name in given}
    for name in ("start", "end"):
        if name in values:
            values[name] = Moment.parse(values[name])
    if "time" in values:
        values["time"] = Span.parse(values["time"])
    if "frames" in values:
        values["frames"] = FrameRange.parse(values["frames"])
    if "quad" in values:
        values["quad"] = parse_quad(values["quad"])
    if "region" in values:
        values["region"] = parse_polygon(values["region"])
    if "exclude" in values:
        values["exclude"] = tuple(map(parse_polygon, values["exclude"]))
    return values


def source_of(input: Path | str, fps: str | float | None) -> Path | str | ImageSequence:
    """The video, or the pictures, that an input names."""
    if is_url(input) and fps is None:
        return input
    return ImageSequence.find(input, None if fps is None else parse_rate(fps)) or input


def _check_strict(given: Namespace, input: Path | str | ImageSequence) -> None:
    """Raises InputError for a file that `--strict` refuses before any work."""
    if "strict" not in given or isinstance(input, ImageSequence) or is_url(input):
        return
    with VideoReader(input) as reader:
        if reader.info.interlaced:
            raise InputError(f"{input} is interlaced: deinterlace it, or leave --strict out to have that done here")


def _surfaces(
    given: Namespace, job: Job | None, input: Path | str | ImageSequence, defaults: Defaults
) -> list[Surface]:
    """The surfaces of the input in whichever way they are given: --quad or --track, --surface, --job."""
    values = _of(Surface, given)
    if "track" in values:
        values["track"] = load_track(given.track, input, getattr(given, "first_frame", None))
    if job is not None:
        return job.surfaces_with(values, input, defaults.surface)
    if "surface" in given:
        with_ads = {ad != "-" for ad, _ in given.surface}
        return [_placed(ad, corners, values, len(with_ads) == 2, defaults) for ad, corners in given.surface]
    if "find" in given:
        return _found(values.pop("find"), values, defaults)
    if "keyframe" in given:
        values["keyframes"] = tuple(map(Keyframe.parse, given.keyframe))
    if "quad" not in values and "track" not in values:
        raise InputError(NO_SURFACE)
    return [Surface(**defaults.surface(values.get("effect", "replace")) | values)]


def _placed(ad: str, corners: str, values: dict[str, Any], is_mixed: bool, defaults: Defaults) -> Surface:
    """A --surface; where there are such with an ad and such without, each takes the options that are of its kind."""
    others = ("effect",) if ad != "-" else ADS_ALONE
    own = {name: value for name, value in values.items() if not is_mixed or name not in others}
    own = defaults.surface(own.get("effect", "replace")) | own
    return Surface(**own | {"ad": None if ad == "-" else Path(ad), "quad": parse_quad(corners)})


def _found(texts: Sequence[str], values: dict[str, Any], defaults: Defaults) -> list[Surface]:
    """The surfaces of --find."""
    said = [_picture_and_ad(text) for text in texts]
    if "ad" in values and all("ad" in each for each in said):
        raise InputError("an ad and --find PICTURE=AD do not go together: the picture has an ad of its own")
    return [Surface(**defaults.surface(values.get("effect", "replace")) | values | each) for each in said]


def _picture_and_ad(text: str) -> dict[str, Path]:
    """What --find PICTURE or PICTURE=AD says of a surface.

    Raises:
        InputError: no picture is named, or no ad after the sign.
    """
    picture, sign, ad = text.rpartition("=")
    if not sign or Path(text).exists():
        return {"find": Path(text)}
    if not picture or not ad:
        raise InputError(f"--find '{text}' is neither PICTURE nor PICTURE=AD: give one of these")
    return {"find": Path(picture), "ad": Path(ad)}


def _check_tracked(given: Namespace, surfaces: list[Surface], frames: FrameRange | None = None) -> None:
    """Raises InputError for options of tracking where nothing is to be tracked, and for a part where something is."""
    is_tracked = all(s.track is not None and not needs_correction(s.track, s.keyframes) for s in surfaces)
    if frames is not None and not is_tracked:
        raise InputError("--frames renders from finished tracks: make them once with ar-track, and give --track")
    if is_tracked:
        for name in ("smooth", "device", "weights"):
            if name in given:
                raise InputError(f"{flag(name)} does nothing, for the track is complete: leave it out")


def reading_limits(given: Namespace) -> tuple[int | None, int | None]:
    """Frames and pixels that inputs may have."""
    return getattr(given, "max_frames", None), getattr(given, "max_pixels", None)


def _either(name: str, given: Namespace, in_job: Any) -> Any:
    """A file that the command line or the job file names, None for neither; the command line's counts."""
    return getattr(given, name, in_job)
