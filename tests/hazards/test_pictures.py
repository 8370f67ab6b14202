"""Pictures in place of a video: a sequence from input to output, and a single one."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo import ImageSequence, OutputOptions, Session, Surface, replace
from ar_demo.cli import entry
from ar_demo.errors import InputError
from ar_demo.pipeline import beside, default_output
from ar_demo.tracks import Track

from ..conftest import Run
from ..scenes import Scene, error, path
from ..test_session import Still

pytestmark = pytest.mark.usefixtures("shared_networks")

TRUTH = path(Scene().quad, 6)
QUAD = ["--quad", *(f"{x},{y}" for x, y in TRUTH[0])]


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of pictures, shot.1001.png and so on."""
    folder = tmp_path_factory.mktemp("pictures") / "shot"
    folder.mkdir()
    for number, corners in enumerate(TRUTH, 1001):
        cv2.imwrite(str(folder / f"shot.{number}.png"), cv2.cvtColor(Scene().draw(corners), cv2.COLOR_RGB2BGR))
    return folder


@pytest.fixture
def ad(tmp_path: Path) -> Path:
    cv2.imwrite(str(tmp_path / "ad.png"), np.full((60, 80, 3), (0, 0, 255), np.uint8))
    return tmp_path / "ad.png"


def redness(file: Path, corners: np.ndarray) -> float:
    x, y = corners.mean(0).round().astype(int)
    blue, green, red = cv2.imread(str(file))[y, x].astype(float)
    return float(red - max(green, blue))


def test_a_sequence_makes_a_sequence(run: Run, shot: Path, ad: Path, tmp_path: Path) -> None:
    track = tmp_path / "t.json"
    called = shot / "shot.####.png"
    code, _, err = run(called, *QUAD, "--fps", "23.976", "-o", track, main=entry.track_main)
    assert code == 0, err
    found = Track.load(track)
    assert max(error(c, t) for c, t in zip(found.corners, TRUTH, strict=True)) < 1
    assert float(found.times[1]) == pytest.approx(1001 / 24000, abs=1e-4)
    out = tmp_path / "o.%03d.png"
    flags = ["--track", track, "--fps", "23.976", "-o", out, "--backend", "opencv", "--flat"]
    code, _, err = run(shot, ad, *flags)  # the same pictures by another name
    assert code == 0, err
    assert "at 25 frames" not in err
    for number, corners in enumerate(TRUTH, 1001):
        made, source = (cv2.imread(str(f)) for f in (tmp_path / f"o.{number:03d}.png", shot / f"shot.{number}.png"))
        assert redness(tmp_path / f"o.{number:03d}.png", corners) > 200
        assert np.array_equal(made[:40], source[:40])  # the wall, as it was
    code, _, err = run(shot, ad, "--track", track, "-o", tmp_path / "p.%03d.png")
    assert code == 2  # at 25 frames a second
    assert "comes at" in err


def test_a_lone_picture(run: Run, shot: Path, ad: Path, tmp_path: Path) -> None:
    photo = tmp_path / "photo.jpg"
    cv2.imwrite(str(photo), cv2.imread(str(shot / "shot.1001.png")), [cv2.IMWRITE_JPEG_QUALITY, 95])
    code, _, err = run(photo, ad, *QUAD, "--backend", "opencv")
    assert code == 0, err
    assert redness(tmp_path / "photo.ar.png", TRUTH[0]) > 150


@pytest.mark.parametrize("called", ["shot", "shot/shot.%d.png", "shot/*.png"])
@pytest.mark.parametrize("output", ["shot.%d.png", "shot.####.png"])
def test_pictures_that_are_read_are_not_written_to(shot: Path, ad: Path, called: str, output: str) -> None:
    before = {file: file.read_bytes() for file in shot.iterdir()}
    with pytest.raises(InputError, match="is an input as well"):
        replace(shot.parent / called, Surface(ad, TRUTH[0]), shot / output)
    assert {file: file.read_bytes() for file in shot.iterdir()} == before


def test_one_name_is_not_for_several_frames(shot: Path, ad: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"o\.png is one picture, and the video has several"):
        replace(ImageSequence.find(shot) or shot, Surface(ad, TRUTH[0]), tmp_path / "o.png")
    assert list(tmp_path.iterdir()) == [ad]


def test_names_beside_pictures(shot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = shot.parent
    assert default_output(shot) == folder / "shot.ar.mp4"
    assert default_output(shot / "shot.%04d.png") == shot / "shot.ar.mp4"
    assert default_output(shot / "%04d.png") == default_output(shot / "*.png") == folder / "shot.ar.mp4"
    assert default_output(Path("a.mov")) == Path("a.ar.mov")
    monkeypatch.chdir(shot)
    assert beside(Path("."), ".track.json") == beside(Path("*.png"), ".track.json") == folder / "shot.track.json"


def test_pictures_that_cannot_be_read_leave_a_gap(shot: Path, tmp_path: Path) -> None:
    folder = tmp_path / "shot"
    shutil.copytree(shot, folder)
    (folder / "shot.1001.png").write_bytes(b"no picture")
    (folder / "shot.1004.png").write_bytes((shot / "shot.1004.png").read_bytes()[:200])
    with Session(folder, make_tracker=Still) as session:
        surfaces = session.track([Surface(effect="mosaic", quad=TRUTH[0])])
        result = session.render(surfaces, tmp_path / "o.####.png", OutputOptions(backend="opencv"))
    numbers = [1002, 1003, 1005, 1006]
    assert sorted(tmp_path.glob("o.*")) == [tmp_path / f"o.{number}.png" for number in numbers]
    assert any("is damaged" in warning for warning in result.warnings)
    for number in numbers:
        made, source = (cv2.imread(str(file)) for file in (tmp_path / f"o.{number}.png", shot / f"shot.{number}.png"))
        assert np.array_equal(made[:40], source[:40])
