"""Writing SynthPlanar's clips: H.264 at a constant rate, converted to BT.709 and tagged so."""

from __future__ import annotations

import os
from fractions import Fraction
from pathlib import Path
from types import TracebackType

import av
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc

from ...errors import RunError
from ...imaging.arrays import Image

FPS = 30
# x264's settings, by which a seed is one file on every machine and under any load: what it writes depends on how many
# threads it has, and a lookahead in a thread of its own decides by chance. Where a frame's width is no multiple of 128,
# its AVX-512 code for the macroblock tree reads memory that nothing has written; no setting helps but those that
# compress worse, so that all SETTINGS have such widths.
X264 = {"preset": "veryfast", "threads": "2", "x264-params": "sync-lookahead=0"}


class Clip:
    """Writes RGB frames (H, W, 3), even in size, to an MP4 that appears under its name only once it is complete.

    Raises:
        RunError: writing fails.
    """

    def __init__(self, path: Path, width: int, height: int, crf: int) -> None:
        self._path = path
        self._part = path.with_name(f".{path.stem}.part{path.suffix}")
        try:
            self._container = av.open(str(self._part), "w", container_options={"movflags": "+faststart"})
            options = {"crf": str(crf)} | X264
            self._stream = self._container.add_stream("libx264", rate=Fraction(FPS), options=options)
            self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"
            context = self._stream.codec_context
            context.color_range, context.colorspace = ColorRange.MPEG, Colorspace.ITU709
            context.color_primaries, context.color_trc = ColorPrimaries.BT709, ColorTrc.BT709
            self._container.start_encoding()
        except (av.FFmpegError, OSError) as error:
            raise self._failed(error) from error
        self._index = 0

    def write(self, image: Image) -> None:
        frame = av.VideoFrame.from_ndarray(image, "rgb24").reformat(
            format="yuv420p",
            dst_colorspace=Colorspace.ITU709,
            dst_color_range=ColorRange.MPEG,
            dst_color_primaries=ColorPrimaries.BT709,
            dst_color_trc=ColorTrc.BT709,
        )
        frame.pts, frame.time_base = self._index, Fraction(1, FPS)
        self._index += 1
        try:
            self._container.mux(self._stream.encode(frame))
        except (av.FFmpegError, OSError) as error:
            raise self._failed(error) from error

    def __enter__(self) -> Clip:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._container.mux(self._stream.encode())
            self._container.close()
            if kind is None:
                os.replace(self._part, self._path)
        except (av.FFmpegError, OSError) as failure:
            if kind is None:
                raise self._failed(failure) from failure
        finally:
            self._part.unlink(missing_ok=True)

    def _failed(self, error: Exception) -> RunError:
        reason = getattr(error, "strerror", None) or str(error)
        return RunError(f"cannot write {self._path}: {reason}; see that there is room and leave to write there")
