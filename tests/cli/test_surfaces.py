"""Several surfaces in one pass, and corrections by hand, from the command line."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from ar_demo.cli import entry
from ar_demo.cli.jobs import load_job
from ar_demo.media.reader import VideoReader
from ar_demo.surface import Moment
from ar_demo.tracks import Track

from ..clips import make_clip, truncated
from ..conftest import Run
from ..scenes import Image, Scene, error, moved, path

FRAMES = 12
QUADS = [
    np.array([[20.0, 40], [140, 44], [136, 130], [22, 126]]),
    np.array([[185.0, 90], [300, 94], [296, 190], [187, 186]]),
]


pytestmark = pytest.mark.usefixtures("shared_networks")


@pytest.fixture(scope="module")
def truth() -> list[list[np.ndarray]]:
    """Of each surface its corners in each frame."""
    return [
        [moved(quad, (1.5 * i, -i if k else i), 1 + 0.01 * i) for i in range(FRAMES)] for k, quad in enumerate(QUADS)
    ]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, truth: list[list[np.ndarray]]) -> Path:
    """Two posters that go different ways, silent."""
    first, second = Scene(seed=0), Scene(seed=3)
    images = []
    for a, b in zip(*truth, strict=True):
        second.wall = first.draw(a, 0)
        images.append(second.draw(b))
    return make_clip(tmp_path_factory.mktemp("clip") / "two.mp4", images, rate=30)


@pytest.fixture(scope="module")
def ads(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A red and a blue picture."""
    files = [tmp_path_factory.mktemp("ads") / name for name in ("red.png", "blue.png")]
    for file, colour in zip(files, ((0, 0, 255), (255, 0, 0)), strict=True):
        cv2.imwrite(str(file), np.full((60, 80, 3), colour, np.uint8))
    return files


def corners(quad: np.ndarray) -> list[str]:
    return [f"{x},{y}" for x, y in quad]


def middle(image: Image, quad: np.ndarray) -> np.ndarray:
    x, y = quad.mean(0).round().astype(int)
    return np.asarray(image[y - 4 : y + 5, x - 4 : x + 5].reshape(-1, 3).mean(0))


def check(out: Path, truth: list[list[np.ndarray]]) -> None:
    """The first surface is red and the second blue in every frame."""
    with VideoReader(out) as reader:
        for frame in reader.frames():
            red, blue = (middle(frame.image, quads[frame.index]) for quads in truth)
            assert red[0] - red[1:].max() > 150
            assert blue[2] - blue[:2].max() > 150


def test_two_surfaces_on_the_command_line(
    run: Run, clip: Path, ads: list[Path], truth: list[list[np.ndarray]], tmp_path: Path
) -> None:
    out, tracks = tmp_path / "out.mp4", tmp_path / "t.json"
    surfaces = [x for ad, quad in zip(ads, QUADS, strict=True) for x in ("--surface", ad, *corners(quad))]
    code, printed, err = run(
        clip, *surfaces, "-o", out, "--backend", "opencv", "--json", "--quiet", "--save-track", tracks
    )
    assert code == 0, err
    check(out, truth)
    summary = json.loads(printed)
    assert [s["ad"] for s in summary["surfaces"]] == list(map(str, ads))
    assert [s["states"]["tracked"] for s in summary["surfaces"]] == [FRAMES, FRAMES]
    assert summary["states"]["tracked"] == 2 * FRAMES
    assert summary["warnings"] == []  # that the video has no sound is none
    assert err == ""
    for number, quads in enumerate(truth, 1):
        track = Track.load(tmp_path / f"t.{number}.json")
        assert max(error(c, t) for c, t in zip(track.corners, quads, strict=True)) < 1


