"""Sound that is encoded anew: one track, or two mixed. Everything is streamed, nothing is held whole."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
import numpy as np
from av.audio.resampler import AudioResampler
from av.audio.stream import AudioStream
from av.container import InputContainer, OutputContainer
from av.packet import Packet
from numpy.typing import NDArray

from .carried import ENCODED_SOUND
from .copying import Warn, open_alone
from .decode import picture_duration

Samples = NDArray[np.float32]  # (channels, n), within -1 to 1
Sound = Callable[[Fraction], Iterator[Samples]]  # blocks of any length from a time on, seconds on the source's clock

MIX_GAIN = np.float32(0.7)  # each of two tracks, 3 dB down
_BLOCK_SECONDS = 1  # of samples produced at once, at most
_GAP_SECONDS = Fraction(1, 50)  # timestamps may be off by so much before silence is put in or samples are dropped
_CHANNEL_BIT_RATE = 96_000  # bits per second
_USUAL_LAYOUTS = ("mono", "stereo", "3.0", "quad", "5.0", "5.1", "6.1", "7.1")  # by the number of channels
_MIXED_UP = {"libopus": {"5.0": "5.1", "6.1": "7.1"}}  # whose channels an encoder mixes up, and what takes them
_INTERLEAVED = "flt"  # PyAV reads beyond the planes of eight channels
_SAME_LAYOUTS = {"5.0(side)": "5.0", "5.1(side)": "5.1"}  # which players know by the other's name


@dataclass(frozen=True)
class Form:
    """How sound is sampled: the rate in Hz, and the channels by FFmpeg's name of their layout."""

    rate: int = 48000
    layout: str = "stereo"

    @property
    def channels(self) -> int:
        return av.AudioLayout(self.layout).nb_channels


def form_for(muxer: str, stream: AudioStream) -> Form:
    """The form nearest to a track's in which it can be encoded for a container."""
    codec = ENCODED_SOUND.get(muxer, "aac")
    rates = av.Codec(codec, "w").audio_rates or [stream.rate]
    rate = stream.rate if stream.rate in rates else 96000 if stream.rate > 96000 and 96000 in rates else 48000
    layout = _SAME_LAYOUTS.get(stream.layout.name, stream.layout.name)
    count = stream.layout.nb_channels
    usual = _USUAL_LAYOUTS[count - 1] if 0 < count <= len(_USUAL_LAYOUTS) else "stereo"
    mixed_up = _MIXED_UP.get(codec, {})
    for name in (mixed_up.get(layout, layout), mixed_up.get(usual, usual)):
        context: Any = av.CodecContext.create(codec, "w")
        try:
            _set_up(context, codec, rate, name)
            context.open()
        except (av.FFmpegError, ValueError):
            continue
        return Form(rate, name)
    return Form(rate)


class Encode:
    """Adds up one or two sounds and encodes the sum."""

    def __init__(self, output: OutputContainer, form: Form, sounds: Sequence[Sound]) -> None:
        """Args:
        output: a container that is not begun yet; its stream is `target`.
        form: of the sounds and of the output.
        sounds: what is heard.
        """
        self._form, self._sounds = form, sounds
        self._tracks: list[_Track] | None = None  # opened when the start is known
        self._written = 0  # samples
        codec = ENCODED_SOUND.get(output.format.name, "aac")
        self.target = cast(AudioStream, output.add_stream(codec, rate=form.rate))
        _set_up(self.target.codec_context, codec, form.rate, form.layout)

    def packets(self, start: Fraction, until: Fraction) -> Iterator[Packet[Any]]:
        if self._tracks is None:
            self._tracks = [_Track(sound(start), self._form.channels) for sound in self._sounds]
        wanted = round((until - start) * self._form.rate)
        while self._written < wanted:
            count = min(wanted - self._written, _BLOCK_SECONDS * self._form.rate)
            yield from self.target.encode(self._frame(_mix([track.read(count) for track in self._tracks])))
            self._written += count

    def flush(self) -> Iterator[Packet[Any]]:
        yield from self.target.encode(None)

    def close(self) -> None:
        for track in self._tracks or []:
            track.close()

    def _frame(self, samples: Samples) -> av.AudioFrame:
        interleaved = np.ascontiguousarray(samples.T).reshape(1, -1)
        frame = av.AudioFrame.from_ndarray(interleaved, _INTERLEAVED, self._form.layout)
        frame.sample_rate = self._form.rate
        frame.pts = self._written
        frame.time_base = Fraction(1, self._form.rate)
        return frame


def _set_up(context: Any, codec: str, rate: int, layout: str) -> None:
    context.sample_rate, context.layout, context.format = rate, layout, "flt" if codec == "libopus" else "fltp"
    context.bit_rate = _CHANNEL_BIT_RATE * context.layout.nb_channels


