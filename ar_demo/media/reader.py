"""Reading a video: upright RGB frames with exact times, forwards and backwards, from any frame on."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Container, Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from dataclasses import replace as changed
from fractions import Fraction
from functools import cache, partial
from pathlib import Path
from threading import Lock
from typing import Literal

import av
import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream

from hdn.imaging.arrays import Box, Image, Picture

from ..errors import InputError, RunError
from ..hdr import Hdr
from . import color
from .damage import DamageWatch, told
from .decode import Clock, decode, frame_rate, open_video, stream_duration
from .deinterlacing import deinterlaced, is_interlaced
from .download import Download, is_url
from .fingerprint import fingerprint
from .index import Index, demux
from .mastering import Mastering, dynamic_metadata
from .planes import Drawn, Planes, can_be_kept
from .sequences import ImageSequence

log = logging.getLogger(__name__)

BACKWARD_BYTES = 256 << 20  # decoded (not yet RGB) frames held at once while reading backwards
CHECKED_FRAMES = 16  # the first frames, decoded to see that packets and frames of a video agree


class IndexDropped(RunError):
    """Frames were numbered by the video's packets, and decoding shows that these numbers are wrong.

    It happens where packets in the middle of a file do not decode. The reader goes by decoding alone from then on, so
    that its numbers are right: whoever asked for frames by number starts over with the same reader.
    """


@dataclass(frozen=True)
class VideoInfo:
    """What a video file says of itself.

    Attributes:
        path: the file.
        width, height: px, as displayed, after the rotation in the file is applied.
        rate: average frames per second.
        time_base: seconds per timestamp tick.
        frames: the container's estimate, None where it gives none.
        duration: seconds, the container's estimate, None where it gives none.
        rotation: counterclockwise turn in degrees that was needed to make the frames upright.
        pixel_aspect: width of a pixel over its height, as displayed.
        depth: bits per sample of the source.
        pixel_format: of the source, by FFmpeg's name.
        colour: how its samples are to be understood.
        hdr: how they stand for light, where that is HDR; None for SDR.
        mastering: what it says of its mastering, where it is HDR.
        dynamic: whose metadata for each single frame it has, where it is HDR, as "Dolby Vision's"; None for none.
        interlaced: whether its first frame is; frames are given out deinterlaced.
        has_audio: whether there is sound beside the picture.
        is_pictures: whether it is an image sequence.
        first_number: that the first picture of one has in its name; 0 where it has none.
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
    depth: int
    pixel_format: str
    colour: color.Colour
    hdr: Hdr | None
    mastering: Mastering | None
    dynamic: str | None
    interlaced: bool
    has_audio: bool
    is_pictures: bool = False
    first_number: int = 0


@dataclass(frozen=True)
class Frame:
    """One picture.

    Attributes:
        index: from 0.
        time: exact, in seconds.
        duration: seconds until the next frame; the last frame's until the end that the container states.
        image: (H, W, 3) RGB, upright; uint8, or uint16 from 0 to 65535 where the reader was asked for 16 bits.
        planes: the picture as it was decoded; None where its samples cannot be kept.
        drawn: where `image` was drawn into since.
        hdr: how the image's samples stand for light, where it has 16 bits and is HDR; None for SDR.
        damaged: whether the file is damaged here, so that the picture may be wrong.
        view: (H, W, 3) the image in SDR and 8 bits, to be looked at; the same array where it is so.
    """

    index: int
    time: Fraction
    duration: Fraction
    image: Picture
    planes: Planes | None = None
    drawn: list[Drawn] = field(default_factory=list)
    hdr: Hdr | None = None
    damaged: bool = False
    view: Image = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "view", self._seen(self.image))

    def add_drawn(self, before: Picture, boxes: Iterable[Box]) -> None:
        """Takes note of what was drawn into the image, in these boxes. before: (H, W, 3) the image without that."""
        for box in boxes:
            self.drawn.append(Drawn.of(before, self.image, box))
            if self.view is not self.image:
                self.view[box] = self._seen(self.image[box])

    def _seen(self, image: Picture) -> Image:
        if image.dtype == np.uint8:
            return image
        return np.asarray((image if self.hdr is None else self.hdr.to_sdr(image)) >> 8, np.uint8)


@dataclass(frozen=True)
class _Decoded:
    index: int
    time: Fraction
    frame: av.VideoFrame


