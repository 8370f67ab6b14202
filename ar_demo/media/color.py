"""Between the decoder's and encoder's pixel formats and RGB arrays, with the right matrix and range.

swscale's default flags darken every pixel by about one grey level and halve the chroma resolution; the flags below
do not (measured: mean error 0.02 against -1.2 grey levels), which matters because most of the picture passes through.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import av
import cv2
import numpy as np
from av.video.reformatter import ColorRange, Interpolation, VideoReformatter
from numpy.typing import NDArray

from hdn.imaging.arrays import Picture

from ..hdr import HLG_PEAK, USUAL_PEAK, Hdr, Transfer
from .floats import from_float, is_float
from .mastering import Mastering

PADDING_BYTES = 64
_ACCURATE_RND, _FULL_CHROMA = 0x40000, 0x2000  # SWS_ACCURATE_RND and SWS_FULL_CHR_H_INT, which PyAV 17 does not name
_TO_RGB = int(Interpolation.BILINEAR) | _ACCURATE_RND | _FULL_CHROMA
_TO_RGB_ROUGHLY = int(Interpolation.BILINEAR)
_FROM_RGB = int(Interpolation.BILINEAR) | _ACCURATE_RND

# AVColorSpace (H.273 MatrixCoefficients) as tagged on a frame -> our name. Everything else counts as untagged.
_TAGGED_MATRICES = {1: "bt709", 4: "fcc", 5: "bt601", 6: "bt601", 7: "smpte240m", 9: "bt2020", 10: "bt2020"}
_HDR_TRANSFERS: dict[int, Transfer] = {16: "pq", 18: "hlg"}  # H.273 TransferCharacteristics
# Our name -> swscale's SWS_CS_* number (PyAV 17 does not name them all).
_SWS_NUMBERS = {"bt709": 1, "fcc": 4, "bt601": 5, "smpte240m": 7, "bt2020": 9}
# Our name -> weights of red and blue in luma (H.273, MatrixCoefficients).
_LUMA_WEIGHTS = {
    "bt709": (0.2126, 0.0722),
    "fcc": (0.30, 0.11),
    "bt601": (0.299, 0.114),
    "smpte240m": (0.212, 0.087),
    "bt2020": (0.2627, 0.0593),
}
TURNS = {90: cv2.ROTATE_90_COUNTERCLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_CLOCKWISE}


@dataclass(frozen=True)
class Colour:
    """How the samples of a picture are to be understood.

    Attributes:
        matrix: its name, see `matrix_of`.
        full_range: whether black is 0 and white the largest value.
        tags: H.273's numbers of matrix, range (1 limited, 2 full), primaries and transfer as the file has them; where
            it does not say, 2 (0 for the range).
    """

    matrix: str
    full_range: bool
    tags: tuple[int, int, int, int]

    @staticmethod
    def of(frame: av.VideoFrame) -> Colour:
        """Of a decoded frame."""
        tags = frame.colorspace, frame.color_range, frame.color_primaries, frame.color_trc
        return Colour(matrix_of(frame), is_full_range(frame), tuple(map(int, tags)))  # type: ignore[arg-type]

    def tag(self, what: av.VideoFrame | av.VideoCodecContext) -> None:
        """Writes the tags on a frame, or an encoder that is not open yet."""
        what.colorspace, what.color_range, what.color_primaries, what.color_trc = self.tags

    def converted(self, pix_fmt: str) -> Colour:
        """The colour for a pixel format that is not the picture's own: with HDR's light the same, else BT.709."""
        primaries, transfer = self.tags[2:] if self.is_hdr else (1, 1)
        if av.VideoFormat(pix_fmt).is_rgb or pix_fmt == "pal8":
            return Colour("rgb", True, (0, 2, primaries, transfer))
        return Colour("bt2020", False, (9, 1, primaries, transfer)) if self.is_hdr else BT709

    @property
    def is_hdr(self) -> bool:
        """Whether the transfer curve is PQ or HLG."""
        return self.tags[3] in _HDR_TRANSFERS


BT709 = Colour("bt709", False, (1, 1, 1, 1))


def matrix_of(frame: av.VideoFrame) -> str:
    """Name of the YUV matrix: the tagged one; untagged is BT.601 below 720 lines and BT.709 from there.

    Lines are those of the coded picture's shorter side, so that a rotated clip is judged like an upright one.
    """
    if frame.format.is_rgb:
        return "rgb"
    return _TAGGED_MATRICES.get(frame.colorspace, "bt601" if min(frame.width, frame.height) < 720 else "bt709")


def is_full_range(frame: av.VideoFrame) -> bool:
    """Whether black is 0 and white 255 (tagged so, one of the old yuvj formats, or RGB)."""
    return frame.color_range == ColorRange.JPEG or frame.format.name.startswith("yuvj") or frame.format.is_rgb


def hdr_of(frame: av.VideoFrame) -> Hdr | None:
    """How a frame's samples stand for light, where its transfer curve is PQ or HLG; None for SDR."""
    transfer = _HDR_TRANSFERS.get(frame.color_trc)
    if transfer is None:
        return None
    peak = Mastering.of(frame).peak if transfer == "pq" else HLG_PEAK
    return Hdr(transfer, frame.color_primaries, peak or USUAL_PEAK)


def depth_of(frame: av.VideoFrame) -> int:
    """Bits per sample (8, 10, 12 ...) of the picture as it is coded; 16 of floating point."""
    return min(max(component.bits for component in frame.format.components), 16)


def rotation_of(frame: av.VideoFrame) -> int:
    """Counterclockwise turn in degrees (0, 90, 180 or 270) that makes the decoded picture upright."""
    return round(frame.rotation / 90) % 4 * 90


