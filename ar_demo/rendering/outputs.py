"""What a rendering writes: the video with its inserts, the inserts alone, their matte; one, or several in one pass."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from dataclasses import replace as changed
from pathlib import Path
from typing import Any

import numpy as np

from hdn.imaging.arrays import Picture

from ..compositing.separation import Insert
from ..errors import InputError
from ..media.claims import Claim
from ..media.codecs import holds_sound, is_picture
from ..media.color import BT709
from ..media.form import form_of
from ..media.outputs import Writer, open_output
from ..media.reader import Frame, VideoInfo
from ..media.streams import Streams
from ..options import OutputOptions
from .layers import LayerWriter, MatteWriter

OF_A_VIDEO = ("codec", "crf", "depth")
OF_SOUND = ("audio", "streams", "location")


@dataclass(frozen=True)
class Outputs:
    """Claims on the names of what is written; None for what is not.

    Attributes:
        video: with the inserts. layer: the inserts alone, with alpha. matte: their alpha alone.

    Raises:
        InputError: there is none of them.
    """

    video: Claim | None = None
    layer: Claim | None = None
    matte: Claim | None = None

    def __post_init__(self) -> None:
        if not self.paths:
            raise InputError("there is nothing to write: name an output with -o, --layer or --save-matte")

    @property
    def apart(self) -> bool:
        """Whether inserts are written by themselves."""
        return self.layer is not None or self.matte is not None

    @property
    def paths(self) -> list[Path]:
        """Of what is written."""
        return [claim.path for claim in (self.video, self.layer, self.matte) if claim is not None]

    def check(self, options: OutputOptions) -> None:
        """Raises InputError for an option that does nothing for these."""
        if self.video is None:
            _refuse(options, OF_A_VIDEO + OF_SOUND, "is for the video that -o names, and there is none")
        elif not holds_sound(self.video.path) and options.audio != "none":
            _refuse(options, OF_SOUND, f"is for sound, and {self.video.path.suffix} holds none")
        elif options.frames is not None:
            _refuse(options, OF_SOUND, "is for sound, which a part of a video gets when it is joined to the others")
        if self.layer is None:
            _refuse(options, ("alpha", "layer_codec"), "does nothing without --layer")
        if not any(map(is_picture, self.paths)):
            _refuse(options, ("start_number",), "is for image sequences, and none is written")


def _refuse(options: OutputOptions, names: Iterable[str], why: str) -> None:
    """Raises InputError for the first of the options named that is not as usual."""
    for name in names:
        if getattr(options, name) != getattr(OutputOptions, name):
            flag = "--no-location" if name == "location" else f"--{name.replace('_', '-')}"
            raise InputError(f"{flag} {why}: leave it out")


class OutputWriters(AbstractContextManager["OutputWriters"]):
    """Writes each frame to all outputs. A context manager; leaving it by an exception removes what there is of them.

    Attributes:
        is_deep: whether it takes frames of 16 bits per sample, else of 8.
        tonemap: whether it takes HDR as it is shown in SDR.
        warnings: what the video has and the outputs have not.
    """

    def __init__(
        self,
        outputs: Outputs,
        info: VideoInfo,
        options: OutputOptions,
        streams: Streams | None = None,
        part: range | None = None,
    ) -> None:
        """Begins the outputs, of the size and at the times of a video.

        Args: part: indices of the frames that will be written; None for all.

        Raises:
            InputError: a name or an option that does not go together.
            RunError: one cannot be begun.
        """
        outputs.check(options)
        if options.start_number is not None:
            info = changed(info, first_number=options.start_number)
        if part is not None and not info.is_pictures:  # which are numbered by their times
            info = changed(info, first_number=info.first_number + part.start)
        whole = part is None
        self.warnings: list[str] = []
        self.tonemap = options.tonemap
        self._video: Writer | None = None
        self._apart: list[LayerWriter | MatteWriter] = []
        self._bits = 8
        with ExitStack() as opened:
            if outputs.video is not None:
                form = form_of(outputs.video.path, info, options.depth, options.codec, self.tonemap)
                self.tonemap = form.colour is None
                self.warnings += form.warnings
                self._video, self._bits = (
                    open_output(outputs.video, info, form, options.crf, streams, whole=whole),
                    form.depth,
                )
                opened.push(self._video)
            if self.tonemap and info.hdr is not None:
                info = changed(info, colour=BT709, hdr=None)
                if outputs.layer is not None and not options.tonemap:
                    self.warnings.append(
                        f"{outputs.layer.path} is in SDR, as the video is: it fits that, not the source"
                    )
            if outputs.layer is not None:
                self._apart.append(LayerWriter(outputs.layer, info, options.layer_codec, options.alpha, whole))
                opened.push(self._apart[-1])
            if outputs.matte is not None:
                self._apart.append(MatteWriter(outputs.matte, info, whole=whole))
                opened.push(self._apart[-1])
            self._opened = opened.pop_all()
        self.is_deep = outputs.apart or self._bits > 8  # alpha is worked out in 16 bits

    def write(self, frame: Frame, insert: Insert | None = None) -> None:
        """Appends a frame with the inserts on it, and these alone, where they are written."""
        if self._video is not None:
            image = in_8_bits(frame.image) if self._bits <= 8 else frame.image
            self._video.write(image, frame.time, frame.duration, frame.planes, frame.drawn)
        for writer in self._apart:
            assert insert is not None
            writer.write(insert, frame.time, frame.duration)

    def discard(self) -> None:
        """Removes what there is of the outputs."""
        for writer in [self._video, *self._apart]:
            if writer is not None:
                writer.discard()

    def __exit__(self, *error: Any) -> None:
        self._opened.__exit__(*error)


def in_8_bits(image: Picture) -> Picture:
    """A frame of 8 or 16 bits in 8, rounded; the same array where it has them already."""
    if image.dtype == np.uint8:
        return image
    return ((image - (image >> 8) + 128) >> 8).astype(np.uint8)
