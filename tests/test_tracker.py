from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from hdn import InputError, Observation, Tracker
from hdn.alignment.refinement import NO_BLUR
from hdn.evidence import Evidence, is_fix
from hdn.imaging.arrays import Image
from hdn.imaging.homography import from_corners
from hdn.localisation import Expectation, FrameSearch
from hdn.networks.engine import Engine

from .scenes import Scene, error, moved, path


@pytest.fixture
def scene() -> Scene:
    return Scene()


@pytest.fixture
def tracker(scene: Scene, engine: Engine) -> Tracker:
    tracker = Tracker(engine=engine)
    tracker.init(scene.draw(scene.quad), scene.quad)
    return tracker


def test_follows_smooth_motion(tracker: Tracker, scene: Scene) -> None:
    errors = []
    for truth in path(scene.quad, 40)[1:]:
        estimate = tracker.track(scene.draw(truth))
        assert estimate.state == "tracked"
        errors.append(error(estimate.corners, truth))
    assert np.median(errors) < 0.25
    assert max(errors) < 1.0


@pytest.mark.parametrize(
    ("shift", "scale", "rotation"),
    [
        ((45, 0), 1, 0),
        ((-20, 40), 1, 0),
        ((0, 0), 1.3, 0),
        ((0, 0), 1 / 1.3, 0),
        ((0, 0), 1, 0.5),
        ((25, -15), 1.15, -0.3),
    ],
)
def test_large_jumps_need_the_networks(
    tracker: Tracker, scene: Scene, shift: tuple[float, float], scale: float, rotation: float
) -> None:
    truth = moved(scene.quad, shift, scale, rotation)
    estimate = tracker.track(scene.draw(truth))
    assert estimate.state == "tracked"
    assert error(estimate.corners, truth) < 1.0


def test_stays_put_while_only_its_wall_is_seen_and_finds_it_again(tracker: Tracker, scene: Scene) -> None:
    for _ in range(4):
        tracker.track(scene.draw(scene.quad))
    for _ in range(30):
        estimate = tracker.track(scene.draw(None))
        assert estimate.state == "held"
        assert error(estimate.corners, scene.quad) < 1.0
    there = moved(scene.quad, (-60, 30), 0.9, 0.4)
    found = [tracker.track(scene.draw(there)) for _ in range(3)][-1]
    assert found.state == "tracked"
    assert error(found.corners, there) < 1.0


