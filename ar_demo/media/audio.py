"""The output's sound: the source's, the ad's, both mixed, or none. Everything is streamed, nothing is held whole."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import numpy as np
from av.audio.resampler import AudioResampler
from av.audio.stream import AudioStream
from av.container import InputContainer, OutputContainer
from av.packet import Packet
from numpy.typing import NDArray

from ..choices import AudioMode, Playback
from .decode import picture_duration

log = logging.getLogger(__name__)

Warn = Callable[[str], None]
Samples = NDArray[np.float32]  # (2, n): stereo at SAMPLE_RATE, within -1 to 1

SAMPLE_RATE = 48000
MIX_GAIN = np.float32(0.7)  # each of two tracks, 3 dB down
_BLOCK_SAMPLES = SAMPLE_RATE  # samples produced at once, at most
_GAP_SAMPLES = SAMPLE_RATE // 50  # timestamps may be off by 20 ms before silence is put in or samples are dropped
_PREROLL_SECONDS = Fraction(1, 10)  # copied sound may begin so much before the picture: it primes the sound decoder
# Codecs that FFmpeg's muxers say they take, and then do not.
_REFUSED_CODECS = {"mov": {"opus", "flac", "truehd"}, "mp4": {"truehd"}}


class Audio:
    """What is to be heard. `attach` it to an output, then take `packets` as the picture goes on.

    Attributes:
        warnings: what went differently from what was asked.
    """

    def __init__(self, mode: AudioMode, source: Path, ad: Path | None = None, playback: Playback = "loop") -> None:
        """Looks which of the files have sound; one that is asked for but has none is gone on without, with a warning.

        A silent video that keeps its sound is as it was, and no reason to warn.

        Args:
            mode: whose sound it is.
            source, ad: the files; ad is None where there is none.
            playback: of the ad: a looped one's sound is looped with its picture, else it plays once.
        """
        self.warnings: list[str] = []
        self._source = source if mode in ("source", "mix") and _has_sound(source) else None
        self._ad = ad if mode in ("ad", "mix") and ad and _has_sound(ad) else None
        if mode == "mix" and self._source is None:
            self._warn(f"the video {source.name} has no sound: going on without it")
        if mode in ("ad", "mix") and ad and self._ad is None:
            self._warn(f"the ad {ad.name} has no sound: going on without it")
        self._loop = playback == "loop"
        self._feed: _Copy | _Encode | None = None

    def attach(self, output: OutputContainer) -> None:
        """Adds the sound's stream to a container that nothing has been written to yet."""
        if self._source is not None and self._ad is None:
            self._feed = _Copy.attach(output, self._source, self._warn)
        if self._feed is None and (self._source or self._ad):
            self._feed = _Encode(output, self._source, self._ad, self._loop, self._warn)

    def packets(self, start: Fraction, until: Fraction) -> Iterator[Packet[AudioStream]]:
        """Packets not yet given out whose sound begins before a time.

        Args:
            start: the output's zero in seconds on the source's clock, always the same.
            until: the time in seconds on the source's clock.
        """
        if self._feed is not None:
            yield from self._feed.packets(start, until)

    def finish(self, start: Fraction, end: Fraction) -> Iterator[Packet[AudioStream]]:
        """The last packets, up to the picture's end in seconds."""
        if self._feed is not None:
            yield from self._feed.packets(start, end)
            yield from self._feed.flush()

    def close(self) -> None:
        """Closes the files it reads."""
        if self._feed is not None:
            self._feed.close()

    def _warn(self, message: str) -> None:
        if message not in self.warnings:
            self.warnings.append(message)
            log.warning(message)


def _has_sound(path: Path) -> bool:
    try:
        with av.open(str(path)) as container:
            return any(stream.codec_context is not None for stream in container.streams.audio)
    except (av.FFmpegError, OSError, ValueError):
        return False  # an image, say


