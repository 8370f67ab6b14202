"""The programs in examples/ run, on a short clip of the demo."""

import os
import subprocess
import sys
import tomllib
from fractions import Fraction
from itertools import islice
from pathlib import Path

import cv2
import pytest

from ar_demo.media.reader import VideoReader
from ar_demo.tracks import Track

from .clips import make_clip

ROOT = Path(__file__).parents[1]
AD = str(ROOT / "assets" / "ad.mp4")
QUAD = ["476.3,128.1", "759.4,121.6", "758.8,479.7", "481.7,476.3"]
FRAMES = 40


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> str:
    with VideoReader(ROOT / "assets" / "demo.mp4") as reader:
        images = [frame.image for frame in islice(reader.frames(), FRAMES)]
        rate = reader.info.rate
    return str(make_clip(tmp_path_factory.mktemp("clip") / "street.mp4", images, rate=Fraction(rate)))


def run(name: str, *arguments: str) -> str:
    command = [sys.executable, str(ROOT / "examples" / f"{name}.py"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_replace_a_poster(clip: str, tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    assert f"{FRAMES} frames" in run("replace_a_poster", clip, AD, str(out), *QUAD)
    assert out.is_file()


def test_track_once_render_often_and_export(clip: str, tmp_path: Path) -> None:
    printed = run("track_once_render_often", clip, str(tmp_path), *QUAD, AD)
    assert printed.split() == [str(tmp_path / "ad.mp4")]
    # As installing examples/own_exporter does: its entry point, and its module on the path.
    metadata = tmp_path / "ar_replace_centre-0.1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: ar-replace-centre\nVersion: 0.1.0\n")
    project = tomllib.loads((ROOT / "examples" / "own_exporter" / "pyproject.toml").read_text())["project"]
    (metadata / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n{name} = {value}\n"
            for group, p in project["entry-points"].items()
            for name, value in p.items()
        )
    )
    paths = os.pathsep.join([str(ROOT), str(ROOT / "examples" / "own_exporter"), str(tmp_path)])
    export = "from ar_demo.cli.entry import export_main; export_main()"
    command = [sys.executable, "-c", export, str(tmp_path / "track.json"), str(tmp_path / "t.centre")]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": paths})
    assert done.returncode == 0, done.stderr
    rows = (tmp_path / "t.centre").read_text().splitlines()
    assert len(rows) == FRAMES
    frame, x, y = map(float, rows[0].split())
    assert frame == 0
    assert (x, y) == pytest.approx((619.5, 302.7), abs=2)


def test_preview_and_stop(clip: str, tmp_path: Path) -> None:
    out, preview = tmp_path / "out.mp4", tmp_path / "preview.png"
    printed = run("preview_and_stop", clip, AD, str(out), str(preview), *QUAD)
    assert "stopped: no output was written" in printed
    assert [p.name for p in tmp_path.iterdir()] == ["preview.png"]


def test_own_tracker(clip: str, tmp_path: Path) -> None:
    run("own_tracker", clip, str(tmp_path / "t.json"), *QUAD)
    assert Track.load(tmp_path / "t.json").counts["tracked"] == FRAMES


def test_tracker_alone(clip: str) -> None:
    lines = run("tracker_alone", clip, *QUAD).splitlines()
    assert len(lines) == 20
    assert all("tracked" in line for line in lines)


def test_map_of_a_plane(clip: str, tmp_path: Path) -> None:
    run("map_of_a_plane", clip, str(tmp_path / "map.png"), *QUAD)
    picture = cv2.imread(str(tmp_path / "map.png"))
    assert picture is not None
    third = picture.shape[1] // 3
    assert (picture[:, -third:] > 40).mean() > (picture[:, :third] > 40).mean()  # it has grown, and proved
