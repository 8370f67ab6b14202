"""Files with more than a picture and a sound: tracks, subtitles, covers, fonts, titles, chapters, times, places."""

import re
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import pytest
from av.stream import Disposition

from ar_demo.media.streams import Streams

from .. import clips
from ..media.test_carried import run_ffmpeg
from ..videos import clip, rewrite

SUBTITLES = "1\n00:00:00,200 --> 00:00:00,900\nHello <i>world</i>\n\n2\n00:00:01,200 --> 00:00:01,800\nSecond\n"
CHAPTERS = """;FFMETADATA1
title=My clip
artist=Someone
location=+48.2000+016.3000/
creation_time=2024-05-06T07:08:09Z
com.apple.quicktime.make=Maker
[CHAPTER]
TIMEBASE=1/1000
START=0
END=800
title=One
[CHAPTER]
TIMEBASE=1/1000
START=800
END=2000
title=Two
"""


@pytest.fixture(scope="module")
def rich(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A MOV of two seconds with two sound tracks, subtitles, a timecode, chapters and tags."""
    folder = tmp_path_factory.mktemp("rich")
    picture = clip(folder / "picture.mp4", 2)
    (folder / "s.srt").write_text(SUBTITLES)
    (folder / "tags.txt").write_text(CHAPTERS)
    path = folder / "rich.mov"
    run_ffmpeg(
        "-i", str(picture), "-f", "lavfi", "-i", "sine=440:d=2", "-f", "lavfi", "-i", "sine=880:d=2",
        "-i", str(folder / "s.srt"), "-i", str(folder / "tags.txt"),
        "-map", "0", "-map", "1", "-map", "2", "-map", "3", "-map_metadata", "4", "-map_chapters", "4",
        "-c:v", "copy", "-c:a", "aac", "-c:s", "mov_text", "-timecode", "10:11:12:13",
        "-metadata:s:a:0", "language=eng", "-metadata:s:a:1", "language=ger", "-metadata:s:a:1", "title=Comment",
        "-metadata:s:s:0", "language=fra", "-movflags", "use_metadata_tags", str(path),
    )  # fmt: skip
    return path


def lowered(tags: dict[str, str]) -> dict[str, str]:
    return {key.lower(): value for key, value in tags.items()}


def subtitles(path: Path) -> list[tuple[float, float, bytes]]:
    """(begin, seconds, text) of the first track's."""
    with av.open(str(path)) as container:
        stream = container.streams.subtitles[0]
        base, found = stream.time_base or Fraction(0), []
        for packet in container.demux(stream):
            shown: Any = stream.codec_context.decode2(packet) if packet.size else None
            text = b"".join(rect.dialogue for rect in shown or ())
            if text:
                found.append((float((packet.pts or 0) * base), float((packet.duration or 0) * base), text))
        return found


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "webm"])
def test_all_that_is_in_a_file_goes_along(rich: Path, tmp_path: Path, suffix: str) -> None:
    streams = Streams("source", rich)
    output = rewrite(rich, tmp_path / f"out.{suffix}", streams)
    assert streams.warnings == [] or suffix == "webm"  # where the sound is encoded anew
    with av.open(str(output)) as container:
        tags = lowered(container.metadata)
        assert (tags["title"], tags["artist"], tags["location"]) == ("My clip", "Someone", "+48.2000+016.3000/")
        assert tags["creation_time"].startswith("2024-05-06T07:08:09")
        assert tags["com.apple.quicktime.make"] == "Maker"
        assert tags["timecode"] == "10:11:12:13"
        starts = [round(float(c["start"] * (c["time_base"] or 0)), 3) for c in container.chapters()]
        assert (starts, [c["metadata"]["title"] for c in container.chapters()]) == ([0, 0.8], ["One", "Two"])
        voices = container.streams.audio
        assert [voice.language for voice in voices] == ["eng", "ger"]
        assert voices[1].metadata.get("title", voices[1].metadata.get("name")) == "Comment"
        assert container.streams.subtitles[0].language == "fra"
    assert [(round(a, 2), round(b, 2)) for a, b, _ in subtitles(output)] == [(0.2, 0.7), (1.2, 0.6)]
    assert [re.sub(rb"{.*?}", b"", text) for *_, text in subtitles(output)] == [b"Hello world", b"Second"]


