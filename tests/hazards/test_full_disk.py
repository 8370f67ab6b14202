"""A disk that is full: one line, and nothing is left behind."""

import errno
import os
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from ar_demo.media.writer import VideoWriter
from hdn.errors import RunError

from .. import clips
from ..videos import write


class FullDisk:
    """A container that breaks off like one on a full disk."""

    def __init__(self, container: av.container.OutputContainer) -> None:
        self._container = container

    def mux(self, packet: object) -> None:
        raise av.error.OSError(errno.ENOSPC, "No space left on device")

    def close(self) -> None:
        self._container.close()


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    def fill() -> None:
        with VideoWriter(tmp_path / "a.mp4", 96, 64, Fraction(25)) as writer:
            writer._container = FullDisk(writer._container)  # type: ignore[assignment]
            for index, image in enumerate(clips.numbered(200)):
                writer.write(image, Fraction(index, 25))

    with pytest.raises(RunError, match="no space left") as caught:
        fill()
    assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
@pytest.mark.parametrize("count", [40, 80])  # full only when the file is finished, and while frames are written
def test_a_really_full_disk(tiny_disk: Path, suffix: str, count: int) -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (128, 192, 3), dtype=np.uint8) for _ in range(count)]
    with pytest.raises(RunError, match="no space left"):
        write(tiny_disk / f"a.{suffix}", images)
    assert os.listdir(tiny_disk) == []
