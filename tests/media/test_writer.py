"""Writing: exact times and durations, colour that comes back, odd sizes, and never half a file."""

import errno
import os
import subprocess
from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest

from ar_demo.media.reader import VideoReader
from ar_demo.media.writer import VideoWriter
from hdn.errors import InputError, RunError

from .. import clips as media

VARIABLE = [Fraction(n, 1000) for n in (0, 20, 53, 153, 203, 236, 256, 300, 420, 440, 473, 500, 507, 640)]


def write(path: Path, images: list[media.Image], rate: Fraction | int = 25, **options: object) -> Path:
    height, width = images[0].shape[:2]
    with VideoWriter(path, width, height, Fraction(rate), **options) as writer:  # type: ignore[arg-type]
        for index, image in enumerate(images):
            writer.write(image, index / Fraction(rate))
    return path


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "webm", "m4v"])
def test_containers(tmp_path: Path, suffix: str) -> None:
    images = media.numbered(30)
    reader = VideoReader(write(tmp_path / f"a.{suffix}", images, Fraction(30000, 1001)))
    frames = list(reader.frames())
    assert [media.number_of(frame.image) for frame in frames] == list(range(30))
    assert all(abs(frame.time - frame.index * Fraction(1001, 30000)) <= Fraction(1, 1000) for frame in frames)
    assert abs(frames[-1].time + frames[-1].duration - 30 * Fraction(1001, 30000)) < Fraction(1, 30)
    assert os.listdir(tmp_path) == [f"a.{suffix}"]


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "webm"])
@pytest.mark.parametrize("first", [Fraction(0), Fraction(7, 5)])
def test_variable_rate_is_kept_from_file_to_file(tmp_path: Path, suffix: str, first: Fraction) -> None:
    """Read, write, read: times to the millisecond, the length to less than a frame, the last frame's duration too."""
    source = media.make_clip(
        tmp_path / "in.mp4", media.numbered(14), times=VARIABLE, time_base=Fraction(1, 90000), options={"bf": "3"}
    )
    with VideoReader(source) as reader:
        info = reader.info
        path = tmp_path / f"out.{suffix}"
        with VideoWriter(path, 96, 64, info.rate, time_base=info.time_base) as writer:
            for frame in reader.frames():
                writer.write(frame.image, first + frame.time, frame.duration)
        frames = list(reader.frames())
    again = list(VideoReader(path).frames())
    assert [media.number_of(frame.image) for frame in again] == list(range(14))
    for a, b in zip(frames, again, strict=True):
        assert abs(a.time - b.time) <= Fraction(1, 1000)
        assert abs(a.duration - b.duration) <= Fraction(2, 1000)
    if suffix in ("mp4", "mov"):
        assert [frame.time for frame in again] == VARIABLE
        duration = VideoReader(path).info.duration
        assert duration is not None
        assert abs(duration - VARIABLE[-1] - frames[-1].duration) < Fraction(1, 10000)


def test_a_default_time_base_is_exact_for_a_constant_rate(tmp_path: Path) -> None:
    rate = Fraction(24000, 1001)
    path = write(tmp_path / "a.mp4", media.numbered(12), rate)
    assert media.frame_times(path) == [index / rate for index in range(12)]


@pytest.mark.parametrize(("size", "suffix"), [((1280, 720), "mp4"), ((192, 144), "mp4"), ((192, 144), "webm")])
def test_colour_comes_back_and_is_tagged(tmp_path: Path, size: tuple[int, int], suffix: str) -> None:
    chart = media.color_chart(*size)
    path = write(tmp_path / f"c.{suffix}", [chart] * 2, crf=4)
    reader = VideoReader(path)
    error = media.patch_colors(next(reader.frames()).image) - media.patch_colors(chart)
    assert np.abs(error).max() <= 3
    assert np.abs(error.mean((0, 1))).max() < 0.7
    assert (reader.info.matrix, reader.info.full_range) == ("bt709", False)
    with av.open(str(path)) as container:
        frame = next(container.decode(video=0))
    assert (frame.colorspace, frame.color_primaries, frame.color_trc, frame.color_range) == (1, 1, 1, 1)


