"""What is not drawn into goes from decoder to encoder as it is."""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from ar_demo.media import color
from ar_demo.media.form import form_of
from ar_demo.media.outputs import open_output
from ar_demo.media.planes import Planes, can_be_kept, cell, grown, samples
from ar_demo.media.reader import Frame, VideoReader
from ar_demo.media.siting import chroma_siting, turned
from ar_demo.media.writer import VideoWriter

from .. import clips
from ..videos import write

SIZE = 192, 144
BOX = slice(41, 90), slice(51, 120)  # odd, so that it shares chroma samples with what is around it


def noisy(count: int, seed: int = 0) -> list[clips.Image]:
    """Pictures of every colour, which no conversion to RGB and back keeps."""
    rng = np.random.default_rng(seed)
    return [rng.integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8) for _ in range(count)]


def red_in_the_box(frame: Frame) -> None:
    before = frame.image.copy()
    frame.image[BOX] = (np.iinfo(frame.image.dtype).max, 0, 0)
    frame.add_drawn(before, [BOX])


def through(
    source: Path, target: Path, codec: str, draw: Callable[[Frame], None] = red_in_the_box, **options: Any
) -> Path:
    """A clip read, drawn into, and written in its own form."""
    with VideoReader(source) as probe:
        depth = probe.info.depth
    with VideoReader(source, depth=16 if depth > 8 else 8) as reader:
        info = reader.info
        form = {"depth": depth, "pixel_format": info.pixel_format, "colour": info.colour}
        with VideoWriter(target, info.width, info.height, info.rate, codec=codec, **form, **options) as writer:
            for frame in reader.frames():
                draw(frame)
                writer.write(frame.image, frame.time, frame.duration, frame.planes, frame.drawn)
    return target


def decoded(path: Path) -> list[av.VideoFrame]:
    with av.open(str(path)) as container:
        return list(container.decode(video=0))


