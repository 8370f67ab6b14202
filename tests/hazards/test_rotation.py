"""Pictures that a player has to turn."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ar_demo.media.ad import open_ad
from ar_demo.media.reader import VideoReader

from .. import clips


@pytest.mark.parametrize("turn", [90, 180, 270])
def test_rotation_is_applied(tmp_path: Path, turn: int) -> None:
    upright = np.zeros((64, 96, 3), np.uint8)
    upright[:20, :30] = 255  # white at the top left
    stored = np.ascontiguousarray(np.rot90(upright, -turn // 90))
    reader = VideoReader(clips.make_clip(tmp_path / "r.mp4", [stored] * 3, rotation=turn))
    frame = next(reader.frames())
    assert (reader.info.width, reader.info.height, reader.info.rotation) == (96, 64, turn)
    assert frame.image.shape == (64, 96, 3)
    assert frame.image.flags.c_contiguous
    assert np.abs(frame.image.astype(int) - upright).mean() < 3


def test_rotated_video(tmp_path: Path) -> None:
    ad = open_ad(clips.make_clip(tmp_path / "r.mp4", clips.numbered(2), rotation=90))
    assert (ad.width, ad.height) == (64, 96)


def test_exif_orientation(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise by 90 degrees
    Image.new("RGB", (32, 24)).save(tmp_path / "e.jpg", exif=exif)
    ad = open_ad(tmp_path / "e.jpg")
    assert (ad.width, ad.height) == (24, 32)
