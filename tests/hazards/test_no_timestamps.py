"""Files without timestamps: raw streams."""

import itertools
from pathlib import Path

import pytest

from ar_demo.media.reader import VideoReader

from .. import clips
from ..videos import numbers


def test_times_strictly_increase_where_the_file_has_none(tmp_path: Path) -> None:
    """Raw H.264 has no timestamps."""
    clip = clips.make_clip(tmp_path / "raw.h264", clips.numbered(12), rate=25)
    times = [frame.time for frame in VideoReader(clip).frames()]
    assert len(times) == 12
    assert all(b > a for a, b in itertools.pairwise(times))
    assert times[-1] - times[0] == 11 / VideoReader(clip).info.rate


def test_backward_without_timestamps_to_seek_by(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip = clips.make_clip(tmp_path / "raw.h264", clips.numbered(30), gop=6)
    monkeypatch.setattr("ar_demo.media.reader.BACKWARD_BYTES", 8 * 96 * 64 * 3 // 2)
    assert numbers(list(VideoReader(clip).backward(30))) == list(range(30))[::-1]
