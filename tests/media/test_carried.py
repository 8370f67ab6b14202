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
TONES = (400, 700, 1000, 1300, 1600, 1900)  # Hz, one for each channel


def sounding(path: Path, encoder: str, channels: int = 2, layout: str = "stereo", rate: int = 48000) -> Path:
    """A clip of a second whose channels have a tone each; the fourth of 5.1, for low tones, has 60 Hz."""
    picture = clip(path.with_suffix(".picture.mkv"), 1)
    tones = [60 if index == 3 and channels == 6 else tone for index, tone in enumerate(TONES[:channels])]
    wave = "|".join(f"0.4*sin(2*PI*{tone}*t)" for tone in tones)
    run_ffmpeg(
        "-i", str(picture), "-f", "lavfi", "-i", f"aevalsrc={wave}:c={layout}:s={rate}:d=1",
        "-map", "0:v", "-map", "1:a", "-c:v", "copy", "-c:a", encoder, "-strict", "-2", "-b:a", "384k", str(path),
    )  # fmt: skip
    return path


def run_ffmpeg(*arguments: str) -> None:
    subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", *arguments], check=True, capture_output=True)


def heard(path: Path) -> tuple[str, str, int, NDArray[np.float64], float]:
    """Codec, layout, rate, the loudest frequency of each channel in Hz, and seconds, of the first sound track."""
    with av.open(str(path)) as container:
        stream = container.streams.audio[0]
        resampler = av.AudioResampler("fltp", stream.layout.name, stream.rate)
        frames: list[Any] = [*container.decode(audio=0), None]
        sound = np.concatenate([piece.to_ndarray() for frame in frames for piece in resampler.resample(frame)], 1)
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
@pytest.mark.parametrize("layout", ["5.1", "5.1(side)"])
def test_sound_that_is_encoded_anew_keeps_its_channels(tmp_path: Path, suffix: str, layout: str) -> None:
    source = sounding(tmp_path / "in.mov", "pcm_s24le", 6, layout)
    name, found, rate, peaks, _ = heard(rewrite(source, tmp_path / f"out.{suffix}", Streams("source", source)))
    assert (name, found, rate) == ("opus" if suffix == "webm" else "aac", "5.1", 48000)
    assert np.allclose(peaks[[0, 1, 2, 4, 5]], np.array(TONES)[[0, 1, 2, 4, 5]], atol=5)
    assert abs(peaks[3] - 60) <= 5


@pytest.mark.parametrize(("rate", "expected"), [(44100, 44100), (96000, 96000), (192000, 96000)])
def test_sound_that_is_encoded_anew_keeps_its_rate(tmp_path: Path, rate: int, expected: int) -> None:
    source = sounding(tmp_path / "in.mov", "pcm_s16le", 1, "mono", rate)
    name, layout, found, peaks, _ = heard(rewrite(source, tmp_path / "out.mp4", Streams("source", source)))
    assert (name, layout, found) == ("aac", "mono", expected)
    assert np.allclose(peaks, TONES[:1], atol=5)
