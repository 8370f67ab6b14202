"""A server with a small clip and an ad, spoken to as the page does."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import httpx2
import pytest
from starlette.testclient import TestClient, WebSocketTestSession

from ar_demo.cli.defaults import Defaults
from ar_demo.studio.app import application
from ar_demo.studio.project import Project
from ar_demo.studio.security import Admission
from ar_demo.studio.workspace import Workspace

from ..clips import make_clip
from ..scenes import Scene, path, texture

FRAMES = 16
ORIGIN = "http://127.0.0.1"


@dataclass
class Studio:
    """A server and a browser that it let in.

    Attributes:
        folder: with street.mp4 and ad.png.
    """

    folder: Path
    workspace: Workspace
    admission: Admission
    page: TestClient
    project: Project

    @property
    def url(self) -> str:
        return f"/api/projects/{self.project.id}"

    def get(self, path: str = "", **query: Any) -> httpx2.Response:
        return self.page.get(self.url + path, params=query)

    def post(self, path: str, content: Any = None) -> httpx2.Response:
        return self.page.post(self.url + path, json=content or {})

    @property
    def content(self) -> dict[str, Any]:
        content: dict[str, Any] = self.get().json()
        return content

    def put(self, **changes: Any) -> httpx2.Response:
        """Changes the project; `surface` changes its first surface."""
        content = self.content
        content["surfaces"][0] |= changes.pop("surface", {})
        return self.page.put(self.url, json=content | changes)

    def socket(self, page: TestClient | None = None, origin: str = ORIGIN) -> WebSocketTestSession:
        """The project's events."""
        url = f"ws{ORIGIN.removeprefix('http')}{self.url}/events"
        return (page or self.page).websocket_connect(url, headers={"origin": origin})

    def finish(self) -> dict[str, Any]:
        """Waits for the task that is under way."""
        self.project.tasks.wait()
        task: dict[str, Any] = self.content["task"]
        return task


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip of a poster on a wall."""
    scene = Scene()
    images = [scene.draw(corners) for corners in path(scene.quad, FRAMES)]
    return make_clip(tmp_path_factory.mktemp("street") / "street.mp4", images, rate=25)


@pytest.fixture
def folder(tmp_path: Path, street: Path) -> Path:
    """A folder with a video and an ad."""
    folder = tmp_path / "shots"
    folder.mkdir()
    (folder / "street.mp4").write_bytes(street.read_bytes())
    cv2.imwrite(str(folder / "ad.png"), texture(2, 80, 60))
    return folder


@pytest.fixture
def studio(folder: Path) -> Iterator[Studio]:
    """Studio with the video, the ad and the folder as its root."""
    workspace, admission = Workspace(folder, folder, Defaults()), Admission()
    page = TestClient(application(workspace, admission), ORIGIN, headers={"origin": ORIGIN})
    page.get("/", params={"token": admission.token}, follow_redirects=False)
    project = workspace.open(folder / "street.mp4", folder / "ad.png")
    yield Studio(folder, workspace, admission, page, project)
    workspace.close()
