"""Quads given by hand, and the edges that they move to."""

import cv2
import numpy as np
import pytest

from hdn.alignment.snapping import MODEL, snap
from hdn.errors import InputError
from hdn.imaging.arrays import Array, Image
from hdn.imaging.observation import Observation

from ..scenes import Scene, error, moved

SEEDS = range(6)


def posters() -> list[tuple[Image, Array]]:
    """Frames with a poster at known corners."""
    rng = np.random.default_rng(4)
    frames = []
    for seed in SEEDS:
        scene = Scene(seed=seed)
        quad = moved(scene.quad, (rng.uniform(-20, 20), rng.uniform(-20, 20)), 1.1, rng.uniform(-0.4, 0.4), 5e-4)
        frames.append((scene.draw(quad), quad))
    return frames


def by_hand(quad: Array, error_px: float, seed: int) -> Array:
    """The quad with each corner off by so many px, in any direction."""
    angle = np.random.default_rng(seed).uniform(0, 2 * np.pi, 4)
    return quad + error_px * np.stack([np.cos(angle), np.sin(angle)], 1)


@pytest.mark.parametrize("error_px", [1.0, 2.0, 3.0])
def test_corners_given_by_hand_move_to_the_edges(error_px: float) -> None:
    errors = []
    for seed, (frame, quad) in enumerate(posters()):
        given = by_hand(quad, error_px, seed)
        snapped, moved_px = snap(Observation(frame), given)
        np.testing.assert_allclose(moved_px, np.linalg.norm(snapped - given, axis=1))
        errors.append(error(snapped, quad))
    assert np.median(errors) < 0.2
    assert max(errors) < 0.8


def test_a_good_quad_stays_good() -> None:
    errors = [error(snap(Observation(frame), quad).quad, quad) for frame, quad in posters()]
    assert np.median(errors) < 0.2
    assert max(errors) < 0.5


def test_what_has_no_edges_stays() -> None:
    scene = Scene()
    quad = scene.quad + 0.3
    for wall in (scene.draw(None), np.full((240, 320, 3), 90, np.uint8)):
        snapped, moved_px = snap(Observation(wall), quad)
        np.testing.assert_array_equal(snapped, quad)
        assert not moved_px.any()


def bars(*at: int) -> Image:
    """A dark picture with a light stripe, that many px below the top, from one row to before the next."""
    image = np.full((120, 200, 3), 40, np.uint8)
    image[slice(*at)] = 200
    return image


def test_a_side_at_the_edge_of_the_frame_does_not_keep_the_others() -> None:
    quad = np.array([[-1.0, 28.5], [199, 28.5], [199, 90], [-1, 90]])
    snapped = snap(Observation(bars(30, 120)), quad).quad
    np.testing.assert_allclose(snapped, [[-1, 29.5], [199, 29.5], [199, 90], [-1, 90]], atol=0.05)


def test_sides_without_an_edge_stay_where_they_are() -> None:
    quad = np.array([[40.0, 31.6], [160, 28.2], [161, 90], [41, 92]])
    snapped, moved_px = snap(Observation(bars(30, 120)), quad)
    np.testing.assert_allclose(snapped[:2, 1], 29.5, atol=0.05)  # between the rows 29 and 30
    np.testing.assert_array_equal(moved_px[2:], 0)


@pytest.mark.parametrize(("given", "edge"), [(28.5, 27.5), (31.5, 32.5)])
def test_of_two_edges_the_nearest_counts(given: float, edge: float) -> None:
    quad = np.array([[40.0, given], [160, given], [160, 90], [40, 90]])
    snapped = snap(Observation(bars(28, 33)), quad).quad
    np.testing.assert_allclose(snapped[:2, 1], edge, atol=0.1)


def test_an_edge_that_is_not_beside_the_whole_side_is_none() -> None:
    image = bars(30, 120)
    image[:, :70] = 40
    image[:, 130:] = 40
    quad = np.array([[40.0, 28], [160, 28], [160, 90], [40, 90]])
    assert not snap(Observation(image), quad).moved_px.any()


@pytest.mark.parametrize("off", [3.0, 6.0])
def test_nothing_moves_further_than_a_few_px(off: float) -> None:
    quad = np.array([[40.0, 29.5 - off], [160, 29.5 - off], [160, 90], [40, 90]])
    assert snap(Observation(bars(30, 120)), quad).moved_px.any() == (off < MODEL.reach_px)


def test_in_large_frames_a_few_px_are_more() -> None:
    small = bars(30, 120)
    factor = 4 * MODEL.usual_frame_px // small.shape[1]
    large = cv2.resize(small, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
    quad = np.array([[40.0, 29.1], [160, 29.1], [160, 90], [40, 90]])
    snapped = snap(Observation(large), (quad + 0.5) * factor - 0.5).quad
    np.testing.assert_allclose(snapped[:2, 1], 30 * factor - 0.5, atol=0.05 * factor)


def test_an_impossible_quad_is_refused() -> None:
    with pytest.raises(InputError, match="crosses itself"):
        snap(Observation(bars(30, 120)), np.array([[40.0, 28], [160, 90], [160, 28], [40, 90]]))
