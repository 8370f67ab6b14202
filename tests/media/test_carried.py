"""Sound by container, each cell decoded: copied where players of the container read it, else encoded anew."""

import subprocess
from pathlib import Path
from typing import Any

import av
import imageio_ffmpeg
import numpy as np
import pytest
from numpy.typing import NDArray

from ar_demo.media.streams import Streams

from ..videos import clip, rewrite

SUFFIXES = ("mp4", "mov", "mkv", "webm")
# Codec, FFmpeg's encoder, and what it is in each of the containers.
CELLS = {
    "aac": ("aac", "aac", "aac", "aac", "opus"),
    "mp3": ("libmp3lame", "mp3", "mp3", "mp3", "opus"),
    "ac3": ("ac3", "ac3", "ac3", "ac3", "opus"),
    "eac3": ("eac3", "eac3", "eac3", "eac3", "opus"),
    "alac": ("alac", "alac", "alac", "alac", "opus"),
    "flac": ("flac", "flac", "aac", "flac", "opus"),
    "opus": ("libopus", "opus", "aac", "opus", "opus"),
    "vorbis": ("libvorbis", "aac", "aac", "vorbis", "vorbis"),
    "mp2": ("mp2", "aac", "aac", "mp2", "opus"),
    "dts": ("dca", "aac", "aac", "dts", "opus"),
    "truehd": ("truehd", "aac", "aac", "truehd", "opus"),
    "wavpack": ("wavpack", "aac", "aac", "wavpack", "opus"),
    "pcm_s16le": ("pcm_s16le", "aac", "pcm_s16le", "pcm_s16le", "opus"),
    "pcm_s24le": ("pcm_s24le", "aac", "pcm_s24le", "pcm_s24le", "opus"),
    "pcm_f32le": ("pcm_f32le", "aac", "pcm_f32le", "pcm_f32le", "opus"),
    "pcm_s16be": ("pcm_s16be", "aac", "pcm_s16be", "pcm_s16be", "opus"),
    "pcm_alaw": ("pcm_alaw", "aac", "pcm_alaw", "aac", "opus"),
}
TONES = (400, 700, 1000, 1300, 1600, 1900, 2200, 2500)  # Hz, one for each channel
LOW_TONE = 60  # Hz, for the channel of low tones


def sounding(path: Path, encoder: str, layout: str = "stereo", rate: int = 48000) -> Path:
    """A clip of a second whose channels have a tone each."""
    picture = clip(path.with_suffix(".picture.mkv"), 1)
    wave = "|".join(f"0.4*sin(2*PI*{tone}*t)" for tone in tones_of(layout).values())
    run_ffmpeg(
        "-i", str(picture), "-f", "lavfi", "-i", f"aevalsrc={wave}:c={layout}:s={rate}:d=1",
        "-map", "0:v", "-map", "1:a", "-c:v", "copy", "-c:a", encoder, "-strict", "-2", "-b:a", "384k", str(path),
    )  # fmt: skip
    return path


def tones_of(layout: str) -> dict[str, int]:
    """The tone in Hz of each channel by name."""
    names = [channel.name for channel in av.AudioLayout(layout).channels]
    return {name: LOW_TONE if name == "LFE" else tone for name, tone in zip(names, TONES, strict=False)}


def run_ffmpeg(*arguments: str) -> None:
    subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", *arguments], check=True, capture_output=True)


