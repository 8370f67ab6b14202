"""Colour matrices and ranges, tagged, untagged and old: what comes out is the colour that was meant."""

import subprocess
from pathlib import Path

import av
import numpy as np
import pytest

from ar_demo.media.reader import VideoReader

from .. import clips
from ..videos import write


@pytest.mark.parametrize(
    ("size", "matrix", "tagged", "full"),
    [
        ((192, 144), clips.BT601, True, False),
        ((192, 144), clips.BT709, True, False),
        ((192, 144), clips.BT601, False, False),  # untagged and small: taken for BT.601
        ((1280, 720), clips.BT709, False, False),  # untagged and large: taken for BT.709
        ((1280, 720), clips.BT601, True, False),
        ((192, 144), clips.BT601, True, True),
        ((192, 144), clips.BT709, True, True),
        ((192, 144), clips.BT2020, True, False),
    ],
)
def test_colours_by_matrix_and_range(
    tmp_path: Path, size: tuple[int, int], matrix: int, tagged: bool, full: bool
) -> None:
    if matrix == clips.BT2020 and av.__version__.startswith("17."):
        pytest.skip("PyAV 17 cannot make such a clip")
    chart = clips.color_chart(*size)
    clip = clips.make_clip(
        tmp_path / "c.mp4", [chart], matrix=matrix, tagged=tagged, full_range=full, options={"crf": "4"}
    )
    reader = VideoReader(clip)
    error = clips.patch_colors(next(reader.frames()).image) - clips.patch_colors(chart)
    assert np.abs(error).max() <= 3
    assert np.abs(error.mean((0, 1))).max() < 0.7  # no tint, no darkening
    assert reader.info.colour.full_range == full


def test_old_full_range_format(tmp_path: Path) -> None:
    chart = clips.color_chart(192, 144)
    clip = clips.make_clip(
        tmp_path / "j.avi",
        [chart],
        codec="mjpeg",
        pix_fmt="yuvj420p",
        matrix=clips.BT601,
        tagged=True,
        full_range=True,
        options={"qmin": "1", "q": "1"},
    )
    error = clips.patch_colors(next(VideoReader(clip).frames()).image) - clips.patch_colors(chart)
    assert np.abs(error).max() <= 6


@pytest.mark.parametrize(("size", "suffix"), [((1280, 720), "mp4"), ((192, 144), "mp4"), ((192, 144), "webm")])
def test_colour_comes_back_and_is_tagged(tmp_path: Path, size: tuple[int, int], suffix: str) -> None:
    chart = clips.color_chart(*size)
    path = write(tmp_path / f"c.{suffix}", [chart] * 2, crf=4)
    reader = VideoReader(path)
    error = clips.patch_colors(next(reader.frames()).image) - clips.patch_colors(chart)
    assert np.abs(error).max() <= 3
    assert np.abs(error.mean((0, 1))).max() < 0.7
    assert (reader.info.colour.matrix, reader.info.colour.full_range) == ("bt709", False)
    with av.open(str(path)) as container:
        frame = next(container.decode(video=0))
    assert (frame.colorspace, frame.color_primaries, frame.color_trc, frame.color_range) == (1, 1, 1, 1)


def test_another_decoder_sees_the_same_colours(tmp_path: Path) -> None:
    """The ffmpeg program, which goes by the tags."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    chart = clips.color_chart(192, 144)
    path = write(tmp_path / "c.mp4", [chart], crf=4)
    flags = ["-sws_flags", "accurate_rnd+full_chroma_int", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run([ffmpeg, "-v", "error", "-i", path, *flags], capture_output=True, check=True).stdout
    image = np.frombuffer(raw, np.uint8).reshape(144, 192, 3)
    assert np.abs(clips.patch_colors(image) - clips.patch_colors(chart)).max() <= 3
