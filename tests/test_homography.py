import numpy as np
import pytest
import torch

from hdn import homography as h

QUAD = np.array([[10.0, 20], [110, 25], [105, 90], [8, 80]])


def test_from_corners_maps_the_corners() -> None:
    target = QUAD[::-1] * 1.3 + 4
    np.testing.assert_allclose(h.transform(h.from_corners(QUAD, target), QUAD), target, atol=1e-9)


def test_from_corners_refuses_three_points_on_a_line() -> None:
    with pytest.raises(ValueError, match="line"):
        h.from_corners(np.array([[0.0, 0], [1, 1], [2, 2], [0, 5]]), QUAD)


def test_dlt_agrees_with_from_corners_and_has_gradients() -> None:
    corners = h.square(128)
    offsets = np.array([[3.0, -2], [1, 4], [-5, 2], [0, 1]])
    ours = h.dlt(torch.from_numpy(offsets[None]), torch.from_numpy(corners))[0].numpy()
    np.testing.assert_allclose(ours, h.from_corners(corners, corners + offsets), atol=1e-9)
    variable = torch.from_numpy(offsets[None] / 10).requires_grad_()
    assert torch.autograd.gradcheck(lambda o: h.dlt(o, torch.from_numpy(corners / 64)), variable)


def test_similarity_turns_from_x_to_y() -> None:
    np.testing.assert_allclose(
        h.transform(h.similarity(2, np.pi / 2, 1, 0), np.array([[1.0, 0]])), [[1, 2]], atol=1e-12
    )


@pytest.mark.parametrize(
    ("quad", "convex"),
    [
        (QUAD, True),
        (QUAD[::-1], True),
        (QUAD[[0, 2, 1, 3]], False),
        (np.array([[0.0, 0], [10, 0], [2, 2], [0, 10]]), False),
    ],
    ids=["clockwise", "mirrored", "self-crossing", "dented"],
)
def test_is_convex(quad: np.ndarray, convex: bool) -> None:
    assert h.is_convex(quad) is convex


def test_area_is_signed() -> None:
    assert h.area(h.square(10)) == pytest.approx(100)
    assert h.area(h.square(10)[::-1]) == pytest.approx(-100)
