"""The verdict on tracks: thresholds, reasons, exit statuses."""

from fractions import Fraction

import numpy as np
import pytest

from ar_demo import InputError, Limits, Track, judge
from ar_demo.tracks import Source
from ar_demo.verdict import parse_share
from hdn.state import State

QUAD = np.array([[10.0, 10], [90, 10], [90, 90], [10, 90]])


def made(held: int = 0, lost: int = 0, deviation: float = 0.3, frames: int = 100, width: int = 640) -> Track:
    """A track that ends with so many held, and then so many lost frames."""
    states: list[State] = ["tracked"] * (frames - held - lost)
    states += ["held"] * held + ["lost"] * lost
    corners = np.repeat(QUAD[None], frames, 0)
    known = np.array([state != "lost" for state in states])
    corners[~known] = np.nan
    deviations = np.where(known, 0.2, np.inf)
    deviations[frames // 2] = deviation
    times = [Fraction(i, 25) for i in range(frames)]
    source = Source("a.mp4", width, 360, Fraction(25), frames)
    return Track(source, 0, QUAD, times, corners, states, known.astype(float), deviations)


@pytest.mark.parametrize(
    ("track", "status", "words"),
    [
        (made(), "pass", []),
        (made(held=50), "pass", []),
        (made(held=51), "check", ["held in 51 of 100 frames (51.0%)"]),
        (made(lost=1), "check", ["lost in 1 of 100 frames (1.0%)"]),
        (made(lost=50), "check", ["lost"]),
        (made(lost=51), "fail", ["lost"]),
        (made(deviation=1.6), "check", ["1.6 px at worst, by more than 1.5 px in 1 frame"]),
        (made(deviation=2.1, width=1920), "pass", []),
        (made(held=60, lost=10, deviation=4), "check", ["lost", "held", "4.0 px"]),
    ],
)
def test_thresholds(track: Track, status: str, words: list[str]) -> None:
    verdict = judge(track)
    assert verdict.status == status
    assert len(verdict.reasons) == len(words)
    assert all(word in reason for word, reason in zip(words, verdict.reasons, strict=True))
    assert verdict.exit_status == {"pass": 0, "check": 4, "fail": 5}[status]


def test_thresholds_can_be_moved() -> None:
    track = made(held=20, lost=60, deviation=4)
    assert judge(track, Limits(0.2, 0.6, 0.1, 4)).status == "pass"
    assert judge(track, Limits(0.2, 0.5, 0.6, 4)).status == "check"
    assert judge(made(held=1), Limits(max_held=0)).status == "check"


def test_the_worst_surface_counts_and_is_named() -> None:
    verdict = judge([made(), made(held=60, deviation=3)])
    assert verdict.status == "check"
    assert [reason[:9] for reason in verdict.reasons] == ["surface 2"] * 2
    assert verdict.summary() == {
        "status": "check",
        "reasons": verdict.reasons,
        "held": 0.6,
        "lost": 0.0,
        "deviation": 3.0,
    }


def test_only_the_span_counts() -> None:
    assert judge(made(lost=60).within(0, 39)).status == "pass"


def test_no_track_is_refused() -> None:
    with pytest.raises(InputError, match="no track"):
        judge([])


@pytest.mark.parametrize(
    ("text", "share"), [("5%", 0.05), ("0.05", 0.05), (0.5, 0.5), (" 12.5 % ", 0.125), ("100%", 1)]
)
def test_shares(text: str | float, share: float) -> None:
    assert parse_share(text) == pytest.approx(share)


@pytest.mark.parametrize("text", ["5", "101%", "-1%", "many", "", "nan"])
def test_what_is_no_share(text: str) -> None:
    with pytest.raises(InputError, match="no share"):
        parse_share(text)


@pytest.mark.parametrize(
    "limits", [{"max_held": 2}, {"max_lost": -0.1}, {"max_deviation": -1}, {"max_deviation": np.inf}]
)
def test_limits_out_of_range(limits: dict[str, float]) -> None:
    with pytest.raises(InputError, match="out of range"):
        Limits(**limits)
