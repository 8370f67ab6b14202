"""An output's name belongs to one run, and what dead runs left is removed, but never another's."""

import errno
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from ar_demo.errors import InputError, RunError
from ar_demo.media import claims
from ar_demo.media.claims import Claim, check_different, write_whole

HOLD = """
import sys
from ar_demo.media.claims import Claim
claim = Claim(sys.argv[1])
claim.part.write_bytes(b"half of it")
print("claimed", flush=True)
sys.stdin.read()
"""


@contextmanager
def other_run(output: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that has claimed an output and written half of it; it lives as long as the context."""
    command = [sys.executable, "-c", HOLD, str(output)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "claimed\n"
        yield process
        process.kill()


def names(folder: Path) -> list[str]:
    return sorted(os.listdir(folder))


def test_a_part_becomes_the_output(tmp_path: Path) -> None:
    with Claim(tmp_path / "a.mp4") as claim:
        claim.part.write_bytes(b"all of it")
        assert "a.mp4" not in names(tmp_path)
        assert all(name.startswith(".") for name in names(tmp_path))
        claim.finish()
    assert names(tmp_path) == ["a.mp4"]
    assert (tmp_path / "a.mp4").read_bytes() == b"all of it"


@pytest.mark.parametrize("is_folder", [False, True])
def test_what_is_not_finished_is_removed(tmp_path: Path, is_folder: bool) -> None:
    claim = Claim(tmp_path / "a.mp4")
    if is_folder:
        claim.part.mkdir()
        (claim.part / "0.png").write_bytes(b"a frame")
    else:
        claim.part.write_bytes(b"half of it")
    claim.release()
    claim.release()
    assert names(tmp_path) == []


def test_a_name_belongs_to_one_run_whatever_its_folder_is_called(tmp_path: Path) -> None:
    folder, link = tmp_path / "folder", tmp_path / "link"
    folder.mkdir()
    link.symlink_to(folder)
    with Claim(folder / "a.mp4", overwrite=True), Claim(folder / "b.mp4"):
        for path in (folder / "a.mp4", link / "a.mp4"):
            with pytest.raises(InputError, match="being written by another run"):
                Claim(path, overwrite=True)
    Claim(folder / "a.mp4").release()


def test_of_many_at_once_one_gets_the_name(tmp_path: Path) -> None:
    for _ in range(8):
        start, got = threading.Barrier(8), []

        def claim(start: threading.Barrier = start, got: list[Claim] = got) -> None:
            start.wait()
            with suppress(InputError):
                got.append(Claim(tmp_path / "a.mp4"))

        threads = [threading.Thread(target=claim) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(got) == 1
        got[0].release()
    assert names(tmp_path) == []


def test_what_a_killed_run_left_is_removed_by_the_next_in_the_folder(tmp_path: Path) -> None:
    with other_run(tmp_path / "dead.mp4") as process, other_run(tmp_path / "alive.mp4"):
        assert len(names(tmp_path)) == 4
        process.kill()
        process.wait()
        Claim(tmp_path / "another.mp4").release()
        left = names(tmp_path)
        assert len(left) == 2
        with pytest.raises(InputError, match="another run"):
            Claim(tmp_path / "alive.mp4")
        assert names(tmp_path) == left


def test_a_killed_runs_name_is_free(tmp_path: Path) -> None:
    with other_run(tmp_path / "a.mp4") as process:
        process.kill()
        process.wait()
        with Claim(tmp_path / "a.mp4") as claim:
            assert not claim.part.exists()


def test_a_killed_runs_name_is_free_while_others_clear_it_away(tmp_path: Path) -> None:
    with other_run(tmp_path / "a.mp4") as process:
        process.kill()
        process.wait()
        [file] = tmp_path.glob("*.claim")
        lock = os.open(file, os.O_RDWR)
        claims.fcntl.flock(lock, claims.fcntl.LOCK_EX)
        timer = threading.Timer(0.1, os.close, (lock,))
        timer.start()
        Claim(tmp_path / "a.mp4").release()
        timer.join()
        assert names(tmp_path) == []


def machine_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(claims, "_machine", lambda: "elsewhere")


def no_locks(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, "no locks available")

    monkeypatch.setattr(claims.fcntl, "flock", refuse)


@pytest.mark.parametrize("hide", [machine_elsewhere, no_locks])
def test_where_locks_do_not_reach_a_claim_lives_as_long_as_it_is_touched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hide: Callable[[pytest.MonkeyPatch], None]
) -> None:
    output = tmp_path / "a.mp4"
    with other_run(output) as process:
        process.kill()
        process.wait()
        [file] = tmp_path.glob("*.claim")
        hide(monkeypatch)
        with pytest.raises(InputError, match="another run"):
            Claim(output)
        before = file.stat().st_mtime - claims.MODEL.silent_seconds - 60
        os.utime(file, (before, before))
        Claim(output).release()
        assert names(tmp_path) == []


def test_a_claim_is_touched_while_it_lives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(claims, "MODEL", claims.ClaimModel(touch_seconds=0.01))
    with Claim(tmp_path / "a.mp4"):
        [file] = tmp_path.glob("*.claim")
        os.utime(file, (1, 1))
        for _ in range(200):
            if file.stat().st_mtime > 1:
                break
            threading.Event().wait(0.02)
        assert file.stat().st_mtime > 1


def test_a_file_that_appeared_meanwhile_is_kept_and_so_is_the_output(tmp_path: Path) -> None:
    with Claim(tmp_path / "a.mp4") as claim:
        claim.part.write_bytes(b"ours")
        (tmp_path / "a.mp4").write_bytes(b"theirs")
        with pytest.raises(RunError, match=r"appeared meanwhile; the output is kept as .*a\.1\.mp4"):
            claim.finish()
    assert names(tmp_path) == ["a.1.mp4", "a.mp4"]
    assert (tmp_path / "a.1.mp4").read_bytes() == b"ours"
    assert (tmp_path / "a.mp4").read_bytes() == b"theirs"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none/a.mp4", "does not exist"),
        ("taken.mp4", "--overwrite"),
        (".", "is a folder"),
        ("a" * 252 + ".mp4", "more than 255 bytes"),
        ("ü" * 126 + ".mp4", "more than 255 bytes"),
        (f"{'a' * 250}/" * 20 + "a.mp4", "too long|does not exist"),
    ],
)
def test_names_that_cannot_be_had_are_one_sentence(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "taken.mp4").write_bytes(b"precious")
    with pytest.raises(InputError, match=message) as caught:
        Claim(tmp_path / name)
    assert "Errno" not in str(caught.value)
    assert "\n" not in str(caught.value)
    assert names(tmp_path) == ["taken.mp4"]


def test_a_closed_folder_is_one_sentence() -> None:
    """The kernel's own folders take no files, not even of root."""
    with pytest.raises(InputError, match="cannot write to the folder /proc") as caught:
        Claim("/proc/a.mp4")
    assert "Errno" not in str(caught.value)


def test_a_folder_without_permission_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may write anywhere, so the system's word is given here."""
    monkeypatch.setattr(claims.os, "access", lambda *_: False)
    with pytest.raises(InputError, match=r"cannot write to the folder .* \(permission denied\)"):
        Claim(tmp_path / "a.mp4")
    assert names(tmp_path) == []


def test_a_full_disk_is_told_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(claims.os, "write", full)
    with pytest.raises(RunError, match="no space left"):
        Claim(tmp_path / "a.mp4")
    assert names(tmp_path) == []


@pytest.mark.parametrize("name", ["a" * 246 + ".mp4", "a" * 251 + ".mp4", "ü" * 125 + ".json"])
def test_the_longest_names_can_be_written(tmp_path: Path, name: str) -> None:
    write_whole(tmp_path / name, b"all of it")
    assert names(tmp_path) == [name]


def test_two_outputs_of_one_run_differ(tmp_path: Path) -> None:
    check_different([tmp_path / "a", tmp_path / "b"])
    with pytest.raises(InputError, match="two outputs have the same name"):
        check_different([tmp_path / "a", tmp_path / "x" / ".." / "a"])
