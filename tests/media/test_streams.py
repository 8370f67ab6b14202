"""Sound: copied to the bit, in time with the picture, looped with the ad, mixed without clipping, or not there."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from ar_demo.media.streams import Streams

from .. import clips
from ..videos import clip, rewrite, sound_codecs

FRAME = 1 / 25


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
def test_the_sources_sound_is_copied_to_the_bit(tmp_path: Path, suffix: str) -> None:
    source = clip(tmp_path / "in.mp4", sound=clips.tone(2))
    output = rewrite(source, tmp_path / f"out.{suffix}", Streams("source", source))
    before, after = clips.sound_packets(source), clips.sound_packets(output)
    if suffix == "mkv":  # which cannot hide what lies before zero
        before = [packet for packet in before if packet[0] >= 0]
    assert [content for _, content in after] == [content for _, content in before]
    assert all(abs(a - b) <= Fraction(1, 1000) for (a, _), (b, _) in zip(after, before, strict=True))
    assert clips.frame_times(output)[0] == 0


def test_sound_ends_with_the_picture(tmp_path: Path) -> None:
    source = clip(tmp_path / "in.mp4", 1, sound=clips.tone(3))
    for mode, ad in (("source", None), ("mix", source)):
        output = rewrite(source, tmp_path / f"{mode}.mp4", Streams(mode, source, ad), stop=20)  # type: ignore[arg-type]
        assert abs(clips.read_sound(output).shape[1] / clips.SOUND_RATE - 20 * FRAME) < 0.03


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
    source = clip(tmp_path / f"in.{suffix}", 1, sound=clips.clicks(1, [0.4]), sound_codec=sound_codec)
    output = rewrite(source, tmp_path / f"out.{target}", Streams("source", source))
    assert sound_codecs(output) == [expected]
    copied = expected == sound_codecs(source)[0]
    assert ("anew" in caplog.text) != copied
    begin = float(clips.frame_times(source)[0])
    expected_onsets = np.array(clips.onsets(clips.read_sound(source))) - begin
    assert np.allclose(clips.onsets(clips.read_sound(output)), expected_onsets, atol=0.005)


def test_mono_of_another_rate_is_resampled(tmp_path: Path) -> None:
    source = clip(tmp_path / "in.mkv", 1)
    voice = tmp_path / "ad.mkv"
    with av.open(str(voice), "w") as container:
        stream: Any = container.add_stream("pcm_s16le", rate=22050)
        stream.codec_context.layout = "mono"
        picture: Any = container.add_stream("libx264", rate=25)
        picture.width, picture.height = 96, 64
        for image in clips.numbered(25):
            container.mux(picture.encode(av.VideoFrame.from_ndarray(image, "rgb24")))
        container.mux(picture.encode(None))
        wave = (np.sin(np.arange(22050) * 2 * np.pi * 441 / 22050) * 16000).astype(np.int16)[None]
        frame = av.AudioFrame.from_ndarray(wave, "s16", "mono")
        frame.sample_rate = 22050
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    sound = clips.read_sound(rewrite(source, tmp_path / "out.mp4", Streams("ad", source, voice)))
    spectrum = np.abs(np.fft.rfft(sound[0, 8000:32000]))
    assert abs(np.argmax(spectrum) * 2 - 441) <= 2
    assert np.allclose(sound[0], sound[1], atol=0.02)


def test_a_looped_ads_sound_begins_again_with_its_picture(tmp_path: Path) -> None:
    """Although it is longer than the picture, by 0.15 s."""
    source = clip(tmp_path / "in.mp4", 2)
    ad = clip(tmp_path / "ad.mp4", 0.6, sound=clips.clicks(0.75, [0.1, 0.7]))
    output = rewrite(source, tmp_path / "out.mp4", Streams("ad", source, ad, "loop"))
    assert np.allclose(clips.onsets(clips.read_sound(output)), [0.1, 0.7, 1.3, 1.9], atol=0.005)


@pytest.mark.parametrize("playback", ["hold", "once"])
def test_an_ad_that_is_not_looped_sounds_once(tmp_path: Path, playback: Any) -> None:
    source = clip(tmp_path / "in.mp4", 2)
    ad = clip(tmp_path / "ad.mp4", 0.6, sound=clips.clicks(0.6, [0.1]))
    output = rewrite(source, tmp_path / "out.mp4", Streams("ad", source, ad, playback))
    sound = clips.read_sound(output)
    assert np.allclose(clips.onsets(sound), [0.1], atol=0.005)
    assert abs(sound.shape[1] / clips.SOUND_RATE - 2) < 0.03


def test_a_mix_has_both_and_does_not_clip(tmp_path: Path) -> None:
    source = clip(tmp_path / "in.mp4", 1, sound=clips.tone(1, 440, 0.6))
    ad = clip(tmp_path / "ad.mp4", 1, sound=clips.tone(1, 1000, 0.6))
    sound = clips.read_sound(rewrite(source, tmp_path / "out.mp4", Streams("mix", source, ad)))
    spectrum = np.abs(np.fft.rfft(sound[0, 12000:36000])) / 12000
    assert abs(spectrum[220] - 0.42) < 0.03  # 440 Hz, 3 dB down
    assert abs(spectrum[500] - 0.42) < 0.03
    assert np.sort(spectrum)[-3] < 0.01  # and nothing else: no distortion
    assert np.abs(sound).max() <= 1


def test_none_is_silent(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    source = clip(tmp_path / "in.mp4", 1, sound=clips.tone(1))
    assert sound_codecs(rewrite(source, tmp_path / "out.mp4", Streams("none", source, source))) == []
    assert caplog.text == ""
