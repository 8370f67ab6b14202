"""What jobs may touch, where their manifest comes from others."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from ..cli.jobs import load_job
from ..errors import InputError
from ..media.download import is_url
from ..media.sequences import pictures_of
from .jobs import Job
from .options import options

SCHEMES = ("https", "s3", "gs")


@dataclass(frozen=True)
class Bounds:
    """Where files and addresses of jobs may lie.

    Attributes:
        root: folder that all files must be in, links followed; None for anywhere.
        schemes: what addresses may begin with.
    """

    root: Path | None = None
    schemes: tuple[str, ...] = SCHEMES

    def check(self, job: Job) -> None:
        """Raises InputError for a job that reads or writes elsewhere."""
        for name in _names(job):
            self.check_name(name)

    def check_name(self, name: str) -> None:
        """Raises InputError for an address, a file, pictures or a glob that lie elsewhere."""
        if is_url(name):
            scheme = urlsplit(name).scheme.lower()
            if scheme not in self.schemes:
                raise InputError(
                    f"{name}: {scheme}:// is not allowed: there are {', '.join(self.schemes)}; see --schemes"
                )
        elif self.root is not None:
            root = Path(os.path.realpath(self.root))
            for file in (Path(name), *pictures_of(Path(name))):
                if not Path(os.path.realpath(file)).is_relative_to(root):
                    raise InputError(f"{name} leads out of {self.root}: see --root")


def _names(job: Job) -> Iterator[str]:
    """All files and addresses that a job reads or writes."""
    for name, value in job.values.items():
        yield from options()[name].files(value)
    if "job" in job.values:
        yield from map(str, load_job(Path(job.values["job"])).files)
