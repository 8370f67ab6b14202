"""An encoder leaves the thread that opens it at the priority that it has."""

import os
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo.media.writer import VideoWriter


@pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="only Linux tells a thread's scheduling")
def test_an_encoder_takes_no_real_time_priority(tmp_path: Path) -> None:
    before = os.sched_getscheduler(0)
    with VideoWriter(tmp_path / "a.mp4", 64, 48, Fraction(25), codec="av1") as writer:
        for i in range(3):
            writer.write(np.full((48, 64, 3), 40 * i, np.uint8), Fraction(i, 25))
        assert os.sched_getscheduler(0) == before
    assert os.sched_getscheduler(0) == before
