"""What an HDR video says of the display that it was mastered on, and of its brightest (SMPTE ST 2086, CTA-861.3)."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import cast

import av
from av.sidedata.sidedata import SideData, Type

# FFmpeg's structures: AVMasteringDisplayMetadata has ten pairs of numerator and denominator and two flags.
_DISPLAY, _LIGHT = struct.Struct("20i2i"), struct.Struct("2I")
_DYNAMIC = {
    Type.DOVI_METADATA: "Dolby Vision's",
    Type.DOVI_RPU_BUFFER: "Dolby Vision's",
    Type.DYNAMIC_HDR_PLUS: "HDR10+'s",
    Type.DYNAMIC_HDR_VIVID: "HDR Vivid's",
}


@dataclass(frozen=True)
class Mastering:
    """Static metadata of an HDR video.

    Attributes:
        display: CIE x and y of red, green, blue and white of the mastering display, and its least and largest
            luminance in cd/m^2, ten numbers; None where the file does not say.
        light: the brightest pixel, and the brightest mean of a frame, cd/m^2; None where the file does not say.
    """

    display: tuple[Fraction, ...] | None
    light: tuple[int, int] | None

    @staticmethod
    def of(frame: av.VideoFrame) -> Mastering:
        """Of a decoded frame."""
        display = light = None
        found = _side_data(frame)
        if len(data := found.get(Type.MASTERING_DISPLAY_METADATA, b"")) >= _DISPLAY.size:
            *pairs, has_primaries, has_luminance = _DISPLAY.unpack_from(data)
            if has_primaries and has_luminance and all(pairs[1::2]):
                display = tuple(Fraction(n, d) for n, d in zip(pairs[::2], pairs[1::2], strict=True))
        if len(data := found.get(Type.CONTENT_LIGHT_LEVEL, b"")) >= _LIGHT.size:
            light = _LIGHT.unpack_from(data)
        return Mastering(display, light if light and any(light) else None)

    @property
    def peak(self) -> float | None:
        """cd/m^2 of the brightest pixel as far as it is told."""
        if self.light and self.light[0]:
            return float(self.light[0])
        return float(self.display[9]) if self.display and self.display[9] else None

    def options(self, encoder: str) -> dict[str, str]:
        """The encoder's options that write it; none where it has none, as `can_be_written` says."""
        if encoder not in _WRITERS:
            return {}
        option, display, light, scaled = _WRITERS[encoder]
        parts = []
        if self.display is not None:
            chromaticity, luminance = (50000, 10000) if scaled else (1, 1)
            red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y = (
                _number(value * chromaticity, scaled) for value in self.display[:8]
            )
            least, most = (_number(value * luminance, scaled) for value in self.display[8:])
            parts.append(
                f"{display}=G({green_x},{green_y})B({blue_x},{blue_y})R({red_x},{red_y})"
                f"WP({white_x},{white_y})L({most},{least})"
            )
        if self.light is not None:
            parts.append(f"{light}={self.light[0]},{self.light[1]}")
        return {option: ":".join(parts)} if parts else {}

    def can_be_written(self, encoder: str) -> bool:
        """Whether an encoder, by FFmpeg's name, has a place for it, or there is nothing to write."""
        return encoder in _WRITERS or (self.display is None and self.light is None)


# Encoder -> its option for options of its own, their names for display and light, and whether numbers are in units of
# 0.00002 and 0.0001 cd/m^2.
_WRITERS = {
    "libx264": ("x264-params", "mastering-display", "cll", True),
    "libx265": ("x265-params", "master-display", "max-cll", True),
    "libsvtav1": ("svtav1-params", "mastering-display", "content-light", False),
}


def _number(value: Fraction, whole: bool) -> str:
    return str(round(value)) if whole else f"{float(value):.6g}"


def dynamic_metadata(frame: av.VideoFrame) -> str | None:
    """Whose metadata a decoded frame carries that say anew for each frame how it is to be shown; None for none."""
    return next((_DYNAMIC[kind] for kind in _side_data(frame) if kind in _DYNAMIC), None)


def _side_data(frame: av.VideoFrame) -> dict[Type, bytes]:
    return {side.type: bytes(side) for side in cast(Iterable[SideData], frame.side_data)}
