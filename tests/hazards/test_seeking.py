"""Late frames in files of all kinds: reached by seeking where that is exact, and numbered as decoding numbers them."""

import itertools
import subprocess
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo.media import decode
from ar_demo.media.reader import Frame, IndexDropped, VideoReader
from hdn.imaging.arrays import Image

from .. import clips

COUNT, GOP = 90, 12
OPEN_GOPS = {"preset": "medium", "x264-params": "open-gop=1:bframes=3:scenecut=0"}
B_FRAMES = {"preset": "medium", "bf": "3"}
UNEVEN = list(itertools.accumulate([Fraction(17 + 29 * (n % 5), 1000) for n in range(COUNT - 1)], initial=Fraction(0)))


def images(count: int = COUNT) -> list[Image]:
    """Pictures that no two frames share."""
    rng = np.random.default_rng(0)
    return [np.kron(rng.integers(0, 256, (8, 12, 3)), np.ones((8, 8, 1))).astype(np.uint8) for _ in range(count)]


def plain(folder: Path) -> Path:
    return clips.make_clip(folder / "a.mp4", images(), gop=GOP)


def damaged(folder: Path, at: int = 40) -> Path:
    """A clip of which two packets in the middle are overwritten."""
    path = clips.make_clip(folder / "d.mp4", images(), gop=GOP)
    data = bytearray(path.read_bytes())
    with decode.open_video(path)[0] as container:
        packets = [(packet.pos, packet.size) for packet in container.demux(video=0) if packet.size]
    for position, size in packets[at : at + 2]:
        assert position is not None
        data[position : position + size] = bytes(size)
    path.write_bytes(data)
    return path


def edited(folder: Path) -> Path:
    """A clip cut without encoding, whose edit list hides what comes before the cut."""
    whole = clips.make_clip(folder / "whole.mp4", images(), gop=GOP, options=B_FRAMES)
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    path = folder / "e.mp4"
    subprocess.run([ffmpeg, "-v", "error", "-ss", "0.7", "-i", whole, "-c", "copy", path], check=True)
    return path


def cut_stream(folder: Path) -> Path:
    """A transport stream that begins in the middle of a group of pictures."""
    path = clips.make_clip(folder / "c.ts", images(), gop=GOP, options=B_FRAMES)
    path.write_bytes(path.read_bytes()[188 * 40 :])
    return path


def truncated(folder: Path) -> Path:
    return clips.truncated(clips.make_clip(folder / "t.mkv", images(), gop=GOP), 0.7)


GOOD: dict[str, Callable[[Path], Path]] = {
    "plain": plain,
    "b-frames": lambda folder: clips.make_clip(folder / "b.mp4", images(), gop=GOP, options=B_FRAMES),
    "open groups, mp4": lambda folder: clips.make_clip(folder / "o.mp4", images(), gop=GOP, options=OPEN_GOPS),
    "open groups, mkv": lambda folder: clips.make_clip(folder / "o.mkv", images(), gop=GOP, options=OPEN_GOPS),
    "transport stream": lambda folder: clips.make_clip(folder / "s.ts", images(), gop=GOP, options=B_FRAMES),
    "uneven times": lambda folder: clips.make_clip(
        folder / "v.mp4", images(), gop=GOP, times=UNEVEN, time_base=Fraction(1, 90000), options=B_FRAMES
    ),
    "avi": lambda folder: clips.make_clip(folder / "a.avi", images(), codec="mpeg4", gop=GOP, options={"bf": "2"}),
    "vp8 with hidden frames": lambda folder: clips.make_clip(
        folder / "8.webm", images(), codec="libvpx", gop=30, options={"auto-alt-ref": "1", "lag-in-frames": "16"}
    ),
    "vp9 with hidden frames": lambda folder: clips.make_clip(
        folder / "9.webm", images(), codec="libvpx-vp9", gop=30, options={"auto-alt-ref": "1", "lag-in-frames": "16"}
    ),
    "edit list": edited,
}
BAD: dict[str, Callable[[Path], Path]] = {
    "no timestamps": lambda folder: clips.make_clip(folder / "r.h264", images(), gop=GOP),
    "cut stream": cut_stream,
    "truncated": truncated,
    "damaged at its end": lambda folder: damaged(folder, COUNT - 4),
}


class Decoded:
    """How many frames were decoded."""

    count = 0


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> Decoded:
    counted, original = Decoded(), decode.decode

    def counting(*args: object, **kwargs: object) -> Iterator[object]:
        for frame in original(*args, **kwargs):  # type: ignore[arg-type]
            counted.count += 1
            yield frame

    monkeypatch.setattr("ar_demo.media.reader.decode", counting)
    return counted


def assert_same(found: list[Frame], expected: list[Frame]) -> None:
    for a, b in zip(found, expected, strict=True):
        assert (a.index, a.time, a.duration) == (b.index, b.time, b.duration)
        assert np.array_equal(a.image, b.image)


@pytest.mark.parametrize("kind", [*GOOD, *BAD])
@pytest.mark.parametrize("start", [17, 35, 36, 50])
def test_frames_from_any_on_are_those_of_decoding_from_the_start(tmp_path: Path, kind: str, start: int) -> None:
    clip = (GOOD | BAD)[kind](tmp_path)
    expected = list(VideoReader(clip).frames())
    assert_same(list(VideoReader(clip).frames(start, start + 1)), expected[start : start + 1])
    assert_same(list(VideoReader(clip).frames(start)), expected[start:])
    assert_same(list(VideoReader(clip).backward(start + 4, start))[::-1], expected[start : start + 4])


