"""Interlaced frames made whole, by FFmpeg's bwdif: one frame of each, by its own fields and its neighbours'."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from fractions import Fraction

import av
from av.filter import Graph

_WITH_FIELDS = 2  # FFmpeg's AVFieldOrder, from which a stream has fields


def is_interlaced(frame: av.VideoFrame, context: av.VideoCodecContext) -> bool:
    """Whether a stream is interlaced, by its first frame or its header."""
    return frame.interlaced_frame or getattr(context, "field_order", 0) >= _WITH_FIELDS


def deinterlaced(frames: Iterable[av.VideoFrame]) -> Generator[av.VideoFrame, None, None]:
    """As many frames in the same order, made whole; those that are not interlaced come out as they are.

    Each comes once the next one has been taken.
    """
    graph: Graph | None = None
    form = None
    for frame in frames:
        if (frame.width, frame.height, frame.format.name) != form:
            yield from _rest(graph)
            form = frame.width, frame.height, frame.format.name
            graph = _graph(*form, frame.time_base or Fraction(1, 1000))
        assert graph is not None
        graph.push(frame)
        yield from _ready(graph)
    yield from _rest(graph)


def _graph(width: int, height: int, pix_fmt: str, time_base: Fraction) -> Graph:
    graph = Graph()
    form = av.VideoFormat(pix_fmt, width, height)
    source = graph.add_buffer(width=width, height=height, format=form, time_base=time_base)
    bwdif, sink = graph.add("bwdif", "mode=send_frame:deint=interlaced"), graph.add("buffersink")
    source.link_to(bwdif)
    bwdif.link_to(sink)
    graph.configure()
    return graph


def _rest(graph: Graph | None) -> Iterator[av.VideoFrame]:
    if graph is not None:
        graph.push(None)
        yield from _ready(graph)


def _ready(graph: Graph) -> Iterator[av.VideoFrame]:
    while True:
        try:
            frame = graph.pull()
        except (BlockingIOError, av.error.EOFError):
            return
        assert isinstance(frame, av.VideoFrame)
        yield frame
