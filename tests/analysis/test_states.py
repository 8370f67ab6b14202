import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as Pillow

from hdn.alignment.refinement import CELLS
from hdn.analysis import cli, states_clips, states_measures
from hdn.benchmark.metrics import roc_area
from hdn.errors import InputError
from hdn.imaging.arrays import Array

from ..conftest import Run
from ..scenes import Scene, path

QUAD = np.array([[20.0, 20], [99, 20], [99, 59], [20, 59]]) - 0.5


def still(frames: int = 150) -> states_clips.Clip:
    """A white target on black in a 120 x 80 frame, which does not move; elsewhere all is grey."""
    image = np.zeros((80, 120, 3), np.uint8)
    image[20:59, 20:99] = 255
    elsewhere = np.full((80, 120, 3), 128, np.uint8)
    return states_clips.Clip("still", "white", [image] * frames, np.repeat(QUAD[None], frames, 0), elsewhere)


def answers(states: str, errors: list[float], shares: list[float], **others: Array) -> states_measures.Answers:
    """T, H and L for the states; all else as the tracker would have it that knows all."""
    n = len(states)
    seen = np.array(shares)[:, None, None] * np.ones((n, CELLS, CELLS))
    values = {
        "confidences": np.array(shares),
        "deviations": np.ones(n),
        "visibility": seen,
        "seen": seen,
        "in_frame": np.ones_like(seen),
    } | others
    words = np.array([{"T": "tracked", "H": "held", "L": "lost"}[s] for s in states])
    return states_measures.Answers("g", "e", words, errors=np.array(errors), **values)


def test_figures_are_those_counted_by_hand() -> None:
    a = answers("TTTTHLLLTT", [1, 1, 11, 1, 50, 50, 50, 50, 3, 1], [1, 1, 1, 0, 0, 0, 1, 1, 1, 0.6])
    f = states_measures.figures([a])
    assert f["frames"] == 10
    assert f["tracked"] == 0.6
    assert f["false tracked"] == pytest.approx(2 / 6)  # 11 px off, and tracked where nothing is seen
    assert f["false lost"] == pytest.approx(2 / 6)
    assert (f["returns"], f["found soon"], f["frames to find"]) == (1, 1, 2)
    assert f["within 2 deviations"] == pytest.approx(4 / 6)


def test_a_target_that_is_not_found_before_it_goes_again_is_not_found() -> None:
    shares = [1, 0, 1, 1, 0, 0.5, 0.99, 1, 1, 1, 0, 1]
    assert states_measures.recoveries(answers("TLLLLLLTTTLT", [0] * 12, shares)) == [np.inf, 1]
    assert states_measures.recoveries(answers("TLTTT", [0] * 5, [1, 0, 1, 1, 1])) == []  # too late to tell
    assert states_measures.recoveries(answers("TLLLLL", [0] * 6, [1, 0, 1, 1, 1, 1])) == [np.inf]
    assert states_measures.recoveries(answers("TLTTTT", [20] * 6, [1, 0, 1, 1, 1, 1])) == [np.inf]  # at a wrong pose


def test_calibration_error_is_the_mean_gap_of_bins() -> None:
    bins = states_measures.binned(
        np.array([0.05, 0.05, 0.95, 1.0]), np.array([0, 0.5, 1, 0]), states_measures.CONFIDENCES
    )
    assert bins.counts[[0, 9]].tolist() == [2, 2]
    assert bins.error == pytest.approx((0.2 + 0.475) / 2)
    assert np.isnan(bins.true[1:9]).all()


def test_confidence_at_a_wrong_pose_stands_for_nothing_seen() -> None:
    bins = states_measures.reliability([answers("TT", [1, 30], [1, 1], confidences=np.array([0.75, 0.25]))])
    assert (bins.true[7], bins.true[2]) == (1, 0)


def test_confidence_is_measured_by_the_part_in_the_frame() -> None:
    half = np.zeros((1, CELLS, CELLS))
    half[:, :4] = 1
    a = answers("T", [1], [0.5], seen=half, in_frame=half, confidences=np.ones(1))
    assert states_measures.reliability([a]).error == 0


def test_deviation_is_measured_by_the_root_of_the_mean_square() -> None:
    bins = states_measures.spread([answers("TTH", [3, 4, 99], [1, 1, 1], deviations=np.full(3, 2.0))])
    (only,) = np.flatnonzero(bins.counts)
    assert (bins.counts[only], bins.said[only]) == (2, 2)
    assert bins.true[only] == pytest.approx(np.sqrt(12.5))


