"""Parts that are joined: the same as the whole in one go, in each container and codec, with the sound beside it."""

from collections.abc import Iterable
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest

from ar_demo.errors import InputError
from ar_demo.media import codecs
from ar_demo.media.claims import Claim
from ar_demo.media.joining import SUFFIXES, join
from ar_demo.media.reader import Frame, VideoReader
from ar_demo.media.streams import Streams
from ar_demo.media.writer import VideoWriter

from .. import clips
from ..videos import numbers, write

FRAMES, RATE = 70, Fraction(25)
SEAMS = 0, 20, 45, FRAMES
CELLS = [(codec.name, suffix) for codec in codecs.CODECS for suffix in codec.containers if suffix in SUFFIXES]


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("join") / "source.mp4"
    sound = clips.tone(FRAMES / 25)
    return clips.make_clip(path, clips.numbered(FRAMES, 256, 128), rate=25, sound=sound)


def copy(frames: Iterable[Frame], source: VideoReader, path: Path, streams: Streams | None, codec: str) -> Path:
    info = source.info
    with VideoWriter(
        path,
        info.width,
        info.height,
        info.rate,
        codec=codec,
        streams=streams,
        time_base=info.time_base,
        pixel_format=info.pixel_format,
        colour=info.colour,
        siting="left",
    ) as writer:
        for frame in frames:
            writer.write(frame.image, frame.time, frame.duration)
    return path


def what_it_says(path: Path) -> list[object]:
    """What a file says of its picture and sound, and when each frame comes."""
    with av.open(str(path)) as container:
        picture, [sound] = container.streams.video[0], container.streams.audio
        context = picture.codec_context
        times = [frame.pts for frame in container.decode(video=0)]
        form = context.name, context.pix_fmt, context.codec_tag, context.extradata
        colour = context.color_range, context.colorspace, context.color_primaries, context.color_trc
        lengths = container.duration, picture.duration, picture.average_rate, picture.time_base, sound.duration
        return [form, colour, lengths, times]


@pytest.mark.parametrize(("codec", "suffix"), CELLS)
def test_the_same_as_in_one_go(source: Path, tmp_path: Path, codec: str, suffix: str) -> None:
    with VideoReader(source) as reader:
        whole = copy(reader.frames(), reader, tmp_path / f"whole{suffix}", Streams("source", source), codec)
        parts = [copy(reader.frames(a, b), reader, tmp_path / f"{a}{suffix}", None, codec) for a, b in pairwise(SEAMS)]
        with Claim(tmp_path / f"joined{suffix}") as claim:
            join(parts, claim, reader.times, reader.times[-1] + 1 / RATE, Streams("source", source), reader.info)
    assert what_it_says(whole) == what_it_says(claim.path)
    assert clips.sound_packets(whole) == clips.sound_packets(claim.path)
    with VideoReader(claim.path) as joined, VideoReader(whole) as other:
        assert numbers(joined.frames()) == [*range(FRAMES)]
        [first], [same] = joined.frames(0, 1), other.frames(0, 1)
        np.testing.assert_array_equal(first.image, same.image)
        assert numbers(joined.frames(50, 52)) == [50, 51]  # by seeking
        assert joined.warnings == []


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_uneven_frames_keep_their_times(tmp_path: Path, suffix: str) -> None:
    steps = [0, 40, 120, 125, 200, 400, 410, 420, 600, 640]
    times = [Fraction(step, 1000) for step in steps]
    images, parts = clips.numbered(10), []
    for begin, end in ((0, 4), (4, 10)):
        parts.append(tmp_path / f"{begin}{suffix}")
        with VideoWriter(parts[-1], 96, 64, Fraction(15), time_base=Fraction(1, 1000)) as writer:
            for index in range(begin, end):
                writer.write(images[index], times[index])
    with Claim(tmp_path / f"o{suffix}") as claim:
        join(parts, claim, times, Fraction(1), Streams("none", parts[0]))
    with VideoReader(claim.path) as reader:
        assert numbers(reader.frames()) == [*range(10)]
        assert [frame.time for frame in reader.frames()] == times


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    a, b = (write(tmp_path / name, clips.numbered(5)) for name in ("a.mp4", "b.mp4"))
    small = write(tmp_path / "small.mp4", clips.numbered(5, 48, 32))
    other = write(tmp_path / "other.mkv", clips.numbered(5))
    nothing = tmp_path / "nothing.mp4"
    nothing.write_bytes(b"no video")
    times = [Fraction(index, 25) for index in range(10)]
    for parts, name, message in (
        ([a, small], "o.mp4", "small.mp4 is encoded otherwise than"),
        ([a, other], "o.mp4", "other.mkv is no .mp4 as the output is"),
        ([a], "o.mp4", "the parts have 5 frames, and the video has 10"),
        ([a, b, b], "o.mp4", "the parts have 15 frames"),
        ([a, nothing], "o.mp4", "nothing.mp4 is no part of a video"),
        ([a, b], "o.gif", "a .gif cannot be joined"),
    ):
        with Claim(tmp_path / name) as claim, pytest.raises(InputError, match=message):
            join(parts, claim, times, Fraction(10, 25), Streams("none", a))
    assert len(list(tmp_path.iterdir())) == 5
