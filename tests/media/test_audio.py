"""Sound: copied to the bit, in time with the picture, looped with the ad, mixed without clipping, or not there."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from ar_demo.media.audio import Audio
from ar_demo.media.reader import VideoReader
from ar_demo.media.writer import VideoWriter

from .. import clips as media

FRAME = 1 / 25


def clip(path: Path, seconds: float = 2, **options: Any) -> Path:
    return media.make_clip(path, media.numbered(round(seconds * 25)), **options)


def rewrite(source: Path, target: Path, audio: Audio, stop: int | None = None) -> Path:
    """Reads a video and writes it as it is, with the given sound."""
    with VideoReader(source) as reader:
        info = reader.info
        with VideoWriter(target, info.width, info.height, info.rate, audio=audio, time_base=info.time_base) as writer:
            for frame in reader.frames(0, stop):
                writer.write(frame.image, frame.time, frame.duration)
    return target


def sounds(path: Path) -> list[str]:
    with av.open(str(path)) as container:
        return [stream.codec_context.name for stream in container.streams.audio]


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
def test_the_sources_sound_is_copied_to_the_bit(tmp_path: Path, suffix: str) -> None:
    source = clip(tmp_path / "in.mp4", sound=media.tone(2))
    output = rewrite(source, tmp_path / f"out.{suffix}", Audio("source", source))
    before, after = media.sound_packets(source), media.sound_packets(output)
    if suffix == "mkv":  # which cannot hide what lies before zero
        before = [packet for packet in before if packet[0] >= 0]
    assert [content for _, content in after] == [content for _, content in before]
    assert all(abs(a - b) <= Fraction(1, 1000) for (a, _), (b, _) in zip(after, before, strict=True))
    assert media.frame_times(output)[0] == 0


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "webm"])
def test_sound_stays_in_time_with_a_variable_rate_picture(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(0)
    times = [Fraction(0)]
    while times[-1] < 2:
        times.append(times[-1] + Fraction(int(rng.integers(15, 120)), 1000))
    bright = {min(range(len(times)), key=lambda index: abs(times[index] - at)) for at in (0.5, 1.0, 1.5)}
    images = [media.number_image(255 if index in bright else 0) for index in range(len(times))]
    flashes = [float(times[index]) for index in sorted(bright)]
    source = media.make_clip(tmp_path / "in.mp4", images, times=times, sound=media.clicks(2, flashes))
    output = rewrite(source, tmp_path / f"out.{suffix}", Audio("source", source))
    frames = list(VideoReader(output).frames())
    seen = [float(frame.time) for frame in frames if media.number_of(frame.image) == 255]
    heard = media.onsets(media.read_sound(output))
    assert len(seen) == len(heard) == 3
    assert np.abs(np.array(seen) - heard).max() < 0.005


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
@pytest.mark.parametrize("mode", ["source", "mix"])
def test_sound_that_begins_late_stays_late(tmp_path: Path, suffix: str, mode: Any) -> None:
    source = clip(tmp_path / "in.mkv", sound=media.clicks(1.2, [0.2]), sound_start=Fraction(4, 5))
    ad = clip(tmp_path / "ad.mp4", sound=media.tone(2, amplitude=0.05))
    output = rewrite(source, tmp_path / f"out.{suffix}", Audio(mode, source, ad))
    assert np.allclose(media.onsets(media.read_sound(output)), [1.0], atol=0.005)


def test_a_file_that_does_not_begin_at_zero(tmp_path: Path) -> None:
    """MPEG transport streams begin anywhere: picture and sound move together."""
    times = [2 + Fraction(index, 25) for index in range(50)]
    source = clip(tmp_path / "in.ts", times=times, sound=media.clicks(2, [0.5, 1.5]), sound_start=Fraction(2))
    begin = media.frame_times(source)[0]
    assert begin > 1
    heard = np.array(media.onsets(media.read_sound(source))) - float(begin)
    output = rewrite(source, tmp_path / "out.mp4", Audio("source", source))
    assert media.frame_times(output)[0] == 0
    assert np.allclose(media.onsets(media.read_sound(output)), heard, atol=0.005)


def test_sound_ends_with_the_picture(tmp_path: Path) -> None:
    source = clip(tmp_path / "in.mp4", 1, sound=media.tone(3))
    for mode, ad in (("source", None), ("mix", source)):
        output = rewrite(source, tmp_path / f"{mode}.mp4", Audio(mode, source, ad), stop=20)  # type: ignore[arg-type]
        assert abs(media.read_sound(output).shape[1] / media.SOUND_RATE - 20 * FRAME) < 0.03


@pytest.mark.parametrize(
    ("suffix", "sound_codec", "target", "expected"),
    [
        ("mov", "pcm_s16le", "mov", "pcm_s16le"),
        ("mov", "pcm_s16le", "webm", "opus"),
        ("mp4", "aac", "webm", "opus"),
        ("mkv", "libopus", "mkv", "opus"),
        ("mkv", "libopus", "mp4", "opus"),
        ("mkv", "libopus", "mov", "aac"),
        ("mkv", "flac", "mp4", "flac"),
        ("mkv", "flac", "mov", "aac"),
        ("ts", "aac", "mp4", "aac"),
    ],
)
def test_sound_is_copied_where_the_container_takes_it_and_else_encoded_anew(
    tmp_path: Path, suffix: str, sound_codec: str, target: str, expected: str, caplog: pytest.LogCaptureFixture
) -> None:
    source = clip(tmp_path / f"in.{suffix}", 1, sound=media.clicks(1, [0.4]), sound_codec=sound_codec)
    output = rewrite(source, tmp_path / f"out.{target}", Audio("source", source))
    assert sounds(output) == [expected]
    copied = expected == sounds(source)[0]
    assert ("anew" in caplog.text) != copied
    begin = float(media.frame_times(source)[0])
    expected_onsets = np.array(media.onsets(media.read_sound(source))) - begin
    assert np.allclose(media.onsets(media.read_sound(output)), expected_onsets, atol=0.005)


def test_mono_of_another_rate_is_resampled(tmp_path: Path) -> None:
    source = clip(tmp_path / "in.mkv", 1)
    voice = tmp_path / "ad.mkv"
    with av.open(str(voice), "w") as container:
        stream: Any = container.add_stream("pcm_s16le", rate=22050)
        stream.codec_context.layout = "mono"
        picture: Any = container.add_stream("libx264", rate=25)
        picture.width, picture.height = 96, 64
        for image in media.numbered(25):
            container.mux(picture.encode(av.VideoFrame.from_ndarray(image, "rgb24")))
        container.mux(picture.encode(None))
        wave = (np.sin(np.arange(22050) * 2 * np.pi * 441 / 22050) * 16000).astype(np.int16)[None]
        frame = av.AudioFrame.from_ndarray(wave, "s16", "mono")
        frame.sample_rate = 22050
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    sound = media.read_sound(rewrite(source, tmp_path / "out.mp4", Audio("ad", source, voice)))
    spectrum = np.abs(np.fft.rfft(sound[0, 8000:32000]))
    assert abs(np.argmax(spectrum) * 2 - 441) <= 2
    assert np.allclose(sound[0], sound[1], atol=0.02)


def test_a_looped_ads_sound_begins_again_with_its_picture(tmp_path: Path) -> None:
    """Although it is longer than the picture, by 0.15 s."""
    source = clip(tmp_path / "in.mp4", 2)
    ad = clip(tmp_path / "ad.mp4", 0.6, sound=media.clicks(0.75, [0.1, 0.7]))
    output = rewrite(source, tmp_path / "out.mp4", Audio("ad", source, ad, "loop"))
    assert np.allclose(media.onsets(media.read_sound(output)), [0.1, 0.7, 1.3, 1.9], atol=0.005)


@pytest.mark.parametrize("playback", ["hold", "once"])
def test_an_ad_that_is_not_looped_sounds_once(tmp_path: Path, playback: Any) -> None:
    source = clip(tmp_path / "in.mp4", 2)
    ad = clip(tmp_path / "ad.mp4", 0.6, sound=media.clicks(0.6, [0.1]))
    output = rewrite(source, tmp_path / "out.mp4", Audio("ad", source, ad, playback))
    sound = media.read_sound(output)
    assert np.allclose(media.onsets(sound), [0.1], atol=0.005)
    assert abs(sound.shape[1] / media.SOUND_RATE - 2) < 0.03


def test_a_mix_has_both_and_does_not_clip(tmp_path: Path) -> None:
    source = clip(tmp_path / "in.mp4", 1, sound=media.tone(1, 440, 0.6))
    ad = clip(tmp_path / "ad.mp4", 1, sound=media.tone(1, 1000, 0.6))
    sound = media.read_sound(rewrite(source, tmp_path / "out.mp4", Audio("mix", source, ad)))
    spectrum = np.abs(np.fft.rfft(sound[0, 12000:36000])) / 12000
    assert abs(spectrum[220] - 0.42) < 0.03  # 440 Hz, 3 dB down
    assert abs(spectrum[500] - 0.42) < 0.03
    assert np.sort(spectrum)[-3] < 0.01  # and nothing else: no distortion
    assert np.abs(sound).max() <= 1


@pytest.mark.parametrize("mode", ["source", "ad", "mix"])
def test_silent_files_are_no_error(tmp_path: Path, mode: Any, caplog: pytest.LogCaptureFixture) -> None:
    source, ad = clip(tmp_path / "in.mp4", 1), clip(tmp_path / "ad.mp4", 1)
    output = rewrite(source, tmp_path / "out.mp4", Audio(mode, source, ad))
    assert sounds(output) == []
    assert ("no sound" in caplog.text) == (mode != "source")  # a silent video that keeps its sound is as it was


def test_a_mix_with_a_silent_ad_copies_the_source(tmp_path: Path) -> None:
    source, ad = clip(tmp_path / "in.mp4", 1, sound=media.tone(1)), clip(tmp_path / "ad.mp4", 1)
    output = rewrite(source, tmp_path / "out.mp4", Audio("mix", source, ad))
    assert {content for _, content in media.sound_packets(output)} <= {
        content for _, content in media.sound_packets(source)
    }


def test_an_image_has_no_sound(tmp_path: Path) -> None:
    source, ad = clip(tmp_path / "in.mp4", 1), tmp_path / "ad.png"
    av.VideoFrame.from_ndarray(media.number_image(1), "rgb24").save(str(ad))
    assert sounds(rewrite(source, tmp_path / "out.mp4", Audio("ad", source, ad))) == []


def test_none_is_silent(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    source = clip(tmp_path / "in.mp4", 1, sound=media.tone(1))
    assert sounds(rewrite(source, tmp_path / "out.mp4", Audio("none", source, source))) == []
    assert caplog.text == ""


def test_damaged_sound_does_not_stop_the_picture(tmp_path: Path) -> None:
    source = clip(tmp_path / "in.mkv", 2, sound=media.tone(2))
    broken = media.truncated(clip(tmp_path / "ad.mkv", 2, sound=media.tone(2)), 0.6)
    for mode in ("ad", "mix"):
        output = rewrite(source, tmp_path / f"{mode}.mp4", Audio(mode, source, broken))
        assert len(media.frame_times(output)) == 50
