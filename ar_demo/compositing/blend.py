"""Blend modes: what a layer's colour becomes over the colour behind it.

After W3C, Compositing and Blending Level 1 (https://www.w3.org/TR/compositing-1/), in the values as they are coded, as
browsers and image editors do. `cb` is the colour behind (the backdrop), `cs` the layer's own (the source), each
float32 (h, w, 3), 0..1.
"""

from collections.abc import Callable

import numpy as np

from hdn.imaging.arrays import Floats

from ..choices import Blend


def multiply(cb: Floats, cs: Floats) -> Floats:
    """Section 9.1.2."""
    return cb * cs


def screen(cb: Floats, cs: Floats) -> Floats:
    """Section 9.1.3."""
    return cb + cs - cb * cs


def overlay(cb: Floats, cs: Floats) -> Floats:
    """Section 9.1.4: hard light with the two exchanged."""
    return np.where(cb <= 0.5, multiply(cs, 2 * cb), screen(cs, 2 * cb - 1))


def soft_light(cb: Floats, cs: Floats) -> Floats:
    """Section 9.1.9."""
    d = np.where(cb <= 0.25, ((16 * cb - 12) * cb + 4) * cb, np.sqrt(cb))
    return np.where(cs <= 0.5, cb - (1 - 2 * cs) * cb * (1 - cb), cb + (2 * cs - 1) * (d - cb))


def add(cb: Floats, cs: Floats) -> Floats:
    """Section 8.1.13, the operator `lighter`, which clips to 1 once the layer's alpha has weighted the sum."""
    return cb + cs


# `normal`, which leaves the layer's colour as it is, has no function.
BLENDS: dict[Blend, Callable[[Floats, Floats], Floats]] = {
    "multiply": multiply,
    "screen": screen,
    "overlay": overlay,
    "soft-light": soft_light,
    "add": add,
}
