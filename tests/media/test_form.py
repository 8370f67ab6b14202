"""The form of an output, by the source's and what is asked for."""

from dataclasses import replace
from pathlib import Path

import pytest

from ar_demo.choices import Depth
from ar_demo.media.form import form_of
from ar_demo.media.reader import VideoInfo, VideoReader

from .. import clips


@pytest.fixture(scope="module")
def info(tmp_path_factory: pytest.TempPathFactory) -> VideoInfo:
    with VideoReader(clips.make_clip(tmp_path_factory.mktemp("form") / "a.mp4", clips.numbered(1))) as reader:
        return reader.info


@pytest.mark.parametrize(
    ("source", "name", "codec", "depth", "written"),
    [
        # Source's bits, output, codec and depth asked for: the codec and bits.
        (8, "a.mp4", None, "auto", ("h264", 8)),
        (10, "a.mp4", None, "auto", ("h265", 10)),
        (10, "a.mp4", None, "8", ("h264", 8)),
        (10, "a.mp4", "h264", "auto", ("h264", 10)),
        (12, "a.mkv", "h264", "auto", ("h264", 10)),
        (16, "a.mov", None, "auto", ("h265", 12)),
        (10, "a.webm", None, "auto", ("av1", 10)),
        (10, "a.webm", "vp9", "auto", ("vp9", 8)),
        (10, "a.gif", None, "auto", ("gif", 8)),
        (8, "a.mp4", None, "10", ("h265", 10)),
        (8, "a.mov", "prores", "auto", ("prores", 8)),
        (12, "a.mov", None, "source", ("h265", 12)),
    ],
)
def test_codec_and_bits(
    info: VideoInfo, source: int, name: str, codec: str | None, depth: Depth, written: tuple[str, int]
) -> None:
    form = form_of(Path(name), replace(info, depth=source), depth, codec)
    assert (form.codec, form.depth) == written


@pytest.mark.parametrize(
    ("pixel_format", "depth", "kept"),
    [
        ("yuv420p", "auto", True),
        ("yuvj420p", "auto", True),
        ("yuv422p", "auto", False),
        ("yuv422p", "source", True),
        ("yuv422p10le", "auto", True),
        ("yuv422p10le", "8", False),
    ],
)
def test_chroma(info: VideoInfo, pixel_format: str, depth: Depth, kept: bool) -> None:
    source = replace(info, pixel_format=pixel_format, depth=10 if "10" in pixel_format else 8)
    form = form_of(Path("a.mp4"), source, depth, None)
    assert form.pixel_format == (pixel_format if kept else None)


def test_fewer_bits_are_announced(info: VideoInfo) -> None:
    form = form_of(Path("a.webm"), replace(info, depth=10), "auto", "vp9")
    assert form.warnings == ("VP9 does not hold 10 bits in this size: the output has 8",)


def test_odd_sizes_of_10_bits_where_av1_has_none(info: VideoInfo) -> None:
    form = form_of(Path("a.webm"), replace(info, depth=10, width=97, height=63), "auto", None)
    assert (form.codec, form.depth) == ("vp9", 8)
