"""Every tracker of the benchmark on a moving poster, and on a wall without it."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from hdn.benchmark import trackers
from hdn.benchmark.trackers import OURS, TRACKERS, make_tracker, weights_of
from hdn.errors import InputError
from hdn.networks import pytorch, weights
from hdn.networks.config import PAPER
from hdn.networks.engine import Engine

from ..scenes import Scene, error, path

FRAMES = 12
PAPERS = [name for name, ours in OURS.items() if ours.config == PAPER.name]
NAMES = [n for n in TRACKERS if n not in PAPERS and ("akaze" not in n or hasattr(cv2, "AKAZE_create"))]


@pytest.fixture(autouse=True)
def shared_networks(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trackers, "_engine", lambda _: engine)


@pytest.mark.parametrize("name", NAMES)
def test_follows_a_poster(name: str) -> None:
    scene, tracker = Scene(), make_tracker(name)
    truth = path(scene.quad, FRAMES)
    tracker.init(scene.draw(truth[0]), truth[0])
    errors = []
    for corners in truth[1:]:
        answer = tracker.track(scene.draw(corners))
        assert answer.state == "tracked"
        assert answer.corners is not None
        errors.append(error(answer.corners, corners))
    # Without refinement errors add up; that is still to be better than standing still.
    alone = name.startswith("hdn-")
    limit = np.median([error(truth[0], corners) for corners in truth[1:]]) if alone else 1.5
    assert np.median(errors) < limit, errors


@pytest.mark.parametrize("name", [n for n in NAMES if n != "hdn-residual"])  # which has no score to tell by
def test_knows_nothing_of_a_plain_frame(name: str) -> None:
    scene, tracker = Scene(), make_tracker(name)
    tracker.init(scene.draw(scene.quad), scene.quad)
    answer = tracker.track(np.full((scene.height, scene.width, 3), 128, np.uint8))
    assert answer.state != "tracked"


@pytest.mark.parametrize("name", NAMES)
def test_a_target_without_texture_is_lost_or_refused_but_no_crash(name: str) -> None:
    plain = np.full((120, 160, 3), 90, np.uint8)
    quad = np.array([[40.0, 30], [120, 30], [120, 90], [40, 90]])
    tracker = make_tracker(name)
    tracker.init(plain, quad)
    assert tracker.track(plain).corners is None or name in OURS


@pytest.mark.parametrize("shrink", [1, 3])
def test_ecc_is_exact_on_a_target_larger_than_its_working_size(shrink: int) -> None:
    scene = Scene(width=320 * shrink, height=240 * shrink)
    quad = (scene.quad + 0.5) * shrink - 0.5
    there = quad + np.array([2.25, -1.5])
    tracker = make_tracker("ecc")
    tracker.init(scene.draw(quad), quad)
    answer = tracker.track(scene.draw(there))
    assert answer.corners is not None
    assert error(answer.corners, there) < 0.15


@pytest.fixture(scope="module")
def paper_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Untrained weights of the paper's configuration, with offsets of zero: others may lead out of all bounds."""
    network = pytorch.Hdn(PAPER).requires_grad_(False)
    for branch in (network.similarity.translation, network.similarity.polar):
        branch.loc_scale.zero_()
    network.residual.fc.weight.zero_()
    network.residual.fc.bias.zero_()
    path = tmp_path_factory.mktemp("paper") / "paper.safetensors"
    pytorch.save(network, path, {})
    return path


def test_the_authors_tracker_runs_on_the_papers_configuration(paper_file: Path) -> None:
    scene, tracker = Scene(), make_tracker("hdn-authors", paper_file)
    tracker.init(scene.draw(scene.quad), scene.quad)
    corners = tracker.track(scene.draw(scene.quad)).corners
    assert corners is not None
    assert corners.shape == (4, 2)
    assert np.isfinite(corners).all()


@pytest.mark.parametrize("name", PAPERS)
def test_the_papers_configuration_needs_its_own_weights(name: str, paper_file: Path) -> None:
    assert weights_of(name, [weights.shipped(), paper_file]) == paper_file
    for files in ([], [weights.shipped()]):
        with pytest.raises(InputError, match=f"{name} needs weights of the configuration 'paper'"):
            weights_of(name, files)


def test_a_file_serves_the_trackers_of_its_configuration(paper_file: Path) -> None:
    assert weights_of("hdn-raw", [paper_file]) == weights.shipped()
    assert weights_of("sift", [paper_file]) is None


def test_without_refinement_errors_add_up() -> None:
    scene = Scene()
    truth = path(scene.quad, FRAMES)
    last = {}
    for name in ("hdn", "hdn-raw", "hdn-similarity", "hdn-residual"):
        tracker = make_tracker(name)
        tracker.init(scene.draw(truth[0]), truth[0])
        for corners in truth[1:]:
            answer = tracker.track(scene.draw(corners))
        assert answer.corners is not None
        last[name] = error(answer.corners, truth[-1])
    assert last["hdn"] < 0.5
    assert min(last, key=lambda name: last[name]) == "hdn"
    assert len(set(last.values())) == 4  # each does another thing


def test_unknown_tracker() -> None:
    with pytest.raises(InputError, match=r"no tracker 'magic': choose from hdn, .*, sift"):
        make_tracker("magic")


@pytest.mark.skipif(hasattr(cv2, "AKAZE_create"), reason="this OpenCV has AKAZE")
def test_akaze_says_where_it_is_missing() -> None:
    with pytest.raises(InputError, match="has no AKAZE"):
        make_tracker("akaze")
