"""What there is to be seen and to be had: composites, the steady view, rendered files, and the command line."""

import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ar_demo.cli import commands, entry
from ar_demo.errors import RunError
from ar_demo.media.reader import VideoReader
from ar_demo.studio.pictures import from_jpeg
from ar_demo.surface import Surface
from hdn.imaging.arrays import Image

from ..conftest import Run
from ..scenes import Scene, path
from .conftest import FRAMES, Studio

QUADS = path(Scene().quad, FRAMES)
QUAD = QUADS[0].tolist()


@pytest.fixture
def tracked(studio: Studio, shared_networks: None) -> Studio:
    studio.put(surface={"quad": QUAD})
    studio.post("/track")
    assert studio.finish()["state"] == "done"
    return studio


def plain(studio: Studio, index: int) -> Image:
    return from_jpeg(studio.get(f"/frames/{index}").content)


def composite(studio: Studio, index: int) -> Image:
    answer = studio.get(f"/composite/{index}")
    assert (answer.status_code, answer.headers["x-frame"]) == (200, str(index)), answer.text
    return from_jpeg(answer.content)


def apart(a: Image, b: Image) -> float:
    return float(np.abs(a.astype(int) - b).mean())


def test_a_composite_without_corners_is_the_plain_frame(studio: Studio) -> None:
    assert apart(composite(studio, 3), plain(studio, 3)) < 1  # compressed twice
    studio.put(surface={"quad": QUAD, "start": 0})
    assert apart(composite(studio, 3), plain(studio, 3)) < 1  # compressed twice
    assert apart(composite(studio, 0), plain(studio, 0)) > 5
    assert studio.get(f"/composite/{FRAMES}").status_code == 404


def test_options_take_effect_at_once(tracked: Studio) -> None:
    before = composite(tracked, 5)
    assert apart(before, plain(tracked, 5)) > 5
    assert tracked.put(surface={"opacity": 0.5}).status_code == 200
    half = composite(tracked, 5)
    assert 2 < apart(half, plain(tracked, 5)) < apart(before, plain(tracked, 5))
    tracked.put(surface={"opacity": 1.0, "effect": "blur"})
    assert apart(composite(tracked, 5), before) > 2
    revision = tracked.content["revision"]
    assert "immutable" in tracked.get("/composite/5", revision=revision).headers["cache-control"]
    assert tracked.get("/composite/5", revision=revision - 1).headers["cache-control"] == "no-store"
    assert from_jpeg(tracked.get("/composite/5", height=120).content).shape == (120, 160, 3)


def test_an_ad_that_went_away_is_told(tracked: Studio) -> None:
    (tracked.folder / "ad.png").unlink()
    answer = tracked.get("/composite/5")
    assert answer.status_code == 404
    assert "choose another" in answer.json()["error"]


