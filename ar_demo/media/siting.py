"""Where a 4:2:0 picture's chroma samples lie among its luma samples; PyAV does not say, the stream's headers do."""

from __future__ import annotations

import re
from pathlib import Path

import av
import av.logging
from av.bitstream import BitStreamFilterContext

from .decode import open_video

# FFmpeg's name -> where a chroma sample lies in its cell of 2x2 luma samples, right and down, in cells.
_PLACES = {
    "left": (0, 0.5),
    "center": (0.5, 0.5),
    "topleft": (0, 0),
    "top": (0.5, 0),
    "bottomleft": (0, 1),
    "bottom": (0.5, 1),
}
# Codec -> what its header calls it, the names of its values, and which counts where the header does not say.
_HEADERS: dict[str, tuple[str, tuple[str | None, ...], str | None]] = {
    "h264": ("chroma_sample_loc_type_top_field", tuple(_PLACES), "left"),
    "hevc": ("chroma_sample_loc_type_top_field", tuple(_PLACES), "left"),
    "libdav1d": ("chroma_sample_position", (None, "left", "topleft"), None),
}


def chroma_siting(path: Path) -> str | None:
    """Where the chroma samples of a 4:2:0 video lie, by FFmpeg's name; None where that is not known.

    Told by the headers of H.264, H.265 and AV1.

    Raises:
        InputError: as `open_video`.
    """
    container, stream = open_video(path)
    with container:
        if stream.codec_context.name not in _HEADERS:
            return None
        title, names, usual = _HEADERS[stream.codec_context.name]
        level = av.logging.get_level()
        av.logging.set_level(av.logging.INFO)  # at which the filter tells
        try:
            with av.logging.Capture() as said:
                trace = BitStreamFilterContext("trace_headers", stream)
                packet = next(container.demux(stream), None)
                if packet is not None and packet.size:
                    trace.filter(packet)
        except (av.FFmpegError, OSError, ValueError):
            return None
        finally:
            av.logging.set_level(level)
    for _, _, message in said:
        if found := re.search(rf"\b{title}\b.* = (\d+)", message):
            number = int(found[1])
            return names[number] if number < len(names) else None
    return usual


def turned(siting: str | None, rotation: int) -> str | None:
    """The same after a picture has been turned counterclockwise by degrees (0, 90, 180 or 270); None for no name."""
    if siting is None:
        return None
    x, y = _PLACES[siting]
    for _ in range(rotation // 90):
        x, y = y, 1 - x
    return next((name for name, place in _PLACES.items() if place == (x, y)), None)
