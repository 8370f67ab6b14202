"""High dynamic range: samples as light and light as samples, by ITU-R BT.2100, and what of it SDR can show.

Light is relative to graphics white, which BT.2408 puts at 203 cd/m^2 (58 % of PQ, 75 % of HLG): 1 is as bright as the
white of a caption, and of an ad. It is what a display shows; HLG is shown as on one of 1000 cd/m^2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from hdn.imaging.arrays import Array, Floats

Deep = NDArray[np.uint16]  # (h, w, 3) RGB, 0..65535, as coded

GRAPHICS_WHITE = 203.0  # cd/m^2 (BT.2408, table 1)
SDR_GAMMA = 2.4  # of a display of SDR (BT.1886)
HLG_PEAK = 1000.0  # cd/m^2 of the display that HLG is shown on ...
HLG_GAMMA = 1.2  # ... and its system gamma (BT.2100, table 5)
PQ_PEAK = 10000.0  # cd/m^2
USUAL_PEAK = 1000.0  # cd/m^2 of a PQ video that does not say

Transfer = Literal["pq", "hlg"]

# CIE x, y of red, green, blue and white, by H.273's number of the primaries.
_WHITE_D65 = (0.3127, 0.3290)
_PRIMARIES = {
    1: ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060), _WHITE_D65),  # BT.709
    9: ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), _WHITE_D65),  # BT.2020
    12: ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), _WHITE_D65),  # P3 with D65
}
_BT709, _BT2020 = 1, 9
_ENTRIES = 65536  # of a table


def pq_to_light(signal: Array) -> Array:
    """BT.2100's EOTF of PQ: signal 0..1 to cd/m^2."""
    power = np.power(signal, 1 / _M2)
    return np.asarray(PQ_PEAK * np.power(np.maximum(power - _C1, 0) / (_C2 - _C3 * power), 1 / _M1))


def light_to_pq(light: Array) -> Array:
    """Its inverse: cd/m^2 to signal 0..1."""
    power = np.power(np.clip(light / PQ_PEAK, 0, 1), _M1)
    return np.asarray(np.power((_C1 + _C2 * power) / (1 + _C3 * power), _M2))


_M1, _M2 = 2610 / 16384, 2523 / 4096 * 128
_C1, _C2, _C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32


def hlg_to_scene(signal: Array) -> Array:
    """BT.2100's inverse OETF of HLG: signal 0..1 to light of the scene, 0..1."""
    return np.where(signal <= 0.5, signal**2 / 3, (np.exp((signal - _C) / _A) + _B) / 12)


def scene_to_hlg(scene: Array) -> Array:
    """Its inverse."""
    return np.where(scene <= 1 / 12, np.sqrt(3 * scene), _A * np.log(np.maximum(12 * scene - _B, 1e-9)) + _C)


_A = 0.17883277
_B, _C = 1 - 4 * _A, 0.5 - _A * np.log(4 * _A)


@dataclass(frozen=True)
class Hdr:
    """How the samples of an HDR picture stand for light.

    Attributes:
        transfer: the curve.
        primaries: H.273's number; those that are not known count as BT.2020.
        peak: cd/m^2 of the brightest that there is.
    """

    transfer: Transfer
    primaries: int = _BT2020
    peak: float = USUAL_PEAK

    def light(self, signal: Deep) -> Floats:
        """Samples (h, w, 3) as light (h, w, 3), 1 being graphics white."""
        light = _decoding(self.transfer).take(signal)
        return self._as_displayed(light, HLG_GAMMA - 1, HLG_PEAK / GRAPHICS_WHITE) if self.transfer == "hlg" else light

    def signal(self, light: Floats) -> Deep:
        """Light (h, w, 3) as samples; what cannot be coded is clipped."""
        if self.transfer == "hlg":
            light = self._as_displayed(light * np.float32(GRAPHICS_WHITE / HLG_PEAK), 1 / HLG_GAMMA - 1, 1)
        return np.asarray(_encoding(self.transfer).take(_index(light, 1 / _most(self.transfer))))

    def of_graphics(self, picture: Floats) -> Floats:
        """The colours (h, w, 3) of an SDR picture in BT.709, 0..1, as light, by BT.2408's display-referred mapping."""
        return _transformed(ungraded(picture), _between(_BT709, self._primaries))

    def to_sdr(self, signal: Deep) -> Deep:
        """Samples (h, w, 3) as an SDR picture in BT.709 that shows the same, its highlights held back.

        The curve is BT.2390's EETF from `peak` to graphics white, on the largest of R, G and B, so that hues stay.
        """
        light = self.light(signal)
        red, green, blue = cv2.split(light)
        index = _index(cv2.max(cv2.max(red, green), blue), GRAPHICS_WHITE / PQ_PEAK)
        dimmed = _compression(max(self.peak, GRAPHICS_WHITE)).take(index)
        shown = _transformed(cv2.multiply(light, cv2.merge([dimmed] * 3)), _between(self._primaries, _BT709))
        return np.asarray(_gamma().take(_index(shown, 1)))

    @property
    def _primaries(self) -> int:
        return self.primaries if self.primaries in _PRIMARIES else _BT2020

    def _as_displayed(self, light: Floats, exponent: float, scale: float) -> Floats:
        """Light times a power of its luminance: BT.2100's OOTF of HLG, or its inverse."""
        luminance = cv2.transform(light, _to_xyz(self._primaries)[1:2])
        gain = cv2.pow(np.maximum(luminance, np.float32(1e-9)), exponent)
        return np.asarray(cv2.multiply(light, cv2.merge([gain] * 3), scale=scale), np.float32)


