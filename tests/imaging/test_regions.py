"""Regions: what is a polygon, and the mask that polygons make."""

import numpy as np
import pytest

from hdn.errors import InputError
from hdn.imaging.homography import similarity
from hdn.imaging.regions import EVERYWHERE, Region, check_region

SQUARE = np.array([[10.0, 10], [30, 10], [30, 30], [10, 30]])
# Concave: it opens to the right.
HOOK = np.array([[0.0, 0], [60, 0], [60, 10], [10, 10], [10, 30], [60, 30], [60, 40], [0, 40]])


def test_everywhere_is_the_whole_frame() -> None:
    assert EVERYWHERE.is_everywhere
    assert (EVERYWHERE.mask(40, 30) == 255).all()


def test_what_is_excluded_is_taken_out_of_what_is_included() -> None:
    hole = np.array([[15.0, 15], [20, 15], [20, 20], [15, 20]])
    region = Region(SQUARE, (hole,))
    mask = region.mask(50, 40)
    y, x = np.mgrid[:40, :50]
    inside = (x >= 10) & (x <= 30) & (y >= 10) & (y <= 30)
    out = (x >= 15) & (x <= 20) & (y >= 15) & (y <= 20)
    np.testing.assert_array_equal(mask, 255 * (inside & ~out))
    np.testing.assert_array_equal(Region(exclude=(hole,)).mask(50, 40), 255 * ~out)
    assert not region.is_everywhere


def test_a_concave_polygon_that_reaches_beyond_the_frame() -> None:
    mask = Region(HOOK * 1000 - [0, 0]).mask(60, 40)
    assert (mask == 255).all()
    mask = Region(HOOK - [0, 5]).mask(40, 30)
    assert (mask[:5] == 255).all()  # the upper arm
    assert (mask[6:25, 12:] == 0).all()  # between the arms
    assert (mask[26:, :] == 255).all()  # the lower arm


def test_it_moves_with_its_plane() -> None:
    moved = Region(SQUARE, (SQUARE + 3,)).transformed(similarity(2, 0, 5, 1))
    np.testing.assert_allclose(moved.include, SQUARE * 2 + [5, 1])
    np.testing.assert_allclose(moved.exclude[0], (SQUARE + 3) * 2 + [5, 1])
    assert EVERYWHERE.transformed(np.eye(3)).is_everywhere


@pytest.mark.parametrize(
    ("polygon", "message"),
    [
        (SQUARE[:2], "three corners"),
        (SQUARE[[0, 2, 1, 3]], "crosses itself"),
        (SQUARE[[0, 1, 1]], "flat"),
        (np.array([[0, 0], [np.nan, 0], [5, 5]]), "three corners"),
        (np.array([1.0, 2, 3]), "three corners"),
    ],
)
def test_refuses_what_is_no_polygon(polygon: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=f"the region .*{message}"):
        Region(polygon)
    with pytest.raises(InputError, match=f"an excluded polygon .*{message}"):
        Region(None, (SQUARE, polygon))


@pytest.mark.parametrize("polygon", [SQUARE, SQUARE[::-1], HOOK, SQUARE[[0, 1, 2, 3, 0]], SQUARE[[0, 1, 2]]])
def test_takes_every_simple_polygon(polygon: np.ndarray) -> None:
    assert Region(polygon).include is polygon


def test_something_has_to_be_left_of_the_frame() -> None:
    check_region(Region(SQUARE), 40, 40)
    check_region(EVERYWHERE, 8, 8)
    for region in (Region(SQUARE + 100), Region(SQUARE, (SQUARE - [2, 0],))):
        with pytest.raises(InputError, match="leaves under 256 px of the 40x40 frame"):
            check_region(region, 40, 40)
