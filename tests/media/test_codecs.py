"""The table of codecs: each cell that it promises is written and read back; what it does not is refused."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from PIL import Image, ImageSequence

from ar_demo.errors import InputError
from ar_demo.media import codecs
from ar_demo.media.reader import VideoReader
from ar_demo.media.writer import VideoWriter
from hdn.imaging.arrays import Picture

from .. import clips
from ..videos import write

SIZE = 256, 128  # DNxHR takes no less
VIDEOS = [codec for codec in codecs.CODECS if codec.name not in ("gif", "webp")]
CELLS = [
    pytest.param(codec, suffix, form, id=f"{codec.name}{suffix}-{form}")
    for codec in VIDEOS
    for suffix in codec.containers
    for form in codec.formats
]
DECODERS = {"prores4444": "prores", "av1": "libdav1d", "animation": "qtrle", "h265": "hevc", "dnxhr": "dnxhd"}
PROFILES = {"prores": "HQ", "prores4444": "4444"}


@pytest.mark.parametrize(("codec", "suffix", "form"), CELLS)
def test_a_promised_cell_is_written_and_read(codec: codecs.Codec, suffix: str, form: str, tmp_path: Path) -> None:
    chart, depth = clips.color_chart(*SIZE), codecs.depth_of(form)
    pictures: list[Picture] = [chart if depth == 8 else chart.astype(np.uint16) * 257] * 3
    path = write(tmp_path / f"a{suffix}", pictures, codec=codec.name, depth=depth, pixel_format=form)
    with VideoReader(path, depth=16) as reader:
        frames = list(reader.frames())
        assert reader.info.depth >= depth  # ProRes 4444 decodes to 12
        if codec.name != "prores4444":
            assert reader.info.pixel_format == form
    assert len(frames) == 3
    error = clips.patch_colors(frames[-1].image / 257) - clips.patch_colors(chart)
    assert np.abs(error).max() <= 4
    with av.open(str(path)) as container:
        context = container.streams.video[0].codec_context
        assert context.name == DECODERS.get(codec.name, codec.name)
        if codec.name in PROFILES:
            assert context.profile == PROFILES[codec.name]


@pytest.mark.parametrize("rate", [25, 60])
@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_animated_pictures(suffix: str, rate: int, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = write(tmp_path / f"a{suffix}", [clips.color_chart(*SIZE), *clips.numbered(11, *SIZE)], rate)
    with Image.open(path) as image:
        pictures = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(image)]
        durations = []
        for index in range(len(pictures)):
            image.seek(index)
            image.load()
            durations.append(image.info["duration"])
        assert image.info["loop"] == 0  # for ever
    assert sum(durations) == pytest.approx(12_000 / rate, abs=20)
    assert np.abs(clips.patch_colors(pictures[0]) - clips.patch_colors(clips.color_chart(*SIZE))).max() < 6
    shown = [clips.number_of(picture) for picture in pictures[1:]]
    if suffix == ".gif" and rate == 60:
        assert min(durations) >= 20
        assert set(shown) < set(range(11))
        assert "at most 50 frames a second" in caplog.text
    else:
        assert shown == list(range(11))


@pytest.mark.parametrize(
    ("name", "codec", "said"),
    [
        ("a.mp4", "prores", ".mp4 cannot hold ProRes 422: let the name end in .mov or .mkv, or choose h264"),
        ("a.webm", "h264", "let the name end in .mp4, .m4v, .mov or .mkv, or choose av1 or vp9"),
        ("a.mkv", "dnxhr", "let the name end in .mov"),
        ("a.gif", "h265", "choose gif"),
        ("a.webm", "mpeg4", "let the name end in .mp4, .m4v, .mov or .mkv"),
        ("a.avi", None, "must end in one of .mp4"),
        ("a.mp4", "h268", "try h264, h265, av1"),
    ],
)
def test_what_a_container_cannot_hold_is_refused_with_those_that_can(
    name: str, codec: str | None, said: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        VideoWriter(tmp_path / name, *SIZE, Fraction(25), codec=codec)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["libx264", "h264"])
def test_a_codec_goes_by_our_name_or_its_encoders(name: str) -> None:
    assert codecs.choose(Path("a.mp4"), name) is codecs.choose(Path("a.MP4"), None)


def test_an_encoder_that_the_table_does_not_have_is_used(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", [clips.color_chart(*SIZE)] * 2, codec="mpeg4")
    with av.open(str(path)) as container:
        assert container.streams.video[0].codec_context.name == "mpeg4"


@pytest.mark.parametrize(
    ("name", "encoder"), [("h264_nvenc", "libx264"), ("hevc_vaapi", "libx265"), ("av1_qsv", "libsvtav1")]
)
def test_where_a_hardware_encoder_does_not_work_software_takes_its_place(
    name: str, encoder: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(codecs, "_works", lambda name: False)
    codecs._say_in_place_of.cache_clear()
    for _ in range(2):
        assert codecs.choose(Path("out.mp4"), name).encoder == encoder
    assert [r.message for r in caplog.records] == [
        f"{name} does not work on this machine: {encoder} encodes in its place"
    ]


def test_a_hardware_encoder_that_works_is_taken_with_its_own_option_for_quality(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if "h264_nvenc" not in av.codecs_available:
        pytest.skip("this FFmpeg knows no NVENC")
    monkeypatch.setattr(codecs, "_works", lambda name: True)
    chosen = codecs.choose(Path("out.mp4"), "h264_nvenc")
    assert (chosen.encoder, chosen.quality, chosen.options["rc"]) == ("h264_nvenc", "cq", "vbr")


def test_an_encoder_is_tried_before_it_is_believed() -> None:
    assert codecs._works("libx264")
    assert not codecs._works("h264_qsv")  # it takes other frames than ours
    assert not codecs._works("h264_nothing")


def test_an_encoder_that_opens_and_makes_nothing_of_a_frame_does_not_work(monkeypatch: pytest.MonkeyPatch) -> None:
    class Silent:
        """An encoder whose driver takes its settings and then no frame."""

        def __init__(self, fails: bool) -> None:
            self.fails = fails

        def open(self) -> None:
            pass

        def encode(self, frame: av.VideoFrame | None) -> list[Any]:
            if self.fails:
                raise av.error.ExternalError(-542398533, "the driver is too old")
            return []

    for fails in (True, False):
        monkeypatch.setattr(av.CodecContext, "create", lambda *_, fails=fails: Silent(fails))
        assert not codecs._works.__wrapped__("libx264")
