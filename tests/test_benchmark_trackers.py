"""Every tracker of the benchmark on a moving poster, and on a wall without it."""

import cv2
import numpy as np
import pytest

from hdn.benchmark import trackers
from hdn.benchmark.trackers import TRACKERS, make_tracker
from hdn.engine import Engine
from hdn.errors import InputError

from .scenes import Scene, error, path

FRAMES = 12
NAMES = [name for name in TRACKERS if "akaze" not in name or hasattr(cv2, "AKAZE_create")]


@pytest.fixture(autouse=True)
def shared_networks(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trackers, "_engine", lambda: engine)


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
    assert np.median(errors) < 1.5, errors


@pytest.mark.parametrize("name", NAMES)
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
    assert tracker.track(plain).corners is None or name == "hdn"


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


def test_unknown_tracker() -> None:
    with pytest.raises(InputError, match="no tracker 'magic': choose from hdn, sift"):
        make_tracker("magic")


@pytest.mark.skipif(hasattr(cv2, "AKAZE_create"), reason="this OpenCV has AKAZE")
def test_akaze_says_where_it_is_missing() -> None:
    with pytest.raises(InputError, match="has no AKAZE"):
        make_tracker("akaze")
