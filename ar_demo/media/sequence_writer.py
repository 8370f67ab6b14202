"""Writing an image sequence: a picture a frame, which appear under their names only once all of them are complete."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self, cast

import av
import numpy as np

from hdn.imaging.arrays import Floats, Picture

from ..errors import InputError, RunError
from . import codecs
from .claims import Claim, reason_of
from .color import FromRGB
from .numbering import Numbering
from .planes import Drawn, Planes
from .srgb import to_linear
from .transparency import FromRGBA

Light = Callable[[Picture], Floats]


class SequenceWriter:
    """Writes frames to pictures. A context manager as `VideoWriter`: leaving it by an exception leaves none of them."""

    def __init__(
        self,
        path: Path | str | Claim,
        width: int,
        height: int,
        *,
        depth: int = 8,
        alpha: bool = False,
        first: int = 0,
        rate: Fraction | None = None,
        light: Light = to_linear,
        whole: bool = True,
    ) -> None:
        """Begins a sequence; what there is of one of this name is replaced.

        Args:
            path: with the ending of one of `codecs.PICTURES`, and a place for the number, see `Numbering`; without one
                it takes a single frame. A claim that was made earlier stays its owner's.
            width, height: of the frames, px.
            depth: bits per sample, of which PNG and TIFF have 8 or 16; OpenEXR's are half floats.
            alpha: whether frames have transparency.
            first: number of the first picture.
            rate: frames per second, by which a frame's time, from 0 on, gives its number, so that pictures that cannot
                be read leave a gap; None numbers them one after the other.
            light: what coded values, uint8 or uint16, are in linear light, for OpenEXR.
            whole: whether it takes the place of all pictures of this name, else of those with its numbers.

        Raises:
            InputError: the ending is that of no picture.
            RunError: it cannot be begun.
        """
        self.path = path.path if isinstance(path, Claim) else Path(path)
        suffix = self.path.suffix.lower()
        self._codec = codecs.picture_codec(self.path)
        self._size, self._alpha, self._first, self._rate = (width, height), alpha, first, rate
        self._is_whole = whole
        self._numbers: list[int] = []  # of the pictures that are complete
        self._names = Numbering.parse(self.path)
        self._pix_fmt = codecs.pixel_format(self._codec, suffix, width, height, depth, alpha=alpha)
        self._is_float, self._light = codecs.is_linear(self.path), light
        self._to_frame = FromRGBA(self._pix_fmt) if alpha and not self._is_float else FromRGB(self._pix_fmt)
        self._is_owner = not isinstance(path, Claim)
        self._claim = path if isinstance(path, Claim) else Claim(path, overwrite=True)
        try:
            self._claim.part.mkdir()
        except OSError as error:
            self.discard()
            raise self._failed(error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            try:
                self._finish()
            except BaseException:
                self.discard()
                raise
        self.discard()

    def write(
        self,
        image: Picture,
        time: Fraction,
        duration: Fraction | None = None,
        planes: Planes | None = None,
        drawn: Sequence[Drawn] = (),
    ) -> None:
        """Appends a picture.

        Args:
            image: (height, width, 3), or 4 with transparency. uint8 or uint16 as it is coded, which OpenEXR gets in
                linear light; or float32, for OpenEXR alone, as it is.
            time: seconds.
            duration, planes, drawn: are not used; a video has them.

        Raises:
            InputError: a second frame, where the name has no place for a number.
            RunError: writing failed.
        """
        if image.shape != (self._size[1], self._size[0], 4 if self._alpha else 3):
            raise ValueError(f"frame is {image.shape}, not {self._size[0]}x{self._size[1]}")
        if self._numbers and self._names is None:
            raise InputError(f"{self.path} is one picture: name a sequence, as {numbered(self.path)}")
        frame = self._float_frame(image) if self._is_float else self._to_frame(image)
        number = self._first + (len(self._numbers) if self._rate is None else round(time * self._rate))
        try:
            self._part(number).write_bytes(self._encoded(frame))
        except (av.FFmpegError, OSError) as error:
            raise self._failed(error) from error
        self._numbers.append(number)

    def discard(self) -> None:
        """Removes what is not finished."""
        self._claim.discard()
        if self._is_owner:
            self._claim.release()

    # ---- inside ----

    def _float_frame(self, image: Picture) -> av.VideoFrame:
        linear = image if image.dtype == np.float32 else self._light(image)
        # FFmpeg cuts off what half floats do not hold, which makes all a little darker.
        rounded: Floats = linear.astype(np.float16).astype(np.float32)
        return av.VideoFrame.from_ndarray(rounded, self._pix_fmt)

    def _encoded(self, frame: av.VideoFrame) -> bytes:
        encoder = cast(av.VideoCodecContext, av.CodecContext.create(self._codec.encoder, "w"))
        encoder.width, encoder.height = self._size
        encoder.pix_fmt, encoder.time_base = self._pix_fmt, Fraction(1, 25)
        encoder.options = self._codec.options_for(self._pix_fmt)
        return b"".join(bytes(packet) for packet in [*encoder.encode(frame), *encoder.encode(None)])

    def _part(self, number: int) -> Path:
        return self._claim.part / f"{number}{self.path.suffix}"

    def _finish(self) -> None:
        if not self._numbers:
            raise RunError(f"cannot write {self.path}: there is no frame to write")
        try:
            for number in self._names.numbers() if self._names and self._is_whole else []:
                self._name(number).unlink()  # those of a longer one would seem to belong to this one
            for number in self._numbers:
                os.replace(self._part(number), self._name(number))
        except OSError as error:
            raise self._failed(error) from error

    def _name(self, number: int) -> Path:
        return self._names.file(number) if self._names else self.path

    def _failed(self, error: Exception) -> RunError:
        return RunError(f"cannot write {self.path}: {reason_of(error)}")


def numbered(path: Path) -> str:
    """How a sequence of such pictures may be called."""
    return f"{path.stem}.%05d{path.suffix}"
