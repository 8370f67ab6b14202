"""The whole job: track, smooth, render."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace as changed
from pathlib import Path

from .options import Options, Placing
from .progress import Progress, silent
from .rendering.loop import Layer, check_output, render_layers
from .rendering.painting import check_ad
from .results import Result
from .track import Track
from .tracking.corrections import retrack
from .tracking.passes import track_surfaces
from .tracking.smoothing import smooth


@dataclass(frozen=True)
class Surface:
    """A surface to be tracked and what is laid on it.

    Attributes:
        ad: video, image or animated image; None with an effect that needs none.
        placing: where it is; at least `quad`, or else there is a `track`.
        track: made earlier; only tracked anew around keyframes of the placing that it does not pass through.
    """

    ad: Path | str | None
    placing: Placing
    track: Track | None = None


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
        known_track: a track of this video made earlier, rendered as it is instead of tracking again; see `Surface`.
        save_track: where to write the track that was rendered.

    Raises:
        InputError, RunError: see `track` and `render`.

    Example:
        replace("street.mp4", "ad.mp4", Options(quad=parse_quad("100,80 300,80 300,240 100,240")))
    """
    return replace_surfaces(input, [Surface(ad, options, known_track)], options, output, progress, save_track)


def replace_surfaces(
    input: Path | str,
    surfaces: Sequence[Surface],
    options: Options,
    output: Path | str | None = None,
    progress: Progress = silent,
    save_track: Path | str | None = None,
) -> Result:
    """Puts ads on several surfaces of a video in one pass; later ones are drawn over earlier ones.

    Args:
        options: what concerns all of them; each surface's own `placing` is in it.
        save_track: where to write the tracks; of several the first goes to NAME.1.json, and so on.

    Raises:
        InputError, RunError: see `track` and `render`.
    """
    started = time.perf_counter()
    output = Path(output) if output is not None else default_output(Path(input))
    check_output(output, options, input, *(surface.ad for surface in surfaces))
    for surface in surfaces:
        check_ad(surface.ad, surface.placing)
    files = track_files(Path(save_track), len(surfaces)) if save_track is not None else []
    for file in files:
        check_output(file, options, input)
    unknown = [surface.placing for surface in surfaces if surface.track is None]
    measured = iter(track_surfaces(input, unknown, options, progress) if unknown else [])
    layers = []
    for surface in surfaces:
        if surface.track is None:
            shown = smooth(next(measured), options.smooth)
        else:
            shown = retrack(input, surface.track, surface.placing.keyframes, options, progress)
        layers.append(Layer(surface.ad, shown, surface.placing))
    for file, layer in zip(files, layers, strict=False):
        layer.track.save(file)
    result = render_layers(input, layers, output, options, progress)
    return changed(result, seconds=time.perf_counter() - started)


def default_output(input: Path) -> Path:
    """INPUT.ar.mp4 beside the input; the container stays where it is one that we write."""
    suffix = input.suffix.lower() if input.suffix.lower() in (".mp4", ".mov", ".mkv", ".webm") else ".mp4"
    return input.with_name(f"{input.stem}.ar{suffix}")


def track_files(path: Path, count: int) -> list[Path]:
    """The file for one track; for several NAME.1.json, NAME.2.json and so on."""
    return [path] if count == 1 else [path.with_name(f"{path.stem}.{i}{path.suffix}") for i in range(1, count + 1)]
