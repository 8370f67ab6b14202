"""Where and when clips show a poster, with known corners."""

from pathlib import Path

import numpy as np
import pytest

from ar_demo import TrackingOptions
from ar_demo.errors import NotFound
from ar_demo.surface import Span

from ..clips import make_clip
from ..scenes import Scene, error, moved, path
from .conftest import FRAMES, Search, places


def test_a_photograph_is_found_where_the_poster_is(find: Search, clip: Path, poster: Path) -> None:
    found = find(clip, poster)
    [copy] = found.instances[0]
    truth = path(Scene().quad, FRAMES)
    sightings = [one for each in copy.appearances for one in each.sightings]
    assert len(sightings) > 0.9 * found.looks
    assert np.median([error(one.corners, truth[one.index]) for one in sightings]) < 0.5
    assert error(copy.best.corners, truth[copy.best.index]) < 0.7
    assert copy.best.is_whole


def test_another_picture_is_not_found(find: Search, clip: Path, other: Path) -> None:
    found = find(clip, other)
    assert found.instances == [[]]
    with pytest.raises(NotFound, match=r"other\.png is not seen in .*street\.mp4: (nothing|the best candidate is in)"):
        found.check(0)


def test_two_at_once_are_two(find: Search, shots: Path, poster: Path, other: Path) -> None:
    found = find(shots, other, poster)
    assert found.instances[0] == []
    copies = found.instances[1]
    truth = places(Scene())
    assert len(copies) == 2
    first = [copy.appearances[0] for copy in copies]
    assert all(each.first.index == 0 and each.last.index <= 7 for each in first)
    for place in truth[:2]:
        assert min(error(each.best.corners, place) for each in first) < 1


def test_it_is_found_again_in_another_shot(find: Search, shots: Path, poster: Path) -> None:
    last = [each for copy in find(shots, poster).instances[0] for each in copy.appearances if each.first.index > 7]
    assert len(last) == 1
    assert last[0].first.index >= 16
    assert error(last[0].best.corners, places(Scene())[2]) < 1


def test_only_the_time_that_is_named_is_searched(find: Search, shots: Path, poster: Path) -> None:
    found = find(shots, poster, options=TrackingOptions(time=Span.parse("9..15")))
    assert found.instances == [[]]
    found = find(shots, poster, options=TrackingOptions(time=Span.parse("16..")))
    assert [copy.best.index >= 16 for copy in found.instances[0]] == [True]


def test_corners_may_lie_outside_the_frame(tmp_path: Path, find: Search, poster: Path) -> None:
    scene = Scene()
    corners = moved(scene.quad, (-120, 0))
    clip = make_clip(tmp_path / "part.mp4", [scene.draw(corners)] * 6)
    [copy] = find(clip, poster).instances[0]
    assert not copy.best.is_whole
    assert copy.best.corners[:, 0].min() < -5
    assert error(copy.best.corners, corners) < 2


def test_it_is_found_seen_from_aside(tmp_path: Path, find: Search, poster: Path) -> None:
    """At a third of its width, as from 70 degrees."""
    scene = Scene(width=400)
    corners = np.array([[150.0, 50], [215, 62], [214, 170], [152, 190]])
    clip = make_clip(tmp_path / "aside.mp4", [scene.draw(corners)] * 4)
    [copy] = find(clip, poster).instances[0]
    assert error(copy.best.corners, corners) < 1.5
