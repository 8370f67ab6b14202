"""Where frames go that are no file: a stream to another program."""

from fractions import Fraction
from types import TracebackType
from typing import Any, BinaryIO, Self, cast

import av
from av.video.stream import VideoStream

from hdn.imaging.arrays import Picture

from ..errors import RunError
from . import color


class StreamWriter:
    """Writes H.264 in MPEG-TS to a pipe, each frame at once. A context manager; leaving it ends the stream.

    Attributes:
        packets: written, one for each frame.
    """

    def __init__(self, pipe: BinaryIO, width: int, height: int, rate: Fraction, time_base: Fraction) -> None:
        """Begins the stream.

        Args:
            pipe: a binary file to write to; it is left open.
            width, height: of the frames, px; odd sizes lose their last column or row, which 4:2:0 has no room for.
            rate: average frames per second.
            time_base: seconds per tick.
        """
        self._width, self._height = width - width % 2, height - height % 2
        self._time_base = time_base
        self.packets = 0
        self._from_rgb = color.FromRGB("yuv420p")
        self._start: Fraction | None = None
        self._container = av.open(_Flushed(pipe), "w", format="mpegts", container_options={"flush_packets": "1"})
        options = {"preset": "ultrafast", "tune": "zerolatency"}
        stream: Any = self._container.add_stream("libx264", rate=rate, options=options)
        self._stream = cast(VideoStream, stream)
        context = self._stream.codec_context
        context.width, context.height, context.pix_fmt = self._width, self._height, "yuv420p"
        context.time_base = self._stream.time_base = time_base
        context.colorspace = context.color_primaries = context.color_trc = 1  # BT.709, as converted

    def write(self, image: Picture, time: Fraction) -> None:
        """Appends a frame.

        Args:
            image: (H, W, 3) RGB, uint8 or uint16.
            time: seconds.

        Raises:
            RunError: nobody reads the pipe any more.
        """
        self._start = time if self._start is None else self._start
        frame = self._from_rgb(image[: self._height, : self._width].copy() if self._odd(image) else image)
        frame.time_base, frame.pts = self._time_base, round((time - self._start) / self._time_base)
        self._mux(frame)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._mux(None)
            self._container.close()

    def _odd(self, image: Picture) -> bool:
        return image.shape[:2] != (self._height, self._width)

    def _mux(self, frame: av.VideoFrame | None) -> None:
        try:
            packets = self._stream.encode(frame)
            self._container.mux(packets)
            self.packets += len(packets)
        except (av.FFmpegError, OSError) as error:
            raise RunError("the output is no longer read: the stream ends here") from error


class _Flushed:
    """A pipe as PyAV writes to it, nothing being held back."""

    def __init__(self, pipe: BinaryIO) -> None:
        self._pipe = pipe

    def write(self, data: bytes) -> int:
        self._pipe.write(data)
        self._pipe.flush()
        return len(data)
