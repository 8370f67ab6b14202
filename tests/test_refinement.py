import numpy as np
import pytest

from hdn.homography import from_corners, transform
from hdn.refinement import Refiner
from hdn.refinement import _normalise as normalise
from hdn.sampling import Pyramid

from .scenes import Scene, error, moved


def grey(image: np.ndarray) -> Pyramid:
    return Pyramid(image.mean(2).astype(np.uint8))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene()


@pytest.mark.parametrize("light", [(1.0, 0), (0.6, 40), (1.4, -30)], ids=["same light", "dim and hazy", "bright"])
def test_aligns_to_a_fraction_of_a_pixel(scene: Scene, light: tuple[float, float]) -> None:
    truth = moved(scene.quad, (3.3, -2.1), 1.04, 0.03, 0.0002)
    frame = np.clip(scene.draw(truth).astype(np.float32) * light[0] + light[1], 0, 255).astype(np.uint8)
    refiner = Refiner(grey(scene.draw(scene.quad)), scene.quad)
    alignment = refiner.align(grey(frame), np.eye(3))
    found, agreement = alignment.homography, alignment.agreement
    assert error(transform(found, scene.quad), truth) < 0.25
    assert agreement.share > 0.9


def test_an_occluder_does_not_pull(scene: Scene) -> None:
    truth = moved(scene.quad, (2, 1))
    frame = scene.draw(truth)
    frame[60:175, 95:140] = 20
    refiner = Refiner(grey(scene.draw(scene.quad)), scene.quad)
    alignment = refiner.align(grey(frame), np.eye(3))
    found, agreement = alignment.homography, alignment.agreement
    assert error(transform(found, scene.quad), truth) < 0.6
    assert 0.4 < agreement.share < 0.85
    assert np.median(agreement.correlation[:, :2]) < 0.3
    assert np.median(agreement.correlation[:, 4:]) > 0.9


def test_what_is_hidden_makes_the_corners_uncertain(scene: Scene) -> None:
    refiner = Refiner(grey(scene.draw(scene.quad)), scene.quad)
    frame = scene.draw(scene.quad)
    clear = refiner.deviation(np.eye(3), refiner.align(grey(frame), np.eye(3)).covariance)
    frame[60:175, 95:165] = 20
    hidden = refiner.deviation(np.eye(3), refiner.align(grey(frame), np.eye(3)).covariance)
    assert clear < 0.5
    assert hidden > 2 * clear


def test_another_picture_does_not_agree(scene: Scene) -> None:
    refiner = Refiner(grey(scene.draw(scene.quad)), scene.quad)
    other = grey(Scene(seed=5).draw(scene.quad))
    assert refiner.align(other, np.eye(3)).agreement.share < 0.3


def test_cells_outside_the_frame_do_not_count(scene: Scene) -> None:
    refiner = Refiner(grey(scene.draw(scene.quad)), scene.quad)
    truth = moved(scene.quad, (-150, 0))
    agreement = refiner.agreement(grey(scene.draw(truth)), from_corners(scene.quad, truth))
    assert 0 < agreement.visible.sum() < 0.9 * agreement.textured.sum()
    assert agreement.share > 0.8


@pytest.mark.parametrize("seed", range(3))
def test_flat_beside_busy_stays_finite(seed: int) -> None:
    """Running sums of a strong texture round to below zero where it ends."""
    image = np.full((160, 126), 100, np.float32)
    image[:60] += np.random.default_rng(seed).uniform(-90, 90, (60, 126))
    assert np.isfinite(normalise(image, 11.4)).all()
