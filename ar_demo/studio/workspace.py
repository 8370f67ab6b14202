"""What a server has open: files that the page may name, and projects."""

import logging
from collections.abc import AsyncIterator
from fractions import Fraction
from pathlib import Path
from threading import Lock
from typing import Any

from ..cli.defaults import Defaults
from ..cli.jobs import load_job
from ..errors import InputError
from ..media.ad import open_ad
from ..media.claims import Claim, free_name
from .errors import Refusal
from .files import ENDINGS, Files
from .pictures import scaled, webp
from .project import Project, job_file_of

log = logging.getLogger(__name__)

MOST_PROJECTS = 8  # that are open at once
MOST_UPLOAD_BYTES = 2 << 30


class Workspace:
    """Files and projects of one server. Its methods may be called from any thread.

    Attributes:
        files: by their ids.
        projects: by their ids, in the order in which they were opened.
    """

    def __init__(self, folder: Path, root: Path | None, defaults: Defaults) -> None:
        """Args:
        folder: where files from the page are put.
        root: the folder whose files the page may choose; None for none but those that are named.
        """
        self.files = Files(root)
        self.projects: dict[str, Project] = {}
        self._folder, self._defaults = folder, defaults
        self._opening = Lock()

    def close(self) -> None:
        """Closes all projects; calling again does nothing."""
        while self.projects:
            self.projects.popitem()[1].close()

    def open(self, path: Path, ad: Path | None = None) -> Project:
        """Opens a video, or the job file of one; the same project where it is open already.

        Args:
            ad: of the first surface.

        Raises:
            InputError: it cannot be read.
            Refusal: too many are open.
        """
        with self._opening:
            video, job_file = _parts(path)
            for project in self.projects.values():
                if project.job_file.resolve() == job_file.resolve():
                    return project
            if len(self.projects) >= MOST_PROJECTS:
                raise Refusal(429, f"{MOST_PROJECTS} videos are open already: start ar-studio anew for more")
            self.files.admit(video)
            project = Project(video, job_file, self.files, self._defaults, ad)
            self.projects[project.id] = project
            return project

    def project(self, id: str) -> Project:
        """An open project.

        Raises:
            Refusal: there is none of this id.
        """
        if id not in self.projects:
            raise Refusal(404, "this project is not open any more: open it anew")
        return self.projects[id]

    def output(self, id: str) -> Path:
        """A file that was rendered.

        Raises:
            Refusal: there is none of this id.
        """
        for project in self.projects.values():
            if (path := project.outputs.get(id)) is not None and path.is_file():
                return path
        raise Refusal(404, "this file is not there any more: render it anew")

    async def take(self, name: str, size: int | None, chunks: AsyncIterator[bytes]) -> dict[str, Any]:
        """Keeps a file from the page, an ad, beside the videos; a free name is found for it.

        Raises:
            Refusal: it is too large, or no ad.
        """
        name = Path(name.replace("\\", "/")).name.lstrip(".")
        if not name.lower().endswith(ENDINGS["ad"]) or "\0" in name:
            raise Refusal(415, "this is no ad that can be shown: give a picture or a video", "ad")
        if size is not None and size > MOST_UPLOAD_BYTES:
            raise _too_large()
        path = free_name(self._folder / name)
        try:
            with Claim(path) as claim:
                with claim.part.open("wb") as file:
                    async for chunk in chunks:
                        if file.tell() + len(chunk) > MOST_UPLOAD_BYTES:
                            raise _too_large()
                        file.write(chunk)
                open_ad(claim.part).close()
                claim.finish()
        except InputError as error:
            raise Refusal(415, str(error).replace(str(claim.part), name), "ad") from error
        self.files.admit(path)
        return self.files.entry(path)

    def picture(self, id: str, height: int | None) -> bytes:
        """The first frame of an ad, or of a video, as WebP with its transparency.

        Raises:
            Refusal: there is no such file.
            InputError: it cannot be read.
        """
        with open_ad(self.files.path(id)) as ad:
            image = ad.at(Fraction(0))
        assert image is not None
        return webp(scaled(image, height))


def _parts(path: Path) -> tuple[Path, Path]:
    """The video and the job file of what is to be opened."""
    if path.suffix.lower() != ".json":
        return path, job_file_of(path)
    video = load_job(path).input
    if not isinstance(video, Path):
        raise InputError(f"{path} names no video on this machine: give it as input in the job file")
    return video, path


def _too_large() -> Refusal:
    return Refusal(413, f"this file has more than {MOST_UPLOAD_BYTES >> 30} GB: give a smaller one", "ad")
