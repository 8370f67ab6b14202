"""Mattes that are given: what was saved gives the same picture again; others hide what they say, at any size."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from ar_demo import OutputOptions, Session, Surface
from ar_demo.cli.jobs import load_job
from ar_demo.errors import InputError
from ar_demo.media.reader import VideoReader
from hdn.imaging.arrays import Image

from ..clips import make_clip
from ..conftest import Run
from ..scenes import Scene, texture
from ..test_session import Still

SCENE, FRAMES = Scene(), 3
LOSSLESS: dict[str, Any] = {"backend": "opencv", "codec": "animation"}
HAND = (200, 150, 120)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Has src.mov, lossless, in which a soft disc comes before the poster, disc.png, which says where, and ad.png."""
    folder = tmp_path_factory.mktemp("mattes")
    disc = np.zeros((SCENE.height, SCENE.width), np.float32)
    cv2.circle(disc, (150, 120), 26, 1, -1)
    disc = cv2.GaussianBlur(disc, (0, 0), 1.5)
    plain = SCENE.draw(SCENE.quad)
    mixed = (plain * (1 - disc[..., None]) + np.array(HAND) * disc[..., None]).round().astype(np.uint8)
    make_clip(folder / "src.mov", [plain, mixed, mixed], codec="qtrle", pix_fmt="rgb24")
    cv2.imwrite(str(folder / "disc.png"), np.round(255 * (1 - disc)).astype(np.uint8))
    cv2.imwrite(str(folder / "wide.png"), np.zeros((90, 240), np.uint8))
    cv2.imwrite(str(folder / "ad.png"), texture(2, 160, 120))
    return folder


def render(
    folder: Path, output: Path, matte: Path | None = None, saved: Path | None = None, **look: Any
) -> list[Image]:
    surface = Surface(folder / "ad.png", SCENE.quad, matte=matte, **look)
    with Session(folder / "src.mov", make_tracker=Still) as session:
        session.render(session.track([surface]), output, OutputOptions(**LOSSLESS, overwrite=True), matte=saved)
    with VideoReader(output) as reader:
        return [frame.image for frame in reader.frames()]


@pytest.mark.parametrize("opacity", [1.0, 0.7])
def test_a_saved_matte_gives_the_same_picture_again(folder: Path, tmp_path: Path, opacity: float) -> None:
    look = {"opacity": opacity, "grain": "off"}
    told = render(folder, tmp_path / "a.mov", saved=tmp_path / "a.%d.png", **look)
    given = render(folder, tmp_path / "b.mov", tmp_path / "a.%d.png", tmp_path / "b.%d.png", **look)
    for index in range(FRAMES):
        first, again = (cv2.imread(str(tmp_path / f"{name}.{index}.png"), cv2.IMREAD_UNCHANGED) for name in "ab")
        # What is unmixed at a soft edge needs an alpha of its own here and there.
        assert (np.abs(first.astype(int) - again) > 300).mean() < 0.004  # of 65535: it is read in 8 bits
        assert np.abs(told[index].astype(int) - given[index]).mean() < 0.2
    assert first[120, 150].max() < 600


def test_the_ad_stays_behind_what_a_matte_says_and_nothing_of_the_print_shines_through(
    folder: Path, tmp_path: Path
) -> None:
    frames = render(folder, tmp_path / "o.mov", folder / "disc.png", softness="off", first_light="even", grain="off")
    bare = render(folder, tmp_path / "f.mov", flat=True)
    share = 1 - cv2.imread(str(folder / "disc.png"))[..., :1] / 255.0
    box = np.s_[80:160, 110:190]
    expected = bare[1][box] * (1 - share[box]) + np.array(HAND) * share[box]
    assert np.abs(frames[1][box] - expected).mean() < 2.5
    assert np.abs(frames[2][120, 150] - np.array(HAND)).max() <= 1


def test_a_matte_of_another_size_is_scaled(folder: Path, tmp_path: Path) -> None:
    matte = cv2.imread(str(folder / "disc.png"))
    cv2.imwrite(str(tmp_path / "double.png"), cv2.resize(matte, None, fx=2, fy=2))
    one = render(folder, tmp_path / "a.mov", folder / "disc.png")
    other = render(folder, tmp_path / "b.mov", tmp_path / "double.png")
    assert np.abs(one[1].astype(int) - other[1]).mean() < 0.2


def test_a_matte_of_another_shape_or_length_is_refused_before_any_work(folder: Path, tmp_path: Path, run: Run) -> None:
    quad = " ".join(f"{x},{y}" for x, y in SCENE.quad)
    asked = [str(folder / "src.mov"), str(folder / "ad.png"), "--quad", quad, "-o", str(tmp_path / "o.mp4")]
    status, _, error = run(*asked, "--matte", str(folder / "wide.png"))
    assert status == 2
    assert f"matte {folder / 'wide.png'} is 240x90 and the video {SCENE.width}x{SCENE.height}" in error
    short = make_clip(tmp_path / "short.mov", [SCENE.draw(SCENE.quad)] * 2, codec="qtrle", pix_fmt="rgb24")
    status, _, error = run(*asked, "--matte", str(short))
    assert status == 2
    assert "has 2 frames: give one of 3 frames, or a single picture" in error
    with pytest.raises(InputError, match=r"none\.mov"):
        render(folder, tmp_path / "o.mov", tmp_path / "none.mov")
    with pytest.raises(InputError, match="matte does nothing with a flat ad"):
        Surface(folder / "ad.png", SCENE.quad, matte=folder / "disc.png", flat=True)


def test_each_surface_of_a_job_has_a_matte_of_its_own(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "job.json"
    surfaces = [
        {"ad": "a.png", "quad": SCENE.quad.tolist(), "matte": "roto.mov"},
        {"ad": "b.png", "quad": SCENE.quad.tolist()},
    ]
    file.write_text(json.dumps({"version": 1, "surfaces": surfaces}))
    job = load_job(file)
    assert [surface.matte for surface in job.surfaces_with({})] == [tmp_path / "roto.mov", None]
    assert tmp_path / "roto.mov" in job.files
