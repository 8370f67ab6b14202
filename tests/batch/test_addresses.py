"""Inputs and outputs at addresses: fetched to a cache of bounded size, and written whole."""

import json
import threading
from collections.abc import Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import fsspec
import pytest

from ar_demo.batch import addresses
from ar_demo.batch.cache import Cache
from ar_demo.batch.staging import put
from ar_demo.errors import InputError, RunError

from ..conftest import Run
from .conftest import Write

pytestmark = pytest.mark.usefixtures("stand_in")


@pytest.fixture
def memory() -> Iterator[Any]:
    """Stands for an object store."""
    system = fsspec.filesystem("memory")
    yield system
    system.store.clear()


def serve(handler: Any) -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *message: Any) -> None: ...


class Endless(BaseHTTPRequestHandler):
    def log_message(self, *message: Any) -> None: ...

    def do_HEAD(self) -> None:
        self.send_response(200)
        self.end_headers()

    def do_GET(self) -> None:
        self.do_HEAD()
        try:
            while True:
                self.wfile.write(bytes(1 << 16))
        except OSError:
            return


@pytest.fixture
def site(tmp_path: Path) -> Iterator[str]:
    (tmp_path / "site").mkdir()
    yield from serve(partial(Quiet, directory=str(tmp_path / "site")))


@pytest.fixture
def endless() -> Iterator[str]:
    yield from serve(Endless)


def test_inputs_and_outputs_at_addresses(run: Run, write: Write, tmp_path: Path, memory: Any, site: str) -> None:
    memory.pipe_file("/in/a.mp4", b"a video from afar")
    (tmp_path / "site" / "b.png").write_text("a picture of the web")
    job = {"input": "memory://in/a.mp4", "ad": f"{site}/b.png", "output": "memory://out/{clip}.{ad}.mp4"}
    options = "--schemes", "memory,http", "--cache", tmp_path / "cache", "--quiet"
    assert run(write(job), *options)[0] == 0
    assert memory.cat("/out/a.b.mp4") == b"a video from afar\na picture of the web\n"
    assert memory.cat("/out/a.b.mp4.log") == b""
    assert json.loads(memory.cat("/out/a.b.mp4.json"))["result"]["states"] == {"tracked": 3, "lost": 1}
    assert sorted(memory.find("/out")) == [f"/out/a.b.mp4{ending}" for ending in ("", ".json", ".log")]

    status, out, _ = run(write(job), *options, "--json")
    assert (status, json.loads(out)["jobs"][0]["ended"]) == (0, "kept")
    memory.pipe_file("/in/a.mp4", b"another video")
    assert run(write(job), *options)[0] == 0
    assert memory.cat("/out/a.b.mp4").startswith(b"another video")

    memory.pipe_file("/out/a.b.mp4", b"somebody else's")
    memory.pipe_file("/in/a.mp4", b"a third one")
    assert run(write(job), *options)[0] == 1
    assert memory.cat("/out/a.b.mp4") == b"somebody else's"


def test_what_is_not_there_is_wrong_input(run: Run, write: Write, tmp_path: Path, memory: Any, site: str) -> None:
    jobs = {"input": "memory://in/none.mp4"}, {"ad": f"{site}/none.png"}, {"ad": "s3://bucket/none.png"}
    options = "--schemes", "memory,http,s3", "--cache", tmp_path / "cache", "--quiet", "--json"
    status, out, _ = run(write(*jobs), *options)
    found = {job["number"]: (job["ended"], job["message"]) for job in json.loads(out)["jobs"]}
    assert status == 1
    assert found[1] == ("wrong", "there is no memory://in/none.mp4: check the address")
    assert found[2] == ("wrong", f"there is no {site}/none.png: check the address")
    assert found[3][0] == "wrong"
    assert "cannot reach s3://bucket/none.png (Install s3fs" in found[3][1]


def test_a_server_that_is_gone_is_a_failure(run: Run, write: Write, tmp_path: Path) -> None:
    options = "--schemes", "http", "--cache", tmp_path / "cache", "--quiet", "--json"
    status, out, _ = run(write({"ad": "http://127.0.0.1:9/a.png"}), *options)
    [job] = json.loads(out)["jobs"]
    assert (status, job["ended"]) == (1, "failed")
    assert "cannot reach http://127.0.0.1:9/a.png" in job["message"]


def test_the_cache_keeps_what_fits(tmp_path: Path, memory: Any) -> None:
    for name in "abcd":
        memory.pipe_file(f"/in/{name}.mp4", name.encode() * 40)
    cache = Cache(tmp_path / "cache", 100)

    def held() -> set[str]:
        return {file.name for file in (tmp_path / "cache").rglob("*.mp4")}

    with cache.held("memory://in/a.mp4") as a, cache.held("memory://in/b.mp4") as b:
        assert (a.read_text(), b.read_text()) == ("a" * 40, "b" * 40)
        with pytest.raises(RunError, match="are in use: see --cache-size"), cache.held("memory://in/c.mp4"):
            pass
    assert held() == {"a.mp4", "b.mp4"}
    with cache.held("memory://in/a.mp4"), cache.held("memory://in/c.mp4"):  # b has been used longest ago
        assert held() == {"a.mp4", "c.mp4"}
    memory.pipe_file("/in/a.mp4", b"new")
    with cache.held("memory://in/a.mp4") as a:
        assert a.read_text() == "new"
    memory.pipe_file("/in/d.mp4", bytes(101))
    with pytest.raises(InputError, match="see --cache-size"), cache.held("memory://in/d.mp4"):
        pass


def test_an_answer_without_end_is_bounded(tmp_path: Path, endless: str) -> None:
    with (
        pytest.raises(InputError, match="is larger than the cache may be"),
        Cache(tmp_path / "cache", 1 << 20).held(f"{endless}/a.mp4"),
    ):
        pass
    assert not list((tmp_path / "cache").rglob("*.mp4"))


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "o.mp4").write_text("new")
    target = tmp_path / "out" / "o.mp4"
    addresses.upload(str(tmp_path / "o.mp4"), f"local://{target}")
    assert [path.read_text() for path in target.parent.iterdir()] == ["new"]

    def fail(*files: Any) -> None:
        raise OSError(28, "no space left on device")

    monkeypatch.setattr("shutil.copyfileobj", fail)
    with pytest.raises(RunError, match="no space left"):
        put(str(tmp_path / "o.mp4"), str(tmp_path / "out" / "p.mp4"))
    assert [path.name for path in target.parent.iterdir()] == ["o.mp4"]
