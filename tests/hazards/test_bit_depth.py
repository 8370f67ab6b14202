"""More than 8 bits per sample."""

from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import numpy as np
import pytest
from av.video.stream import VideoStream
from numpy.typing import NDArray
from PIL import Image

from ar_demo import OutputOptions, Session, Surface
from ar_demo.media import color
from ar_demo.media.ad import open_ad
from ar_demo.media.planes import samples
from ar_demo.media.reader import VideoReader
from ar_demo.media.writer import VideoWriter
from hdn.errors import InputError

from .. import clips
from ..test_session import Still
from ..videos import write


def test_ten_bit(tmp_path: Path) -> None:
    chart = clips.color_chart(192, 144)
    clip = clips.make_clip(tmp_path / "t.mov", [chart] * 2, codec="prores_ks", pix_fmt="yuv422p10le")
    error = clips.patch_colors(next(VideoReader(clip).frames()).image) - clips.patch_colors(chart)
    assert np.abs(error).max() <= 3


def test_ten_bit_video(tmp_path: Path) -> None:
    chart = clips.color_chart(192, 144)
    path = clips.make_clip(tmp_path / "t.mov", [chart], codec="prores_ks", pix_fmt="yuv422p10le")
    image = open_ad(path).at(Fraction(0))
    assert image is not None
    assert np.abs(clips.patch_colors(image) - clips.patch_colors(chart)).max() <= 3


def test_grey_of_sixteen_bits(tmp_path: Path) -> None:
    Image.fromarray(np.full((24, 32), 0x8040, np.uint16)).save(tmp_path / "g.png")
    image = open_ad(tmp_path / "g.png").at(Fraction(0))
    assert image is not None
    assert image.shape == (24, 32, 3)
    assert (image == 0x80).all()


LEVELS = 877  # of grey in 10 bits of limited range, 64 to 940; 8 bits have 220


def ramp(width: int = 2048, height: int = 32) -> NDArray[np.uint16]:
    """From black to white in as many steps as there are columns."""
    row = np.linspace(0, 65535, width).round().astype(np.uint16)
    return np.ascontiguousarray(np.broadcast_to(row[None, :, None], (height, width, 3)))


@pytest.mark.parametrize(
    ("name", "codec", "depth"),
    [
        ("a.mp4", "libx264", 10),
        ("a.mp4", "libx265", 10),
        ("a.mkv", "libx265", 12),
        ("a.webm", "libsvtav1", 10),
        ("a.mov", "prores_ks", 10),
        ("a.mkv", "ffv1", 16),
    ],
)
def test_a_ramp_keeps_its_levels_from_file_to_file(tmp_path: Path, name: str, codec: str, depth: int) -> None:
    source, copy = tmp_path / f"in.{name}", tmp_path / f"out.{name}"
    quality = {} if codec in ("prores_ks", "ffv1") else {"crf": 1}
    write(source, [ramp()] * 3, codec=codec, depth=depth, **quality)
    with VideoReader(source, depth=16) as reader:
        assert reader.info.depth == depth
        assert (reader.info.colour.matrix, reader.info.colour.full_range) == ("bt709", False)
        images = [frame.image for frame in reader.frames()]
    assert images[0].dtype == np.uint16
    write(copy, images, codec=codec, depth=depth, **quality)
    again = next(VideoReader(copy, depth=16).frames()).image[16, :, 1].astype(int)
    assert len(np.unique(again)) >= 0.98 * LEVELS
    assert np.abs(again - ramp()[16, :, 1]).max() <= 4 * 65535 / LEVELS  # the codec's loss
    assert again[0] < 2 * 65535 / LEVELS
    assert again[-1] > 65535 - 2 * 65535 / LEVELS


@pytest.mark.parametrize("form", ["yuv420p", "yuv422p", "yuv444p", "gbrp"])
@pytest.mark.parametrize("depth", [10, 12])
def test_conversion_to_a_format_and_back_is_exact_to_a_level(form: str, depth: int) -> None:
    """Saturated colours as well, which swscale would wrap around."""
    chart = clips.color_chart(192, 144)
    frame = color.FromRGB(f"{form}{depth}le")(chart.astype(np.uint16) * 257)
    if form != "gbrp":
        frame.colorspace, frame.color_range = 1, 1  # as a decoder gives it
    assert color.depth_of(frame) == depth
    error = clips.patch_colors(color.ToRGB("rgb48")(frame)) - clips.patch_colors(chart) * 257
    assert np.abs(error).max() <= 2 * 65535 / (219 << (depth - 8))


def test_eight_bits_are_read_as_before_and_in_sixteen_as_the_same(tmp_path: Path) -> None:
    clip = clips.make_clip(tmp_path / "a.mp4", [clips.color_chart(192, 144)])
    with VideoReader(clip) as narrow, VideoReader(clip, depth=16) as wide:
        eight, sixteen = next(narrow.frames()).image, next(wide.frames()).image
        assert (narrow.info.depth, wide.info.depth) == (8, 8)
    assert (eight.dtype, sixteen.dtype) == (np.uint8, np.uint16)
    assert np.array_equal(sixteen, eight.astype(np.uint16) * 257)
    assert sixteen.flags.writeable