class _Copy:
    """Copies the packets of a file's first sound track, without touching what is in them."""

    def __init__(
        self, container: InputContainer, stream: AudioStream, target: AudioStream, preroll: Fraction, warn: Warn
    ) -> None:
        self._container = container
        self._warn = warn
        self._preroll = preroll
        self._target = target
        self._name = Path(container.name).name
        self._base = stream.time_base or Fraction(1, stream.rate)
        self._packets = container.demux(stream)
        self._next = self._read()

    @staticmethod
    def attach(output: OutputContainer, source: Path, warn: Warn) -> _Copy | None:
        """None, and a warning, where the output's container does not take the source's codec."""
        container = av.open(str(source))
        stream = container.streams.audio[0]
        name, muxer = stream.codec_context.name, output.format.name
        try:
            if name in _REFUSED_CODECS.get(muxer, ()):
                raise ValueError
            target = output.add_stream_from_template(stream)
        except ValueError:
            container.close()
            warn(f"{muxer} takes no {name} sound: the source's sound is encoded anew")
            return None
        # Matroska would shift everything, the picture too, so that nothing lies before zero; MP4 hides what does.
        shifts = muxer in ("matroska", "webm") and name != "opus"
        return _Copy(container, stream, target, Fraction(0) if shifts else _PREROLL_SECONDS, warn)

    def _read(self) -> Packet[AudioStream] | None:
        try:
            return next((packet for packet in self._packets if packet.pts is not None), None)
        except (av.FFmpegError, OSError):
            self._warn(f"the sound of {self._name} is damaged: it ends early")
            return None

    def packets(self, start: Fraction, until: Fraction) -> Iterator[Packet[AudioStream]]:
        shift = round(start / self._base)
        while (packet := self._next) is not None and cast(int, packet.pts) * self._base < until:
            self._next = self._read()
            assert packet.pts is not None
            if packet.pts * self._base < start - self._preroll:
                continue
            packet.pts -= shift
            if packet.dts is not None:
                packet.dts -= shift
            packet.stream = self._target
            yield packet

    def flush(self) -> Iterator[Packet[AudioStream]]:
        return iter(())

    def close(self) -> None:
        self._container.close()


class _Encode:
    """Decodes one or two tracks to 48 kHz stereo, adds them up and encodes the sum."""

    def __init__(self, output: OutputContainer, source: Path | None, ad: Path | None, loop: bool, warn: Warn) -> None:
        self._warn = warn
        self._source = source
        self._ad = ad
        self._loop = loop
        self._tracks: list[_Track] | None = None  # opened when the start is known
        self._written = 0  # samples
        codec, self._format = ("libopus", "flt") if output.format.name == "webm" else ("aac", "fltp")
        self._stream = cast(AudioStream, output.add_stream(codec, rate=SAMPLE_RATE, bit_rate=192_000))
        self._stream.codec_context.format = self._format

    def packets(self, start: Fraction, until: Fraction) -> Iterator[Packet[AudioStream]]:
        if self._tracks is None:
            sources = [_samples(self._source, start, self._warn)] if self._source else []
            ads = [_ad_samples(self._ad, self._loop, self._warn)] if self._ad else []
            self._tracks = [_Track(blocks) for blocks in sources + ads]
        wanted = round((until - start) * SAMPLE_RATE)
        while self._written < wanted:
            count = min(wanted - self._written, _BLOCK_SAMPLES)
            yield from self._stream.encode(self._frame(self._mix([track.read(count) for track in self._tracks])))
            self._written += count

    def _mix(self, parts: list[Samples]) -> Samples:
        if len(parts) == 1:
            return parts[0]
        mixed: Samples = np.clip(MIX_GAIN * (parts[0] + parts[1]), -1, 1)
        return mixed

    def _frame(self, samples: Samples) -> av.AudioFrame:
        if self._format == "fltp":
            data = np.ascontiguousarray(samples)
        else:  # "flt", interleaved
            data = np.ascontiguousarray(samples.T).reshape(1, -1)
        frame = av.AudioFrame.from_ndarray(data, self._format, "stereo")
        frame.sample_rate = SAMPLE_RATE
        frame.pts = self._written
        frame.time_base = Fraction(1, SAMPLE_RATE)
        return frame

    def flush(self) -> Iterator[Packet[AudioStream]]:
        yield from self._stream.encode(None)

    def close(self) -> None:
        for track in self._tracks or []:
            track.close()


