"""What a batch has done so far: a SQLite file that a kill at any moment leaves whole."""

import json
import os
import sqlite3
import time
from collections.abc import Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from ..errors import InputError, RunError
from ..media.claims import reason_of

if os.name != "nt":
    import fcntl

VERSION = 1
LOCK_SECONDS = 10.0  # in which jobs of a batch that was killed end

_TABLES = """
CREATE TABLE jobs (identity TEXT PRIMARY KEY, name TEXT, state TEXT, attempts INTEGER, seconds REAL, message TEXT,
                   result TEXT, finished REAL);
CREATE TABLE outputs (path TEXT PRIMARY KEY, identity TEXT, stamp TEXT);
CREATE TABLE digests (path TEXT PRIMARY KEY, stamp TEXT, digest TEXT);
"""


class State(AbstractContextManager["State"]):
    """The state of a batch, which this process alone has open. A context manager.

    Attributes:
        folder: that it lies in.
        tracks: folder of the tracks that were made.
        lock: descriptor whose lock says that a batch is at work; its jobs hold it as well.
    """

    def __init__(self, folder: Path) -> None:
        """Opens the state in a folder, or makes it.

        Raises:
            InputError: another batch is at work with it, it is of another version, or it is no state.
            RunError: it cannot be written.
        """
        self.folder, self.tracks = folder, folder / "tracks"
        try:
            self.tracks.mkdir(parents=True, exist_ok=True)
            self.lock = os.open(folder / "lock", os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
        except OSError as error:
            raise InputError(f"cannot write to {folder} ({reason_of(error)}): choose another with --state") from error
        try:
            self._take_lock()
            self._base = self._open(folder / "state.sqlite")
        except BaseException:
            os.close(self.lock)
            raise

    def __exit__(self, *error: object) -> None:
        self._base.close()
        os.close(self.lock)

    def _take_lock(self) -> None:
        until = time.monotonic() + LOCK_SECONDS
        while os.name != "nt":
            try:
                fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
            except BlockingIOError:
                if time.monotonic() > until:
                    raise InputError(f"another ar-batch is at work with {self.folder}: wait for it") from None
                time.sleep(0.05)
            except OSError:
                return  # a file system without locks

    def _open(self, file: Path) -> sqlite3.Connection:
        try:
            base = sqlite3.connect(file)
            base.execute("PRAGMA journal_mode = WAL")
            base.execute("PRAGMA synchronous = FULL")
            [[version]] = base.execute("PRAGMA user_version")
            if version == 0:
                base.executescript(f"BEGIN IMMEDIATE; {_TABLES} PRAGMA user_version = {VERSION}; COMMIT;")
        except sqlite3.OperationalError as error:
            raise RunError(f"{file} cannot be written ({error})") from error
        except sqlite3.DatabaseError as error:
            raise InputError(f"{file} is no state of a batch ({error}): move it away to begin anew") from error
        if version not in (0, VERSION):
            raise InputError(f"{file} is of version {version}, this program writes {VERSION}: choose another --state")
        return base

    def _do(self, *steps: tuple[str, Iterable[Any]]) -> None:
        """Does all or nothing."""
        try:
            with self._base:
                for statement, values in steps:
                    self._base.execute(statement, tuple(values))
        except sqlite3.Error as error:
            raise RunError(f"the state in {self.folder} cannot be written ({error})") from error

    # ---- jobs ----

    def begin(self, identity: str, name: str, outputs: Iterable[str]) -> None:
        """A job is about to be done: from here on its outputs are its own, complete or not."""
        self._do(
            ("REPLACE INTO jobs VALUES (?, ?, 'begun', 0, 0, '', '{}', 0)", (identity, name)),
            *(("REPLACE INTO outputs VALUES (?, ?, NULL)", (path, identity)) for path in outputs),
        )

    def done(
        self, identity: str, attempts: int, seconds: float, result: dict[str, Any], stamps: dict[str, str]
    ) -> None:
        """A job is done; stamps: of its outputs."""
        self._do(
            (
                "UPDATE jobs SET state = 'done', attempts = ?, seconds = ?, result = ?, finished = ? "
                "WHERE identity = ?",
                (attempts, seconds, json.dumps(result), time.time(), identity),
            ),
            *(("UPDATE outputs SET stamp = ? WHERE path = ?", (stamp, path)) for path, stamp in stamps.items()),
        )

    def failed(self, identity: str, attempts: int, seconds: float, message: str, stamps: dict[str, str]) -> None:
        """A job failed; stamps: of what lies under the names of its outputs, '' for nothing."""
        self._do(
            (
                "UPDATE jobs SET state = 'failed', attempts = ?, seconds = ?, message = ?, finished = ? "
                "WHERE identity = ?",
                (attempts, seconds, message, time.time(), identity),
            ),
            *(
                ("UPDATE outputs SET stamp = ? WHERE path = ?", (stamp, path))
                for path, stamp in stamps.items()
                if stamp
            ),
            *(("DELETE FROM outputs WHERE path = ?", (path,)) for path, stamp in stamps.items() if not stamp),
        )

    def finished(self, identity: str) -> tuple[int, float, dict[str, Any], dict[str, str]] | None:
        """Attempts, seconds, result, and the outputs' stamps of a job that is done; None of one that is not."""
        row = self._base.execute(
            "SELECT attempts, seconds, result FROM jobs WHERE identity = ? AND state = 'done'", (identity,)
        ).fetchone()
        if row is None:
            return None
        stamps = self._base.execute("SELECT path, stamp FROM outputs WHERE identity = ?", (identity,)).fetchall()
        return row[0], row[1], json.loads(row[2]), dict(stamps)

    def stamp(self, path: str) -> str | None:
        """Of a file that a job made, when it was made; '' where that was not finished, None where none made it."""
        row = self._base.execute("SELECT stamp FROM outputs WHERE path = ?", (path,)).fetchone()
        return None if row is None else row[0] or ""

    # ---- contents of files ----

    def digest(self, path: str, stamp: str) -> str | None:
        """The digest of a file's content, where it is known and the file has not changed since."""
        row = self._base.execute("SELECT digest FROM digests WHERE path = ? AND stamp = ?", (path, stamp)).fetchone()
        return None if row is None else row[0]

    def keep_digest(self, path: str, stamp: str, digest: str) -> None:
        """Keeps it for the next time."""
        self._do(("REPLACE INTO digests VALUES (?, ?, ?)", (path, stamp, digest)))
