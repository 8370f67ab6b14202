"""Joining parts of a video that were encoded alike: their packets go on as they are, with times of the whole."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
from av.packet import Packet
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream

from ..errors import InputError, RunError
from . import codecs
from .claims import Claim, reason_of
from .planes import plain
from .priority import priority_kept
from .reader import VideoInfo
from .siting import chroma_siting, turned
from .streams import Streams

# Whose frames are of their own or of a group that is: a GIF's are drawn over those before them.
SUFFIXES = (".mp4", ".m4v", ".mov", ".mkv", ".webm")


def is_joinable(path: Path) -> bool:
    """Whether parts make a video of this name."""
    return path.suffix.lower() in SUFFIXES


@dataclass(frozen=True)
class Part:
    """What a part has in it, by its packets.

    Attributes:
        order: of each packet, in the order of the file, the place of its frame among those of the part as shown.
        form: what has to be alike in all parts: codec, size, pixels, and what the decoder is told before the first.
    """

    path: Path
    order: tuple[int, ...]
    form: tuple[Any, ...]

    @staticmethod
    def of(path: Path) -> Part:
        """Looks through a file.

        Raises:
            InputError: it is no video.
        """
        try:
            with av.open(str(path)) as container:
                stream = container.streams.video[0]
                context = stream.codec_context
                form = context.name, context.width, context.height, context.pix_fmt, context.extradata
                shown = [packet.pts or 0 for packet in container.demux(stream) if packet.size]
        except (av.FFmpegError, OSError, IndexError) as error:
            raise InputError(f"{path} is no part of a video: {reason_of(error)}") from error
        place = {pts: index for index, pts in enumerate(sorted(shown))}
        if not shown or len(place) < len(shown):
            raise InputError(f"{path} has no frames, or two at the same time: render it again")
        return Part(path, tuple(place[pts] for pts in shown), form)

    @property
    def delay(self) -> int:
        """Frames by which a decoder falls behind, since they are not stored as they are shown."""
        return max(index - place for index, place in enumerate(self.order))


def join(
    parts: Sequence[Path],
    output: Claim,
    times: Sequence[Fraction],
    end: Fraction,
    streams: Streams,
    source: VideoInfo | None = None,
) -> None:
    """Makes one video of parts; it appears only when it is complete.

    Args:
        parts: in their order, each encoded by itself in the same way, in files of the output's kind.
        times: of all their frames, seconds on the source's clock; end: of the last one.
        streams: what goes along with the picture.
        source: the video that the parts are of, for what they do not tell themselves; None for another's.

    Raises:
        InputError: parts that are not alike, of another kind of file, or with more or fewer frames.
        RunError: the output cannot be written.
    """
    found = _checked([Part.of(path) for path in parts], output.path, len(times))
    container: Any = None
    try:
        kind = codecs.CONTAINERS[output.path.suffix.lower()]
        container = av.open(str(output.part), "w", format=kind.muxer, container_options=dict(kind.options))
        stream = _like(parts[0], container, kind.muxer, source)
        streams.attach(container, stream)
        container.start_encoding()
        zero = streams.begin(times[0])
        _Packets(found, times, end, zero).mux(container, stream, streams)
        for packet in streams.finish(end):
            container.mux(packet)
        container.close()
    except (av.FFmpegError, OSError) as error:
        _discard(container, output, streams)
        raise RunError(f"cannot write {output.path}: {reason_of(error)}") from error
    except BaseException:
        _discard(container, output, streams)
        raise
    streams.close()
    output.finish()


def _checked(parts: list[Part], output: Path, frames: int) -> list[Part]:
    if not is_joinable(output):
        raise InputError(f"a {output.suffix} cannot be joined from parts: choose {', '.join(SUFFIXES)}")
    for part in parts:
        if part.path.suffix.lower() != output.suffix.lower():
            raise InputError(f"{part.path} is no {output.suffix} as the output is: give them the same ending")
        if part.form != parts[0].form:
            raise InputError(f"{part.path} is encoded otherwise than {parts[0].path}: render all with the same options")
    count = sum(len(part.order) for part in parts)
    if count != frames:
        raise InputError(f"the parts have {count} frames, and the video has {frames}: give all of them, each once")
    return parts


def _like(part: Path, container: Any, muxer: str, of: VideoInfo | None) -> VideoStream:
    """Adds a stream to a container that is not begun yet, like that of a part."""
    with av.open(str(part)) as source:
        theirs = source.streams.video[0]
        context = theirs.codec_context
        stream: Any
        if muxer in ("mp4", "mov"):
            stream = container.add_stream_from_template(theirs, opaque=True)
            stream.codec_tag = context.codec_tag  # by which players tell one ProRes from another
        else:  # Matroska says the frame rate, which a template does not have: so an encoder is opened, and not used
            encoder, pixels = _encoder(context)
            options = encoder.options_for(pixels)
            if of is not None and not of.is_pictures and pixels == plain(of.pixel_format):
                siting = turned(chroma_siting(of.path), of.rotation) if pixels.startswith("yuv420") else None
                options |= {} if siting is None else {"chroma_sample_location": siting}
            stream = container.add_stream(encoder.encoder, rate=theirs.average_rate, options=options)
            own = stream.codec_context
            own.pix_fmt = pixels
            for name in ("width", "height", "color_range", "colorspace", "color_primaries", "color_trc"):
                setattr(own, name, getattr(context, name))
            own.sample_aspect_ratio = theirs.sample_aspect_ratio or Fraction(1)
            own.time_base = Fraction(1, 1000)
            with priority_kept():
                own.open()
            own.extradata = context.extradata
        stream.time_base = theirs.time_base
    return cast(VideoStream, stream)


def _encoder(context: VideoCodecContext) -> tuple[codecs.Codec, str]:
    """What encoded a stream, and of which pixel format; ProRes 4444 is decoded to more bits than it was made of."""
    pixels = context.pix_fmt or ""
    makers = [codec for codec in codecs.CODECS if av.Codec(codec.encoder, "w").id == context.codec.id]
    for codec in makers:
        if pixels in codec.formats:
            return codec, pixels
    codec = next((c for c in makers if c.formats[0][:6] == pixels[:6]), makers[0])
    return codec, codec.formats[0]


def _discard(container: Any, output: Claim, streams: Streams) -> None:
    streams.close()
    output.discard()
    if container is not None:
        with contextlib.suppress(av.FFmpegError, OSError, ValueError):
            container.close()
    output.discard()


class _Packets:
    """The packets of the parts, with the times that they have in the whole."""

    def __init__(self, parts: Sequence[Part], times: Sequence[Fraction], end: Fraction, zero: Fraction) -> None:
        self._parts, self._times, self._end, self._zero = parts, times, end, zero
        self._delay = max(part.delay for part in parts)

    def mux(self, container: Any, stream: VideoStream, streams: Streams) -> None:
        """Writes them, with all that goes along."""
        first_dts, last, begin = 0, None, 0
        for part in self._parts:
            with av.open(str(part.path)) as source:
                packets = [source.streams.video[0]]
                for number, packet in enumerate(p for p in source.demux(packets) if p.size):
                    self._place(cast("Packet[VideoStream]", packet), begin + number, begin + part.order[number], stream)
                    if last is None:
                        first_dts = packet.dts or 0
                    else:
                        container.mux(last)
                    for beside in streams.packets(self._times[begin + number]):
                        container.mux(beside)
                    last = packet
            begin += len(part.order)
        assert last is not None
        if container.format.name in ("mp4", "mov"):  # see `VideoWriter`: the muxer adds up the packets as they come
            last.duration = max(1, self._ticks(self._end, stream) - self._ticks(self._times[0], stream))
            last.duration = max(1, last.duration - ((last.dts or 0) - first_dts))
        container.mux(last)

    def _place(self, packet: Packet[VideoStream], stored: int, shown: int, stream: VideoStream) -> None:
        """Sets when the packet that is stored as number `stored` is decoded and shown, as number `shown`."""
        times, due = self._times, stored - self._delay
        step = times[1] - times[0] if len(times) > 1 else self._end - times[0]
        decoded = times[due] if due >= 0 else times[0] + due * step
        after = times[shown + 1] if shown + 1 < len(times) else self._end
        packet.stream = stream
        packet.time_base = cast(Fraction, stream.time_base)
        packet.pts = self._ticks(times[shown], stream)
        packet.dts = min(self._ticks(decoded, stream), packet.pts)
        packet.duration = self._ticks(after, stream) - packet.pts

    def _ticks(self, time: Fraction, stream: VideoStream) -> int:
        return round((time - self._zero) / cast(Fraction, stream.time_base))
