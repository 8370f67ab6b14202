"""Reading: exact times, upright pictures, right colours, and files in every state of disrepair."""

import itertools
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from ar_demo.media import reader as video
from ar_demo.media.decode import decode
from ar_demo.media.reader import VideoReader
from hdn.errors import InputError

from .. import clips as media

VARIABLE = [Fraction(n, 1000) for n in (0, 20, 53, 153, 203, 236, 256, 300, 420, 440, 473, 500)]


def numbers(frames: list[video.Frame]) -> list[int]:
    return [media.number_of(frame.image) for frame in frames]


def test_a_clip_is_read_frame_by_frame(tmp_path: Path) -> None:
    clip = media.make_clip(tmp_path / "a.mp4", media.numbered(30), rate=Fraction(30000, 1001), sound=media.tone(1))
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
    reader = VideoReader(media.make_clip(tmp_path / "a.mp4", media.numbered(20)))
    assert numbers(list(reader.frames(5, 9))) == [5, 6, 7, 8]
    assert numbers(list(reader.frames())) == list(range(20))
    assert list(reader.frames(20)) == []


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
def test_variable_rate_times_are_exact(tmp_path: Path, suffix: str) -> None:
    clip = media.make_clip(
        tmp_path / f"v.{suffix}", media.numbered(len(VARIABLE)), times=VARIABLE, time_base=Fraction(1, 30000)
    )
    frames = list(VideoReader(clip).frames())
    assert [frame.time for frame in frames] == VARIABLE
    assert [frame.duration for frame in frames[:-1]] == [b - a for a, b in itertools.pairwise(VARIABLE)]


def test_times_strictly_increase_where_the_file_has_none(tmp_path: Path) -> None:
    """Raw H.264 has no timestamps."""
    clip = media.make_clip(tmp_path / "raw.h264", media.numbered(12), rate=25)
    times = [frame.time for frame in VideoReader(clip).frames()]
    assert len(times) == 12
    assert all(b > a for a, b in itertools.pairwise(times))
    assert times[-1] - times[0] == 11 / VideoReader(clip).info.rate


