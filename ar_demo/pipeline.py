"""The whole job in one call: track, smooth, render."""

import time
from collections.abc import Sequence
from dataclasses import replace as changed
from pathlib import Path

from hdn.imaging.arrays import Image

from .errors import InputError
from .media.codecs import check_video_name
from .media.pictures import check_picture_name, write_picture
from .options import OutputOptions, TrackingOptions
from .progress import Listener, silent
from .rendering.painting import check_ad
from .results import Result
from .session import Session, check_output
from .surface import Surface
from .tracking.protocol import MakeTracker, MappingTracker, PlanarTracker, hdn_trackers
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
    save_map: Path | str | None = None,
    save_steady: Path | str | None = None,
    options: OutputOptions | None = None,
) -> Track:
    """Tracks a surface through a video; one that has a track is tracked anew next to keyframes that are new to it.

    Args:
        surface: with its quad, or a track made earlier.
        tracking: how; `smooth=0` gives the track as it was measured.
        make_tracker: makes the tracker, see `PlanarTracker`; None makes HDN's.
        save_map: picture to write, of the tracker's map of the plane.
        save_steady: video to write, in which the surface stands still, see `Session.steady`.
        options: how that is written, and whether existing files may be replaced.

    Raises:
        InputError: see `Session.track`; a map of a tracker that keeps none, an output that exists.
        RunError: an output cannot be written.
    """
    tracking, options = tracking or TrackingOptions(), options or OutputOptions()
    outputs = [Path(path) for path in (save_map, save_steady) if path is not None]
    for output in outputs:
        check_output(output, options, input)
    mapped = _Mapped(make_tracker, tracking) if save_map is not None else None
    if save_map is not None:
        check_picture_name(Path(save_map))
    if save_steady is not None:
        check_video_name(Path(save_steady))
    with Session(input, listen, mapped or make_tracker) as session:
        [tracked] = session.track([surface], tracking)
        assert tracked.track is not None
        if mapped is not None and save_map is not None:
            write_picture(Path(save_map), mapped.picture())
        if save_steady is not None:
            session.steady(tracked.track, save_steady, options)
    return tracked.track


class _Mapped:
    """Makes trackers of one surface, and keeps the first, whose map is that of the plane as the video has it."""

    def __init__(self, make_tracker: MakeTracker | None, tracking: TrackingOptions) -> None:
        self._make_tracker, self._tracking = make_tracker, tracking
        self._first: MappingTracker | None = None

    def __call__(self) -> PlanarTracker:
        self._make_tracker = self._make_tracker or hdn_trackers(self._tracking)
        tracker = self._make_tracker()
        if self._first is None:
            if not isinstance(tracker, MappingTracker):
                raise InputError("this tracker keeps no map of the plane: leave --save-map out")
            self._first = tracker
        return tracker

    def picture(self) -> Image:
        """The map (h, w, 3) after tracking."""
        if self._first is None:
            raise InputError("nothing was tracked, so there is no map: leave --save-map out")
        return self._first.map_picture()


def default_output(input: Path) -> Path:
    """INPUT.ar.mp4 beside the input; the container stays where it is one that we write."""
    suffix = input.suffix.lower() if input.suffix.lower() in (".mp4", ".mov", ".mkv", ".webm") else ".mp4"
    return input.with_name(f"{input.stem}.ar{suffix}")


def track_files(path: Path, count: int) -> list[Path]:
    """The file for one track; for several NAME.1.json, NAME.2.json and so on."""
    return [path] if count == 1 else [path.with_name(f"{path.stem}.{i}{path.suffix}") for i in range(1, count + 1)]
