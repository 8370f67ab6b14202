"""Frames at uneven times: each keeps its own through reading, writing, sound and ads."""

import itertools
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo.media.ad import open_ad
from ar_demo.media.reader import VideoReader
from ar_demo.media.streams import Streams
from ar_demo.media.writer import VideoWriter

from .. import clips
from ..videos import number_shown, rewrite

VARIABLE = [Fraction(n, 1000) for n in (0, 20, 53, 153, 203, 236, 256, 300, 420, 440, 473, 500, 507, 640)]


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
def test_variable_rate_times_are_exact(tmp_path: Path, suffix: str) -> None:
    clip = clips.make_clip(
        tmp_path / f"v.{suffix}", clips.numbered(len(VARIABLE)), times=VARIABLE, time_base=Fraction(1, 30000)
    )
    frames = list(VideoReader(clip).frames())
    assert [frame.time for frame in frames] == VARIABLE
    assert [frame.duration for frame in frames[:-1]] == [b - a for a, b in itertools.pairwise(VARIABLE)]


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "webm"])
@pytest.mark.parametrize("first", [Fraction(0), Fraction(7, 5)])
def test_variable_rate_is_kept_from_file_to_file(tmp_path: Path, suffix: str, first: Fraction) -> None:
    """Read, write, read: times to the millisecond, the length to less than a frame, the last frame's duration too."""
    source = clips.make_clip(
        tmp_path / "in.mp4", clips.numbered(14), times=VARIABLE, time_base=Fraction(1, 90000), options={"bf": "3"}
    )
    with VideoReader(source) as reader:
        info = reader.info
        path = tmp_path / f"out.{suffix}"
        with VideoWriter(path, 96, 64, info.rate, time_base=info.time_base) as writer:
            for frame in reader.frames():
                writer.write(frame.image, first + frame.time, frame.duration)
        frames = list(reader.frames())
    again = list(VideoReader(path).frames())
    assert [clips.number_of(frame.image) for frame in again] == list(range(14))
    for a, b in zip(frames, again, strict=True):
        assert abs(a.time - b.time) <= Fraction(1, 1000)
        assert abs(a.duration - b.duration) <= Fraction(2, 1000)
    if suffix in ("mp4", "mov"):
        assert [frame.time for frame in again] == VARIABLE
        duration = VideoReader(path).info.duration
        assert duration is not None
        assert abs(duration - VARIABLE[-1] - frames[-1].duration) < Fraction(1, 10000)


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "webm"])
def test_sound_stays_in_time_with_a_variable_rate_picture(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(0)
    times = [Fraction(0)]
    while times[-1] < 2:
        times.append(times[-1] + Fraction(int(rng.integers(15, 120)), 1000))
    bright = {min(range(len(times)), key=lambda index: abs(times[index] - at)) for at in (0.5, 1.0, 1.5)}
    images = [clips.number_image(255 if index in bright else 0) for index in range(len(times))]
    flashes = [float(times[index]) for index in sorted(bright)]
    source = clips.make_clip(tmp_path / "in.mp4", images, times=times, sound=clips.clicks(2, flashes))
    output = rewrite(source, tmp_path / f"out.{suffix}", Streams("source", source))
    frames = list(VideoReader(output).frames())
    seen = [float(frame.time) for frame in frames if clips.number_of(frame.image) == 255]
    heard = clips.onsets(clips.read_sound(output))
    assert len(seen) == len(heard) == 3
    assert np.abs(np.array(seen) - heard).max() < 0.005


def test_variable_rate(tmp_path: Path) -> None:
    times = [Fraction(n, 1000) for n in (0, 20, 120, 140, 300)]
    path = clips.make_clip(tmp_path / "v.mkv", clips.numbered(5), times=times)
    with open_ad(path, "hold") as ad:
        for milliseconds, number in [(0, 0), (19, 0), (20, 1), (119, 1), (120, 2), (140, 3), (299, 3), (300, 4)]:
            assert number_shown(ad, Fraction(milliseconds, 1000)) == number
