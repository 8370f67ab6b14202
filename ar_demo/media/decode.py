"""Opening a video file and decoding its picture stream, whatever state the file is in."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator
from contextlib import suppress
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import cast

import av
from av.container import InputContainer
from av.video.stream import VideoStream

from ..errors import InputError
from .limits import check_count, check_size, for_decoding, for_probing
from .sequences import ImageSequence

# FFmpeg opens pictures and even plain text as "video"; none of these is a clip.
_NOT_CLIP_FORMATS = {"tty", "image2", "lrc", "srt", "ass", "webvtt"}
# These name other files, or addresses: a video that comes from somebody else shall not choose what is read.
_PLAYLISTS = {"concat", "dash", "hls", "imf", "lavfi", "rtp", "rtsp", "sap", "sdp", "webm_dash_manifest"}
# FFmpeg's own VP8/VP9 decoders drop the alpha plane; libvpx keeps it.
_ALPHA_DECODERS = {"vp8": "libvpx", "vp9": "libvpx-vp9"}


def open_video(source: Path | ImageSequence) -> tuple[InputContainer, VideoStream]:
    """Opens a clip, or pictures, and picks its first picture stream. The caller closes the container.

    Raises:
        InputError: the file is missing, cannot be read, is no video, or has no picture stream.
    """
    container = _open_pictures(source) if isinstance(source, ImageSequence) else _open_clip(source)
    try:
        streams = [s for s in container.streams.video if not s.disposition & av.stream.Disposition.attached_pic]
        if not streams:
            raise InputError(f"{source} has no video stream: give a file with pictures in it")
        stream = streams[0]
        if stream.codec_context is None:
            raise InputError(f"{source} uses a video codec that this FFmpeg cannot decode: convert it to H.264 first")
        check_size(source, stream.codec_context.width, stream.codec_context.height)
        stream.codec_context.options = for_decoding()
    except BaseException:
        container.close()
        raise
    stream.codec_context.thread_type = "AUTO"
    return container, stream


def _open_pictures(pictures: ImageSequence) -> InputContainer:
    try:
        return pictures.open()
    except (av.FFmpegError, OSError, ValueError) as error:
        raise InputError(f"{pictures.files[0]} is not a picture that FFmpeg can read, or is damaged") from error


def _open_clip(path: Path) -> InputContainer:
    if not path.exists():
        raise InputError(f"{path} does not exist: check the file name")
    if not path.is_file():
        raise InputError(f"{path} is not a file: give a video file")
    if path.stat().st_size == 0:
        raise InputError(f"{path} is empty: give a video file")
    try:
        container = av.open(str(path), options={"format_whitelist": _clip_formats()}, **for_probing())
    except PermissionError as error:
        raise InputError(f"{path} cannot be read: check its permissions") from error
    except (av.FFmpegError, OSError, ValueError) as error:
        if _begins_as_playlist(path):
            raise InputError(f"{path} is a playlist, which names other files: give the video itself") from error
        raise InputError(f"{path} is not a video that FFmpeg can read, or is damaged at its start") from error
    if container.format.name in _NOT_CLIP_FORMATS or container.format.name.endswith("_pipe"):
        container.close()
        raise InputError(f"{path} is not a video: give an MP4, MOV, MKV, WebM, AVI or another video file")
    return container


@cache
def _clip_formats() -> str:
    """Names of FFmpeg's demuxers that read what they are given, and nothing else."""
    return ",".join(sorted(av.formats_available - _PLAYLISTS))


def _begins_as_playlist(path: Path) -> bool:
    with suppress(OSError), path.open("rb") as file:
        return file.read(20).startswith((b"#EXTM3U", b"ffconcat version"))
    return False


def has_alpha(stream: VideoStream) -> bool:
    """Whether the stream carries transparency (an alpha plane, or VP8/VP9's alpha side stream)."""
    tags = {key.lower(): value for key, value in stream.metadata.items()}
    if stream.codec_context.codec.name in _ALPHA_DECODERS and tags.get("alpha_mode") == "1":
        return True
    return stream.format is not None and any(component.is_alpha for component in stream.format.components)


