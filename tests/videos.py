"""What tests do with videos by our own means: read, write and rewrite them, and look up an ad's picture."""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

from ar_demo.media.ad import Ad
from ar_demo.media.reader import Frame, VideoReader
from ar_demo.media.streams import Streams
from ar_demo.media.writer import VideoWriter
from hdn.imaging.arrays import Floats, Picture

from . import clips


def numbers(frames: Iterable[Frame]) -> list[int]:
    """The numbers that pictures of `clips.number_image` say."""
    return [clips.number_of(frame.image) for frame in frames]


def number_shown(ad: Ad, time: Fraction | float) -> int:
    """The number that an ad's picture says at a time in seconds."""
    image = ad.at(Fraction(time))
    assert image is not None
    return clips.number_of(image[..., :3])


def write(path: Path, images: Sequence[Picture], rate: Fraction | int = 25, **options: Any) -> Path:
    """Writes pictures at a constant rate; options: of `VideoWriter`."""
    height, width = images[0].shape[:2]
    with VideoWriter(path, width, height, Fraction(rate), **options) as writer:
        for index, image in enumerate(images):
            writer.write(image, index / Fraction(rate))
    return path


def rewrite(source: Path, target: Path, streams: Streams, stop: int | None = None) -> Path:
    """Reads a video and writes it as it is, with the given sound."""
    with VideoReader(source) as reader:
        info = reader.info
        with VideoWriter(
            target, info.width, info.height, info.rate, streams=streams, time_base=info.time_base
        ) as writer:
            for frame in reader.frames(0, stop):
                writer.write(frame.image, frame.time, frame.duration)
    return target


def sound_codecs(path: Path) -> list[str]:
    """Codecs of a file's sound tracks."""
    with av.open(str(path)) as container:
        return [stream.codec_context.name for stream in container.streams.audio]


def clip(path: Path, seconds: float = 2, **options: Any) -> Path:
    """Makes a numbered clip at 25 frames a second; options: of `clips.make_clip`."""
    return clips.make_clip(path, clips.numbered(round(seconds * 25)), **options)


def floats_of(path: Path) -> Floats:
    """The samples (h, w, 3 or 4) of an OpenEXR picture of half floats."""
    with av.open(str(path)) as container:
        frame = next(container.decode(video=0))
    rows = [np.frombuffer(plane, np.float16).reshape(plane.height, -1)[:, : plane.width] for plane in frame.planes]
    return np.stack([rows[index] for index in (2, 0, 1, 3)[: len(rows)]], -1).astype(np.float32)
