"""An output's name, claimed before the work begins, and the hidden part that becomes the output once it is complete.

While out.mp4 is made, two files lie beside it, whose names are short and tell its name by a digest:

    .ar-1f0c….claim       who makes it, locked (flock) for as long as that process lives
    .ar-1f0c….part.mp4    what there is of it

So a second run to the same name is refused, however the first one ends its name is free again, and what a run that was
killed left is known to be dead: the next claim in the folder removes it. Where locks do not reach across machines, a
live claim is one that was touched within the last minutes, which every run does.
"""

import errno
import hashlib
import os
import shutil
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from platform import node
from threading import Event, Thread
from types import TracebackType
from typing import Self

from ..errors import InputError, RunError

if sys.platform != "win32":
    import fcntl

_PREFIX, _CLAIM, _PART = ".ar-", ".claim", ".part"
_BOOT = Path("/proc/sys/kernel/random/boot_id")
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EINVAL}  # of a file system that has none
_FULL = {errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)}
_LONGEST_NAME = 255  # bytes, where the file system does not tell


@dataclass(frozen=True)
class ClaimModel:
    """Times by which a claim is told to be alive."""

    # Others that look whether it is dead lock it as well, and clear it away: so one look does not tell.
    looks: int = 6
    pause_seconds: float = 0.05  # between two of them
    # Of another machine:
    touch_seconds: float = 60.0  # from one sign of life to the next
    silent_seconds: float = 600.0  # without one, after which it is dead


MODEL = ClaimModel()


class Claim:
    """A name that this run alone writes to. A context manager; leaving it removes what is not finished.

    Attributes:
        path: the output.
        part: file, or folder, beside it that is to be written; `finish` gives it the output's name.
        scratch: folder beside it for what the part is made of; nobody makes it but who needs it.
    """

    def __init__(self, path: Path | str, overwrite: bool = False, share: str = "") -> None:
        """Claims a name, and removes what dead runs left in its folder.

        Args:
            path: a file in a folder that exists.
            overwrite: whether a file of this name may be replaced.
            share: of an image sequence, which others may write other parts of meanwhile; none for all of it.

        Raises:
            InputError: the name cannot be had: see `check_name`; another run is writing to it.
            RunError: there is no space left.
        """
        self.path, self._overwrite = Path(path), overwrite
        check_name(self.path, overwrite)
        stem = _PREFIX + hashlib.blake2b(os.fsencode(self.path.name + share), digest_size=8).hexdigest()
        self._file = self.path.with_name(stem + _CLAIM)
        self.part = self.path.with_name(f"{stem}{_PART}{self.path.suffix}")
        self.scratch = self.path.with_name(f"{stem}{_PART}s")
        _remove_dead(self.path.parent)
        try:
            self._lock = _take(self._file)
        except OSError as error:
            raise _refusal(self.path, error) from error
        if self._lock is None:
            raise InputError(f"{self.path} is being written by another run: wait for it, or choose another output")
        self._released = Event()
        self._pulse = Thread(target=self._stay_alive, name="claim", daemon=True)
        self._pulse.start()

    def finish(self) -> None:
        """Gives the part, which is complete, the output's name.

        Raises:
            RunError: it cannot be; then the message says under which name it is kept.
        """
        try:
            if self.path.exists() and not self._overwrite:
                raise FileExistsError(errno.EEXIST, "a file of this name has appeared meanwhile")
            os.replace(self.part, self.path)
        except OSError as error:
            kept = free_name(self.path)
            try:
                os.replace(self.part, kept)
            except OSError:
                raise RunError(f"cannot write {self.path}: {reason_of(error)}") from error
            raise RunError(f"cannot write {self.path}: {reason_of(error)}; the output is kept as {kept}") from error

    def discard(self) -> None:
        """Removes the part; the name stays claimed."""
        _remove(self.part)

    def release(self) -> None:
        """Removes what is not finished, and lets go of the name; calling again does nothing."""
        if self._lock is None:
            return
        self._released.set()
        self._pulse.join()
        self.discard()
        _remove(self.scratch)
        lock, self._lock = self._lock, None
        _remove_claim(self._file, lock)

    def _stay_alive(self) -> None:
        while not self._released.wait(MODEL.touch_seconds):
            with suppress(OSError):
                os.utime(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


@contextmanager
def claimed(output: Path | str | Claim, overwrite: bool = True, share: str = "") -> Iterator[Claim]:
    """A claim for as long as the context lasts; one that is given stays its owner's.

    Raises:
        InputError, RunError: see `Claim`.
    """
    if isinstance(output, Claim):
        yield output
        return
    with Claim(output, overwrite, share) as claim:
        yield claim


def write_whole(output: Path | str | Claim, content: bytes) -> None:
    """Writes a small file, whole or not at all, in place of one that there is.

    Raises:
        InputError: the name cannot be had.
        RunError: it cannot be written.
    """
    with claimed(output) as claim:
        try:
            claim.part.write_bytes(content)
        except OSError as error:
            claim.discard()
            raise RunError(f"cannot write {claim.path}: {reason_of(error)}") from error
        claim.finish()


def check_name(path: Path, overwrite: bool) -> None:
    """Whether a file of this name can be written, as far as that can be told without doing it.

    Raises:
        InputError: the name is too long or that of a folder, its folder is missing or closed, or the file exists.
    """
    folder = path.parent
    try:
        if not folder.is_dir():
            raise InputError(f"the output folder {folder} does not exist: make it first")
        longest = os.pathconf(folder, "PC_NAME_MAX") if hasattr(os, "pathconf") else _LONGEST_NAME
        if len(os.fsencode(path.name)) > longest:
            raise InputError(f"the name {path.name} has more than {longest} bytes: choose a shorter one with -o")
        is_folder, exists = path.is_dir(), path.exists()
    except OSError as error:  # of a path that is too long as a whole, say
        raise InputError(f"{path} cannot be written to ({reason_of(error)}): choose another output with -o") from error
    if is_folder:
        raise InputError(f"{path} is a folder: name a file with -o")
    if exists and not overwrite:
        raise InputError(f"{path} exists already: choose another output with -o, or give --overwrite")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise _refusal(path, PermissionError(errno.EACCES, os.strerror(errno.EACCES)))


def check_different(outputs: Iterable[Path | str]) -> None:
    """Raises InputError where two outputs of one run are one file."""
    names = [Path(output).resolve() for output in outputs]
    if len(set(names)) < len(names):
        raise InputError("two outputs have the same name: give each its own")


# ---- claims of this run and of others ----


def _take(file: Path) -> int | None:
    """Makes a claim's file, and locks it: its descriptor, None where another run has the name.

    Raises:
        OSError: the folder cannot be written to.
    """
    looks = 0
    while True:
        try:
            lock = os.open(file, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0), 0o666)
        except FileExistsError:
            if not _remove_if_dead(file):
                looks += 1
                if looks == MODEL.looks:
                    return None
                time.sleep(MODEL.pause_seconds)
            continue
        try:
            _locked(lock, wait=True)  # somebody else holds it only while looking whether it is dead
            if not _is_same(lock, file):
                os.close(lock)
                continue
            os.write(lock, _machine().encode())
        except BaseException:
            _remove_claim(file, lock)
            raise
        return lock