def test_auc_counts_pairs() -> None:
    assert roc_area(np.array([0.1, 0.5, 0.5, 0.9]), np.array([False, False, True, True])) == 3.5 / 4
    assert np.isnan(roc_area(np.ones(3), np.ones(3, bool)))


@pytest.mark.parametrize("event", states_clips.EVENTS)
def test_what_is_seen_is_what_the_frame_shows(event: str) -> None:
    """The target is white, so that its seen share is the white one of the frame's pixels within the true corners."""
    gone, _ = states_clips.absence(150)
    for index, view in enumerate(states_clips.staged(still(), event)):
        inside = np.zeros((80, 120), np.uint8)
        if not (event == "cut away" and gone[index] == 1):
            cv2.fillConvexPoly(
                inside, (np.round(view.corners + 0.5)).astype(np.int32) - [[0, 0], [1, 0], [1, 1], [0, 1]], 1
            )
        white = (view.image[..., 0] == 255) & (inside > 0)
        assert view.seen.mean() == pytest.approx(white.sum() / (79 * 39), abs=0.05)
        assert (view.seen <= view.in_frame + 1e-6).all()
        if event in ("leaves", "cut away"):
            assert view.seen.any() == (gone[index] < 1)
        if event == "covered" and gone[index] == 1:
            assert not view.seen.any()
        if gone[index] == 0 or event == "in view":
            np.testing.assert_array_equal(view.seen, 1)
    if event == "partly covered":
        least = min(v.seen.mean() for v in states_clips.staged(still(), event))
        assert least == pytest.approx(1 - states_clips.STAGING.partly_share, abs=0.05)


def test_away_for_a_long_and_then_for_a_short_time() -> None:
    gone, times = states_clips.absence(200)
    lengths = [int(((gone == 1) & (times == t)).sum()) for t in (0, 1)]
    assert lengths == list(states_clips.STAGING.away_frames)
    assert len(gone) == len(times) == 200
    assert not gone[: states_clips.STAGING.seen_frames].any()


def test_logos_are_flat_but_for_a_few_edges() -> None:
    for seed in range(5):
        picture = states_clips.draw_logo((200, 120), np.random.default_rng(seed))
        assert picture.shape == (120, 200, 3)
        edges = cv2.Canny(picture, 50, 100) > 0
        assert 0.005 < edges.mean() < 0.12


def written_clip(folder: Path, frames: int = 24) -> Path:
    """A folder with one clip of images, and a frame whose corners are not known."""
    scene = Scene()
    (folder / "poster").mkdir(parents=True)
    corners = path(scene.quad, frames)
    for index, c in enumerate(corners):
        cv2.imwrite(str(folder / "poster" / f"{index}.png"), scene.draw(c)[..., ::-1])
    rows = [None if i == 5 else c.tolist() for i, c in enumerate(corners)]
    (folder / "poster.json").write_text(json.dumps({"corners": rows}))
    return folder


def test_measured_clips_go_forward_and_backward(tmp_path: Path) -> None:
    (clip,) = states_clips.measured_clips(written_clip(tmp_path / "mine"), 50)
    assert (clip.group, clip.name) == ("mine", "poster")
    assert len(clip.images) == len(clip.truth) == 50
    np.testing.assert_array_equal(clip.truth[23], clip.truth[21])  # 23 frames are known
    assert clip.images[23] is clip.images[21]
    assert np.isfinite(clip.truth).all()


def test_states_command(tmp_path: Path, run: Run) -> None:
    folder = written_clip(tmp_path / "mine")
    out = tmp_path / "out"
    status, printed, error = run("states", folder, "--clips", 1, "--frames", 12, "--out", out, main=cli.main)
    assert (status, error) == (0, "")
    assert "| mine, in view | 11 |" in printed
    assert "| low texture, cut away | 11 |" in printed
    assert Pillow.open(out / "states.png").size[0] > 600
    with (out / "states.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * len(states_clips.EVENTS) * 11
    in_view = [r for r in rows if (r["clip"], r["event"]) == ("poster", "in view")]
    assert {r["state"] for r in in_view} == {"tracked"}
    assert max(float(r["error"]) for r in in_view) < 3


def test_a_folder_without_clips_is_said_in_one_line(tmp_path: Path, run: Run) -> None:
    with pytest.raises(InputError, match="holds no clips"):
        next(states_clips.measured_clips(tmp_path, 10))
    status, _, error = run("states", tmp_path, "--clips", 1, "--frames", 2, "--out", tmp_path / "o", main=cli.main)
    assert status == 2
    assert error.rstrip().count("\n") == 0
