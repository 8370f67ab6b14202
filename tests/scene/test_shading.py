"""Light that changes within a few pixels."""

import numpy as np
import pytest

from ar_demo.scene.shading import CLOTH, shading

from ..scenes import texture

PRINT = texture(5, 120, 80).mean(2).astype(np.float32)
TRUST = np.ones((80, 120), np.float32)


def shaded() -> np.ndarray:
    """A shadow with a sharp edge takes half of the light from the right side."""
    view = PRINT.copy()
    view[:, 60:] *= np.sqrt(0.5)
    return view


def test_a_shadow_keeps_its_edge() -> None:
    light = shading(shaded(), PRINT, TRUST, 0.2)
    assert np.median(light[:, 70:]) == pytest.approx(0.5, abs=0.05)
    assert np.median(light[:, :50]) == pytest.approx(1, abs=0.02)
    across = np.median(light, axis=0)
    assert np.flatnonzero(across < 0.75).min() == pytest.approx(60, abs=3)


def test_noise_is_no_light() -> None:
    noisy = PRINT + np.random.default_rng(0).normal(0, 3, PRINT.shape).astype(np.float32)
    assert np.abs(shading(noisy, PRINT, TRUST, 0.2) - 1).mean() < 0.01


def test_a_print_beside_itself_is_no_light() -> None:
    light = shading(np.roll(PRINT, 1, 1), PRINT, TRUST, 1.0)
    assert np.quantile(np.abs(light - 1), 0.9) < 0.1


def test_what_is_hidden_tells_nothing() -> None:
    view, trust = PRINT.copy(), TRUST.copy()
    view[:, :40], trust[:, :40] = 5, 0
    light = shading(view, PRINT, trust, 0.2)
    assert np.abs(light - 1).max() < 0.05


def test_folds_of_cloth_are_kept_that_a_print_would_not_have() -> None:
    across = np.arange(PRINT.shape[1])
    folds = np.exp(0.3 * np.sin(across * (2 * np.pi / 9))).astype(np.float32)  # 9 px from fold to fold
    view = PRINT * np.sqrt(folds) + np.random.default_rng(0).normal(0, 1, PRINT.shape).astype(np.float32)
    print_, cloth = (np.log(shading(view, PRINT, TRUST, 0.2, *model)) - np.log(folds) for model in ((), (CLOTH,)))
    assert np.sqrt(np.square(cloth).mean()) < 0.08
    assert np.sqrt(np.square(cloth).mean()) < 0.6 * np.sqrt(np.square(print_).mean())
