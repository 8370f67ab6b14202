"""Jobs done by ar-replace itself."""

import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest

from ar_demo import OutputOptions, Surface, parse_quad, replace
from ar_demo.media.pictures import write_picture
from ar_demo.media.reader import VideoReader

from ..clips import make_clip
from ..conftest import Run
from ..scenes import Scene, path
from .processes import fork_batch, wait_until

FRAMES = 6
QUAD = "100,70 220,74 216,166 102,160"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With a clip and two ads."""
    scene = Scene()
    make_clip(tmp_path / "c.mp4", [scene.draw(corners) for corners in path(scene.quad, FRAMES)])
    for name, colour in (("red.png", (200, 30, 30)), ("blue.png", (20, 40, 200))):
        write_picture(tmp_path / name, np.full((60, 80, 3), colour, np.uint8))
    return tmp_path


@pytest.mark.usefixtures("shared_networks")
def test_killed_in_the_middle_the_pictures_are_those_that_one_run_makes(run: Run, folder: Path) -> None:
    manifest = folder / "jobs.json"
    job = {"input": "c.mp4", "ad": ["red.png", "blue.png"], "quad": QUAD, "codec": "ffv1", "output": "out/{ad}.mkv"}
    manifest.write_text(json.dumps({"version": 1, "jobs": [job]}))
    pid = fork_batch(manifest)
    wait_until(lambda: bool(list(folder.glob("jobs.batch/tracks/*.json"))))  # it is killed as it draws
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    status, out, _ = run(manifest, "--json", "--quiet")
    assert status == 0
    results = {Path(each["outputs"]["output"]).name: each["result"] for each in json.loads(out)["jobs"]}
    assert {result["states"]["tracked"] for result in results.values()} == {FRAMES}
    for ad in ("red", "blue"):
        surface = Surface(folder / f"{ad}.png", parse_quad(QUAD))
        replace(folder / "c.mp4", surface, folder / "direct.mkv", options=OutputOptions(codec="ffv1", overwrite=True))
        made, expected = pictures(folder / "out" / f"{ad}.mkv"), pictures(folder / "direct.mkv")
        assert len(made) == FRAMES
        np.testing.assert_array_equal(made, expected)
    assert len(list((folder / "jobs.batch" / "tracks").iterdir())) == 1  # both ads lie on one track
    assert sorted(p.name for p in (folder / "out").iterdir()) == sorted(
        f"{ad}.mkv{ending}" for ad in ("red", "blue") for ending in ("", ".log", ".json")
    )


def pictures(video: Path) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    with VideoReader(video) as reader:
        return np.array([frame.image for frame in reader.frames()])
