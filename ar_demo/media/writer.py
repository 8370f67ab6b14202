"""Writing a video: exact times, tagged colour, sound beside it, and all of it or nothing."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, cast

import av
import numpy as np
from av.codec.context import Flags
from av.packet import Packet
from av.video.stream import VideoStream

from hdn.imaging.arrays import Picture

from ..errors import InputError, RunError
from . import codecs
from .claims import Claim, reason_of
from .color import BT709, Colour, FromRGB
from .mastering import Mastering
from .palette import ToPalette
from .planes import Drawn, Planes, plain
from .priority import priority_kept
from .streams import Streams
from .transparency import FromRGBA

log = logging.getLogger(__name__)

DEFAULT_CRF = 18  # visually lossless in H.264
os.environ.setdefault("SVT_LOG", "1")  # SVT-AV1 tells of itself unless its environment says: of errors alone


class VideoWriter:
    """Writes RGB frames to a video file, which appears under its name only once it is complete.

    Used as a context manager: leaving it normally finishes the file, leaving it by any exception removes what there is.
    Frame times start at zero in the file whatever the first one is, but for sound that begins before the picture; all
    that goes along moves with them.

    Attributes:
        packets: of the picture that are written, one for each frame.
    """

    def __init__(
        self,
        path: Path | str | Claim,
        width: int,
        height: int,
        rate: Fraction,
        *,
        codec: str | None = None,
        crf: float | None = None,
        streams: Streams | None = None,
        time_base: Fraction | None = None,
        pixel_aspect: Fraction = Fraction(1),
        fast: bool = False,
        depth: int = 8,
        pixel_format: str | None = None,
        colour: Colour | None = None,
        mastering: Mastering | None = None,
        siting: str | None = None,
        alpha: bool = False,
    ) -> None:
        """Begins a file.

        Args:
            path: in a folder that exists, with the ending of one of `codecs.CONTAINERS`; what is there is replaced. A
                claim that was made earlier says whether it may be, and stays its owner's.
            width, height: of the frames, px.
            rate: average frames per second, a hint for players; `write` says the times.
            codec: of `codecs.CODECS`, or an encoder by FFmpeg's name; None for the container's usual.
            crf: quality, lower is better, where the codec knows it: 0 to 51 (63 in VP9 and AV1).
            streams: what goes along with the picture, as sound; None for nothing.
            time_base: seconds per tick in which all frame times are whole (the source's); None takes one for `rate`.
            pixel_aspect: a pixel's width over its height.
            fast: larger files, but H.264 and H.265 keep up with a live source, and hold no frame back.
            depth: bits per sample in the file: 8, 10, 12 ...; whatever frames are of.
            pixel_format: FFmpeg's name of the source's, which is preferred where it has this depth and the codec takes
                it; None takes 4:2:0 before others.
            colour: of the source; kept where its pixel format is, or with alpha. Else the file is in BT.709, or in
                BT.2020 with the source's transfer where that is HDR. None for BT.709.
            mastering: what an HDR source says of itself, written where the codec has a place for it.
            siting: where the source's chroma samples lie, by FFmpeg's name; told where its pixel format is kept.
            alpha: whether frames have transparency.

        Raises:
            InputError: the container or codec cannot do this; nothing has been written.
            RunError: the file cannot be begun.
        """
        self.path = path.path if isinstance(path, Claim) else Path(path)
        chosen = codecs.choose(self.path, codec, alpha, depth)
        suffix = self.path.suffix.lower()
        container = codecs.CONTAINERS[suffix]
        like = pixel_format and plain(pixel_format)
        pix_fmt = codecs.pixel_format(chosen, suffix, width, height, depth, like, alpha)
        if (width % 2 or height % 2) and pix_fmt.startswith("yuv444"):
            log.warning("odd size %dx%d is written as 4:4:4, which some players do not show", width, height)
        if colour is None or (pix_fmt != like and not (alpha and pix_fmt.startswith("yuv"))):
            colour = (colour or BT709).converted(pix_fmt)
        told = mastering.options(chosen.encoder) if mastering else {}
        if siting is not None and pix_fmt == like:
            told["chroma_sample_location"] = siting

        self._size = width, height
        self._rate = Fraction(rate)
        self._time_base = container.tick or time_base or _fine_time_base(self._rate)
        self._least_ticks = container.least_ticks
        self._streams = streams
        self._form = pix_fmt, colour
        self._channels = 4 if alpha else 3
        self._to_frame = _conversion(pix_fmt, colour, width, height, alpha)
        self._start: Fraction | None = None  # time of the first frame
        self._zero = Fraction(0)  # where the file begins, by the clock of the frames' times
        self._kept: Packet[VideoStream] | None = None
        self._keeps = True
        self.packets = 0
        self._first_dts = 0
        self._last = self._end = Fraction(0)  # of the newest frame
        self._leaves_out = False
        self._pts = 0  # of the newest frame, ticks
        self._count = 0
        self._is_owner = not isinstance(path, Claim)
        self._claim = path if isinstance(path, Claim) else Claim(path, overwrite=True)
        try:
            options = dict(container.options)
            part = str(self._claim.part)
            self._container = av.open(part, "w", format=container.muxer, container_options=options)
            self._stream = self._add_stream(chosen, crf, pix_fmt, pixel_aspect, fast, told)
            if streams is not None:
                streams.attach(self._container, self._stream)
            with priority_kept():
                self._container.start_encoding()
        except (av.FFmpegError, ValueError, OSError) as error:
            self.discard()
            if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EACCES, errno.EROFS, errno.EPERM):
                raise self._failed(error) from error
            raise InputError(
                f"codec {chosen.name} cannot write {width}x{height} to {self.path.suffix}: "
                "choose another codec or container"
            ) from error
        except BaseException:
            self.discard()
            raise
        if (
            crf is not None and chosen.quality in self._stream.codec_context.options
        ):  # FFmpeg leaves what it did not use
            self.discard()
            raise InputError(f"codec {chosen.name} knows no crf: leave --crf out, or choose h264, h265, av1 or vp9")

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self.discard()
            return
        try:
            self._finish()
        except BaseException:
            self.discard()
            raise

    def write(
        self,
        image: Picture,
        time: Fraction,
        duration: Fraction | None = None,
        planes: Planes | None = None,
        drawn: Sequence[Drawn] = (),
    ) -> None:
        """Appends a frame.

        Args:
            image: (height, width, 3) RGB, uint8 or uint16 in full scale; it may be changed afterwards. With
                transparency (height, width, 4), uint16, straight or premultiplied as the file is to have it.
            time: seconds, later than the frame before.
            duration: seconds; it matters for the last frame only, and None is 1 / rate.
            planes: what the image was made from. Where the file has its pixel format and colour, these samples are
                written, and the image where it was drawn into.
            drawn: where that is.

        Raises:
            ValueError: the frame is of another size or kind, or not later than the one before.
            RunError: writing failed.
        """
        shape = self._size[1], self._size[0], self._channels
        if image.shape != shape or image.dtype not in (np.uint8, np.uint16):
            raise ValueError(f"frame is {image.dtype} {image.shape}, not {shape} of 8 or 16 bits")
        pts = self._tick_of(time, duration)
        if pts is None:
            return
        convert = self._to_frame
        if planes is not None and isinstance(convert, FromRGB) and (planes.pix_fmt, planes.colour) == self._form:
            frame = planes.with_drawn(image, drawn, convert)
        else:
            frame = convert(image)
        self._append(frame, pts, time, duration)

    def copy(self, planes: Planes, time: Fraction, duration: Fraction | None = None) -> None:
        """Appends a picture as it was decoded; time and duration as `write` takes them.

        Raises:
            ValueError: the file has another size, pixel format or colour; the time is not later than the one before.
            RunError: writing failed.
        """
        if (planes.size, (planes.pix_fmt, planes.colour)) != (self._size, self._form):
            raise ValueError(f"a picture in {planes.pix_fmt} cannot be copied to a file in {self._form[0]}")
        pts = self._tick_of(time, duration)
        if pts is not None:
            self._append(planes.own(), pts, time, duration)

    def discard(self) -> None:
        """Closes everything and removes the unfinished file, as leaving the context by an exception does."""
        if self._streams is not None:
            self._streams.close()
        self._claim.discard()  # before it is closed, which would complete a file of any size
        with contextlib.suppress(AttributeError, av.FFmpegError, OSError, ValueError):
            self._container.close()
        self._claim.discard()
        if self._is_owner:
            self._claim.release()

    # ---- inside ----

    def _tick_of(self, time: Fraction, duration: Fraction | None) -> int | None:
        """Takes note of the next frame's time, and says its tick; None for a frame that is left out."""
        if self._start is None:
            self._start = time
            self._zero = time if self._streams is None else self._streams.begin(time)
        elif time <= self._last:
            raise ValueError(f"frame time {time} is not later than {self._last}")
        self._last = time
        self._end = time + (duration or 1 / self._rate)
        pts = round((time - self._zero) / self._time_base)
        if self._count and pts - self._pts < self._least_ticks:
            self._say_left_out()
            return None
        self._pts = pts
        self._count += 1
        return pts

    def _append(self, frame: av.VideoFrame, pts: int, time: Fraction, duration: Fraction | None) -> None:
        self._form[1].tag(frame)  # some encoders go by these, and some by their own
        frame.time_base, frame.pts = self._time_base, pts
        frame.duration = round((duration or 1 / self._rate) / self._time_base)
        if self._streams is not None:
            streams = self._streams
            self._mux(lambda: streams.packets(time))
        self._mux(lambda: self._encode(frame))

    def _say_left_out(self) -> None:
        if not self._leaves_out:
            most = 1 / (self._least_ticks * self._time_base)
            log.warning("%s shows at most %d frames a second: frames are left out", self.path.name, most)
        self._leaves_out = True

    def _add_stream(
        self,
        codec: codecs.Codec,
        crf: float | None,
        pix_fmt: str,
        pixel_aspect: Fraction,
        fast: bool,
        told: dict[str, str],
    ) -> VideoStream:
        width, height = self._size
        options = codec.options_for(pix_fmt) | {codec.quality: f"{DEFAULT_CRF if crf is None else crf:g}"}
        if fast and codec.encoder in ("libx264", "libx265"):
            options |= {"preset": "ultrafast", "tune": "zerolatency"}
            self._keeps = False  # every frame lasts as it says, for none is shown out of order
        for name, value in told.items():
            options[name] = f"{options[name]}:{value}" if name in options else value
        stream = cast(VideoStream, self._container.add_stream(codec.encoder, rate=self._rate, options=options))
        stream.time_base = self._time_base
        context = stream.codec_context
        context.width, context.height, context.pix_fmt = width, height, pix_fmt
        context.time_base = self._time_base
        context.sample_aspect_ratio = pixel_aspect
        if self._channels == 4 and codec.encoder == "libvpx-vp9":
            stream.metadata["alpha_mode"] = "1"  # else players of WebM do not look for it
        context.flags |= Flags.frame_duration
        context.thread_type = "AUTO" if self._keeps else "SLICE"  # frames side by side would be held back
        if codec.encoder in ("libx265", "hevc_nvenc") and self._container.format.name in ("mp4", "mov"):
            context.codec_tag = "hvc1"  # Apple's players open no other
        self._form[1].tag(context)
        return stream

    def _encode(self, frame: av.VideoFrame | None) -> Iterator[Packet[VideoStream]]:
        """Packets that are ready, but for the newest, which may be kept back: see _last_packet."""
        for packet in self._stream.encode(frame):
            if self._count <= 2 and self._stream.codec_context.name == "libx265":
                packet.dts = packet.pts  # which x265 leaves unset, at random values, where there are no more frames
            if not self._keeps:
                self.packets += 1
                yield packet
                continue
            if self._kept is None:
                self._first_dts = packet.dts or 0
            else:
                self.packets += 1
                yield self._kept
            self._kept = packet

    def _last_packet(self) -> Iterator[Packet[VideoStream]]:
        """The packet written last, which in MP4 and MOV must make up the video's whole length.

        Their muxer adds up the packets in decoding order, where the last one seldom is the last one shown.
        """
        packet = self._kept
        if packet is None or self._start is None:
            return
        if self._container.format.name in ("mp4", "mov") and packet.dts is not None:
            length = round((self._end - self._start) / packet.time_base)
            packet.duration = max(1, length - (packet.dts - self._first_dts))
        yield packet

    def _mux(self, make: Callable[[], Iterable[Packet[Any]]]) -> None:
        try:
            for packet in make():
                self._container.mux(packet)
        except (av.FFmpegError, OSError) as error:
            raise self._failed(error) from error

    def _finish(self) -> None:
        if self._start is None:
            raise RunError(f"cannot write {self.path}: there is no frame to write")
        end = self._end
        if self._streams is not None:
            streams = self._streams
            self._mux(lambda: streams.finish(end))
        self._mux(lambda: self._encode(None))
        self._mux(self._last_packet)
        try:
            self._container.close()
        except (av.FFmpegError, OSError) as error:
            raise self._failed(error) from error
        self._claim.finish()
        if self._is_owner:
            self._claim.release()
        if self._streams is not None:
            self._streams.close()

    def _failed(self, error: Exception) -> RunError:
        return RunError(f"cannot write {self.path}: {reason_of(error)}")


def _conversion(pix_fmt: str, colour: Colour, width: int, height: int, alpha: bool) -> FromRGB | FromRGBA | ToPalette:
    """What makes frames of a pixel format of arrays."""
    if alpha:
        return FromRGBA(pix_fmt, colour)
    return ToPalette(width, height) if pix_fmt == "pal8" else FromRGB(pix_fmt, colour)


def _fine_time_base(rate: Fraction) -> Fraction:
    """Ticks in which frames at a constant rate fall exactly, at least 10000 a second so that others come close."""
    ticks = rate.numerator
    while ticks < 10000:
        ticks *= 2
    return Fraction(1, ticks)