def _remove_dead(folder: Path) -> None:
    """Removes the claims and parts of runs that are surely dead."""
    with suppress(OSError):
        names = [entry.name for entry in os.scandir(folder) if entry.name.startswith(_PREFIX)]
        for name in names:
            if name.endswith(_CLAIM):
                _remove_if_dead(folder / name)


def _remove_if_dead(file: Path) -> bool:
    """Removes a claim and its parts where its run is dead; whether the name is free."""
    try:
        lock = os.open(file, os.O_RDWR)
    except FileNotFoundError:
        return True
    except OSError:
        return False  # somebody else's
    has_lock = _locked(lock, wait=False)
    try:
        is_of_this_machine = os.read(lock, 100).decode(errors="replace") == _machine()
        silent = time.time() - os.fstat(lock).st_mtime > MODEL.silent_seconds
        is_dead = (has_lock and is_of_this_machine) or (has_lock is not False and silent)
        if not is_dead or not _is_same(lock, file):
            os.close(lock)
            return False if not is_dead else not file.exists()
    except OSError:
        os.close(lock)
        return False
    stem = file.name.removesuffix(_CLAIM)
    for part in [name for name in os.listdir(file.parent) if name.startswith(stem + _PART)]:
        _remove(file.with_name(part))
    _remove_claim(file, lock)
    return True


def _locked(descriptor: int, wait: bool) -> bool | None:
    """Locks a file, until it is closed; False where another process has it, None where there are no locks."""
    if sys.platform == "win32":
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return None
        raise
    return True


def _is_same(descriptor: int, file: Path) -> bool:
    """Whether an open file still has its name."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(file))
    except FileNotFoundError:
        return False


def _machine() -> str:
    """What tells one kernel that runs, whose locks reach all of its containers, from others."""
    try:
        return _BOOT.read_text().strip()
    except OSError:
        return node()


def _remove_claim(file: Path, lock: int) -> None:
    if sys.platform == "win32":  # where no open file can be removed
        os.close(lock)
        file.unlink(missing_ok=True)
        return
    with suppress(OSError):
        if _is_same(lock, file):
            file.unlink()
    os.close(lock)


def _remove(part: Path) -> None:
    with suppress(OSError):
        if part.is_dir() and not part.is_symlink():
            shutil.rmtree(part, ignore_errors=True)
        else:
            part.unlink(missing_ok=True)


# ---- words ----


def free_name(path: Path) -> Path:
    """A path that no file has: this one, or one with a number in it."""
    other, number = path, 1
    while other.exists():
        other, number = path.with_name(f"{path.stem[:200]}.{number}{path.suffix}"), number + 1
    return other


def _refusal(path: Path, error: OSError) -> InputError | RunError:
    if error.errno in _FULL:
        return RunError(f"cannot write {path}: {reason_of(error)}")
    return InputError(f"cannot write to the folder {path.parent} ({reason_of(error)}): choose another with -o")


def reason_of(error: Exception) -> str:
    """Why a file could not be written, in words."""
    if getattr(error, "errno", None) in _FULL:
        return "no space left on the disk: free some, or write elsewhere"
    return (getattr(error, "strerror", None) or str(error)).lower()
