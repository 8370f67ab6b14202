"""A rough guess of the space that an output takes, for a warning before the disk is full."""

import logging
import shutil
from pathlib import Path

from . import codecs
from .reader import VideoInfo

log = logging.getLogger(__name__)

# Bits that a frame's pixel takes in the files of each codec, the mean of three clips of 1280x720 (a drawn street, a
# dog, cups) at the usual quality; others are taken for H.264. Layers, which are empty outside the surface, take less.
BITS_PER_PIXEL = {
    "h264": 0.14,
    "h265": 0.15,
    "av1": 0.17,
    "vp9": 0.23,
    "prores": 3.8,
    "prores4444": 5.4,
    "dnxhr": 3.5,
    "animation": 10.5,
    "ffv1": 3.2,
    "gif": 4.4,
    "webp": 0.7,
    "png": 19.0,
    "exr": 22.0,
    "tiff": 13.0,
}
_GIGA = 10**9


def guess(path: Path, codec: str | None, info: VideoInfo, alpha: bool = False) -> int:
    """Bytes that an output takes, about; 0 where it is not known how many frames there are.

    Args:
        path: of the output. codec, alpha: as `codecs.choose` takes them.
        info: of the video, which the output is as large as.
    """
    kind = codecs.picture_codec(path) if codecs.is_picture(path) else codecs.choose(path, codec, alpha)
    bits = BITS_PER_PIXEL.get(kind.name, BITS_PER_PIXEL["h264"])
    return round((info.frames or 0) * info.width * info.height * bits / 8)


def warn_of_space(path: Path, codec: str | None, info: VideoInfo, alpha: bool = False) -> None:
    """Warns where the disk has less space than an output probably takes."""
    needed, free = guess(path, codec, info, alpha), shutil.disk_usage(path.parent).free
    if needed > free:
        log.warning(
            "%s may take about %.2g GB, and its disk has %.2g GB left: free some, or write elsewhere",
            path.name,
            needed / _GIGA,
            free / _GIGA,
        )
