"""What tells jobs from each other: the contents of what goes in, all options, and the program's version."""

import hashlib
import json
import os
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..cli.defaults import load_defaults
from ..cli.jobs import load_job
from ..media.download import is_url
from ..media.sequences import pictures_of
from . import addresses
from .jobs import Job
from .options import options
from .state import State

_BLOCK_BYTES = 1 << 20

# Of a job with a quad: what its track is made with. The same with others gives the same track.
TRACKING = ("quad", "snap", "region", "exclude", "start", "keyframe", "time", "smooth", "fps", "device", "weights")
# Where a track is given, it has these.
OF_A_TRACK = tuple(name for name in TRACKING if name not in ("time", "fps"))
# With one of these there are several surfaces, a track already, or one that says how long the output is.
WITHOUT_TRACK = ("surface", "job", "track", "end", "find")


# What changes nothing of an output that there is.
WITHOUT_EFFECT = ("overwrite", "max_frames", "max_pixels")


def identity(job: Job, state: State) -> str:
    """Of a job: 32 hexadecimal digits, which change with whatever can change its outputs."""
    return _digest({"job": _contents(job.values, state), "outputs": job.outputs})


def track_key(job: Job, state: State) -> str | None:
    """Of the track that a job makes on its way; None where it makes none that others can use."""
    if "quad" not in job.values or any(name in job.values for name in WITHOUT_TRACK):
        return None
    named = {name: job.values[name] for name in ("input", *TRACKING) if name in job.values}
    return _digest({"track": _contents(named, state)})


def stamp(path: str) -> str:
    """What changes when a file, or pictures of a sequence, are written; '' where there is none.

    Raises:
        InputError, RunError: it is at an address that cannot be reached.
    """
    if is_url(path):
        return addresses.facts(path)
    found = [Path(path)] if os.path.isfile(path) else sorted(pictures_of(Path(path)))
    try:
        stats = [file.stat() for file in found]
    except OSError:
        return ""
    if not stats:
        return ""
    return f"{len(stats)} files, {sum(s.st_size for s in stats)} bytes, {max(s.st_mtime_ns for s in stats)} ns"


def _digest(content: Any) -> str:
    said = json.dumps([_version(), _defaults(), content], sort_keys=True, default=str)
    return hashlib.sha256(said.encode()).hexdigest()[:32]


@cache
def _version() -> str:
    return version("ar-replace")


@cache
def _defaults() -> str:
    """Those of the person who runs it, which change the outputs, too."""
    return str(sorted(load_defaults().values.items()))


def _contents(values: Mapping[str, Any], state: State) -> dict[str, Any]:
    """Options where names of files that are read stand for what is in them."""
    said = {
        name: value for name, value in values.items() if not options()[name].is_output and name not in WITHOUT_EFFECT
    }
    for name, value in said.items():
        said[name] = options()[name].renamed(value, lambda file: _content(file, state))
    if "job" in values:
        said["files"] = [_content(str(file), state) for file in load_job(Path(values["job"])).files]
    return said


def _content(name: str, state: State) -> str:
    """What is in a file, or in all pictures of a sequence; of an address what is told of it."""
    if is_url(name):
        return f"{name} {addresses.facts(name)}"
    if os.path.isfile(name):
        return _of_file(name, state)
    return (
        " ".join(f"{file.name} {_of_file(str(file), state)}" for file in sorted(pictures_of(Path(name)))) or "missing"
    )


def _of_file(name: str, state: State) -> str:
    """The digest of a file; worked out once for as long as it is not changed."""
    now = stamp(name)
    known = state.digest(name, now)
    if known is None:
        total = hashlib.sha256()
        try:
            with open(name, "rb") as file:
                while block := file.read(_BLOCK_BYTES):
                    total.update(block)
        except OSError:
            return "unreadable"
        known = total.hexdigest()
        state.keep_digest(name, now, known)
    return known
