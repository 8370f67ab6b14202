"""Reading a video: upright RGB frames with exact times, forwards and backwards."""

from __future__ import annotations

import bisect
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

from ..closing import Closing
from ..errors import InputError
from . import color
from .decode import Clock, decode, frame_rate, open_video, stream_duration

log = logging.getLogger(__name__)

BACKWARD_BYTES = 256 << 20  # decoded (not yet RGB) frames held at once while reading backwards


@dataclass(frozen=True)
class VideoInfo:
    """What a video file says of itself.

    width, height: as displayed, after the rotation in the file is applied.
    rate: average frames per second. time_base: seconds per timestamp tick.
    frames, duration (seconds): the container's estimates, None where it gives none.
    rotation: counterclockwise turn in degrees that was needed to make the frames upright.
    pixel_aspect: width of a pixel over its height, as displayed.
    matrix: "bt709", "bt601", "bt2020", "smpte240m", "fcc" or "rgb"; untagged is BT.601 below 720 lines, else BT.709.
    """

    path: Path
    width: int
    height: int
    rate: Fraction
    time_base: Fraction
    frames: int | None
    duration: Fraction | None
    rotation: int
    pixel_aspect: Fraction
    matrix: str
    full_range: bool
    has_audio: bool


@dataclass(frozen=True)
class Frame:
    """One picture: index from 0, exact time and duration in seconds, image uint8 (H, W, 3) RGB, upright.

    The duration lasts until the next frame, the last frame's until the end that the container states.
    """

    index: int
    time: Fraction
    duration: Fraction
    image: NDArray[np.uint8]


@dataclass(frozen=True)
class _Decoded:
    index: int
    time: Fraction
    frame: av.VideoFrame