@pytest.mark.parametrize("kind", GOOD)
def test_good_files_are_indexed(tmp_path: Path, kind: str) -> None:
    reader = VideoReader(GOOD[kind](tmp_path))
    assert reader.seekable
    times = reader.times[:]
    frames = list(reader.frames())
    assert times == reader.times == [frame.time for frame in frames]
    assert reader.seekable
    assert not reader.warnings


@pytest.mark.parametrize("kind", ["no timestamps", "cut stream"])
def test_files_whose_packets_do_not_tell_their_frames_are_decoded(tmp_path: Path, kind: str) -> None:
    reader = VideoReader(BAD[kind](tmp_path))
    assert not reader.seekable
    assert len(reader.times) < 20
    frames = list(reader.frames())
    assert reader.times == [frame.time for frame in frames]
    assert reader.seekable  # by what decoding told


@pytest.mark.parametrize("kind", ["plain", "b-frames", "open groups, mp4", "transport stream", "uneven times"])
def test_a_late_frame_is_reached_without_decoding_the_rest(tmp_path: Path, kind: str, decoded: Decoded) -> None:
    reader = VideoReader(GOOD[kind](tmp_path))
    list(reader.frames(80, 82))
    assert decoded.count <= 1 + 16 + 2 * GOP  # the first, those that are compared, and at most two groups
    before = decoded.count
    list(reader.frames(60, 62))
    list(reader.backward(62, 60))
    assert decoded.count - before <= 2 * 2 * GOP


@pytest.mark.parametrize("kind", ["plain", "b-frames", "open groups, mkv", "uneven times"])
def test_decoding_begins_with_the_key_frame_before(tmp_path: Path, kind: str, decoded: Decoded) -> None:
    reader = VideoReader(GOOD[kind](tmp_path))
    list(reader.frames(80, 82))
    for start in (46, 61, 75):
        before = decoded.count
        list(reader.frames(start, start + 1))
        assert decoded.count - before <= start + 2 - reader.key_before(start)


@pytest.mark.parametrize("kind", GOOD)
def test_what_was_decoded_once_is_reached_by_seeking_as_well(tmp_path: Path, kind: str, decoded: Decoded) -> None:
    reader = VideoReader(GOOD[kind](tmp_path))
    count = len(list(reader.frames()))
    before = decoded.count
    list(reader.backward(count, count - 4))
    assert decoded.count - before <= 2 * 30


def test_an_early_frame_needs_no_index(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr("ar_demo.media.reader.demux")
    assert [frame.index for frame in VideoReader(plain(tmp_path)).frames(5, 7)] == [5, 6]


def test_a_frame_beyond_the_end_is_none(tmp_path: Path, decoded: Decoded) -> None:
    reader = VideoReader(plain(tmp_path))
    assert list(reader.frames(COUNT)) == list(reader.frames(COUNT + 100, COUNT + 101)) == []
    assert decoded.count <= 1 + 16
    assert [frame.index for frame in reader.frames(COUNT - 1, COUNT + 50)] == [COUNT - 1]


def test_damage_before_frames_that_were_given_out_is_told(tmp_path: Path) -> None:
    reader = VideoReader(damaged(tmp_path, 40))
    expected = list(VideoReader(reader.path).frames())
    late = next(reader.frames(60)).index
    assert late == 60
    with pytest.raises(IndexDropped, match="start over"):
        list(reader.frames())
    assert not reader.seekable
    assert_same(list(reader.frames()), expected)  # and is right from then on
    assert_same(list(reader.frames(60)), expected[60:])
    assert_same(list(reader.backward(len(expected)))[::-1], expected)
    assert any("damaged" in warning for warning in reader.warnings)


def test_damage_is_told_backwards_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ar_demo.media.reader.BACKWARD_BYTES", 8 * 96 * 64 * 3 // 2)
    reader = VideoReader(damaged(tmp_path, 40))
    with pytest.raises(IndexDropped):
        list(reader.backward(70))


def test_damage_behind_frames_that_were_given_out_does_no_harm(tmp_path: Path) -> None:
    reader = VideoReader(damaged(tmp_path, 60))
    expected = list(VideoReader(reader.path).frames())
    assert_same(list(reader.frames(30)), expected[30:])
    assert_same(list(reader.frames(20)), expected[20:])
    assert any("damaged" in warning for warning in reader.warnings)


def test_forward_and_backward_share_the_index(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from ar_demo.media import reader as module

    calls = 0
    original = module.demux

    def counting(path: Path) -> object:
        nonlocal calls
        calls += 1
        return original(path)

    monkeypatch.setattr(module, "demux", counting)
    reader = VideoReader(plain(tmp_path))
    list(reader.frames(70, 72))
    list(reader.backward(60, 50))
    assert reader.seekable
    assert calls == 1


def test_seeking_that_lands_elsewhere_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A container whose seeks end somewhere else: frames are decoded from the start, and are right."""
    caplog.set_level("INFO", "ar_demo")
    clip = plain(tmp_path)
    expected = list(VideoReader(clip).frames())
    original = VideoReader._open

    class Astray:
        def __init__(self, container: object) -> None:
            self._container = container

        def __getattr__(self, name: str) -> object:
            return getattr(self._container, name)

        def seek(self, offset: int, **options: object) -> None:
            self._container.seek(offset + 24000, **options)  # type: ignore[attr-defined]

    def open_astray(reader: VideoReader) -> object:
        container, stream = original(reader)
        return Astray(container), stream

    monkeypatch.setattr(VideoReader, "_open", open_astray)
    monkeypatch.setattr(VideoReader, "_shut", lambda reader, container: container.close())
    reader = VideoReader(clip)
    assert_same(list(reader.frames(40, 45)), expected[40:45])
    assert "inexact" in caplog.text
    assert reader.seekable
