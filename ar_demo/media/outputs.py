"""Opening of an output by its name: a video, or an image sequence."""

from __future__ import annotations

from pathlib import Path

from ..errors import InputError
from . import codecs
from .claims import Claim
from .form import Form
from .numbering import Numbering
from .reader import VideoInfo
from .sequence_writer import SequenceWriter, numbered
from .srgb import to_linear
from .streams import Streams
from .writer import VideoWriter

Writer = VideoWriter | SequenceWriter


def open_output(
    output: Path | Claim,
    info: VideoInfo,
    form: Form,
    crf: float | None = None,
    streams: Streams | None = None,
    alpha: bool = False,
    whole: bool = True,
) -> Writer:
    """Begins an output of a video's size and times; see `VideoWriter` and `SequenceWriter`.

    Raises:
        InputError: a name or a quality that does not go together.
        RunError: it cannot be begun.
    """
    path = output.path if isinstance(output, Claim) else output
    if not codecs.is_picture(path):
        return VideoWriter(
            output,
            info.width,
            info.height,
            info.rate,
            codec=form.codec,
            crf=crf,
            streams=streams,
            time_base=info.time_base,
            pixel_aspect=info.pixel_aspect,
            depth=form.depth,
            pixel_format=form.pixel_format,
            colour=form.colour,
            mastering=form.mastering,
            siting=form.siting,
            alpha=alpha,
        )
    if crf is not None:
        raise InputError(f"--crf does nothing for {path.suffix}, which has one quality: leave it out")
    if info.frames != 1 and Numbering.parse(path) is None:
        raise InputError(f"{path} is one picture, and the video has several: name a sequence, as {numbered(path)}")
    return SequenceWriter(
        output,
        info.width,
        info.height,
        depth=form.depth,
        alpha=alpha,
        first=info.first_number,
        rate=info.rate if info.is_pictures else None,
        whole=whole,
        light=to_linear if info.hdr is None or form.colour is None else info.hdr.light,
    )
