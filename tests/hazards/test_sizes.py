"""Odd sizes, which 4:2:0 cannot hold, and sizes that change on the way."""

from pathlib import Path

import numpy as np
import pytest

from ar_demo.media.reader import VideoReader

from .. import clips
from ..videos import write


def test_odd_size(tmp_path: Path) -> None:
    clip = clips.make_clip(tmp_path / "odd.mp4", [clips.color_chart(97, 63)] * 2, pix_fmt="yuv444p")
    assert next(VideoReader(clip).frames()).image.shape == (63, 97, 3)


@pytest.mark.parametrize("size", [(97, 63), (96, 63), (97, 64)])
def test_odd_sizes_are_kept(tmp_path: Path, size: tuple[int, int], caplog: pytest.LogCaptureFixture) -> None:
    chart = clips.color_chart(*size)
    path = write(tmp_path / "odd.mp4", [chart] * 3, crf=4)
    image = next(VideoReader(path).frames()).image
    assert image.shape == chart.shape
    assert np.abs(clips.patch_colors(image) - clips.patch_colors(chart)).max() <= 3
    assert "4:4:4" in caplog.text


def test_a_change_of_size_on_the_way(tmp_path: Path) -> None:
    first = clips.make_clip(tmp_path / "1.ts", clips.numbered(10))
    second = clips.make_clip(tmp_path / "2.ts", clips.numbered(10, 160, 96))
    both = tmp_path / "both.ts"
    both.write_bytes(first.read_bytes() + second.read_bytes())
    reader = VideoReader(both)
    assert {frame.image.shape for frame in reader.frames()} == {(64, 96, 3)}
    assert any("size" in warning for warning in reader.warnings)
