"""B-frames and open groups of pictures: frames are stored in another order than they are shown in."""

from pathlib import Path

import numpy as np
import pytest

from ar_demo.media.reader import VideoReader

from .. import clips


@pytest.mark.parametrize(
    ("gop", "chunk", "options"),
    [
        (12, 7, {}),
        (250, 5, {}),
        (12, 9, {"preset": "medium", "x264-params": "open-gop=1:bframes=3:scenecut=0"}),
        (1, 4, {}),
    ],
)
@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_backward_is_forward_reversed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, gop: int, chunk: int, options: dict[str, str], suffix: str
) -> None:
    rng = np.random.default_rng(0)
    images = [np.kron(rng.integers(0, 256, (8, 12, 3)), np.ones((8, 8, 1))).astype(np.uint8) for _ in range(50)]
    clip = clips.make_clip(tmp_path / f"b.{suffix}", images, gop=gop, options=options)
    monkeypatch.setattr("ar_demo.media.reader.BACKWARD_BYTES", chunk * 96 * 64 * 3 // 2)
    forward = list(VideoReader(clip).frames())
    for stop in (50, 31):
        backward = list(VideoReader(clip).backward(stop))
        assert [frame.index for frame in backward] == list(range(stop))[::-1]
        for a, b in zip(backward[::-1], forward[:stop], strict=True):
            assert a.time == b.time
            assert a.duration == b.duration
            assert np.array_equal(a.image, b.image)
