"""The whole job in one call: track, smooth, render."""

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace as changed
from glob import has_magic
from pathlib import Path
from typing import NamedTuple

from .errors import InputError, RunError, Stopped
from .media.claims import Claim, check_different, free_name
from .media.codecs import check_video_name
from .media.download import is_url, local_name
from .media.numbering import Numbering
from .media.pictures import check_picture_name, write_picture
from .media.sequences import SUFFIXES, ImageSequence
from .options import OutputOptions, TrackingOptions
from .progress import Listener, Timings, silent
from .rendering.outputs import Outputs
from .report.facts import settings
from .report.report import Report, check_page
from .results import Plan, Result
from .session import Session, check_output, claimed_output, claimed_outputs
from .surface import Surface
from .tracking.protocol import MakeTracker
from .tracks import Track
from .verdict import LIMITS, Limits, judge

log = logging.getLogger(__name__)


def replace(
    input: Path | str | ImageSequence,
    surfaces: Surface | Sequence[Surface],
    output: Path | str | None = None,
    tracking: TrackingOptions | None = None,
    options: OutputOptions | None = None,
    listen: Listener = silent,
    save_track: Path | str | None = None,
    layer: Path | str | None = None,
    matte: Path | str | None = None,
    report: Path | str | None = None,
    limits: Limits = LIMITS,
) -> Result:
    """Puts ads on the surfaces of a video in one pass; later ones are drawn over earlier ones.

    Args:
        input: the video or its http(s) address, or pictures; see `Session`.
        surfaces: one or several, each with its quad or with a track made earlier.
        output: the video to write; None writes beside the input, as INPUT.ar.mp4, where neither layer nor matte is.
        tracking, options: how to track, and how to draw and write.
        listen: called after each frame.
        save_track: where to write the tracks; of several the first goes to NAME.1.json, and so on.
        layer, matte: what is laid on the video by itself, and its alpha alone, to write; see `Session.render`.
        report: page to write, see `Report`.
        limits: by which the result has its verdict.

    Raises:
        InputError, RunError: see `Session.track` and `Session.render`.

    Example:
        replace("street.mp4", Surface("ad.mp4", parse_quad("100,80 300,80 300,240 100,240")), "out.mp4")
    """
    started, timings = time.perf_counter(), Timings(listen)
    tracking, options = tracking or TrackingOptions(), options or OutputOptions()
    with _begun(input, surfaces, output, tracking, options, timings, save_track, layer, matte, report) as job:
        session, surfaces, outputs, files, claims, page = job
        timings.take("opening and checks")
        tracked = session.track(surfaces, tracking)
        timings.take("joint solution")
        for file, surface in zip(claims, tracked, strict=False):
            if surface.track is not None:
                surface.track.save(file)
        try:
            result = session.render(tracked, outputs.video, options, tracking.end, outputs.layer, outputs.matte)
            timings.take("finishing the file")
        except (RunError, OSError) as error:
            new = [now.track for now, given in zip(tracked, surfaces, strict=True) if now.track is not given.track]
            if isinstance(error, Stopped) or not new:
                raise
            raise RunError(f"{error}; {_kept([track for track in new if track], files, outputs.paths[0])}") from error
        tracks = [surface.track for surface in tracked if surface.track is not None]
        seconds = time.perf_counter() - started
        result = changed(result, seconds=seconds, verdict=judge(tracks, limits))
        if page is not None:
            told = Report.of(
                tracks,
                session.reader.source,
                None if outputs.video is None else outputs.video.path,
                limits,
                [surface.name for surface in tracked],
                settings({"input": str(input)}, *tracked, tracking, options),
                timings.told,
                result.warnings,
                listen,
                session.stopping,
            )
            told.save(page)
            result = changed(result, warnings=told.warnings)
    return result