def test_the_surface_stands_still(tracked: Studio) -> None:
    first, later = (from_jpeg(tracked.get(f"/surfaces/0/steady/{index}").content) for index in (0, 12))
    height, width = first.shape[:2]
    middle = slice(height // 3, -height // 3), slice(width // 3, -width // 3)
    assert apart(first[middle], later[middle]) < apart(plain(tracked, 0), plain(tracked, 12)) / 2
    assert from_jpeg(tracked.get("/surfaces/0/steady/3", height=50).content).shape[0] == 50
    assert tracked.get(f"/surfaces/0/steady/{FRAMES}").status_code == 404
    assert tracked.get("/surfaces/1/steady/0").status_code == 404


def test_renders_downloads_and_renders_the_same_from_the_job_file(tracked: Studio, run: Run) -> None:
    answer = tracked.post("/render", {"name": "out.mp4"})
    assert answer.status_code == 202, answer.text
    task = tracked.finish()
    assert (task["kind"], task["state"], task["error"]) == ("render", "done", None)
    [output] = tracked.get("/outputs").json()
    assert (output["id"], output["name"]) == (task["output"], "out.mp4")
    download = tracked.page.get(f"/api/outputs/{output['id']}")
    assert download.content == (tracked.folder / "out.mp4").read_bytes()
    assert 'attachment; filename="out.mp4"' in download.headers["content-disposition"]
    assert tracked.page.get("/api/outputs/guess").status_code == 404

    again = tracked.folder / "again.mp4"
    code, _, err = run("--job", tracked.folder / "street.job.json", "-o", again, "--quiet", main=entry.replace_main)
    assert (code, err) == (0, "")
    with VideoReader(tracked.folder / "out.mp4") as one, VideoReader(again) as other:
        for a, b in zip(one.frames(), other.frames(), strict=True):
            assert apart(a.image, b.image) < 1

    answer = tracked.post("/render", {"name": "out.mp4"})
    assert (answer.status_code, answer.json()["field"]) == (409, "name")
    assert tracked.post("/render", {"name": "out.mp4", "overwrite": True}).status_code == 202
    assert tracked.finish()["state"] == "done"
    assert len(tracked.get("/outputs").json()) == 1
    assert tracked.content["output"] == "out.mp4"


def test_names_that_cannot_be_rendered_to(tracked: Studio) -> None:
    def there() -> dict[str, float]:
        return {p.name: p.stat().st_mtime for p in tracked.folder.parent.rglob("*.*") if p.suffix != ".json"}

    (tracked.folder / "folder.mp4").mkdir()
    before, job = there(), (tracked.folder / "street.job.json").read_bytes()
    names = ["../out.mp4", "/tmp/out.mp4", "", ".mp4", "out.xyz", "a/b.mp4", "..", "shots/../out.mp4"]
    for name in [*names, "street.mp4", "ad.png", "folder.mp4", f"{'n' * 300}.mp4"]:
        answer = tracked.post("/render", {"name": name, "overwrite": True})
        assert (answer.status_code, answer.json()["field"]) == (422, "name"), name
        assert " -" not in answer.json()["error"], "options of the command line are not on the page"
    assert there() == before
    assert (tracked.folder / "street.job.json").read_bytes() == job


def test_a_rendering_that_fails_says_what_to_do_on_the_page(tracked: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise RunError("the disk is full: choose another output with -o")

    monkeypatch.setattr(tracked.project.session, "render", fail)
    tracked.post("/render", {"name": "out.mp4"})
    assert tracked.finish()["state"] == "failed"
    assert tracked.content["task"]["error"] == "the disk is full: change the name or the options here, and render again"


def test_rendering_waits_for_tracks_and_ads(studio: Studio, shared_networks: None) -> None:
    answer = studio.post("/render", {"name": "out.mp4"})
    assert (answer.status_code, answer.json()["field"]) == (409, "surfaces.0.track")
    studio.put(surface={"quad": QUAD, "ad": None})
    studio.post("/track")
    assert studio.finish()["state"] == "done"
    answer = studio.post("/render", {"name": "out.mp4"})
    assert (answer.status_code, answer.json()["field"]) == (422, "surfaces.0.ad")


def test_poses_are_told_while_it_is_tracked(
    studio: Studio, shared_networks: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ar_demo.studio.tasks.EVENT_SECONDS", 0)
    content = studio.content
    content["surfaces"] = [{"quad": QUAD}, {"quad": (QUADS[0] + 2).tolist()}]
    studio.page.put(studio.url, json=content)
    told: list[dict[str, Any]] = []
    monkeypatch.setattr(studio.project.tasks, "_send", told.append)
    studio.post("/track")
    assert studio.finish()["state"] == "done"
    poses = [event for event in told if event["type"] == "pose"]
    assert {(pose["surface"], pose["frame"]) for pose in poses} == {(s, f) for s in (0, 1) for f in range(FRAMES)}
    for pose in poses:
        assert np.abs(np.array(pose["corners"]) - QUADS[pose["frame"]] - 2 * pose["surface"]).max() < 2
    # Next to a keyframe only its own surface is looked at.
    told.clear()
    content = studio.content
    content["surfaces"][1]["keyframes"] = [{"frame": 12, "corners": (QUADS[12] + 2).tolist()}]
    studio.page.put(studio.url, json=content)
    studio.post("/track")
    assert studio.finish()["state"] == "done"
    assert {event["surface"] for event in told if event["type"] == "pose"} == {1}


@pytest.mark.parametrize(
    "surface",
    [
        {"quad": QUAD, "ad": None, "effect": "blur"},
        {
            "quad": QUAD,
            "start": 3,
            "snap": True,
            "region": [[90, 60], [230, 60], [230.5, 180]],
            "exclude": [[[100, 80], [120, 80], [120, 90]], [[-5, 20], [30, 20], [30, 30]]],
            "keyframes": [{"frame": 9, "corners": QUADS[9].tolist()}],
            "fit": "cover",
            "playback": "once",
            "blend": "soft-light",
            "opacity": 0.25,
            "feather": 2.5,
            "lost": "hide",
            "shutter": 180,
            "grain": "off",
        },
        {"quad": QUAD, "flat": True, "playback": "hold"},
    ],
)
def test_the_command_line_says_the_same(
    studio: Studio, run: Run, monkeypatch: pytest.MonkeyPatch, surface: dict[str, Any]
) -> None:
    tracking, rendering = {"time": "2..12", "smooth": 2}, {"audio": "none", "codec": "h265", "crf": 20, "depth": "8"}
    answer = studio.put(surface=surface, tracking=tracking, rendering=rendering)
    assert answer.status_code == 200, answer.text
    told = answer.json()["command"]
    done: list[Any] = []
    monkeypatch.setattr(commands, "replace", lambda *arguments, **names: done.append(arguments) or _stop())
    words = shlex.split(told)
    run(*words[1:], main=entry.replace_main)
    run("--job", studio.folder / "street.job.json", "-o", words[-1], main=entry.replace_main)
    by_line, by_job = done
    assert Path(by_line[0]) == Path(by_job[0]) == studio.folder / "street.mp4"
    assert by_line[2:5] == by_job[2:5]
    [one], [other] = by_line[1], by_job[1]
    for name in Surface.__dataclass_fields__:
        as_told, as_kept = getattr(one, name), getattr(other, name)
        assert f"{as_told}" == f"{as_kept}", name


def test_the_command_line_of_several_surfaces_names_the_job(studio: Studio) -> None:
    content = studio.content
    content["surfaces"] = [{"quad": QUAD}, {"quad": QUAD}]
    words = shlex.split(studio.page.put(studio.url, json=content).json()["command"])
    folder = studio.folder
    assert words == ["ar-replace", "--job", f"{folder}/street.job.json", "-o", f"{folder}/street.ar.mp4"]


def test_the_command_line_of_a_track_names_its_file(tracked: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tracked.folder)
    words = shlex.split(tracked.content["command"])
    assert words == ["ar-replace", "street.mp4", "ad.png", "--track", "street.track.json", "-o", "street.ar.mp4"]


def _stop() -> None:
    raise KeyboardInterrupt
