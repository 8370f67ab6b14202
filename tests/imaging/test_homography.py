import numpy as np
import pytest

from hdn.imaging import homography as h
from hdn.imaging.arrays import Array

QUAD = np.array([[10.0, 20], [110, 25], [105, 90], [8, 80]])
UNIT = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def test_from_corners_maps_the_corners() -> None:
    target = QUAD[::-1] * 1.3 + 4
    np.testing.assert_allclose(h.transform(h.from_corners(QUAD, target), QUAD), target, atol=1e-9)


def test_from_corners_refuses_three_points_on_a_line() -> None:
    with pytest.raises(ValueError, match="line"):
        h.from_corners(np.array([[0.0, 0], [1, 1], [2, 2], [0, 5]]), QUAD)


@pytest.mark.parametrize(
    "quad",
    [QUAD, QUAD[::-1], UNIT * [300, 200] + 5, np.array([[0.0, 0], [1000, 1], [1000, 1.001], [0, 1e-3]])],
    ids=["in perspective", "mirrored", "a rectangle", "a sliver of a thousandth of a pixel"],
)
def test_unit_to_quad_maps_the_unit_square(quad: Array) -> None:
    matrix = h.unit_to_quad(quad)
    assert matrix[2, 2] == 1
    np.testing.assert_allclose(h.transform(matrix, UNIT), quad, rtol=1e-12, atol=1e-12)


def test_unit_to_quad_is_the_homography_of_the_corners() -> None:
    np.testing.assert_allclose(h.unit_to_quad(QUAD), h.from_corners(UNIT, QUAD), rtol=1e-9)


def test_derivative_is_that_of_transform() -> None:
    matrix = h.unit_to_quad(QUAD)
    points = np.random.default_rng(0).uniform(0, 1, (3, 5, 2))
    step = 1e-6
    by_x, by_y = (
        (h.transform(matrix, points + d) - h.transform(matrix, points - d)) / (2 * step) for d in np.eye(2) * step
    )
    jacobians = h.derivative(matrix, points)
    np.testing.assert_allclose(jacobians, np.stack([by_x, by_y], -1), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(h.derivative(matrix, points[1, 2]), jacobians[1, 2], rtol=1e-12)


def test_derivative_stays_finite_at_the_horizon() -> None:
    matrix = np.array([[1.0, 0, 0], [0, 1, 0], [0.1, 0, 1]])
    beyond = np.array([[-10.0, 3], [-12, 3]])  # x = -10 is the horizon
    jacobians = h.derivative(matrix, beyond, min_weight=1e-6)
    assert np.isfinite(jacobians).all()
    before = np.array([5.0, 3])
    np.testing.assert_array_equal(h.derivative(matrix, before, min_weight=1e-6), h.derivative(matrix, before))


def test_similarity_turns_from_x_to_y() -> None:
    np.testing.assert_allclose(
        h.transform(h.similarity(2, np.pi / 2, 1, 0), np.array([[1.0, 0]])), [[1, 2]], atol=1e-12
    )
