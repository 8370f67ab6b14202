"""The command line of the server."""

import os
import re
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from ar_demo.cli import entry

from ..conftest import Main, Run


@pytest.fixture
def main() -> Main:
    return entry.studio_main


@pytest.mark.skipif(sys.platform == "win32", reason="ends by a signal")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_serves_until_it_is_ended(folder: Path, number: int) -> None:
    code = "from ar_demo.cli.entry import studio_main; studio_main()"
    command = [sys.executable, "-c", code, str(folder / "street.mp4"), str(folder / "ad.png"), "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address = re.search(r"http://127\.0\.0\.1:\d+/", process.stdout.readline())
        assert address is not None
        with pytest.raises(urllib.error.HTTPError, match="401"):
            urllib.request.urlopen(address[0], timeout=20)
        os.kill(process.pid, number)
        _, err = process.communicate(timeout=20)
    finally:
        process.kill()
        process.communicate()
    assert (process.returncode, "Traceback" in err) == (0, False)


def test_says_what_to_install(run: Run, monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    code, _, err = run(folder / "street.mp4")
    assert (code, err.count("\n")) == (2, 1)
    assert "pip install 'ar-replace[studio]'" in err


def test_wrong_input_is_said_in_one_line(run: Run, folder: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        for arguments, message in (
            ([folder / "gone.mp4"], "does not exist"),
            ([folder / "street.mp4", folder / "gone.png"], "ad's file name"),
            ([folder / "street.mp4", "--root", folder / "gone"], "not a folder"),
            ([folder / "street.mp4", "--max-frames", 1], "allow more with --max-frames"),
            ([folder / "street.mp4", "--max-pixels", 100], "allow more with --max-pixels"),
            ([folder / "street.mp4", "--port", taken.getsockname()[1]], "name another with --port"),
            ([folder / "street.mp4", "--port", 99999], "name another with --port"),
        ):
            code, _, err = run(*arguments, "--no-browser", "--quiet")
            assert (code, err.count("\n")) == (2, 1), err
            assert message in err


def test_ar_replace_picks_in_studio(run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    served: list[object] = []
    monkeypatch.setattr("ar_demo.studio.command.serve", lambda *given, **others: served.append((given, others)))
    assert run(folder / "street.mp4", folder / "ad.png", "--pick", main=entry.replace_main)[0] == 0
    assert served == [((folder / "street.mp4", folder / "ad.png", None, 0), {"opens_browser": True})]
    code, _, err = run(folder / "street.mp4", "--pick", "--quad", "1,1 9,1 9,9 1,9", main=entry.replace_main)
    assert (code, len(served)) == (2, 1)
    assert "--quad does nothing beside --pick" in err
    assert run("--pick", main=entry.replace_main)[0] == 2
