"""Where a video's frames are: their timestamps and key frames, by which a late frame is reached without the rest."""

from __future__ import annotations

import bisect
import logging
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av

from .decode import frame_rate, open_video
from .limits import check_count
from .sequences import ImageSequence

log = logging.getLogger(__name__)


@dataclass
class Index:
    """The frames of a video in the order they are shown; grows while it is decoded, or is made at once by `demux`.

    Attributes:
        pts: each frame's timestamp in ticks, None where the file has none.
        times: each frame's time in seconds.
        keys: indices of the key frames, from which decoding can begin.
        targets: of each key frame the timestamp to seek to, None where there is none.
        whole: whether these are all frames of the video.
    """

    pts: list[int | None] = field(default_factory=list)
    times: list[Fraction] = field(default_factory=list)
    keys: list[int] = field(default_factory=list)
    targets: list[int | None] = field(default_factory=list)
    whole: bool = False

    @staticmethod
    def of_pictures(count: int, rate: Fraction) -> Index:
        """Of pictures, each of which is a key frame and has its number as timestamp."""
        numbers = range(count)
        return Index([*numbers], [number / rate for number in numbers], [*numbers], [*numbers], whole=True)

    def __len__(self) -> int:
        return len(self.pts)

    def append(self, pts: int | None, time: Fraction, key: bool, target: int | None) -> None:
        """Adds the frame that is shown next."""
        if key:
            self.keys.append(len(self.pts))
            self.targets.append(target)
        self.times.append(time)
        self.pts.append(pts)

    def key_before(self, frame: int) -> tuple[int, int | None]:
        """The last key frame up to `frame` and the timestamp to seek to; (0, None) where there is none."""
        found = bisect.bisect_right(self.keys, frame)
        return (self.keys[found - 1], self.targets[found - 1]) if found else (0, None)

    def covers(self, stop: int | None) -> bool:
        """Whether all frames before `stop` are known; None: all of the video."""
        return self.whole or (stop is not None and stop <= len(self))

    def first(self, count: int) -> Index:
        """The first frames alone, of which it is not known whether they are all."""
        keys = bisect.bisect_left(self.keys, count)
        return Index(self.pts[:count], self.times[:count], self.keys[:keys], self.targets[:keys])


def demux(source: Path | ImageSequence) -> Index | None:
    """Reads a video's packets, without decoding them, into an index of its frames; of pictures it is known already.

    Frames that an edit list hides are left out, as decoding leaves them out. That each packet gives one frame cannot
    be known without decoding: whoever decodes compares.

    Returns:
        The index; None, and a line in the log, where packets do not tell the frames: some have no timestamp or
        another's, are marked as damaged, or come before the first key frame.

    Raises:
        InputError: as `open_video`.
    """
    if isinstance(source, ImageSequence):
        return Index.of_pictures(len(source.files), source.rate)
    container, stream = open_video(source)
    with container:
        base = stream.time_base or 1 / frame_rate(stream)
        # Seeking goes by pts in these, by dts in all others. (MP4's own times are dts, but an edit list moves them.)
        by_pts = any(name in container.format.name for name in ("matroska", "mp4"))
        found: list[tuple[int, bool, int | None]] = []
        reason = ""
        try:
            for count, packet in enumerate(container.demux(stream)):
                if packet.size == 0:  # the last one, which only says that there are no more
                    continue
                check_count(source, count + 1)
                if packet.pts is None:
                    reason = "packets have no timestamps"
                elif packet.is_corrupt:
                    reason = "packets are damaged"
                elif count == 0 and not packet.is_keyframe:
                    reason = "it does not begin with a key frame"
                if reason or packet.pts is None:
                    break
                if not packet.is_discard:
                    found.append((packet.pts, packet.is_keyframe, packet.pts if by_pts else packet.dts))
        except (av.FFmpegError, OSError):
            reason = "it breaks off"
    found.sort(key=lambda each: each[0])
    index = Index(whole=True)
    for pts, key, target in found:
        if index.pts and pts == index.pts[-1]:
            reason = "packets share timestamps"
        index.append(pts, pts * base, key, target)
    if reason or not found:
        log.info("%s cannot be searched by its packets (%s): it is decoded from the start", source.name, reason)
        return None
    return index
