"""In which form an output is written: its codec, bits and colour, by what is asked for and what the source has."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..choices import Depth
from . import codecs
from .color import Colour
from .mastering import Mastering
from .planes import plain
from .reader import VideoInfo
from .siting import chroma_siting, turned


@dataclass(frozen=True)
class Form:
    """The form of an output.

    Attributes:
        codec: by its name in the table, or FFmpeg's encoder.
        depth: bits per sample.
        pixel_format: the source's, where it is preferred among those of this depth; None for 4:2:0.
        colour: the source's; None for BT.709.
        mastering: what an HDR source says of itself, where the output is HDR.
        siting: where chroma samples lie, where they are the source's; None where that is not known.
        warnings: what the source has and the output has not, though it was not asked for.
    """

    codec: str
    depth: int
    pixel_format: str | None
    colour: Colour | None
    mastering: Mastering | None = None
    warnings: tuple[str, ...] = ()
    siting: str | None = None


def form_of(output: Path, info: VideoInfo, depth: Depth, codec: str | None, tonemap: bool = False) -> Form:
    """The form in which a video is written.

    Bits stay as many as the source's where the codec has them. Chroma stays where there are more than 8 bits, or that
    is asked for; else it becomes 4:2:0, for players often know nothing else in 8 bits. HDR stays where there are more
    than 8 bits, which do not hold it without steps.

    Args:
        output: with the ending of a container or a picture.
        info: of the source.
        depth: bits as they are asked for.
        codec: as it is asked for; None for the container's usual, which depends on the bits.
        tonemap: whether HDR is to be shown in SDR; it has 8 bits then, where nothing else is asked for.

    Raises:
        InputError: an unknown container or codec, or a codec that the container cannot hold.
    """
    if depth == "auto" and tonemap and info.hdr is not None:
        depth = "8"
    wanted = int(depth) if depth.isdigit() else info.depth
    warnings: list[str] = []
    if tonemap and info.hdr is None:
        warnings.append(f"{info.path.name} is not HDR: --tonemap changes nothing")
    if codecs.is_picture(output):
        # Only floats in linear light tell HDR from SDR.
        in_sdr = info.hdr is not None and (tonemap or wanted <= 8 or not codecs.is_linear(output))
        if in_sdr and not tonemap and depth != "8":
            warnings.append(f"pictures do not say that they are HDR: {info.path.name} is shown in SDR")
        colour = None if in_sdr else info.colour
        return Form(codecs.choose(output, codec).name, wanted, None, colour, None, tuple(warnings))
    size = info.width, info.height
    chosen = codecs.choose(output, codec, depth=wanted)
    if codec is None and wanted > 8 and codecs.most_bits(chosen, wanted, *size) == 8:
        chosen = codecs.choose(output, None)
    bits = wanted
    if depth == "auto" and wanted > 8:
        bits = codecs.most_bits(chosen, wanted, *size)
        if bits < wanted:
            warnings.append(f"{chosen.title} does not hold {wanted} bits in this size: the output has {bits}")
    keeps_chroma = depth == "source" or bits > 8 or plain(info.pixel_format) == "yuv420p"
    pixel_format = info.pixel_format if keeps_chroma else None
    mastering = info.mastering
    if info.hdr is not None and (tonemap or bits == 8):
        if not tonemap and depth != "8":
            warnings.append(f"8 bits do not hold HDR: {info.path.name} is shown in SDR")
        return Form(chosen.name, bits, pixel_format, None, None, tuple(warnings))
    if info.dynamic is not None:
        warnings.append(f"{info.dynamic} dynamic metadata cannot be kept: {info.path.name} becomes plain HDR")
    if mastering is not None and not mastering.can_be_written(chosen.encoder):
        warnings.append(f"{chosen.title} has no place for the mastering display's metadata: they are left out")
    siting = None
    if pixel_format is not None and plain(pixel_format).startswith("yuv420"):
        siting = turned(chroma_siting(info.path), info.rotation)
    return Form(chosen.name, bits, pixel_format, info.colour, mastering, tuple(warnings), siting)
