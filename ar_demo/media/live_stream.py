"""Live sources: frames as they come, late ones dropped."""

import logging
import platform
import re
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager
from fractions import Fraction
from itertools import chain
from pathlib import Path
from threading import Condition, Event, Thread
from typing import Any

import av
from av.container import InputContainer
from av.video.stream import VideoStream

from ..errors import InputError
from . import color
from .decode import Clock, decode, frame_rate, open_video
from .deinterlacing import deinterlaced, is_interlaced
from .reader import Frame

log = logging.getLogger(__name__)

TIMEOUT_SECONDS = 10.0  # seconds without an answer after which a network source counts as gone


class Stream(AbstractContextManager["Stream"]):
    """A camera, a network stream, or a file played as one. A context manager that closes it.

    A thread decodes and keeps the newest frame ready: what is not fetched before the next one comes is dropped, so that
    nothing queues up. A file is played at the pace of its times.

    Attributes:
        name: the source.
        width, height: of the frames, upright, px.
        rate: frames per second, as far as known.
        time_base: seconds per tick.
        dropped: frames that came too fast.
        warnings: what was wrong with the source.
        came: `time.monotonic` of when the newest frame that was fetched was decoded, or due where a file is played.
    """

    def __init__(self, source: str) -> None:
        """Opens a source and waits for its first frame.

        Args:
            source: a camera's number or device (0, /dev/video0), a URL (rtsp://, http://), - for standard input, or a
                file.

        Raises:
            InputError: it cannot be opened, or shows nothing.
        """
        self.name = source
        self.dropped = 0
        self.came = time.monotonic()
        self.warnings: list[str] = []
        self._container, self._stream, self._paced = _open(source)
        self._frames = decode(self._container, self._stream, self._damaged)
        first = next(self._frames, None)
        if first is None:
            self._container.close()
            raise InputError(f"{source} shows no frame that can be decoded: check the source")
        if is_interlaced(first, self._stream.codec_context):
            log.info("%s is interlaced: it is deinterlaced (bwdif), a frame late", source)
            self._frames = deinterlaced(chain([first], self._frames))
            first = next(self._frames)
        self._first = first
        self._hdr = color.hdr_of(first)
        if self._hdr is not None:
            log.info("%s is HDR: it is shown in SDR", source)
        self._rotation = color.rotation_of(first)
        self._size = first.width, first.height
        sideways = self._rotation in (90, 270)
        self.width, self.height = self._size[::-1] if sideways else self._size
        self.rate = frame_rate(self._stream)
        self.time_base = self._stream.time_base or 1 / self.rate
        self._stop = Event()
        self._ready = Condition()
        self._newest: tuple[int, Fraction, av.VideoFrame, float] | None = None
        self._over = False
        self._error: BaseException | None = None
        self._thread = Thread(target=self._read, name="stream", daemon=True)

    def __exit__(self, *error: object) -> None:
        self.close()

    def frames(self, stop: Event) -> Iterator[Frame]:
        """Frames as they come, until the source ends or `stop` is set; their index counts dropped ones too.

        What goes wrong in the thread that decodes is raised here.
        """
        to_rgb = color.ToRGB(tonemap=self._hdr)
        self._thread.start()
        while not stop.is_set():
            with self._ready:
                while self._newest is None and not self._over and not stop.is_set():
                    self._ready.wait(0.1)  # so that a signal is seen to
                newest, self._newest = self._newest, None
            if newest is None:
                if self._error is not None:
                    raise self._error
                return
            index, at, frame, self.came = newest
            yield Frame(index, at, 1 / self.rate, to_rgb(frame, self._rotation, self._size))

    def close(self) -> None:
        """Ends the thread and closes the source; calling again does nothing."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(TIMEOUT_SECONDS)
        if not self._thread.is_alive():  # else it is stuck in the driver, and goes with the process
            self._newest = None
            self._frames.close()  # before what it decodes from goes
            self._container.close()

    def _read(self) -> None:
        """In the thread: shows all frames, and says when there are no more."""
        try:
            self._show()
        except BaseException as error:
            self._error = error
        with self._ready:
            self._over = True
            self._ready.notify()

    def _show(self) -> None:
        """Decodes, waits for a file's pace, and puts each frame where the last one was."""
        clock = Clock(self.rate, self.time_base)
        begun, zero = time.monotonic(), None
        frame: av.VideoFrame | None = self._first
        index = 0
        while frame is not None and not self._stop.is_set():
            at = clock.time(frame)
            zero = at if zero is None else zero
            came = begun + float(at - zero) if self._paced else time.monotonic()
            if self._stop.wait(max(0.0, came - time.monotonic())):
                break
            with self._ready:
                self.dropped += self._newest is not None
                self._newest = index, at, frame, came
                self._ready.notify()
            frame, index = next(self._frames, None), index + 1

    def _damaged(self, since: int | None) -> None:
        message = f"{self.name} is damaged or broke off: what can be decoded is used"
        if message not in self.warnings:
            self.warnings.append(message)


def _open(source: str) -> tuple[InputContainer, VideoStream, bool]:
    """The source's container and picture stream, and whether it has to be played at a pace."""
    if not re.fullmatch(r"-|\d+", source) and "://" not in source and not source.startswith("/dev/"):
        return *open_video(Path(source)), True
    where: dict[str, Any] = {}
    target = source
    if source == "-":
        target = "pipe:0"
    elif "://" not in source:
        system = platform.system()
        if system == "Windows":
            raise InputError("cameras cannot be opened on Windows: give a stream's URL (rtsp://, http://)")
        number = source.isdigit()
        target = source if not number else f"{source}:none" if system == "Darwin" else f"/dev/video{source}"
        where = {"format": "avfoundation" if system == "Darwin" else "v4l2"}
    elif source.startswith("rtsp"):
        where = {"options": {"rtsp_transport": "tcp"}}
    try:
        container = av.open(target, timeout=TIMEOUT_SECONDS if "://" in source else None, **where)
    except (av.FFmpegError, OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot open {source} ({reason.lower()}): check the camera or the address") from error
    if not container.streams.video:
        container.close()
        raise InputError(f"{source} has no picture: give a camera or a stream with one")
    return container, container.streams.video[0], False
