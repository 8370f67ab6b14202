import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ar_demo.tracks import Source, Track
from hdn.errors import InputError
from hdn.imaging.homography import transform
from hdn.imaging.regions import Region

QUAD = np.array([[10.0, 20], [110, 25], [105, 90], [8, 80]])


@pytest.fixture
def track() -> Track:
    corners = np.stack([QUAD, QUAD * 1.1 + 3, np.full((4, 2), np.nan)])
    source = Source("street.mp4", 320, 240, Fraction(30000, 1001), 3)
    times = [Fraction(i * 1001, 30000) for i in range(3)]
    return Track(
        source,
        0,
        QUAD,
        times,
        corners,
        ["tracked", "held", "lost"],
        np.array([1, 0.5, 0]),
        np.array([0.2, np.inf, np.inf]),
    )


def test_round_trip(track: Track, tmp_path: Path) -> None:
    track.save(tmp_path / "t.json")
    again = Track.load(tmp_path / "t.json")
    assert again.source == track.source
    assert again.states == track.states
    np.testing.assert_allclose(again.corners, track.corners, atol=1e-4)
    np.testing.assert_allclose([float(t) for t in again.times], [float(t) for t in track.times], atol=1e-6)


def test_file_is_version_1_as_designed(track: Track, tmp_path: Path) -> None:
    track.save(tmp_path / "t.json")
    content = json.loads((tmp_path / "t.json").read_text())
    assert content["version"] == 1
    size = {"width": 320, "height": 240}
    assert content["source"] == {
        "path": "street.mp4",
        **size,
        "fps": "30000/1001",
        "frames": 3,
        "fingerprint": None,
        "pixel_aspect": "1",
        "first_number": None,
    }
    assert content["frames"][2]["corners"] is None
    assert content["frames"][2]["homography"] is None
    homography = np.array(content["frames"][1]["homography"])
    assert homography[2, 2] == 1
    np.testing.assert_allclose(transform(homography, QUAD), content["frames"][1]["corners"], atol=1e-3)


def test_keyframes_and_cuts_are_kept(track: Track, tmp_path: Path) -> None:
    track.keyframes, track.cuts = {1: track.corners[1]}, [2]
    track.save(tmp_path / "t.json")
    again = Track.load(tmp_path / "t.json")
    assert again.cuts == [2]
    np.testing.assert_array_equal(again.keyframes[1], track.corners[1])
    assert again.given.keys() == {0, 1}


def test_warnings_are_kept(track: Track, tmp_path: Path) -> None:
    track.warnings = ["frames 1 to 2: the surface is hardly seen", "street.mp4 is damaged"]
    track.save(tmp_path / "t.json")
    assert Track.load(tmp_path / "t.json").warnings == track.warnings


def test_the_region_is_kept(track: Track, tmp_path: Path) -> None:
    track.region = Region(QUAD * 2, (QUAD[:3], QUAD[1:]))
    track.save(tmp_path / "t.json")
    again = Track.load(tmp_path / "t.json").region
    np.testing.assert_array_equal(again.include, QUAD * 2)
    np.testing.assert_array_equal(again.exclude, [QUAD[:3], QUAD[1:]])


def test_a_file_without_them_loads_as_before(track: Track, tmp_path: Path) -> None:
    path = tmp_path / "t.json"
    track.save(path)
    content = json.loads(path.read_text())
    for name in ("keyframes", "cuts", "region", "exclude", "warnings"):
        del content[name]
    path.write_text(json.dumps(content))
    again = Track.load(path)
    assert (again.keyframes, again.cuts) == ({}, [])
    assert again.region.is_everywhere
    assert again.warnings == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 2}, "version 2"),
        ({"keyframes": [{"frame": 7, "corners": QUAD.tolist()}]}, "frame 7"),
        ({"keyframes": [{"frame": 1, "corners": [[1, 2]]}]}, "damaged"),
        ({"quad": [[1, 2]]}, "damaged"),
        ({"region": [[1, 2], [3, 4]]}, "three corners"),
        ({"span": [2, 9]}, "span from 2 to 9"),
        ({"span": 3}, "damaged"),
        ({"exclude": [[[1, 1], [9, 9], [9, 1], [1, 9]]]}, "crosses itself"),
        ({"exclude": [5]}, "three corners"),
        ({"frames": []}, "damaged"),
        ({"frames": [{"index": 0}]}, "damaged"),
        ({"source": {"path": "x"}}, "damaged"),
    ],
)
def test_refuses_what_is_no_track(track: Track, tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = tmp_path / "t.json"
    track.save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=message) as error:
        Track.load(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", ["", "hello", "[1]", '{"a": 1}'])
def test_refuses_other_files(tmp_path: Path, content: str) -> None:
    path = tmp_path / "t.json"
    path.write_text(content)
    with pytest.raises(InputError, match="not a track file"):
        Track.load(path)


def test_leaves_nothing_behind_where_it_cannot_write(track: Track, tmp_path: Path) -> None:
    target = tmp_path / "taken"
    target.mkdir()
    with pytest.raises(InputError, match="is a folder"):
        track.save(target)
    assert list(tmp_path.iterdir()) == [target]


def test_a_span_is_kept(track: Track, tmp_path: Path) -> None:
    part = track.within(1, 9)
    assert (part.span, track.span) == ((1, 2), None)
    assert (part.counts, part.known.tolist()) == ({"tracked": 0, "held": 1, "lost": 1}, [False, True, False])
    assert part.seconds == (Fraction(1001, 30000), Fraction(3 * 1001, 30000))
    part.save(tmp_path / "t.json")
    assert Track.load(tmp_path / "t.json").span == (1, 2)


def test_the_track_as_saved_is_that_of_its_file(track: Track, tmp_path: Path) -> None:
    track.corners += 1 / 3
    track.save(tmp_path / "t.json")
    saved, loaded = track.as_saved(), Track.load(tmp_path / "t.json")
    np.testing.assert_array_equal(saved.corners, loaded.corners)
    np.testing.assert_array_equal(saved.deviation, loaded.deviation)
    assert saved.times == loaded.times == track.times
    assert not np.array_equal(saved.corners, track.corners, equal_nan=True)
