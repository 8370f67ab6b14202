"""Picture and sound that begin late, or not together."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ar_demo.media.ad import open_ad
from ar_demo.media.audio import Audio

from .. import clips
from ..videos import clip, number_shown, rewrite


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
@pytest.mark.parametrize("mode", ["source", "mix"])
def test_sound_that_begins_late_stays_late(tmp_path: Path, suffix: str, mode: Any) -> None:
    source = clip(tmp_path / "in.mkv", sound=clips.clicks(1.2, [0.2]), sound_start=Fraction(4, 5))
    ad = clip(tmp_path / "ad.mp4", sound=clips.tone(2, amplitude=0.05))
    output = rewrite(source, tmp_path / f"out.{suffix}", Audio(mode, source, ad))
    assert np.allclose(clips.onsets(clips.read_sound(output)), [1.0], atol=0.005)


def test_a_file_that_does_not_begin_at_zero(tmp_path: Path) -> None:
    """MPEG transport streams begin anywhere: picture and sound move together."""
    times = [2 + Fraction(index, 25) for index in range(50)]
    source = clip(tmp_path / "in.ts", times=times, sound=clips.clicks(2, [0.5, 1.5]), sound_start=Fraction(2))
    begin = clips.frame_times(source)[0]
    assert begin > 1
    heard = np.array(clips.onsets(clips.read_sound(source))) - float(begin)
    output = rewrite(source, tmp_path / "out.mp4", Audio("source", source))
    assert clips.frame_times(output)[0] == 0
    assert np.allclose(clips.onsets(clips.read_sound(output)), heard, atol=0.005)


def test_an_ad_that_does_not_begin_at_zero(tmp_path: Path) -> None:
    times = [2 + Fraction(index, 25) for index in range(5)]
    path = clips.make_clip(tmp_path / "late.mkv", clips.numbered(5), times=times)
    with open_ad(path, "hold") as ad:
        assert ad.duration == Fraction(5, 25)
        assert [number_shown(ad, Fraction(index, 25)) for index in range(5)] == list(range(5))


def test_sound_longer_than_the_picture_does_not_delay_the_loop(tmp_path: Path) -> None:
    path = clips.make_clip(
        tmp_path / "s.webm", clips.numbered(10), codec="libvpx-vp9", sound=clips.tone(1), sound_codec="libopus"
    )
    assert open_ad(path).duration == Fraction(10, 25)
