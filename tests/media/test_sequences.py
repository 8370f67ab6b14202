"""Pictures as a video: by a pattern, a folder, a glob, or a single one; in any order that is clear, or refused."""

import logging
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from ar_demo.errors import InputError
from ar_demo.media.numbering import Numbering
from ar_demo.media.reader import VideoReader
from ar_demo.media.sequence_writer import SequenceWriter
from ar_demo.media.sequences import ImageSequence, parse_rate

from .. import clips
from ..videos import numbers


def save(folder: Path, names: list[str]) -> Path:
    """Pictures that say their place in the list."""
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(names):
        cv2.imwrite(str(folder / name), clips.number_image(number))
    return folder


PADDED = [f"a.{number:04d}.png" for number in range(998, 1005)]
PLAIN = [f"IMG{number}.jpg" for number in range(7, 14)]
GAPS = ["a03.png", "a04.png", "a10.png"]


@pytest.mark.parametrize(
    ("names", "called"),
    [
        (PADDED, "{}/a.%04d.png"),
        (PADDED, "{}/a.####.png"),
        (PADDED, "{}"),
        (PADDED, "{}/*.png"),
        (PADDED, "{}/a.1*.png"),
        (PLAIN, "{}/IMG%d.jpg"),
        (PLAIN, "{}"),
        (GAPS, "{}"),
        (GAPS, "{}/a*.png"),
        (["one.png", "two.png"], "{}"),
        (["b.png"], "{}"),
    ],
)
def test_pictures_come_in_their_order(names: list[str], called: str, tmp_path: Path) -> None:
    folder = save(tmp_path / "100% [a]", names)
    (folder / "notes.txt").write_text("no picture")
    sequence = ImageSequence.find(called.format(folder), Fraction(24))
    assert sequence is not None
    with VideoReader(sequence) as reader:
        frames = list(reader.frames())
        first = 2 if "a.1" in called else 0
        assert numbers(frames) == list(range(first, len(names)))
        assert [frame.time for frame in frames] == [Fraction(index, 24) for index in range(len(frames))]
        assert frames[-1].duration == Fraction(1, 24)
        assert (reader.info.frames, reader.info.rate, reader.info.has_audio) == (len(frames), 24, False)
        assert numbers(list(reader.backward(len(frames))))[::-1] == numbers(frames)
        assert reader.warnings == []


def test_a_late_picture_is_read_alone(tmp_path: Path) -> None:
    folder = save(tmp_path / "s", [f"{number:03d}.bmp" for number in range(40)])
    with VideoReader(folder) as reader:
        assert numbers(list(reader.frames(35, 37))) == [35, 36]
        assert reader.seekable
        assert reader.fingerprint(10) == VideoReader(folder / "%03d.bmp").fingerprint(10)


def test_the_rate_that_is_taken_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    with VideoReader(save(tmp_path / "s", PLAIN)) as reader:
        assert reader.info.rate == 25
    assert "7 pictures are taken at 25 frames a second; --fps says otherwise" in caplog.text


@pytest.mark.parametrize(
    ("names", "called", "said"),
    [
        (GAPS, "{}/a%02d.png", "a05.png is missing (5 of"),
        (PADDED, "{}/b.%04d.png", "there is no picture"),
        (PADDED, "{}/*.tif", "has no pictures"),
        ([], "{}", "has no pictures"),
        (["a.png", "b.jpg"], "{}", "of several kinds (.jpg, .png)"),
        (["a2.png", "a10.png", "a11.png"], "{}", "are not numbered 1, 2, 3"),
        (["a01.png", "a03.png", "b01.png"], "{}/a*.png", "are not numbered 1, 2, 3"),
        (PADDED, "{}/c.png", "does not exist"),
    ],
)
def test_what_is_not_clear_is_refused(names: list[str], called: str, said: str, tmp_path: Path) -> None:
    folder = save(tmp_path / "s", names)
    with pytest.raises(InputError) as caught:
        VideoReader(called.format(folder))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_damaged_picture_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"a\.png"):
        VideoReader(tmp_path / "a.png")


def test_a_rate_is_for_pictures_alone(tmp_path: Path) -> None:
    clip = clips.make_clip(tmp_path / "a.mp4", clips.numbered(2))
    assert ImageSequence.find(clip) is None
    with pytest.raises(InputError, match="--fps is for image sequences"):
        ImageSequence.find(clip, Fraction(24))


def test_a_lone_picture_is_upright_and_has_its_own_colours(tmp_path: Path) -> None:
    turned = Image.Exif()
    turned[0x112] = 6  # to be turned clockwise by 90 degrees
    chart = clips.color_chart(192, 144)
    Image.fromarray(chart).save(tmp_path / "a.jpg", exif=turned, quality=95, subsampling=0)
    with VideoReader(tmp_path / "a.jpg") as reader:
        [frame] = reader.frames()
        assert (reader.info.width, reader.info.height, reader.info.frames) == (144, 192, 1)
    error = clips.patch_colors(np.rot90(frame.image)) - clips.patch_colors(chart)
    assert np.abs(error).max() <= 3


@pytest.mark.parametrize("suffix", ["png", "tif", "exr"])
def test_sixteen_bits_come_back(suffix: str, tmp_path: Path) -> None:
    ramp = np.linspace(0, 65535, 96 * 64 * 3).reshape(64, 96, 3).round().astype(np.uint16)
    with SequenceWriter(tmp_path / f"a.%03d.{suffix}", 96, 64, depth=16) as writer:
        for number in range(2):
            writer.write(ramp, Fraction(number))
    with VideoReader(tmp_path / f"a.%03d.{suffix}", depth=16) as deep, VideoReader(deep.source) as narrow:
        [_, wide], [_, small] = deep.frames(), narrow.frames()
        assert deep.info.depth == 16
    halves = 20 if suffix == "exr" else 0  # of 65535
    assert np.abs(wide.image.astype(int) - ramp).max() <= halves
    assert np.abs(small.image.astype(int) - ramp / 257).max() <= 1.5


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        (24, Fraction(24)),
        ("23.976", Fraction(24000, 1001)),
        (29.97, Fraction(30000, 1001)),
        ("59.94", Fraction(60000, 1001)),
        ("30000/1001", Fraction(30000, 1001)),
        ("12.5", Fraction(25, 2)),
    ],
)
def test_rates(text: str | float, rate: Fraction) -> None:
    assert parse_rate(text) == rate


@pytest.mark.parametrize("text", ["fast", "0", "-1", "1/0", "nan", "1e9"])
def test_what_is_no_rate_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="is no frame rate"):
        parse_rate(text)


def test_a_name_has_one_place_for_a_number() -> None:
    assert Numbering.parse(Path("a.png")) is None
    assert Numbering.parse(Path("%d.%d.png")) is None
    numbering = Numbering.parse(Path("f/a.##.png"))
    assert numbering is not None
    assert [numbering.file(number) for number in (7, 123)] == [Path("f/a.07.png"), Path("f/a.123.png")]