def graded(light: Floats) -> Floats:
    """Light, 1 being graphics white, as an SDR display's samples, which go beyond 1 where it is brighter."""
    return np.asarray(np.power(np.maximum(light, 0), np.float32(1 / SDR_GAMMA)), np.float32)


def ungraded(samples: Floats) -> Floats:
    """The light of an SDR display's samples."""
    return np.asarray(np.power(samples, np.float32(SDR_GAMMA)), np.float32)


def eetf(light: Array, peak: float, shown: float) -> Array:
    """BT.2390-10's electrical-electrical transfer function, section 5.4, in light: cd/m^2 to cd/m^2.

    Args:
        light: cd/m^2.
        peak: the brightest that there is, cd/m^2.
        shown: the brightest that is shown, cd/m^2.
    """
    top = float(light_to_pq(np.array(peak)))
    most = float(light_to_pq(np.array(shown))) / top
    knee = 1.5 * most - 0.5
    level = np.minimum(light_to_pq(light) / top, 1)
    t = (level - knee) / max(1 - knee, 1e-9)
    spline = (2 * t**3 - 3 * t**2 + 1) * knee + (t**3 - 2 * t**2 + t) * (1 - knee) + (-2 * t**3 + 3 * t**2) * most
    return pq_to_light(top * np.where(level < knee, level, spline))


def _most(transfer: Transfer) -> float:
    """The light that the largest sample stands for; of the scene with HLG."""
    return PQ_PEAK / GRAPHICS_WHITE if transfer == "pq" else 1.0


@cache
def _decoding(transfer: Transfer) -> Floats:
    """Light by sample."""
    signal = np.linspace(0, 1, _ENTRIES)
    curve: Callable[[Array], Array] = pq_to_light if transfer == "pq" else hlg_to_scene
    return (curve(signal) / (GRAPHICS_WHITE if transfer == "pq" else 1)).astype(np.float32)


@cache
def _encoding(transfer: Transfer) -> Deep:
    """Sample by the fourth root of light as a share of the most."""
    share = np.linspace(0, 1, _ENTRIES) ** 4
    signal = light_to_pq(share * PQ_PEAK) if transfer == "pq" else scene_to_hlg(share)
    return np.rint(signal * 65535).astype(np.uint16)


@cache
def _compression(peak: float) -> Floats:
    """How much darker light is shown in SDR, by the fourth root of light as a share of PQ's most."""
    light = np.maximum(np.linspace(0, 1, _ENTRIES) ** 4 * PQ_PEAK, 1e-6)
    return (eetf(light, peak, GRAPHICS_WHITE) / light).astype(np.float32)


@cache
def _gamma() -> Deep:
    """SDR sample by the fourth root of light."""
    return np.rint(np.linspace(0, 65535, _ENTRIES) ** (4 / SDR_GAMMA) * 65535 ** (1 - 4 / SDR_GAMMA)).astype(np.uint16)


@cache
def _to_xyz(primaries: int) -> Array:
    """(3, 3) from RGB of these primaries to CIE XYZ (SMPTE RP 177)."""
    *colours, white = (np.array([x / y, 1, (1 - x - y) / y]) for x, y in _PRIMARIES[primaries])
    columns = np.stack(colours, 1)
    return np.asarray(columns * np.linalg.solve(columns, white))


@cache
def _between(source: int, target: int) -> Array:
    return np.asarray(np.linalg.solve(_to_xyz(target), _to_xyz(source)))


def _transformed(light: Floats, matrix: Array) -> Floats:
    return np.asarray(cv2.transform(light, matrix), np.float32)


def _index(light: Floats, scale: float) -> Deep:
    """Where light, (h, w) or (h, w, 3), stands in a table: by its fourth root, as the eye has it."""
    share = np.multiply(light, np.float32(scale))
    root = cv2.sqrt(cv2.sqrt(np.maximum(share, 0, out=share)))
    return np.asarray(cv2.addWeighted(root, _ENTRIES - 1, root, 0, 0, dtype=cv2.CV_16U))
