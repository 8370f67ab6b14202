import numpy as np
import pytest

from hdn.imaging import quads

QUAD = np.array([[10.0, 20], [110, 25], [105, 90], [8, 80]])


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
    assert quads.is_convex(quad) is convex


def test_area_is_signed() -> None:
    assert quads.area(quads.square(10)) == pytest.approx(100)
    assert quads.area(quads.square(10)[::-1]) == pytest.approx(-100)
