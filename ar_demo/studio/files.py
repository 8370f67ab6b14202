"""The files that the page may name: by opaque ids, never by paths, and only those that it was shown."""

import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Literal, get_args

from ..media.sequences import SUFFIXES as PICTURES
from .errors import Refusal

Kind = Literal["video", "ad", "picture", "job", "track"]

VIDEOS = (".mp4", ".mov", ".mkv", ".webm", ".avi", ".m4v", ".mpg", ".mpeg", ".ts", ".mts", ".ogv", ".mxf")
STILLS = (*(suffix for suffix in PICTURES if suffix not in (".exr", ".tga", ".dpx")), ".gif", ".avif")
ENDINGS: dict[str, tuple[str, ...]] = {
    "video": VIDEOS,
    "ad": (*STILLS, *VIDEOS),
    "picture": STILLS,
    "job": (".json",),
    "track": (".track.json",),
}


@dataclass(frozen=True)
class ListingModel:
    """How much of a folder is shown."""

    most_entries: int = 2000


MODEL = ListingModel()


class Files:
    """Files and folders by their ids.

    What is below the root is found by listing folders; what is not was named by whoever started the server, or made by
    it. Wherever a path is used it is resolved anew, so that a link that leads out of the root leads nowhere.
    """

    def __init__(self, root: Path | None = None, model: ListingModel = MODEL) -> None:
        self._root = None if root is None else root.resolve()
        self._model = model
        self._named: set[Path] = set()
        self._paths: dict[str, Path] = {}
        self._ids: dict[Path, str] = {}
        self._lock = Lock()

    def admit(self, path: Path) -> str:
        """The id of a file that the page may name wherever it lies."""
        path = path.resolve()
        with self._lock:
            self._named.add(path)
            return self._id(path)

    def path(self, id: str) -> Path:
        """The file, or folder, of an id.

        Raises:
            Refusal: there is no such id, or what it stands for is gone or leads elsewhere.
        """
        with self._lock:
            path = self._paths.get(id)
        if path is None or not self._may(path.resolve()) or not path.exists():
            raise Refusal(404, "this file is not there any more: choose another")
        return path

    def entry(self, path: Path) -> dict[str, Any]:
        """What the page is told of a file that it may name."""
        with self._lock:
            return self._entry(path)

    def listing(self, kind: Kind, folder: str | None = None) -> dict[str, Any]:
        """The folders and the files of a kind in a folder.

        Args:
            folder: its id; None for the root, with the files that were named.

        Raises:
            Refusal: no such folder.
        """
        here = self._root if folder is None else self.path(folder)
        if here is not None and not here.is_dir():
            raise Refusal(404, "this is not a folder: choose another")
        found = [] if here is None else self._children(here)
        with self._lock:
            named = sorted(self._named) if folder is None else []
        seen = list(dict.fromkeys(path for path in [*named, *found] if self._is_shown(path)))
        files = [path for path in seen if path.is_file() and kind in kinds_of(path)]
        parent = None if here in (None, self._root) else here.parent
        with self._lock:
            return {
                "folder": None if here is None else {"id": self._id(here), "name": here.name},
                "parent": None if parent is None else {"id": self._id(parent), "name": parent.name},
                "folders": [{"id": self._id(path), "name": path.name} for path in seen if path.is_dir()],
                "files": [self._entry(path) for path in files],
            }

    def _children(self, folder: Path) -> Sequence[Path]:
        try:
            found = sorted((path for path in folder.iterdir() if not path.name.startswith(".")), key=_order)
        except OSError as error:
            raise Refusal(403, "this folder cannot be read: choose another") from error
        return found[: self._model.most_entries]

    def _is_shown(self, path: Path) -> bool:
        try:
            return self._may(path.resolve()) and path.exists()
        except OSError:
            return False

    def _may(self, resolved: Path) -> bool:
        return resolved in self._named or (self._root is not None and resolved.is_relative_to(self._root))

    def _entry(self, path: Path) -> dict[str, Any]:
        kind = next(iter(kinds_of(path)), None)
        return {"id": self._id(path), "name": path.name, "kind": kind, "bytes": path.stat().st_size}

    def _id(self, path: Path) -> str:
        if path not in self._ids:
            self._ids[path] = secrets.token_urlsafe(9)
            self._paths[self._ids[path]] = path
        return self._ids[path]


def kinds_of(path: Path) -> list[Kind]:
    """What a file may be, by its name."""
    name = path.name.lower()
    if name.endswith(ENDINGS["track"]):
        return ["track"]
    return [kind for kind in get_args(Kind) if name.endswith(ENDINGS[kind])]


def _order(path: Path) -> tuple[str, str]:
    return path.name.lower(), path.name
