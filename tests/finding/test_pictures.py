"""Reading of what is looked for."""

from pathlib import Path

import numpy as np
import pytest

from ar_demo.errors import InputError
from ar_demo.finding.pictures import read_pictures

from ..scenes import texture
from .conftest import written


def test_a_folder_gives_its_pictures_in_the_order_of_their_names(tmp_path: Path) -> None:
    for seed, name in enumerate(("b.png", "a.jpg")):
        written(tmp_path / name, texture(seed, 200, 150))
    (tmp_path / "notes.txt").write_text("no picture")
    assert [picture.name for picture in read_pictures([tmp_path])] == ["a.jpg", "b.png"]
    assert len(read_pictures([tmp_path, tmp_path / "b.png"])) == 2  # each once


def test_the_corners_are_those_of_the_whole_picture(tmp_path: Path) -> None:
    [picture] = read_pictures([written(tmp_path / "large.png", texture(1, 1600, 1200))])
    assert picture.image.shape == (480, 640, 3)
    np.testing.assert_allclose(picture.quad[[0, 2]], [[-0.5, -0.5], [639.5, 479.5]])


def test_what_is_transparent_is_no_part_of_it(tmp_path: Path) -> None:
    logo = np.dstack([texture(2, 300, 200), np.full((200, 300), 255, np.uint8)])
    logo[:, :150, 3] = 0
    [picture] = read_pictures([written(tmp_path / "logo.png", logo)])
    assert picture.opaque is not None
    assert picture.points[:, 0].min() > 140
    assert (picture.image[:, :140] == 128).all()


@pytest.mark.parametrize(
    ("picture", "reason"),
    [
        (np.full((100, 100, 3), 200, np.uint8), "shows too little"),
        (np.full((8, 300, 3), 200, np.uint8), "too narrow"),
    ],
)
def test_what_cannot_be_told_is_refused(tmp_path: Path, picture: np.ndarray, reason: str) -> None:
    with pytest.raises(InputError, match=f"plain.png .*{reason}"):
        read_pictures([written(tmp_path / "plain.png", picture)])


def test_files_that_are_no_pictures_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "empty").mkdir()
    for name, reason in (("text.png", "is no picture"), ("empty", "has no pictures"), ("none.png", "does not exist")):
        with pytest.raises(InputError, match=f"{name} {reason}"):
            read_pictures([tmp_path / name])
