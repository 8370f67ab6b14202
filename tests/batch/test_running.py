"""A batch: each job is a process, failures while working are tried again, and what is done is not done again."""

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest

from ar_demo.batch import identity
from ar_demo.batch.state import State

from ..conftest import Run
from .conftest import Write
from .processes import children_of_the_batch, fork_batch, status_of, wait_until

pytestmark = pytest.mark.usefixtures("stand_in")
Begun = Callable[[], list[str]]


def endings(out: str) -> dict[str, str]:
    """How each job ended, by the name of its output."""
    return {Path(job["outputs"]["output"]).name: job["ended"] for job in json.loads(out)["jobs"]}


def test_what_fails_while_working_is_tried_again_and_wrong_input_is_not(run: Run, write: Write, begun: Begun) -> None:
    jobs = [{"codec": name} for name in ("fail-once", "crash-once", "fail", "wrong")]
    status, out, _ = run(write(*jobs, {"codec": "fail", "retries": 3}, {}), "--json", "--quiet")
    assert status == 1
    assert endings(out) == {
        **{"1.mp4": "done", "2.mp4": "done", "6.mp4": "done"},
        **{"3.mp4": "failed", "4.mp4": "wrong", "5.mp4": "failed"},
    }
    assert [begun().count(f"{n}.mp4") for n in range(1, 2)] == [2]
    found = {job["number"]: (job["attempts"], job["message"]) for job in json.loads(out)["jobs"]}
    assert found[3] == (2, "it broke")
    assert found[4] == (1, "that cannot be")
    assert found[5] == (4, "it broke")


def test_one_that_goes_beyond_its_limits_is_ended_and_the_rest_is_done(run: Run, write: Write) -> None:
    manifest = write({"codec": "sleep:30", "time_limit": 0.3}, {"codec": "memory:10", "memory_limit": "100MB"}, {})
    begin = time.monotonic()
    status, out, _ = run(manifest, "--json", "--quiet", "--workers", 3)
    assert (status, endings(out)) == (1, {"1.mp4": "failed", "2.mp4": "failed", "3.mp4": "done"})
    assert time.monotonic() - begin < 15
    told = {job["number"]: job["message"] for job in json.loads(out)["jobs"]}
    assert told[1] == "it took longer than 0.3 s"
    assert told[2] == "it took more than 100 MB of memory"


def test_the_limits_of_the_command_line_hold_whatever_the_manifest_says(run: Run, write: Write) -> None:
    status, out, _ = run(write({"codec": "sleep:30", "time_limit": "1h"}), "--json", "--quiet", "--time-limit", "0.2s")
    assert (status, endings(out)) == (1, {"1.mp4": "failed"})


def test_log_and_result_lie_beside_the_output(run: Run, write: Write, tmp_path: Path) -> None:
    assert run(write({"codec": "fail-once"}))[0] == 0
    assert (tmp_path / "out" / "1.mp4.log").read_text() == "error: it broke\n"
    result = json.loads((tmp_path / "out" / "1.mp4.json").read_text())
    assert result["attempts"] == 2
    assert result["result"]["states"] == {"tracked": 3, "lost": 1}
    assert f"--output={tmp_path}/out/1.mp4" in result["command"]


def test_the_summary_in_all_its_forms_has_the_worst_first(run: Run, write: Write, tmp_path: Path) -> None:
    status, out, err = run(write({}, {"codec": "fail"}, {"codec": "wrong"}))
    assert status == 1
    assert [line.split()[0] for line in out.splitlines()] == ["ended", "failed", "wrong", "done", "3"]
    assert out.endswith("3 jobs: 1 done, 1 wrong input, 1 failed\n")
    assert "3 of 3" in err
    folder = tmp_path / "jobs.batch"
    content = json.loads((folder / "summary.json").read_text())
    assert content["counts"] == {"failed": 1, "wrong": 1, "doubtful": 0, "done": 1, "kept": 0}
    suites = ElementTree.parse(folder / "junit.xml").getroot()
    assert (suites.get("tests"), suites.get("failures"), suites.get("errors")) == ("3", "1", "1")
    assert [child.tag for case in suites.iter("testcase") for child in case] == ["failure", "error"]
    page = (folder / "summary.html").read_text()
    assert 'href="../out/1.mp4"' in page
    assert "&lt;odd&gt; &amp; " in page


def test_a_verdict_that_strict_does_not_let_pass_is_told_each_time(run: Run, write: Write, begun: Begun) -> None:
    jobs = {"codec": "doubt", "strict": True}, {"codec": "doubt"}, {}
    for expected in ({"2.mp4": "done", "3.mp4": "done"}, {"2.mp4": "kept", "3.mp4": "kept"}):
        status, out, _ = run(write(*jobs), "--quiet", "--json")
        assert (status, endings(out)) == (1, {"1.mp4": "doubtful"} | expected)
        assert json.loads(out)["jobs"][0]["message"] == "12 % held"
        assert [Path(job["outputs"]["output"]).name for job in json.loads(out)["jobs"]] == ["1.mp4", "2.mp4", "3.mp4"]
    assert len(begun()) == 3


