"""A project: its state on disk and in the page, tracking, corrections, and what is told meanwhile."""

import json
import threading
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from ar_demo.cli.defaults import Defaults
from ar_demo.cli.jobs import load_job
from ar_demo.errors import InputError, NotFound, RunError
from ar_demo.options import TrackingOptions
from ar_demo.progress import Progress
from ar_demo.session import Session
from ar_demo.studio.errors import Refusal
from ar_demo.studio.project import Project
from ar_demo.studio.state import LOOK, Change, SurfaceState
from ar_demo.studio.tasks import Task
from ar_demo.studio.workspace import Workspace
from ar_demo.surface import Keyframe, Moment, Surface

from ..scenes import Scene, error, path
from .conftest import FRAMES, Studio

QUAD = Scene().quad.tolist()
TRUTH = path(Scene().quad, FRAMES)


def job_of(studio: Studio) -> dict[str, Any]:
    job: dict[str, Any] = json.loads((studio.folder / "street.job.json").read_text())
    return job


def again(studio: Studio) -> Project:
    """The project as a server that is started anew opens it."""
    return Workspace(studio.folder, studio.folder, Defaults()).open(studio.folder / "street.mp4")


def test_a_new_project(studio: Studio) -> None:
    content = studio.content
    video = content["video"]
    assert (video["name"], video["width"], video["height"], video["frames"]) == ("street.mp4", 320, 240, FRAMES)
    assert video["times"][:3] == [0, 0.04, 0.08]
    [surface] = content["surfaces"]
    assert (surface["ad_name"], surface["quad"], surface["track"]) == ("ad.png", None, None)
    assert "cover" in content["choices"]["fit"]
    assert studio.page.get("/api/projects").json() == [
        {"id": content["id"], "name": "street.mp4", "video": "street.mp4"}
    ]
    assert not (studio.folder / "street.job.json").exists()  # looking changes nothing


def test_each_change_is_in_the_job_file(studio: Studio) -> None:
    region = [[90, 60], [230, 60], [230, 180]]
    changes = {
        "quad": QUAD,
        "start": 4,
        "snap": True,
        "region": region,
        "exclude": [region],
        "keyframes": [{"frame": 9, "corners": QUAD}],
        "fit": "cover",
        "opacity": 0.5,
        "lost": "hide",
    }
    tracking, rendering = {"time": "2..12", "smooth": 2}, {"audio": "none", "codec": None, "crf": 20, "depth": "8"}
    answer = studio.put(surface=changes, tracking=tracking, rendering=rendering)
    assert (answer.status_code, answer.json()["revision"]) == (200, 1)
    job = load_job(studio.folder / "street.job.json")
    [surface] = job.surfaces_with({})
    assert (job.input, surface.ad) == (studio.folder / "street.mp4", studio.folder / "ad.png")
    assert (surface.fit, surface.opacity, surface.lost) == ("cover", 0.5, "hide")
    assert (surface.snap, surface.start.frame) == (True, 4)
    np.testing.assert_allclose(surface.quad, QUAD)
    np.testing.assert_allclose(surface.region, region)
    assert surface.keyframes[0].at.frame == 9
    assert job.output_options() == {"audio": "none", "crf": 20, "depth": "8"}
    assert str(job.tracking_options()["time"]) == "frame 2 to frame 12"
    other = again(studio)
    [seen], [known] = (json.loads(json.dumps(content["surfaces"])) for content in (other.content, answer.json()))
    assert seen.pop("ad") != known.pop("ad")
    assert seen == known
    assert (other.content["tracking"], other.content["rendering"]) == (tracking, rendering)
    other.close()


def test_an_unfinished_surface_is_kept_and_the_command_line_says_what_is_missing(studio: Studio) -> None:
    content = studio.content
    content["surfaces"] = []
    assert studio.page.put(studio.url, json=content).json()["surfaces"] == []
    assert again(studio).content["surfaces"] == []
    content["surfaces"], content["revision"] = [{"fit": "cover"}], 1
    assert studio.page.put(studio.url, json=content).status_code == 200
    assert again(studio).content["surfaces"][0]["fit"] == "cover"
    with pytest.raises(InputError, match=r"neither quad, find nor track.*surfaces\[0\]"):
        load_job(studio.folder / "street.job.json").surfaces_with({})