class VideoReader(AbstractContextManager["VideoReader"]):
    """Reads a video file frame by frame. A context manager.

    Every iteration opens the file anew, so several may run side by side. Frames are numbered as decoding from the
    start numbers them. A late frame is reached by seeking, with an index of the file's packets that is made when it is
    first needed; wherever decoding does not agree with it, the file is decoded from the start instead.

    Attributes:
        given: what was given to be opened.
        path: the file, or what its pictures are called by; of an address, the temporary file that it was fetched to.
        source: the file or the pictures, which others can read as well.
        info: what it says of itself.
        fingerprint: of its first frames, as many as given, see `media.fingerprint`; worked out once.
    """

    def __init__(self, path: Path | str | ImageSequence, depth: Literal[8, 16] = 8, tonemap: bool = True) -> None:
        """Opens a video and decodes its first frame.

        Args:
            path: the file; its http(s) address, from which it is fetched once; or pictures, see `ImageSequence.find`.
            depth: bits per sample of the frames: 8 gives uint8; 16 gives uint16 in full scale, without going through 8.
            tonemap: whether HDR is shown in SDR (BT.709); with 16 bits it may be left as it is.

        Raises:
            InputError: the file is missing, unreadable, no video, or has no picture that can be decoded.
            RunError: fetching it broke off.
        """
        self.given = str(path)
        self._download = Download.of(path) if is_url(path) else None
        path = path if self._download is None else self._download.path
        pictures = path if isinstance(path, ImageSequence) else ImageSequence.find(path)
        self.path = Path(path)
        self.source: Path | ImageSequence = pictures or self.path
        self._told: list[str] = []
        self._damaged: set[int] = set()  # frames seen so far that may be wrong
        self._missing = 0  # frames seen to be missing
        self._broken: int | None = None  # the frame after which a packet does not decode
        self._form: Literal["rgb24", "rgb48"] = "rgb24" if depth == 8 else "rgb48"
        self._tonemap = tonemap or depth == 8
        self._containers: list[InputContainer] = []
        self._promised: Fraction | None = None  # the picture's length in seconds, as the header has it
        self._index = Index()
        self._confirmed = 0  # its first frames that decoding from the start has given
        self._relied = -1  # the highest number not confirmed by which a frame was given out
        self._demuxed = False
        self._lock, self._demuxing = Lock(), Lock()  # iterations may run in several threads
        self.fingerprint = cache(partial(fingerprint, self.source))
        self.info = self._probe()

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes what unfinished iterations hold open."""
        for container in self._containers:
            container.close()
        self._containers.clear()

    @property
    def warnings(self) -> list[str]:
        """What is seen so far to be wrong with the file but does not stop the reading, one sentence each."""
        name, damage = self.path.name, []
        if self._damaged or self._missing:
            damage = [told(name, self._damaged, self._missing)]
        elif self._broken is not None:
            damage = [f"{name} is damaged after frame {self._broken}: what can be decoded is used"]
        return [*self._told, *damage]

    @property
    def is_damaged(self) -> bool:
        """Whether damage is seen so far."""
        return bool(self._damaged or self._missing) or self._broken is not None

    def take_note(self, warnings: Iterable[str]) -> None:
        """Adds what another reader of the same file told."""
        for warning in warnings:
            self._warn(warning)

    @property
    def first_number(self) -> int | None:
        """Number of the first picture of an image sequence; None for a video."""
        return self.info.first_number if isinstance(self.source, ImageSequence) else None

    @property
    def seekable(self) -> bool:
        """Whether all frames' times and key frames are known, by the packets or since all has been decoded."""
        self._demux()
        return self._index.whole

    @property
    def times(self) -> list[Fraction]:
        """Times of all frames in seconds, not to be changed; of those decoded so far where it is not `seekable`."""
        self._demux()
        return self._index.times

    def key_before(self, index: int) -> int:
        """The frame from which decoding begins where frame `index` is gone to, as far as it is known."""
        self._demux()
        return self._index.key_before(index)[0]

    def frames(
        self, start: int = 0, stop: int | None = None, only: Container[int] | None = None, rough: bool = False
    ) -> Iterator[Frame]:
        """Frames start to stop - 1 (to the end for None), or only some of these, by their indices.

        Those between are decoded, and not converted. Rough ones are for trackers, see `ToRGB`.

        Raises:
            IndexDropped: frames were given out under numbers that prove wrong, by this iteration or another.
        """
        to_rgb = self._converter(rough)
        waiting = None  # a frame whose duration is known once the next one is decoded
        for decoded in self._whole_frames(start, None if stop is None else stop + 1):
            if waiting is not None:
                yield self._finish(waiting, to_rgb)
            waiting = decoded if only is None or decoded.index in only else None
        if waiting is not None and (stop is None or waiting.index < stop):
            yield self._finish(waiting, to_rgb)

    def backward(self, stop: int, start: int = 0, rough: bool = False) -> Iterator[Frame]:
        """Frames stop - 1, stop - 2 ... start, the same as reading forward and reversing, in bounded memory.

        Raises:
            IndexDropped: as `frames`.
        """
        if not self._index.covers(stop + 1):
            self._demux()
        if not self._index.covers(stop + 1):
            for _ in self._decode(stop + 1):  # one more tells how long the last one lasts
                pass
        stop = min(stop, len(self._index))
        to_rgb = self._converter(rough)
        bytes_each = self.info.width * self.info.height * 3 // 2  # 8 bit 4:2:0; others take more, but not much
        size = max(1, BACKWARD_BYTES // bytes_each)
        while stop > start:
            first = max(start, stop - size)
            chunk = list(self._whole_frames(first, stop))
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
        hdr = color.hdr_of(frame)
        sideways = self._rotation in (90, 270)
        container, stream = self._open()
        self._is_interlaced = is_interlaced(frame, stream.codec_context)
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
            depth=color.depth_of(frame),
            pixel_format=frame.format.name,
            colour=color.Colour.of(frame),
            hdr=hdr,
            mastering=Mastering.of(frame) if hdr is not None else None,
            dynamic=dynamic_metadata(frame) if hdr is not None else None,
            interlaced=frame.interlaced_frame,
            has_audio=bool(container.streams.audio),
            is_pictures=isinstance(self.source, ImageSequence),
            first_number=self.source.first_number if isinstance(self.source, ImageSequence) else 0,
        )
        self._shut(container)
        return info

    def _open(self) -> tuple[InputContainer, VideoStream]:
        container, stream = open_video(self.source)
        self._containers.append(container)
        return container, stream

    def _shut(self, container: InputContainer) -> None:
        if container in self._containers:
            self._containers.remove(container)
        container.close()

    def _warn(self, message: str) -> None:
        if message not in self._told:
            self._told.append(message)
            log.warning(message)

    def _converter(self, rough: bool) -> color.ToRGB:
        return color.ToRGB(self._form, self.info.hdr if self._tonemap else None, rough)

    def _finish(self, decoded: _Decoded, to_rgb: color.ToRGB) -> Frame:
        frame = decoded.frame
        same = (frame.width, frame.height) == self._size
        if not same:
            self._warn(f"{self.path.name} changes its picture size on the way: it is scaled to the first frame's size")
        planes = Planes(frame, self._rotation) if same and can_be_kept(frame, self._rotation) else None
        image = to_rgb(frame, self._rotation, self._size)
        hdr = None if self._tonemap else self.info.hdr
        number, damaged = decoded.index, decoded.index in self._damaged
        return Frame(number, decoded.time, self._duration(number), image, planes, hdr=hdr, damaged=damaged)

    def _duration(self, index: int) -> Fraction:
        times = self._index.times
        if index + 1 < len(times):
            return times[index + 1] - times[index]
        step = 1 / self.info.rate
        if self._promised is None or not self._index.whole:
            return step
        left = times[0] + self._promised - times[index]
        # Where it makes no sense the file breaks off, or its header is wrong.
        return left if 0 < left < max(Fraction(1), 10 * step) else step

    def _decode(self, stop: int | None) -> Iterator[_Decoded]:
        """Decodes from the first frame on, and compares what comes with the index, or adds it."""
        container, stream = self._open()
        try:
            count, rate = 0, frame_rate(stream)
            watch = DamageWatch(container.format.name, rate)

            def broken(since: int | None) -> None:
                watch.broken(since)
                if self._broken is None:
                    self._broken = max(count - 1, 0)

            clock = Clock(rate, stream.time_base or 1 / rate)
            for frame in decode(container, stream, broken):
                time = clock.time(frame)
                self._confirm(count, frame.pts, time, frame.key_frame)
                self._damaged.update(watch.damaged(count, frame, time))
                self._missing = max(self._missing, watch.missing)
                yield _Decoded(count, time, frame)
                count += 1
                if count == stop:
                    return
            self._confirm_end(count)
            self._check_length()
        finally:
            self._shut(container)

    def _confirm(self, number: int, pts: int | None, time: Fraction, key: bool) -> None:
        """Takes note of what decoding from the start gave as frame `number`."""
        with self._lock:
            if number < self._confirmed:
                return
            if number < len(self._index) and (pts, time) != (self._index.pts[number], self._index.times[number]):
                self._drop(number)
            if number == len(self._index):
                self._index.append(pts, time, key, pts)
            self._confirmed = number + 1

    def _confirm_end(self, count: int) -> None:
        """Takes note of how many frames decoding from the start gave."""
        with self._lock:
            if count < len(self._index):
                self._drop(count)
            self._index.whole = True

    def _drop(self, number: int) -> None:
        """Goes by decoding alone from now on, since packets and frames differ from frame `number` on."""
        self._index = self._index.first(number)
        relied, self._relied = self._relied, -1
        log.info("%s: its packets do not tell its frames from %d on: seeking goes without them", self.path.name, number)
        if relied >= number:
            raise IndexDropped(
                f"{self.path} is damaged at frame {number}: later frames were counted wrongly, start over"
            )

    def _demux(self) -> None:
        """Makes the index of all frames, once, and keeps it where it agrees with what has been decoded."""
        with self._demuxing:
            if self._demuxed:
                return
            self._demuxed = True
            found = demux(self.source)
            with self._lock:
                known = self._index
                count = None if known.whole else len(known)
                if found is None or found.pts[:count] != known.pts or found.times[:count] != known.times:
                    return
                self._index = found
            if self._confirmed < CHECKED_FRAMES:
                for _ in self._decode(CHECKED_FRAMES):
                    pass

    def _check_length(self) -> None:
        """Many demuxers end a file that breaks off without a word: compare with the length the header promises."""
        times = self._index.times
        if self._promised is None or not times:
            return
        step = 1 / self.info.rate
        found = times[-1] - times[0] + step
        if found < self._promised - max(10 * step, Fraction(1)):
            self._warn(
                f"{self.path.name} breaks off after frame {len(times) - 1} "
                f"({float(found):.2f} of {float(self._promised):.2f} s): "
                "what was decoded up to there is used"
            )

    def _whole_frames(self, start: int, stop: int | None) -> Iterator[_Decoded]:
        """Frames start to stop - 1, deinterlaced where they are interlaced, by the frames around them."""
        if not self._is_interlaced:
            yield from self._decode_range(start, stop)
            return
        taken: deque[_Decoded] = deque()

        def take() -> Iterator[av.VideoFrame]:
            for decoded in self._decode_range(max(start - 1, 0), None if stop is None else stop + 1):
                if decoded.frame.interlaced_frame:
                    self._warn(f"{self.path.name} is interlaced: it is deinterlaced (bwdif), a frame from each frame")
                taken.append(decoded)
                yield decoded.frame

        for frame in deinterlaced(take()):
            decoded = taken.popleft()
            if start <= decoded.index and (stop is None or decoded.index < stop):
                yield changed(decoded, frame=frame)

    def _decode_range(self, start: int, stop: int | None) -> Iterator[_Decoded]:
        """Frames start to stop - 1, by seeking to the key frame before them where that proves exact."""
        if start > CHECKED_FRAMES:
            self._demux()
        if self._index.whole and start >= len(self._index):
            return
        key, target = self._index.key_before(start) if self._index.covers(stop) else (0, None)
        if key > 0 and target is not None:
            for decoded in self._seek_and_decode(key, target, start, stop):
                yield decoded
                start = decoded.index + 1
            if start == stop:
                return
            if self._index.whole and start == len(self._index):
                self._check_length()
                return
            log.info("%s: seeking is inexact, decoding from the start instead", self.path.name)
        for decoded in self._decode(stop):
            if decoded.index >= start:
                yield decoded

    def _seek_and_decode(self, key: int, target: int, start: int, stop: int | None) -> Iterator[_Decoded]:
        """As _decode_range, from key frame `key` at timestamp `target`; ends where others come than the index has."""
        container, stream = self._open()
        index, number = self._index, key
        try:
            container.seek(target, stream=stream)
            watch = DamageWatch(container.format.name, self.info.rate)
            for frame in decode(container, stream, watch.broken):
                pts = None if number == len(index) else index.pts[number]
                if frame.pts is None or pts is None:
                    return
                if number == key and frame.pts < pts:
                    continue  # from before the key frame: the seek landed earlier, or an open group's leading frames
                if frame.pts != pts:
                    return
                self._damaged.update(watch.damaged(number, frame, index.times[number]))
                if number >= start:
                    with self._lock:
                        if number >= self._confirmed:
                            self._relied = max(self._relied, number)
                    yield _Decoded(number, index.times[number], frame)
                number += 1
                if number == stop:
                    return
        except av.FFmpegError as error:
            log.info("%s: seeking failed (%s)", self.path.name, error)
        finally:
            self._shut(container)
