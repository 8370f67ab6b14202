"""How far the verdict can be believed: what counts as wrong and as good, and the tables."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ar_demo.evaluation import verdicts
from ar_demo.evaluation.verdicts import Case, Outcome, by_threshold, cases, table, tracked
from ar_demo.verdict import LIMITS
from hdn.benchmark.degradation import DEGRADATIONS
from hdn.imaging.arrays import Array

from ..clips import make_clip
from ..export.tracks import make
from ..scenes import Scene, path

FRAMES = 6
TRUTH = np.stack(path(Scene().quad, FRAMES))


def outcome(
    off: float = 0.0, lost: int = 0, deviation: float = 0.2, seen: float = 1.0, truth: Array = TRUTH
) -> Outcome:
    """Of a track that is off in frame 3, lost in the last ones, and as uncertain as said."""
    corners = TRUTH.copy()
    corners[3] += [off, 0]
    corners[FRAMES - lost :] = np.nan
    found = make(corners)
    found.deviation[3] = deviation
    share = np.ones(FRAMES)
    share[3:] = seen
    return Outcome.of(Case("a", "clean", True, (), TRUTH[0], truth, share), found)


@pytest.mark.parametrize(
    ("of", "wrong", "good"),
    [
        ({}, False, True),
        ({"off": 4.9}, False, True),
        ({"off": 7}, False, False),
        ({"off": 11}, True, False),
        ({"off": 11, "seen": 0}, False, True),
        ({"lost": 2}, False, False),
        ({"lost": 2, "seen": 0.5}, False, True),
    ],
)
def test_what_is_wrong_and_what_is_good(of: dict[str, float], wrong: bool, good: bool) -> None:
    found = outcome(**of)  # type: ignore[arg-type]
    assert (found.wrong, found.good) == (wrong, good)


def test_frames_without_a_truth_do_not_count() -> None:
    truth = TRUTH.copy()
    truth[3] = np.nan
    assert outcome(off=50, truth=truth).good


def test_tables() -> None:
    some = [outcome(), outcome(deviation=9), outcome(off=11), outcome(off=11, deviation=9), outcome(lost=2, seen=0.1)]
    rows = table([*some, replace(outcome(), chosen_by=False)], LIMITS)
    assert rows[-2].endswith("** | 5 | 2 | 1 of 2 | 2 of 3 | 1 of 2 |")
    assert rows[-1].endswith("** | 1 | 1 | 0 of 0 | 0 of 1 | 0 of 1 |")
    rows = by_threshold(some)
    assert "| 2 px | 5% | 1 of 2 | 0 of 0 | 1 of 2 | 0 of 0 |" in rows


def test_clips_are_tracked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, asked = Scene(), []
    folder = tmp_path / "clips"
    folder.mkdir()
    make_clip(folder / "poster.mp4", [scene.draw(corners) for corners in TRUTH])
    (folder / "poster.json").write_text(json.dumps({"corners": TRUTH.tolist()}))
    monkeypatch.setattr(verdicts, "DRAWN_EACH", 0)

    def stand_in(video: Path, surface: Any) -> Any:
        asked.append(video)
        return make(TRUTH)

    monkeypatch.setattr(verdicts, "track", stand_in)
    first = [(case.kind, found) for case, found in tracked(cases(folder, FRAMES), tmp_path / "out")]
    assert [kind for kind, _ in first] == ["clean", *DEGRADATIONS, *verdicts.EVENTS[1:]]
    count = len(asked)
    assert count == len(first)
    assert len([*tracked(cases(folder, FRAMES), tmp_path / "out")]) == count == len(asked)
