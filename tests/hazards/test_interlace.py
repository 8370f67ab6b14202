"""Interlaced video: two moments in each frame, of which one is shown."""

import os
from fractions import Fraction
from pathlib import Path
from threading import Event
from typing import cast

import av
import numpy as np
import pytest
from av.codec.context import Flags
from av.video.stream import VideoStream

from ar_demo import OutputOptions, Session, Surface
from ar_demo.media.live_stream import Stream
from ar_demo.media.reader import VideoReader

from ..clips import make_clip, numbered
from ..conftest import Run
from ..test_session import Still

SIZE = 192, 128
STEP = 8  # px that a bar moves from field to field
FRAMES = 40


def interlaced(path: Path, codec: str = "libx264", pix_fmt: str = "yuv420p", count: int = FRAMES) -> Path:
    """A bright bar that moves to the right, the lower field first, which is what PyAV has encoders write."""
    options = {"crf": "8", "preset": "ultrafast"} if codec == "libx264" else {"q": "2"}
    with av.open(str(path), "w") as container:
        stream = cast(VideoStream, container.add_stream(codec, rate=25, options=options))
        stream.width, stream.height, stream.pix_fmt = *SIZE, pix_fmt
        stream.codec_context.gop_size = 8
        stream.codec_context.flags |= Flags.interlaced_dct
        for index in range(count):
            image = np.full((SIZE[1], SIZE[0], 3), 40, np.uint8)
            for field in (0, 1):
                left = (STEP * (2 * index + 1 - field)) % (SIZE[0] - 40)
                image[field::2, left : left + 40] = 220
            frame = av.VideoFrame.from_ndarray(image, "rgb24").reformat(format=pix_fmt)
            frame.pts = index
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def left_edges(image: np.ndarray) -> tuple[float, float]:
    """Where the bar begins in the rows of either field."""
    return tuple(float(np.argmax(image[field + 40 : 80 : 2, :, 1].mean(0) > 130)) for field in (0, 1))  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("name", "codec", "pix_fmt"),
    [("a.mp4", "libx264", "yuv420p"), ("a.mkv", "libx264", "yuv420p10le"), ("a.mpg", "mpeg2video", "yuv422p")],
)
def test_each_frame_is_of_one_moment(tmp_path: Path, name: str, codec: str, pix_fmt: str) -> None:
    path = interlaced(tmp_path / name, codec, pix_fmt, 10)
    with av.open(str(path)) as container:
        raw = next(container.decode(video=0)).to_ndarray(format="rgb24")
    upper, lower = left_edges(raw)
    assert upper == lower + STEP
    with VideoReader(path) as reader:
        frames = list(reader.frames())
    assert len(frames) == 10
    for index, frame in enumerate(frames[1:-1], 1):
        assert left_edges(frame.image) == pytest.approx((2 * STEP * index, 2 * STEP * index), abs=1.1)
        assert frame.planes is not None
        assert frame.planes.pix_fmt == pix_fmt
    [warning] = reader.warnings
    assert "deinterlaced" in warning


def test_any_order_gives_the_same_frames_at_the_same_times(tmp_path: Path) -> None:
    with VideoReader(interlaced(tmp_path / "a.mp4")) as reader:
        whole = list(reader.frames())
        assert [frame.time for frame in whole] == [Fraction(index, 25) for index in range(FRAMES)]
        for part in (list(reader.frames(21, 25)), list(reader.backward(25, 21))[::-1]):
            assert [frame.index for frame in part] == [21, 22, 23, 24]
            assert all(np.array_equal(a.image, b.image) for a, b in zip(part, whole[21:25], strict=True))


def test_what_is_not_interlaced_is_left_alone(tmp_path: Path) -> None:
    with VideoReader(make_clip(tmp_path / "a.mp4", numbered(3))) as reader:
        assert len(list(reader.frames())) == 3
        assert reader.warnings == []


def test_the_output_is_progressive(tmp_path: Path) -> None:
    quad = np.array([[20.0, 90], [80, 90], [80, 120], [20, 120]])
    with Session(interlaced(tmp_path / "a.mp4", count=4), make_tracker=Still) as session:
        [surface] = session.track([Surface(quad=quad, effect="blur")])
        result = session.render([surface], tmp_path / "o.mp4", OutputOptions(backend="opencv"))
    assert len(result.warnings) == 1
    with av.open(str(tmp_path / "o.mp4")) as container:
        frames = list(container.decode(video=0))
    assert len(frames) == 4
    assert not any(frame.interlaced_frame for frame in frames)


def test_strict_refuses_it_before_any_work(tmp_path: Path, run: Run) -> None:
    clip = interlaced(tmp_path / "a.mp4", count=3)
    quad = ["20,90", "80,90", "80,120", "20,120"]
    status, _, errors = run(clip, "--quad", *quad, "--effect", "blur", "-o", tmp_path / "o.mp4", "--strict")
    assert status == 2
    assert errors.count("is interlaced") == len(errors.splitlines()) == 1
    assert os.listdir(tmp_path) == ["a.mp4"]


def test_live(tmp_path: Path) -> None:
    with Stream(str(interlaced(tmp_path / "a.mp4", count=6))) as stream:
        frames = list(stream.frames(Event()))
    assert frames
    upper, lower = left_edges(frames[-1].image)
    assert abs(upper - lower) <= 1