def heard(path: Path) -> tuple[str, str, int, NDArray[np.float64], float]:
    """Codec, layout, rate, the loudest frequency of each channel in Hz, and seconds, of the first sound track."""
    with av.open(str(path)) as container:
        stream = container.streams.audio[0]
        resampler = av.AudioResampler("flt", stream.layout.name, stream.rate)
        frames: list[Any] = [*container.decode(audio=0), None]
        pieces = [piece.to_ndarray() for frame in frames for piece in resampler.resample(frame)]
        sound = np.concatenate([piece.reshape(-1, stream.layout.nb_channels) for piece in pieces]).T
        middle = sound[:, sound.shape[1] // 4 : sound.shape[1] * 3 // 4]
        spectrum = np.abs(np.fft.rfft(middle * np.hanning(middle.shape[1])))
        peaks = spectrum.argmax(1) * stream.rate / middle.shape[1]
        name = stream.codec_context.codec.canonical_name
        return name, stream.layout.name, stream.rate, peaks, sound.shape[1] / stream.rate


@pytest.mark.parametrize("codec", CELLS)
def test_each_cell_of_codec_and_container_is_heard_as_it_was(tmp_path: Path, codec: str) -> None:
    encoder, *expected = CELLS[codec]
    source = sounding(tmp_path / f"in.{'mov' if codec == 'pcm_alaw' else 'mkv'}", encoder)
    for suffix, name in zip(SUFFIXES, expected, strict=True):
        streams = Streams("source", source)
        found, layout, rate, peaks, seconds = heard(rewrite(source, tmp_path / f"out.{suffix}", streams))
        assert (found, rate) == (name, 48000)
        assert layout in ("stereo", "2 channels")  # Matroska does not say which ones PCM has
        assert np.allclose(peaks, TONES[:2], atol=5)
        assert abs(seconds - 1) < 0.08
        assert bool(streams.warnings) == (name != codec)


@pytest.mark.parametrize("suffix", ["mp4", "webm"])
@pytest.mark.parametrize("layout", ["3.0", "quad", "5.0", "5.1", "5.1(side)", "6.1", "7.1"])
def test_sound_that_is_encoded_anew_keeps_its_channels(tmp_path: Path, suffix: str, layout: str) -> None:
    source = sounding(tmp_path / "in.mov", "pcm_s24le", layout)
    name, found, rate, peaks, _ = heard(rewrite(source, tmp_path / f"out.{suffix}", Streams("source", source)))
    assert (name, rate) == ("opus" if suffix == "webm" else "aac", 48000)
    if found == "7 channels":  # AAC has no name for 6.1
        found = "6.1"
    same = {"5.1(side)": "5.1"} | ({"5.0": "5.1", "6.1": "7.1"} if suffix == "webm" else {})
    assert found == same.get(layout, layout)
    if (layout, suffix) != ("6.1", "webm"):  # whose middle at the back goes to both sides
        was = {channel.replace("S", "B"): tone for channel, tone in tones_of(layout).items()} if found == "5.1" else {}
        was = was or tones_of(layout)
        for channel, peak in zip(av.AudioLayout(found).channels, peaks, strict=True):
            assert channel.name not in was or abs(peak - was[channel.name]) <= 5


@pytest.mark.parametrize("suffix", ["mp4", "webm"])
@pytest.mark.parametrize("channels", [4, 8, 10])
def test_channels_without_names_are_encoded_anew(tmp_path: Path, suffix: str, channels: int) -> None:
    """As recorders write them; those beyond eight are mixed to two."""
    first = sounding(tmp_path / "mono.mov", "pcm_s16le", "mono")
    source = tmp_path / "in.mkv"
    pan = f"pan={channels}c|" + "|".join(f"c{i}=c0" for i in range(channels))
    run_ffmpeg("-i", str(first), "-af", pan, "-c:v", "copy", "-c:a", "pcm_s16le", str(source))
    streams = Streams("source", source)
    _, layout, _, peaks, _ = heard(rewrite(source, tmp_path / f"out.{suffix}", streams))
    assert av.AudioLayout(layout).nb_channels == (2 if channels > 8 else channels)
    assert ("stereo" in " ".join(streams.warnings)) == (channels > 8)
    others = [peak for i, peak in enumerate(peaks) if not (channels == 8 and i == 3)]  # that of low tones
    assert np.allclose(others, TONES[0], atol=5)


@pytest.mark.parametrize(("rate", "expected"), [(44100, 44100), (96000, 96000), (192000, 96000)])
def test_sound_that_is_encoded_anew_keeps_its_rate(tmp_path: Path, rate: int, expected: int) -> None:
    source = sounding(tmp_path / "in.mov", "pcm_s16le", "mono", rate)
    name, layout, found, peaks, _ = heard(rewrite(source, tmp_path / "out.mp4", Streams("source", source)))
    assert (name, layout, found) == ("aac", "mono", expected)
    assert np.allclose(peaks, TONES[:1], atol=5)
