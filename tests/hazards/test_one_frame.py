"""Videos of one frame or two: they have a length, and every encoder can write them."""

from fractions import Fraction
from pathlib import Path

import pytest

from ar_demo.media.ad import open_ad
from ar_demo.media.reader import VideoReader
from ar_demo.media.streams import Streams

from .. import clips
from ..videos import number_shown, numbers, rewrite, write


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "webm"])
def test_it_is_written_and_read(tmp_path: Path, suffix: str, count: int) -> None:
    path = write(tmp_path / f"a.{suffix}", clips.numbered(count))
    with VideoReader(path) as reader:
        frames = list(reader.frames())
        assert numbers(frames) == list(range(count))
        assert [frame.duration for frame in frames] == [Fraction(1, 25)] * count
        assert reader.seekable
        assert reader.times == [frame.time for frame in frames]
        assert numbers(list(reader.backward(count))) == list(range(count))[::-1]
        assert reader.warnings == []


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("codec", ["libx264", "libx265", "libvpx-vp9", "libsvtav1"])
def test_every_encoder_writes_it(tmp_path: Path, codec: str, count: int) -> None:
    for turn in range(10):  # x265 leaves times unset, which goes wrong by chance
        path = write(tmp_path / f"{turn}.mp4", clips.numbered(count), codec=codec)
        assert clips.frame_times(path) == [Fraction(index, 25) for index in range(count)]


def test_with_sound(tmp_path: Path) -> None:
    source = clips.make_clip(tmp_path / "in.mp4", clips.numbered(1), sound=clips.tone(1))
    for mode in ("source", "mix"):
        output = rewrite(source, tmp_path / f"{mode}.mp4", Streams(mode, source, source))
        assert len(clips.frame_times(output)) == 1
        assert clips.read_sound(output).shape[1] / clips.SOUND_RATE < 0.1


def test_as_an_ad(tmp_path: Path) -> None:
    with open_ad(clips.make_clip(tmp_path / "ad.mp4", clips.numbered(1))) as ad:
        assert ad.duration == Fraction(1, 25)
        assert [number_shown(ad, Fraction(index, 100)) for index in range(10)] == [0] * 10
