"""A plain transcode, which others are measured by: `python -m ar_demo.evaluation.transcode IN OUT`.

The product's decoder and encoder with their settings, and nothing between: samples stay as they were decoded.
"""

import sys
from pathlib import Path

from ..media.decode import Clock, decode, frame_rate, open_video
from ..media.form import form_of
from ..media.outputs import open_output
from ..media.planes import Planes
from ..media.reader import VideoReader
from ..media.threads import behind
from ..media.writer import VideoWriter


def transcode(source: Path, target: Path) -> int:
    """Writes a video anew, and returns how many frames it has.

    Raises:
        InputError: it cannot be read, or is none whose samples stay as they are.
        RunError: it cannot be written.
    """
    with VideoReader(source) as reader:
        info = reader.info
    container, stream = open_video(source)
    rate = frame_rate(stream)
    clock, count = Clock(rate, stream.time_base or 1 / rate), 0
    with container, open_output(target, info, form_of(target, info, "auto", None)) as writer:
        assert isinstance(writer, VideoWriter)
        with behind(writer.copy) as copy:
            for frame in decode(container, stream, lambda _: None):
                copy(Planes(frame, info.rotation), clock.time(frame))
                count += 1
    return count


if __name__ == "__main__":
    transcode(*map(Path, sys.argv[1:3]))
