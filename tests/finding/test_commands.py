"""ar-find, and --find of ar-replace and ar-track, end to end."""

import json
from pathlib import Path

import numpy as np
import pytest

from ar_demo.cli import entry
from ar_demo.tracks import Track

from ..conftest import Main, Run
from ..scenes import Scene, error, path, texture
from .conftest import FRAMES, places, written

pytestmark = pytest.mark.usefixtures("shared_networks")


@pytest.fixture
def main() -> Main:
    return entry.find_main


@pytest.fixture
def ad(tmp_path: Path) -> Path:
    return written(tmp_path / "ad.png", np.full((60, 80, 3), (255, 0, 0), np.uint8))


def test_the_table_says_where_and_when(run: Run, shots: Path, poster: Path, other: Path) -> None:
    code, out, err = run(shots, poster, other, "--quiet")
    assert (code, err) == (0, "")
    head, *rows, missing, looks = out.splitlines()
    assert head.split() == ["picture", "frames", "seconds", "best", "score", "corners"]
    assert len(rows) == 3
    assert {row.split("  ")[0] for row in rows} == {"poster.png (1)", "poster.png (2)"}
    assert missing.startswith("other.png is not seen: ")
    assert looks == "24 frames looked at"


def test_json_says_the_same(run: Run, shots: Path, poster: Path) -> None:
    code, out, _ = run(shots, poster, "--json", "--time", "16..")
    assert code == 0
    found = json.loads(out)
    [picture] = found["pictures"]
    [copy] = picture["instances"]
    assert picture["picture"] == str(poster)
    assert error(np.array(copy["best"]["corners"]), places(Scene())[2]) < 1
    assert copy["seen"][0]["first"] >= 16
    assert copy["best"]["whole"] is True


def test_what_is_not_seen_exits_with_3(run: Run, clip: Path, other: Path, ad: Path, tmp_path: Path) -> None:
    code, out, err = run(clip, other)
    assert code == 3
    assert "other.png is not seen" in out
    output = tmp_path / "out.mp4"
    code, _, err = run(clip, ad, "--find", other, "-o", output, "--quiet", main=entry.replace_main)
    assert code == 3
    assert err.count("\n") == 1
    assert f"{other} is not seen in {clip}: " in err
    assert not output.exists()


def test_ar_track_begins_where_the_poster_is_found(run: Run, clip: Path, poster: Path, tmp_path: Path) -> None:
    file = tmp_path / "t.json"
    code, _, err = run(clip, "--find", poster, "-o", file, "--quiet", main=entry.track_main)
    assert code == 0, err
    track, truth = Track.load(file), path(Scene().quad, FRAMES)
    assert set(track.states) == {"tracked"}
    assert np.median([error(a, b) for a, b in zip(track.corners, truth, strict=True)]) < 1


def test_every_copy_gets_the_ad_through_cuts(run: Run, shots: Path, poster: Path, ad: Path, tmp_path: Path) -> None:
    arguments = [shots, ad, "--find", poster, "-o", tmp_path / "o.mp4", "--save-track", tmp_path / "t.json", "--quiet"]
    code, _, err = run(*arguments, main=entry.replace_main)
    assert code == 0, err
    tracks = [Track.load(tmp_path / f"t.{number}.json") for number in (1, 2)]
    left, right, elsewhere = places(Scene())
    for place in (left, right):
        assert min(error(track.corners[3], place) for track in tracks) < 1
    assert all(track.states[12] == "lost" for track in tracks)
    assert min(error(track.corners[20], elsewhere) for track in tracks) < 1.5


def test_each_picture_has_its_ad(run: Run, clip: Path, poster: Path, ad: Path, tmp_path: Path) -> None:
    plan = [clip, "--find", f"{poster}={ad}", "-o", tmp_path / "o.mp4", "--dry-run", "--json"]
    code, out, err = run(*plan, main=entry.replace_main)
    assert code == 0, err
    [surface] = json.loads(out)["surfaces"]
    assert surface["ad"] == str(ad)
    code, _, err = run(clip, ad, *plan[1:], main=entry.replace_main)
    assert code == 2
    assert "PICTURE=AD" in err


def test_a_folder_gives_what_is_seen_of_it(run: Run, clip: Path, poster: Path, ad: Path, tmp_path: Path) -> None:
    library = tmp_path / "library"
    library.mkdir()
    (library / "poster.png").write_bytes(poster.read_bytes())
    written(library / "another.png", texture(78, 200, 200))
    job = {"version": 1, "input": str(clip), "surfaces": [{"ad": "ad.png", "find": "library"}]}
    (tmp_path / "job.json").write_text(json.dumps(job))
    code, out, err = run("--job", tmp_path / "job.json", "--dry-run", "--json", main=entry.replace_main)
    assert code == 0, err
    assert len(json.loads(out)["surfaces"]) == 1
    code, _, err = run(
        "--job", tmp_path / "job.json", "--dry-run", "--json", "--quad", "1,1 9,1 9,9 1,9", main=entry.replace_main
    )
    assert code == 2
