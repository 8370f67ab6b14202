"""Light and samples by BT.2100, graphics by BT.2408, and SDR's view of it by BT.2390."""

from typing import Any

import numpy as np
import pytest

from ar_demo.hdr import GRAPHICS_WHITE, Hdr, Transfer, eetf, graded, light_to_pq, pq_to_light
from hdn.imaging.arrays import Floats

BOTH: Any = pytest.mark.parametrize("transfer", ["pq", "hlg"])


def grey(level: float) -> Floats:
    return np.full((1, 1, 3), level, np.float32)


def coded(level: float) -> np.ndarray[Any, np.dtype[np.uint16]]:
    return np.full((1, 1, 3), round(level * 65535), np.uint16)


@pytest.mark.parametrize(("light", "signal"), [(0, 0), (100, 0.5081), (203, 0.5807), (1000, 0.7518), (10000, 1)])
def test_pq_as_bt_2408_tabulates_it(light: float, signal: float) -> None:
    assert light_to_pq(np.array(light)) == pytest.approx(signal, abs=1e-4)
    assert pq_to_light(np.array(signal)) == pytest.approx(light, rel=2e-3, abs=1e-3)


@pytest.mark.parametrize(("transfer", "signal"), [("pq", 0.58), ("hlg", 0.75)])
def test_graphics_white(transfer: Transfer, signal: float) -> None:
    """BT.2408, table 1: 203 cd/m^2, which is 58 % of PQ and 75 % of HLG."""
    hdr = Hdr(transfer)
    assert hdr.signal(hdr.of_graphics(grey(1))) / 65535 == pytest.approx(signal, abs=1e-3)


def test_hlg_shows_its_peak_at_1000() -> None:
    assert Hdr("hlg").light(coded(1)) * GRAPHICS_WHITE == pytest.approx(1000, rel=1e-3)


@BOTH
def test_there_and_back(transfer: Transfer) -> None:
    signal = np.random.default_rng(0).integers(0, 65536, (40, 50, 3)).astype(np.uint16)
    hdr = Hdr(transfer)
    assert np.abs(hdr.signal(hdr.light(signal)).astype(int) - signal).max() <= 1


def test_primaries_as_bt_2087_has_them() -> None:
    red = Hdr("pq", 9).of_graphics(np.array([[[1, 0, 0]]], np.float32))
    assert red == pytest.approx(np.array([[[0.6274, 0.0691, 0.0164]]]), abs=1e-4)
    assert Hdr("pq", 1).of_graphics(red) == pytest.approx(red**2.4, rel=1e-3)  # which are BT.709's: nothing to do
    assert (Hdr("pq", 2).of_graphics(red) == Hdr("pq", 9).of_graphics(red)).all()  # unknown: taken for BT.2020


@BOTH
def test_the_view_of_graphics_is_the_picture(transfer: Transfer) -> None:
    """Below the knee, at about 92 cd/m^2, and with all hues; above it highlights are held back."""
    colours = np.random.default_rng(0).random((20, 30, 3)).astype(np.float32) * np.float32(0.65)
    hdr = Hdr(transfer)
    shown = hdr.to_sdr(hdr.signal(hdr.of_graphics(colours))) / 65535
    assert np.abs(shown - colours).max() < 0.02  # where a channel is next to nothing beside the others
    assert np.abs(shown - colours).mean() < 0.001
    levels = [int(hdr.to_sdr(hdr.signal(grey(light)))[0, 0, 0]) for light in (0.3, 1, 2, 4, 4.9)]
    assert levels == sorted(set(levels))
    assert 225 < levels[1] / 257 < 235
    assert levels[-1] / 257 > 254


def test_the_curve_ends_where_it_should() -> None:
    light = np.linspace(0.01, 1000, 500)
    shown = eetf(light, 1000, 203)
    assert (np.diff(shown) > 0).all()
    assert shown[-1] == pytest.approx(203)
    assert shown[light < 90] == pytest.approx(light[light < 90], rel=1e-4)
    assert eetf(light[light < 203], 203, 203) == pytest.approx(light[light < 203], rel=1e-4)  # nothing to hold back


def test_what_cannot_be_coded_is_clipped() -> None:
    assert (Hdr("pq").signal(grey(1e6)) == 65535).all()
    assert (Hdr("hlg").signal(grey(-1)) == 0).all()
    assert graded(grey(-1)).max() == 0
