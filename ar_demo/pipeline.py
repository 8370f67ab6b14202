"""The whole job in one call: track, smooth, render."""

import time
from collections.abc import Sequence
from dataclasses import replace as changed
from pathlib import Path

from .errors import InputError
from .options import OutputOptions, TrackingOptions
from .progress import Listener, silent
from .rendering.painting import check_ad
from .results import Result
from .session import Session, check_output
from .surface import Surface
from .tracking.protocol import MakeTracker
from .tracks import Track


def replace(
    input: Path | str,
    surfaces: Surface | Sequence[Surface],
    output: Path | str | None = None,
    tracking: TrackingOptions | None = None,
    options: OutputOptions | None = None,
    listen: Listener = silent,
    save_track: Path | str | None = None,
) -> Result:
    """Puts ads on the surfaces of a video in one pass; later ones are drawn over earlier ones.

    Args:
        input: the video.
        surfaces: one or several, each with its quad or with a track made earlier.
        output: the video to write; None writes beside the input, as INPUT.ar.mp4.
        tracking, options: how to track, and how to draw and write.
        listen: called after each frame.
        save_track: where to write the tracks; of several the first goes to NAME.1.json, and so on.

    Raises:
        InputError, RunError: see `Session.track` and `Session.render`.

    Example:
        replace("street.mp4", Surface("ad.mp4", parse_quad("100,80 300,80 300,240 100,240")), "out.mp4")
    """
    started = time.perf_counter()
    surfaces = [surfaces] if isinstance(surfaces, Surface) else list(surfaces)
    if not surfaces:
        raise InputError("there is no surface: give one, with its quad or a track")
    tracking, options = tracking or TrackingOptions(), options or OutputOptions()
    output = Path(output) if output is not None else default_output(Path(input))
    check_output(output, options, input, *(surface.ad for surface in surfaces))
    for surface in surfaces:
        check_ad(surface)
    files = track_files(Path(save_track), len(surfaces)) if save_track is not None else []
    for file in files:
        check_output(file, options, input)
    with Session(input, listen) as session:
        tracked = session.track(surfaces, tracking)
        for file, surface in zip(files, tracked, strict=False):
            if surface.track is not None:
                surface.track.save(file)
        result = session.render(tracked, output, options)
    return changed(result, seconds=time.perf_counter() - started)


def track(
    input: Path | str,
    surface: Surface,
    tracking: TrackingOptions | None = None,
    listen: Listener = silent,
    make_tracker: MakeTracker | None = None,
) -> Track:
    """Tracks a surface through a video; one that has a track is tracked anew next to keyframes that are new to it.

    Args:
        surface: with its quad, or a track made earlier.
        tracking: how; `smooth=0` gives the track as it was measured.
        make_tracker: makes the tracker, see `PlanarTracker`; None makes HDN's.

    Raises:
        InputError: see `Session.track`.
    """
    with Session(input, listen, make_tracker) as session:
        [tracked] = session.track([surface], tracking)
    assert tracked.track is not None
    return tracked.track


def default_output(input: Path) -> Path:
    """INPUT.ar.mp4 beside the input; the container stays where it is one that we write."""
    suffix = input.suffix.lower() if input.suffix.lower() in (".mp4", ".mov", ".mkv", ".webm") else ".mp4"
    return input.with_name(f"{input.stem}.ar{suffix}")


def track_files(path: Path, count: int) -> list[Path]:
    """The file for one track; for several NAME.1.json, NAME.2.json and so on."""
    return [path] if count == 1 else [path.with_name(f"{path.stem}.{i}{path.suffix}") for i in range(1, count + 1)]
