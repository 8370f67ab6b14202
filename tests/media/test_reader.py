"""Reading: frame by frame, ranges, and backwards; what files may have wrong with them is in tests/hazards."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo.media.decode import decode
from ar_demo.media.reader import VideoReader

from .. import clips
from ..videos import numbers


def test_a_clip_is_read_frame_by_frame(tmp_path: Path) -> None:
    clip = clips.make_clip(tmp_path / "a.mp4", clips.numbered(30), rate=Fraction(30000, 1001), sound=clips.tone(1))
    with VideoReader(clip) as reader:
        info = reader.info
        frames = list(reader.frames())
        assert (info.width, info.height, info.frames, info.rotation) == (96, 64, 30, 0)
        assert info.rate == Fraction(30000, 1001)
        assert info.has_audio
        assert numbers(frames) == list(range(30))
        assert [frame.index for frame in frames] == list(range(30))
        assert [frame.time for frame in frames] == [index * Fraction(1001, 30000) for index in range(30)]
        assert frames[0].image.dtype == np.uint8
        assert frames[0].image.flags.c_contiguous
        assert frames[0].image.flags.writeable
        assert reader.warnings == []


def test_a_range_and_a_second_reading(tmp_path: Path) -> None:
    reader = VideoReader(clips.make_clip(tmp_path / "a.mp4", clips.numbered(20)))
    assert numbers(list(reader.frames(5, 9))) == [5, 6, 7, 8]
    assert numbers(list(reader.frames())) == list(range(20))
    assert list(reader.frames(20)) == []


def test_some_frames_of_a_range(tmp_path: Path) -> None:
    reader = VideoReader(clips.make_clip(tmp_path / "a.mp4", clips.numbered(20)))
    some = list(reader.frames(2, 12, {1, 2, 7, 11, 12}))
    assert numbers(some) == [frame.index for frame in some] == [2, 7, 11]
    assert [frame.duration for frame in some] == [frame.duration for frame in reader.frames(2, 12)][:3]
    assert numbers(list(reader.frames(only=range(1, 20, 6)))) == [1, 7, 13, 19]


def test_rough_frames_are_the_same_but_for_some_grey_levels(tmp_path: Path) -> None:
    chart = clips.color_chart(96, 64)
    reader = VideoReader(clips.make_clip(tmp_path / "a.mp4", [np.roll(chart, shift, 1) for shift in range(8)]))
    exact, rough = list(reader.frames(2, 7)), list(reader.frames(2, 7, rough=True))
    back = list(reader.backward(7, 2, rough=True))[::-1]
    assert [frame.index for frame in rough] == [frame.index for frame in exact]
    for a, b, c in zip(exact, rough, back, strict=True):
        assert 0 < np.abs(a.image.astype(int) - b.image).mean() < 4
        assert np.array_equal(b.image, c.image)


def test_backward_seeks_instead_of_decoding_everything_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip = clips.make_clip(tmp_path / "b.mp4", clips.numbered(60), gop=10)
    monkeypatch.setattr("ar_demo.media.reader.BACKWARD_BYTES", 10 * 96 * 64 * 3 // 2)
    reader = VideoReader(clip)
    list(reader.frames())
    decoded = 0
    original = decode

    def counting(*args: object, **kwargs: object) -> object:
        nonlocal decoded
        for frame in original(*args, **kwargs):  # type: ignore[arg-type]
            decoded += 1
            yield frame

    monkeypatch.setattr("ar_demo.media.reader.decode", counting)
    assert numbers(list(reader.backward(60))) == list(range(60))[::-1]
    assert decoded <= 80
