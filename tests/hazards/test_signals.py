"""Signals that ask to end: whenever they come, nothing unfinished is left, and the exit status tells which it was."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import ar_demo.session
from ar_demo import OutputOptions, Progress, Surface, replace
from ar_demo.media.claims import Claim
from hdn.commandline import run

from ..clips import make_clip
from ..scenes import Scene, path
from ..test_session import Still

FRAMES = 12
SURFACE = Surface(effect="blur", quad=Scene().quad)
OPTIONS = OutputOptions(backend="opencv")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sends signals")


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ar_demo.session, "hdn_trackers", lambda options: Still)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = Scene()
    images = [scene.draw(corners) for corners in path(scene.quad, FRAMES)]
    return make_clip(tmp_path_factory.mktemp("clip") / "a.mp4", images)


def sending(number: int, stage: str, times: int = 1) -> Callable[[Progress], None]:
    def listen(event: Progress) -> None:
        if event.stage == stage and event.done == 3:
            for _ in range(times):
                os.kill(os.getpid(), number)

    return listen


@pytest.mark.parametrize("stage", ["track", "render"])
@pytest.mark.parametrize(("name", "status"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_all_endings_clean_up(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], stage: str, name: str, status: int
) -> None:
    before = signal.getsignal(getattr(signal, name))

    def command(_: object) -> int:
        replace(clip, SURFACE, tmp_path / "o.mp4", None, OPTIONS, sending(getattr(signal, name), stage))
        return 0

    assert run(command, [], "nothing is left") == status
    assert capsys.readouterr().err == "interrupted: nothing is left\n"
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(getattr(signal, name)) == before


def test_an_impatient_second_one_does_not_end_the_cleaning_up(clip: Path, tmp_path: Path) -> None:
    def command(_: object) -> int:
        try:
            replace(clip, SURFACE, tmp_path / "o.mp4", None, OPTIONS, sending(signal.SIGTERM, "render"))
        finally:
            os.kill(os.getpid(), signal.SIGINT)
        return 0

    assert run(command, [], "") == 143
    assert list(tmp_path.iterdir()) == []


def test_one_that_comes_where_no_exception_gets_through_is_not_lost(clip: Path, tmp_path: Path) -> None:
    class Finalised:
        def __del__(self) -> None:
            os.kill(os.getpid(), signal.SIGTERM)

    def listen(event: Progress) -> None:
        if event.stage == "render" and event.done == 1:
            Finalised()
        time.sleep(0.02)

    def command(_: object) -> int:
        replace(clip, SURFACE, tmp_path / "o.mp4", None, OPTIONS, listen)
        return 0

    assert run(command, [], "") == 143
    assert list(tmp_path.iterdir()) == []


def test_what_whoever_started_it_wants_ignored_is_ignored(clip: Path, tmp_path: Path) -> None:
    """As nohup does with SIGHUP."""

    def command(_: object) -> int:
        replace(clip, SURFACE, tmp_path / "o.mp4", None, OPTIONS, sending(signal.SIGHUP, "render"))
        return 0

    usual = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert run(command, [], "") == 0
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, usual)
    assert [p.name for p in tmp_path.iterdir()] == ["o.mp4"]


def test_children_end_as_children_do() -> None:
    """A worker's end, as of a pool that is over, is no interruption."""
    code = """
import multiprocessing, time
from hdn.commandline import run
def work(begun):
    begun.set()
    time.sleep(60)
def command(_):
    context = multiprocessing.get_context("fork")
    begun = context.Event()
    process = context.Process(target=work, args=(begun,))
    process.start()
    begun.wait()
    process.terminate()
    process.join()
    return -process.exitcode
raise SystemExit(run(command, [], ""))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (signal.SIGTERM, "")


def test_what_a_killed_render_left_goes_with_the_next_run_in_the_folder(clip: Path, tmp_path: Path) -> None:
    code = """
import os, signal, sys
import ar_demo.session
from tests.hazards import test_signals as t
ar_demo.session.hdn_trackers = lambda options: t.Still
t.replace(sys.argv[1], t.SURFACE, sys.argv[2], None, t.OPTIONS, t.sending(signal.SIGKILL, "render"))
"""
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code, clip, tmp_path / "o.mp4"], cwd=root, check=False)
    assert done.returncode == -signal.SIGKILL
    left = [p.name for p in tmp_path.iterdir()]
    assert len(left) == 2
    assert all(name.startswith(".") for name in left)
    Claim(tmp_path / "another.mp4").release()
    assert list(tmp_path.iterdir()) == []


def test_the_installed_command_ends_while_it_loads(clip: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from ar_demo.cli.entry import replace_main; replace_main()"]
    process = subprocess.Popen(
        [*command, clip, "--effect", "blur", "--quad", "1,1 99,1 99,99 1,99", "-o", tmp_path / "o.mp4"],
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(0.4)
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=120)
    assert process.returncode in (143, -signal.SIGTERM)  # the latter before the program itself began
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []
