"""Clips, made when a test needs them, with what real ones have: odd rates and sizes, turns, alpha, sound, damage."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
import numpy as np
from av.audio.stream import AudioStream
from av.video.reformatter import ColorRange, Interpolation
from av.video.stream import VideoStream
from numpy.typing import NDArray

from hdn.imaging.arrays import Image

SOUND_RATE = 48000
BT709, BT601, BT2020 = 1, 5, 9  # swscale's numbers


def number_image(number: int, width: int = 96, height: int = 64) -> Image:
    """A picture that says its number (0..255) as eight big black or white bars; survives any lossy codec."""
    bars = [255 * (number >> bit & 1) for bit in range(8)]
    columns = np.repeat(np.array(bars, np.uint8), -(-width // 8))[:width]
    image: Image = np.repeat(np.broadcast_to(columns, (height, width))[..., None], 3, axis=2)
    return np.ascontiguousarray(image)


def number_of(image: Image) -> int:
    """The number that a picture of number_image says."""
    step = -(-image.shape[1] // 8)
    row = image[image.shape[0] // 2, step // 2 :: step, 1]
    return sum(1 << bit for bit in range(8) if row[bit] > 127)


def numbered(count: int, width: int = 96, height: int = 64) -> list[Image]:
    return [number_image(index, width, height) for index in range(count)]


def color_chart(width: int, height: int) -> Image:
    """Four by six flat patches: primaries, their mixtures, greys, and skin-like and muted colours."""
    patches = np.array(
        [
            [[255, 0, 0], [0, 255, 0], [0, 0, 255], [0, 255, 255], [255, 0, 255], [255, 255, 0]],
            [[0, 0, 0], [51, 51, 51], [102, 102, 102], [153, 153, 153], [204, 204, 204], [255, 255, 255]],
            [[115, 82, 68], [194, 150, 130], [98, 122, 157], [87, 108, 67], [133, 128, 177], [103, 189, 170]],
            [[214, 126, 44], [80, 91, 166], [193, 90, 99], [94, 60, 108], [157, 188, 64], [224, 163, 46]],
        ],
        np.uint8,
    )
    rows = np.arange(height) * 4 // height
    columns = np.arange(width) * 6 // width
    return np.ascontiguousarray(patches[rows][:, columns])


def patch_colors(image: Image) -> NDArray[np.float64]:
    """(4, 6, 3) mean colour of each patch's middle."""
    height, width = image.shape[0] / 4, image.shape[1] / 6
    return np.array(
        [
            [
                image[
                    int((row + 0.3) * height) : int((row + 0.7) * height),
                    int((column + 0.3) * width) : int((column + 0.7) * width),
                ].mean((0, 1))
                for column in range(6)
            ]
            for row in range(4)
        ]
    )


def tone(seconds: float, frequency: float = 440.0, amplitude: float = 0.5) -> NDArray[np.float32]:
    """(2, n) a sine at 48 kHz."""
    time = np.arange(round(seconds * SOUND_RATE)) / SOUND_RATE
    wave = amplitude * np.sin(2 * np.pi * frequency * time)
    return np.stack([wave, wave]).astype(np.float32)


def clicks(seconds: float, at: Sequence[float], length: float = 0.01) -> NDArray[np.float32]:
    """(2, n) silence with a short 1 kHz burst at each of the given times."""
    sound = np.zeros((2, round(seconds * SOUND_RATE)), np.float32)
    burst = tone(length, 1000.0, 0.9)
    for time in at:
        begin = round(time * SOUND_RATE)
        sound[:, begin : begin + burst.shape[1]] = burst[:, : sound.shape[1] - begin]
    return sound


