"""Transparency, of stills, palettes and videos."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ar_demo.media.ad import open_ad

from .. import clips


@pytest.mark.parametrize("suffix", ["png", "webp"])
def test_alpha_of_stills_is_straight(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    Image.new("RGBA", (32, 24), (200, 100, 50, 128)).save(path, lossless=True)
    image = open_ad(path).at(Fraction(0))
    assert image is not None
    assert image[0, 0].tolist() == [200, 100, 50, 128]


def test_palette_with_a_transparent_colour(tmp_path: Path) -> None:
    palette = Image.new("P", (32, 24), 1)
    palette.putpalette([0, 0, 0, 220, 30, 20])
    palette.paste(0, (0, 0, 16, 24))
    palette.save(tmp_path / "p.png", transparency=0)
    image = open_ad(tmp_path / "p.png").at(Fraction(0))
    assert image is not None
    assert image[5, 5, 3] == 0
    assert image[5, 20].tolist() == [220, 30, 20, 255]


@pytest.mark.parametrize(
    ("name", "codec", "pix_fmt", "tags"),
    [
        ("a.webm", "libvpx-vp9", "yuva420p", {"alpha_mode": "1"}),
        ("a.mov", "prores_ks", "yuva444p10le", {}),
        ("b.mov", "png", "rgba", {}),
        ("c.mov", "qtrle", "argb", {}),
    ],
)
def test_alpha_of_videos_is_kept(tmp_path: Path, name: str, codec: str, pix_fmt: str, tags: dict[str, str]) -> None:
    image = np.zeros((64, 96, 4), np.uint8)
    image[..., :3] = (200, 100, 50)
    image[:, :48, 3] = 255
    image[:, 64:, 3] = 128
    options = {"crf": "4", "b": "0"} if codec == "libvpx-vp9" else {}
    path = clips.make_clip(tmp_path / name, [image] * 5, codec=codec, pix_fmt=pix_fmt, tags=tags, options=options)
    with open_ad(path) as ad:
        for time in (Fraction(0), Fraction(4, 25), Fraction(6, 25)):
            got = ad.at(time)
            assert got is not None
            assert got.shape == (64, 96, 4)
            assert np.abs(got[32, [20, 55, 80], 3].astype(int) - [255, 0, 128]).max() <= 3
            assert np.abs(got[32, 20, :3].astype(int) - (200, 100, 50)).max() <= 4
