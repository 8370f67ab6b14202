"""Ads: any picture or clip, looked up by time, with its transparency, never read whole into memory."""

import itertools
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from ar_demo.media.ad import open_ad
from hdn.errors import InputError

from .. import clips
from ..videos import number_shown

RED, GREEN, BLUE = (220, 30, 20), (10, 200, 40), (30, 20, 210)


def picture(color: tuple[int, ...], size: tuple[int, int] = (32, 24)) -> Image.Image:
    return Image.new("RGBA" if len(color) == 4 else "RGB", size, color)


def animation(path: Path, milliseconds: list[int]) -> Path:
    images = [picture(color) for color in (RED, GREEN, BLUE)]
    images[0].save(path, save_all=True, append_images=images[1:], duration=milliseconds, loop=0, **lossless(path))
    return path


def lossless(path: Path) -> dict[str, Any]:
    return {"lossless": True} if path.suffix == ".webp" else {}


@pytest.mark.parametrize("suffix", ["png", "jpg", "webp", "bmp", "tif", "gif", "ppm"])
def test_stills(tmp_path: Path, suffix: str) -> None:
    picture(RED).save(tmp_path / f"a.{suffix}")
    with open_ad(tmp_path / f"a.{suffix}") as ad:
        assert (ad.width, ad.height, ad.duration) == (32, 24, None)
        image = ad.at(Fraction(0))
        assert image is not None
        assert image.dtype == np.uint8
        assert image.shape == (24, 32, 3)
        assert np.abs(image.astype(int) - RED).max() <= 3
        assert ad.at(Fraction(1000)) is image
        assert ad.at(Fraction(3)) is image


@pytest.mark.parametrize("playback", ["loop", "hold", "once"])
def test_a_still_never_ends(tmp_path: Path, playback: Any) -> None:
    picture(RED).save(tmp_path / "a.png")
    assert open_ad(tmp_path / "a.png", playback).at(Fraction(10**6)) is not None


def test_print_colours(tmp_path: Path) -> None:
    Image.new("CMYK", (32, 24), (0, 200, 200, 0)).save(tmp_path / "c.jpg", quality=100)
    image = open_ad(tmp_path / "c.jpg").at(Fraction(0))
    assert image is not None
    assert image.shape == (24, 32, 3)
    assert np.abs(image.astype(int) - (255, 55, 55)).max() <= 3


def test_an_image_too_large_to_be_meant_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picture(RED).save(tmp_path / "a.png")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    with pytest.raises(InputError, match=r"a\.png"):
        open_ad(tmp_path / "a.png")


@pytest.mark.parametrize("suffix", ["gif", "webp", "png"])
def test_animated_images_keep_their_durations(tmp_path: Path, suffix: str) -> None:
    with open_ad(animation(tmp_path / f"a.{suffix}", [100, 300, 200])) as ad:
        assert ad.duration == Fraction(6, 10)
        for milliseconds, color in [
            (0, RED),
            (99, RED),
            (100, GREEN),
            (399, GREEN),
            (400, BLUE),
            (599, BLUE),
            (600, RED),
        ]:
            image = ad.at(Fraction(milliseconds, 1000))
            assert image is not None
            assert np.abs(image[0, 0, :3].astype(int) - color).max() <= 2, milliseconds


def test_animated_frames_without_a_duration_last_a_tenth_of_a_second(tmp_path: Path) -> None:
    assert open_ad(animation(tmp_path / "a.gif", [0, 0, 0])).duration == Fraction(3, 10)


def clip_of_ten(tmp_path: Path, **options: Any) -> Path:
    return clips.make_clip(tmp_path / "ad.mp4", clips.numbered(10), **options)


def test_looped(tmp_path: Path) -> None:
    with open_ad(clip_of_ten(tmp_path), "loop") as ad:
        assert (ad.width, ad.height, ad.duration) == (96, 64, Fraction(10, 25))
        for index in range(35):
            assert number_shown(ad, Fraction(index, 25)) == index % 10


def test_held(tmp_path: Path) -> None:
    with open_ad(clip_of_ten(tmp_path), "hold") as ad:
        assert [number_shown(ad, Fraction(index, 25)) for index in range(14)] == [*range(10), 9, 9, 9, 9]


def test_once(tmp_path: Path) -> None:
    with open_ad(clip_of_ten(tmp_path), "once") as ad:
        assert number_shown(ad, Fraction(999, 2500)) == 9
        assert ad.at(Fraction(10, 25)) is None
        assert ad.at(Fraction(100)) is None
        assert number_shown(ad, 0) == 0


def test_going_back_in_time(tmp_path: Path) -> None:
    with open_ad(clip_of_ten(tmp_path)) as ad:
        assert [number_shown(ad, Fraction(index, 25)) for index in (7, 2, 3, 0)] == [7, 2, 3, 0]


def test_the_same_frame_is_the_identical_array(tmp_path: Path) -> None:
    with open_ad(clip_of_ten(tmp_path)) as ad:
        images = [ad.at(Fraction(index, 100)) for index in range(40)]
    assert [a is b for a, b in itertools.pairwise(images)] == [(index + 1) % 4 != 0 for index in range(39)]
