"""Streams of a file that go along with the picture as they are, packet by packet."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol, cast

import av
from av.container import InputContainer
from av.packet import Packet
from av.stream import Discard, Stream

Warn = Callable[[str], None]


class Feed(Protocol):
    """A stream of the output, fed as the picture goes on."""

    def packets(self, start: Fraction, until: Fraction) -> Iterator[Packet[Any]]:
        """Packets not yet given out that begin before a time.

        Args:
            start: the output's zero in seconds on the source's clock, always the same.
            until: seconds on the source's clock.
        """

    def flush(self) -> Iterator[Packet[Any]]:
        """What is left after the last call of `packets`."""

    def close(self) -> None:
        """Closes what it reads."""


def open_alone(path: Path, index: int) -> tuple[InputContainer, Stream]:
    """Opens a file to read one of its streams; the others are passed over. The caller closes the container."""
    container = av.open(str(path))
    for stream in container.streams:
        if stream.index != index:
            stream.discard = Discard.all
    return container, container.streams[index]


class Copy:
    """Copies the packets of one stream, without touching what is in them; sound is decoded to see that it can be."""

    def __init__(self, path: Path, index: int, target: Stream, preroll: Fraction, warn: Warn) -> None:
        """Args:
        path, index: the file, and which of its streams.
        target: the output's stream, made from that one.
        preroll: seconds before the output's zero from which packets are kept: they prime a sound decoder.
        warn: is told of damage.
        """
        self._container, stream = open_alone(path, index)
        self._warn, self._preroll, self._target = warn, preroll, target
        self._name, self._kind = path.name, stream.type
        self._base = stream.time_base or Fraction(1, 1000)
        self._checked = cast(Any, stream.codec_context) if stream.type == "audio" else None
        self._packets = self._container.demux(cast(Any, stream))
        self._next = self._read()

    def packets(self, start: Fraction, until: Fraction) -> Iterator[Packet[Any]]:
        shift = round(start / self._base)
        while (packet := self._next) is not None and cast(int, packet.pts) * self._base < until:
            self._next = self._read()
            if not self._begins(packet, start):
                continue
            packet.pts = cast(int, packet.pts) - shift
            if packet.dts is not None:
                packet.dts -= shift
            yield from self._ready(packet)

    def flush(self) -> Iterator[Packet[Any]]:
        return iter(())

    def close(self) -> None:
        self._container.close()

    def _ready(self, packet: Packet[Any]) -> Iterator[Packet[Any]]:
        """A packet, its times being the output's, as it goes to the output."""
        if self._checked is not None:
            try:
                self._checked.decode(packet)
            except (av.FFmpegError, OSError):
                self._warn(f"the sound of {self._name} is damaged: it is copied as it is")
        packet.stream = self._target
        yield packet

    def _begins(self, packet: Packet[Any], start: Fraction) -> bool:
        """Whether a packet is of the output's time; of a subtitle that is shown already the rest is kept."""
        assert packet.pts is not None
        begin = packet.pts * self._base
        if begin >= start - self._preroll:
            return True
        end = begin + (packet.duration or 0) * self._base
        if self._kind != "subtitle" or end <= start:
            return False
        packet.duration = round((end - start) / self._base)
        packet.pts = packet.dts = round(start / self._base)
        return True

    def _read(self) -> Packet[Any] | None:
        try:
            return next((packet for packet in self._packets if packet.pts is not None and packet.size), None)
        except (av.FFmpegError, OSError):
            what = "the sound" if self._kind == "audio" else f"the {self._kind} stream"
            self._warn(f"{what} of {self._name} is damaged: it ends early")
            return None


class Subtitles(Copy):
    """Copies subtitles as text of another codec."""

    def __init__(self, path: Path, index: int, target: Stream, warn: Warn) -> None:
        super().__init__(path, index, target, Fraction(0), warn)
        self._decoder = cast(Any, self._container.streams[index].codec_context)
        self._encoder = cast(Any, target.codec_context)
        self._encoder.subtitle_header = self._decoder.subtitle_header or _PLAIN_STYLE

    def _ready(self, packet: Packet[Any]) -> Iterator[Packet[Any]]:
        try:
            text = self._decoder.decode2(packet)
            if text is None or not any(rect.dialogue for rect in text):
                return  # a gap, which some codecs write out
            made = self._encoder.encode_subtitle(text)
        except (av.FFmpegError, OSError):
            self._warn(f"the subtitles of {self._name} are damaged: what can be decoded is used")
            return
        made.stream, made.time_base = self._target, self._base
        made.pts = made.dts = packet.pts
        made.duration = packet.duration
        yield made


class Still:
    """A picture that is attached to a file, as a record's cover is: one packet."""

    def __init__(self, picture: Packet[Any], target: Stream) -> None:
        self._packet: Packet[Any] | None = picture
        self._target = target

    def packets(self, start: Fraction, until: Fraction) -> Iterator[Packet[Any]]:
        packet, self._packet = self._packet, None
        if packet is not None:
            packet.stream = self._target
            packet.pts = packet.dts = 0
            yield packet

    def flush(self) -> Iterator[Packet[Any]]:
        return iter(())

    def close(self) -> None:
        pass


def first_packet(path: Path, index: int) -> Packet[Any] | None:
    """The first packet of a stream, as of a picture that is attached; None where it has none."""
    container, stream = open_alone(path, index)
    with container:
        return next((packet for packet in container.demux(cast(Any, stream)) if packet.size), None)


_PLAIN_STYLE = b"""[Script Info]
ScriptType: v4.00+

[V4+ Styles]
Format: Name, Fontname, Fontsize, PrimaryColour, SecondaryColour, OutlineColour, BackColour, Bold, Italic, Underline, \
StrikeOut, ScaleX, ScaleY, Spacing, Angle, BorderStyle, Outline, Shadow, Alignment, MarginL, MarginR, MarginV, Encoding
Style: Default,Arial,16,&Hffffff,&Hffffff,&H0,&H0,0,0,0,0,100,100,0,0,1,1,0,2,10,10,10,1

[Events]
Format: Layer, Start, End, Style, Name, MarginL, MarginR, MarginV, Effect, Text
"""
