"""Picture and sound that begin late, or not together."""

import re
import subprocess
from fractions import Fraction
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest

from ar_demo.media.ad import open_ad
from ar_demo.media.streams import Streams

from .. import clips
from ..videos import clip, number_shown, rewrite


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
@pytest.mark.parametrize("mode", ["source", "mix"])
def test_sound_that_begins_late_stays_late(tmp_path: Path, suffix: str, mode: Any) -> None:
    source = clip(tmp_path / "in.mkv", sound=clips.clicks(1.2, [0.2]), sound_start=Fraction(4, 5))
    ad = clip(tmp_path / "ad.mp4", sound=clips.tone(2, amplitude=0.05))
    output = rewrite(source, tmp_path / f"out.{suffix}", Streams(mode, source, ad))
    assert np.allclose(clips.onsets(clips.read_sound(output)), [1.0], atol=0.005)


def test_a_file_that_does_not_begin_at_zero(tmp_path: Path) -> None:
    """MPEG transport streams begin anywhere: picture and sound move together."""
    times = [2 + Fraction(index, 25) for index in range(50)]
    source = clip(tmp_path / "in.ts", times=times, sound=clips.clicks(2, [0.5, 1.5]), sound_start=Fraction(2))
    begin = clips.frame_times(source)[0]
    assert begin > 1
    heard = np.array(clips.onsets(clips.read_sound(source))) - float(begin)
    output = rewrite(source, tmp_path / "out.mp4", Streams("source", source))
    assert clips.frame_times(output)[0] == 0
    assert np.allclose(clips.onsets(clips.read_sound(output)), heard, atol=0.005)


def test_an_ad_that_does_not_begin_at_zero(tmp_path: Path) -> None:
    times = [2 + Fraction(index, 25) for index in range(5)]
    path = clips.make_clip(tmp_path / "late.mkv", clips.numbered(5), times=times)
    with open_ad(path, "hold") as ad:
        assert ad.duration == Fraction(5, 25)
        assert [number_shown(ad, Fraction(index, 25)) for index in range(5)] == list(range(5))


def test_sound_longer_than_the_picture_does_not_delay_the_loop(tmp_path: Path) -> None:
    path = clips.make_clip(
        tmp_path / "s.webm", clips.numbered(10), codec="libvpx-vp9", sound=clips.tone(1), sound_codec="libopus"
    )
    assert open_ad(path).duration == Fraction(10, 25)


@pytest.mark.parametrize("source_suffix", ["mp4", "mkv", "ts"])
@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
@pytest.mark.parametrize("mode", ["source", "mix"])
def test_sound_that_begins_before_the_picture_is_whole_and_in_time(
    tmp_path: Path, source_suffix: str, suffix: str, mode: Any
) -> None:
    times = [Fraction(1, 2) + Fraction(index, 25) for index in range(25)]
    source = clip(tmp_path / f"in.{source_suffix}", 1, times=times, sound=clips.clicks(1.5, [0.1, 0.7]))
    ad = clip(tmp_path / "ad.mp4", 1, sound=clips.clicks(0.5, [0.4], length=0.003))
    output = rewrite(source, tmp_path / f"out.{suffix}", Streams(mode, source, ad))
    pictures = [float(time) for time in clips.frame_times(output)]
    heard = np.array(clips.onsets(clips.read_sound(output)))
    expected = np.array([0.1, 0.7] if mode == "source" else [0.1, 0.7, 0.9]) - 0.5  # of the first picture's time
    assert len(pictures) == 25
    assert np.allclose(np.diff(pictures), 0.04, atol=0.0011)
    assert np.allclose(heard - pictures[0], expected, atol=0.01)


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_a_lead_in_is_played_by_another_decoder(tmp_path: Path, suffix: str) -> None:
    """The ffmpeg program: its output begins with the sound, and the first picture comes when it should."""
    times = [Fraction(1, 2) + Fraction(index, 25) for index in range(25)]
    source = clip(tmp_path / "in.mp4", 1, times=times, sound=clips.clicks(1.5, [0.1, 0.7]))
    output = rewrite(source, tmp_path / f"out.{suffix}", Streams("source", source))
    ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    sound = subprocess.run(
        [ffmpeg, "-v", "error", "-i", output, "-f", "f32le", "-ac", "1", "-ar", "48000", "-"], capture_output=True
    ).stdout
    assert np.allclose(clips.onsets(np.frombuffer(sound, np.float32)[None]), [0.1, 0.7], atol=0.03)
    told = subprocess.run([ffmpeg, "-i", output, "-vf", "showinfo", "-f", "null", "-"], capture_output=True).stderr
    first = re.search(rb"n: *0 .*pts_time:([\d.]+)", told)
    assert first is not None
    assert abs(float(first[1]) - 0.5) < 0.03
