"""Pixels that are not square."""

from fractions import Fraction
from pathlib import Path

from ar_demo.media.reader import VideoReader

from .. import clips
from ..videos import write


def test_pixel_aspect(tmp_path: Path) -> None:
    clip = clips.make_clip(tmp_path / "a.mp4", clips.numbered(2), pixel_aspect=Fraction(4, 3), rotation=90)
    assert VideoReader(clip).info.pixel_aspect == Fraction(3, 4)


def test_pixel_aspect_is_kept(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", clips.numbered(2), pixel_aspect=Fraction(4, 3))
    assert VideoReader(path).info.pixel_aspect == Fraction(4, 3)