class _Track:
    """Reads any number of samples at a time from blocks of any length; silence after their end."""

    def __init__(self, blocks: Iterator[Samples]) -> None:
        self._blocks = blocks
        self._rest: Samples = np.zeros((2, 0), np.float32)

    def read(self, count: int) -> Samples:
        parts, missing = [], count
        while missing > 0:
            if self._rest.shape[1] == 0:
                self._rest = next(self._blocks, np.zeros((2, missing), np.float32))
            part = self._rest[:, :missing]
            self._rest = self._rest[:, missing:]
            parts.append(part)
            missing -= part.shape[1]
        return np.concatenate(parts, axis=1) if parts else np.zeros((2, 0), np.float32)

    def close(self) -> None:
        close = getattr(self._blocks, "close", None)
        if close:
            close()


def _ad_samples(path: Path, loop: bool, warn: Warn) -> Iterator[Samples]:
    """The ad's sound from its first picture on; a looped ad's begins again exactly when its picture does."""
    if not loop:
        yield from _samples(path, None, warn)
        return
    duration = picture_duration(path)
    for turn in itertools.count():
        count = round((turn + 1) * duration * SAMPLE_RATE) - round(turn * duration * SAMPLE_RATE)
        track = _Track(_samples(path, None, warn))
        while count > 0:
            block = track.read(min(count, _BLOCK_SAMPLES))
            yield block
            count -= block.shape[1]
        track.close()


def _samples(path: Path, start: Fraction | None, warn: Warn) -> Iterator[Samples]:
    """A file's sound from `start` seconds (None: from its first picture) without gaps, as its timestamps place it."""
    with av.open(str(path)) as container:
        stream = container.streams.audio[0]
        if start is None:
            pictures = container.streams.video
            first = pictures[0] if pictures else stream
            start = (first.start_time or 0) * (first.time_base or Fraction(0))
        done = 0
        for time, block in _resampled(container, stream, warn):
            begin = done if time is None else round((time - start) * SAMPLE_RATE)
            if abs(begin - done) > _GAP_SAMPLES or (done == 0 and begin < 0):
                block = block[:, max(0, done - begin) :]
                while begin > done:
                    silence = np.zeros((2, min(begin - done, _BLOCK_SAMPLES)), np.float32)
                    yield silence
                    done += silence.shape[1]
            if block.shape[1]:
                yield block
                done += block.shape[1]


def _resampled(container: InputContainer, stream: AudioStream, warn: Warn) -> Iterator[tuple[Fraction | None, Samples]]:
    """(time in seconds, samples) of each decoded piece of sound; a damaged piece is left out."""
    resampler, layout = AudioResampler("fltp", "stereo", SAMPLE_RATE), None
    frames = _decoded(container, stream, warn)
    for frame in itertools.chain(frames, [None]):
        now = (frame.format.name, frame.layout.name, frame.sample_rate) if frame else None
        ready = []
        if now != layout and layout is not None:  # the sound's form changes on the way, or ends
            ready += resampler.resample(None)
            resampler = AudioResampler("fltp", "stereo", SAMPLE_RATE)
        layout = now
        if frame is not None:
            ready += resampler.resample(frame)
        for piece in ready:
            time = None if piece.pts is None else piece.pts * cast(Fraction, piece.time_base)
            yield time, cast(Samples, piece.to_ndarray())


def _decoded(container: InputContainer, stream: AudioStream, warn: Warn) -> Iterator[av.AudioFrame]:
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
            frames = packet.decode() if packet is not None else []
        except (av.FFmpegError, OSError):
            warn(f"the sound of {Path(container.name).name} is damaged: what can be decoded is used")
            frames = []
            if packet is None:
                return
        if packet is None:
            return
        yield from frames