def test_another_decoder_sees_the_same_colours(tmp_path: Path) -> None:
    """The ffmpeg program, which goes by the tags."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    chart = media.color_chart(192, 144)
    path = write(tmp_path / "c.mp4", [chart], crf=4)
    flags = ["-sws_flags", "accurate_rnd+full_chroma_int", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run([ffmpeg, "-v", "error", "-i", path, *flags], capture_output=True, check=True).stdout
    image = np.frombuffer(raw, np.uint8).reshape(144, 192, 3)
    assert np.abs(media.patch_colors(image) - media.patch_colors(chart)).max() <= 3


@pytest.mark.parametrize("size", [(97, 63), (96, 63), (97, 64)])
def test_odd_sizes_are_kept(tmp_path: Path, size: tuple[int, int], caplog: pytest.LogCaptureFixture) -> None:
    chart = media.color_chart(*size)
    path = write(tmp_path / "odd.mp4", [chart] * 3, crf=4)
    image = next(VideoReader(path).frames()).image
    assert image.shape == chart.shape
    assert np.abs(media.patch_colors(image) - media.patch_colors(chart)).max() <= 3
    assert "4:4:4" in caplog.text


def test_even_sizes_play_everywhere(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = write(tmp_path / "a.mp4", media.numbered(2))
    with av.open(str(path)) as container:
        assert container.streams.video[0].pix_fmt == "yuv420p"
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")  # playable while it loads
    assert caplog.text == ""


def test_other_codecs(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    chart = media.color_chart(192, 144)
    path = write(tmp_path / "p.mov", [chart], codec="prores_ks", crf=20)
    assert np.abs(media.patch_colors(next(VideoReader(path).frames()).image) - media.patch_colors(chart)).max() <= 3
    assert "crf" in caplog.text
    with av.open(str(path)) as container:
        assert container.streams.video[0].codec_context.name == "prores"


def test_hevc_plays_on_apples_players(tmp_path: Path) -> None:
    path = write(tmp_path / "h.mp4", media.numbered(3), codec="libx265")
    with av.open(str(path)) as container:
        assert container.streams.video[0].codec_context.codec_tag == "hvc1"


def test_crf_is_the_quality(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (64, 96, 3), dtype=np.uint8) for _ in range(5)]
    sizes = [write(tmp_path / f"{crf}.mp4", images, crf=crf).stat().st_size for crf in (10, 18, 40)]
    assert sizes[0] > sizes[1] > 2 * sizes[2]
    # x264 does not make quite the same file each time; a step of the quality is 5 %.
    assert sizes[1] == pytest.approx(write(tmp_path / "default.mp4", images).stat().st_size, rel=0.02)


def test_pixel_aspect_is_kept(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", media.numbered(2), pixel_aspect=Fraction(4, 3))
    assert VideoReader(path).info.pixel_aspect == Fraction(4, 3)


def test_the_frame_may_be_changed_after_it_is_written(tmp_path: Path) -> None:
    canvas = np.zeros((64, 96, 3), np.uint8)
    with VideoWriter(tmp_path / "a.mp4", 96, 64, Fraction(25)) as writer:
        for index, image in enumerate(media.numbered(20)):
            canvas[:] = image
            writer.write(canvas, Fraction(index, 25))
    assert [media.number_of(frame.image) for frame in VideoReader(tmp_path / "a.mp4").frames()] == list(range(20))


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("a.xyz", {}, ".mp4"),
        ("a", {}, ".mp4"),
        ("no/such/folder/a.mp4", {}, "folder"),
        ("a.mp4", {"codec": "h266turbo"}, "h266turbo"),
        ("a.mp4", {"codec": "aac"}, "aac"),
        ("a.webm", {"codec": "libx264"}, "libx264"),
        ("a.mp4", {"codec": "qtrle"}, "qtrle"),
    ],
)
def test_what_cannot_be_written_is_refused_before_any_work(
    tmp_path: Path, name: str, options: dict[str, str], said: str
) -> None:
    with pytest.raises(InputError, match=said) as caught:
        VideoWriter(tmp_path / name, 96, 64, Fraction(25), **options)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_exception_leaves_nothing_behind(tmp_path: Path, error: type[BaseException]) -> None:
    (tmp_path / "a.mp4").write_bytes(b"what was there before")

    def fail() -> None:
        with VideoWriter(tmp_path / "a.mp4", 96, 64, Fraction(25)) as writer:
            writer.write(media.number_image(0), Fraction(0))
            assert len(os.listdir(tmp_path)) == 2
            raise error

    with pytest.raises(error):
        fail()
    assert os.listdir(tmp_path) == ["a.mp4"]
    assert (tmp_path / "a.mp4").read_bytes() == b"what was there before"


def test_success_replaces_what_was_there(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"what was there before")
    write(tmp_path / "a.mp4", media.numbered(3))
    assert VideoReader(tmp_path / "a.mp4").info.frames == 3


def test_no_frames_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no frame"), VideoWriter(tmp_path / "a.mp4", 96, 64, Fraction(25)):
        pass
    assert os.listdir(tmp_path) == []


def test_times_must_increase_and_sizes_fit(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "a.mp4", 96, 64, Fraction(25)) as writer:
        writer.write(media.number_image(0), Fraction(1))
        with pytest.raises(ValueError, match="later"):
            writer.write(media.number_image(0), Fraction(1))
        with pytest.raises(ValueError, match="frame is"):
            writer.write(media.number_image(0, 64, 64), Fraction(2))


class FullDisk:
    """A container that breaks off like one on a full disk."""

    def __init__(self, container: av.container.OutputContainer) -> None:
        self._container = container

    def mux(self, packet: object) -> None:
        raise av.error.OSError(errno.ENOSPC, "No space left on device")

    def close(self) -> None:
        self._container.close()


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    def fill() -> None:
        with VideoWriter(tmp_path / "a.mp4", 96, 64, Fraction(25)) as writer:
            writer._container = FullDisk(writer._container)  # type: ignore[assignment]
            for index, image in enumerate(media.numbered(200)):
                writer.write(image, Fraction(index, 25))

    with pytest.raises(RunError, match="no space left") as caught:
        fill()
    assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == []


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of 200 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", disk], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("mounting needs root")
    yield disk
    subprocess.run(["umount", disk], check=True)


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
@pytest.mark.parametrize("count", [40, 80])  # full only when the file is finished, and while frames are written
def test_a_really_full_disk(tiny_disk: Path, suffix: str, count: int) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (128, 192, 3), dtype=np.uint8) for _ in range(count)]
    with pytest.raises(RunError, match="no space left"):
        write(tiny_disk / f"a.{suffix}", images)
    assert os.listdir(tiny_disk) == []


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
