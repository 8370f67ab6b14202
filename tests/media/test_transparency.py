"""Transparency: each container and codec that promises it holds it, colours and alpha alike."""

import subprocess
from pathlib import Path

import av
import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from ar_demo.errors import InputError
from ar_demo.media import codecs
from ar_demo.media.decode import has_alpha, open_video
from ar_demo.media.writer import VideoWriter
from hdn.imaging.arrays import Picture

from .. import clips
from ..videos import write

SIZE = 192, 144
CELLS = [
    pytest.param(codec.name, suffix, id=f"{codec.name}{suffix}")
    for codec in codecs.CODECS
    if codec.transparent
    for suffix in codec.holders(True)
]

ALPHA_LOSS = {"vp9": 6, "prores4444": 1}  # levels of 8 bits
COLOUR_LOSS = {"vp9": 4, "prores4444": 4, "webp": 6}


def picture() -> Picture:
    """A colour chart whose alpha goes from clear to opaque."""
    alpha = np.broadcast_to(np.linspace(0, 255, SIZE[0]).round()[None], SIZE[::-1])
    return np.ascontiguousarray(np.dstack([clips.color_chart(*SIZE), alpha]).astype(np.uint16) * 257)


def decoded(path: Path, suffix: str) -> Picture:
    """The first frame (h, w, 4), uint16, by a decoder that is not ours."""
    if suffix == ".webp":
        return np.asarray(Image.open(path).convert("RGBA")).astype(np.uint16) * 257
    by_vpx = ["-c:v", "libvpx-vp9"] if suffix == ".webm" or "vp9" in path.name else []
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", *by_vpx, "-i", str(path), "-frames:v", "1"]
    narrow = "animation" in path.name  # FFmpeg's way from RGB of 8 bits to 16 is off by a level
    command += ["-f", "rawvideo", "-pix_fmt", "rgba" if narrow else "rgba64le", "-"]
    data = subprocess.run(command, capture_output=True, check=True).stdout
    picture = np.frombuffer(data, np.uint8 if narrow else np.uint16).reshape(*SIZE[::-1], 4)
    return picture * np.uint16(257 if narrow else 1)


@pytest.mark.parametrize(("name", "suffix"), CELLS)
def test_a_promised_cell_holds_transparency(name: str, suffix: str, tmp_path: Path) -> None:
    path = write(tmp_path / f"{name}{suffix}", [picture()] * 3, codec=name, alpha=True, depth=8)
    if suffix != ".webp":
        container, stream = open_video(path)
        with container:
            assert has_alpha(stream)
    found, wanted = decoded(path, suffix).astype(int), picture().astype(int)
    assert np.abs(found[..., 3] - wanted[..., 3]).max() <= 257 * ALPHA_LOSS.get(name, 0)
    seen = slice(None), slice(1, None)  # WebP gives what is clear no colour
    error = clips.patch_colors(found[..., :3]) - clips.patch_colors(wanted[..., :3])
    assert np.abs(error[seen]).max() <= 257 * COLOUR_LOSS.get(name, 0)


def test_prores_4444_is_as_apples_programs_want_it(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mov", [picture()] * 2, codec="prores4444", alpha=True)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.codec_tag, stream.codec_context.profile) == ("ap4h", "4444")
        assert b"apl0" in bytes(next(container.demux(stream)))[:40]


@pytest.mark.parametrize(
    ("name", "codec", "said"),
    [
        ("a.mp4", None, "H.264 holds no transparency: let the name end in .mov, .mkv, .webm or .webp"),
        ("a.mov", "h265", "H.265 holds no transparency: choose prores4444 or animation"),
        ("a.mp4", "vp9", ".mp4 cannot hold VP9 with transparency: let the name end in .webm or .mkv"),
    ],
)
def test_what_holds_no_transparency_is_refused(name: str, codec: str | None, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        VideoWriter(tmp_path / name, *SIZE, 25, codec=codec, alpha=True)  # type: ignore[arg-type]
    assert said in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_alpha_is_rounded_and_not_dithered(tmp_path: Path) -> None:
    smooth = np.zeros((144, 192, 4), np.uint16)
    smooth[..., 3] = np.linspace(0, 65535, 192).round()[None]
    found = decoded(write(tmp_path / "animation.mov", [smooth], codec="animation", alpha=True), ".mov")
    assert np.array_equal(found[..., 3] >> 8, np.rint(smooth[..., 3] / 257))
    assert not found[..., :3].any()
