"""Files that break off or have holes: what can be decoded is used, and nothing is counted wrongly."""

import itertools
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo.errors import InputError
from ar_demo.media.ad import open_ad
from ar_demo.media.damage import in_stretches
from ar_demo.media.reader import VideoReader
from ar_demo.media.streams import Streams
from hdn.imaging.arrays import Image, Picture

from .. import clips
from ..conftest import Run
from ..videos import clip, rewrite


@pytest.mark.parametrize(
    ("suffix", "codec"), [("mkv", "libx264"), ("ts", "libx264"), ("avi", "mpeg4"), ("webm", "libvpx-vp9")]
)
def test_a_truncated_file_is_read_as_far_as_it_goes(tmp_path: Path, suffix: str, codec: str) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (64, 96, 3), dtype=np.uint8) for _ in range(75)]
    clip = clips.truncated(clips.make_clip(tmp_path / f"t.{suffix}", images, codec=codec), 0.5)
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
    clip = clips.make_clip(tmp_path / "d.mp4", images, gop=4)
    data = bytearray(clip.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 20000] = bytes(20000)
    clip.write_bytes(data)
    reader = VideoReader(clip)
    frames = list(reader.frames())
    assert 20 < len(frames) <= 40
    assert any("damaged" in warning for warning in reader.warnings)
    assert all(b.time > a.time for a, b in itertools.pairwise(frames))


def test_a_truncated_ad_shows_what_it_has(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (64, 96, 3), dtype=np.uint8) for _ in range(50)]
    path = clips.truncated(clips.make_clip(tmp_path / "t.mkv", images), 0.5)
    with open_ad(path, "hold") as ad:
        assert ad.at(Fraction(2)) is not None


def test_damaged_sound_does_not_stop_the_picture(tmp_path: Path) -> None:
    source = clip(tmp_path / "in.mkv", 2, sound=clips.tone(2))
    broken = clips.truncated(clip(tmp_path / "ad.mkv", 2, sound=clips.tone(2)), 0.6)
    for mode in ("ad", "mix"):
        output = rewrite(source, tmp_path / f"{mode}.mp4", Streams(mode, source, broken))
        assert len(clips.frame_times(output)) == 50


def test_damaged_sound_is_copied_and_told(tmp_path: Path) -> None:
    source = clip(tmp_path / "in.mp4", 2, sound=clips.tone(2))
    streams = Streams("source", source)
    rewrite(source, tmp_path / "whole.mp4", streams)
    assert streams.warnings == []
    packets = clips.sound_packets(source)
    data = source.read_bytes()
    for _, content in packets[40:44]:
        data = data.replace(content, np.random.default_rng(3).bytes(len(content)))
    source.write_bytes(data)
    streams = Streams("source", source)
    output = rewrite(source, tmp_path / "out.mp4", streams)
    assert streams.warnings == ["the sound of in.mp4 is damaged: it is copied as it is"]
    assert len(clips.sound_packets(output)) == len(packets)


@pytest.mark.usefixtures("shared_networks")
def test_a_damaged_video_is_a_failure_if_that_is_wanted(tmp_path: Path, run: Run) -> None:
    path = with_noise(clips.make_clip(tmp_path / "in.mp4", moving(50)))
    arguments = [path, "--effect", "blur", "--quad", "40,30", "200,30", "200,130", "40,130", "-o", tmp_path / "o.mp4"]
    status, _, err = run(*arguments, "--strict", "--end", "30")
    assert status == 1
    assert "is damaged: frame" in err
    assert (tmp_path / "o.mp4").exists()


def moving(count: int) -> list[Image]:
    """Pictures of a texture that moves on, in which concealed damage is seen."""
    rng = np.random.default_rng(1)
    texture = cv2.GaussianBlur(rng.integers(0, 256, (160, 400, 3), dtype=np.uint8), (0, 0), 2)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)
    return [np.ascontiguousarray(texture[:, 3 * i : 3 * i + 240]) for i in range(count)]


def with_noise(path: Path, share: float = 0.05, at: float = 0.45) -> Path:
    """The file with a stretch of its bytes made random."""
    data = bytearray(path.read_bytes())
    begin, length = int(len(data) * at), int(len(data) * share)
    data[begin : begin + length] = np.random.default_rng(2).bytes(length)
    out = path.with_stem("damaged")
    out.write_bytes(data)
    return out


