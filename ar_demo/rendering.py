"""The render loop: the ad onto the tracked surface, frame by frame, into a video."""

import logging
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdn.errors import InputError
from hdn.homography import Array

from .ads import Ad, open_ad
from .audio import Audio
from .compositor import Region, fit_region, open_compositor, quad_aspect
from .effects import draw_outline, texture
from .options import Options
from .smoothing import segments
from .trackfile import Track
from .tracking import Progress, silent
from .video import VideoReader
from .writer import VideoWriter

log = logging.getLogger(__name__)

FADE_SECONDS = 0.25  # that the ad takes to go and to come back
GLIDE_SECONDS = 0.25  # before a lost surface is found, that a held ad takes to its place

WHOLE: Region = (0.0, 0.0, 1.0, 1.0)


@dataclass
class Result:
    """What was made: the summary that `--json` prints.

    Attributes:
        output: the file written.
        frames: frames in it; states: how many of them were tracked, held, lost.
        seconds: wall time of tracking and rendering; fps: frames per second of it.
        compositor: backend and renderer.
        warnings: what went differently from what was asked, one sentence each.
    """

    output: Path
    frames: int
    states: dict[str, int]
    seconds: float
    compositor: str
    warnings: list[str] = field(default_factory=list)

    @property
    def fps(self) -> float:
        return self.frames / max(self.seconds, 1e-9)

    def summary(self) -> dict[str, Any]:
        return {
            "output": str(self.output),
            "frames": self.frames,
            "states": self.states,
            "seconds": round(self.seconds, 3),
            "fps": round(self.fps, 2),
            "compositor": self.compositor,
            "warnings": self.warnings,
        }


def render(
    input: Path | str,
    ad: Path | str | None,
    track: Track,
    output: Path | str,
    options: Options,
    progress: Progress = silent,
) -> Result:
    """Lays an ad, or an effect, on the tracked surface of a video and writes the result.

    Args:
        ad: video, image or animated image; None where `options.effect` needs none.
        track: of this video, smoothed or not.

    Raises:
        InputError: files that cannot be read, a track of another video, an output that exists, unknown codec.
        RunError: the output cannot be written, the compositing backend is not available.
    """
    started = time.perf_counter()
    output = Path(output)
    check_output(output, options, input, ad)
    if options.effect == "replace" and ad is None:
        raise InputError("no ad is given: name a video or image, or choose --effect mosaic, blur or outline")
    with ExitStack() as stack:
        reader = stack.enter_context(VideoReader(input))
        info = reader.info
        track.check_belongs_to(Path(input), info.width, info.height)
        surface = None
        if options.effect == "replace" and ad is not None:
            surface = stack.enter_context(open_ad(ad, options.playback))
        compositor = stack.enter_context(open_compositor(options.backend))
        poses, opacity = presentation(track, options)
        audio = Audio(options.audio, Path(input), Path(ad) if ad else None, options.playback)
        writer = stack.enter_context(
            VideoWriter(
                output,
                info.width,
                info.height,
                info.rate,
                codec=options.codec,
                crf=options.crf,
                audio=audio,
                time_base=info.time_base,
                pixel_aspect=info.pixel_aspect,
            )
        )
        region = _region(surface, track, options, info.width, info.height)
        first = None
        count = 0
        for frame in reader.frames(0, len(track)):
            first = frame.time if first is None else first
            image, pose = frame.image, poses[frame.index]
            strength = float(opacity[frame.index])
            if strength > 0 and np.isfinite(pose).all():
                if options.effect == "outline":
                    draw_outline(image, pose, strength)
                elif surface is None:
                    compositor.composite(image, texture(options.effect, image, pose), pose, WHOLE, strength)
                elif (picture := surface.at(frame.time - first)) is not None:
                    compositor.composite(image, picture, pose, region, strength, options.feather)
            writer.write(image, frame.time, frame.duration)
            count += 1
            progress("render", count, len(track), track.states[frame.index])
        warnings = list(dict.fromkeys([*track.warnings, *reader.warnings]))
        if count < len(track):
            warnings.append(f"{input} has only {count} of the track's {len(track)} frames: the rest is left out")
        description = compositor.description
    return Result(output, count, track.counts, time.perf_counter() - started, description, warnings)


def check_output(output: Path, options: Options, *inputs: Path | str | None) -> None:
    """Raises InputError where the output may not be written: it exists, is an input, or its folder is missing."""
    if not output.parent.is_dir():
        raise InputError(f"the output folder {output.parent} does not exist: make it first")
    if any(source is not None and Path(source).resolve() == output.resolve() for source in inputs):
        raise InputError(f"{output} is an input as well: choose another output with -o")
    if output.exists() and not options.overwrite:
        raise InputError(f"{output} exists already: choose another output with -o, or give --overwrite")


def presentation(track: Track, options: Options) -> tuple[Array, NDArray[np.float64]]:
    """Where the ad is drawn, (N, 4, 2) px, and how strongly, (N,) 0..1, in every frame.

    While the surface is lost the ad keeps its last pose. It fades out there (`lost='fade'`), goes at once ('hide'), or
    stays and glides to where the surface is found again, so that it never jumps ('hold').
    """
    poses = track.corners.copy()
    shown = track.known
    times = np.array([float(t) for t in track.times])
    opacity = shown.astype(np.float64)
    for start, stop in segments((~shown).tolist()):
        if start:
            poses[start:stop] = poses[start - 1]
        if options.lost == "hold" and start:
            opacity[start:stop] = 1
            if stop < len(poses):
                way = np.clip(1 - (times[stop] - times[start:stop]) / GLIDE_SECONDS, 0, 1)
                ease = (way * way * (3 - 2 * way))[:, None, None]
                poses[start:stop] += (poses[stop] - poses[start:stop]) * ease
        elif options.lost == "fade":
            if start:
                opacity[start:stop] = 1 - (times[start:stop] - times[start - 1]) / FADE_SECONDS
            if stop < len(poses):
                coming = (times[stop:] - times[stop - 1]) / FADE_SECONDS
                opacity[stop:] = np.minimum(opacity[stop:], coming)
    return poses, np.clip(opacity, 0, 1) * options.opacity


def _region(ad: Ad | None, track: Track, options: Options, width: int, height: int) -> Region:
    if ad is None:
        return WHOLE
    return fit_region(options.fit, ad.width / ad.height, quad_aspect(track.quad, (width, height)))
