import cv2
import numpy as np
import pytest

from hdn.alignment.refinement import Refiner
from hdn.imaging.homography import from_corners, transform
from hdn.imaging.observation import Observation
from hdn.imaging.photometry import normalise

from ..scenes import Scene, error, moved


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene()


@pytest.mark.parametrize("light", [(1.0, 0), (0.6, 40), (1.4, -30)], ids=["same light", "dim and hazy", "bright"])
def test_aligns_to_a_fraction_of_a_pixel(scene: Scene, light: tuple[float, float]) -> None:
    truth = moved(scene.quad, (3.3, -2.1), 1.04, 0.03, 0.0002)
    frame = np.clip(scene.draw(truth).astype(np.float32) * light[0] + light[1], 0, 255).astype(np.uint8)
    refiner = Refiner(Observation(scene.draw(scene.quad)), scene.quad)
    alignment = refiner.align(Observation(frame), np.eye(3))
    found, agreement = alignment.homography, alignment.agreement
    assert error(transform(found, scene.quad), truth) < 0.25
    assert agreement.share > 0.9


def test_the_finest_step_is_the_most_exact() -> None:
    """Of a target larger than the crop that the steps before look at."""
    scene = Scene(768, 576)
    scene.quad *= 2.4
    refiner = Refiner(Observation(scene.draw(scene.quad)), scene.quad)
    roughly, exactly = [], []
    for shift in ((3.3, -2.1), (-1.4, 0.6), (0.5, 2.7), (-2.2, -3.8)):
        truth = moved(scene.quad, shift, 1.03, 0.02)
        frame = Observation(scene.draw(truth))
        found = refiner.align_roughly(frame, np.eye(3))
        roughly.append(error(transform(found.homography, scene.quad), truth))
        exactly.append(error(transform(refiner.align_finely(frame, found).homography, scene.quad), truth))
    assert np.median(exactly) < 0.15
    assert np.median(exactly) < np.median(roughly)


@pytest.mark.parametrize("blurry", ["frame", "template"])
def test_blur_is_found_and_matched(scene: Scene, blurry: str) -> None:
    """A view moved 8 px, at 30 degrees, while it was exposed, against a sharp one."""
    truth = moved(scene.quad, (3.3, -2.1), 1.02, 0.01)
    template, frame = scene.draw(scene.quad), scene.draw(truth)
    if blurry == "frame":
        frame = streaked(frame, 8, np.deg2rad(30))
    else:
        template = streaked(template, 8, np.deg2rad(30))
    refiner = Refiner(Observation(template), scene.quad)
    roughly = refiner.align_roughly(Observation(frame), np.eye(3))
    found = refiner.align_finely(Observation(frame), roughly)
    values, axes = np.linalg.eigh(refiner.frame_blur(found))
    if blurry == "template":
        values, axes = -values[::-1], axes[:, ::-1]
    assert values[1] == pytest.approx(8**2 / 12, rel=0.35)
    assert values[0] < 0.25 * values[1]
    assert abs(axes[:, 1] @ [np.cos(np.deg2rad(30)), np.sin(np.deg2rad(30))]) > np.cos(np.deg2rad(8))
    assert np.median(found.agreement.correlation) > np.median(roughly.agreement.correlation)
    assert error(transform(found.homography, scene.quad), truth) < 0.5


def test_no_blur_is_found_where_there_is_none(scene: Scene) -> None:
    refiner = Refiner(Observation(scene.draw(scene.quad)), scene.quad)
    found = refiner.align(Observation(scene.draw(moved(scene.quad, (3.3, -2.1), 1.04))), np.eye(3))
    assert np.abs(refiner.frame_blur(found)).max() < 0.5


def streaked(image: np.ndarray, length: float, angle: float) -> np.ndarray:
    """The image blurred along a line, px, at an angle to the x axis, rad."""
    shifts = [(t * np.cos(angle), t * np.sin(angle)) for t in np.linspace(-length / 2, length / 2, 25)]
    size = image.shape[1::-1]
    frames = [
        cv2.warpAffine(
            image.astype(np.float32), np.array([[1, 0, x], [0, 1, y]]), size, borderMode=cv2.BORDER_REPLICATE
        )
        for x, y in shifts
    ]
    return np.mean(frames, 0).astype(np.uint8)


def test_an_occluder_does_not_pull(scene: Scene) -> None:
    truth = moved(scene.quad, (2, 1))
    frame = scene.draw(truth)
    frame[60:175, 95:140] = 20
    refiner = Refiner(Observation(scene.draw(scene.quad)), scene.quad)
    alignment = refiner.align(Observation(frame), np.eye(3))
    found, agreement = alignment.homography, alignment.agreement
    assert error(transform(found, scene.quad), truth) < 0.6
    assert 0.4 < agreement.share < 0.85
    assert np.median(agreement.correlation[:, :2]) < 0.3
    assert np.median(agreement.correlation[:, 4:]) > 0.9


def test_what_is_hidden_makes_the_corners_uncertain(scene: Scene) -> None:
    refiner = Refiner(Observation(scene.draw(scene.quad)), scene.quad)
    frame = scene.draw(scene.quad)
    clear = refiner.deviation(np.eye(3), refiner.align(Observation(frame), np.eye(3)).covariance)
    frame[60:175, 95:165] = 20
    hidden = refiner.deviation(np.eye(3), refiner.align(Observation(frame), np.eye(3)).covariance)
    assert clear < 0.5
    assert hidden > 2 * clear


def test_another_picture_does_not_agree(scene: Scene) -> None:
    refiner = Refiner(Observation(scene.draw(scene.quad)), scene.quad)
    other = Observation(Scene(seed=5).draw(scene.quad))
    assert refiner.align(other, np.eye(3)).agreement.share < 0.3


def test_cells_outside_the_frame_do_not_count(scene: Scene) -> None:
    refiner = Refiner(Observation(scene.draw(scene.quad)), scene.quad)
    truth = moved(scene.quad, (-150, 0))
    agreement = refiner.agreement(Observation(scene.draw(truth)), from_corners(scene.quad, truth))
    assert 0 < agreement.visible.sum() < 0.9 * agreement.textured.sum()
    assert agreement.share > 0.8


@pytest.mark.parametrize("seed", range(3))
def test_flat_beside_busy_stays_finite(seed: int) -> None:
    """Running sums of a strong texture round to below zero where it ends."""
    image = np.full((160, 126), 100, np.float32)
    image[:60] += np.random.default_rng(seed).uniform(-90, 90, (60, 126))
    assert np.isfinite(normalise(image, 33)).all()


def test_where_nothing_may_be_looked_at_the_pose_stays_as_expected(scene: Scene) -> None:
    refiner = Refiner(Observation(scene.draw(scene.quad)), scene.quad)
    nothing = np.zeros((8, 8), np.float32)
    alignment = refiner.align(Observation(scene.draw(None)), np.eye(3), nothing)
    assert np.allclose(alignment.homography, np.eye(3), atol=1e-6)
    assert refiner.deviation(np.eye(3), alignment.measured) > 50