def test_while_its_wall_tells_where_it_is_the_whole_frame_is_searched_now_and_then(
    tracker: Tracker, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    for _ in range(4):
        tracker.track(scene.draw(scene.quad))
    searched, anywhere = [], FrameSearch.anywhere
    monkeypatch.setattr(FrameSearch, "anywhere", lambda search: searched.append(1) or anywhere(search))
    for _ in range(12):
        tracker.track(scene.draw(None))
    assert 2 <= len(searched) <= 5


def test_a_wall_that_it_moves_before_does_not_tell_where_it_is(tracker: Tracker, scene: Scene) -> None:
    for step in range(1, 9):
        here = moved(scene.quad, (3 * step, 2 * step))
        tracker.track(scene.draw(here))
    estimates = [tracker.track(scene.draw(None)) for _ in range(6)]
    assert all(error(estimate.corners, here) < 4 for estimate in estimates)
    assert estimates[-1].state == "lost"


def test_holds_some_frames_without_any_sight_then_loses_and_finds_it_again(tracker: Tracker, scene: Scene) -> None:
    tracker.track(scene.draw(scene.quad))
    nothing = np.full_like(scene.draw(None), 90)
    estimates = [tracker.track(nothing) for _ in range(40)]
    states = [estimate.state for estimate in estimates]
    held = states.index("lost")
    assert 5 < held < 40
    assert states == ["held"] * held + ["lost"] * (40 - held)
    assert all(np.diff([estimate.deviation for estimate in estimates[:held]]) > 0)
    assert np.isinf(estimates[-1].deviation)
    assert estimates[-1].covariance is None
    there = moved(scene.quad, (-60, 30), 0.9, 0.4)
    assert error([tracker.track(scene.draw(there)) for _ in range(2)][-1].corners, there) < 1.0


def test_another_poster_in_its_place_is_not_it(tracker: Tracker, scene: Scene) -> None:
    other = Scene(seed=7)
    other.wall = scene.wall
    states = [tracker.track(other.draw(scene.quad)).state for _ in range(4)]
    assert "tracked" not in states


def test_partly_covered_is_still_tracked_with_less_confidence(tracker: Tracker, scene: Scene) -> None:
    frame = scene.draw(scene.quad)
    frame[:, 100:135] = (30, 60, 90)
    estimate = tracker.track(frame)
    assert estimate.state == "tracked"
    assert estimate.confidence < 0.9
    assert error(estimate.corners, scene.quad) < 3
    assert estimate.visibility[:, :2].mean() < 0.2  # what lies left of x = 130 is hidden
    assert estimate.visibility[:, 3:].mean() > 0.8


def test_behind_a_bar_that_hides_two_thirds_it_is_still_followed(tracker: Tracker, scene: Scene) -> None:
    for step in range(1, 11):
        truth = moved(scene.quad, (1.5 * step, -step))
        frame = scene.draw(truth)
        left = int(truth[0, 0])
        frame[:, left : left + int(7.8 * step)] = (120, 120, 118)
        estimate = tracker.track(frame)
        assert estimate.state == "tracked" or step > 8  # then its far corners are too unsure
        assert error(estimate.corners, truth) < 3


def test_behind_a_bar_the_plane_leads_and_the_networks_are_spared(
    tracker: Tracker, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    proposer, asked = tracker.target.proposer, []
    propose = proposer.propose
    monkeypatch.setattr(proposer, "propose", lambda *given: asked.append(1) or propose(*given))
    for step in range(1, 13):
        truth = moved(scene.quad, (1.5 * step, -step))
        frame = scene.draw(truth)
        left = int(truth[0, 0])
        frame[:, left : left + 60] = (120, 120, 118)
        assert error(tracker.track(frame).corners, truth) < 2
    assert len(asked) < 6
    asked.clear()
    for _ in range(4):  # once nothing hides it they are back
        tracker.track(scene.draw(truth))
    assert asked


def test_seen_well_and_in_steady_motion_the_networks_are_spared_and_asked_once_it_turns(
    tracker: Tracker, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    proposer, asked = tracker.target.proposer, []
    propose = proposer.propose
    monkeypatch.setattr(proposer, "propose", lambda *given: asked.append(1) or propose(*given))
    for step in range(1, 11):
        truth = moved(scene.quad, (4.0 * step, -2.5 * step))
        assert error(tracker.track(scene.draw(truth)).corners, truth) < 0.5
    assert len(asked) <= 2  # the first frames tell how it moves
    asked.clear()
    truth = moved(scene.quad, (0.0, -25.0), 1.1, 0.2)
    estimate = tracker.track(scene.draw(truth))
    assert asked
    assert estimate.state == "tracked"
    assert error(estimate.corners, truth) < 1.0


def test_the_networks_are_asked_in_steady_motion_where_the_reference_frame_is_blurred(
    scene: Scene, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker = Tracker(engine=engine)
    tracker.init(_smeared(scene.draw(scene.quad)), scene.quad)
    asked = []
    propose = tracker.target.proposer.propose
    monkeypatch.setattr(tracker.target.proposer, "propose", lambda *given: asked.append(1) or propose(*given))
    for step in range(1, 7):
        truth = moved(scene.quad, (4.0 * step, -2.5 * step))
        assert error(tracker.track(_smeared(scene.draw(truth))).corners, truth) < 1.0
    assert len(asked) == 6


def _smeared(frame: Image) -> Image:
    return np.asarray(cv2.blur(frame, (41, 1)), np.uint8)


def test_keypoints_place_a_lost_target_of_which_a_third_is_seen(engine: Engine) -> None:
    scene = Scene(640, 480, seed=1)
    scene.quad = scene.quad * 2
    tracker = Tracker(engine=engine)
    tracker.init(scene.draw(scene.quad), scene.quad)
    there = moved(scene.quad, (-70, 60), 0.9, 0.3)
    tracker.lose()
    frame = scene.draw(there)
    left, right = there[:, 0].min(), there[:, 0].max()
    frame[:, int(left + 0.35 * (right - left)) :] = (120, 120, 118)
    found = [tracker.track(frame) for _ in range(3)][-1]
    assert found.state != "lost"
    assert error(found.corners, there) < 5


@pytest.mark.parametrize(("spread", "found"), [(9.0, True), (0.01, False)], ids=["vague", "sharp"])
def test_keypoints_that_cannot_be_mistaken_overrule_an_expected_place_that_is_not_sharp(
    engine: Engine, spread: float, found: bool
) -> None:
    scene = Scene(640, 480, seed=1)
    scene.quad = scene.quad * 2
    tracker = Tracker(engine=engine)
    tracker.init(scene.draw(scene.quad), scene.quad)
    there = moved(scene.quad, (-150, 60), 0.9)
    frame = scene.draw(there)
    middle = int(there[:, 0].mean())
    frame[:, middle:] = (120, 120, 118)
    search = FrameSearch(tracker.target, replace(tracker.pose, missed=2), Observation(frame))
    search.is_hard = True
    search.expectation = Expectation(np.eye(3), np.eye(8) * spread, True, None, NO_BLUR)
    candidate = search.anywhere()
    assert error(tracker.target.corners(candidate.homography), there) < 3
    assert candidate.support < 0.6
    assert search.is_found(candidate) is found


@pytest.mark.parametrize(
    ("evidence", "fix"),
    [
        (Evidence(score=0.9, residual=3, visible=0.6, agreement=0.45), True),
        (Evidence(score=0.1, residual=3, visible=0.6, agreement=0.45), True),
        (Evidence(score=0.9, residual=0.1, visible=0.0, agreement=0.45), False),
        (Evidence(score=0.1, residual=0.1, visible=0.0, agreement=0.95), True),
        (Evidence(score=0.9, residual=3, visible=0.6, agreement=0.2), False),
        (Evidence(score=0.9, residual=3, visible=0.3, agreement=0.25, cohesion=0.2), True),
        (Evidence(score=0.9, residual=3, visible=0.8, agreement=0.25, cohesion=0.2), False),
        (Evidence(score=0.1, residual=3, visible=0.0, agreement=0.25, cohesion=0.15), False),
    ],
    ids=[
        "positive",
        "low score but seen",
        "pulled to zero",
        "negative but agreeing",
        "not agreeing",
        "patch",
        "patch of what should show whole",
        "patch of a negative",
    ],
)
def test_negative_evidence_asks_for_stronger_agreement(evidence: Evidence, fix: bool) -> None:
    assert is_fix(evidence) is fix


@pytest.mark.parametrize(
    ("quad", "message"),
    [
        ([[10, 10], [50, 10], [50, 40]], "3 points"),
        ([[10, 10], [60, 60], [60, 10], [10, 60]], "crosses itself"),
        ([[10, 10], [60, 10], [110, 10], [160, 10]], "flat"),
        ([[-30, 10], [60, 10], [60, 60], [-30, 60]], "outside"),
        ([[10, 10], [22, 10], [22, 22], [10, 22]], "under 16 px"),
    ],
)
def test_refuses_impossible_quads(engine: Engine, scene: Scene, quad: list[list[float]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Tracker(engine=engine).init(scene.draw(None), np.array(quad, float))


@pytest.mark.parametrize(
    "use",
    [
        lambda tracker, frame: tracker.track(frame),
        lambda tracker, frame: tracker.propose(frame),
        lambda tracker, frame: tracker.place(np.eye(3)),
        lambda tracker, frame: tracker.lose(),
        lambda tracker, frame: tracker.quad,
        lambda tracker, frame: tracker.homography,
    ],
    ids=["track", "propose", "place", "lose", "quad", "homography"],
)
def test_used_before_init_it_says_so(engine: Engine, scene: Scene, use: Callable[[Tracker, Image], object]) -> None:
    with pytest.raises(InputError, match="no target yet: call init"):
        use(Tracker(engine=engine), scene.draw(scene.quad))


def test_a_refused_target_leaves_the_one_before(tracker: Tracker, scene: Scene) -> None:
    with pytest.raises(InputError):
        tracker.init(scene.draw(None), scene.quad + 1000)
    assert tracker.track(scene.draw(scene.quad)).state == "tracked"
    np.testing.assert_array_equal(tracker.quad, scene.quad)


def test_proposing_does_not_move_the_tracker(tracker: Tracker, scene: Scene) -> None:
    before = tracker.pose
    tracker.propose(scene.draw(moved(scene.quad, (20, 5))))
    assert tracker.pose is before


def test_placed_it_goes_on_from_there(tracker: Tracker, scene: Scene) -> None:
    """Where it would not have looked by itself for a target that has turned over."""
    there = moved(scene.quad, (10, -5), 0.9, np.pi)
    pose = from_corners(scene.quad, moved(there, (2, 1)))
    tracker.place(2 * pose)
    np.testing.assert_allclose(tracker.homography, pose)  # of the same homography, scaled
    estimate = tracker.track(scene.draw(there))
    assert estimate.state == "tracked"
    assert error(estimate.corners, there) < 1.0


def test_unknown_device() -> None:
    with pytest.raises(InputError, match="tpu"):
        Tracker(device="tpu")
