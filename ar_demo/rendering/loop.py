"""The render loop: ads onto their tracked surfaces, frame by frame, into a video."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from hdn.imaging.arrays import Image

from ..errors import InputError
from ..media.audio import Audio
from ..media.reader import VideoReader
from ..media.writer import VideoWriter
from ..options import Options, Placing
from ..progress import Progress, silent
from ..results import Result, total
from ..scene.conditions import Appearance, Conditions
from ..track import Track
from .painting import Painter
from .presentation import presentation


@dataclass(frozen=True)
class Layer:
    """An ad, or an effect that needs none, on one tracked surface."""

    ad: Path | str | None
    track: Track
    placing: Placing


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
    return render_layers(input, [Layer(ad, track, options)], output, options, progress)


def render_layers(
    input: Path | str, layers: Sequence[Layer], output: Path | str, options: Options, progress: Progress = silent
) -> Result:
    """Lays several ads on a video, which is decoded once; later ones lie over earlier ones. See `render`.

    The sound of the ad, where `options.audio` asks for it, is the first ad's.
    """
    started = time.perf_counter()
    output = Path(output)
    check_output(output, options, input, *(layer.ad for layer in layers))
    with ExitStack() as stack:
        reader = stack.enter_context(VideoReader(input))
        info = reader.info
        painters, looks, poses, opacities = [], [], [], []
        for layer in layers:
            layer.track.check_belongs_to(Path(input), info.width, info.height)
            painter = Painter(layer.ad, layer.placing, layer.track.quad, (info.width, info.height), options.backend)
            painters.append(stack.enter_context(painter))
            looks.append(_Look(reader, layer))
            where, strength = presentation(layer.track, layer.placing)
            poses.append(where)
            opacities.append(strength)
        heard = next((layer for layer in layers if layer.ad is not None), layers[0])
        audio = Audio(options.audio, Path(input), Path(heard.ad) if heard.ad else None, heard.placing.playback)
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
        first = None
        count, length = 0, max(len(layer.track) for layer in layers)
        for frame in reader.frames(0, length):
            first = frame.time if first is None else first
            i = frame.index
            seen = [look.at(i, frame.image) for look in looks]  # before anything is drawn
            for painter, where, strength, conditions in zip(painters, poses, opacities, seen, strict=True):
                if i < len(where):
                    painter.draw(frame.image, where[i], float(strength[i]), frame.time - first, conditions)
            writer.write(frame.image, frame.time, frame.duration)
            count += 1
            progress("render", count, length, layers[0].track.states[i] if i < len(layers[0].track) else "")
        warnings = [w for layer in layers for w in layer.track.warnings] + reader.warnings
        if count < length:
            warnings.append(f"{input} has only {count} of the track's {length} frames: the rest is left out")
        description = painters[0].description
    return Result(
        output,
        count,
        total(layer.track.counts for layer in layers),
        time.perf_counter() - started,
        description,
        list(dict.fromkeys([*warnings, *audio.warnings])),
        [{"ad": layer.ad and str(layer.ad), "states": layer.track.counts} for layer in layers],
    )


class _Look:
    """How a layer's surface looks in frame after frame; nothing is told where its placing is flat or it needs no ad."""

    def __init__(self, reader: VideoReader, layer: Layer) -> None:
        self._track = layer.track
        self._appearance: Appearance | None = None
        if not layer.placing.in_scene:
            return
        at = layer.track.reference_frame
        for frame in reader.frames(at, at + 1):
            self._appearance = Appearance(frame.image, layer.track.quad)

    def at(self, index: int, image: Image) -> Conditions | None:
        """The conditions in a frame (H, W, 3) of this index; None where nothing is told."""
        track, appearance = self._track, self._appearance
        if appearance is None or index >= len(track):
            return None
        lost, cut = track.states[index] == "lost", index in track.cuts
        return appearance.conditions(image, track.corners[index], float(track.deviation[index]), lost, cut)


def check_output(output: Path, options: Options, *inputs: Path | str | None) -> None:
    """Raises InputError where the output may not be written: it exists, is an input, or its folder is missing."""
    if not output.parent.is_dir():
        raise InputError(f"the output folder {output.parent} does not exist: make it first")
    if any(source is not None and Path(source).resolve() == output.resolve() for source in inputs):
        raise InputError(f"{output} is an input as well: choose another output with -o")
    if output.exists() and not options.overwrite:
        raise InputError(f"{output} exists already: choose another output with -o, or give --overwrite")
