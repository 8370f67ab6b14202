"""Inputs and outputs in an object store that speaks S3, a server of its own: `pip install s3fs "moto[server]"`."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import fsspec
import pytest

from ..conftest import Run
from .conftest import Write
from .processes import wait_until

pytest.importorskip("s3fs")
pytest.importorskip("moto")

pytestmark = pytest.mark.usefixtures("stand_in")

SERVER = """
import sys
from moto.server import ThreadedMotoServer
server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
server.start()
print(server.get_host_and_port()[1], flush=True)
sys.stdin.read()
"""
UPLOAD = "import sys; from ar_demo.batch.addresses import upload; upload(sys.argv[1], sys.argv[2])"


@pytest.fixture(scope="module")
def store() -> Iterator[str]:
    """Where the server listens."""
    program = [sys.executable, "-c", SERVER]
    with subprocess.Popen(program, stdin=-1, stdout=-1, stderr=subprocess.DEVNULL, text=True) as server:
        assert server.stdout is not None
        port = server.stdout.readline().strip()
        address = f"http://127.0.0.1:{port}"
        with urlopen(f"{address}/moto-api/") as answer:
            assert answer.status == 200
        yield address
        server.kill()


@pytest.fixture
def s3(store: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The store with an empty bucket, as users' environment names it."""
    for name, value in {
        "AWS_ENDPOINT_URL": store,
        "AWS_ACCESS_KEY_ID": "a",
        "AWS_SECRET_ACCESS_KEY": "b",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_EC2_METADATA_DISABLED": "true",
    }.items():
        monkeypatch.setenv(name, value)
    system = fsspec.filesystem("s3", skip_instance_cache=True, use_listings_cache=False)
    system.mkdir("bucket")
    yield system
    system.rm("bucket", recursive=True)


def test_a_batch_reads_and_writes_a_bucket(run: Run, write: Write, tmp_path: Path, s3: Any) -> None:
    s3.pipe_file("bucket/in/a.mp4", b"a video in a bucket")
    job = {"input": "s3://bucket/in/a.mp4", "output": "s3://bucket/out/{clip}.mp4"}
    options = "--cache", tmp_path / "cache", "--quiet"
    assert run(write(job), *options)[0] == 0
    assert s3.cat("bucket/out/a.mp4") == b"a video in a bucket\na picture\n"
    assert sorted(s3.find("bucket/out")) == [f"bucket/out/a.mp4{ending}" for ending in ("", ".json", ".log")]

    status, out, _ = run(write(job), *options, "--json")
    assert status == 0
    assert '"kept"' in out
    s3.pipe_file("bucket/in/a.mp4", b"another video")
    assert run(write(job), *options)[0] == 0
    assert s3.cat("bucket/out/a.mp4") == b"another video\na picture\n"


def test_an_upload_that_is_killed_leaves_no_half_object(tmp_path: Path, s3: Any) -> None:
    file = tmp_path / "o.mp4"
    file.write_bytes(bytes(120 << 20))  # is sent in several parts
    s3.pipe_file("bucket/o.mp4", b"the one before")
    upload = [sys.executable, "-c", UPLOAD, file, "s3://bucket/o.mp4"]
    with subprocess.Popen(upload, env=dict(os.environ)) as process:
        wait_until(lambda: bool(s3.call_s3("list_multipart_uploads", Bucket="bucket").get("Uploads")))
        process.kill()
    assert process.returncode == -signal.SIGKILL
    assert s3.find("bucket") == ["bucket/o.mp4"]
    assert s3.cat("bucket/o.mp4") == b"the one before"
