"""What surrounds a target carries its pose on while it is hidden, if it carried it before."""

import cv2
import numpy as np
import pytest

from hdn import Tracker
from hdn.imaging.homography import similarity, transform, translation
from hdn.imaging.pyramid import Pyramid
from hdn.networks.engine import Engine
from hdn.surroundings import surrounding_motion

from .scenes import Scene, error, texture

QUAD = np.array([[100.0, 70], [220, 74], [216, 166], [102, 160]])


def seen_from(image: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    return cv2.warpPerspective(image, matrix, (width, height), borderMode=cv2.BORDER_REFLECT)


@pytest.mark.parametrize("shift", [(3.0, -2.0), (25.0, 10.0)])
def test_the_motion_around_the_target_is_measured_whatever_the_target_shows(shift: tuple[float, float]) -> None:
    about = translation(160, 120) @ similarity(1.05, 0.04, *shift) @ translation(-160, -120)
    before = cv2.cvtColor(texture(3, 320, 240), cv2.COLOR_RGB2GRAY)
    after = seen_from(before, about)
    cv2.fillConvexPoly(before, QUAD.astype(np.int32), 90)
    after[60:180, 90:230] = np.random.default_rng(0).integers(0, 255, (120, 140))
    motion = surrounding_motion(Pyramid(before), Pyramid(after), QUAD)
    assert motion is not None
    assert error(transform(motion, QUAD), transform(about, QUAD)) < 0.7


def test_where_nothing_can_be_followed_there_is_no_motion() -> None:
    plain = np.full((240, 320), 120, np.uint8)
    assert surrounding_motion(Pyramid(plain), Pyramid(plain), QUAD) is None
    rng = np.random.default_rng(0)
    noise = [rng.integers(0, 255, (240, 320)).astype(np.uint8) for _ in range(2)]
    assert surrounding_motion(Pyramid(noise[0]), Pyramid(noise[1]), QUAD) is None


def test_a_hidden_poster_moves_on_with_its_wall(engine: Engine) -> None:
    scene = Scene()
    scene.wall = texture(100, scene.width, scene.height)
    still = scene.draw(scene.quad)
    tracker = Tracker(engine=engine)
    tracker.init(still, scene.quad)
    for step in range(1, 12):
        camera = translation(1.5 * step, -0.8 * step)
        frame, truth = seen_from(still, camera), transform(camera, scene.quad)
        if step > 3:
            low, high = truth.min(0).astype(int) - 2, truth.max(0).astype(int) + 3
            frame[low[1] : high[1], low[0] : high[0]] = (70, 90, 110)
        estimate = tracker.track(frame)
        assert estimate.state == ("tracked" if step <= 3 else "held")
        assert error(estimate.corners, truth) < 1.5
