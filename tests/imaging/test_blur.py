"""Blur that is told by spectra, of a poster that is moved as well."""

import cv2
import numpy as np
import pytest

from hdn.imaging.arrays import Array, Grey
from hdn.imaging.blur import spectral_blur

from ..scenes import texture

SIZE = (160, 120)
BEYOND = 40  # px of the poster around what is looked at, so that a streak has something to blur in


@pytest.fixture(scope="module")
def poster() -> Grey:
    picture = texture(5, SIZE[0] + 2 * BEYOND, SIZE[1] + 2 * BEYOND)
    return np.asarray(cv2.GaussianBlur(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), (0, 0), 0.7), np.float32)


def view(poster: Grey, shift: tuple[int, int] = (0, 0), noise: float = 1.0) -> Grey:
    """What is looked at of the poster, which is moved by whole px."""
    x, y = BEYOND - shift[0], BEYOND - shift[1]
    seen = poster[y : y + SIZE[1], x : x + SIZE[0]]
    return (seen + np.random.default_rng(sum(shift)).normal(0, noise, seen.shape)).astype(np.float32)


def streaked(image: Grey, length: float, angle: float) -> Grey:
    """The image blurred along a line of so many px, at an angle to x, rad."""
    reach = int(length) // 2 + 2
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(float)
    along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    kernel = np.clip(length / 2 + 0.5 - np.abs(along), 0, 1) * np.clip(1 - np.abs(across), 0, 1)
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()), np.float32)


def axes(blur: Array) -> tuple[float, float, float]:
    """Length of the streak of a blur (2, 2), px, its angle to x, 0..pi, and its deviation across, px."""
    values, vectors = np.linalg.eigh(blur)
    return np.sqrt(12 * values[1]), np.arctan2(vectors[1, 1], vectors[0, 1]) % np.pi, np.sqrt(max(values[0], 0))


@pytest.mark.parametrize("angle", [0.0, 0.6, 2.0])
@pytest.mark.parametrize("length", [10, 25, 45])
def test_streaks(poster: Grey, length: int, angle: float) -> None:
    found, direction, across = axes(spectral_blur(view(poster), view(streaked(poster, length, angle), (5, -4))))
    # Long streaks come out shorter: in so small a view their spectrum's zeros are smeared.
    assert (0.8 if length < 40 else 0.6) * length < found < 1.2 * length
    assert abs((direction - angle + np.pi / 2) % np.pi - np.pi / 2) < 0.1
    assert across < 2


def test_the_same_picture_is_as_sharp(poster: Grey) -> None:
    assert np.abs(spectral_blur(view(poster), view(poster, (6, 3)))).max() < 0.5
    np.testing.assert_allclose(spectral_blur(view(poster), view(poster)), 0, atol=1e-6)


def test_a_sharper_view_is_not_blurred(poster: Grey) -> None:
    assert np.linalg.eigvalsh(spectral_blur(view(streaked(poster, 15, 0.3)), view(poster))).max() < 0.5


def test_blur_by_focus_is_round(poster: Grey) -> None:
    soft = np.asarray(cv2.GaussianBlur(poster, (0, 0), 1.6), np.float32)
    blur = spectral_blur(view(poster), view(soft, (3, 2)))
    np.testing.assert_allclose(np.linalg.eigvalsh(blur), 1.6**2, rtol=0.3)


def test_without_texture_nothing_is_told() -> None:
    flat = np.full(SIZE[::-1], 128, np.float32) + np.random.default_rng(0).normal(0, 1, SIZE[::-1]).astype(np.float32)
    np.testing.assert_array_equal(spectral_blur(flat, flat), np.zeros((2, 2)))
