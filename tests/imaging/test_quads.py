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


SMALLEST = quads.square(1) * np.sqrt(0.5)


def bent(by: float) -> np.ndarray:
    """Half a square of 100 px with a fourth corner, so many px out from the middle of its diagonal along x and y."""
    return np.array([[0, 0], [100, 0], [100, 100], [50 - by, 50 + by]])


@pytest.mark.parametrize(
    ("quad", "drawable"),
    [
        (QUAD, True),
        (QUAD[::-1], True),
        (QUAD[[0, 2, 1, 3]], False),
        (np.where(np.eye(4, 2), np.nan, QUAD), False),
        (np.where(np.eye(4, 2), np.inf, QUAD), False),
        (SMALLEST * 1.01, True),
        (SMALLEST * 0.99, False),
        (bent(0.2), True),
        (bent(0.02), False),
        (bent(-5), False),
    ],
    ids=[
        "clockwise",
        "mirrored",
        "self-crossing",
        "not a number",
        "infinite",
        "over half a pixel",
        "under half a pixel",
        "clearly convex",
        "nearly flat at a corner",
        "dented",
    ],
)
def test_is_drawable(quad: np.ndarray, drawable: bool) -> None:
    assert quads.is_drawable(quad) is drawable


@pytest.mark.parametrize("part", [quads.square(10), quads.square(10)[::-1]], ids=["clockwise", "mirrored"])
def test_clip_polygon_keeps_what_is_inside(part: np.ndarray) -> None:
    bounds = (-100.0, -100.0, 100.0, 100.0)
    np.testing.assert_array_equal(quads.clip_polygon(part, bounds), part)
    half = quads.clip_polygon(part, (4.5, -100.0, 100.0, 100.0))
    assert quads.area(half) == pytest.approx(quads.area(part) / 2)
    assert half[:, 0].min() == 4.5


def test_clip_polygon_cuts_corners_off() -> None:
    """Of a square that stands on its tip about a square of the same area: an octagon is left."""
    reach = np.sqrt(2) * 5
    diamond = np.array([[0.0, -reach], [reach, 0], [0, reach], [-reach, 0]])
    left = quads.clip_polygon(diamond, (-5.0, -5.0, 5.0, 5.0))
    assert left.shape == (8, 2)
    assert np.abs(left).max() == pytest.approx(5)
    assert quads.area(left) == pytest.approx(100 - 4 * (reach - 5) ** 2)


def test_clip_polygon_of_what_is_outside_is_empty() -> None:
    assert quads.clip_polygon(QUAD, (200.0, 0.0, 300.0, 100.0)).shape == (0, 2)
