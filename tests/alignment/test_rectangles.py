"""Likely rectangles in drawn frames."""

import cv2
import numpy as np
import pytest

from hdn.alignment.rectangles import MODEL, find_rectangles
from hdn.imaging.arrays import Array, Image
from hdn.imaging.observation import Observation

from ..scenes import Scene, error, moved, texture


def posters() -> list[tuple[Image, Array]]:
    """Frames with a poster at known corners."""
    rng, found = np.random.default_rng(7), []
    for seed in range(6):
        scene = Scene(640, 480, seed)
        quad = moved(
            scene.quad * 2, tuple(rng.uniform(-40, 40, 2)), rng.uniform(0.7, 1.2), rng.uniform(-0.5, 0.5), 4e-4
        )
        found.append((scene.draw(quad), quad))
    return found


def screens() -> tuple[Image, list[Array]]:
    """A room with two bright screens and a page, upright and turned."""
    image = np.full((540, 960, 3), 90, np.uint8)
    image[360:] = [120, 100, 80]
    quads = [
        np.array([[100.0, 80], [380, 100], [376, 260], [98, 270]]),
        np.array([[520.0, 90], [820, 60], [828, 240], [526, 250]]),
        np.array([[420.0, 380], [600, 390], [590, 500], [400, 488]]),
    ]
    for quad, colour in zip(quads, ([200, 220, 240], [30, 40, 60], [235, 230, 220]), strict=True):
        cv2.fillConvexPoly(image, np.round(quad * 16).astype(np.int32), colour, cv2.LINE_AA, 4)
    noise = np.random.default_rng(0).normal(0, 3, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8), quads


def test_posters_come_first() -> None:
    ranks = []
    for frame, quad in posters():
        errors = [error(found.corners, quad) for found in find_rectangles(Observation(frame))]
        ranks.append(next((i for i, e in enumerate(errors) if e < 2), None))
    assert sum(rank == 0 for rank in ranks) >= 5


@pytest.mark.parametrize("scale", [1, 2])
def test_finds_each_of_several(scale: int) -> None:
    image, quads = screens()
    image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    found = find_rectangles(Observation(image))
    for quad in quads:
        assert min(error(f.corners, (quad + 0.5) * scale - 0.5) for f in found[:5]) < 1.5 * scale
    assert [f.score for f in found] == sorted((f.score for f in found), reverse=True)
    assert all(0 < f.score <= 1 for f in found)


def test_corners_begin_at_the_top_left_and_run_clockwise() -> None:
    for found in find_rectangles(Observation(screens()[0])):
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = found.corners
        assert x0 < x1
        assert x3 < x2
        assert y0 < y3
        assert y1 < y2


@pytest.mark.parametrize(
    "image",
    [
        np.full((240, 320, 3), 128, np.uint8),
        np.random.default_rng(0).integers(0, 256, (240, 320, 3)).astype(np.uint8),
        cv2.GaussianBlur(texture(3, 320, 240), (0, 0), 6),
        np.zeros((2, 2, 3), np.uint8),
    ],
)
def test_none_where_there_are_none(image: Image) -> None:
    assert find_rectangles(Observation(image)) == []


def test_not_more_than_are_asked_for() -> None:
    board = np.kron(np.indices((8, 10)).sum(0) % 2, np.ones((50, 60))).astype(np.uint8) * 200
    image = np.repeat(board[..., None], 3, 2)
    assert 0 < len(find_rectangles(Observation(image))) <= MODEL.most
