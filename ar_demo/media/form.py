"""In which form an output is written: its codec, bits and colour, by what is asked for and what the source has."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

from ..choices import Depth
from . import codecs
from .color import Colour
from .planes import plain
from .reader import VideoInfo

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Form:
    """The form of an output.

    Attributes:
        codec: by its name in the table, or FFmpeg's encoder.
        depth: bits per sample.
        pixel_format: the source's, where it is preferred among those of this depth; None for 4:2:0.
        colour: the source's.
    """

    codec: str
    depth: int
    pixel_format: str | None
    colour: Colour


def form_of(output: Path, info: VideoInfo, depth: Depth, codec: str | None) -> Form:
    """The form in which a video is written.

    Bits stay as many as the source's where the codec has them. Chroma stays where there are more than 8 bits, or that
    is asked for; else it becomes 4:2:0, for players often know nothing else in 8 bits.

    Args:
        output: with the ending of a container or a picture.
        info: of the source.
        depth: bits as they are asked for.
        codec: as it is asked for; None for the container's usual, which depends on the bits.

    Raises:
        InputError: an unknown container or codec, or a codec that the container cannot hold.
    """
    wanted = int(depth) if depth.isdigit() else info.depth
    if codecs.is_picture(output):
        return Form(codecs.choose(output, codec).name, wanted, None, info.colour)
    size = info.width, info.height
    chosen = codecs.choose(output, codec, depth=wanted)
    if codec is None and wanted > 8 and codecs.most_bits(chosen, wanted, *size) == 8:
        chosen = codecs.choose(output, None)
    bits = wanted
    if depth == "auto" and wanted > 8:
        bits = codecs.most_bits(chosen, wanted, *size)
        if bits < wanted:
            log.warning("%s does not hold %d bits in this size: the output has %d", chosen.title, wanted, bits)
    keeps_chroma = depth == "source" or bits > 8 or plain(info.pixel_format) == "yuv420p"
    return Form(chosen.name, bits, info.pixel_format if keeps_chroma else None, info.colour)
