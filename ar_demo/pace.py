"""How live work keeps up with its source: how late frames are, and whether there is time for all of the looks."""

import time
from array import array
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class PaceModel:
    """When the looks of a surface are left out; set by judgement.

    Work on a frame may take a share of the time until the next one comes; where the mean takes more, what costs and can
    be done without is left out for a while, which doubles each time.
    """

    busy_share: float = 0.9  # of a frame's time
    memory: float = 0.1  # weight of the newest frame in the mean
    most_intervals: float = 2.0  # that one frame counts for: a lone late one, as at a start, changes nothing
    pause_seconds: float = 10.0  # at first


MODEL = PaceModel()


@dataclass(frozen=True)
class Latency:
    """From when a frame was there (decoded, or due where a file is played at its pace) until it was in the output.

    Attributes:
        p50, p95, p99: ms, percentiles over all frames.
    """

    p50: float
    p95: float
    p99: float

    def summary(self) -> dict[str, Any]:
        """As JSON can hold it, ms."""
        return {name: round(value, 1) for name, value in vars(self).items()}


class Lateness:
    """Takes the times between a frame's coming and its packet's going."""

    def __init__(self) -> None:
        self._waiting: deque[float] = deque()  # when the frames came whose packets are still in the encoder
        self._seconds = array("f")

    def wrote(self, came: float, packets: int) -> None:
        """A frame was given to the encoder.

        Args:
            came: `time.monotonic` of when it was there.
            packets: that are in the output by now, one for each frame.
        """
        self._waiting.append(came)
        at = time.monotonic()
        while len(self._seconds) < packets and self._waiting:
            self._seconds.append(at - self._waiting.popleft())

    @property
    def told(self) -> Latency | None:
        """Over all frames whose packets left while others came; None where there is none."""
        if not self._seconds:
            return None
        return Latency(*(np.percentile(self._seconds, (50, 95, 99)) * 1000).tolist())


class Pace:
    """Whether there is time for all.

    Attributes:
        hurried: whether what can be left out is to be left out in the next frame.
        count: frames in which it was.
    """

    def __init__(self, interval: float) -> None:
        """Args: interval: seconds from one frame to the next."""
        self.hurried, self.count = False, 0
        self._interval, self._mean = interval, 0.0
        self._until, self._pause = 0.0, MODEL.pause_seconds

    def took(self, seconds: float, now: float) -> None:
        """A frame took so long, and it is `now`, seconds by any steady clock."""
        self.count += self.hurried
        self._mean += MODEL.memory * (min(seconds, MODEL.most_intervals * self._interval) - self._mean)
        if self.hurried and now >= self._until:
            self.hurried, self._mean = False, 0.0
        elif not self.hurried and self._mean > MODEL.busy_share * self._interval:
            self.hurried, self._until = True, now + self._pause
            self._pause *= 2
