"""The simulation of a farm: what is known by hand at its ends."""

from dataclasses import replace

import pytest

from ar_demo.batch.simulation import Costs, Farm, simulate, table

SURE = Farm(hours_between_failures=1e9, slow_share=0, scheduler_s=0, storage_bytes_s=1e18, worker_bytes_s=1e18)
COSTS = Costs()


def seconds(frames: int, segments: int) -> float:
    """Of one worker that nothing disturbs."""
    look = segments * COSTS.run_up_frames / 2 if segments > 1 else 0
    work = COSTS.track_start_s + COSTS.join_s + segments * COSTS.render_start_s
    work += (frames * (COSTS.track_ms + COSTS.render_ms + COSTS.join_ms) + look * COSTS.render_ms) / 1000
    return work / COSTS.cores


@pytest.mark.parametrize(("segment", "segments"), [(1800, 1), (300, 6)])
def test_one_worker_takes_the_sum_of_all_work(segment: int, segments: int) -> None:
    found = simulate(1, segment, SURE)
    assert found.hours * 3600 == pytest.approx(2 * seconds(54_000, segments))
    assert found.busy == pytest.approx(1)
    assert found.price == pytest.approx(found.hours * SURE.price_hour)


def test_workers_share_the_work() -> None:
    one, ten = (simulate(20, 300, replace(SURE, workers=number)).hours for number in (1, 10))
    assert one / 10 <= ten < 1.2 * one / 10


def test_failures_cost_time_and_nothing_is_lost() -> None:
    sure = simulate(50, 300, replace(SURE, workers=10))
    failing = simulate(50, 300, replace(SURE, workers=10, hours_between_failures=5))
    assert failing.failures > 5
    assert sure.hours < failing.hours < 1.5 * sure.hours
    assert failing.busy * failing.hours == pytest.approx(sure.busy * sure.hours)  # all work is done, and once


def test_storage_and_scheduler_set_a_limit() -> None:
    many = replace(SURE, workers=500)
    bytes_moved = 20 * 3600 * COSTS.frames_per_second * COSTS.frame_bytes * 5
    slow = simulate(20, 60, replace(many, storage_bytes_s=1e7))
    assert slow.hours * 3600 >= bytes_moved / 1e7
    tasks = 40 * (1 + 30 + 1)
    assert simulate(20, 60, replace(many, scheduler_s=2)).hours * 3600 >= 2 * tasks


def test_the_table_has_a_row_for_each() -> None:
    assert len(table(1, (300, 1800), (1, 2)).splitlines()) == 2 + 4
