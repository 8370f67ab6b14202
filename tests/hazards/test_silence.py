"""Files without sound, where sound is asked for."""

from pathlib import Path
from typing import Any

import av
import pytest

from ar_demo.media.streams import Streams

from .. import clips
from ..videos import clip, rewrite, sound_codecs


@pytest.mark.parametrize("mode", ["source", "ad", "mix"])
def test_silent_files_are_no_error(tmp_path: Path, mode: Any, caplog: pytest.LogCaptureFixture) -> None:
    source, ad = clip(tmp_path / "in.mp4", 1), clip(tmp_path / "ad.mp4", 1)
    output = rewrite(source, tmp_path / "out.mp4", Streams(mode, source, ad))
    assert sound_codecs(output) == []
    assert ("no sound" in caplog.text) == (mode != "source")  # a silent video that keeps its sound is as it was


def test_a_mix_with_a_silent_ad_copies_the_source(tmp_path: Path) -> None:
    source, ad = clip(tmp_path / "in.mp4", 1, sound=clips.tone(1)), clip(tmp_path / "ad.mp4", 1)
    output = rewrite(source, tmp_path / "out.mp4", Streams("mix", source, ad))
    assert {content for _, content in clips.sound_packets(output)} <= {
        content for _, content in clips.sound_packets(source)
    }


def test_an_image_has_no_sound(tmp_path: Path) -> None:
    source, ad = clip(tmp_path / "in.mp4", 1), tmp_path / "ad.png"
    av.VideoFrame.from_ndarray(clips.number_image(1), "rgb24").save(str(ad))
    assert sound_codecs(rewrite(source, tmp_path / "out.mp4", Streams("ad", source, ad))) == []