def test_a_job_file_has_options_for_each(
    run: Run, clip: Path, ads: list[Path], truth: list[list[np.ndarray]], tmp_path: Path
) -> None:
    job, out = ads[0].parent / "job.json", tmp_path / "out.mp4"
    second: dict[str, Any] = {"ad": str(ads[1]), "quad": truth[1][5].tolist(), "start": 5, "fit": "cover"}
    second["keyframes"] = [{"frame": 9, "corners": truth[1][9].tolist()}]
    job.write_text(
        json.dumps({"version": 1, "surfaces": [{"ad": "red.png", "quad": " ".join(corners(QUADS[0]))}, second]})
    )
    code, _, err = run(clip, "--job", job, "-o", out, "--backend", "opencv", "--quiet", "--audio", "none")
    assert code == 0, err
    check(out, truth)


def test_what_a_job_does_not_say_is_as_on_the_command_line(tmp_path: Path) -> None:
    job = tmp_path / "job.json"
    surfaces = [{"quad": QUADS[0].tolist(), "opacity": 0.2}, {"quad": QUADS[1].tolist()}]
    job.write_text(json.dumps({"version": 1, "surfaces": surfaces}))
    first, second = load_job(job).surfaces_with({"opacity": 0.7, "effect": "blur", "start": Moment(frame=3)})
    assert (first.opacity, second.opacity) == (0.2, 0.7)
    assert first.effect == second.effect == "blur"
    assert second.start == Moment(frame=3)
    assert first.ad is None


def test_keyframes_first_while_tracking_then_in_the_finished_track(
    run: Run, clip: Path, truth: list[list[np.ndarray]], tmp_path: Path
) -> None:
    first, second = tmp_path / "1.json", tmp_path / "2.json"
    given = truth[0][4] + 1.5

    def keyframe(at: object, quad: np.ndarray) -> list[str]:
        return ["--keyframe", f"{at}:{','.join(corners(quad))}"]

    code, _, err = run(
        clip, "--quad", *corners(QUADS[0]), *keyframe(4, given), "-o", first, "--quiet", main=entry.track_main
    )
    assert code == 0, err
    before = Track.load(first)
    np.testing.assert_array_equal(before.used[4], given)
    code, _, err = run(
        clip, "--track", first, *keyframe("0.3s", truth[0][9] - 1), "-o", second, "--quiet", main=entry.track_main
    )
    assert code == 0, err
    after = Track.load(second)
    np.testing.assert_array_equal(after.corners[:5], before.corners[:5])
    assert after.keyframes.keys() == after.used.keys() == {4, 9}
    assert after.known.all()
    assert max(error(c, t) for c, t in zip(after.corners, truth[0], strict=True)) < 0.7


def test_a_keyframe_after_the_end_of_a_damaged_video_is_refused(run: Run, tmp_path: Path) -> None:
    scene = Scene()
    images = [scene.draw(quad) for quad in path(scene.quad, FRAMES)]
    clip = truncated(make_clip(tmp_path / "cut.mkv", images, rate=10), 0.5)
    given = f"{FRAMES - 1}:{','.join(corners(scene.quad))}"
    code, _, err = run(
        clip,
        "--quad",
        *corners(scene.quad),
        "--keyframe",
        given,
        "-o",
        tmp_path / "t.json",
        "--quiet",
        main=entry.track_main,
    )
    assert code == 2
    assert "beyond the end" in err


# Comes to a stop where a library is about to be loaded, until its standard input ends.
WAITING = """
import sys

class Waiting:
    def find_spec(self, name, path=None, target=None):
        if name == "{library}":
            print("loading", flush=True)
            sys.stdin.read()

sys.meta_path.insert(0, Waiting())
from ar_demo.cli.entry import replace_main
replace_main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
@pytest.mark.parametrize("library", ["numpy", "cv2"])
def test_ctrl_c_while_libraries_load_is_a_word(library: str) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", WAITING.format(library=library), "in.mp4", "ad.png", "--quad", *corners(QUADS[0])],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(Path(entry.__file__).parents[2])},
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "loading\n"
    process.send_signal(signal.SIGINT)
    assert process.wait(600) == 130
    _, err = process.communicate()
    assert err == "interrupted: nothing unfinished is left\n"
