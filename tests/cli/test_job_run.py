"""A whole job, from a file alone."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo.media.reader import VideoReader

from ..clips import make_clip
from ..conftest import Run
from ..scenes import Scene

pytestmark = pytest.mark.usefixtures("shared_networks")


def test_a_job_file_is_all_that_is_needed(run: Run, tmp_path: Path) -> None:
    scene = Scene()
    make_clip(tmp_path / "in.mp4", [scene.draw(scene.quad)] * 6, rate=25)
    cv2.imwrite(str(tmp_path / "ad.png"), np.full((60, 80, 3), (0, 0, 255), np.uint8))
    job = {
        "version": 1,
        "input": "in.mp4",
        "output": "out.mp4",
        "save_track": "track.json",
        "tracking": {"end": 3},
        "rendering": {"backend": "opencv", "crf": 10},
        "surfaces": [{"ad": "ad.png", "quad": scene.quad.tolist(), "flat": True}],
    }
    (tmp_path / "job.json").write_text(json.dumps(job))
    code, _, err = run("--job", tmp_path / "job.json", "--quiet")
    assert code == 0, err
    with VideoReader(tmp_path / "out.mp4") as reader:
        images = [frame.image for frame in reader.frames()]
    assert len(images) == 4
    assert all(image[118, 160, 0] - int(image[118, 160, 1]) > 150 for image in images)
    assert (tmp_path / "track.json").is_file()
    code, _, err = run("--job", tmp_path / "job.json", "--quiet")
    assert code == 2
    assert "--overwrite" in err
