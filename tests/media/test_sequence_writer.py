"""Image sequences: names, depths, linear light, and all of it or nothing."""

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from ar_demo.errors import InputError, RunError
from ar_demo.media.sequence_writer import SequenceWriter
from ar_demo.media.srgb import to_linear

from .. import clips
from ..videos import floats_of

SIZE = 96, 64
CHART = clips.color_chart(*SIZE)


def write(path: Path, count: int = 3, picture: np.ndarray = CHART, **options: object) -> None:
    with SequenceWriter(path, *SIZE, **options) as writer:  # type: ignore[arg-type]
        for index in range(count):
            writer.write(picture, Fraction(index, 25))


@pytest.mark.parametrize("name", ["a.%05d.png", "a.#####.png", "a_%05d.tif", "%05dx.exr"])
def test_pictures_are_numbered(name: str, tmp_path: Path) -> None:
    write(tmp_path / name, first=1001)
    numbers = ["01001", "01002", "01003"]
    expected = [name.replace("%05d", number).replace("#####", number) for number in numbers]
    assert sorted(file.name for file in tmp_path.iterdir()) == expected


@pytest.mark.parametrize("suffix", ["png", "tif", "tiff"])
@pytest.mark.parametrize("depth", [8, 10, 16])
@pytest.mark.parametrize("alpha", [False, True])
def test_png_and_tiff_are_exact(suffix: str, depth: int, alpha: bool, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 65536, (64, 96, 4 if alpha else 3)).astype(np.uint16)
    if depth == 8 and not alpha:
        picture = (picture >> 8).astype(np.uint8)
    write(tmp_path / f"a.%d.{suffix}", 1, picture, depth=depth, alpha=alpha)
    found = cv2.imread(str(tmp_path / f"a.0.{suffix}"), cv2.IMREAD_UNCHANGED)
    order = cv2.COLOR_BGRA2RGBA if alpha else cv2.COLOR_BGR2RGB
    assert np.array_equal(cv2.cvtColor(found, order), picture)


def test_openexr_has_linear_light_in_rounded_halves(tmp_path: Path) -> None:
    write(tmp_path / "a.exr", 1)
    found = floats_of(tmp_path / "a.exr")
    assert np.array_equal(found, to_linear(CHART).astype(np.float16))
    assert to_linear(CHART)[0, 0] == pytest.approx([1, 0, 0])
    assert to_linear(np.array([0.5], np.float32)) == pytest.approx(0.21404, abs=1e-5)
    content = (tmp_path / "a.exr").read_bytes()
    assert content[content.index(b"compression\0compression\0") + 28] == 3  # ZIP, sixteen lines at a time


def test_a_lone_picture(tmp_path: Path) -> None:
    write(tmp_path / "a.png", 1)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "a.png")), CHART)
    with pytest.raises(InputError, match=r"a.png is one picture: name a sequence, as a.%05d.png"):
        write(tmp_path / "a.png", 2)
    assert [file.name for file in tmp_path.iterdir()] == ["a.png"]


def test_a_shorter_sequence_leaves_nothing_of_a_longer_one(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"something else")
    write(tmp_path / "a.%04d.png", 5)
    write(tmp_path / "a.%04d.png", 2)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.0000.png", "a.0001.png", "a.mp4"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_what_is_not_finished_is_removed(error: type[BaseException], tmp_path: Path) -> None:
    write(tmp_path / "a.%04d.png", 1)

    def fail() -> None:
        with SequenceWriter(tmp_path / "a.%04d.png", *SIZE) as writer:
            for index in range(3):
                writer.write(np.zeros_like(CHART), Fraction(index))
            raise error

    with pytest.raises(error):
        fail()
    assert [file.name for file in tmp_path.iterdir()] == ["a.0000.png"]
    assert np.array_equal(np.asarray(Image.open(tmp_path / "a.0000.png")), CHART)
    with pytest.raises(RunError, match="no frame"):
        write(tmp_path / "b.%04d.png", 0)
    assert [file.name for file in tmp_path.iterdir()] == ["a.0000.png"]


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"must end in one of \.png, \.exr, \.tif, \.tiff"):
        SequenceWriter(tmp_path / "a.%04d.bmp", *SIZE)