def test_every_option_of_a_surface_is_known() -> None:
    """One that was not would be lost when the page saves."""
    place = {"ad", "matte", "quad", "snap", "start", "region", "exclude", "keyframes", "track", "find"}
    assert set(LOOK) == {field.name for field in fields(Surface)} - place
    assert set(LOOK) < set(SurfaceState.__struct_fields__)


def test_what_the_page_does_not_know_stays_in_the_job_file(folder: Path) -> None:
    said = {
        "version": 1,
        "input": "street.mp4",
        "output": "out.mp4",
        "save_track": "t.json",
        "tracking": {"end": "10", "device": "cpu"},
        "rendering": {"location": False, "crf": 18},
        "surfaces": [{"quad": "100,70 220,74 216,166 102,160", "start": "0.2s", "effect": "blur"}],
    }
    (folder / "mine.json").write_text(json.dumps(said))
    workspace = Workspace(folder, folder, Defaults())
    project = workspace.open(folder / "mine.json")
    [surface] = project.content["surfaces"]
    assert (surface["start"], surface["effect"], surface["quad"][1]) == (5, "blur", (220, 74))
    studio = {"revision": 0, **{k: project.content[k] for k in ("surfaces", "tracking", "rendering")}}
    project.change(msgspec.convert(studio, Change))
    now = json.loads((folder / "mine.json").read_text())
    assert {k: v for k, v in now.items() if k != "surfaces"} == {k: v for k, v in said.items() if k != "surfaces"}
    workspace.close()


def test_a_picture_that_a_surface_is_found_by_stays_until_it_has_corners(folder: Path) -> None:
    said = {"version": 1, "input": "street.mp4", "surfaces": [{"ad": "ad.png", "find": "ad.png"}]}
    (folder / "street.job.json").write_text(json.dumps(said))
    workspace = Workspace(folder, folder, Defaults())
    project = workspace.open(folder / "street.mp4")
    for number, (change, expected) in enumerate((({"opacity": 0.5}, {"find"}), ({"quad": QUAD}, {"quad"}))):
        content = project.content
        content["surfaces"][0] |= change
        project.change(msgspec.convert({"revision": number} | {"surfaces": content["surfaces"]}, Change))
        [entry] = json.loads((folder / "street.job.json").read_text())["surfaces"]
        assert entry.keys() == {"ad", "opacity"} | expected
    workspace.close()


def test_an_older_state_does_not_replace_a_newer_one(studio: Studio) -> None:
    first, second = studio.content, studio.content
    first["surfaces"][0]["opacity"] = 0.25
    second["surfaces"][0]["opacity"] = 0.75
    assert studio.page.put(studio.url, json=first).status_code == 200
    answer = studio.page.put(studio.url, json=second)
    assert (answer.status_code, answer.json()["revision"]) == (409, 1)
    assert answer.json()["surfaces"][0]["opacity"] == 0.25
    assert job_of(studio)["surfaces"][0]["opacity"] == 0.25


def test_what_another_program_wrote_is_not_replaced(studio: Studio) -> None:
    """As a second server does on the same video."""
    other = again(studio)
    studio.put(surface={"opacity": 0.25})
    content = json.loads(json.dumps(other.content))
    with pytest.raises(Refusal, match="start ar-studio anew"):
        other.change(msgspec.convert({"revision": 0, "surfaces": content["surfaces"]}, Change))
    assert other.content["revision"] == 0
    assert job_of(studio)["surfaces"][0]["opacity"] == 0.25
    (studio.folder / "street.job.json").unlink()
    assert studio.put(surface={"opacity": 0.5}).status_code == 409
    assert studio.content["surfaces"][0]["opacity"] == 0.25
    other.close()


