"""The whole job: track, smooth, render."""

import time
from dataclasses import replace as changed
from pathlib import Path

from .options import Options
from .rendering import Result, check_output, render
from .smoothing import smooth
from .trackfile import Track
from .tracking import Progress, silent, track


def replace(
    input: Path | str,
    ad: Path | str | None,
    options: Options,
    output: Path | str | None = None,
    known_track: Track | None = None,
    progress: Progress = silent,
    save_track: Path | str | None = None,
) -> Result:
    """Puts an ad on a surface of a video.

    Args:
        input: the video.
        ad: video, image or animated image; None with an effect that needs none.
        options: at least `quad`, or else a `known_track`.
        output: the video to write; None writes beside the input, as INPUT.ar.mp4.
        known_track: a track of this video made earlier, rendered as it is instead of tracking again.
        save_track: where to write the track that was rendered.

    Raises:
        InputError, RunError: see `track` and `render`.

    Example:
        replace("street.mp4", "ad.mp4", Options(quad=parse_quad("100,80 300,80 300,240 100,240")))
    """
    started = time.perf_counter()
    output = Path(output) if output is not None else default_output(Path(input))
    check_output(output, options, input, ad)
    if save_track is not None:
        check_output(Path(save_track), options, input)
    shown = known_track or smooth(track(input, options, progress), options.smooth)
    if save_track is not None:
        shown.save(save_track)
    result = render(input, ad, shown, output, options, progress)
    return changed(result, seconds=time.perf_counter() - started)


def default_output(input: Path) -> Path:
    """INPUT.ar.mp4 beside the input; the container stays where it is one that we write."""
    suffix = input.suffix.lower() if input.suffix.lower() in (".mp4", ".mov", ".mkv", ".webm") else ".mp4"
    return input.with_name(f"{input.stem}.ar{suffix}")
