"""Inputs from others: pictures that unpack to gigabytes, clips without end, and playlists that name other files."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ar_demo.cli import entry
from ar_demo.errors import InputError
from ar_demo.media.ad import open_ad
from ar_demo.media.limits import BeyondLimits, limited
from ar_demo.media.reader import VideoReader

from ..clips import make_clip, numbered
from ..conftest import Run
from ..export.tracks import make

QUAD = "10,10 80,10 80,50 10,50"
PIXELS = 96 * 64


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return make_clip(tmp_path / "c.mp4", numbered(12))


@pytest.fixture
def bomb(tmp_path: Path) -> Path:
    """A picture of 64 megapixels in some kilobytes."""
    Image.new("L", (8000, 8000)).save(tmp_path / "bomb.png")
    assert (tmp_path / "bomb.png").stat().st_size < 100_000
    return tmp_path / "bomb.png"


def test_a_picture_of_too_many_pixels_is_refused_before_it_is_unpacked(bomb: Path, clip: Path) -> None:
    begin = time.process_time()
    with limited(pixels=PIXELS):
        with pytest.raises(BeyondLimits, match="has 8000x8000 pixels, and no more than 6144"):
            open_ad(bomb)
        with pytest.raises(BeyondLimits, match="has more than 6144 pixels"):
            VideoReader(bomb)
        with VideoReader(clip) as reader:
            assert sum(1 for _ in reader.frames()) == 12
    with limited(pixels=PIXELS - 1), pytest.raises(BeyondLimits, match="has 96x64 pixels"):
        VideoReader(clip)
    assert time.process_time() - begin < 2


def test_pictures_that_grow_on_the_way_are_refused(tmp_path: Path, bomb: Path) -> None:
    folder = tmp_path / "shot"
    folder.mkdir()
    for number in range(3):
        Image.new("L", (96, 64)).save(folder / f"{number}.png")
    bomb.rename(folder / "3.png")
    with limited(pixels=PIXELS), VideoReader(folder) as reader:
        assert sum(1 for _ in reader.frames()) <= 3
        assert any("damaged" in warning for warning in reader.warnings)


def test_a_clip_of_too_many_frames_is_refused(clip: Path) -> None:
    with limited(frames=12), VideoReader(clip) as reader:
        assert len(reader.times) == sum(1 for _ in reader.frames()) == 12
    with limited(frames=11):
        with VideoReader(clip) as reader, pytest.raises(BeyondLimits, match="more than 11 frames"):
            list(reader.frames())
        with VideoReader(clip) as reader, pytest.raises(BeyondLimits, match="more than 11 frames"):
            reader.times  # noqa: B018
    with VideoReader(clip) as reader:
        assert sum(1 for _ in reader.frames()) == 12


def test_an_animated_ad_of_too_many_frames_is_refused(tmp_path: Path) -> None:
    pictures = [Image.fromarray(np.full((20, 20, 3), 20 * n, np.uint8)) for n in range(8)]
    pictures[0].save(tmp_path / "ad.gif", save_all=True, append_images=pictures[1:])
    with limited(frames=7), pytest.raises(BeyondLimits, match="more than 7 frames"):
        open_ad(tmp_path / "ad.gif")


def test_the_command_line_has_both(run: Run, clip: Path, bomb: Path) -> None:
    for options in (["--max-frames", "11"], ["--max-pixels", "6143"]):
        status, _, err = run(clip, bomb, "--quad", QUAD, *options, "--flat")
        assert (status, err.count("\n")) == (2, 1)
        assert options[0] in err
    status, _, err = run(clip, bomb, "--quad", QUAD, "--max-pixels", "10000")
    assert status == 2
    assert "bomb.png has 8000x8000 pixels" in err


def test_ar_find_and_ar_report_have_both(run: Run, clip: Path, tmp_path: Path) -> None:
    track = make(np.tile(np.array([[10.0, 10], [80, 10], [80, 50], [10, 50]]), (12, 1, 1)), 96, 64)
    track.save(tmp_path / "t.json")
    poster = tmp_path / "poster.png"
    Image.fromarray(np.random.default_rng(1).integers(0, 255, (60, 90, 3), dtype=np.uint8)).save(poster)
    for options in (["--max-frames", "11"], ["--max-pixels", "6143"]):
        for main, inputs in ((entry.find_main, (clip, poster)), (entry.report_main, (tmp_path / "t.json", clip))):
            status, _, err = run(*inputs, *options, main=main)
            assert (status, err.count("\n")) == (2, 1)
            assert options[0] in err
    assert not (tmp_path / "t.html").exists()


@pytest.mark.parametrize("text", ["#EXTM3U\n#EXTINF:1,\n{}\n#EXT-X-ENDLIST\n", "ffconcat version 1.0\nfile {}\n"])
def test_a_playlist_does_not_choose_what_is_read(run: Run, clip: Path, tmp_path: Path, text: str) -> None:
    """Whatever it is called, and in the place of an ad, too."""
    playlist = tmp_path / "p.mp4"
    playlist.write_text(text.format(clip.name))
    with pytest.raises(InputError, match="is a playlist, which names other files"):
        VideoReader(playlist)
    status, out, _ = run(clip, playlist, "--quad", QUAD, "--dry-run", "--json")
    assert (status, out) == (2, "")
    assert json.dumps(str(clip))
