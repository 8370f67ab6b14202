"""What is no video or no ad is refused in one line."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ar_demo.media.ad import open_ad
from ar_demo.media.reader import VideoReader
from hdn.errors import InputError

from .. import clips


@pytest.mark.parametrize("kind", ["missing", "folder", "empty", "text", "garbage", "sound", "headless"])
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
        clips.make_sound(path, clips.tone(0.5))
    elif kind == "headless":  # the index, which MP4 keeps at its end, is cut off
        clips.truncated(clips.make_clip(path, clips.numbered(10)), 0.5)
    with pytest.raises(InputError) as caught:
        VideoReader(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["missing", "folder", "empty", "text", "sound", "cut image"])
def test_what_is_no_ad_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "x.mp4"
    if kind == "folder":
        path.mkdir()
    elif kind == "empty":
        path.touch()
    elif kind == "text":
        path.write_text("This is no ad.\n" * 50)
    elif kind == "sound":
        clips.make_sound(path, clips.tone(0.5))
    elif kind == "cut image":
        path = tmp_path / "x.png"
        Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 96, 3), dtype=np.uint8)).save(path)
        clips.truncated(path, 0.5)
    with pytest.raises(InputError) as caught:
        open_ad(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
