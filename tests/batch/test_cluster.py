"""A Dask cluster of real processes on this machine: workers that are killed, a scheduler restarted, full disks."""

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ar_demo.batch.cluster import ClusterModel, work
from ar_demo.batch.staging import Place
from ar_demo.batch.task import Task

from ..conftest import Run
from .conftest import Write
from .processes import children_of_the_batch, fork_batch, status_of, wait_until

JOBS = 10
HERE = Path(__file__).parent
Process = subprocess.Popen[bytes]


class Cluster:
    """A scheduler and workers, as users start them."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        self.folder = folder
        self.processes: list[Process] = []
        self.scheduler = self.start_scheduler()

    def start_scheduler(self) -> Process:
        port = self.address.rpartition(":")[2]
        return self._start("dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")

    def start_worker(self, *options: str) -> Process:
        usual = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1", "--memory-limit", "0")
        places = ("--local-directory", str(self.folder), "--preload", str(HERE / "preload.py"))
        return self._start("dask_worker", self.address, *usual, *places, *options)

    def close(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()

    def _start(self, module: str, *arguments: str) -> Process:
        settings = {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "1 hour", "STAND_IN": str(HERE / "stand_in.py")}
        log = (self.folder / "cluster.log").open("ab")
        words = [sys.executable, "-m", f"distributed.cli.{module}", *arguments]
        process = subprocess.Popen(words, stdout=log, stderr=log, stdin=subprocess.DEVNULL, env=os.environ | settings)
        self.processes.append(process)
        return process


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """With two workers."""
    cluster = Cluster(tmp_path_factory.mktemp("cluster"))
    try:
        cluster.start_worker()
        cluster.start_worker("--resources", "GPU=1")
        yield cluster
    finally:
        cluster.close()


def endings(folder: Path) -> list[str]:
    content = json.loads((folder / "jobs.batch" / "summary.json").read_text())
    return sorted(job["ended"] for job in content["jobs"])


def test_jobs_are_done_by_workers(run: Run, write: Write, tmp_path: Path, cluster: Cluster) -> None:
    manifest = write({}, {"codec": "fail-once"}, {"codec": "wrong"})
    status, out, _ = run(manifest, "--scheduler", cluster.address, "--json", "--quiet")
    found = {job["number"]: (job["ended"], job["attempts"], job["message"]) for job in json.loads(out)["jobs"]}
    assert status == 1
    assert found == {1: ("done", 1, ""), 2: ("done", 2, ""), 3: ("wrong", 1, "that cannot be")}
    assert (tmp_path / "out" / "1.mp4").read_text() == "a video\na picture\n"
    assert (tmp_path / "out" / "3.mp4.log").read_text() == "error: that cannot be\n"
    result = json.loads((tmp_path / "out" / "1.mp4.json").read_text())["result"]
    assert result["output"] == str(tmp_path / "out" / "1.mp4")  # and not where the worker made it
    files = {f"{n}.mp4{ending}" for n in (1, 2) for ending in ("", ".json", ".log")}
    assert {path.name for path in (tmp_path / "out").iterdir()} == files | {"3.mp4.log"}
    status, out, _ = run(write({}, {"codec": "fail-once"}), "--scheduler", cluster.address, "--json", "--quiet")
    assert (status, endings(tmp_path)) == (0, ["kept", "kept"])


def test_a_track_comes_back_and_goes_to_the_next_job(run: Run, write: Write, tmp_path: Path, cluster: Cluster) -> None:
    (tmp_path / "c.png").write_text("another")
    tracked = {"codec": "tracked", "start": 0}
    manifest = write({"save_track": "out/t.json"} | tracked, {"ad": "c.png"} | tracked)
    assert run(manifest, "--scheduler", cluster.address, "--quiet")[0] == 0
    [track] = (tmp_path / "jobs.batch" / "tracks").iterdir()
    assert track.read_text() == (tmp_path / "out" / "t.json").read_text() == "a track"
    assert (tmp_path / "out" / "2.mp4").read_text() == "a video\nanother\na track\n"


def test_a_job_takes_a_resource_of_its_worker(run: Run, write: Write, tmp_path: Path, cluster: Cluster) -> None:
    manifest = write({}, {})
    assert run(manifest, "--scheduler", cluster.address, "--resources", "GPU=1", "--quiet")[0] == 0


def test_a_request_to_end_ends_the_jobs_of_the_workers(write: Write, tmp_path: Path, cluster: Cluster) -> None:
    pid = fork_batch(write({"codec": "sleep:60"}), "--scheduler", cluster.address)
    wait_until(lambda: bool(children_now(cluster.folder)))
    os.kill(pid, signal.SIGTERM)
    assert status_of(pid) == 143
    assert not children_of_the_batch(cluster.folder)
    assert not (tmp_path / "out" / "1.mp4").exists()


def test_a_batch_that_is_killed_ends_the_jobs_of_the_workers_and_goes_on(
    run: Run, write: Write, tmp_path: Path, cluster: Cluster
) -> None:
    pid = fork_batch(write({"codec": "sleep:60"}, {}), "--scheduler", cluster.address)
    wait_until(lambda: bool(children_now(cluster.folder)))
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    assert not children_of_the_batch(cluster.folder)
    assert run(write({"codec": "sleep:0.1"}, {}), "--scheduler", cluster.address, "--quiet")[0] == 0


def test_on_a_slow_disk_an_output_appears_whole(run: Run, write: Write, tmp_path: Path, cluster: Cluster) -> None:
    (tmp_path / "a.mp4").write_text("slow" * 10_000)
    pid = fork_batch(write({}), "--scheduler", cluster.address)
    wait_until(lambda: bool(list(tmp_path.glob("out/.ar-batch-*.mp4"))))
    assert not (tmp_path / "out" / "1.mp4").exists()
    os.kill(pid, signal.SIGKILL)  # while it is copied
    os.waitpid(pid, 0)
    (tmp_path / "a.mp4").write_text("quick" * 10_000)
    assert run(write({}), "--scheduler", cluster.address, "--quiet")[0] == 0
    assert (tmp_path / "out" / "1.mp4").read_text() == "quick" * 10_000 + "\na picture\n"
    wait_until(lambda: len(list((tmp_path / "out").iterdir())) == 3)
    assert (tmp_path / "out" / "1.mp4").stat().st_size == 50_011


def test_a_full_disk_fails_jobs_and_loses_none(
    run: Run, write: Write, tmp_path: Path, cluster: Cluster, tiny_disk: Path
) -> None:
    (tmp_path / "a.mp4").write_text("a" * 150_000)
    jobs = [{"output": str(tiny_disk / f"{number}.mp4")} for number in (1, 2)]
    status, out, _ = run(write(*jobs), "--scheduler", cluster.address, "--json", "--quiet", "--retries", 0)
    ended = {job["ended"]: job["message"] for job in json.loads(out)["jobs"]}
    assert (status, ended.keys() | {"done"}) == (1, {"done", "failed"})  # both fail where they write at the same time
    assert "no space left on the disk" in ended["failed"]
    assert not [path for path in tiny_disk.iterdir() if path.name.startswith(".")]
    subprocess.run(["mount", "-o", "remount,size=2m", tiny_disk], check=True)
    assert run(write(*jobs), "--scheduler", cluster.address, "--quiet")[0] == 0
    assert endings(tmp_path) == (["done", "kept"] if "done" in ended else ["done", "done"])
    assert {(tiny_disk / f"{n}.mp4").stat().st_size for n in (1, 2)} == {150_000 + len("\na picture\n")}


def test_a_worker_that_is_killed_and_a_scheduler_that_comes_back_lose_nothing(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both in one batch, since it takes a while to start them."""
    folder = tmp_path / "own"
    folder.mkdir()
    cluster = Cluster(folder)
    try:
        victim = cluster.start_worker("--name", "victim")
        jobs = [{"codec": "sleep:0.4", "crf": number} for number in range(JOBS)]
        pid = fork_batch(write(*jobs), "--scheduler", cluster.address)
        wait_until(lambda: (tmp_path / "out" / "1.mp4").exists() and bool(children_now(folder)))
        cluster.start_worker("--name", "second")
        victim.kill()
        wait_until(lambda: (tmp_path / "out" / "5.mp4").exists() and bool(children_now(folder)))
        cluster.scheduler.kill()
        cluster.scheduler.wait()
        cluster.scheduler = cluster.start_scheduler()
        cluster.start_worker("--name", "third")
        assert status_of(pid) == 0
        assert endings(tmp_path) == ["done"] * JOBS
        assert {(tmp_path / "out" / f"{n}.mp4").read_text() for n in range(1, JOBS + 1)} == {"a video\na picture\n"}
        expected = {f"{n}.mp4{ending}" for n in range(1, JOBS + 1) for ending in ("", ".json", ".log")}
        assert {path.name for path in (tmp_path / "out").iterdir()} == expected
        attempts = [
            json.loads((tmp_path / "out" / f"{n}.mp4.json").read_text())["attempts"] for n in range(1, JOBS + 1)
        ]
        assert sum(attempts) == JOBS  # what its machines do is not a job's failure
        assert not children_of_the_batch(folder)

        # One that stays away ends the batch.
        monkeypatch.setattr("ar_demo.batch.cluster.MODEL", ClusterModel(connect_seconds=2, gone_seconds=1))
        pid = fork_batch(write({"codec": "sleep:60", "output": "out/last.mp4"}), "--scheduler", cluster.address)
        wait_until(lambda: bool(children_now(folder)))
        cluster.scheduler.kill()
        assert status_of(pid) == 1
        assert not (tmp_path / "out" / "last.mp4").exists()
    finally:
        cluster.close()