def test_what_is_done_is_skipped_and_what_changed_is_done_again(
    run: Run, write: Write, begun: Begun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "c.png").write_text("another")
    jobs = {}, {"ad": "c.png"}, {"crf": 20}
    assert run(write(*jobs), "--quiet")[0] == 0
    assert len(begun()) == 3
    status, out, _ = run(write(*jobs), "--quiet", "--json")
    assert (status, set(endings(out).values()), begun()) == (0, {"kept"}, [])

    (tmp_path / "c.png").write_text("yet another")
    assert run(write(*jobs), "--quiet")[0] == 0
    assert begun() == ["2.mp4"]
    assert (tmp_path / "out" / "2.mp4").read_text() == "a video\nyet another\n"

    (tmp_path / "out" / "1.mp4").unlink()
    assert run(write(*jobs), "--quiet")[0] == 0
    assert begun() == ["1.mp4"]

    assert run(write({}, {"ad": "c.png"}, {"crf": 21}), "--quiet")[0] == 0
    assert begun() == ["3.mp4"]

    (tmp_path / "b.png").touch()  # the same content
    assert run(write({}), "--quiet")[0] == 0
    assert begun() == []

    monkeypatch.setattr(identity, "_version", lambda: "99")
    assert run(write({}), "--quiet")[0] == 0
    assert begun() == ["1.mp4"]


def test_what_failed_is_tried_in_the_next_run(run: Run, write: Write, begun: Begun) -> None:
    assert run(write({"codec": "fail"}), "--quiet", "--retries", 0)[0] == 1
    assert run(write({"codec": "fail"}), "--quiet", "--retries", 0)[0] == 1
    assert begun() == ["1.mp4", "1.mp4"]


def test_a_file_that_no_job_made_is_never_replaced(run: Run, write: Write, begun: Begun, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    for name in ("1.mp4", "2.mp4.log"):
        (tmp_path / "out" / name).write_text("mine")
    status, out, _ = run(write({}, {}, {}), "--quiet", "--json")
    assert (status, endings(out)) == (1, {"1.mp4": "wrong", "2.mp4": "wrong", "3.mp4": "done"})
    assert begun() == ["3.mp4"]
    assert {(tmp_path / "out" / name).read_text() for name in ("1.mp4", "2.mp4.log")} == {"mine"}

    (tmp_path / "out" / "3.mp4").write_text("edited by hand")
    assert run(write({}, {}, {"crf": 9}), "--quiet")[0] == 1
    assert (tmp_path / "out" / "3.mp4").read_text() == "edited by hand"
    assert run(write({}, {}, {"crf": 9}, defaults={"overwrite": True}), "--quiet")[0] == 0
    assert (tmp_path / "out" / "3.mp4").read_text() == "a video\na picture\n"


def test_the_tracks_of_several_surfaces_are_not_replaced_either(run: Run, write: Write, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "t.2.json").write_text("mine")
    job = {"surface": [["b.png", "0,0 9,0 9,9 0,9"]] * 2, "save_track": "out/t.json"}
    status, out, _ = run(write(job), "--quiet", "--json")
    assert (status, endings(out)) == (1, {"1.mp4": "wrong"})
    (tmp_path / "out" / "t.2.json").unlink()
    assert run(write(job), "--quiet")[0] == 0


def test_a_job_that_failed_leaves_what_was_there_its_own(run: Run, write: Write, tmp_path: Path) -> None:
    assert run(write({}), "--quiet")[0] == 0
    assert run(write({"codec": "fail"}), "--quiet")[0] == 1
    assert run(write({"crf": 3}), "--quiet")[0] == 0


def test_a_second_batch_with_the_same_state_is_refused(
    run: Run, write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ar_demo.batch.state.LOCK_SECONDS", 0.1)
    with State(tmp_path / "jobs.batch"):
        status, _, err = run(write({}))
    assert status == 2
    assert "another ar-batch is at work" in err


def test_a_state_that_is_none_is_named(run: Run, write: Write, tmp_path: Path) -> None:
    (tmp_path / "jobs.batch").mkdir()
    (tmp_path / "jobs.batch" / "state.sqlite").write_text("this is no data base" * 100)
    status, _, err = run(write({}))
    assert (status, err.count("\n")) == (2, 1)
    assert "state.sqlite is no state of a batch" in err


def test_a_request_to_end_ends_the_jobs_and_leaves_nothing_half_made(
    write: Write, begun: Begun, tmp_path: Path
) -> None:
    pid = fork_batch(write({"codec": "sleep:30"}, {}))
    wait_until((tmp_path / "begun.txt").exists)
    os.kill(pid, signal.SIGTERM)
    assert status_of(pid) == 143
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["1.mp4.log"]
    assert not children_of_the_batch(tmp_path)


def test_killed_twenty_times_the_outputs_are_as_undisturbed(
    run: Run, write: Write, begun: Begun, tmp_path: Path
) -> None:
    jobs = [{"crf": number, "codec": "sleep:0.03"} for number in range(12)]
    kills = 20
    for number in range(kills):
        pid = fork_batch(write(*jobs), "--workers", "2")
        time.sleep(0.02 + (number * 37 % 20) / 100)  # anywhere from its start to some jobs later
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
    status, out, _ = run(write(*jobs), "--quiet", "--json", "--workers", 2)
    assert status == 0
    assert {(tmp_path / "out" / f"{n}.mp4").read_text() for n in range(1, 13)} == {"a video\na picture\n"}
    expected = {f"{n}.mp4{ending}" for n in range(1, 13) for ending in ("", ".log", ".json")}
    left = {path.name for path in (tmp_path / "out").iterdir() if not path.name.endswith(".part")}
    assert left == expected
    assert len(begun()) <= 12 + 2 * kills  # no more than were under way when it was killed
    assert not children_of_the_batch(tmp_path)
    status, out, _ = run(write(*jobs), "--quiet", "--json")
    assert (status, set(endings(out).values()), begun()) == (0, {"kept"}, [])