def make_clip(
    path: Path,
    images: Sequence[Image],
    *,
    rate: Fraction | int = 25,
    times: Sequence[Fraction] | None = None,
    time_base: Fraction | None = None,
    codec: str = "libx264",
    pix_fmt: str = "yuv420p",
    options: dict[str, str] | None = None,
    matrix: int = BT709,
    tagged: bool = True,
    full_range: bool = False,
    transfer: int | None = None,
    rotation: int = 0,
    sound: NDArray[np.float32] | None = None,
    sound_start: Fraction = Fraction(0),
    sound_codec: str = "aac",
    sound_rate: int = SOUND_RATE,
    gop: int = 12,
    tags: dict[str, str] | None = None,
    pixel_aspect: Fraction | None = None,
) -> Path:
    """Writes a clip.

    images: uint8 (H, W, 3) RGB or (H, W, 4) RGBA. times: seconds of each frame, None for a constant rate.
    matrix, full_range: what the colours are encoded with; tagged: whether the file says so. rotation: counterclockwise
    degrees to be turned by a player. sound: (2, n) at 48 kHz, beginning at sound_start seconds.
    """
    rate = Fraction(rate)
    base = time_base or Fraction(1, rate.numerator * (1 if rate.numerator > 10000 else 1000))
    height, width, channels = images[0].shape
    color_range = ColorRange.JPEG if full_range else ColorRange.MPEG
    with av.open(str(path), "w") as container:
        defaults = {"crf": "10", "preset": "ultrafast"} if codec == "libx264" else {}
        stream = cast(VideoStream, container.add_stream(codec, rate=rate, options=defaults | (options or {})))
        context = stream.codec_context
        context.width, context.height, context.pix_fmt, context.gop_size = width, height, pix_fmt, gop
        context.time_base = stream.time_base = base
        if pixel_aspect:
            context.sample_aspect_ratio = pixel_aspect
        if tagged and not pix_fmt.startswith(("rgb", "gbr", "argb", "bgr")):
            context.colorspace = {BT709: 1, BT601: 6, BT2020: 9}[matrix]
            context.color_range = color_range
            if transfer is not None:
                context.color_trc = transfer
        if rotation:
            stream.set_display_rotation(rotation)
        stream.metadata.update(tags or {})
        voice: Any = None
        if sound is not None:
            voice = cast(AudioStream, container.add_stream(sound_codec, rate=sound_rate))
        for index, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), "rgba" if channels == 4 else "rgb24")
            frame = frame.reformat(
                format=pix_fmt,
                dst_colorspace=matrix,
                src_color_range=ColorRange.JPEG,
                dst_color_range=color_range,
                interpolation=int(Interpolation.BILINEAR) | 0x40000,  # SWS_ACCURATE_RND
            )
            time = Fraction(times[index]) if times is not None else index / rate
            frame.time_base, frame.pts = base, round(time / base)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
        if sound is not None:
            _write_sound(container, voice, sound, sound_start)
    return path


def make_sound(path: Path, sound: NDArray[np.float32], codec: str = "aac") -> Path:
    """Writes a file with sound only."""
    with av.open(str(path), "w") as container:
        _write_sound(container, cast(AudioStream, container.add_stream(codec, rate=SOUND_RATE)), sound, Fraction(0))
    return path


def _write_sound(
    container: av.container.OutputContainer, voice: AudioStream, sound: NDArray[np.float32], start: Fraction
) -> None:
    offset = round(start * SOUND_RATE)
    for begin in range(0, sound.shape[1], SOUND_RATE):
        frame = av.AudioFrame.from_ndarray(np.ascontiguousarray(sound[:, begin : begin + SOUND_RATE]), "fltp", "stereo")
        frame.sample_rate, frame.time_base, frame.pts = SOUND_RATE, Fraction(1, SOUND_RATE), offset + begin
        container.mux(voice.encode(frame))
    container.mux(voice.encode(None))


def truncated(path: Path, share: float) -> Path:
    """Cuts a file down to a share of its bytes."""
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    return path


def frame_times(path: Path) -> list[Fraction]:
    """Times of all frames in seconds, as the file has them."""
    with av.open(str(path)) as container:
        return [cast(int, frame.pts) * cast(Fraction, frame.time_base) for frame in container.decode(video=0)]


def sound_packets(path: Path) -> list[tuple[Fraction, bytes]]:
    """(time, content) of each packet of the first sound track."""
    with av.open(str(path)) as container:
        stream = container.streams.audio[0]
        return [
            (packet.pts * packet.time_base, bytes(packet))
            for packet in container.demux(stream)
            if packet.pts is not None
        ]


def read_sound(path: Path) -> NDArray[np.float32]:
    """(2, n) the first sound track at 48 kHz; n = 0 at time 0, with silence where there is none."""
    resampler = av.AudioResampler("fltp", "stereo", SOUND_RATE)
    pieces: list[tuple[int, NDArray[np.float32]]] = []
    with av.open(str(path)) as container:
        frames: list[av.AudioFrame | None] = [*container.decode(audio=0), None]
        for frame in frames:
            for piece in resampler.resample(frame):
                begin = round(cast(int, piece.pts) * cast(Fraction, piece.time_base) * SOUND_RATE)
                pieces.append((begin, cast(Any, piece.to_ndarray())))
    length = max((begin + piece.shape[1] for begin, piece in pieces), default=0)
    sound = np.zeros((2, length), np.float32)
    for begin, samples in pieces:
        skip = max(0, -begin)
        sound[:, begin + skip : begin + samples.shape[1]] = samples[:, skip:]
    return sound


def onsets(sound: NDArray[np.float32], threshold: float = 0.3) -> list[float]:
    """Seconds at which bursts begin."""
    loud = np.flatnonzero(np.abs(sound[0]) > threshold)
    starts = [time for index, time in enumerate(loud) if index == 0 or time - loud[index - 1] > SOUND_RATE // 20]
    return [float(time) / SOUND_RATE for time in starts]
