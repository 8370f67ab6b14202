"""Blend modes: values worked out by hand from W3C Compositing and Blending Level 1, sections 8 and 9."""

from typing import get_args

import numpy as np
import pytest

from ar_demo.choices import Blend
from ar_demo.compositing.blend import BLENDS
from ar_demo.compositing.layer import Layer
from ar_demo.compositing.merge import merge

# Backdrop, source, and what comes out.
BY_HAND = {
    "multiply": [(0.4, 0.5, 0.2), (1.0, 0.3, 0.3), (0.0, 0.9, 0.0)],
    "screen": [(0.4, 0.5, 0.7), (1.0, 0.3, 1.0), (0.0, 0.3, 0.3)],
    # Up to a half: 2 cb cs. Above: screen of cs and 2 cb - 1, as 0.5 + 0.6 - 0.3.
    "overlay": [(0.4, 0.5, 0.4), (0.8, 0.5, 0.8), (0.5, 0.3, 0.3), (0.2, 1.0, 0.4)],
    # cs <= 0.5: cb - (1 - 2 cs) cb (1 - cb), as 0.4 - 0.5 0.4 0.6. Above: cb + (2 cs - 1)(d - cb) with
    # d = ((16 cb - 12) cb + 4) cb = ((3.2 - 12) 0.2 + 4) 0.2 = 0.448 up to a quarter, the root of cb beyond.
    "soft-light": [(0.4, 0.25, 0.28), (0.2, 0.75, 0.2 + 0.5 * 0.248), (0.64, 1.0, 0.8), (0.64, 0.5, 0.64)],
    "add": [(0.4, 0.5, 0.9), (0.2, 0.1, 0.3)],
}


def blended(blend: Blend, cb: float, cs: float) -> float:
    pixel = (np.full((1, 1, 3), value, np.float32) for value in (cb, cs))
    return float(BLENDS[blend](*pixel)[0, 0, 1])


@pytest.mark.parametrize("blend", BY_HAND)
def test_values_by_hand(blend: Blend) -> None:
    for cb, cs, expected in BY_HAND[blend]:
        assert blended(blend, cb, cs) == pytest.approx(expected, abs=1e-6)


def test_every_choice_has_its_function() -> None:
    assert {"normal", *BLENDS} == set(get_args(Blend))
    assert set(BY_HAND) == set(BLENDS)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
@pytest.mark.parametrize(
    ("blend", "expected"),
    [
        # Backdrop 0.4, colour 0.6, alpha 0.6, opacity 0.5: alpha 0.3 in all; 0.7 0.4 + 0.3 B.
        ("normal", 0.28 + 0.3 * 0.6),
        ("multiply", 0.28 + 0.3 * 0.24),
        ("screen", 0.28 + 0.3 * 0.76),
        ("overlay", 0.28 + 0.3 * 0.48),
        ("soft-light", 0.28 + 0.3 * (0.4 + 0.2 * (np.sqrt(0.4) - 0.4))),
        ("add", 0.4 + 0.3 * 0.6),
    ],
)
def test_a_half_transparent_layer_is_weighted_by_its_alpha(
    blend: Blend, expected: float, dtype: type, depth: type
) -> None:
    frame = np.full((4, 5, 3), 0.4 * np.iinfo(depth).max, depth)
    unit = 255 if dtype is np.uint8 else 1
    rgba = np.tile(np.array([0.36, 0.36, 0.36, 0.6]) * unit, (2, 3, 1))
    merge(
        frame,
        Layer((slice(1, 3), slice(1, 4)), np.rint(rgba).astype(dtype) if unit > 1 else rgba.astype(dtype)),
        blend,
        0.5,
    )
    white = np.iinfo(depth).max
    # The layer's colour may be half a level of 8 bit off, by its rounding.
    tolerance = 0.5 + (white / 255 * 0.6 if dtype is np.uint8 else 1e-3 * white / 255)
    assert frame[1:3, 1:4] == pytest.approx(expected * white, abs=tolerance)
    assert (frame[0] == int(0.4 * white)).all()
    assert (frame[:, 4] == int(0.4 * white)).all()


def test_adding_clips_at_white_after_alpha() -> None:
    """0.8 + 0.5 0.6 is 1.1, so white; adding first would clip to 1 and give 0.5 0.8 + 0.5."""
    frame = np.full((1, 1, 3), 204, np.uint8)
    merge(frame, Layer((slice(0, 1), slice(0, 1)), np.full((1, 1, 4), (0.3, 0.3, 0.3, 0.5), np.float32)), "add")
    assert (frame == 255).all()
