"""Files of a job where its process is: addresses fetched, and outputs made aside, then put in their places whole."""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

from ..errors import InputError, RunError
from ..media.claims import reason_of, write_whole
from ..media.download import is_url, local_name
from ..media.numbering import Numbering
from ..media.sequences import pictures_of
from . import addresses
from .cache import Cache
from .options import options

STOPPED = "it was stopped"


@dataclass(frozen=True)
class Place:
    """Where jobs are done.

    Attributes:
        cache: folder of what is fetched, None for the system's; cache_bytes: that it may have.
        scratch: folder that outputs are made in which are put in their places when they are complete; None for the
            system's.
        makes_aside: whether that is so of all outputs, and not just of those at addresses.
    """

    cache: Path | None
    cache_bytes: int
    scratch: Path | None = None
    makes_aside: bool = False


@dataclass
class Staged:
    """A job's options with names of files that are here.

    Attributes:
        values: the options. folder: for whatever else.
    """

    values: dict[str, Any]
    folder: Path
    _outputs: list[tuple[str, str]] = field(default_factory=list)  # here, and where they belong

    def aside(self, name: str) -> str:
        """A name here for a file that `publish` puts in its place."""
        here = str(self.folder / str(len(self._outputs)) / (local_name(name) if is_url(name) else Path(name).name))
        os.mkdir(os.path.dirname(here))
        self._outputs.append((here, name))
        return here

    def told(self, text: str) -> str:
        """A text where outputs are called by their places."""
        for here, name in self._outputs:
            text = text.replace(here, name)
        return text

    def publish(self, stopped: Callable[[], bool]) -> None:
        """Puts all outputs that there are in their places, each whole; the first one, which the others tell of, last.

        Raises:
            RunError: one cannot be, or the job is stopped meanwhile.
        """
        for here, name in reversed(self._outputs):
            for file, place in _files(here, name):
                put(file, place, stopped)


@contextmanager
def staged(values: dict[str, Any], place: Place) -> Iterator[Staged]:
    """Fetches what a job reads from addresses, and gives what it writes names aside.

    Raises:
        InputError, RunError: something cannot be fetched, or there is no room.
    """
    cache = Cache(place.cache or user_cache_path("ar-replace", appauthor=False) / "batch", place.cache_bytes)
    with ExitStack() as held:
        try:
            folder = held.enter_context(tempfile.TemporaryDirectory(prefix="ar-batch-", dir=place.scratch))
        except OSError as error:
            raise RunError(f"cannot write to the folder for temporary files: {reason_of(error)}") from error
        here = Staged({}, Path(folder))
        for name, value in values.items():
            option = options()[name]
            if option.is_output:
                aside = place.makes_aside or is_url(value)
                here.values[name] = here.aside(value) if aside else value
            elif name == "job" and is_url(value):
                raise InputError(f"{value}: a job file must be a file, since it names others beside it")
            else:
                here.values[name] = option.renamed(
                    value, lambda file: str(held.enter_context(cache.held(file))) if is_url(file) else file
                )
        yield here


def put(file: str, place: str, stopped: Callable[[], bool] = lambda: False) -> None:
    """Copies a file to its place, whole or not at all.

    Raises:
        RunError: it cannot be, or the job is stopped meanwhile, which somebody else may be doing anew.
    """
    if is_url(place):
        if stopped():
            raise RunError(STOPPED)
        addresses.upload(file, place)
        return
    folder, name = os.path.split(place)
    part = None
    try:
        os.makedirs(folder, exist_ok=True)
        descriptor, part = tempfile.mkstemp(prefix=".ar-batch-", suffix=Path(name).suffix, dir=folder)
        with os.fdopen(descriptor, "wb") as target, open(file, "rb") as source:
            shutil.copyfileobj(source, target, 1 << 20)
            target.flush()
            os.fsync(target.fileno())
        os.chmod(part, os.stat(file).st_mode & 0o777)
        if stopped():
            raise RunError(STOPPED)
        os.replace(part, place)
        part = None
    except OSError as error:
        raise RunError(f"cannot write {place}: {reason_of(error)}") from error
    finally:
        if part is not None:
            Path(part).unlink(missing_ok=True)


def put_content(content: bytes, place: str) -> None:
    """Writes a small file in its place, whole or not at all.

    Raises:
        InputError, RunError: it cannot be.
    """
    if not is_url(place):
        write_whole(place, content)
        return
    with tempfile.NamedTemporaryFile() as file:
        file.write(content)
        file.flush()
        addresses.upload(file.name, place)


def _files(here: str, name: str) -> Iterator[tuple[str, str]]:
    """A file and its place, or those of all pictures of a sequence; none where there is no file."""
    if os.path.isfile(here):
        yield here, name
        return
    folder = name.rpartition("/")[0]
    if Numbering.parse(Path(here)) is not None:
        for picture in pictures_of(Path(here)):
            yield str(picture), f"{folder}/{picture.name}"
