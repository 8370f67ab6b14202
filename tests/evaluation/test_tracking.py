"""`ar-eval-track`: the product's own tracking of whole clips, in the tables beside other trackers."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from ar_demo.evaluation import tracking
from ar_demo.evaluation.tracking import track_clip, write_lossless
from ar_demo.media.reader import VideoReader
from hdn.benchmark import cli as hdn_eval
from hdn.benchmark.datasets import open_dataset
from hdn.benchmark.identity import sources, tracker_sources
from hdn.benchmark.running import ClipTracker, Track
from hdn.benchmark.sequences import Sequence
from hdn.errors import InputError

from ..clips import make_clip
from ..conftest import Main, Run
from ..scenes import Scene, path

FRAMES = 8
PACKAGE = Path(tracking.__file__).parents[1]


@pytest.fixture
def main() -> Main:
    return tracking.main


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip of a poster, its corners in the last frame but one not known."""
    folder = tmp_path_factory.mktemp("posters")
    scene = Scene()
    truth = path(scene.quad, FRAMES)
    make_clip(folder / "poster.mp4", [scene.draw(corners) for corners in truth], rate=30)
    corners = [c.tolist() for c in truth]
    (folder / "poster.json").write_text(json.dumps({"corners": [*corners[:-2], None, corners[-1]]}))
    return folder


def poster(clips: Path) -> Sequence:
    [sequence] = open_dataset(str(clips))
    return sequence


@pytest.mark.parametrize("size", [(64, 48), (61, 47)])
def test_the_temporary_video_gives_back_the_very_same_frames(tmp_path: Path, size: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 256, (size[1], size[0], 3), np.uint8) for _ in range(5)]
    assert write_lossless(iter(frames), tmp_path / "clip.mkv", "noise") == 5
    read = [frame.image for frame in VideoReader(tmp_path / "clip.mkv").frames()]
    np.testing.assert_array_equal(read, frames)


def test_frames_of_several_sizes_are_refused(tmp_path: Path) -> None:
    frames = [np.zeros((48, width, 3), np.uint8) for width in (64, 64, 62)]
    with pytest.raises(InputError, match="views/one has frames of several sizes"):
        write_lossless(iter(frames), tmp_path / "clip.mkv", "views/one")


@pytest.mark.usefixtures("shared_networks")
def test_one_command_compares_it_with_others(run: Run, clips: Path, tmp_path: Path) -> None:
    status, out, err = run(clips, "--trackers", "ar-track", "flow", "--degrade", "dark", "--out", tmp_path)
    assert (status, err) == (0, "")
    with (tmp_path / "summary.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(r["dataset"], r["tracker"]) for r in rows] == [(f"{clips.name}+dark", t) for t in ("ar-track", "flow")] * 2
    assert float(rows[0]["P<=5"]) == 1
    assert float(rows[0]["ms"]) > 0
    assert "| ar-track | " in out
    assert f"{FRAMES - 2} frames that count" in out  # all but the first and the unknown
    track = json.loads((tmp_path / "tracks" / f"{clips.name}+dark" / "ar-track" / "poster.json").read_text())
    assert len(track["corners"]) == len(track["states"]) == FRAMES
    assert track["corners"][0] == np.round(poster(clips).quad, 4).tolist()


def test_tracks_are_kept_while_code_and_weights_are_the_same(
    run: Run, clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[str] = []
    code = "one"

    def still(clip: Sequence, weights: Path | None) -> Track:
        started.append(clip.name)
        return Track(np.stack([clip.quad] * FRAMES), ("tracked",) * FRAMES, np.ones(FRAMES - 1))

    def runs() -> int:
        started.clear()
        assert run(clips, "--trackers", "ar-track", "--out", tmp_path, "--quiet") == (0, "", "")
        return len(started)

    monkeypatch.setitem(tracking.CLIP_TRACKERS, "ar-track", ClipTracker(still, lambda _: code))
    assert [runs(), runs()] == [1, 0]
    code = "another"
    assert runs() == 1


def test_what_makes_a_track(tmp_path: Path) -> None:
    before = tracking.made_by(None)
    assert tracking.made_by(None) == before
    (tmp_path / "weights").write_bytes(b"others")
    assert tracking.made_by(tmp_path / "weights") != before
    named = {path.name for path in [*tracker_sources(), *sources(PACKAGE, tracking.NO_PART)]}
    assert {"passes.py", "reader.py", "lucas_kanade.py", "session.py"} <= named
    assert not {"opengl.py", "report.py", "metrics.py"} & named


@pytest.mark.parametrize(
    ("error", "said"), [(ValueError("no luck\nat all"), "failed: at all"), (InputError("no"), "no")]
)
def test_a_failure_is_said(
    run: Run, clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, said: str
) -> None:
    def fail(clip: Sequence, weights: Path | None) -> Track:
        raise error

    monkeypatch.setitem(tracking.CLIP_TRACKERS, "ar-track", ClipTracker(fail, lambda _: ""))
    status, _, err = run(clips, "--trackers", "ar-track", "--out", tmp_path)
    assert status == 1
    assert err.startswith("error: 1 of 1 runs failed; the first: ")
    assert err.endswith(f"{said}\n")


@pytest.mark.usefixtures("shared_networks")
def test_a_target_that_is_refused_is_lost_in_every_frame(clips: Path, caplog: pytest.LogCaptureFixture) -> None:
    sequence = poster(clips)
    small = Sequence("set", "small", sequence.source, sequence.quad * 0.01 + 50, sequence.truth)
    track = track_clip(small, None)
    assert track.states == ("tracked", *["lost"] * (FRAMES - 1))
    assert np.isnan(track.corners[1:]).all()
    assert "counts as lost throughout: the quad is under 16 px" in caplog.text


def test_hdn_eval_alone_does_not_know_it(run: Run, clips: Path, tmp_path: Path) -> None:
    status, _, err = run(clips, "--trackers", "ar-track", "--out", tmp_path, main=hdn_eval.main)
    assert status == 2
    assert "there is no tracker 'ar-track'" in err