@pytest.mark.parametrize("full_range", [False, True])
@pytest.mark.parametrize("matrix", [clips.BT601, clips.BT709])
@pytest.mark.parametrize("pix_fmt", ["yuv420p", "yuv422p", "yuv444p", "yuv420p10le", "yuv422p10le", "yuv444p12le"])
def test_outside_the_box_the_samples_are_the_decoders(
    tmp_path: Path, pix_fmt: str, matrix: int, full_range: bool
) -> None:
    form = {"codec": "ffv1", "pix_fmt": pix_fmt, "matrix": matrix, "full_range": full_range}
    source = clips.make_clip(tmp_path / "a.mkv", noisy(3), **form)
    target = through(source, tmp_path / "b.mkv", "ffv1")
    for before, after in zip(decoded(source), decoded(target), strict=True):
        assert after.format.name == pix_fmt
        assert color.Colour.of(after) == color.Colour.of(before)
        for index in range(3):
            a, b = samples(before, index), samples(after, index)
            x, y = cell(pix_fmt) if index else (1, 1)
            box = tuple(slice(s.start // n, -(-s.stop // n)) for s, n in zip(BOX, (y, x), strict=True))
            assert not np.array_equal(a[box], b[box])
            outside = np.ones(a.shape, bool)
            outside[box] = False
            assert np.array_equal(a[outside], b[outside])
        inside = color.ToRGB()(after)[BOX][4:-4, 4:-4]
        assert np.abs(inside.astype(int) - [255, 0, 0]).max() <= 3


def test_from_h264_to_h264(tmp_path: Path) -> None:
    source = clips.make_clip(tmp_path / "a.mp4", noisy(3), options={"crf": "30"})
    target = through(source, tmp_path / "b.mp4", "libx264", crf=0)  # which is lossless
    for before, after in zip(decoded(source), decoded(target), strict=True):
        assert color.Colour.of(after) == color.Colour.of(before)
        assert np.array_equal(samples(before, 0)[90:], samples(after, 0)[90:])
        assert np.array_equal(samples(before, 2)[45:], samples(after, 2)[45:])


@pytest.mark.parametrize("rotation", [90, 180, 270])
@pytest.mark.parametrize("pix_fmt", ["yuv420p", "yuv444p", "yuv420p10le"])
def test_turned_clips_keep_theirs_turned(tmp_path: Path, pix_fmt: str, rotation: int) -> None:
    source = clips.make_clip(tmp_path / "a.mp4", noisy(2), pix_fmt=pix_fmt, rotation=rotation)
    target = through(source, tmp_path / "b.mkv", "ffv1")
    for before, after in zip(decoded(source), decoded(target), strict=True):
        a, b = np.rot90(samples(before, 0), rotation // 90), samples(after, 0)
        assert np.array_equal(a[:41], b[:41])
        assert np.array_equal(a[90:], b[90:])
        a, b = np.rot90(samples(before, 1), rotation // 90), samples(after, 1)
        assert np.array_equal(a[: 40 // cell(pix_fmt)[1]], b[: 40 // cell(pix_fmt)[1]])


def test_what_cannot_be_turned_exactly_is_not_kept() -> None:
    half_wide = av.VideoFrame(64, 48, "yuv422p")
    assert can_be_kept(half_wide)
    assert can_be_kept(half_wide, 180)
    assert not can_be_kept(half_wide, 90)
    assert not can_be_kept(av.VideoFrame(63, 48, "yuv420p"), 180)
    assert not can_be_kept(av.VideoFrame(64, 48, "nv12"))
    assert not can_be_kept(av.VideoFrame(64, 48, "rgb24"))


def test_another_colour_than_the_files_is_converted(tmp_path: Path) -> None:
    """Frames whose tags change on the way."""
    chart = clips.color_chart(*SIZE)
    source = clips.make_clip(tmp_path / "a.mkv", [chart], codec="ffv1", matrix=clips.BT601)
    with VideoReader(source) as reader, VideoWriter(tmp_path / "b.mkv", *SIZE, Fraction(25), codec="ffv1") as writer:
        for frame in reader.frames():
            writer.write(frame.image, frame.time, frame.duration, frame.planes)
    [after] = decoded(tmp_path / "b.mkv")
    assert after.colorspace == 1
    assert np.abs(clips.patch_colors(color.ToRGB()(after)) - clips.patch_colors(chart)).max() <= 3


def test_the_sources_key_frames_are_not_the_outputs(tmp_path: Path) -> None:
    source = clips.make_clip(tmp_path / "a.mp4", noisy(20), gop=2)
    target = through(source, tmp_path / "b.mp4", "libx264", lambda frame: None)
    assert sum(frame.key_frame for frame in decoded(source)) == 10
    assert sum(frame.key_frame for frame in decoded(target)) == 1


def test_a_frame_that_is_not_drawn_into_is_the_decoders(tmp_path: Path) -> None:
    source = clips.make_clip(tmp_path / "a.mkv", noisy(2), codec="ffv1", pix_fmt="yuv420p10le")
    target = through(source, tmp_path / "b.mkv", "ffv1", lambda frame: None)
    for before, after in zip(decoded(source), decoded(target), strict=True):
        assert all(np.array_equal(samples(before, i), samples(after, i)) for i in range(3))


@pytest.mark.parametrize("pix_fmt", ["yuv420p", "yuv422p10le"])
def test_in_the_box_pixels_that_did_not_change_are_the_decoders_too(tmp_path: Path, pix_fmt: str) -> None:
    """As in the corners around a tilted ad."""
    spot = slice(50, 70), slice(61, 90)

    def draw(frame: Frame) -> None:
        before = frame.image.copy()
        frame.image[spot] ^= 0xFF
        frame.add_drawn(before, [BOX, (slice(0, 0), slice(0, 0))])

    source = clips.make_clip(tmp_path / "a.mkv", noisy(1), codec="ffv1", pix_fmt=pix_fmt)
    [before], [after] = decoded(source), decoded(through(source, tmp_path / "b.mkv", "ffv1", draw))
    for index in range(3):
        a, b = samples(before, index), samples(after, index)
        x, y = cell(pix_fmt) if index else (1, 1)
        inside = np.zeros(a.shape, bool)
        inside[spot[0].start // y : -(-spot[0].stop // y), spot[1].start // x : -(-spot[1].stop // x)] = True
        assert np.array_equal(a[~inside], b[~inside])
        assert (a[inside] != b[inside]).mean() > 0.7


@pytest.mark.parametrize("codec", ["h264", "h265", "av1"])
def test_chroma_samples_are_said_to_lie_where_the_sources_do(tmp_path: Path, codec: str) -> None:
    depth = {"depth": 10, "pixel_format": "yuv420p10le"} if codec == "av1" else {"pixel_format": "yuv420p"}
    source = write(tmp_path / "a.mp4", noisy(2), codec=codec, siting="topleft", **depth)
    assert chroma_siting(source) == "topleft"
    with VideoReader(source) as reader:
        form = form_of(tmp_path / "b.mp4", reader.info, "auto", codec)
        with open_output(tmp_path / "b.mp4", reader.info, form) as writer:
            for frame in reader.frames():
                writer.write(frame.image, frame.time, frame.duration, frame.planes)
    assert chroma_siting(tmp_path / "b.mp4") == "topleft"


def test_where_chroma_samples_lie_by_default_and_turned(tmp_path: Path) -> None:
    assert chroma_siting(clips.make_clip(tmp_path / "a.mp4", noisy(1))) == "left"
    assert chroma_siting(clips.make_clip(tmp_path / "a.mkv", noisy(1), codec="ffv1")) is None
    assert [turned("left", degrees) for degrees in (0, 90, 180, 270)] == ["left", "bottom", None, "top"]
    assert turned("topleft", 180) is None
    assert turned("center", 90) == "center"
    assert turned(None, 90) is None


def test_a_box_grows_to_whole_cells_inside_the_picture() -> None:
    assert grown(BOX, 0, (2, 2), (144, 192)) == (slice(40, 90), slice(50, 120))
    assert grown(BOX, 4, (2, 2), (97, 121)) == (slice(32, 97), slice(42, 121))


def test_the_old_full_range_formats_are_what_they_are() -> None:
    frame = av.VideoFrame(64, 48, "yuvj420p")
    samples(frame, 0)[:] = 255
    planes = Planes(frame)
    assert (planes.pix_fmt, planes.colour.full_range) == ("yuv420p", True)
    own = planes.with_drawn(np.zeros((48, 64, 3), np.uint8), [], color.FromRGB("yuv420p", planes.colour))
    assert own.format.name == "yuv420p"
    assert (samples(own, 0) == 255).all()
