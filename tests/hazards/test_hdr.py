"""HDR: PQ and HLG sources stay what they are, and ads are as bright on them as captions are."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from PIL import Image

from ar_demo import InputError, OutputOptions, Session, Surface
from ar_demo.hdr import GRAPHICS_WHITE, Hdr, Transfer
from ar_demo.media import color
from ar_demo.media.ad import open_ad
from ar_demo.media.mastering import Mastering
from ar_demo.media.planes import samples
from ar_demo.media.reader import VideoReader
from ar_demo.media.writer import VideoWriter
from hdn.imaging.arrays import Array

from ..clips import make_clip
from ..conftest import Run
from ..scenes import texture
from ..test_session import Still
from ..videos import floats_of

SIZE = 320, 240
QUAD = np.array([[100.0, 70], [220, 70], [220, 166], [100, 166]])
INSIDE = slice(80, 156), slice(110, 210)
TRANSFERS = {"pq": 16, "hlg": 18}
P3 = "0.68 0.32 0.265 0.69 0.15 0.06 0.3127 0.329"
DISPLAY = tuple(map(Fraction, f"{P3} 0.005 1000".split()))
MASTERING = Mastering(DISPLAY, (900, 300))
BOTH: Any = pytest.mark.parametrize("transfer", ["pq", "hlg"])


def light() -> Array:
    """(H, W, 3) a print, and a lamp of 800 cd/m^2 beside it, relative to graphics white."""
    scene = Hdr("pq").of_graphics(texture(3, *SIZE).astype(np.float32) / 255)
    scene[20:50, 250:300] = 800 / GRAPHICS_WHITE
    return scene


def clip(path: Path, transfer: Transfer, codec: str = "libx265", **options: Any) -> Path:
    colour = color.Colour("bt2020", False, (9, 1, 9, TRANSFERS[transfer]))
    form = {"depth": 10, "pixel_format": "yuv420p10le", "colour": colour} | options
    picture = Hdr(transfer).signal(light().astype(np.float32))
    with VideoWriter(path, *SIZE, Fraction(25), codec=codec, crf=None if codec == "ffv1" else 8, **form) as writer:
        for index in range(3):
            writer.write(picture, Fraction(index, 25))
    return path


@pytest.fixture(scope="module")
def white(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ad") / "white.png"
    Image.new("RGB", (64, 48), (255, 255, 255)).save(path)
    return path


def rendered(source: Path, ad: Path, output: Path, **options: Any) -> list[str]:
    with Session(source, make_tracker=Still) as session:
        [surface] = session.track([Surface(ad, QUAD, flat=True)])
        return session.render([surface], output, OutputOptions(backend="opencv", **options)).warnings


def frames(path: Path) -> list[av.VideoFrame]:
    with av.open(str(path)) as container:
        return list(container.decode(video=0))


@BOTH
def test_an_ad_is_as_bright_as_graphics_and_the_rest_untouched(tmp_path: Path, white: Path, transfer: Transfer) -> None:
    source = clip(tmp_path / "in.mkv", transfer, "ffv1")
    assert rendered(source, white, tmp_path / "o.mkv", codec="ffv1") == []
    for before, after in zip(frames(source), frames(tmp_path / "o.mkv"), strict=True):
        assert color.Colour.of(after) == color.Colour.of(before)
        assert np.array_equal(samples(before, 0)[:70], samples(after, 0)[:70])
        assert np.array_equal(samples(before, 1)[90:], samples(after, 1)[90:])
    with VideoReader(tmp_path / "o.mkv", depth=16, tonemap=False) as reader:
        image = next(reader.frames()).image
    assert image[INSIDE].mean() / 65535 == pytest.approx({"pq": 0.58, "hlg": 0.75}[transfer], abs=0.002)
    assert Hdr(transfer).light(image)[30:40, 260:290].mean() * GRAPHICS_WHITE == pytest.approx(800, rel=0.02)


def test_the_usual_output_is_h265_with_all_that_says_how_it_is_shown(tmp_path: Path, white: Path) -> None:
    source = clip(tmp_path / "in.mp4", "pq", mastering=MASTERING)
    [first, *_] = frames(source)
    assert Mastering.of(first) == MASTERING
    rendered(source, white, tmp_path / "o.mp4")
    [after, *_] = frames(tmp_path / "o.mp4")
    assert after.format.name == "yuv420p10le"
    assert color.Colour.of(after).tags == (9, 1, 9, 16)
    assert Mastering.of(after) == MASTERING
    with av.open(str(tmp_path / "o.mp4")) as container:
        assert container.streams.video[0].codec_context.name == "hevc"


@pytest.mark.parametrize(("codec", "name"), [("libsvtav1", "a.webm"), ("libx264", "a.mp4")])
def test_mastering_metadata_of_other_codecs(tmp_path: Path, codec: str, name: str) -> None:
    [first, *_] = frames(clip(tmp_path / name, "pq", codec, mastering=MASTERING))
    found = Mastering.of(first)
    assert found.light == MASTERING.light
    assert found.display is not None
    assert [float(x) for x in found.display] == pytest.approx([float(x) for x in DISPLAY], abs=1e-3)


def test_a_codec_without_a_place_for_it_says_so(tmp_path: Path, white: Path) -> None:
    source = clip(tmp_path / "in.mp4", "pq", mastering=MASTERING)
    [warning] = rendered(source, white, tmp_path / "o.mov", codec="prores")
    assert "ProRes 422 has no place" in warning
    [after, *_] = frames(tmp_path / "o.mov")
    assert after.color_trc == 16


@BOTH
def test_what_looks_at_it_sees_a_picture_in_sdr(tmp_path: Path, transfer: Transfer) -> None:
    """As bright as the print is in SDR, and with the lamp held back."""
    print_ = texture(3, *SIZE)
    with VideoReader(clip(tmp_path / "in.mp4", transfer)) as reader:
        view = next(reader.frames()).image
        assert reader.warnings == []
    dark = print_.max(2) < 160
    dark[15:55, 245:305] = False
    assert np.abs(view[dark].astype(int) - print_[dark]).mean() < 5  # chroma is 4:2:0
    assert 245 < view[30:40, 260:290].mean() <= 255


@BOTH
@pytest.mark.parametrize("options", [{"tonemap": True}, {"depth": "8"}, {"tonemap": True, "depth": "10"}])
def test_shown_in_sdr(tmp_path: Path, white: Path, transfer: Transfer, options: dict[str, Any]) -> None:
    source = clip(tmp_path / "in.mp4", transfer)
    assert rendered(source, white, tmp_path / "o.mp4", crf=4, **options) == []
    [after, *_] = frames(tmp_path / "o.mp4")
    assert after.format.name == ("yuv420p10le" if options.get("depth") == "10" else "yuv420p")
    assert color.Colour.of(after).tags == (1, 1, 1, 1)
    shown = color.ToRGB()(after)
    with VideoReader(source) as reader:
        view = next(reader.frames()).image
    assert np.abs(shown[:60].astype(int) - view[:60]).mean() < 2
    assert shown[INSIDE].mean() > 253


def test_an_ad_in_hdr_is_shown_in_sdr(tmp_path: Path) -> None:
    with open_ad(clip(tmp_path / "ad.mp4", "hlg")) as ad, VideoReader(tmp_path / "ad.mp4") as reader:
        picture = ad.at(Fraction(0))
        assert picture is not None
        assert np.array_equal(picture, next(reader.frames()).image)


def test_effects_are_made_of_hdr_as_it_is(tmp_path: Path) -> None:
    source = clip(tmp_path / "in.mkv", "pq", "ffv1")
    with Session(source, make_tracker=Still) as session:
        [surface] = session.track([Surface(quad=QUAD + np.array([140, -60]), effect="blur")])
        session.render([surface], tmp_path / "o.mkv", OutputOptions(backend="opencv", codec="ffv1"))
    with VideoReader(tmp_path / "o.mkv", depth=16, tonemap=False) as reader:
        image = next(reader.frames()).image
    assert Hdr("pq").light(image)[34:36, 270:280].mean() > 1.5  # the lamp is brighter than white still


def test_dolby_visions_metadata_are_left_out_with_a_word(tmp_path: Path, white: Path) -> None:
    """Here of an empty kind, as a NAL unit of type 62 after each picture."""
    plain, source = clip(tmp_path / "plain.hevc.mp4", "hlg"), tmp_path / "in.mkv"
    unit = bytes([62 << 1, 1, 25]) + bytes(range(1, 60))
    with av.open(str(plain)) as read, av.open(str(source), "w") as write:
        stream = write.add_stream_from_template(read.streams.video[0])
        for packet in read.demux(video=0):
            if packet.size:
                more = av.Packet(bytes(packet) + len(unit).to_bytes(4, "big") + unit)
                more.pts, more.dts, more.time_base, more.is_keyframe = (
                    packet.pts,
                    packet.dts,
                    packet.time_base,
                    packet.is_keyframe,
                )
                more.stream = stream
                write.mux(more)
    with VideoReader(source) as reader:
        assert reader.info.dynamic == "Dolby Vision's"
    [warning] = rendered(source, white, tmp_path / "o.mp4")
    assert "Dolby Vision's dynamic metadata cannot be kept" in warning
    assert frames(tmp_path / "o.mp4")[0].color_trc == 18


def test_too_few_bits_for_hdr(tmp_path: Path, white: Path) -> None:
    source = clip(tmp_path / "in.mp4", "pq")
    few, shown = rendered(source, white, tmp_path / "o.webm", codec="vp9")
    assert "VP9 does not hold 10 bits" in few
    assert "in.mp4 is shown in SDR" in shown
    [after, *_] = frames(tmp_path / "o.webm")
    assert color.Colour.of(after).tags == (1, 1, 1, 1)
    with pytest.raises(InputError, match="use av1"):
        rendered(source, white, tmp_path / "p.webm", codec="vp9", depth="10")


def test_a_layer_of_an_hdr_video_has_its_samples(tmp_path: Path, white: Path) -> None:
    source = clip(tmp_path / "in.mp4", "hlg")
    with Session(source, make_tracker=Still) as session:
        [surface] = session.track([Surface(white, QUAD, flat=True)])
        session.render([surface], None, OutputOptions(backend="opencv"), layer=tmp_path / "l.mov")
    [layer, *_] = frames(tmp_path / "l.mov")
    assert layer.color_trc == 18
    assert samples(layer, 0)[INSIDE].mean() / 4 == pytest.approx(64 + 876 * 0.75, abs=4)  # decoded in 12 bits


def test_pictures_are_in_sdr_and_a_layer_with_them(tmp_path: Path, white: Path) -> None:
    source = clip(tmp_path / "in.mp4", "pq")
    with Session(source, make_tracker=Still) as session:
        [surface] = session.track([Surface(white, QUAD, flat=True)])
        options, layer = OutputOptions(backend="opencv"), tmp_path / "l.%02d.png"
        warnings = session.render([surface], tmp_path / "o.%02d.png", options, layer=layer).warnings
    assert any("is in SDR, as the video is" in warning for warning in warnings)
    for name in ("o.00.png", "l.00.png"):
        with Image.open(tmp_path / name) as picture:
            assert np.asarray(picture.convert("RGB"))[INSIDE].mean() > 253


@BOTH
def test_a_layer_in_pictures_fits_the_hdr_source(tmp_path: Path, white: Path, transfer: Transfer) -> None:
    """As it is coded in PNG, in linear light in OpenEXR, where 1 is graphics white; and the video stays HDR."""
    source = clip(tmp_path / "in.mp4", transfer)
    for suffix in ("png", "exr"):
        with Session(source, make_tracker=Still) as session:
            [surface] = session.track([Surface(white, QUAD, opacity=0.7, feather=3, flat=True)])
            options, layer = OutputOptions(backend="opencv", overwrite=True, codec="ffv1"), tmp_path / f"l.%d.{suffix}"
            assert session.render([surface], tmp_path / "o.mkv", options, layer=layer).warnings == []
        with VideoReader(source, 16, False) as reader, VideoReader(tmp_path / "o.mkv", 16, False) as made:
            [before, *_], [after, *_], hdr = reader.frames(), made.frames(), reader.info.hdr
            assert made.info.hdr == hdr is not None
        if suffix == "exr":
            found = floats_of(tmp_path / "l.0.exr")
            assert found[120, 160, :3] == pytest.approx(0.7, abs=0.02)
            over = hdr.signal(found[..., :3] + (1 - found[..., 3:]) * hdr.light(before.image))
        else:
            found = cv2.cvtColor(cv2.imread(str(tmp_path / "l.0.png"), cv2.IMREAD_UNCHANGED), cv2.COLOR_BGRA2RGBA)
            share = found[..., 3:] / 65535
            over = found[..., :3] * share + (1 - share) * before.image
        middle = INSIDE  # elsewhere chroma is shared with what is around
        assert np.abs(over[middle] - after.image[middle].astype(float)).mean() < 65535 / 1023


@BOTH
def test_openexr_has_the_light_of_hdr(tmp_path: Path, white: Path, transfer: Transfer) -> None:
    source = clip(tmp_path / "in.mkv", transfer, "ffv1")
    assert rendered(source, white, tmp_path / "o.%d.exr") == []
    found = floats_of(tmp_path / "o.0.exr")
    assert found[INSIDE].mean((0, 1)) == pytest.approx([1, 1, 1], abs=0.02)  # an ad's white
    assert found[30:40, 260:290].mean() == pytest.approx(800 / GRAPHICS_WHITE, rel=0.05)
    assert rendered(source, white, tmp_path / "s.%d.exr", tonemap=True) == []
    assert floats_of(tmp_path / "s.0.exr").max() <= 1


def test_a_layer_of_eight_bits_is_no_hdr(tmp_path: Path, white: Path) -> None:
    source = clip(tmp_path / "in.mp4", "pq")
    with Session(source, make_tracker=Still) as session:
        surfaces = session.track([Surface(white, QUAD, flat=True)])
        with pytest.raises(InputError, match="8 bits, too few for HDR"):
            session.render(surfaces, options=OutputOptions(backend="opencv"), layer=tmp_path / "l.webm")
        options = OutputOptions(backend="opencv", tonemap=True)
        assert session.render(surfaces, options=options, layer=tmp_path / "l.webm").warnings == []


def test_tonemap_says_where_it_changes_nothing(tmp_path: Path, white: Path) -> None:
    source = make_clip(tmp_path / "in.mp4", [texture(3, *SIZE)] * 2)
    [warning] = rendered(source, white, tmp_path / "o.mp4", tonemap=True)
    assert "in.mp4 is not HDR" in warning


def test_the_command_line_says_once_that_it_is_shown_in_sdr(tmp_path: Path, white: Path, run: Run) -> None:
    source = clip(tmp_path / "in.mp4", "pq")
    corners = [f"{x:g},{y:g}" for x, y in QUAD]
    said = run(source, white, "--quad", *corners, "--end", 1, "-o", tmp_path / "o.webm", "--codec", "vp9", "--flat")
    assert said[0] == 0
    assert said[2].count("is shown in SDR") == 1
