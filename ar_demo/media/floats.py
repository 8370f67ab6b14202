"""Pictures of floating point samples in linear light, as OpenEXR's, in coded values."""

import av
import cv2
import numpy as np

from hdn.imaging.arrays import Floats, Picture

from .srgb import to_coded


def is_float(frame: av.VideoFrame) -> bool:
    """Whether a decoded picture has floating point samples."""
    return frame.format.name.startswith(("gbrpf", "gbrapf", "grayf"))


def from_float(frame: av.VideoFrame, width: int, height: int, deep: bool) -> Picture:
    """A decoded picture as sRGB has it: (height, width, 3), uint16 where it is deep, else uint8, in full scale."""
    picture = _samples(frame)
    if picture.shape[:2] != (height, width):
        picture = np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), np.float32)
    most, kind = (65535, np.uint16) if deep else (255, np.uint8)
    return np.rint(to_coded(picture) * np.float32(most)).astype(kind)


def _samples(frame: av.VideoFrame) -> Floats:
    """(h, w, 3), linear; FFmpeg's own way from half floats to others is off by up to a thousandth."""
    kind = np.dtype("<f2" if frame.format.components[0].bits == 16 else "<f4")
    planes = [
        np.frombuffer(plane, kind).reshape(-1, plane.line_size // kind.itemsize)[: plane.height, : plane.width]  # type: ignore[call-overload]
        for plane in frame.planes
    ]
    red, green, blue = (planes[index] for index in ((2, 0, 1) if len(planes) > 1 else (0, 0, 0)))
    return np.stack([red, green, blue], -1).astype(np.float32)
