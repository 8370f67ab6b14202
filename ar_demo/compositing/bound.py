"""A layer within a matte that was made elsewhere, which says how much of each pixel it may take."""

import numpy as np

from hdn.imaging.arrays import Floats, Grey, Image

from ..scene.occlusion import Occluder
from .layer import Layer, in_float

STEP = 1 / 255  # of a matte in 8 bits: what it lacks to an alpha by no more is rounding


def in_front(layer: Layer, opacity: float, matte: Grey, seen: Image, behind: Floats | None) -> Occluder:
    """What lies over a layer, for it to take no more of each pixel than a matte leaves it.

    Where the matte is the layer's own alpha, as at its edges in one that was saved, nothing does.

    Args:
        opacity: 0..1, that the layer is laid on with.
        matte: (H, W) 0..1, of the frame.
        seen: (h, w, 3) the frame in the layer's box, 8 bits.
        behind: (h, w, 3) the surface there without what is in front of it; None where that is not known.
    """
    alpha = in_float(layer.rgba[..., 3]) * np.float32(opacity)
    most = matte[layer.box]
    left = np.divide(most, alpha, out=np.ones_like(alpha), where=most < alpha - STEP)
    share = np.repeat(1 - left[..., None], 3, axis=2)
    part = seen.astype(np.float32)
    # A pixel is its mixture with the surface behind, which goes: what is left of it is light of its own.
    ground = part if behind is None else behind
    colour = np.clip(part - (1 - share) * ground, 0, 255 * share)
    return Occluder(layer.box, share, np.asarray(colour, np.float32), np.asarray(ground, np.float32))
