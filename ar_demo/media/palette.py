"""Pictures of 256 colours, as GIF holds them."""

from fractions import Fraction

import av
import numpy as np
from av.filter import Graph

from hdn.imaging.arrays import Picture


class ToPalette:
    """Converts RGB arrays to frames with a palette of their own each, which FFmpeg finds and dithers to."""

    def __init__(self, width: int, height: int) -> None:
        """Args: width, height: of the frames, px."""
        self._graph = graph = Graph()
        source = graph.add_buffer(
            width=width, height=height, format=av.VideoFormat("rgb24"), time_base=Fraction(1, 100)
        )
        split, sink = graph.add("split"), graph.add("buffersink")
        generate, use = graph.add("palettegen", "stats_mode=single"), graph.add("paletteuse", "new=1")
        for one, two, output, input in (
            (source, split, 0, 0),
            (split, use, 0, 0),
            (split, generate, 1, 0),
            (generate, use, 0, 1),
            (use, sink, 0, 0),
        ):
            one.link_to(two, output, input)
        graph.configure()
        self._count = 0

    def __call__(self, image: Picture) -> av.VideoFrame:
        """Converts (height, width, 3), uint8 or uint16."""
        small = image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(small), "rgb24")
        frame.pts, self._count = self._count, self._count + 1
        self._graph.push(frame)
        converted = self._graph.pull()
        assert isinstance(converted, av.VideoFrame)
        return converted
