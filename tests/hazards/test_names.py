"""File names with spaces, signs and letters of all scripts."""

import os
from fractions import Fraction
from pathlib import Path

import pytest
from PIL import Image

from ar_demo.errors import InputError
from ar_demo.media.ad import open_ad
from ar_demo.media.reader import VideoReader
from ar_demo.media.streams import Streams

from .. import clips
from ..videos import numbers, rewrite

NAMES = ["Übergröße – Straße", "広告 動画", "реклама", "🎬 take 2", "50% off #1 (final)", "a:b'c", "%04d", "-o"]


@pytest.mark.parametrize("name", NAMES)
def test_videos_are_read_and_written(tmp_path: Path, name: str) -> None:
    folder = tmp_path / name
    folder.mkdir()
    source = clips.make_clip(folder / "in.mp4", clips.numbered(20), sound=clips.tone(0.8)).rename(
        folder / f"{name}.mp4"
    )
    output = rewrite(source, folder / f"{name} out.mp4", Streams("source", source))
    with VideoReader(output) as reader:
        assert numbers(reader.frames()) == list(range(20))
        assert reader.seekable
    assert sorted(os.listdir(folder)) == sorted([source.name, output.name])


@pytest.mark.parametrize("name", NAMES)
def test_ads_are_opened(tmp_path: Path, name: str) -> None:
    clips.make_clip(tmp_path / "ad.mp4", clips.numbered(3)).rename(tmp_path / f"{name}.mp4")
    Image.new("RGB", (32, 24), (220, 30, 20)).save(tmp_path / f"{name}.png")
    for suffix in ("mp4", "png"):
        with open_ad(tmp_path / f"{name}.{suffix}") as ad:
            assert ad.at(Fraction(0)) is not None


@pytest.mark.parametrize("name", NAMES)
def test_errors_say_the_name(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError) as caught:
        VideoReader(tmp_path / name)
    assert name in str(caught.value)
