import numpy as np
import pytest

from hdn.imaging import homography as h

QUAD = np.array([[10.0, 20], [110, 25], [105, 90], [8, 80]])


def test_from_corners_maps_the_corners() -> None:
    target = QUAD[::-1] * 1.3 + 4
    np.testing.assert_allclose(h.transform(h.from_corners(QUAD, target), QUAD), target, atol=1e-9)


def test_from_corners_refuses_three_points_on_a_line() -> None:
    with pytest.raises(ValueError, match="line"):
        h.from_corners(np.array([[0.0, 0], [1, 1], [2, 2], [0, 5]]), QUAD)


def test_similarity_turns_from_x_to_y() -> None:
    np.testing.assert_allclose(
        h.transform(h.similarity(2, np.pi / 2, 1, 0), np.array([[1.0, 0]])), [[1, 2]], atol=1e-12
    )
