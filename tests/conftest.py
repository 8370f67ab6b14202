import logging
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from ar_demo.cli import entry
from ar_demo.media.priority import priority_kept
from ar_demo.tracking import protocol
from hdn import Tracker
from hdn.networks import pytorch, weights
from hdn.networks.engine import Engine
from hdn.networks.loading import load_engine

Main = Callable[[list[str]], None]
Run = Callable[..., tuple[int, str, str]]


def pytest_configure() -> None:
    """Tests that are ended by signals find them as a terminal leaves them: `nohup` and `&` have some ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture
def main() -> Main:
    """The command line that `run` runs, where a call names no other; modules that test another have their own."""
    return entry.replace_main


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], main: Main) -> Run:
    """Runs a command line of ours in this process: exit status, standard output and error."""

    def call(*arguments: object, main: Main = main) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as end:
            main([str(a) for a in arguments])
        out, err = capsys.readouterr()
        return int(end.value.code or 0), out, err

    return call


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium, without a window; one for all tests, since Playwright runs once in a process."""
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("Chromium is not installed")
    with playwright.sync_playwright() as p:
        options = ["--no-sandbox"] if os.getuid() == 0 else []
        browser = p.chromium.launch(executable_path=chromium, args=options)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def network() -> pytorch.Hdn:
    """The shipped networks."""
    return pytorch.load(weights.shipped())


@pytest.fixture(scope="session")
def engine() -> Engine:
    """The shipped networks as the tracker runs them on a CPU; loaded once for all tests."""
    return load_engine(device="cpu")


@pytest.fixture
def shared_networks(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sessions of this test take the shipped networks as they are loaded already, where they name no others."""

    def tracker(weights: Path | None = None, device: str = "auto", engine: Engine | None = engine) -> Tracker:
        return Tracker(weights, device, None if weights else engine)

    monkeypatch.setattr(protocol, "Tracker", tracker)


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of 200 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", disk], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("mounting needs root")
    yield disk
    subprocess.run(["umount", disk], check=True)


@pytest.fixture(autouse=True)
def _no_defaults_of_ones_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """The person who runs the tests may have some."""
    monkeypatch.setenv("XDG_CONFIG_HOME", "/nowhere")
    for name in [name for name in os.environ if name.startswith("AR_REPLACE_")]:
        monkeypatch.delenv(name)


@pytest.fixture(autouse=True)
def _loggers_as_they_were() -> Iterator[None]:
    """Commands set up their own logging, which is none of the next test's business."""
    loggers = [logging.getLogger(name) for name in ("ar_demo", "hdn")]
    before = [(logger.level, logger.handlers[:]) for logger in loggers]
    yield
    for logger, (level, handlers) in zip(loggers, before, strict=True):
        logger.setLevel(level)
        logger.handlers[:] = handlers


@pytest.fixture(autouse=True)
def _usual_priority() -> Iterator[None]:
    """Tests that open SVT-AV1 by themselves, as root, would leave all after them at real-time priority."""
    with priority_kept():
        yield
