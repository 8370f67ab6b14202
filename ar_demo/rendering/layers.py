"""What was laid on a video, written by itself: as a layer with alpha, or its matte alone."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import replace as changed
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from hdn.imaging.arrays import Floats, Picture

from ..choices import Alpha
from ..compositing.separation import Insert, Light, straight
from ..errors import InputError
from ..media import codecs
from ..media.claims import Claim
from ..media.color import BT709, Colour
from ..media.form import Form
from ..media.outputs import open_output
from ..media.reader import VideoInfo
from ..media.srgb import to_linear


class LayerWriter(AbstractContextManager["LayerWriter"]):
    """Writes inserts with their alpha, in frames of the video's size and at its times."""

    def __init__(
        self,
        output: Path | Claim,
        info: VideoInfo,
        codec: str | None = None,
        alpha: Alpha | None = None,
        whole: bool = True,
    ) -> None:
        """Begins a layer.

        Args:
            output: a video or an image sequence that holds transparency.
            info: of the video that it is to be laid over.
            codec: of a video; None takes the container's usual that holds transparency.
            alpha: whether colours are times alpha; None takes what is usual: 'premultiplied' for OpenEXR, else
                'straight'.
            whole: of an image sequence, see `SequenceWriter`.

        Raises:
            InputError: an output that holds no transparency, or not this kind.
            RunError: it cannot be begun.
        """
        path = output.path if isinstance(output, Claim) else output
        self._light = _light(path, info)
        if self._light is not None and alpha == "straight":
            raise InputError("OpenEXR is premultiplied by its standard: leave --alpha out")
        chosen = codecs.choose(path, codec, alpha=True)
        if info.hdr is not None and all(codecs.depth_of(name) == 8 for name in chosen.transparent):
            raise InputError(f"{chosen.title} with alpha has 8 bits, too few for HDR: use .mov, .exr or --tonemap")
        self._is_straight = self._light is None and alpha != "premultiplied"
        self._levels = (1 << min(info.depth, 16)) - 1  # as many as the video has
        self._writer = open_output(
            output, info, Form(chosen.name, 8, None, _tagged(info.colour)), alpha=True, whole=whole
        )

    def write(self, insert: Insert, time: Fraction, duration: Fraction | None = None) -> None:
        """Appends a frame; see `VideoWriter.write`."""
        layer = insert.layer(self._levels, self._light)
        if self._is_straight:
            layer = straight(layer)
        self._writer.write(insert.framed(in_16_bits(layer) if self._light is None else layer), time, duration)

    def discard(self) -> None:
        """Removes what there is of it."""
        self._writer.discard()

    def __exit__(self, *error: Any) -> None:
        self._writer.__exit__(*error)


class MatteWriter(AbstractContextManager["MatteWriter"]):
    """Writes the alpha of inserts as grey pictures: black where the video is seen, white where the insert is."""

    def __init__(self, output: Path | Claim, info: VideoInfo, codec: str | None = None, whole: bool = True) -> None:
        """Begins a matte; see `LayerWriter`."""
        path = output.path if isinstance(output, Claim) else output
        self._light = _light(path, info)
        self._levels = (1 << min(info.depth, 16)) - 1  # as many as the video has
        form = Form(codecs.choose(path, codec).name, 16 if codecs.is_picture(path) else 8, None, BT709)
        self._writer = open_output(output, info, form, whole=whole)

    def write(self, insert: Insert, time: Fraction, duration: Fraction | None = None) -> None:
        """Appends a frame; see `VideoWriter.write`."""
        alpha = insert.layer(self._levels, self._light)[..., 3:]
        grey = np.repeat(in_16_bits(alpha) if self._light is None else alpha, 3, axis=2)
        self._writer.write(insert.framed(grey), time, duration)

    def discard(self) -> None:
        """Removes what there is of it."""
        self._writer.discard()

    def __exit__(self, *error: Any) -> None:
        self._writer.__exit__(*error)


def _light(path: Path, info: VideoInfo) -> Light | None:
    """What a video's values stand for in a file of linear light; None for another kind of file."""
    if not codecs.is_linear(path):
        return None
    return to_linear if info.hdr is None else info.hdr.light


def in_16_bits(picture: Floats) -> Picture:
    """Values 0..1 as uint16 in full scale."""
    return np.rint(picture * np.float32(65535)).astype(np.uint16)


def _tagged(colour: Colour) -> Colour:
    """The colour of a layer in YUV: the video's in limited range, where that is said, so that both are read alike."""
    matrix, _, primaries, transfer = colour.tags
    if colour.matrix == "rgb" or matrix == 2:
        return BT709
    return changed(colour, full_range=False, tags=(matrix, 1, primaries, transfer))