def test_a_change_that_cannot_be_written_is_not_made(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise RunError("cannot write street.job.json: no space left on the disk")

    monkeypatch.setattr("ar_demo.studio.project.write_whole", full)
    answer = studio.put(surface={"opacity": 0.25})
    assert (answer.status_code, "no space" in answer.json()["error"]) == (500, True)
    assert (studio.content["revision"], studio.content["surfaces"][0]["opacity"]) == (0, 1.0)


@pytest.mark.parametrize(
    ("surface", "field"),
    [
        ({"opacity": 2}, "surfaces.0.opacity"),
        ({"fit": "squeeze"}, "surfaces.0.fit"),
        ({"quad": [[1, 2]]}, "surfaces.0.quad"),
        ({"start": FRAMES}, "surfaces.0.start"),
        ({"start": -1}, "surfaces.0.start"),
        ({"region": [[0, 0], [9, 9], [9, 0], [0, 9]]}, "surfaces.0"),
        ({"track": {"id": "guess"}}, "surfaces.0.track"),
        ({"feather": -1}, "surfaces.0.feather"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(studio: Studio, surface: dict[str, Any], field: str) -> None:
    answer = studio.put(surface=surface)
    assert (answer.status_code, answer.json()["field"]) == (422, field)
    assert "\n" not in answer.json()["error"]
    assert studio.content["revision"] == 0
    assert not (studio.folder / "street.job.json").exists()


def test_an_impossible_time_is_refused_with_its_place(studio: Studio) -> None:
    assert studio.put(tracking={"time": "soon", "smooth": 1}).json()["field"] == "tracking.time"
    assert studio.put(tracking={"time": "3..5", "smooth": -1}).json()["field"] == "tracking.smooth"


def test_what_does_nothing_beside_an_effect_is_left_out_of_the_job(studio: Studio) -> None:
    assert studio.put(surface={"quad": QUAD, "effect": "blur", "fit": "cover"}).status_code == 200
    assert job_of(studio)["surfaces"][0].keys() == {"quad", "effect"}
    assert studio.content["surfaces"][0]["ad_name"] == "ad.png"  # should somebody change their mind
    assert studio.put(surface={"effect": "replace", "flat": True, "shutter": 90}).status_code == 200
    assert job_of(studio)["surfaces"][0].keys() == {"ad", "quad", "fit", "flat"}


def test_tracking_waits_for_corners(studio: Studio) -> None:
    answer = studio.post("/track")
    assert (answer.status_code, answer.json()["field"]) == (422, "surfaces.0.quad")
    studio.put(surface={"quad": [[0, 0], [9, 9], [9, 0], [0, 9]]})
    answer = studio.post("/track")
    assert (answer.status_code, answer.json()["field"]) == (422, "surfaces.0.quad")
    assert studio.post("/stop").status_code == 409
    assert studio.get("/surfaces/0/track").status_code == 404


@pytest.mark.usefixtures("shared_networks")
def test_tracks_and_mends(studio: Studio) -> None:
    studio.put(surface={"quad": QUAD})
    assert studio.post("/track").status_code == 202
    task = studio.finish()
    assert (task["kind"], task["state"], task["error"]) == ("track", "done", None)
    track = studio.get("/surfaces/0/track").json()
    assert (track["first"], track["last"], track["reference_frame"], track["states"]) == (0, 15, 0, "t" * FRAMES)
    assert all(error(np.array(c), t) < 1 for c, t in zip(track["corners"], TRUTH, strict=True))
    assert len(track["confidence"]) == len(track["deviation"]) == FRAMES
    [surface] = studio.content["surfaces"]
    assert surface["track"]["counts"]["tracked"] == FRAMES
    assert not surface["track"]["stale"]
    assert job_of(studio)["surfaces"] == [{"ad": "ad.png", "track": "street.track.json"}]
    assert studio.post("/track").status_code == 409  # nothing is to do

    # Another look does not touch the track; another quad does, and undoing that brings it back.
    assert not studio.put(surface={"opacity": 0.5}).json()["surfaces"][0]["track"]["stale"]
    assert studio.put(surface={"start": 3}).json()["surfaces"][0]["track"]["stale"]
    assert job_of(studio)["surfaces"][0].keys() == {"ad", "quad", "start", "opacity"}
    assert not studio.put(surface={"start": 0}).json()["surfaces"][0]["track"]["stale"]
    assert studio.put(tracking={"time": None, "smooth": 3}).json()["surfaces"][0]["track"]["stale"]
    assert not studio.put(tracking={"time": None, "smooth": 1}).json()["surfaces"][0]["track"]["stale"]

    # A keyframe: what lies on the far side of it is kept, to the bit.
    for frame in (8, 12):
        marked = [*studio.content["surfaces"][0]["keyframes"], {"frame": frame, "corners": TRUTH[frame].tolist()}]
        assert studio.put(surface={"keyframes": marked}).json()["surfaces"][0]["track"]["stale"]
        before = studio.get("/surfaces/0/track").json()
        assert studio.post("/track").status_code == 202
        assert studio.finish()["state"] == "done"
    after = studio.get("/surfaces/0/track").json()
    assert after["keyframes"] == [8, 12]
    assert after["corners"][:8] == before["corners"][:8]
    assert not studio.content["surfaces"][0]["track"]["stale"]
    # The job renders as it is, and a new server knows it all.
    [loaded] = load_job(studio.folder / "street.job.json").surfaces_with({}, studio.folder / "street.mp4")
    assert loaded.track is not None
    assert sorted(loaded.track.keyframes) == [8, 12]
    other = again(studio)
    assert [k["frame"] for k in other.content["surfaces"][0]["keyframes"]] == [8, 12]
    assert not other.content["surfaces"][0]["track"]["stale"]
    other.close()
    # A keyframe that is taken back: tracked anew.
    assert studio.put(surface={"keyframes": marked[:1]}).json()["surfaces"][0]["track"]["stale"]
    files = {path.name for path in studio.folder.glob("*.track.json")}
    assert len(files) == 3
    studio.put(surface={"keyframes": marked})
    studio.workspace.close()
    assert [path.name for path in studio.folder.glob("*.track.json")] == [job_of(studio)["surfaces"][0]["track"]]


class Slow:
    """Work that waits until it is told to go on."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.begun, self.may_go_on = threading.Event(), threading.Event()
        work = Session.track

        def slow(session: Session, *arguments: Any) -> Any:
            self.begun.set()
            assert self.may_go_on.wait(20)
            return work(session, *arguments)

        monkeypatch.setattr(Session, "track", slow)


@pytest.mark.usefixtures("shared_networks")
def test_what_changes_while_it_is_tracked_is_kept(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    slow = Slow(monkeypatch)
    studio.put(surface={"quad": QUAD})
    studio.post("/track")
    assert slow.begun.wait(20)
    assert studio.post("/track").status_code == 409
    content = studio.content
    assert content["task"]["state"] == "running"
    # Another surface comes before it, and it looks different.
    content["surfaces"] = [{"quad": [[5, 5], [60, 5], [60, 60], [5, 60]]}, content["surfaces"][0] | {"opacity": 0.5}]
    assert studio.page.put(studio.url, json=content).status_code == 200
    slow.may_go_on.set()
    assert studio.finish()["state"] == "done"
    first, second = studio.content["surfaces"]
    assert (first["track"], second["opacity"]) == (None, 0.5)
    assert second["track"]["counts"]["tracked"] == FRAMES


@pytest.mark.usefixtures("shared_networks")
def test_stops_and_goes_on(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    tasks, seen = studio.project.tasks, list[int | None]()
    listen = tasks._listen

    def note(task: Task, event: Progress) -> None:
        listen(task, event)
        seen.append(event.frame)
        if len(seen) == 5:
            assert studio.post("/stop").status_code == 202

    monkeypatch.setattr(tasks, "_listen", note)
    studio.put(surface={"quad": QUAD})
    studio.post("/track")
    assert studio.finish()["state"] == "stopped"
    assert studio.content["surfaces"][0]["track"] is None
    assert list(studio.folder.glob("*.track.json")) == []
    assert studio.content["can_go_on"]
    assert not studio.put(surface={"quad": (Scene().quad + 1).tolist()}).json()["can_go_on"]
    assert studio.put(surface={"quad": QUAD, "opacity": 0.5}).json()["can_go_on"]
    assert studio.post("/track").status_code == 202
    assert studio.finish()["state"] == "done"
    assert seen == [*range(FRAMES)], "each frame is tracked once"
    assert not studio.content["can_go_on"]


def test_a_surface_is_looked_for_by_its_picture(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    picture, other = studio.content["surfaces"][0]["ad"], (Scene().quad + 9)
    asked: list[Surface] = []

    def located(surfaces: list[Surface], options: TrackingOptions) -> list[Surface]:
        asked.extend(surfaces)
        mark = Keyframe(Moment(frame=7), other)
        return [
            Surface(effect="blur", quad=Scene().quad, start=Moment(frame=3), keyframes=(mark,)),
            Surface(effect="blur", quad=other),
        ]

    monkeypatch.setattr(studio.project.session, "located", located)
    assert studio.post("/find", {"picture": picture}).status_code == 202
    task = studio.finish()
    assert (task["kind"], task["state"]) == ("find", "done")
    assert [one.find for one in asked] == [studio.folder / "ad.png"]
    assert task["found"] == [
        {"quad": QUAD, "start": 3, "keyframes": [{"frame": 7, "corners": other.tolist()}]},
        {"quad": other.tolist(), "start": 0, "keyframes": []},
    ]
    assert studio.post("/find", {"picture": "guess"}).status_code == 404

    def fail(*_: Any) -> None:
        raise NotFound("ad.png is not seen in street.mp4: nothing is like it")

    monkeypatch.setattr(studio.project.session, "located", fail)
    studio.post("/find", {"picture": picture})
    assert studio.finish()["error"] == "ad.png is not seen in street.mp4: nothing is like it"


@pytest.mark.usefixtures("shared_networks")
def test_a_stop_that_came_too_late_does_not_end_what_comes_next(studio: Studio) -> None:
    studio.project.session.stop()
    studio.put(surface={"quad": QUAD})
    studio.post("/track")
    assert studio.finish()["state"] == "done"


def test_what_fails_is_told_in_one_sentence(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    for number, raised in enumerate((InputError("no such device: choose cpu"), ValueError("two\nlines"))):

        def fail(*_: Any, raised: Exception = raised) -> None:
            raise raised

        monkeypatch.setattr(Session, "track", fail)
        studio.put(surface={"quad": QUAD, "opacity": 0.5 + number / 4})
        studio.post("/track")
        task = studio.finish()
        assert task["state"] == "failed"
        assert "\n" not in task["error"]
        assert str(raised).split("\n")[0] in task["error"]


@pytest.mark.usefixtures("shared_networks")
def test_pages_are_told_what_happens(studio: Studio) -> None:
    with studio.page, studio.socket() as socket:
        studio.put(surface={"quad": QUAD})
        assert socket.receive_json() == {"type": "project", "revision": 1}
        studio.post("/track")
        seen: list[dict[str, Any]] = []
        while not seen or seen[-1].get("state") not in ("done", "failed"):
            seen.append(socket.receive_json())
        assert [event["type"] for event in seen[:1]] == ["task"]
        assert seen[-1]["state"] == "done"
        assert {"type": "project", "revision": 2} in seen
        assert all(event["done"] <= FRAMES for event in seen if event["type"] == "task")


def test_corners_snap_to_edges(studio: Studio) -> None:
    clicked = np.add(QUAD, [[1.5, -1], [-1, 1], [1, 1.5], [-1, -1]]).tolist()
    answer = studio.post("/snap", {"frame": 0, "corners": clicked}).json()
    assert error(np.array(answer["corners"]), np.array(QUAD)) < error(np.array(clicked), np.array(QUAD))
    assert len(answer["moved"]) == 4
    assert max(answer["moved"]) > 0.5
    for wrong in ([[0, 0], [9, 9], [9, 0], [0, 9]], [[0, 0]], "corners"):
        assert studio.post("/snap", {"frame": 0, "corners": wrong}).json()["field"] == "corners"
    assert studio.post("/snap", {"frame": 99, "corners": clicked}).status_code == 404


def test_proposes_the_poster(studio: Studio) -> None:
    proposals = studio.post("/proposals", {"frame": 3}).json()["proposals"]
    assert error(np.array(proposals[0]["corners"]), TRUTH[3]) < 3
    assert [p["score"] for p in proposals] == sorted((p["score"] for p in proposals), reverse=True)
    assert studio.post("/proposals", {"frame": FRAMES}).status_code == 404
    assert studio.post("/proposals", {}).status_code == 422


def test_a_job_file_of_something_else_is_refused_and_stays(folder: Path) -> None:
    (folder / "street.job.json").write_text("{}")
    with pytest.raises(InputError, match="not as a job file must be"):
        Workspace(folder, folder, Defaults()).open(folder / "street.mp4")
    assert (folder / "street.job.json").read_text() == "{}"


def test_a_track_that_is_gone_is_told(studio: Studio, folder: Path) -> None:
    said = '{"version": 1, "input": "street.mp4", "surfaces": [{"track": "gone.track.json"}]}'
    (folder / "street.job.json").write_text(said)
    with pytest.raises(InputError, match=r"gone\.track\.json"):
        again(studio)
    assert (folder / "street.job.json").read_text() == said
