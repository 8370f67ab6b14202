"""Between the decoder's and encoder's pixel formats and RGB arrays, with the right matrix and range.

swscale's default flags darken every pixel by about one grey level and halve the chroma resolution; the flags below
do not (measured: mean error 0.02 against -1.2 grey levels), which matters because most of the picture passes through.
"""

from __future__ import annotations

from typing import Literal

import av
import cv2
import numpy as np
from av.video.reformatter import ColorRange, Interpolation, VideoReformatter

from hdn.imaging.arrays import Picture

_ACCURATE_RND, _FULL_CHROMA = 0x40000, 0x2000  # SWS_ACCURATE_RND and SWS_FULL_CHR_H_INT, which PyAV 17 does not name
_TO_RGB = int(Interpolation.BILINEAR) | _ACCURATE_RND | _FULL_CHROMA
_FROM_RGB = int(Interpolation.BILINEAR) | _ACCURATE_RND

# AVColorSpace (H.273 MatrixCoefficients) as tagged on a frame -> our name. Everything else counts as untagged.
_TAGGED = {1: "bt709", 4: "fcc", 5: "bt601", 6: "bt601", 7: "smpte240m", 9: "bt2020", 10: "bt2020"}
# Our name -> swscale's SWS_CS_* number (PyAV 17 does not name them all).
_SWS = {"bt709": 1, "fcc": 4, "bt601": 5, "smpte240m": 7, "bt2020": 9}
_TURNS = {90: cv2.ROTATE_90_COUNTERCLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_CLOCKWISE}


def matrix_of(frame: av.VideoFrame) -> str:
    """Name of the YUV matrix: the tagged one; untagged is BT.601 below 720 lines and BT.709 from there.

    Lines are those of the coded picture's shorter side, so that a rotated clip is judged like an upright one.
    """
    if frame.format.is_rgb:
        return "rgb"
    return _TAGGED.get(frame.colorspace, "bt601" if min(frame.width, frame.height) < 720 else "bt709")


def is_full_range(frame: av.VideoFrame) -> bool:
    """Whether black is 0 and white 255 (tagged so, one of the old yuvj formats, or RGB)."""
    return frame.color_range == ColorRange.JPEG or frame.format.name.startswith("yuvj") or frame.format.is_rgb


def is_hdr(frame: av.VideoFrame) -> bool:
    """Whether the transfer curve is PQ (SMPTE 2084) or HLG (ARIB STD-B67)."""
    return frame.color_trc in (16, 18)


def depth_of(frame: av.VideoFrame) -> int:
    """Bits per sample (8, 10, 12 ...) of the picture as it is coded."""
    return max(component.bits for component in frame.format.components)


def rotation_of(frame: av.VideoFrame) -> int:
    """Counterclockwise turn in degrees (0, 90, 180 or 270) that makes the decoded picture upright."""
    return round(frame.rotation / 90) % 4 * 90


class ToRGB:
    """Converts decoded frames to upright RGB (or RGBA) arrays; keeps swscale's tables between frames."""

    def __init__(self, alpha: bool = False, depth: Literal[8, 16] = 8) -> None:
        """Chooses the arrays' form.

        Args:
            alpha: RGBA rather than RGB.
            depth: bits per sample: 8 for uint8, 16 for uint16 in full scale, made from the source's own depth.
        """
        self._format = {(False, 8): "rgb24", (True, 8): "rgba", (False, 16): "rgb48le", (True, 16): "rgba64le"}[
            alpha, depth
        ]
        self._reformatter = VideoReformatter()

    def __call__(self, frame: av.VideoFrame, rotation: int = 0, size: tuple[int, int] | None = None) -> Picture:
        """Converts a frame.

        Args:
            frame: as decoded.
            rotation: counterclockwise degrees (0, 90, 180 or 270) to turn it by.
            size: (width, height) in px to scale to before turning; None keeps the frame's.

        Returns:
            (H, W, 3 or 4), uint8 or uint16, writable and C-contiguous.
        """
        width, height = size or (frame.width, frame.height)
        rgb = self._reformatter.reformat(
            frame,
            width,
            height,
            format=self._format,
            src_colorspace=_SWS.get(matrix_of(frame)),
            src_color_range=ColorRange.JPEG if is_full_range(frame) else ColorRange.MPEG,
            dst_color_range=ColorRange.JPEG,
            interpolation=_TO_RGB,
        )
        image: Picture = np.ascontiguousarray(rgb.to_ndarray())
        if rotation:
            image = cv2.rotate(image, _TURNS[rotation])
        return image


class FromRGB:
    """Converts RGB arrays to frames of one pixel format in BT.709, limited range."""

    def __init__(self, pix_fmt: str) -> None:
        """Args: pix_fmt: FFmpeg's name of the pixel format, such as "yuv420p" or "yuv420p10le"."""
        self._pix_fmt = pix_fmt
        self._reformatter = VideoReformatter()

    def __call__(self, image: Picture) -> av.VideoFrame:
        """Converts (H, W, 3), uint8 or uint16. It is copied: it may be changed as soon as this returns."""
        image = np.ascontiguousarray(image)
        if image.dtype == np.uint16:
            frame = av.VideoFrame.from_ndarray(image, "rgb48le")
        else:
            frame = av.VideoFrame.from_numpy_buffer(image, "rgb24")
        return self._reformatter.reformat(
            frame,
            format=self._pix_fmt,
            dst_colorspace=_SWS["bt709"],
            src_color_range=ColorRange.JPEG,
            dst_color_range=ColorRange.MPEG,
            interpolation=_FROM_RGB,
        )