def _mix(parts: list[Samples]) -> Samples:
    if len(parts) == 1:
        return parts[0]
    mixed: Samples = np.clip(MIX_GAIN * (parts[0] + parts[1]), -1, 1)
    return mixed


class _Track:
    """Reads any number of samples at a time from blocks of any length; silence after their end."""

    def __init__(self, blocks: Iterator[Samples], channels: int) -> None:
        self._blocks, self._channels = blocks, channels
        self._rest: Samples = np.zeros((channels, 0), np.float32)

    def read(self, count: int) -> Samples:
        parts, missing = [np.zeros((self._channels, 0), np.float32)], count
        while missing > 0:
            if self._rest.shape[1] == 0:
                self._rest = next(self._blocks, np.zeros((self._channels, missing), np.float32))
            part = self._rest[:, :missing]
            self._rest = self._rest[:, missing:]
            parts.append(part)
            missing -= part.shape[1]
        return np.concatenate(parts, axis=1)

    def close(self) -> None:
        close = getattr(self._blocks, "close", None)
        if close:
            close()


def silence(seconds: Fraction, form: Form) -> Samples:
    """(channels, n) zeros."""
    return np.zeros((form.channels, round(max(seconds, Fraction(0)) * form.rate)), np.float32)


def first_samples(blocks: Iterator[Samples], count: int) -> Iterator[Samples]:
    """The first samples, as many as given, of blocks (channels, n)."""
    for block in blocks:
        yield block[:, :count]
        count -= block.shape[1]
        if count <= 0:
            return


def ad_samples(path: Path, index: int, form: Form, loop: bool, warn: Warn) -> Iterator[Samples]:
    """An ad's sound from its first picture on; a looped ad's begins again exactly when its picture does."""
    if not loop:
        yield from samples(path, index, form, None, warn)
        return
    duration = picture_duration(path)
    for turn in itertools.count():
        count = round((turn + 1) * duration * form.rate) - round(turn * duration * form.rate)
        track = _Track(samples(path, index, form, None, warn), form.channels)
        while count > 0:
            block = track.read(min(count, _BLOCK_SECONDS * form.rate))
            yield block
            count -= block.shape[1]
        track.close()


def samples(path: Path, index: int, form: Form, start: Fraction | None, warn: Warn) -> Iterator[Samples]:
    """A track's sound from `start` seconds (None: from its first picture) without gaps, as its timestamps place it."""
    container, stream = open_alone(path, index)
    with container:
        if start is None:
            pictures = container.streams.video
            first = pictures[0] if pictures else stream
            start = (first.start_time or 0) * (first.time_base or Fraction(0))
        done, gap = 0, round(_GAP_SECONDS * form.rate)
        for time, block in _resampled(container, cast(AudioStream, stream), form, warn):
            begin = done if time is None else round((time - start) * form.rate)
            if abs(begin - done) > gap or (done == 0 and begin < 0):
                block = block[:, max(0, done - begin) :]
                while begin > done:
                    missing = min(begin - done, _BLOCK_SECONDS * form.rate)
                    yield np.zeros((form.channels, missing), np.float32)
                    done += missing
            if block.shape[1]:
                yield block
                done += block.shape[1]


def first_heard(path: Path, index: int) -> Fraction | None:
    """When a track begins to be heard, in seconds on its file's clock; what only primes its decoder does not count."""
    container, stream = open_alone(path, index)
    with container:
        for frame in _decoded(container, cast(AudioStream, stream), lambda message: None):
            return None if frame.pts is None else frame.pts * cast(Fraction, frame.time_base)
    return None


def _resampled(
    container: InputContainer, stream: AudioStream, form: Form, warn: Warn
) -> Iterator[tuple[Fraction | None, Samples]]:
    """(time in seconds, samples) of each decoded piece of sound; a damaged piece is left out."""
    resampler: AudioResampler | None = None
    before = None
    frames = _decoded(container, stream, warn)
    for frame in itertools.chain(frames, [None]):
        now = (frame.format.name, frame.layout.name, frame.sample_rate) if frame else None
        ready = []
        if now != before and resampler is not None:  # the sound's form changes on the way, or ends
            ready += resampler.resample(None)
            resampler = None
        before = now
        if frame is not None:
            resampler = resampler or AudioResampler(_INTERLEAVED, _layout_for(frame, form), form.rate)
            ready += resampler.resample(frame)
        for piece in ready:
            time = None if piece.pts is None else piece.pts * cast(Fraction, piece.time_base)
            yield time, cast(Samples, piece.to_ndarray().reshape(-1, form.channels).T)


def _layout_for(frame: av.AudioFrame, form: Form) -> str:
    """The layout to resample to: channels of which nobody says what they are are not mixed with each other."""
    same = frame.layout.nb_channels == form.channels and frame.layout.name.endswith(" channels")
    return frame.layout.name if same else form.layout


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