def decode(
    container: InputContainer, stream: VideoStream, on_damage: Callable[[int | None], None], *, alpha: bool = False
) -> Generator[av.VideoFrame, None, None]:
    """Decoded frames in display order from where the container stands.

    Packets that do not decode are skipped, and a file that breaks off ends the iteration.

    Args:
        container, stream: as `open_video` gives them.
        on_damage: is called for each packet that does not decode or is marked as damaged, and where the file breaks
            off, with a timestamp from which on it may be, for decoders tell some packets later; None: not known.
        alpha: whether to keep the alpha plane of VP8 and VP9.
    """
    context: av.VideoCodecContext = stream.codec_context
    if alpha and context.codec.name in _ALPHA_DECODERS:
        context = cast(av.VideoCodecContext, av.CodecContext.create(_ALPHA_DECODERS[context.codec.name], "r"))
    packets = container.demux(stream)
    recent: deque[int] = deque(maxlen=(context.thread_count or os.cpu_count() or 1) + 2)  # timestamps
    count = 0
    while True:
        try:
            packet = next(packets, None)
        except (av.FFmpegError, OSError):
            on_damage(recent[-1] if recent else None)
            packet = None
        if packet is not None and packet.pts is not None:
            recent.append(packet.pts)
        if packet is not None and packet.is_corrupt:
            on_damage(packet.pts)
        try:
            # An empty packet (and None) drains the decoder.
            frames = context.decode(packet if packet is not None and packet.size else None)
        except av.error.EOFError:
            return  # drained already
        except (av.FFmpegError, OSError):
            on_damage(min(recent, default=None))
            frames = []
        for frame in frames:
            count += 1
            check_count(container.name, count)
            check_size(container.name, frame.width, frame.height)
            if frame.time_base is None:
                frame.time_base = stream.time_base
            yield frame
        if packet is None or not packet.size:
            return


def frame_rate(stream: VideoStream) -> Fraction:
    """Average frames per second; 25 where the container does not say."""
    return Fraction(stream.average_rate or stream.guessed_rate or 25)


def stream_duration(container: InputContainer, stream: VideoStream, start: Fraction | None) -> Fraction | None:
    """Seconds that the picture lasts as the file's header has it, None where it does not say.

    Args:
        container, stream: as `open_video` gives them.
        start: time of the first frame in seconds, None where it is not known.
    """
    if "matroska" not in container.format.name:
        return stream.duration * stream.time_base if stream.duration and stream.time_base else None
    # Matroska and WebM only give the length of everything together, and a tag with the time the stream ends.
    if start is None:
        return None
    tags = {key.upper(): value for key, value in stream.metadata.items()}
    try:
        hours, minutes, seconds = (Fraction(part) for part in tags.get("DURATION", "").split(":"))
        end = hours * 3600 + minutes * 60 + seconds
    except ValueError:
        # The tag comes at the file's end. Where it is cut off, a lone stream is as long as everything together.
        if len(container.streams) > 1 or not container.duration:
            return None
        end = Fraction(container.duration, 1_000_000)
    return end - start if end > start else None


def picture_duration(path: Path) -> Fraction:
    """Seconds that the picture lasts, by its packets where the header does not say; meant for short files.

    Raises:
        InputError: as `open_video`.
    """
    container, stream = open_video(path)
    with container:
        duration = stream_duration(container, stream, start=None)
        if duration is not None:
            return duration
        step = 1 / frame_rate(stream)
        base = stream.time_base or step
        begin: Fraction | None = None
        end = Fraction(0)
        for count, packet in enumerate(container.demux(stream)):
            check_count(path, count + bool(packet.size))
            if packet.pts is not None:
                time = packet.pts * base
                begin = time if begin is None else min(begin, time)
                end = max(end, time + (packet.duration * base if packet.duration else step))
        return step if begin is None else end - begin


class Clock:
    """Turns decoded frames' timestamps into exact, strictly increasing times in seconds."""

    def __init__(self, rate: Fraction, time_base: Fraction) -> None:
        self._step = 1 / rate
        self._tick = time_base
        self._last: Fraction | None = None

    def time(self, frame: av.VideoFrame) -> Fraction:
        """Time of the next frame: without a timestamp one frame after the last, with a stale one a tick after it."""
        last = self._last
        if frame.pts is None or frame.time_base is None:
            time = Fraction(0) if last is None else last + self._step
        else:
            time = frame.pts * frame.time_base
            if last is not None and time <= last:
                time = last + self._tick
        self._last = time
        return time