def test_first_keeps_one_sound_and_the_titles(rich: Path, tmp_path: Path) -> None:
    output = rewrite(rich, tmp_path / "out.mkv", Streams("source", rich, keep="first"))
    with av.open(str(output)) as container:
        assert [stream.type for stream in container.streams] == ["video", "audio"]
        assert container.streams.audio[0].language == "eng"
        assert container.metadata["title"] == "My clip"
        assert len(container.chapters()) == 2


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
def test_the_location_is_left_out_where_that_is_asked_for(rich: Path, tmp_path: Path, suffix: str) -> None:
    output = rewrite(rich, tmp_path / f"out.{suffix}", Streams("source", rich, location=False))
    assert b"+48.2" not in output.read_bytes()
    with av.open(str(output)) as container:
        assert not [key for key in lowered(container.metadata) if "location" in key]
        assert container.metadata["title"] == "My clip"


def test_chapters_end_where_the_output_does(rich: Path, tmp_path: Path) -> None:
    output = rewrite(rich, tmp_path / "out.mkv", Streams("source", rich, end=Fraction(1)), stop=25)
    with av.open(str(output)) as container:
        assert [float(c["end"] * (c["time_base"] or 0)) for c in container.chapters()] == [0.8, 1.0]
    output = rewrite(rich, tmp_path / "shorter.mkv", Streams("source", rich, end=Fraction(1, 2)), stop=12)
    with av.open(str(output)) as container:
        assert [c["metadata"]["title"] for c in container.chapters()] == ["One"]


def test_chapters_are_no_longer_than_the_picture(rich: Path, tmp_path: Path) -> None:
    source = tmp_path / "in.mov"
    run_ffmpeg("-i", str(rich), "-map", "0:v:0", "-map_chapters", "0", "-c", "copy", "-t", "1", str(source))
    short = tmp_path / "short.mov"
    tags = tmp_path / "tags.txt"
    tags.write_text(CHAPTERS)
    run_ffmpeg("-i", str(source), "-i", str(tags), "-map", "0:v", "-map_chapters", "1", "-c", "copy", str(short))
    with av.open(str(rewrite(short, tmp_path / "out.mkv", Streams("source", short)))) as container:
        ends = [float(c["end"] * (c["time_base"] or 0)) for c in container.chapters()]
    assert ends == [0.8, 1.0]


def test_other_tracks_stay_as_they_are_beside_a_mix(rich: Path, tmp_path: Path) -> None:
    ad = clip(tmp_path / "ad.mp4", 1, sound=None)
    run_ffmpeg("-i", str(ad), "-f", "lavfi", "-i", "sine=300:d=1", "-c:v", "copy", "-shortest", str(tmp_path / "a.mp4"))
    output = rewrite(rich, tmp_path / "out.mp4", Streams("mix", rich, tmp_path / "a.mp4"))
    with av.open(str(output)) as container, av.open(str(rich)) as source:
        assert [voice.layout.name for voice in container.streams.audio] == ["stereo", "mono"]
        assert [voice.language for voice in container.streams.audio] == ["eng", "ger"]
        theirs = [bytes(packet) for packet in source.demux(source.streams.audio[1]) if packet.size]
        ours = [bytes(packet) for packet in container.demux(container.streams.audio[1]) if packet.size]
        assert ours == theirs[: len(ours)]
        assert len(ours) > len(theirs) - 3


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "webm"])
def test_fonts_and_covers_go_where_they_can_and_are_named_where_not(tmp_path: Path, suffix: str) -> None:
    picture = clip(tmp_path / "picture.mp4", 1)
    (tmp_path / "font.ttf").write_bytes(b"font" * 50)
    source = tmp_path / "in.mkv"
    run_ffmpeg(
        "-f", "lavfi", "-i", "color=red:s=64x64", "-frames:v", "1", str(tmp_path / "cover.png")
    )  # fmt: skip
    run_ffmpeg(
        "-i", str(picture), "-c", "copy", "-attach", str(tmp_path / "font.ttf"), "-metadata:s:t:0",
        "mimetype=font/ttf", "-attach", str(tmp_path / "cover.png"), "-metadata:s:t:1", "mimetype=image/png",
        str(source),
    )  # fmt: skip
    streams = Streams("source", source)
    output = rewrite(source, tmp_path / f"out.{suffix}", streams)
    with av.open(str(output)) as container:
        fonts = [held.data for held in container.streams.attachments]
        covers = [s for s in container.streams.video if s.disposition & Disposition.attached_pic]
    assert fonts == ([b"font" * 50] if suffix == "mkv" else [])
    assert len(covers) == (suffix != "webm")
    told = " ".join(streams.warnings)
    assert ("font.ttf" in told, "png" in told, len(streams.warnings)) == (
        suffix != "mkv",
        suffix == "webm",
        suffix != "mkv",
    )