@pytest.mark.parametrize("turn", [90, 180, 270])
def test_rotation_is_applied(tmp_path: Path, turn: int) -> None:
    upright = np.zeros((64, 96, 3), np.uint8)
    upright[:20, :30] = 255  # white at the top left
    stored = np.ascontiguousarray(np.rot90(upright, -turn // 90))
    reader = VideoReader(media.make_clip(tmp_path / "r.mp4", [stored] * 3, rotation=turn))
    frame = next(reader.frames())
    assert (reader.info.width, reader.info.height, reader.info.rotation) == (96, 64, turn)
    assert frame.image.shape == (64, 96, 3)
    assert frame.image.flags.c_contiguous
    assert np.abs(frame.image.astype(int) - upright).mean() < 3


def test_odd_size(tmp_path: Path) -> None:
    clip = media.make_clip(tmp_path / "odd.mp4", [media.color_chart(97, 63)] * 2, pix_fmt="yuv444p")
    assert next(VideoReader(clip).frames()).image.shape == (63, 97, 3)


@pytest.mark.parametrize(
    ("size", "matrix", "tagged", "full"),
    [
        ((192, 144), media.BT601, True, False),
        ((192, 144), media.BT709, True, False),
        ((192, 144), media.BT601, False, False),  # untagged and small: taken for BT.601
        ((1280, 720), media.BT709, False, False),  # untagged and large: taken for BT.709
        ((1280, 720), media.BT601, True, False),
        ((192, 144), media.BT601, True, True),
        ((192, 144), media.BT709, True, True),
        ((192, 144), media.BT2020, True, False),
    ],
)
def test_colours_by_matrix_and_range(
    tmp_path: Path, size: tuple[int, int], matrix: int, tagged: bool, full: bool
) -> None:
    if matrix == media.BT2020 and av.__version__.startswith("17."):
        pytest.skip("PyAV 17 cannot make such a clip")
    chart = media.color_chart(*size)
    clip = media.make_clip(
        tmp_path / "c.mp4", [chart], matrix=matrix, tagged=tagged, full_range=full, options={"crf": "4"}
    )
    reader = VideoReader(clip)
    error = media.patch_colors(next(reader.frames()).image) - media.patch_colors(chart)
    assert np.abs(error).max() <= 3
    assert np.abs(error.mean((0, 1))).max() < 0.7  # no tint, no darkening
    assert reader.info.full_range == full


def test_old_full_range_format(tmp_path: Path) -> None:
    chart = media.color_chart(192, 144)
    clip = media.make_clip(
        tmp_path / "j.avi",
        [chart],
        codec="mjpeg",
        pix_fmt="yuvj420p",
        matrix=media.BT601,
        tagged=True,
        full_range=True,
        options={"qmin": "1", "q": "1"},
    )
    error = media.patch_colors(next(VideoReader(clip).frames()).image) - media.patch_colors(chart)
    assert np.abs(error).max() <= 6


def test_ten_bit(tmp_path: Path) -> None:
    chart = media.color_chart(192, 144)
    clip = media.make_clip(tmp_path / "t.mov", [chart] * 2, codec="prores_ks", pix_fmt="yuv422p10le")
    error = media.patch_colors(next(VideoReader(clip).frames()).image) - media.patch_colors(chart)
    assert np.abs(error).max() <= 3


def test_hdr_is_read_with_a_warning(tmp_path: Path) -> None:
    clip = media.make_clip(tmp_path / "h.mp4", media.numbered(2), matrix=media.BT2020, transfer=16)
    reader = VideoReader(clip)
    assert reader.info.matrix == "bt2020"
    assert any("tone mapping" in warning for warning in reader.warnings)


def test_pixel_aspect(tmp_path: Path) -> None:
    clip = media.make_clip(tmp_path / "a.mp4", media.numbered(2), pixel_aspect=Fraction(4, 3), rotation=90)
    assert VideoReader(clip).info.pixel_aspect == Fraction(3, 4)


@pytest.mark.parametrize(
    ("gop", "chunk", "options"),
    [
        (12, 7, {}),
        (250, 5, {}),
        (12, 9, {"preset": "medium", "x264-params": "open-gop=1:bframes=3:scenecut=0"}),
        (1, 4, {}),
    ],
)
@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_backward_is_forward_reversed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, gop: int, chunk: int, options: dict[str, str], suffix: str
) -> None:
    rng = np.random.default_rng(0)
    images = [np.kron(rng.integers(0, 256, (8, 12, 3)), np.ones((8, 8, 1))).astype(np.uint8) for _ in range(50)]
    clip = media.make_clip(tmp_path / f"b.{suffix}", images, gop=gop, options=options)
    monkeypatch.setattr(video, "BACKWARD_BYTES", chunk * 96 * 64 * 3 // 2)
    forward = list(VideoReader(clip).frames())
    for stop in (50, 31):
        backward = list(VideoReader(clip).backward(stop))
        assert [frame.index for frame in backward] == list(range(stop))[::-1]
        for a, b in zip(backward[::-1], forward[:stop], strict=True):
            assert a.time == b.time
            assert a.duration == b.duration
            assert np.array_equal(a.image, b.image)


def test_backward_seeks_instead_of_decoding_everything_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip = media.make_clip(tmp_path / "b.mp4", media.numbered(60), gop=10)
    monkeypatch.setattr(video, "BACKWARD_BYTES", 10 * 96 * 64 * 3 // 2)
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


def test_backward_without_timestamps_to_seek_by(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip = media.make_clip(tmp_path / "raw.h264", media.numbered(30), gop=6)
    monkeypatch.setattr(video, "BACKWARD_BYTES", 8 * 96 * 64 * 3 // 2)
    assert numbers(list(VideoReader(clip).backward(30))) == list(range(30))[::-1]


@pytest.mark.parametrize(
    ("suffix", "codec"), [("mkv", "libx264"), ("ts", "libx264"), ("avi", "mpeg4"), ("webm", "libvpx-vp9")]
)
def test_a_truncated_file_is_read_as_far_as_it_goes(tmp_path: Path, suffix: str, codec: str) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (64, 96, 3), dtype=np.uint8) for _ in range(75)]
    clip = media.truncated(media.make_clip(tmp_path / f"t.{suffix}", images, codec=codec), 0.5)
    reader = VideoReader(clip)
    count = len(list(reader.frames()))
    assert 20 < count < 60
    if suffix not in ("ts", "avi"):  # whose length FFmpeg guesses from what is there
        assert len(reader.warnings) == 1
        assert "t." + suffix in reader.warnings[0]
    assert len(list(reader.backward(75))) == count


def test_damage_in_the_middle_is_skipped(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (64, 96, 3), dtype=np.uint8) for _ in range(40)]
    clip = media.make_clip(tmp_path / "d.mp4", images, gop=4)
    data = bytearray(clip.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 20000] = bytes(20000)
    clip.write_bytes(data)
    reader = VideoReader(clip)
    frames = list(reader.frames())
    assert 20 < len(frames) <= 40
    assert any("damaged" in warning for warning in reader.warnings)
    assert all(b.time > a.time for a, b in itertools.pairwise(frames))


def test_a_change_of_size_on_the_way(tmp_path: Path) -> None:
    first = media.make_clip(tmp_path / "1.ts", media.numbered(10))
    second = media.make_clip(tmp_path / "2.ts", media.numbered(10, 160, 96))
    both = tmp_path / "both.ts"
    both.write_bytes(first.read_bytes() + second.read_bytes())
    reader = VideoReader(both)
    assert {frame.image.shape for frame in reader.frames()} == {(64, 96, 3)}
    assert any("size" in warning for warning in reader.warnings)


@pytest.mark.parametrize("kind", ["missing", "folder", "empty", "text", "garbage", "sound", "image", "headless"])
def test_what_is_no_video_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "x.mp4"
    if kind == "folder":
        path.mkdir()
    elif kind == "empty":
        path.touch()
    elif kind == "text":
        path = tmp_path / "x.txt"
        path.write_text("This is no video.\n" * 50)
    elif kind == "garbage":
        path.write_bytes(np.random.default_rng(0).bytes(5000))
    elif kind == "sound":
        media.make_sound(path, media.tone(0.5))
    elif kind == "image":
        path = tmp_path / "x.png"
        av.VideoFrame.from_ndarray(media.number_image(1), "rgb24").save(str(path))
    elif kind == "headless":  # the index, which MP4 keeps at its end, is cut off
        media.truncated(media.make_clip(path, media.numbered(10)), 0.5)
    with pytest.raises(InputError) as caught:
        VideoReader(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
