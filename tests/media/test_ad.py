"""Ads: any picture or clip, looked up by time, with its transparency, never read whole into memory."""

import itertools
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from ar_demo.media.ad import Ad, open_ad
from hdn.errors import InputError

from .. import clips as media

RED, GREEN, BLUE = (220, 30, 20), (10, 200, 40), (30, 20, 210)


def picture(color: tuple[int, ...], size: tuple[int, int] = (32, 24)) -> Image.Image:
    return Image.new("RGBA" if len(color) == 4 else "RGB", size, color)


def animation(path: Path, milliseconds: list[int]) -> Path:
    images = [picture(color) for color in (RED, GREEN, BLUE)]
    images[0].save(path, save_all=True, append_images=images[1:], duration=milliseconds, loop=0, **lossless(path))
    return path


def lossless(path: Path) -> dict[str, Any]:
    return {"lossless": True} if path.suffix == ".webp" else {}


def shown(ad: Ad, time: Fraction | float) -> int:
    image = ad.at(Fraction(time))
    assert image is not None
    return media.number_of(image[..., :3])


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


@pytest.mark.parametrize("suffix", ["png", "webp"])
def test_alpha_of_stills_is_straight(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    picture((200, 100, 50, 128)).save(path, **lossless(path))
    image = open_ad(path).at(Fraction(0))
    assert image is not None
    assert image[0, 0].tolist() == [200, 100, 50, 128]


def test_palette_with_a_transparent_colour(tmp_path: Path) -> None:
    palette = Image.new("P", (32, 24), 1)
    palette.putpalette([0, 0, 0, *RED])
    palette.paste(0, (0, 0, 16, 24))
    palette.save(tmp_path / "p.png", transparency=0)
    image = open_ad(tmp_path / "p.png").at(Fraction(0))
    assert image is not None
    assert image[5, 5, 3] == 0
    assert image[5, 20].tolist() == [*RED, 255]


def test_grey_of_sixteen_bits(tmp_path: Path) -> None:
    Image.fromarray(np.full((24, 32), 0x8040, np.uint16)).save(tmp_path / "g.png")
    image = open_ad(tmp_path / "g.png").at(Fraction(0))
    assert image is not None
    assert image.shape == (24, 32, 3)
    assert (image == 0x80).all()


def test_exif_orientation(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise by 90 degrees
    picture(RED).save(tmp_path / "e.jpg", exif=exif)
    ad = open_ad(tmp_path / "e.jpg")
    assert (ad.width, ad.height) == (24, 32)


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
    return media.make_clip(tmp_path / "ad.mp4", media.numbered(10), **options)


def test_looped(tmp_path: Path) -> None:
    with open_ad(clip_of_ten(tmp_path), "loop") as ad:
        assert (ad.width, ad.height, ad.duration) == (96, 64, Fraction(10, 25))
        for index in range(35):
            assert shown(ad, Fraction(index, 25)) == index % 10


def test_held(tmp_path: Path) -> None:
    with open_ad(clip_of_ten(tmp_path), "hold") as ad:
        assert [shown(ad, Fraction(index, 25)) for index in range(14)] == [*range(10), 9, 9, 9, 9]


def test_once(tmp_path: Path) -> None:
    with open_ad(clip_of_ten(tmp_path), "once") as ad:
        assert shown(ad, Fraction(999, 2500)) == 9
        assert ad.at(Fraction(10, 25)) is None
        assert ad.at(Fraction(100)) is None
        assert shown(ad, 0) == 0


def test_going_back_in_time(tmp_path: Path) -> None:
    with open_ad(clip_of_ten(tmp_path)) as ad:
        assert [shown(ad, Fraction(index, 25)) for index in (7, 2, 3, 0)] == [7, 2, 3, 0]


def test_the_same_frame_is_the_identical_array(tmp_path: Path) -> None:
    with open_ad(clip_of_ten(tmp_path)) as ad:
        images = [ad.at(Fraction(index, 100)) for index in range(40)]
    assert [a is b for a, b in itertools.pairwise(images)] == [(index + 1) % 4 != 0 for index in range(39)]


def test_variable_rate(tmp_path: Path) -> None:
    times = [Fraction(n, 1000) for n in (0, 20, 120, 140, 300)]
    path = media.make_clip(tmp_path / "v.mkv", media.numbered(5), times=times)
    with open_ad(path, "hold") as ad:
        for milliseconds, number in [(0, 0), (19, 0), (20, 1), (119, 1), (120, 2), (140, 3), (299, 3), (300, 4)]:
            assert shown(ad, Fraction(milliseconds, 1000)) == number


def test_an_ad_that_does_not_begin_at_zero(tmp_path: Path) -> None:
    times = [2 + Fraction(index, 25) for index in range(5)]
    path = media.make_clip(tmp_path / "late.mkv", media.numbered(5), times=times)
    with open_ad(path, "hold") as ad:
        assert ad.duration == Fraction(5, 25)
        assert [shown(ad, Fraction(index, 25)) for index in range(5)] == list(range(5))


def test_sound_longer_than_the_picture_does_not_delay_the_loop(tmp_path: Path) -> None:
    path = media.make_clip(
        tmp_path / "s.webm", media.numbered(10), codec="libvpx-vp9", sound=media.tone(1), sound_codec="libopus"
    )
    assert open_ad(path).duration == Fraction(10, 25)


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
    path = media.make_clip(tmp_path / name, [image] * 5, codec=codec, pix_fmt=pix_fmt, tags=tags, options=options)
    with open_ad(path) as ad:
        for time in (Fraction(0), Fraction(4, 25), Fraction(6, 25)):
            got = ad.at(time)
            assert got is not None
            assert got.shape == (64, 96, 4)
            assert np.abs(got[32, [20, 55, 80], 3].astype(int) - [255, 0, 128]).max() <= 3
            assert np.abs(got[32, 20, :3].astype(int) - (200, 100, 50)).max() <= 4


def test_ten_bit_video(tmp_path: Path) -> None:
    chart = media.color_chart(192, 144)
    path = media.make_clip(tmp_path / "t.mov", [chart], codec="prores_ks", pix_fmt="yuv422p10le")
    image = open_ad(path).at(Fraction(0))
    assert image is not None
    assert np.abs(media.patch_colors(image) - media.patch_colors(chart)).max() <= 3


def test_rotated_video(tmp_path: Path) -> None:
    ad = open_ad(media.make_clip(tmp_path / "r.mp4", media.numbered(2), rotation=90))
    assert (ad.width, ad.height) == (64, 96)


def test_a_truncated_ad_shows_what_it_has(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (64, 96, 3), dtype=np.uint8) for _ in range(50)]
    path = media.truncated(media.make_clip(tmp_path / "t.mkv", images), 0.5)
    with open_ad(path, "hold") as ad:
        assert ad.at(Fraction(2)) is not None


@pytest.mark.parametrize("kind", ["missing", "folder", "empty", "text", "sound", "cut image"])
def test_what_is_no_ad_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "x.mp4"
    if kind == "folder":
        path.mkdir()
    elif kind == "empty":
        path.touch()
    elif kind == "text":
        path.write_text("This is no ad.\n" * 50)
    elif kind == "sound":
        media.make_sound(path, media.tone(0.5))
    elif kind == "cut image":
        path = tmp_path / "x.png"
        Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 96, 3), dtype=np.uint8)).save(path)
        media.truncated(path, 0.5)
    with pytest.raises(InputError) as caught:
        open_ad(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