def plan_replacing(
    input: Path | str | ImageSequence,
    surfaces: Surface | Sequence[Surface],
    output: Path | str | None = None,
    tracking: TrackingOptions | None = None,
    options: OutputOptions | None = None,
    save_track: Path | str | None = None,
    layer: Path | str | None = None,
    matte: Path | str | None = None,
    report: Path | str | None = None,
) -> Plan:
    """What `replace` would do: checks all that it checks before it works, and leaves nothing behind.

    Raises:
        InputError, RunError: see `replace`.
    """
    tracking, options = tracking or TrackingOptions(), options or OutputOptions()
    with _begun(input, surfaces, output, tracking, options, silent, save_track, layer, matte, report) as job:
        written = [*job.outputs.paths, *job.files, *([] if job.report is None else [job.report.path])]
        return job.session.plan(job.surfaces, tracking, written)


class _Begun(NamedTuple):
    """A job that is checked and about to be done: files are for the tracks, and claims are those on them; report is
    the claim on its name."""

    session: Session
    surfaces: list[Surface]
    outputs: Outputs
    files: list[Path]
    claims: list[Claim]
    report: Claim | None


@contextmanager
def _begun(
    input: Path | str | ImageSequence,
    surfaces: Surface | Sequence[Surface],
    output: Path | str | None,
    tracking: TrackingOptions,
    options: OutputOptions,
    listen: Listener,
    save_track: Path | str | None,
    layer: Path | str | None,
    matte: Path | str | None,
    report: Path | str | None,
) -> Iterator[_Begun]:
    """Checks what can be checked before the work, and claims all names for as long as the context lasts."""
    surfaces = [surfaces] if isinstance(surfaces, Surface) else list(surfaces)
    if not surfaces:
        raise InputError("there is no surface: give one, with its quad or a track")
    if output is None and layer is None and matte is None:
        output = default_output(input)
    names = [Path(name) if name is not None else None for name in (output, layer, matte)]
    pages = [] if report is None else [check_page(report)]
    check_different([*filter(None, names), *([] if save_track is None else [Path(save_track)]), *pages])
    with ExitStack() as held, Session(input, listen) as session:
        inputs = (input, *(file for surface in surfaces for file in (surface.ad, surface.matte)))
        outputs = held.enter_context(claimed_outputs(names, options, *inputs))
        page = held.enter_context(claimed_output(pages[0], options, *inputs)) if pages else None
        session.check(surfaces, outputs, options, tracking.last)
        surfaces = session.located(surfaces, tracking)
        files = track_files(Path(save_track), len(surfaces)) if save_track is not None else []
        check_different([*filter(None, names), *files, *pages])
        claims = [held.enter_context(claimed_output(file, options, *inputs)) for file in files]
        yield _Begun(session, surfaces, outputs, files, claims, page)


def _kept(tracks: Sequence[Track], files: Sequence[Path], output: Path) -> str:
    """Saves the tracks of an output that failed, if they are not saved already; where they are, in words."""
    try:
        if not files:
            files = [free_name(file) for file in track_files(output.with_name(KEPT.format(output.stem)), len(tracks))]
            for track, file in zip(tracks, files, strict=True):
                track.save(file)
    except (InputError, RunError):
        return "its track could not be kept either"
    return f"its track is kept, see --track: {', '.join(map(str, files))}"


def track(
    input: Path | str | ImageSequence,
    surface: Surface,
    tracking: TrackingOptions | None = None,
    listen: Listener = silent,
    make_tracker: MakeTracker | None = None,
    save_map: Path | str | None = None,
    save_steady: Path | str | None = None,
    options: OutputOptions | None = None,
    save_track: Path | str | None = None,
    report: Path | str | None = None,
    limits: Limits = LIMITS,
) -> Track:
    """Tracks a surface through a video; one that has a track is tracked anew next to keyframes that are new to it.

    Args:
        surface: with its quad, or a track made earlier.
        tracking: how; `smooth=0` gives the track as it was measured.
        make_tracker: makes the tracker, see `PlanarTracker`; None makes HDN's.
        save_map: picture to write, of the surface's plane, see `Session.plane_picture`.
        save_steady: video to write, in which the surface stands still, see `Session.steady`.
        options: how that is written, and whether existing files may be replaced.
        save_track: track file to write.
        report: page to write, see `Report`; limits: by which it has its verdict.

    Raises:
        InputError: see `Session.track`; an output that exists.
        RunError: an output cannot be written.
    """
    tracking, options = tracking or TrackingOptions(), options or OutputOptions()
    outputs = save_track, save_map, save_steady, report
    _check_names(input, outputs, options)
    timings = Timings(listen)
    with ExitStack() as held, Session(input, timings, make_tracker) as session:
        file, picture, steady, page = (
            None if path is None else held.enter_context(claimed_output(path, options, input)) for path in outputs
        )
        if steady is not None:
            session.check_steady(steady, options)
        timings.take("opening and checks")
        copies = session.located([surface], tracking)
        if len(copies) > 1:
            log.warning("%s is seen %d times: the one that is seen best is tracked", surface.find, len(copies))
        [tracked] = session.track(copies[:1], tracking)
        timings.take("joint solution")
        assert tracked.track is not None
        if file is not None:
            tracked.track.save(file)
        if picture is not None:
            write_picture(picture, session.plane_picture(tracked.track).drawn)
        if steady is not None:
            session.steady(tracked.track, steady, options)
        if page is not None:
            Report.of(
                tracked.track,
                session.reader.source,
                limits=limits,
                settings=settings({"input": str(input)}, surface, tracking),
                timings=timings.told,
                listen=listen,
                stop=session.stopping,
            ).save(page)
    return tracked.track


