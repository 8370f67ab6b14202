"""Videos at http addresses: fetched whole, whatever the server can do, or refused in one line that says what to do."""

import shutil
from collections.abc import Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest

from ar_demo.errors import InputError, RunError
from ar_demo.media.download import Download, is_url, local_name
from ar_demo.media.reader import VideoReader
from ar_demo.tracks import Track

from .. import clips
from ..conftest import Run
from ..scenes import Scene, path
from ..videos import numbers


class Server(ThreadingHTTPServer):
    """Serves one content under any name; what the name begins with says how."""

    content = b""
    asked = 0


KINDS = {"page": "text/html", "playlist": "application/vnd.apple.mpegurl", "camera": "multipart/x-mixed-replace"}


class Handler(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        server: Server = self.server  # type: ignore[assignment]
        server.asked += 1
        way, content = self.path.split("/")[1], server.content
        if way == "gone":
            self.send_error(404)
            return
        if way == "moved":
            self.send_response(302)
            self.send_header("Location", "/plain/clip.mp4")
            self.end_headers()
            return
        self.send_response(200)
        self.send_header("Content-Type", KINDS.get(way, "video/mp4"))
        if way != "unknown":  # a server that does not say how long it is, and ends by closing
            self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        with suppress(ConnectionError):  # of who has had enough
            self.wfile.write(content[: len(content) // 2] if way == "short" else content)

    def log_message(self, *arguments: object) -> None: ...


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server(("127.0.0.1", 0), Handler)
    thread = Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.server_close()
    thread.join()


def address(server: Server, name: str) -> str:
    return f"http://127.0.0.1:{server.server_port}/{name}"


@pytest.mark.parametrize("name", ["plain/clip.mp4", "plain/a%20clip.mp4?token=x*y", "unknown/clip.mp4", "moved/x"])
def test_a_video_at_an_address_is_read_as_a_file_is(server: Server, tmp_path: Path, name: str) -> None:
    server.content = clips.make_clip(tmp_path / "in.mp4", clips.numbered(30)).read_bytes()
    with VideoReader(address(server, name)) as reader:
        assert numbers(reader.frames()) == list(range(30))
        assert numbers(reader.backward(30)) == list(range(30))[::-1]
        asked = server.asked
        with VideoReader(address(server, name)) as second:  # which does not fetch it again
            assert numbers(second.frames(20)) == list(range(20, 30))
        assert server.asked == asked
        file = reader.path
        assert file.exists()
    del reader, second
    assert not file.exists()


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("gone/clip.mp4", "404"),
        ("page/watch", "web page"),
        ("playlist/a.m3u8", "--live"),
        ("camera/1", "--live"),
    ],
)
def test_what_is_no_file_is_refused_in_one_line(server: Server, name: str, told: str) -> None:
    server.content = b"something"
    with pytest.raises(InputError, match=told) as caught:
        VideoReader(address(server, name))
    assert address(server, name) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_failures_say_what_to_do(server: Server, tmp_path: Path) -> None:
    server.content = clips.make_clip(tmp_path / "in.mp4", clips.numbered(3)).read_bytes()
    with pytest.raises(RunError, match="broke off"):
        VideoReader(address(server, "short/clip.mp4"))
    with pytest.raises(InputError, match="--live"):
        VideoReader("rtsp://127.0.0.1/camera")
    port = server.server_port
    server.shutdown()
    server.server_close()
    with pytest.raises((InputError, RunError), match="cannot fetch"):
        VideoReader(f"http://127.0.0.1:{port}/clip.mp4")


def test_an_answer_without_end_does_not_fill_the_disk(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    server.content = bytes(8 << 20)
    room = shutil.disk_usage("/")
    free = iter([1 << 40, (1 << 28) + 1, (1 << 28) - 1])
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: room._replace(free=next(free)))
    with pytest.raises(RunError, match="has no end, or there is no room for it"):
        Download(address(server, "unknown/clip.mp4"))


def test_names() -> None:
    assert is_url("https://example.com/a.mp4")
    assert not is_url("C:/a.mp4")
    assert not is_url(Path("a.mp4"))
    assert local_name("http://h/a/b%20c.mp4?x=1") == "b c.mp4"
    assert local_name("http://h/..") == "video"
    assert local_name("http://h/") == "video"


@pytest.mark.usefixtures("shared_networks")
def test_the_commands_take_addresses(server: Server, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene()
    server.content = clips.make_clip(
        tmp_path / "in.mp4", [scene.draw(quad) for quad in path(scene.quad, 6)]
    ).read_bytes()
    monkeypatch.chdir(tmp_path)
    url = address(server, "plain/street.mp4?id=1")
    corners = [f"{x},{y}" for x, y in scene.quad]
    status, _, err = run(url, "--effect", "blur", "--quad", *corners, "--save-track", "t.json")
    assert (status, "http:/1" in err) == (0, False)
    assert len(clips.frame_times(tmp_path / "street.ar.mp4")) == 6
    assert Track.load(tmp_path / "t.json").source.path == url
    assert not Download._held
