"""The readers on tiny folders of the layouts that the data sets are published in."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from hdn.benchmark.datasets import POT_ATTRIBUTES, open_dataset
from hdn.errors import InputError
from hdn.imaging.arrays import Array

from ..clips import make_clip

FRAMES = 6
WIDTH, HEIGHT = 96, 64
TRUTH = np.array([[20.0, 10], [70, 12], [68, 50], [22, 48]]) + np.arange(FRAMES)[:, None, None] * (1.5, 0.5)


def picture(index: int) -> np.ndarray:
    """A plain frame whose red level tells its index, and whose blue is none."""
    return np.full((HEIGHT, WIDTH, 3), (20 + 30 * index, 60, 0), np.uint8)


def images(folder: Path, pattern: str = "{:04d}.png") -> None:
    folder.mkdir(parents=True)
    for index in range(FRAMES):
        cv2.imwrite(str(folder / pattern.format(index + 1)), picture(index)[..., ::-1])


def text(path: Path, *lines: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")


def row(corners: Array) -> str:
    return " ".join(f"{v:.6f}" for v in corners.ravel())


def indices(frames: list[np.ndarray]) -> list[int]:
    """Which frames they are; also shows that they came as RGB."""
    assert all(f.shape == (HEIGHT, WIDTH, 3) and f[..., 2].max() < 25 for f in frames)
    return [round((float(f[..., 0].mean()) - 20) / 30) for f in frames]


def pot(root: Path, name: str, annotation: str = "annotation") -> None:
    """POT: every second frame annotated, the last but one occluded."""
    rows = [row(TRUTH[i]) if i == 0 or i % 2 else "0 0 0 0 0 0 0 0" for i in range(FRAMES)]
    text(root / annotation / f"{name}_gt_points.txt", *rows)
    text(root / annotation / f"{name}_flag.txt", *("1" if i == 3 else "0" for i in range(FRAMES)))
    text(root / annotation / f"{name}_gt_homography.txt", *(["1 0 0 0 1 0 0 0 1"] * FRAMES))


@pytest.mark.parametrize("annotation", ["annotation", "annotation/annotation"])
def test_pot_videos(tmp_path: Path, annotation: str) -> None:
    pot(tmp_path, "V01_4", annotation)
    (tmp_path / "V01").mkdir()
    make_clip(tmp_path / "V01" / "V01_4.avi", [picture(i) for i in range(FRAMES)], rate=30)
    (sequence,) = open_dataset(str(tmp_path))
    assert (sequence.dataset, sequence.name, sequence.attributes) == ("POT-280", "V01_4", ("motion blur",))
    assert np.array_equal(sequence.quad, TRUTH[0])
    known = np.flatnonzero(np.isfinite(sequence.truth).all((1, 2)))
    assert known.tolist() == [0, 1, 5]  # not annotated: 2 and 4; flagged: 3
    assert np.allclose(sequence.truth[known], TRUTH[known])
    assert len(list(sequence.frames())) == FRAMES


def test_pot_blank_rows_may_be_not_a_number(tmp_path: Path) -> None:
    pot(tmp_path, "V02_1")
    file = tmp_path / "annotation" / "V02_1_gt_points.txt"
    file.write_text(file.read_text().replace("0 0 0 0 0 0 0 0", "NaN NaN NaN NaN NaN NaN NaN NaN"))
    images(tmp_path / "V02" / "V02_1")
    (sequence,) = open_dataset(str(tmp_path))
    assert np.isfinite(sequence.truth).all((1, 2)).tolist() == [True, True, False, False, False, True]


def test_pot_210_is_a_part_of_280(tmp_path: Path) -> None:
    for name in ("V30_7", "V31_1"):
        pot(tmp_path, name)
        images(tmp_path / name[:3] / name)
    assert [s.name for s in open_dataset(f"pot210:{tmp_path}")] == ["V30_7"]
    both = open_dataset(f"pot280:{tmp_path}")
    assert [s.name for s in both] == ["V30_7", "V31_1"]
    assert [s.attributes for s in both] == [(POT_ATTRIBUTES[6],), (POT_ATTRIBUTES[0],)]


def test_what_was_not_downloaded_is_passed_over_and_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    pot(tmp_path, "V01_1")
    pot(tmp_path, "V02_1")
    with pytest.raises(InputError, match="no frames for any"):
        open_dataset(str(tmp_path))
    images(tmp_path / "V02" / "V02_1")
    caplog.clear()
    assert [s.name for s in open_dataset(str(tmp_path))] == ["V02_1"]
    assert "no frames for 1 of 2" in caplog.text


@pytest.mark.parametrize(
    ("annotations", "split"), [("annotation", "test_split"), ("annos", "training-test-splits"), ("annos", None)]
)
def test_planartrack(tmp_path: Path, annotations: str, split: str | None) -> None:
    for name in ("Seq_00001", "Seq_00002"):
        images(tmp_path / "sequences" / name)
        blank = "0.000000 " * 8
        text(tmp_path / annotations / f"{name}.txt", *(blank if i == 2 else row(TRUTH[i]) for i in range(FRAMES)))
        text(tmp_path / annotations / f"{name}_flag.txt", *("3" if i == 4 else "0" for i in range(FRAMES)))
        text(tmp_path / annotations / f"{name}_homography.txt", *(["1 0 0 0 1 0 0 0 1"] * FRAMES))
    factors = tmp_path / ("annotation" if annotations == "annotation" else "") / "challenging_factor"
    text(factors / "Seq_00002_challenging_factor.txt", "0,1,0,0,0,1,0,0")
    if split:
        text(tmp_path / split / "test_seq.txt", "Seq_00002")
    sequences = open_dataset(str(tmp_path))
    assert [s.name for s in sequences] == (["Seq_00002"] if split else ["Seq_00001", "Seq_00002"])
    assert sequences[-1].attributes == ("motion blur", "out of view")
    assert np.isfinite(sequences[-1].truth).all((1, 2)).tolist() == [True, True, False, True, False, True]
    assert indices(list(sequences[-1].frames())) == list(range(FRAMES))


HEADING = "frame   ulx     uly     urx     ury     lrx     lry     llx     lly     "


def test_poic(tmp_path: Path) -> None:
    images(tmp_path / "sequences" / "dl_bus", "frame{:05d}.jpg")
    rows = [f"frame{i + 1:05d}.jpg\t" + row(TRUTH[i]).replace(" ", "\t") for i in range(FRAMES)]
    text(tmp_path / "gt" / "dl_bus.txt", HEADING, *rows)
    (sequence,) = open_dataset(str(tmp_path))
    assert (sequence.dataset, sequence.name, sequence.attributes) == ("POIC", "dl_bus", ())
    assert np.allclose(sequence.truth, TRUTH)
    assert indices(list(sequence.frames())) == list(range(FRAMES))


def test_ucsb(tmp_path: Path) -> None:
    images(tmp_path / "bricks_motion4", "frame{:d}.png")
    rows = [f"frame{i + 1:05d}.jpg\t" + row(TRUTH[i]).replace(" ", "\t") for i in range(FRAMES)]
    text(tmp_path / "bricks_motion4.txt", HEADING, *rows)
    text(tmp_path / "readme.txt", "Planar textures.")
    (sequence,) = open_dataset(str(tmp_path))
    assert (sequence.dataset, sequence.name, sequence.attributes) == ("UCSB", "bricks_motion4", ("motion",))
    assert np.allclose(sequence.truth, TRUTH)
    assert indices(list(sequence.frames())) == list(range(FRAMES))


def clip(folder: Path, **more: object) -> Path:
    """A clip with corners, unknown in frame 3."""
    make_clip(folder / "poster.mp4", [picture(i) for i in range(FRAMES)], rate=30)
    corners = [None if i == 3 else TRUTH[i].tolist() for i in range(FRAMES)]
    (folder / "poster.json").write_text(json.dumps({"corners": corners, **more}))
    return folder


def test_clips_with_corners(tmp_path: Path) -> None:
    clip(tmp_path, quad=(TRUTH[0] + 0.25).tolist(), attributes=["glossy"])
    (tmp_path / "notes.json").write_text('{"title": "something else"}')
    (sequence,) = open_dataset(str(tmp_path))
    assert (sequence.dataset, sequence.name, sequence.attributes) == (tmp_path.name, "poster", ("glossy",))
    assert np.array_equal(sequence.quad, TRUTH[0] + 0.25)
    assert np.flatnonzero(np.isnan(sequence.truth).any((1, 2))).tolist() == [3]
    assert len(list(sequence.frames())) == FRAMES


@pytest.mark.parametrize("names", [("img1.png", "img3.png", "H1to3p"), ("1.ppm", "3.ppm", "H_1_3")])
def test_image_pairs(tmp_path: Path, names: tuple[str, str, str]) -> None:
    scene = tmp_path / "graf"
    scene.mkdir()
    for name in names[:2]:
        cv2.imwrite(str(scene / name), np.zeros((41, 81, 3), np.uint8))
    text(scene / names[2], "1 0 7", "0 1 -2", "0 0 1")
    for folder in (tmp_path, scene):  # the data set, or one scene of it
        (sequence,) = open_dataset(str(folder))
        assert sequence.name == "graf_1_3"
        assert sequence.quad.tolist() == [[20, 10], [60, 10], [60, 30], [20, 30]]
        assert np.allclose(sequence.truth[1], sequence.quad + np.array([7, -2]))
        assert len(list(sequence.frames())) == 2


def _no_folder(root: Path) -> str:
    return f"{root / 'nowhere'}"


def _unknown_layout(root: Path) -> str:
    return str(root)


def _short_row(root: Path) -> str:
    pot(root, "V01_1")
    text(root / "annotation" / "V01_1_gt_points.txt", "1 2 3 4 5 6 7 8", "1 2 3")
    return str(root)


def _words(root: Path) -> str:
    pot(root, "V01_1")
    text(root / "annotation" / "V01_1_gt_points.txt", "a b c d e f g h")
    return str(root)


def _flags_missing(root: Path) -> str:
    pot(root, "V01_1")
    (root / "annotation" / "V01_1_flag.txt").unlink()
    return str(root)


def _too_few_flags(root: Path) -> str:
    pot(root, "V01_1")
    text(root / "annotation" / "V01_1_flag.txt", "0")
    return str(root)


def _blank_start(root: Path) -> str:
    pot(root, "V01_1")
    text(root / "annotation" / "V01_1_gt_points.txt", *(["0 0 0 0 0 0 0 0"] * FRAMES))
    return str(root)


def _bad_json(root: Path) -> str:
    (root / "a.json").write_text("{")
    return str(root)


def _three_corners(root: Path) -> str:
    (root / "a.json").write_text('{"corners": [[[0, 0], [1, 0], [1, 1]]]}')
    return str(root)


def _lonely_homography(root: Path) -> str:
    text(root / "H1to2p", "1 0 0", "0 1 0", "0 0 1")
    return str(root)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (_no_folder, "not a folder"),
        (_unknown_layout, "no data set known"),
        (_short_row, "line 2: 8 numbers"),
        (_words, "line 1: 8 numbers"),
        (_flags_missing, "V01_1_flag.txt is missing"),
        (_too_few_flags, "1 flags for 6 frames"),
        (_blank_start, "no corners to start from"),
        (_bad_json, "not valid JSON"),
        (_three_corners, r"four \[x, y\]"),
        (_lonely_homography, "no images img1 and img2"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path: Path, make: Callable[[Path], str], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        open_dataset(make(tmp_path))
    assert "\n" not in str(caught.value)


def test_damaged_frames(tmp_path: Path) -> None:
    (sequence,) = open_dataset(str(clip(tmp_path)))
    (tmp_path / "poster.mp4").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"poster\.mp4 cannot be opened"):
        next(sequence.frames())


def test_limit_and_every_fourth_frame(tmp_path: Path) -> None:
    images(tmp_path / "V01" / "V01_1")
    pot(tmp_path, "V01_1")
    (sequence,) = open_dataset(str(tmp_path))
    assert indices(list(sequence.limited(2).frames())) == [0, 1]
    skipping = sequence.degraded("skip")
    assert indices(list(skipping.frames())) == [0, 4]
    assert len(skipping.truth) == 2
    assert skipping.dataset == "POT-280+skip"
    with pytest.raises(InputError, match="rain"):
        sequence.degraded("rain")
