"""The jobs that a manifest stands for."""

import glob
import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from ..cli.jobs import load_job
from ..errors import InputError
from ..media.download import is_url, local_name
from ..pipeline import default_output
from .documents import Document, Keys
from .manifest import MANY, Manifest
from .options import command, options

LONGEST_NAME = 255  # bytes
MOST_JOBS = 100_000
IN_A_JOB = ("input", "output", "layer", "save_matte", "save_track")  # that a job file can name


@dataclass(frozen=True)
class Job:
    """One output, made by one process.

    Attributes:
        number: in the batch, from 1.
        values: options of `ar-replace` by their names, as they were checked; names of files are whole.
        retries, time_limit, memory_limit: as the manifest says: times, seconds, bytes; None where it does not.
        keys: where in the manifest it stands.
    """

    number: int
    values: Mapping[str, Any]
    retries: int | None = None
    time_limit: float | None = None
    memory_limit: int | None = None
    keys: Keys = ()

    @property
    def outputs(self) -> dict[str, str]:
        """What it writes, by the options' names; the video, or what there is in its place, first."""
        return {
            name: str(self.values[name])
            for name, option in options().items()
            if option.is_output and name in self.values
        }

    @property
    def name(self) -> str:
        """What it is called by: the first of its outputs."""
        return next(iter(self.outputs.values()))

    @property
    def arguments(self) -> list[str]:
        """Of `ar-replace`."""
        return command(self.values)


def expand(manifest: Manifest, document: Document, check: Callable[[str], None] = lambda name: None) -> list[Job]:
    """The jobs of a manifest, in their order: `jobs`, then each clip with each ad.

    Args:
        check: raises InputError for a name, or a glob, that is not to be looked for.

    Raises:
        InputError: there are none, or too many; a glob that nothing fits; an unknown place in a name; two outputs of
            one name. The message has line and column.
    """
    if manifest.ads and not manifest.clips:
        raise document.wrong(("ads",), "there are ads, but no clips")
    jobs: list[Job] = []
    for keys, values in _entries(manifest):
        if "input" not in values and "job" not in values:
            raise document.wrong(keys, "it has no input: name the video")
        many = [_matching(document, (*keys, name), values.get(name), check) for name in MANY]
        for chosen in product(*many):
            if len(jobs) == MOST_JOBS:
                raise document.wrong(keys, f"these are more than {MOST_JOBS} jobs: split the manifest")
            said = values | {name: one for name, one in zip(MANY, chosen, strict=True) if one is not None}
            jobs.append(_job(len(jobs) + 1, said, document, keys, check))
    if not jobs:
        raise InputError(f"{document.path} has no jobs: give jobs, or clips and ads")
    _check_different(jobs, document)
    return jobs


def _entries(manifest: Manifest) -> Iterator[tuple[Keys, dict[str, Any]]]:
    """What each job says, and where it does."""
    defaults, clips, jobs = (_said(entries) for entries in ([manifest.defaults], manifest.clips, manifest.jobs))
    ads = _said(manifest.ads) or [{}]
    for index, job in enumerate(jobs):
        yield ("jobs", index), defaults[0] | job
    for (index, clip), ad in product(enumerate(clips), ads):
        yield ("clips", index), defaults[0] | clip | ad


def _said(entries: list[Any]) -> list[dict[str, Any]]:
    return [entry.model_dump(exclude_unset=True) for entry in entries]


def _matching(
    document: Document, keys: Keys, names: str | list[str] | None, check: Callable[[str], None]
) -> list[str | None]:
    """The files that an input or an ad stands for; addresses as they are, [None] for nothing."""
    if names is None:
        return [None]
    found: list[str | None] = []
    for name in [names] if isinstance(names, str) else names:
        try:
            path = Path(_checked(document, name, check))
        except InputError as error:
            raise document.wrong(keys, str(error)) from error
        if is_url(name) or not glob.has_magic(name) or path.exists():
            found.append(name)
            continue
        fitting = sorted(glob.glob(str(path), recursive=True))
        if not fitting:
            raise document.wrong(keys, f"there is no file {name}")
        found += fitting
    return found


def _job(number: int, said: dict[str, Any], document: Document, keys: Keys, check: Callable[[str], None]) -> Job:
    own = {name: said.pop(name) for name in ("retries", "time_limit", "memory_limit") if name in said}
    names = {
        "clip": _stem(said.get("input", "")),
        "ad": _stem(said.get("ad") or said.get("effect", "")),
        "number": str(number),
    }
    for name, option in options().items():
        if name in said:
            try:
                filled = _filled(said[name], names) if option.is_path and name not in MANY else said[name]
                said[name] = option.renamed(filled, lambda file: _checked(document, file, check))
            except InputError as error:
                raise document.wrong((*keys, name), str(error)) from error
    if "job" in said:
        try:
            job = load_job(Path(said["job"]))
        except InputError as error:
            raise document.wrong((*keys, "job"), str(error)) from error
        in_job = {name: getattr(job, name) for name in IN_A_JOB}
        said = {name: str(file) for name, file in in_job.items() if file is not None} | said
    if "input" not in said:
        raise document.wrong(keys, "it has no input: name the video")
    if not any(name in said for name in ("output", "layer", "save_matte")):
        if is_url(said["input"]):
            raise document.wrong(keys, f"{said['input']} has no folder for its output: name one")
        said["output"] = str(default_output(said["input"]))
    return Job(number, said, keys=keys, **own)


def _checked(document: Document, name: str, check: Callable[[str], None]) -> str:
    """An address as it is, or the name of a file beside the manifest from the root on.

    Raises:
        InputError: it is not to be looked for, or there can be no such name.
    """
    if not is_url(name):
        name = os.path.abspath(document.path.parent.absolute() / name)
        if name.encode(errors="replace").decode() != name:
            raise InputError(f"the name {name!a} is not UTF-8: rename it")
        if any(len(os.fsencode(part)) > LONGEST_NAME for part in Path(name).parts):
            raise InputError(f"the name {name[:40]}... has more than {LONGEST_NAME} bytes: choose a shorter one")
    check(name)
    return name


def _stem(name: str) -> str:
    return Path(local_name(name) if is_url(name) else name).stem


def _filled(pattern: str, names: Mapping[str, str]) -> str:
    """A name with what its places in braces stand for."""

    def value(match: re.Match[str]) -> str:
        if match[1] not in names:
            raise InputError(f"{{{match[1]}}} is unknown: there are {', '.join(f'{{{name}}}' for name in names)}")
        return names[match[1]]

    return re.sub(r"\{([^{}]*)\}", value, pattern)


def _check_different(jobs: list[Job], document: Document) -> None:
    """Raises InputError where two jobs would write to one file."""
    taken: dict[str, Job] = {}
    for job in jobs:
        for output in job.outputs.values():
            if output in taken:
                other = taken[output].number
                message = f"jobs {other} and {job.number} would both write {output}"
                raise document.wrong(job.keys, f"{message}: give each its own, as {{clip}}.{{ad}}.mp4")
            taken[output] = job
