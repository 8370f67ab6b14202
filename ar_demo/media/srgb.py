"""sRGB's curve (IEC 61966-2-1), by which pictures in linear light, as OpenEXR's, and coded values are told apart."""

import numpy as np

from hdn.imaging.arrays import Floats, Picture

_SLOPE = np.float32(12.92)  # of coded values over linear light, at black


def to_linear(coded: Picture) -> Floats:
    """Coded values of any shape in linear light, 0..1.

    Args:
        coded: uint8 or uint16 in full scale, or float32 0..1.
    """
    if coded.dtype.kind == "u":
        most = np.iinfo(coded.dtype).max
        table = to_linear(np.arange(most + 1, dtype=np.float32) / np.float32(most))
        return table[coded]
    curve = ((coded + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.where(coded <= 0.04045, coded / _SLOPE, curve).astype(np.float32)


def to_coded(linear: Floats) -> Floats:
    """Linear light of any shape in coded values, 0..1; what is beyond is cut off."""
    clipped = np.clip(linear, 0, 1)
    curve = np.float32(1.055) * clipped ** np.float32(1 / 2.4) - np.float32(0.055)
    return np.where(clipped <= 0.0031308, clipped * _SLOPE, curve).astype(np.float32)
