"""From pictures with transparency to the encoders' pixel formats.

swscale dithers alpha to 8 bits, which is then off by up to two levels; it is laid into its plane here, rounded.
"""

from __future__ import annotations

import av
import numpy as np

from hdn.imaging.arrays import Picture

from .color import BT709, Colour, FromRGB
from .planes import samples

_PACKED = {"argb": (3, 0, 1, 2), "bgra": (2, 1, 0, 3)}  # the channels, RGBA, in the order of the format


class FromRGBA:
    """Converts RGBA arrays to frames of one pixel format with alpha, which is always in full range."""

    def __init__(self, pix_fmt: str, colour: Colour = BT709) -> None:
        """Args: pix_fmt: FFmpeg's name, such as "yuva444p10le" or "argb". colour: of the frames, where they are YUV."""
        self._pix_fmt, self._colour = pix_fmt, colour
        self._from_rgb = FromRGB(pix_fmt.replace("yuva", "yuv"), colour) if pix_fmt.startswith("yuva") else None

    def __call__(self, image: Picture) -> av.VideoFrame:
        """Converts (H, W, 4), uint16 in full scale, straight or premultiplied as it is to be. It is copied."""
        if self._from_rgb is not None:
            return self._planar(self._from_rgb(image[..., :3]), image[..., 3])
        if self._pix_fmt in _PACKED:
            small = _rounded(image, 255).astype(np.uint8)[..., _PACKED[self._pix_fmt]]
            return av.VideoFrame.from_ndarray(np.ascontiguousarray(small), self._pix_fmt)
        return av.VideoFrame.from_ndarray(np.ascontiguousarray(image), "rgba64le").reformat(format=self._pix_fmt)

    def _planar(self, colour: av.VideoFrame, alpha: Picture) -> av.VideoFrame:
        """A frame of the planes of YUV, and alpha (H, W) beside them."""
        frame = av.VideoFrame(colour.width, colour.height, self._pix_fmt)
        self._colour.tag(frame)
        for index in range(len(colour.planes)):
            samples(frame, index)[:] = samples(colour, index)
        samples(frame, 3)[:] = _rounded(alpha, (1 << frame.format.components[3].bits) - 1)
        return frame


def _rounded(image: Picture, most: int) -> Picture:
    """uint16 in full scale in steps of which `most` is white."""
    return (image.astype(np.uint32) * most + 32767) // 65535