def test_a_subtitle_that_is_shown_already_is_shown_from_the_first_picture_on(tmp_path: Path) -> None:
    late = clip(tmp_path / "late.mkv", times=[Fraction(1, 2) + Fraction(index, 25) for index in range(50)])
    (tmp_path / "s.srt").write_text(SUBTITLES)
    source = tmp_path / "in.mkv"
    run_ffmpeg("-copyts", "-i", str(late), "-i", str(tmp_path / "s.srt"), "-c", "copy", str(source))
    output = rewrite(source, tmp_path / "out.mkv", Streams("source", source))
    assert [(round(a, 2), round(b, 2)) for a, b, _ in subtitles(output)] == [(0, 0.4), (0.7, 0.6)]


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
def test_telemetry_goes_along_where_it_can_and_is_named_where_not(tmp_path: Path, suffix: str) -> None:
    """A subtitle track that is made to look like a GoPro's, since no encoder writes one."""
    picture = clip(tmp_path / "picture.mp4", 2)
    (tmp_path / "s.srt").write_text(SUBTITLES)
    source = tmp_path / "in.mp4"
    run_ffmpeg("-i", str(picture), "-i", str(tmp_path / "s.srt"), "-c:v", "copy", "-c:s", "mov_text", str(source))
    content = source.read_bytes().replace(b"tx3g", b"gpmd").replace(b"sbtl", b"meta")
    source.write_bytes(content.replace(b"SubtitleHandler", b"\tGoPro MET     "))
    streams = Streams("source", source)
    output = rewrite(source, tmp_path / f"out.{suffix}", streams)
    assert ("GoPro MET" in " ".join(streams.warnings)) == (suffix == "mkv")
    if suffix != "mkv":
        assert data_packets(output) == data_packets(source)
    streams = Streams("source", source, location=False)  # which telemetry tells
    with av.open(str(rewrite(source, tmp_path / f"nowhere.{suffix}", streams))) as container:
        assert len(container.streams.data) == len(streams.warnings) == 0


def test_a_drones_subtitles_are_left_out_with_the_location(tmp_path: Path) -> None:
    picture, text = clip(tmp_path / "picture.mp4", 1), tmp_path / "s.srt"
    text.write_text("1\n00:00:00,000 --> 00:00:00,900\n[iso: 100] [latitude: 48.2] [longitude: 16.3]\n")
    source = tmp_path / "in.mkv"
    run_ffmpeg("-i", str(picture), "-i", str(text), "-c", "copy", str(source))
    for location in (True, False):
        output = rewrite(source, tmp_path / f"{location}.mkv", Streams("source", source, location=location))
        with av.open(str(output)) as container:
            assert len(container.streams.subtitles) == location


def data_packets(path: Path) -> list[tuple[Fraction, bytes]]:
    with av.open(str(path)) as container:
        [stream] = container.streams.data
        base = stream.time_base or Fraction(0)
        return [((packet.pts or 0) * base, bytes(packet)) for packet in container.demux(stream) if packet.size]


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "webm"])
def test_a_second_picture_goes_along_where_it_can(tmp_path: Path, suffix: str) -> None:
    first, second = clip(tmp_path / "a.mp4", 1), clip(tmp_path / "b.mp4", 1, options={"bf": "2"})
    source = tmp_path / "in.mp4"
    run_ffmpeg("-i", str(first), "-i", str(second), "-map", "0", "-map", "1", "-c", "copy", str(source))
    streams = Streams("source", source)
    output = rewrite(source, tmp_path / f"out.{suffix}", streams)
    assert ("video h264" in " ".join(streams.warnings)) == (suffix == "webm")
    with av.open(str(output)) as container:
        assert len(container.streams.video) == (1 if suffix == "webm" else 2)
        if suffix != "webm":
            shown = [frame.to_ndarray(format="rgb24") for frame in container.decode(container.streams.video[1])]
            assert [clips.number_of(image) for image in shown] == list(range(25))
