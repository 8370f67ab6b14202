"""Writing: containers, codecs, exact times, and never half a file."""

import os
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from ar_demo.media.reader import VideoReader
from ar_demo.media.writer import VideoWriter
from hdn.errors import InputError, RunError

from .. import clips
from ..videos import write


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "webm", "m4v"])
def test_containers(tmp_path: Path, suffix: str) -> None:
    images = clips.numbered(30)
    reader = VideoReader(write(tmp_path / f"a.{suffix}", images, Fraction(30000, 1001)))
    frames = list(reader.frames())
    assert [clips.number_of(frame.image) for frame in frames] == list(range(30))
    assert all(abs(frame.time - frame.index * Fraction(1001, 30000)) <= Fraction(1, 1000) for frame in frames)
    assert abs(frames[-1].time + frames[-1].duration - 30 * Fraction(1001, 30000)) < Fraction(1, 30)
    assert os.listdir(tmp_path) == [f"a.{suffix}"]


def test_a_default_time_base_is_exact_for_a_constant_rate(tmp_path: Path) -> None:
    rate = Fraction(24000, 1001)
    path = write(tmp_path / "a.mp4", clips.numbered(12), rate)
    assert clips.frame_times(path) == [index / rate for index in range(12)]


def test_even_sizes_play_everywhere(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = write(tmp_path / "a.mp4", clips.numbered(2))
    with av.open(str(path)) as container:
        assert container.streams.video[0].pix_fmt == "yuv420p"
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")  # playable while it loads
    assert caplog.text == ""


def test_other_codecs(tmp_path: Path) -> None:
    chart = clips.color_chart(192, 144)
    path = write(tmp_path / "p.mov", [chart], codec="prores_ks")
    assert np.abs(clips.patch_colors(next(VideoReader(path).frames()).image) - clips.patch_colors(chart)).max() <= 3
    with av.open(str(path)) as container:
        assert container.streams.video[0].codec_context.name == "prores"


def test_hevc_plays_on_apples_players(tmp_path: Path) -> None:
    path = write(tmp_path / "h.mp4", clips.numbered(3), codec="libx265")
    with av.open(str(path)) as container:
        assert container.streams.video[0].codec_context.codec_tag == "hvc1"


def test_crf_is_the_quality(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (64, 96, 3), dtype=np.uint8) for _ in range(5)]
    sizes = [write(tmp_path / f"{crf}.mp4", images, crf=crf).stat().st_size for crf in (10, 18, 40)]
    assert sizes[0] > sizes[1] > 2 * sizes[2]
    # x264 does not make quite the same file each time; a step of the quality is 5 %.
    assert sizes[1] == pytest.approx(write(tmp_path / "default.mp4", images).stat().st_size, rel=0.02)


def test_the_frame_may_be_changed_after_it_is_written(tmp_path: Path) -> None:
    canvas = np.zeros((64, 96, 3), np.uint8)
    with VideoWriter(tmp_path / "a.mp4", 96, 64, Fraction(25)) as writer:
        for index, image in enumerate(clips.numbered(20)):
            canvas[:] = image
            writer.write(canvas, Fraction(index, 25))
    assert [clips.number_of(frame.image) for frame in VideoReader(tmp_path / "a.mp4").frames()] == list(range(20))


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("a.xyz", {}, ".mp4"),
        ("a", {}, ".mp4"),
        ("no/such/folder/a.mp4", {}, "folder"),
        ("a.mp4", {"codec": "h266turbo"}, "h266turbo"),
        ("a.mp4", {"codec": "aac"}, "aac"),
        ("a.webm", {"codec": "libx264"}, "cannot hold H.264"),
        ("a.mp4", {"codec": "qtrle"}, "cannot hold QuickTime Animation"),
        ("a.mov", {"codec": "prores_ks", "crf": 20}, "knows no crf"),
    ],
)
def test_what_cannot_be_written_is_refused_before_any_work(
    tmp_path: Path, name: str, options: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError, match=said) as caught:
        VideoWriter(tmp_path / name, 96, 64, Fraction(25), **options)
    assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_exception_leaves_nothing_behind(tmp_path: Path, error: type[BaseException]) -> None:
    (tmp_path / "a.mp4").write_bytes(b"what was there before")

    def fail() -> None:
        with VideoWriter(tmp_path / "a.mp4", 96, 64, Fraction(25)) as writer:
            writer.write(clips.number_image(0), Fraction(0))
            assert len(os.listdir(tmp_path)) == 3  # and what is written, and whose it is
            raise error

    with pytest.raises(error):
        fail()
    assert os.listdir(tmp_path) == ["a.mp4"]
    assert (tmp_path / "a.mp4").read_bytes() == b"what was there before"


def test_success_replaces_what_was_there(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"what was there before")
    write(tmp_path / "a.mp4", clips.numbered(3))
    assert VideoReader(tmp_path / "a.mp4").info.frames == 3


def test_no_frames_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no frame"), VideoWriter(tmp_path / "a.mp4", 96, 64, Fraction(25)):
        pass
    assert os.listdir(tmp_path) == []


def test_times_must_increase_and_sizes_fit(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "a.mp4", 96, 64, Fraction(25)) as writer:
        writer.write(clips.number_image(0), Fraction(1))
        with pytest.raises(ValueError, match="later"):
            writer.write(clips.number_image(0), Fraction(1))
        with pytest.raises(ValueError, match="frame is"):
            writer.write(clips.number_image(0, 64, 64), Fraction(2))


def test_packets_are_not_hoarded(tmp_path: Path) -> None:
    """The file grows while frames are written: memory does not."""
    rng = np.random.default_rng(0)
    sizes = []
    with VideoWriter(tmp_path / "a.mp4", 192, 128, Fraction(25)) as writer:
        for index in range(400):  # x264 holds back 40 frames to look ahead, and one for each of up to 128 threads
            writer.write(rng.integers(0, 256, (128, 192, 3), dtype=np.uint8), Fraction(index, 25))
            sizes.append(next(tmp_path.glob(".*")).stat().st_size)
    assert sizes[399] > sizes[300] > sizes[200]
    assert all(b >= a for a, b in pairwise(sizes))


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_a_live_writer_holds_no_frame_back(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"live{suffix}"
    images = clips.numbered(6)
    height, width = images[0].shape[:2]
    with VideoWriter(path, width, height, Fraction(10), fast=True) as writer:
        for index, image in enumerate(images):
            writer.write(image, Fraction(index, 10))
            assert writer.packets == index + 1
    assert clips.frame_times(path) == [Fraction(i, 10) for i in range(6)]
    with av.open(str(path)) as container:
        assert float(container.duration or 0) / av.time_base == pytest.approx(0.6, abs=0.01)
