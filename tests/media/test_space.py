"""The guess of what an output takes, and the warning where there is less."""

import shutil
from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import pytest

from ar_demo.media.codecs import CODECS, PICTURES
from ar_demo.media.reader import VideoInfo, VideoReader
from ar_demo.media.space import BITS_PER_PIXEL, guess, warn_of_space

from ..clips import make_clip, numbered

Usage = namedtuple("Usage", "total used free")


@pytest.fixture(scope="module")
def info(tmp_path_factory: pytest.TempPathFactory) -> VideoInfo:
    with VideoReader(make_clip(tmp_path_factory.mktemp("clip") / "a.mp4", numbered(4))) as reader:
        return replace(reader.info, width=1920, height=1080, frames=1500)


def test_each_codec_of_the_table_has_its_guess() -> None:
    assert {codec.name for codec in (*CODECS, *PICTURES.values())} == BITS_PER_PIXEL.keys()


def test_a_minute_takes_what_it_usually_takes(info: VideoInfo) -> None:
    assert guess(Path("a.mp4"), None, info) == pytest.approx(54e6, rel=0.1)
    assert guess(Path("a.mov"), "prores", info) == pytest.approx(1.48e9, rel=0.1)
    assert guess(Path("a.mov"), None, info, alpha=True) == pytest.approx(2.1e9, rel=0.1)  # ProRes 4444
    assert guess(Path("a.%05d.exr"), None, info) == pytest.approx(8.6e9, rel=0.1)
    assert guess(Path("a.mp4"), None, replace(info, frames=None)) == 0


@pytest.mark.parametrize(("free", "warned"), [(10**9, 1), (10**10, 0)])
def test_warns_where_there_is_less(
    tmp_path: Path,
    info: VideoInfo,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    free: int,
    warned: int,
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: Usage(2 * free, free, free))
    warn_of_space(tmp_path / "a.mov", "prores", info)
    assert len(caplog.records) == warned
    assert all("may take about 1.5 GB, and its disk has 1 GB left" in record.getMessage() for record in caplog.records)
