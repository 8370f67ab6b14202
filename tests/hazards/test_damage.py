"""Files that break off or have holes: what can be decoded is used, and nothing is counted wrongly."""

import itertools
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo.media.ad import open_ad
from ar_demo.media.reader import VideoReader
from ar_demo.media.streams import Streams

from .. import clips
from ..videos import clip, rewrite


@pytest.mark.parametrize(
    ("suffix", "codec"), [("mkv", "libx264"), ("ts", "libx264"), ("avi", "mpeg4"), ("webm", "libvpx-vp9")]
)
def test_a_truncated_file_is_read_as_far_as_it_goes(tmp_path: Path, suffix: str, codec: str) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (64, 96, 3), dtype=np.uint8) for _ in range(75)]
    clip = clips.truncated(clips.make_clip(tmp_path / f"t.{suffix}", images, codec=codec), 0.5)
    reader = VideoReader(clip)
    count = len(list(reader.frames()))
    assert 20 < count < 60
    if suffix not in ("ts", "avi"):  # whose length FFmpeg guesses from what is there
        assert len(reader.warnings) == 1
        assert "t." + suffix in reader.warnings[0]
    assert len(list(reader.backward(75))) == count


def test_damage_in_the_middle_is_skipped(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (64, 96, 3), dtype=np.uint8) for _ in range(40)]
    clip = clips.make_clip(tmp_path / "d.mp4", images, gop=4)
    data = bytearray(clip.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 20000] = bytes(20000)
    clip.write_bytes(data)
    reader = VideoReader(clip)
    frames = list(reader.frames())
    assert 20 < len(frames) <= 40
    assert any("damaged" in warning for warning in reader.warnings)
    assert all(b.time > a.time for a, b in itertools.pairwise(frames))


def test_a_truncated_ad_shows_what_it_has(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (64, 96, 3), dtype=np.uint8) for _ in range(50)]
    path = clips.truncated(clips.make_clip(tmp_path / "t.mkv", images), 0.5)
    with open_ad(path, "hold") as ad:
        assert ad.at(Fraction(2)) is not None


def test_damaged_sound_does_not_stop_the_picture(tmp_path: Path) -> None:
    source = clip(tmp_path / "in.mkv", 2, sound=clips.tone(2))
    broken = clips.truncated(clip(tmp_path / "ad.mkv", 2, sound=clips.tone(2)), 0.6)
    for mode in ("ad", "mix"):
        output = rewrite(source, tmp_path / f"{mode}.mp4", Streams(mode, source, broken))
        assert len(clips.frame_times(output)) == 50