class ToRGB:
    """Converts decoded frames to upright RGB (or RGBA) arrays; keeps swscale's tables between frames."""

    def __init__(
        self, form: Literal["rgb24", "rgba", "rgb48"] = "rgb24", tonemap: Hdr | None = None, rough: bool = False
    ) -> None:
        """Args:
        form: uint8 with 3 or 4 channels, or uint16 with 3, in full scale and from the source's own depth.
        tonemap: how the frames' samples stand for light, to have them shown in SDR; None takes them as they are.
        rough: to be looked at by a tracker alone: about one grey level too dark, and with chroma of half the
            resolution, in a tenth of the time.
        """
        self._form, self._hdr = form, tonemap
        self._interpolation = _TO_RGB_ROUGHLY if rough else _TO_RGB
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
        if is_float(frame):
            image = from_float(frame, width, height, deep=self._form == "rgb48")
        elif self._hdr is not None:
            image = self._hdr.to_sdr(self._deep(frame, width, height))
            if self._form != "rgb48":
                image = (image >> 8).astype(np.uint8)
            if self._form == "rgba":
                alpha = self._reformat(frame, width, height, "rgba", ColorRange.JPEG)[..., 3]
                image = np.dstack([image, alpha])
        elif self._form == "rgb48":
            image = self._deep(frame, width, height)
        else:
            image = self._reformat(frame, width, height, self._form, ColorRange.JPEG)
        if rotation:
            image = cv2.rotate(image, TURNS[rotation])
        return image

    def _reformat(self, frame: av.VideoFrame, width: int, height: int, form: str, range: ColorRange) -> Picture:
        converted = self._reformatter.reformat(
            frame,
            width,
            height,
            format=form,
            src_colorspace=_SWS_NUMBERS.get(matrix_of(frame)),
            dst_colorspace=_SWS_NUMBERS.get(matrix_of(frame)) if form.startswith("yuv") else None,
            src_color_range=ColorRange.JPEG if is_full_range(frame) else ColorRange.MPEG,
            dst_color_range=range,
            interpolation=self._interpolation,
        )
        return np.ascontiguousarray(converted.to_ndarray())

    def _deep(self, frame: av.VideoFrame, width: int, height: int) -> Picture:
        """16 bits per sample. YUV of more than 8 bits is multiplied out here, for swscale wraps saturated colours."""
        depth, matrix, full = depth_of(frame), matrix_of(frame), is_full_range(frame)
        if depth <= 8:
            return self._reformat(frame, width, height, "rgb24", ColorRange.JPEG) * np.uint16(257)
        if matrix == "rgb":
            return self._reformat(frame, width, height, "rgb48le", ColorRange.JPEG)
        yuv = self._reformat(frame, width, height, "yuv444p16le", ColorRange.JPEG if full else ColorRange.MPEG)
        return cv2.transform(yuv, _yuv_to_rgb(matrix, depth if full else None))


@cache
def _yuv_to_rgb(matrix: str, full_depth: int | None) -> NDArray[np.float64]:
    """(3, 4) from 16-bit YUV to 16-bit RGB in full scale, by H.273's equations 38 to 43.

    Args:
        matrix: its name.
        full_depth: bits per sample of a full range source, whose samples were shifted up; None for limited range.
    """
    red, blue = _LUMA_WEIGHTS[matrix]
    green = 1 - red - blue
    of_y_and_chroma = np.array(
        [
            [1, 0, 2 * (1 - red)],
            [1, -2 * blue * (1 - blue) / green, -2 * red * (1 - red) / green],
            [1, 2 * (1 - blue), 0],
        ]
    )
    if full_depth is None:
        black, luma, chroma = 16 << 8, 219 << 8, 224 << 8
    else:
        black = 0
        luma = chroma = ((1 << full_depth) - 1) << (16 - full_depth)
    scaled = of_y_and_chroma * 65535 / [luma, chroma, chroma]
    return np.hstack([scaled, -scaled @ [[black], [128 << 8], [128 << 8]]])


def _padded(image: Picture) -> Picture:
    """A copy of a picture with memory behind it, which swscale reads (FFmpeg's AV_INPUT_BUFFER_PADDING_SIZE)."""
    memory = np.empty(image.size + PADDING_BYTES, np.uint8)
    copy = memory[: image.size].reshape(image.shape)
    copy[:] = image
    return copy


class FromRGB:
    """Converts RGB arrays to frames of one pixel format."""

    def __init__(self, pix_fmt: str, colour: Colour = BT709) -> None:
        """Args: pix_fmt: FFmpeg's name, such as "yuv420p" or "yuv420p10le". colour: of the frames."""
        self.pix_fmt, self.colour = pix_fmt, colour
        self._is_rgb = av.VideoFormat(pix_fmt).is_rgb
        self._reformatter = VideoReformatter()

    def __call__(self, image: Picture) -> av.VideoFrame:
        """Converts (H, W, 3), uint8 or uint16. It is copied: it may be changed as soon as this returns."""
        if image.dtype == np.uint16:
            # swscale takes 255 * 256 for white where it makes YUV.
            image = np.ascontiguousarray(image if self._is_rgb else image - (image >> 8))
            frame = av.VideoFrame.from_ndarray(image, "rgb48le")
        else:
            frame = av.VideoFrame.from_numpy_buffer(_padded(image), "rgb24")
        return self._reformatter.reformat(
            frame,
            format=self.pix_fmt,
            dst_colorspace=_SWS_NUMBERS.get(self.colour.matrix),
            src_color_range=ColorRange.JPEG,
            dst_color_range=ColorRange.JPEG if self.colour.full_range else ColorRange.MPEG,
            interpolation=_FROM_RGB,
        )
