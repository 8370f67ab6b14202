"""Files from addresses, kept in a folder of bounded size, which processes of a machine share."""

import hashlib
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import InputError, RunError
from ..media.claims import reason_of
from ..media.download import local_name
from ..units import in_words
from . import addresses

if os.name != "nt":
    import fcntl


class Cache:
    """A folder of files that were fetched: the least recently used ones make place for new ones."""

    def __init__(self, folder: Path, limit: int) -> None:
        """Args: limit: bytes of all files together."""
        self._folder, self._limit = folder, limit

    @contextmanager
    def held(self, url: str) -> Iterator[Path]:
        """The file at an address, fetched where it is not here as it is there now; it stays while the context lasts.

        Raises:
            InputError: there is none, or it is larger than the cache may be.
            RunError: it cannot be fetched, or all files of a full cache are in use.
        """
        size = addresses.size(url)
        if size is not None and size > self._limit:
            raise InputError(f"{url} has {in_words(size)}, and the cache {in_words(self._limit)}: see --cache-size")
        key = hashlib.sha256(f"{url} {addresses.facts(url)}".encode()).hexdigest()[:32]
        folder = self._folder / key
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with _locked(self._folder / f"{key}.lock") as lock:
                file = folder / local_name(url)
                if not file.exists():
                    self._fetch(url, folder, file, size or 0)
                os.utime(folder)
                _share(lock)
                yield file
        except OSError as error:
            raise RunError(f"cannot write to the cache {self._folder}: {reason_of(error)}") from error

    def _fetch(self, url: str, folder: Path, file: Path, size: int) -> None:
        part = folder / ".part"
        try:
            self._make_room(part, size)
            addresses.download(url, str(part), self._limit)
            self._make_room(None, 0)  # where its size was not told
            os.replace(part, file)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    def _make_room(self, part: Path | None, size: int) -> None:
        """Removes the least recently used files until there is room for a part of so many bytes, which takes it."""
        with _locked(self._folder / "lock"):
            if part is not None:
                shutil.rmtree(part.parent, ignore_errors=True)  # what a process that was killed left
            folders = [entry for entry in os.scandir(self._folder) if entry.is_dir()]
            sizes = {entry.path: _size_of(Path(entry.path)) for entry in folders}
            for entry in sorted(folders, key=lambda entry: entry.stat().st_mtime):
                if sum(sizes.values()) + size <= self._limit:
                    break
                with _locked(Path(f"{entry.path}.lock"), wait=False) as lock:
                    if lock is not None:
                        shutil.rmtree(entry.path, ignore_errors=True)
                        del sizes[entry.path]
            if sum(sizes.values()) + size > self._limit:
                raise RunError(f"all files of the cache {self._folder} are in use: see --cache-size")
            if part is not None:
                part.parent.mkdir()
                part.touch()
                os.truncate(part, size)


def _size_of(folder: Path) -> int:
    total = 0
    with suppress(OSError):
        total = sum(entry.stat().st_size for entry in os.scandir(folder))
    return total


@contextmanager
def _locked(file: Path, wait: bool = True) -> Iterator[int | None]:
    """Locks a file, which is made; None where another process, or thread, has it and this one shall not wait."""
    lock = os.open(file, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
    try:
        if os.name != "nt":
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
            except BlockingIOError:
                yield None
                return
        yield lock
    finally:
        os.close(lock)


def _share(lock: int | None) -> None:
    """Lets others use the file as well, though not remove it."""
    if lock is not None and os.name != "nt":
        fcntl.flock(lock, fcntl.LOCK_SH)
