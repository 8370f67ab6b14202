"""Tracking must not get worse: average precision on freshly made SynthPlanar clips against a committed reference.

Where it changed on purpose, `python -m tests.benchmark.test_gate` from the repository's root writes a new reference.
"""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from hdn.benchmark.datasets import open_dataset
from hdn.benchmark.metrics import PRECISION_THRESHOLDS, measure, within
from hdn.benchmark.running import Job, run
from hdn.benchmark.synthplanar.cli import SETTINGS, VERSION, generate
from hdn.benchmark.synthplanar.pictures import Pictures

REFERENCE = Path(__file__).with_name("reference_precision.json")
UPDATE = "python -m tests.benchmark.test_gate"
TOLERANCE = 0.02
ATTRIBUTES = ("scale", "rotation", "motion blur", "occlusion", "low light", "low texture")
FRAMES, SEED = 30, 4

Precision = dict[str, float]  # by attribute, and their mean


def make_clips(folder: Path) -> Path:
    for attribute in ATTRIBUTES:
        generate(folder, attribute, 0, SETTINGS["quick"], FRAMES, SEED, Pictures(None))
    return folder


def measured(folder: Path, tracker: str = "hdn") -> Precision:
    found: Precision = {}
    for sequence in open_dataset(f"clips:{folder}"):
        track = run(Job(sequence, tracker, folder / "unused"))
        errors = measure(sequence.truth, track.corners, track.states, track.seconds).errors
        found[sequence.attributes[0]] = float(within(errors, PRECISION_THRESHOLDS).mean())
    return {"mean": sum(found.values()) / len(found)} | found


def verdict(now: Precision, before: Precision) -> str:
    """What is wrong in one line; nothing where all is well."""
    if now["mean"] >= before["mean"] - TOLERANCE:
        return ""
    worst = max(ATTRIBUTES, key=lambda a: before[a] - now[a])
    return (
        f"hdn's average precision fell from {before['mean']:.3f} to {now['mean']:.3f}, by more than {TOLERANCE} "
        f"(most in {worst}, {before[worst]:.3f} to {now[worst]:.3f}); if that is meant, {UPDATE} writes a new reference"
    )


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_clips(tmp_path_factory.mktemp("gate"))


@pytest.fixture(scope="module")
def reference() -> Precision:
    data = json.loads(REFERENCE.read_text(encoding="utf-8"))
    assert data["generator"] == VERSION, f"SynthPlanar has changed, so that the reference is of other clips: {UPDATE}"
    return data["precision"]


def test_tracking_is_no_worse_than_the_reference(clips: Path, reference: Precision) -> None:
    wrong = verdict(measured(clips), reference)
    if wrong:
        pytest.fail(wrong, pytrace=False)


def test_a_worse_tracker_would_not_pass(clips: Path, reference: Precision) -> None:
    wrong = verdict(measured(clips, "sift"), reference)  # HDN's halves alone are hardly worse on these clips
    assert f"fell from {reference['mean']:.3f} to 0." in wrong
    assert UPDATE in wrong
    assert "\n" not in wrong


if __name__ == "__main__":
    with TemporaryDirectory() as name:
        precision = {key: round(value, 4) for key, value in measured(make_clips(Path(name))).items()}
    REFERENCE.write_text(json.dumps({"generator": VERSION, "precision": precision}, indent=2) + "\n", encoding="utf-8")
    print(f"{REFERENCE.name}: {precision}")