def test_sixteen_bits_are_turned_upright_and_read_backwards(tmp_path: Path) -> None:
    chart = clips.color_chart(192, 144)
    clip = clips.make_clip(tmp_path / "r.mov", [chart] * 3, codec="prores_ks", pix_fmt="yuv422p10le", rotation=90)
    with VideoReader(clip, depth=16) as reader:
        forward, backward = [f.image for f in reader.frames()], [f.image for f in reader.backward(3)]
    assert forward[0].shape == (192, 144, 3)
    assert np.abs(clips.patch_colors(np.rot90(forward[0], -1) / 257) - clips.patch_colors(chart)).max() <= 3
    assert all(np.array_equal(a, b) for a, b in zip(forward, backward[::-1], strict=True))


@pytest.mark.parametrize("depth", [8, 10])
def test_frames_of_both_kinds_give_the_same_colours(tmp_path: Path, depth: int) -> None:
    chart = clips.color_chart(192, 144)
    narrow = write(tmp_path / "8.mp4", [chart], depth=depth, crf=1)
    wide = write(tmp_path / "16.mp4", [chart.astype(np.uint16) * 257], depth=depth, crf=1)
    a, b = (clips.patch_colors(next(VideoReader(path, depth=16).frames()).image / 257) for path in (narrow, wide))
    assert np.abs(a - b).max() <= 1.5  # grey levels of 8 bits


@pytest.mark.parametrize("pix_fmt", ["yuv444p10le", "yuv420p10le"])
@pytest.mark.parametrize("full", [False, True])
def test_ten_bit_colours_by_range(tmp_path: Path, pix_fmt: str, full: bool) -> None:
    chart = clips.color_chart(192, 144)
    clip = clips.make_clip(tmp_path / "c.mp4", [chart], pix_fmt=pix_fmt, full_range=full, options={"crf": "4"})
    with VideoReader(clip, depth=16) as reader:
        assert reader.info.colour.full_range == full
        error = clips.patch_colors(next(reader.frames()).image / 257) - clips.patch_colors(chart)
    assert np.abs(error).max() <= 3
    assert np.abs(error.mean((0, 1))).max() < 0.7


@pytest.mark.parametrize(
    ("name", "codec", "depth", "size", "said"),
    [
        ("a.mp4", "libx264", 12, (96, 64), "use h265"),
        ("a.webm", "vp9", 10, (96, 64), "use av1"),
        ("a.mp4", "mpeg4", 10, (96, 64), "use h264, h265 or av1"),
        ("a.mkv", "libsvtav1", 10, (97, 63), "use h264, h265, prores4444 or ffv1"),
        ("a.mov", "libx264", 14, (96, 64), "fewer bits"),
    ],
)
def test_what_a_codec_cannot_hold_is_refused_with_those_that_can(
    tmp_path: Path, name: str, codec: str | None, depth: int, size: tuple[int, int], said: str
) -> None:
    with pytest.raises(InputError, match=said) as caught:
        VideoWriter(tmp_path / name, *size, Fraction(25), codec=codec, depth=depth)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_odd_sizes_of_ten_bits(tmp_path: Path) -> None:
    path = write(tmp_path / "odd.mp4", [clips.color_chart(97, 63)], depth=10, crf=4)
    with VideoReader(path, depth=16) as reader:
        assert (reader.info.width, reader.info.height, reader.info.depth) == (97, 63, 10)


def test_frames_of_other_kinds_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="8 or 16 bits"):
        write(tmp_path / "a.mp4", [np.zeros((64, 96, 3), np.float32)])


@pytest.mark.parametrize(("name", "codec"), [("o.mp4", None), ("o.mkv", "ffv1"), ("o.mp4", "h264")])
def test_a_ramp_of_all_levels_of_10_bits_by_default(tmp_path: Path, name: str, codec: str | None) -> None:
    """In full range, with 1024 levels, beside an ad; H.264 at its usual quality would join some of them."""
    row = np.arange(2048) // 2
    frame = av.VideoFrame(2048, 96, "yuv420p10le")
    samples(frame, 0)[:] = row
    for index in (1, 2):
        samples(frame, index)[:] = 512
    with av.open(str(tmp_path / "in.mkv"), "w") as container:
        stream = cast(VideoStream, container.add_stream("ffv1", rate=25))
        stream.width, stream.height, stream.pix_fmt = 2048, 96, "yuv420p10le"
        stream.codec_context.color_range = 2
        for number in range(2):
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    quad = np.array([[100.0, 60], [160, 60], [160, 90], [100, 90]])
    with Session(tmp_path / "in.mkv", make_tracker=Still) as session:
        [surface] = session.track([Surface(quad=quad, effect="mosaic")])
        session.render(
            [surface], tmp_path / name, OutputOptions(backend="opencv", codec=codec, crf=6 if codec == "h264" else None)
        )
    with av.open(str(tmp_path / name)) as container:
        after = next(container.decode(video=0))
    assert (after.format.name, after.color_range) == ("yuv420p10le", 2)
    luma = samples(after, 0)[20]
    assert len(np.unique(luma)) > 900
    assert np.abs(luma.astype(int) - row).max() <= (0 if codec == "ffv1" else 4)
