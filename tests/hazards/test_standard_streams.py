"""Standard streams that are closed, full or no longer read: the output is as it would be otherwise."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ar_demo.media.reader import VideoReader

from ..clips import make_clip
from ..scenes import Scene, path

FRAMES = 3
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="uses a shell")
# A whole run of ar-replace with a tracker that is loaded at once.
CODE = """
import ar_demo.session
from tests.test_session import Still
ar_demo.session.hdn_trackers = lambda options: Still
from ar_demo.cli.entry import replace_main
replace_main()
"""


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = Scene()
    images = [scene.draw(corners) for corners in path(scene.quad, FRAMES)]
    return make_clip(tmp_path_factory.mktemp("clip") / "a.mp4", images)


def shell(clip: Path, out: Path, redirection: str, *options: str) -> subprocess.CompletedProcess[str]:
    corners = " ".join(f"{x},{y}" for x, y in Scene().quad)
    words = [clip, "--effect", "blur", "--backend", "opencv", "--quad", corners, "-o", out, *options]
    line = f'exec "$0" -c "$1" "${{@:2}}" {redirection}'
    return subprocess.run(
        ["bash", "-c", line, sys.executable, CODE, *map(str, words)],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parents[2],
    )


@pytest.mark.parametrize(
    ("redirection", "status"),
    [
        ("2>&-", 0),
        ("<&- >&- 2>&-", 0),
        ("2>/dev/full", 0),
        (">/dev/full", 1),
        (">/dev/full 2>&1", 1),
        ("> >(exec <&-; sleep 5)", 1),
    ],
)
def test_the_output_is_complete(clip: Path, tmp_path: Path, redirection: str, status: int) -> None:
    done = shell(clip, tmp_path / "o.mp4", redirection, "--codec", "libx265", "--json")
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception" not in done.stderr
    if status and "2>" not in redirection:
        assert "error: standard output cannot be written to: " in done.stderr
    with VideoReader(tmp_path / "o.mp4") as reader:
        assert sum(1 for _ in reader.frames()) == FRAMES
    assert os.listdir(tmp_path) == ["o.mp4"]


@pytest.mark.parametrize("codec", ["libx264", "libx265", "libsvtav1"])
def test_quiet_is_quiet(clip: Path, tmp_path: Path, codec: str) -> None:
    done = shell(clip, tmp_path / "o.mp4", "", "--codec", codec, "--quiet")
    assert done.returncode == 0
    assert done.stderr == ""
