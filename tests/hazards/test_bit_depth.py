"""More than 8 bits per sample."""

from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL import Image

from ar_demo.media.ad import open_ad
from ar_demo.media.reader import VideoReader

from .. import clips


def test_ten_bit(tmp_path: Path) -> None:
    chart = clips.color_chart(192, 144)
    clip = clips.make_clip(tmp_path / "t.mov", [chart] * 2, codec="prores_ks", pix_fmt="yuv422p10le")
    error = clips.patch_colors(next(VideoReader(clip).frames()).image) - clips.patch_colors(chart)
    assert np.abs(error).max() <= 3


def test_ten_bit_video(tmp_path: Path) -> None:
    chart = clips.color_chart(192, 144)
    path = clips.make_clip(tmp_path / "t.mov", [chart], codec="prores_ks", pix_fmt="yuv422p10le")
    image = open_ad(path).at(Fraction(0))
    assert image is not None
    assert np.abs(clips.patch_colors(image) - clips.patch_colors(chart)).max() <= 3


def test_grey_of_sixteen_bits(tmp_path: Path) -> None:
    Image.fromarray(np.full((24, 32), 0x8040, np.uint16)).save(tmp_path / "g.png")
    image = open_ad(tmp_path / "g.png").at(Fraction(0))
    assert image is not None
    assert image.shape == (24, 32, 3)
    assert (image == 0x80).all()
