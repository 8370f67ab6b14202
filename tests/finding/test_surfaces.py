"""What is made of sightings: copies of a picture, and the frames that tracking begins in."""

import logging
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo.errors import InputError, NotFound
from ar_demo.finding.search import Found
from ar_demo.finding.sightings import Appearance, Instance, Sighting, best_of, instances
from ar_demo.finding.surfaces import Wanted
from ar_demo.surface import Moment, Surface, parse_quad

SQUARE = np.array([[10.0, 10], [110, 10], [110, 110], [10, 110]])


def sighting(index: int, deviation: float = 0.5, whole: bool = True, sharpness: float = 0.1) -> Sighting:
    return Sighting(0, index, Fraction(index, 25), SQUARE, 0.9, deviation, 20, whole, sharpness)


def located(poster: Path, *copies: Instance, snap: bool = False) -> list[Surface]:
    wanted = Wanted([Surface("ad.png", find=poster, snap=snap)])
    return wanted.located(Found("clip.mp4", (640, 360), wanted.pictures, [copies], [None], 9))


def test_the_best_is_whole_then_sharp_then_exact() -> None:
    part, blurred, rough, exact = sighting(0, 0.1, False), sighting(1, 0.2, True, 0.05), sighting(2, 0.55), sighting(3)
    assert best_of([part, blurred, rough, exact]) is exact
    assert best_of([part, blurred]) is blurred
    wrong = sighting(5, 2.0, True, 0.2)  # a wrong place has any sharpness
    assert best_of([wrong, exact]) is exact
    assert best_of([part]) is part


def test_as_many_copies_as_are_seen_at_once() -> None:
    spans = [(0, 9), (5, 20), (10, 15), (30, 40), (32, 33)]
    found = instances([Appearance([sighting(a), sighting(b)]) for a, b in spans])
    assert [[each.first.index for each in copy.appearances] for copy in found] == [[0, 10, 30], [5, 32]]


def test_other_appearances_give_keyframes_where_they_are_exact(poster: Path) -> None:
    shots = [Appearance([sighting(0, 0.4)]), Appearance([sighting(10, 0.2)]), Appearance([sighting(20, 5.0)])]
    [surface] = located(poster, Instance(shots))
    assert surface.find is None
    assert surface.start == Moment(frame=10)
    assert surface.quad is SQUARE
    assert [keyframe.at for keyframe in surface.keyframes] == [Moment(frame=0)]


def test_snapping_is_left_to_tracking(poster: Path) -> None:
    assert located(poster, Instance([Appearance([sighting(0)])]), snap=True)[0].snap


def test_unsure_corners_are_told(poster: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        located(poster, Instance([Appearance([sighting(0, 1.9)])]))
        assert not caplog.messages
        located(poster, Instance([Appearance([sighting(7, 4.0)])]))
    assert "known to 4.0 px only, in frame 7" in caplog.text


def test_what_is_never_whole_is_not_tracked(poster: Path, caplog: pytest.LogCaptureFixture) -> None:
    part, whole = (Instance([Appearance([sighting(4, 0.5, is_whole)])]) for is_whole in (False, True))
    with pytest.raises(NotFound, match=r"best in frame 4 with a score of 0\.90, but never wholly inside the frame"):
        located(poster, part)
    assert len(located(poster, part, whole)) == 1
    assert "left out" in caplog.text


def test_find_goes_with_nothing_that_says_the_same() -> None:
    with pytest.raises(InputError, match="quad does nothing beside find"):
        Surface("ad.png", find="poster.png", quad=parse_quad("0,0 9,0 9,9 0,9"))