def plan_tracking(
    input: Path | str | ImageSequence,
    surface: Surface,
    tracking: TrackingOptions | None = None,
    options: OutputOptions | None = None,
    exports: Sequence[Path] = (),
    save_track: Path | str | None = None,
    save_map: Path | str | None = None,
    save_steady: Path | str | None = None,
    report: Path | str | None = None,
) -> Plan:
    """What `track`, and exports, would do: checks all that is checked before the work, and leaves nothing behind.

    Raises:
        InputError, RunError: see `track`.
    """
    tracking, options = tracking or TrackingOptions(), options or OutputOptions()
    files = save_track, save_map, save_steady, report
    _check_names(input, files, options)
    outputs = [Path(path) for path in (*files, *exports) if path is not None]
    with ExitStack() as held, Session(input) as session:
        for path in outputs:
            held.enter_context(claimed_output(path, options, input))
        return session.plan([surface], tracking, outputs)


def _check_names(
    input: Path | str | ImageSequence, outputs: tuple[Path | str | None, ...], options: OutputOptions
) -> None:
    """Raises InputError for a name that cannot be written to: of the track file, map, steady view and report."""
    named = [Path(path) for path in outputs if path is not None]
    check_different(named)
    for path in named:
        check_output(path, options, input)
    _, picture, steady, report = outputs
    if picture is not None:
        check_picture_name(Path(picture))
    if steady is not None:
        check_video_name(Path(steady))
    if report is not None:
        check_page(report)


KEPT = "{}.track.json"  # a track's file, by the name of the output that it was made for


def default_output(input: Path | str | ImageSequence) -> Path:
    """INPUT.ar.mp4 beside the input; the container stays where it is one that we write; a lone picture makes a PNG."""
    input = _local(input)
    suffix = input.suffix.lower() if input.suffix.lower() in (".mp4", ".mov", ".mkv", ".webm") else ".mp4"
    if input.is_file() and input.suffix.lower() in SUFFIXES:
        suffix = ".png"
    return beside(input, f".ar{suffix}")


def beside(input: Path | str, ending: str) -> Path:
    """A name beside an input, or beside the folder of pictures that have no name in common: its own, and an ending.

    That of an address is the file's there, in the current folder.
    """
    input = _local(input)
    if input.is_dir():
        return input.resolve().with_name(f"{input.resolve().name}{ending}")
    numbering = None if input.exists() else Numbering.parse(input)
    stem = numbering.head.rstrip(" ._-") if numbering is not None else input.stem
    if not stem or (not input.exists() and has_magic(stem)):
        return beside(input.parent, ending)
    return input.with_name(f"{stem}{ending}")


def _local(input: Path | str | ImageSequence) -> Path:
    return Path(local_name(input) if is_url(input) else input)


def track_files(path: Path, count: int) -> list[Path]:
    """The file for one track; for several NAME.1.json, NAME.2.json and so on."""
    return [path] if count == 1 else [path.with_name(f"{path.stem}.{i}{path.suffix}") for i in range(1, count + 1)]