def test_a_scheduler_that_is_not_there_is_named(run: Run, write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ar_demo.batch.cluster.MODEL", ClusterModel(connect_seconds=0.2))
    status, _, err = run(write({}), "--scheduler", "tcp://127.0.0.1:9", "--quiet")
    assert status == 1
    assert "cannot reach the scheduler tcp://127.0.0.1:9" in err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--scheduler", "tcp://x:1", "--workers", "2"], "--workers does nothing beside --scheduler"),
        (["--resources", "GPU=1"], "--resources does nothing without --scheduler"),
        (["--scheduler", "tcp://x:1", "--resources", "GPU"], "'GPU' is no resource"),
    ],
)
def test_what_makes_no_sense_is_refused(run: Run, write: Write, options: list[str], message: str) -> None:
    status, _, err = run(write({}), *options, "--quiet")
    assert status == 2
    assert message in err


def test_a_worker_of_another_version_is_named() -> None:
    outcome = work(Task({}, ("o.mp4",)), Place(None, 1), "0.0.0")
    assert outcome.is_wrong_input
    assert "and the batch 0.0.0: install the same" in outcome.message


def children_now(folder: Path) -> str:
    """Jobs that workers are at, which make their outputs in a folder."""
    words: Any = ["pgrep", "-f", f"stand_in.py.*{folder}"]
    return subprocess.run(words, capture_output=True, text=True).stdout