class VideoReader(Closing):
    """Reads a video file frame by frame.

    Every iteration opens the file anew, so several may run side by side. What is wrong with the file but does not
    stop the reading is appended to `warnings` (and logged).

    Raises InputError where the file is missing, unreadable, no video, or has no picture that can be decoded.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.warnings: list[str] = []
        self._containers: list[InputContainer] = []
        self._pts: list[int | None] = []  # timestamp of each frame, learnt while decoding
        self._times: list[Fraction] = []  # and its time
        self._keys: list[int] = []  # indices of the key frames
        self._complete = False  # whether the whole file has been decoded
        self.info = self._probe()

    @property
    def times(self) -> list[Fraction]:
        """Times of the frames, seconds, as far as they are known."""
        return self._times

    @property
    def seekable(self) -> bool:
        """Whether all times are known, and late frames are reached without decoding those before them."""
        return False

    def close(self) -> None:
        """Closes what unfinished iterations hold open."""
        for container in self._containers:
            container.close()
        self._containers.clear()

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        """Frames start to stop - 1 (to the end for None). Decoding always begins at the first frame."""
        to_rgb = color.ToRGB()
        waiting = None  # a frame whose duration is known once the next one is decoded
        for decoded in self._decode(None if stop is None else stop + 1):
            if waiting is not None and waiting.index >= start:
                yield self._finish(waiting, to_rgb)
            waiting = decoded
        if waiting is not None and waiting.index >= start and (stop is None or waiting.index < stop):
            yield self._finish(waiting, to_rgb)

    def backward(self, stop: int, start: int = 0) -> Iterator[Frame]:
        """Frames stop - 1, stop - 2 ... start, the same as reading forward and reversing, in bounded memory."""
        if stop >= len(self._times) and not self._complete:
            for _ in self._decode(stop + 1):  # one more tells how long the last one lasts
                pass
        stop = min(stop, len(self._times))
        to_rgb = color.ToRGB()
        bytes_each = self.info.width * self.info.height * 3 // 2  # 8 bit 4:2:0; others take more, but not much
        size = max(1, BACKWARD_BYTES // bytes_each)
        while stop > start:
            first = max(start, stop - size)
            chunk = list(self._decode_range(first, stop))
            while chunk:
                yield self._finish(chunk.pop(), to_rgb)
            stop = first

    # ---- inside ----

    def _probe(self) -> VideoInfo:
        first = next(self._decode(1), None)
        if first is None:
            raise InputError(f"{self.path} has no frame that can be decoded: the file is damaged or empty")
        frame = first.frame
        self._rotation = color.rotation_of(frame)
        self._size = frame.width, frame.height
        if color.is_hdr(frame):
            self._warn(f"{self.path.name} is HDR (PQ or HLG): it is taken as it is, without tone mapping")
        sideways = self._rotation in (90, 270)
        container, stream = self._open()
        rate = frame_rate(stream)
        self._promised = stream_duration(container, stream, first.time)
        duration = self._promised or (Fraction(container.duration, av.time_base) if container.duration else None)
        aspect = stream.sample_aspect_ratio or Fraction(1)
        info = VideoInfo(
            path=self.path,
            width=frame.height if sideways else frame.width,
            height=frame.width if sideways else frame.height,
            rate=rate,
            time_base=stream.time_base or 1 / rate,
            frames=stream.frames or (round(duration * rate) if duration else None),
            duration=duration,
            rotation=self._rotation,
            pixel_aspect=1 / aspect if sideways else aspect,
            matrix=color.matrix_of(frame),
            full_range=color.is_full_range(frame),
            has_audio=bool(container.streams.audio),
        )
        self._shut(container)
        return info

    def _open(self) -> tuple[InputContainer, VideoStream]:
        container, stream = open_video(self.path)
        self._containers.append(container)
        return container, stream

    def _shut(self, container: InputContainer) -> None:
        if container in self._containers:
            self._containers.remove(container)
        container.close()

    def _warn(self, message: str) -> None:
        if message not in self.warnings:
            self.warnings.append(message)
            log.warning(message)

    def _finish(self, decoded: _Decoded, to_rgb: color.ToRGB) -> Frame:
        frame = decoded.frame
        if (frame.width, frame.height) != self._size:
            self._warn(f"{self.path.name} changes its picture size on the way: it is scaled to the first frame's size")
        return Frame(
            decoded.index, decoded.time, self._duration(decoded.index), to_rgb(frame, self._rotation, self._size)
        )

    def _duration(self, index: int) -> Fraction:
        if index + 1 < len(self._times):
            return self._times[index + 1] - self._times[index]
        step = 1 / self.info.rate
        if self._promised is None or not self._complete:
            return step
        left = self._times[0] + self._promised - self._times[index]
        return (
            left if 0 < left < max(Fraction(1), 10 * step) else step
        )  # else the file breaks off, or its header is wrong

    def _decode(self, stop: int | None) -> Iterator[_Decoded]:
        """Decodes from the first frame on and learns what seeking needs."""
        container, stream = self._open()
        try:
            count = 0
            broken = False

            def damaged() -> None:
                nonlocal broken
                if not broken:
                    self._warn(
                        f"{self.path.name} is damaged after frame {max(count - 1, 0)}: what can be decoded is used"
                    )
                broken = True

            rate = frame_rate(stream)
            clock = Clock(rate, stream.time_base or 1 / rate)
            time = Fraction(0)
            for frame in decode(container, stream, damaged):
                time = clock.time(frame)
                if count == len(self._times):
                    self._times.append(time)
                    self._pts.append(frame.pts)
                    if frame.key_frame:
                        self._keys.append(count)
                yield _Decoded(count, time, frame)
                count += 1
                if count == stop:
                    return
            self._complete = True
            self._check_length(count)
        finally:
            self._shut(container)

    def _check_length(self, count: int) -> None:
        """Many demuxers end a file that breaks off without a word: compare with the length the header promises."""
        if self._promised is None or not count:
            return
        step = 1 / self.info.rate
        found = self._times[count - 1] - self._times[0] + step
        if found < self._promised - max(10 * step, Fraction(1)):
            self._warn(
                f"{self.path.name} breaks off after frame {count - 1} "
                f"({float(found):.2f} of {float(self._promised):.2f} s): "
                "what was decoded up to there is used"
            )

    def _decode_range(self, start: int, stop: int) -> Iterator[_Decoded]:
        """Frames start to stop - 1, by seeking to the key frame before them where that proves exact."""
        key = self._keys[bisect.bisect_right(self._keys, start) - 1] if self._keys else 0
        seekable = key > 0 and None not in self._pts[key:stop]
        found = self._seek_and_decode(key, start, stop) if seekable else None
        if found is None:
            if seekable:
                log.info("%s: seeking is inexact, decoding from the start instead", self.path.name)
            found = [decoded for decoded in self._decode(stop) if decoded.index >= start]
        yield from found

    def _seek_and_decode(self, key: int, start: int, stop: int) -> list[_Decoded] | None:
        """As _decode_range, from key frame `key`; None where other frames came than were decoded the first time."""
        container, stream = self._open()
        try:
            key_pts = self._pts[key]
            assert key_pts is not None
            container.seek(key_pts, stream=stream)
            index, found = key, []
            for frame in decode(container, stream, lambda: None):
                if index == key and frame.pts is not None and frame.pts < key_pts:
                    continue  # from before the key frame: the seek landed earlier, or an open group's leading frames
                if frame.pts != self._pts[index]:
                    return None
                if index >= start:
                    found.append(_Decoded(index, self._times[index], frame))
                index += 1
                if index == stop:
                    return found
            return None
        except av.FFmpegError:
            return None
        finally:
            self._shut(container)
