import numpy as np

from ar_demo.tracking.states import judged, suspicions

QUAD = np.array([[100.0, 100], [300, 100], [300, 250], [100, 250]])


def state(
    deviation: float, agrees: bool = True, may_hold: bool = True, quad: np.ndarray = QUAD, width: int = 1280
) -> str:
    return judged(quad[None], np.array([deviation]), np.array([agrees]), np.array([may_hold]), width)[0]


def test_the_bounds_are_what_a_person_sees() -> None:
    assert [state(d) for d in (0.5, 2.9, 3.1, 8.5, 8.8, np.inf)] == ["tracked"] * 2 + ["held"] * 2 + ["lost"] * 2
    assert state(1.5, quad=QUAD / 10) == "held"  # a small surface, of which 1.5 px is a lot
    assert [state(5.5, width=w) for w in (1280, 3840)] == ["held", "held"]
    assert state(15, width=3840) == "held"


def test_only_what_is_measured_and_agreed_upon_is_tracked() -> None:
    assert state(0.5, agrees=False) == "held"
    assert state(0.5, agrees=False, may_hold=False) == "lost"


def test_a_held_surface_keeps_its_shape() -> None:
    crossed = QUAD[[0, 2, 1, 3]]
    assert state(4.0, quad=crossed) == "lost"
    corners = np.stack([QUAD, QUAD * [1.0, 1.1], QUAD * [1.0, 1.9], QUAD])
    agrees = np.array([True, False, False, True])
    states = judged(corners, np.full(4, 1.0), agrees, np.ones(4, bool), 1280)
    assert states == ["tracked", "held", "lost", "tracked"]


def test_near_stretches_make_one_warning_and_moments_none() -> None:
    states = np.array(["tracked"] * 300, object)
    states[[5, 40]] = "held"
    assert suspicions(states.tolist(), np.zeros(300, bool)) == []
    states[100:110], states[115:130], states[200:220] = "held", "held", "lost"
    disagrees = np.zeros(300, bool)
    told = suspicions(states.tolist(), disagrees)
    assert [warning.split(":")[0] for warning in told] == ["frames 100 to 129", "frames 200 to 219"]
    assert "hardly seen" in told[0]
    assert "not found" in told[1]
    disagrees[100:130] = True
    assert "contradicts" in suspicions(states.tolist(), disagrees)[0]
