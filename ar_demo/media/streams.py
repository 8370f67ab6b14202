"""What the output has beside the picture: sound, subtitles, other streams, chapters, titles. Nothing is held whole."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
from av.audio.stream import AudioStream
from av.container import InputContainer, OutputContainer
from av.packet import Packet
from av.stream import AttachmentStream, Disposition, Stream
from av.video.stream import VideoStream

from ..choices import AudioMode, KeptStreams, Playback
from .audio import Encode, Form, Samples, ad_samples, first_heard, first_samples, form_for, samples, silence
from .carried import COPIED_SOUND, COPIED_SUBTITLES, ENCODED_SUBTITLES, TEXT_SUBTITLES, codec_name, takes
from .copying import Copy, Feed, Still, Subtitles, first_packet
from .decode import stream_duration
from .metadata import carry_chapters, carry_stream_tags, carry_tags, tells_place

log = logging.getLogger(__name__)

_PREROLL_SECONDS = Fraction(1, 10)  # copied sound may begin so much before the picture: it primes the sound decoder
# Sound that begins so much before the picture is heard before it; less is taken for what primes a decoder, which is up
# to 48 ms of AAC, and of which not all files tell.
_LEAD_SECONDS = Fraction(1, 20)
_PICTURES = {"mjpeg": "image/jpeg", "png": "image/png"}  # codecs of covers
_GOPRO = "GoPro MET"  # the only data stream without a codec of its own that MP4 and MOV take


class Streams:
    """All that is beside the picture. `attach` it to an output, then take `packets` as the picture goes on.

    Attributes:
        warnings: what went differently from what was asked.
    """

    def __init__(
        self,
        audio: AudioMode,
        source: Path,
        ad: Path | None = None,
        playback: Playback = "loop",
        keep: KeptStreams = "all",
        location: bool = True,
        end: Fraction | None = None,
        ad_time: tuple[Fraction, Fraction | None] = (Fraction(0), None),
    ) -> None:
        """Looks which of the files have sound; one that is asked for but has none is gone on without, with a warning.

        A silent video that keeps its sound is as it was, and no reason to warn.

        Args:
            audio: whose sound it is. A mix is of the source's first track, its others are kept as they are.
            source, ad: the files; ad is None where there is none.
            playback: of the ad: a looped one's sound is looped with its picture, else it plays once.
            keep: whether all streams of the source go along, or its first sound alone; titles and chapters always do.
            location: whether the place where the source was taken goes along.
            end: seconds on the source's clock where the output ends, None for its end.
            ad_time: seconds from the first picture where the ad begins and ends; None for the output's end.
        """
        self.warnings: list[str] = []
        self._source, self._keep, self._location, self._end = source, keep, location, end
        self._mode, self._ad_time = audio, ad_time
        self._heard = _sound(source) if audio in ("source", "mix") else None
        self._ad = ad if audio in ("ad", "mix") and ad and _sound(ad) is not None else None
        if audio == "mix" and self._heard is None:
            self._warn(f"the video {source.name} has no sound: going on without it")
        if audio in ("ad", "mix") and ad and self._ad is None:
            self._warn(f"the ad {ad.name} has no sound: going on without it")
        self._loop = playback == "loop"
        self._feeds: list[Feed] = []
        self._begins: list[Fraction] = []  # of the source's tracks that are heard, seconds on its clock
        self._picture = self._start = Fraction(0)  # the first picture, and the output's zero, seconds on its clock

    def attach(self, output: OutputContainer, picture: VideoStream) -> None:
        """Adds streams and tags to a container that nothing has been written to yet, and tags to its picture."""
        if output.format.name not in COPIED_SOUND:  # which holds pictures alone
            return
        try:
            container = av.open(str(self._source))
        except (av.FFmpegError, OSError, ValueError):  # pictures, say
            self._attach_ad(output)
            return
        with container:
            main = next((s for s in container.streams.video if not s.disposition & Disposition.attached_pic), None)
            if self._heard is None:
                self._attach_ad(output)
            left = [each for stream in container.streams if (each := self._attach(output, container, stream, main))]
            if left:
                self._warn(
                    f"{output.format.name} cannot hold these streams of {self._source.name}, which are left out: "
                    f"{', '.join(left)}; --streams first keeps none but the picture and the first sound"
                )
            carry_tags(container, output, self._location)
            if main is not None:
                carry_stream_tags(main, picture, self._location)
                picture.disposition = main.disposition
                first = (main.start_time or 0) * (main.time_base or Fraction(0))
                length = stream_duration(container, main, first)
                end = first + length if self._end is None and length else self._end
                carry_chapters(container, output, self._zero(first), end)

    def begin(self, picture: Fraction) -> Fraction:
        """Takes note of when the first picture is shown; the output's zero, before it where sound is heard before it.

        Both are in seconds on the source's clock.
        """
        self._picture, self._start = picture, self._zero(picture)
        if self._start < picture:
            log.info("the sound begins %.2f s before the picture, in the output as well", float(picture - self._start))
        return self._start

    def packets(self, until: Fraction) -> Iterator[Packet[Any]]:
        """Packets not yet given out that begin before a time in seconds on the source's clock."""
        for feed in self._feeds:
            yield from feed.packets(self._start, until)

    def finish(self, end: Fraction) -> Iterator[Packet[Any]]:
        """The last packets, up to the picture's end in seconds on the source's clock."""
        for feed in self._feeds:
            yield from feed.packets(self._start, end)
            yield from feed.flush()

    def close(self) -> None:
        """Closes the files it reads."""
        for feed in self._feeds:
            feed.close()

    # ---- inside ----

    def _zero(self, picture: Fraction) -> Fraction:
        first = min(self._begins, default=picture)
        return first if picture - first > _LEAD_SECONDS else picture

    def _attach(
        self, output: OutputContainer, container: InputContainer, stream: Stream, main: VideoStream | None
    ) -> str | None:
        """Adds what goes along of one stream; what it is called, where it should and cannot."""
        if stream.type == "audio":
            return self._attach_sound(output, cast(AudioStream, stream))
        if self._keep != "all" or stream is main or (not self._location and self._tells_place(stream)):
            return None
        if stream.type == "subtitle" and stream.codec_context is not None:
            return self._attach_subtitles(output, stream)
        if stream.type == "attachment" and output.format.name == "matroska":
            held = cast(AttachmentStream, stream)
            output.add_attachment(held.name or "attachment", held.mimetype or "application/octet-stream", held.data)
            return None
        if stream.type == "data" and output.format.name in ("mp4", "mov") and _GOPRO in _handler(stream):
            self._copy(output, stream)
            return None
        if stream.type == "data" and (_is_chapters(container, stream) or "timecode" in stream.metadata):
            return None  # written anew from chapters and tags
        if stream.type == "video" and stream.disposition & Disposition.attached_pic:
            return self._attach_picture(output, stream)
        if stream.type == "video" and stream.codec_context is not None and takes(output.format.name, stream):
            self._copy(output, stream)
            return None
        return _called(stream)

    def _tells_place(self, stream: Stream) -> bool:
        """Whether a stream says where the source was taken, as cameras' telemetry and drones' subtitles do."""
        if stream.type == "data":
            return _GOPRO in _handler(stream)
        packet = first_packet(self._source, stream.index) if stream.type == "subtitle" else None
        return packet is not None and tells_place(bytes(packet))

    def _attach_sound(self, output: OutputContainer, stream: AudioStream) -> str | None:
        if self._heard is None or (self._keep == "first" and stream.index != self._heard):
            return None
        if stream.codec_context is None:
            return _called(stream)
        muxer, name, index = output.format.name, codec_name(stream), stream.index
        mixed = index == self._heard and self._ad is not None
        if mixed:
            self._feeds.append(self._mixed(output))
            carry_stream_tags(stream, cast(Encode, self._feeds[-1]).target, self._location)
        elif name in COPIED_SOUND[muxer] and takes(muxer, stream):
            # Matroska would shift everything, the picture too, so that nothing lies before zero; MP4 hides what does.
            shifts = muxer in ("matroska", "webm") and name != "opus"
            preroll = Fraction(0) if shifts else _PREROLL_SECONDS
            self._copy(output, stream, preroll)
        else:
            form = form_for(muxer, stream)
            encode = Encode(output, form, [lambda start: samples(self._source, index, form, start, self._warn)])
            carry_stream_tags(stream, encode.target, self._location)
            encode.target.disposition = stream.disposition
            self._feeds.append(encode)
            other = "" if form.channels == stream.layout.nb_channels else f" with {form.layout} channels"
            self._warn(
                f"{name} sound is not for {muxer} and its players: the source's sound is encoded anew, as "
                f"{codec_name(encode.target)}{other}"
            )
        begin = first_heard(self._source, index)
        if begin is not None:
            self._begins.append(begin)
        return None

    def _attach_ad(self, output: OutputContainer) -> None:
        """The ad's sound alone."""
        if self._ad is not None:
            self._feeds.append(Encode(output, Form(), [self._ad_sound]))

    def _mixed(self, output: OutputContainer) -> Encode:
        index = cast(int, self._heard)
        return Encode(
            output, Form(), [lambda start: samples(self._source, index, Form(), start, self._warn), self._ad_sound]
        )

    def _ad_sound(self, start: Fraction) -> Iterator[Samples]:
        """The ad's sound, which begins with the ad."""
        ad, (begin, end) = cast(Path, self._ad), self._ad_time
        sound = ad_samples(ad, cast(int, _sound(ad)), Form(), self._loop, self._warn)
        if end is not None:
            sound = first_samples(sound, round((end - begin) * Form().rate))
        return itertools.chain([silence(self._picture + begin - start, Form())], sound)

    def _attach_subtitles(self, output: OutputContainer, stream: Stream) -> str | None:
        muxer, name = output.format.name, codec_name(stream)
        if name in COPIED_SUBTITLES[muxer] and takes(muxer, stream):
            self._copy(output, stream)
            return None
        if name not in TEXT_SUBTITLES:
            return _called(stream)
        codec: Any = ENCODED_SUBTITLES[muxer]
        made = output.add_stream(codec)
        made.time_base = Fraction(1, 1000)
        carry_stream_tags(stream, made, self._location)
        made.disposition = stream.disposition
        self._feeds.append(Subtitles(self._source, stream.index, made, self._warn))
        return None

    def _attach_picture(self, output: OutputContainer, stream: Stream) -> str | None:
        """A cover: MP4 has it as a stream, Matroska as a file."""
        muxer, kind = output.format.name, _PICTURES.get(codec_name(stream))
        picture = first_packet(self._source, stream.index)
        if picture is None or kind is None or muxer not in ("mp4", "matroska"):
            return _called(stream)
        if muxer == "mp4":
            self._feeds.append(Still(picture, self._copied(output, stream)))
        else:
            name = stream.metadata.get("filename", f"cover.{kind.rpartition('/')[2]}")
            output.add_attachment(name, kind, bytes(picture))
        return None

    def _copy(self, output: OutputContainer, stream: Stream, preroll: Fraction = Fraction(0)) -> None:
        self._feeds.append(Copy(self._source, stream.index, self._copied(output, stream), preroll, self._warn))

    def _copied(self, output: OutputContainer, stream: Stream) -> Stream:
        """A stream of the output like one of the source."""
        target = output.add_stream_from_template(stream, opaque=True)
        if codec_name(stream) == "hevc" and output.format.name in ("mp4", "mov"):
            cast(Any, target).codec_tag = "hvc1"  # Apple's players open no other
        target.metadata.clear()
        carry_stream_tags(stream, target, self._location)
        target.disposition = stream.disposition
        return target

    def _warn(self, message: str) -> None:
        if message not in self.warnings:
            self.warnings.append(message)
            log.warning(message)


def _sound(path: Path) -> int | None:
    """Index of a file's first sound track that can be decoded; None where it has none, as an image."""
    try:
        with av.open(str(path)) as container:
            return next((s.index for s in container.streams.audio if s.codec_context is not None), None)
    except (av.FFmpegError, OSError, ValueError):
        return None


def _is_chapters(container: InputContainer, stream: Stream) -> bool:
    """Whether a stream is the track of text that MP4 and MOV keep chapters in."""
    is_text = codec_name(stream) == "bin_data" and _GOPRO not in _handler(stream)
    return "mov" in container.format.name and is_text and bool(container.chapters())


def _handler(stream: Stream) -> str:
    return stream.metadata.get("handler_name", "")


def _called(stream: Stream) -> str:
    """As in '4 (data bin_data, GoPro MET)'."""
    handler = _handler(stream).strip()
    return f"{stream.index} ({stream.type} {codec_name(stream)}{', ' if handler else ''}{handler})"
