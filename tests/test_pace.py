"""How late live frames are, and when looks are left out."""

import time

import pytest

from ar_demo.pace import MODEL, Lateness, Pace

INTERVAL = 1 / 30


def test_a_frame_is_late_until_its_packet_is_written() -> None:
    late, now = Lateness(), time.monotonic()
    late.wrote(now - 0.5, packets=0)  # the encoder keeps it
    assert late.told is None
    late.wrote(now - 0.1, packets=1)
    told = late.told
    assert told is not None
    assert told.p50 == told.p99 == pytest.approx(500, abs=100)


def test_what_can_be_left_out_is_where_frames_take_too_long_and_is_tried_again() -> None:
    pace, now = Pace(INTERVAL), 0.0
    for _ in range(100):
        pace.took(0.7 * INTERVAL, now)
    pace.took(3.0, now)  # one late frame, as at a start
    assert not pace.hurried
    pauses = []
    for _ in range(2):
        while not pace.hurried:
            pace.took(2 * INTERVAL, now)
        since = now
        while pace.hurried:
            now += INTERVAL
            pace.took(0.1 * INTERVAL, now)
        pauses.append(now - since)
    assert pauses == pytest.approx([MODEL.pause_seconds, 2 * MODEL.pause_seconds], abs=0.1)
    assert pace.count == pytest.approx(sum(pauses) / INTERVAL, abs=3)
