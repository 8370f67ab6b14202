"""How the ad comes and goes where the surface is lost."""

from fractions import Fraction

import numpy as np
import pytest

from ar_demo.rendering.presentation import presentation
from ar_demo.surface import Surface
from ar_demo.tracks import Source, Track

QUAD = np.array([[10.0, 20], [110, 25], [105, 90], [8, 80]])
LOSS = slice(20, 50)


@pytest.fixture
def track() -> Track:
    corners = np.repeat(QUAD[None], 80, 0)
    corners[50:] += 60  # it comes back elsewhere
    corners[LOSS] = np.nan
    states = ["tracked"] * 20 + ["lost"] * 30 + ["tracked"] * 30
    times = [Fraction(i, 30) for i in range(80)]
    return Track(Source("a.mp4", 320, 240, Fraction(30), 80), 0, QUAD, times, corners, states, np.ones(80), np.ones(80))  # type: ignore[arg-type]


def test_fades_out_where_it_was_and_is_back_at_once(track: Track) -> None:
    poses, opacity = presentation(track, Surface(lost="fade", opacity=0.8))
    assert opacity[19] == pytest.approx(0.8)
    assert (np.diff(opacity[19:28]) <= 0).all()
    assert opacity[22] > 0 == opacity[30]
    assert opacity[50:] == pytest.approx(0.8)  # what is replaced does not shine through where the pose is known
    np.testing.assert_array_equal(poses[25], QUAD)
    np.testing.assert_array_equal(poses[50], QUAD + 60)


def test_hold_glides_back_without_a_jump(track: Track) -> None:
    poses, opacity = presentation(track, Surface(lost="hold"))
    assert (opacity == 1).all()
    np.testing.assert_array_equal(poses[30], QUAD)
    steps = np.abs(np.diff(poses, axis=0)).max((1, 2))
    assert steps.max() < 15 < 60
    np.testing.assert_array_equal(poses[50], QUAD + 60)


def test_hide_goes_at_once(track: Track) -> None:
    _, opacity = presentation(track, Surface(lost="hide"))
    np.testing.assert_array_equal(opacity == 1, track.known)


def test_nothing_is_drawn_before_it_is_first_seen(track: Track) -> None:
    track.corners[:20] = np.nan
    poses, opacity = presentation(track, Surface(lost="hold"))
    assert (opacity[:50] == 0).all()
    assert np.isnan(poses[:50]).all()


@pytest.mark.parametrize("lost", ["fade", "hold", "hide"])
def test_a_cut_ends_it_at_once(track: Track, lost: str) -> None:
    track.cuts = [20, 50]
    _, opacity = presentation(track, Surface(lost=lost))  # type: ignore[arg-type]
    np.testing.assert_array_equal(opacity == 1, track.known)
    assert (opacity[LOSS] == 0).all()


@pytest.mark.parametrize("lost", ["hold", "fade", "hide"])
def test_outside_a_span_there_is_nothing(track: Track, lost: str) -> None:
    _, opacity = presentation(track.within(5, 60), Surface(lost=lost))  # type: ignore[arg-type]
    assert (opacity[:5] == 0).all()
    assert (opacity[5:20] == 1).all()
    assert (opacity[50:61] == 1).all()
    assert (opacity[61:] == 0).all()
