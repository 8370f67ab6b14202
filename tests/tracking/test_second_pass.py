"""The second pass: it mends what a poor first view spoilt, and is not made where that was good."""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo.options import TrackingOptions
from ar_demo.pipeline import track
from ar_demo.progress import Progress
from ar_demo.surface import Surface
from ar_demo.tracking.passes import Passes
from ar_demo.tracking.solution import blank, may_gain
from ar_demo.tracks import Source, Track
from hdn import Tracker
from hdn.networks.engine import Engine

from ..clips import make_clip
from ..plane.test_picture import BAD, FRAMES, TRUTH, as_it_is, blurred, frames_of
from ..scenes import error


def both(clip: Path, monkeypatch: pytest.MonkeyPatch, engine: Engine) -> tuple[Track, Track, list[str]]:
    """The clip's track without and with the second pass, and the stages of the latter."""
    events: list[Progress] = []

    def measured(listen: Callable[[Progress], None]) -> Track:
        options = TrackingOptions(smooth=0)
        return track(clip, Surface(quad=TRUTH[0]), options, listen, lambda: Tracker(engine=engine))

    second = measured(events.append)
    monkeypatch.setattr(Passes, "_again", lambda *_: iter(()))
    return measured(lambda _: None), second, [event.stage for event in events]


def test_the_second_pass_mends_a_blurred_beginning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, engine: Engine
) -> None:
    clip = make_clip(tmp_path / "a.mp4", frames_of(blurred), rate=30, options={"crf": "16"})
    once, twice, stages = both(clip, monkeypatch, engine)
    errors = [np.array([error(c, t) for c, t in zip(track.corners, TRUTH, strict=True)]) for track in (once, twice)]
    assert "again: track" in stages
    assert twice.counts["tracked"] == FRAMES
    assert np.median(errors[1][BAD:]) < 0.6 * np.median(errors[0][BAD:])
    np.testing.assert_array_equal(twice.corners[0], TRUTH[0])
    assert twice.deviation[1:].min() > 0  # where the second pass began counts as measured, not as given


def test_a_good_first_view_costs_no_second_pass(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, engine: Engine
) -> None:
    clip = make_clip(tmp_path / "a.mp4", frames_of(as_it_is), rate=30, options={"crf": "16"})
    once, twice, stages = both(clip, monkeypatch, engine)
    assert set(stages) == {"track"}
    assert once.states == twice.states
    np.testing.assert_allclose(twice.corners, once.corners, atol=1e-3)


def test_a_picture_whose_place_is_unsure_is_not_worth_a_pass() -> None:
    source = Source("a.mp4", 320, 240, Fraction(30), 3)
    found = blank(source, 0, TRUTH[0], [Fraction(i, 30) for i in range(3)], {})
    found.deviation = np.array([0.0, 1.0, 1.2])
    assert may_gain(found, 1.4)
    assert not may_gain(found, 1.6)