def is_wrong(picture: Picture, clean: Picture) -> bool:
    """Whether a picture differs visibly from the clean one, in some 16 x 16 px."""
    difference = np.abs(picture.astype(np.float32) - clean).mean(2)
    return bool(cv2.resize(difference, (15, 10), interpolation=cv2.INTER_AREA).max() > 8)


DAMAGED_FILES = [
    *((suffix, "libx264") for suffix in ("mp4", "mov", "mkv", "ts")),
    *((suffix, "mpeg4") for suffix in ("mp4", "mkv", "avi")),
    *((suffix, "prores_ks") for suffix in ("mov", "mkv")),
    ("ts", "mpeg2video"),
]


@pytest.mark.parametrize(("suffix", "codec"), DAMAGED_FILES)
def test_frames_that_show_damage_are_named(tmp_path: Path, suffix: str, codec: str) -> None:
    pix_fmt = "yuv422p10le" if codec == "prores_ks" else "yuv420p"
    path = clips.make_clip(
        tmp_path / f"in.{suffix}", moving(50), codec=codec, pix_fmt=pix_fmt, time_base=Fraction(1, 25)
    )
    clean = {frame.time: frame.image for frame in VideoReader(path).frames()}
    reader = VideoReader(with_noise(path))
    frames = [frame for frame in reader.frames() if frame.time in clean]
    wrong = {frame.index for frame in frames if is_wrong(frame.image, clean[frame.time])}
    told = {frame.index for frame in reader.frames() if frame.damaged}
    assert wrong <= told
    assert wrong or len(frames) < 50
    assert len(told) <= 13  # at most to the next key frame
    assert [warning for warning in reader.warnings if "is damaged: " in warning] == reader.warnings


@pytest.mark.parametrize(
    ("suffix", "codec"), [("mp4", "libx265"), ("mkv", "libx265"), ("mp4", "libvpx-vp9"), ("webm", "libvpx-vp9")]
)
def test_damage_that_decodes_to_something_is_told_by_what_is_missing(tmp_path: Path, suffix: str, codec: str) -> None:
    options = {"x265-params": "log-level=none"} if codec == "libx265" else {"cpu-used": "8"}
    path = clips.make_clip(tmp_path / f"in.{suffix}", moving(60), codec=codec, options=options)
    reader = VideoReader(with_noise(path, 0.2))
    assert len(list(reader.frames())) < 60
    assert len(reader.warnings) == 1
    assert "missing" in reader.warnings[0]


@pytest.mark.parametrize(("suffix", "codec"), [*DAMAGED_FILES, ("webm", "libvpx-vp9")])
def test_whole_files_are_not_said_to_be_damaged(tmp_path: Path, suffix: str, codec: str) -> None:
    pix_fmt = "yuv422p10le" if codec == "prores_ks" else "yuv420p"
    path = tmp_path / f"in.{suffix}"
    reader = VideoReader(clips.make_clip(path, moving(30), codec=codec, pix_fmt=pix_fmt, time_base=Fraction(1, 25)))
    assert not [frame.index for frame in reader.frames() if frame.damaged]
    assert reader.warnings == []


def test_dropped_frames_are_no_damage(tmp_path: Path) -> None:
    times = [Fraction(i, 25) for i in range(60) if i not in (30, 31) and not 40 <= i < 46]
    path = clips.make_clip(tmp_path / "in.mp4", clips.numbered(len(times)), times=times)
    reader = VideoReader(path)
    assert not [frame.index for frame in reader.frames() if frame.damaged]
    assert reader.warnings == []


def test_damaged_frames_are_known_backward_and_after_a_seek(tmp_path: Path) -> None:
    path = with_noise(clips.make_clip(tmp_path / "in.mov", moving(50), codec="prores_ks", pix_fmt="yuv422p10le"))
    known = {frame.index for frame in VideoReader(path).frames() if frame.damaged}
    assert known
    assert {frame.index for frame in VideoReader(path).backward(60) if frame.damaged} == known
    assert {frame.index for frame in VideoReader(path).frames(18) if frame.damaged} == known


def test_a_file_without_a_frame_is_refused(tmp_path: Path) -> None:
    path = clips.make_clip(tmp_path / "in.ts", clips.numbered(3))
    data = path.read_bytes()
    path.write_bytes(data[: 188 * 3] + bytes(len(data)))
    with pytest.raises(InputError):
        VideoReader(path)


def test_numbers_in_words() -> None:
    assert in_stretches([3]) == "3"
    assert in_stretches([3, 4, 5, 9]) == "3 to 5 and 9"
    assert in_stretches(range(0, 60, 2)) == "0, 2, 4, 6, 8, 10, 12 and others"
