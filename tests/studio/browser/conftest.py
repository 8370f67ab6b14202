"""Studio as a person uses it: its server as a process of its own, and Chromium."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from ...clips import make_clip, number_image
from ...scenes import Scene, path, texture
from .person import Person

WIDTH, HEIGHT, FRAMES, STRIP = 640, 360, 40, 24
REPOSITORY = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with street.mp4, whose frames tell their number in a strip at the bottom, and ad.png."""
    folder = tmp_path_factory.mktemp("shot")
    scene = Scene(WIDTH, HEIGHT)
    scene.quad = np.array([[220.0, 90], [430, 97], [424, 250], [226, 240]])
    images = [scene.draw(corners) for corners in path(scene.quad, FRAMES)]
    for number, image in enumerate(images):
        image[-STRIP:] = number_image(number, WIDTH, STRIP)
    make_clip(folder / "street.mp4", images, rate=25, options={"crf": "16"})
    cv2.imwrite(str(folder / "ad.png"), texture(7, 300, 200))
    return folder


@dataclass
class Server:
    """A server that runs, and what a browser needs to be let in again."""

    root: Path
    address: str
    admission: Any


@pytest.fixture(scope="module")
def server(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """ar-studio for the tests of a file, at most eight, each of which has a folder of its own below its root."""
    root = tmp_path_factory.mktemp("root")
    code = "from ar_demo.cli.entry import studio_main; studio_main()"
    command = [sys.executable, "-c", code, "--root", str(root), "--no-browser"]
    environment = {"PYTHONPATH": str(REPOSITORY)} | dict(os.environ)
    with subprocess.Popen(command, cwd=root, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address is not None
        context = browser.new_context()
        page = context.new_page()
        page.goto(address.group())
        page.get_by_role("button", name="Open a video…").wait_for()
        yield Server(root, page.url, context.storage_state())
        process.terminate()


@pytest.fixture
def folder(shot: Path, server: Server, request: pytest.FixtureRequest) -> Path:
    """A folder of the test's own, with the video and the ad."""
    return Path(shutil.copytree(shot, server.root / re.sub(r"\W+", "_", request.node.name)))


@pytest.fixture
def visit(browser: Any, server: Server, folder: Path) -> Iterator[Callable[..., Person]]:
    """Opens the folder's video, with its ad or without; options are the browser's."""
    contexts = []

    def call(ad: bool = True, **options: Any) -> Person:
        usual = {"viewport": {"width": 1366, "height": 768}, "accept_downloads": True}
        context = browser.new_context(storage_state=server.admission, **usual | options)
        contexts.append(context)
        return Person(context, server.address, _open(context, server, folder.name, ad), (WIDTH, HEIGHT), STRIP)

    yield call
    for context in contexts:
        context.close()


def _open(context: Any, server: Server, folder: str, ad: bool) -> str:
    """Opens a project as the page does; its id."""

    def ask(path: str, content: Any = None, method: str = "POST") -> Any:
        headers = {"origin": server.address.rstrip("/")}
        url = f"{server.address}api/{path}"
        answer = context.request.fetch(url, method=method, data=content, headers=headers)
        assert answer.ok, answer.text()
        return answer.json()

    def one(kind: str) -> str:
        folders = ask(f"files?kind={kind}", method="GET")["folders"]
        id = next(f["id"] for f in folders if f["name"] == folder)
        files = ask(f"files?kind={kind}&folder={id}", method="GET")["files"]
        return str(next(f["id"] for f in files if f["name"] == {"video": "street.mp4", "ad": "ad.png"}[kind]))

    project = ask("projects", {"video": one("video")})
    if ad:
        changed = project | {"surfaces": [{"ad": one("ad")}]}
        ask(f"projects/{project['id']}", changed, "PUT")
    return str(project["id"])
