"""A surface's own picture put back, and marks made by hand: on drawn clips, of which the answer is known."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo.evaluation import cli
from ar_demo.evaluation.marks import count, read_marks
from ar_demo.evaluation.own_surface import NAMES, taken
from ar_demo.evaluation.quality import gradient_deviation
from ar_demo.evaluation.tracking import write_lossless
from hdn.errors import InputError

from ..conftest import Main, Run
from ..scenes import Scene

BAR = np.array([[140, 60], [165, 60], [165, 180], [140, 180]])
FRAMES = 5
pytestmark = pytest.mark.usefixtures("shared_networks")


@pytest.fixture
def main() -> Main:
    return cli.main


@pytest.fixture(params=[True])
def folder(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """A clip of the poster, still; a plain orange bar stands before it in the last two frames, or does not."""
    scene = Scene()
    rng = np.random.default_rng(0)
    drawn = scene.draw(scene.quad, noise=0).astype(np.float64)
    frames = [(drawn + rng.normal(0, 2, drawn.shape)).clip(0, 255).astype(np.uint8) for _ in range(FRAMES)]
    for frame in frames[-2:] if request.param else []:
        cv2.fillPoly(frame, [BAR], (250, 140, 20))
    write_lossless(iter(frames), tmp_path / "poster.mkv", "poster")
    quad, marked = scene.quad.tolist(), FRAMES - 1
    corners = {"quad": quad, "corners": [quad] * FRAMES}
    (tmp_path / "poster.json").write_text(json.dumps(corners))
    surface = [[[106, 76], [130, 76], [130, 156], [106, 154]], [[175, 80], [210, 82], [210, 156], [175, 156]]]
    marks = {"frame": marked, "front": [BAR.tolist()], "surface": surface}
    (tmp_path / "marks.json").write_text(json.dumps([{"clip": "poster.mkv", "quad": quad, "frames": [marks]}]))
    return tmp_path


def test_what_is_in_front_is_counted(folder: Path) -> None:
    [clip] = read_marks(folder / "marks.json")
    [found] = count(clip, folder, None, folder / "sheet.png")
    assert found.frame == FRAMES - 1
    assert found.front == pytest.approx(26 * 92, rel=0.05)  # of the bar, as far as it lies on the poster
    assert found.kept > 0.8 * found.front
    assert found.replaced == found.surface > 4000
    assert (cv2.imread(str(folder / "sheet.png")) == [0, 0, 255]).all(2).any()  # the bar's outline, red


@pytest.mark.parametrize("folder", [False], indirect=True)
def test_a_surface_s_own_picture_gives_the_clip_again(folder: Path, run: Run) -> None:
    status, out, err = run(folder, "--self", "--out", folder / "out")
    assert (status, err) == (0, "")
    [row] = [line.split(" | ") for line in out.splitlines() if line.startswith("| poster")]
    figures = dict(zip(NAMES, (float(cell.strip("| ")) for cell in row[1:]), strict=True))
    assert figures["PSNR inside"] > 28
    assert figures["SSIM inside"] > 0.95
    assert figures["gradient deviation"] < 0.1
    assert 0 < figures["temporal noise"] < 1.2
    assert (folder / "out" / "own.md").read_text(encoding="utf-8") in out
    assert (folder / "out" / "poster-worst.png").exists()


def test_marks_make_a_table(folder: Path, run: Run) -> None:
    status, out, err = run(folder, "--marks", folder / "marks.json", "--out", folder / "out")
    assert (status, err) == (0, "")
    assert "| all | 1 | 0." in out
    assert out.count("| poster |") == 2


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read"),
        ("[]", "its list is empty"),
        ("[{}]", "has no marks"),
        ('[{"clip": "a", "quad": [], "frames": 3}]', "has no marks"),
    ],
)
def test_marks_that_are_none(content: str | None, message: str, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / "marks.json").write_text(content)
    with pytest.raises(InputError, match=message):
        read_marks(tmp_path / "marks.json")


def test_no_marked_clip_has_such_a_name(folder: Path, run: Run) -> None:
    status, out, err = run(folder, "--marks", folder / "marks.json", "--only", "x*", "--out", folder / "out")
    assert (status, out) == (2, "")
    assert "no sequence is called like 'x*'" in err


def test_the_marks_of_the_project_are_whole() -> None:
    clips = read_marks(Path(__file__).parents[1] / "data" / "marks.json")
    assert sum(len(clip.frames) for clip in clips) == 24
    assert all(frame.surface for clip in clips for frame in clip.frames)


def test_the_picture_that_is_taken_is_the_surface() -> None:
    frame = np.zeros((60, 80, 3), np.uint8)
    frame[10:30, 20:60] = 200
    picture = taken(frame, np.array([[19.5, 9.5], [59.5, 9.5], [59.5, 29.5], [19.5, 29.5]]))
    assert picture.shape == (40, 80, 3)
    assert (picture[6:-6, 6:-6] == 200).all()


def test_gradient_deviation_sees_blur() -> None:
    scene = Scene()
    frame, quad = scene.draw(scene.quad), scene.quad
    blurred = np.asarray(cv2.GaussianBlur(frame, (0, 0), 2), np.uint8)
    assert gradient_deviation(frame, frame, quad) == pytest.approx(0)
    assert gradient_deviation(blurred, frame, quad) > 0.1
