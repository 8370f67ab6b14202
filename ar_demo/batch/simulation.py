"""How long hours of video take on many workers that fail now and then, by what one clip takes: an event simulation.

    python -m ar_demo.batch.simulation                   the table of docs/scale.md
    python -m ar_demo.batch.simulation --hours 10 --workers 4 --segment 300 ...

Each video is tracked by whichever worker is free, then rendered in segments by any, and these are joined. The scheduler
hands out one task after the other, and storage has so much to give and take in all. A worker that fails loses the task
that it is at, and is back after some time.
"""

import argparse
import heapq
import random
from dataclasses import dataclass
from itertools import count


@dataclass(frozen=True)
class Costs:
    """What work takes on one worker of two cores; measured with 1920x1080, see `docs/scale.md`.

    Attributes:
        track_ms, render_ms: processor time of a frame.
        track_start_s, render_start_s: processor time until the first frame.
        run_up_frames: that a part looks at before its own, each for half of a frame's rendering.
        join_s, join_ms: processor time of a join, and of each frame in it.
        frame_bytes: of the video; the output's frames are as large.
        cores: that a worker keeps busy, on average; processor time divided by that is the time it takes.
        frames_per_second: of the video.
    """

    track_ms: float = 29.0
    render_ms: float = 147.0
    track_start_s: float = 1.8
    render_start_s: float = 3.7
    run_up_frames: int = 50
    join_s: float = 0.9
    join_ms: float = 7.0
    frame_bytes: int = 28_000
    cores: float = 1.6
    frames_per_second: float = 30.0


@dataclass(frozen=True)
class Farm:
    """Who does the work.

    Attributes:
        workers: of two cores each.
        scheduler_s: that the scheduler takes for a task, one after the other.
        storage_bytes_s: that storage gives and takes in all. worker_bytes_s: that a worker does.
        hours_between_failures: of a worker, on average. repair_s: until it is back.
        slow_share, slow_factor: of the workers that take so many times as long.
        price_hour: dollars for a worker's hour.
    """

    workers: int = 1
    scheduler_s: float = 0.005
    storage_bytes_s: float = 1.25e9
    worker_bytes_s: float = 125e6
    hours_between_failures: float = 100.0
    repair_s: float = 300.0
    slow_share: float = 0.05
    slow_factor: float = 2.0
    price_hour: float = 0.085


@dataclass(frozen=True)
class Outcome:
    """What came of it: hours until all is done, dollars for an hour of video, shares of the workers' time, failures."""

    hours: float
    price: float
    busy: float
    waiting: float
    lost: float
    failures: int


def simulate(
    hours: float,
    segment_s: float,
    farm: Farm,
    costs: Costs | None = None,
    video_s: float = 1800.0,
    seed: int = 0,
) -> Outcome:
    """Some hours of video, in videos of `video_s` seconds, rendered in segments of `segment_s` seconds."""
    costs = costs or Costs()
    rng = random.Random(seed)
    tasks = _tasks(hours, segment_s, video_s, costs)
    speed = [farm.slow_factor if rng.random() < farm.slow_share else 1.0 for _ in range(farm.workers)]
    fails = [rng.expovariate(1 / (3600 * farm.hours_between_failures)) for _ in speed]
    free = [(0.0, worker) for worker in range(farm.workers)]
    heapq.heapify(free)
    order = count()
    ready: list[tuple[float, int, int, int]] = []  # when, number, video, stage
    left = []
    for video, stages in enumerate(tasks):
        left.append(len(stages[1]))
        heapq.heappush(ready, (0.0, next(order), video, 0))
    scheduler = storage = busy = waiting = lost = end = 0.0
    failures = 0
    while ready:
        possible, _, video, stage = heapq.heappop(ready)
        at, worker = heapq.heappop(free)
        begin = max(at, possible, scheduler)
        scheduler = begin + farm.scheduler_s
        begin = scheduler
        work, moved = tasks[video][stage][0]
        storage = max(storage, begin) + moved / farm.storage_bytes_s
        transfer = max(storage - begin, moved / farm.worker_bytes_s)
        done = begin + transfer + work / costs.cores * speed[worker]
        if fails[worker] < done:
            failed = max(fails[worker], begin)
            failures += 1
            lost += failed - begin
            back = failed + farm.repair_s
            fails[worker] = back + rng.expovariate(1 / (3600 * farm.hours_between_failures))
            heapq.heappush(free, (back, worker))
            heapq.heappush(ready, (failed, next(order), video, stage))
            continue
        busy += done - begin - transfer
        waiting += transfer
        end = max(end, done)
        heapq.heappush(free, (done, worker))
        if stage == 2:
            continue
        if stage == 0:
            for _ in tasks[video][1]:
                heapq.heappush(ready, (done, next(order), video, 1))
            continue
        left[video] -= 1
        if not left[video]:
            heapq.heappush(ready, (done, next(order), video, 2))
    paid = end * farm.workers
    price = paid / 3600 * farm.price_hour / hours
    return Outcome(end / 3600, price, busy / paid, waiting / paid, lost / paid, failures)


def _tasks(hours: float, segment_s: float, video_s: float, costs: Costs) -> list[list[list[tuple[float, float]]]]:
    """Of each video the tasks of each stage: processor time in seconds, and bytes that are moved."""
    videos = max(1, round(hours * 3600 / video_s))
    video_s = hours * 3600 / videos
    segments = max(1, round(video_s / segment_s))
    frames = video_s * costs.frames_per_second / segments
    whole, read = frames * segments, frames * costs.frame_bytes
    track = costs.track_start_s + whole * costs.track_ms / 1000, whole * costs.frame_bytes
    look = costs.run_up_frames / 2 if segments > 1 else 0
    render = costs.render_start_s + (frames + look) * costs.render_ms / 1000, 2 * read
    join = costs.join_s + whole * costs.join_ms / 1000, 2 * whole * costs.frame_bytes
    return [[[track], [render] * segments, [join]] for _ in range(videos)]


SEGMENTS_S = (10, 30, 100, 300, 1800)
WORKERS = (1, 10, 100, 1000)


def table(hours: float, segments: tuple[int, ...] = SEGMENTS_S, workers: tuple[int, ...] = WORKERS) -> str:
    """The outcomes in Markdown."""
    lines = [
        "| Workers | Segment | Time | $ per hour of video | Busy | Storage | Lost to failures | Failures |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for number in workers:
        for segment in segments:
            found = simulate(hours, segment, Farm(workers=number))
            shares = " | ".join(f"{100 * share:.1f} %" for share in (found.busy, found.waiting, found.lost))
            time = f"{found.hours / 24:.1f} days" if found.hours >= 48 else f"{found.hours:.2f} h"
            lines.append(f"| {number} | {segment} s | {time} | {found.price:.2f} | {shares} | {found.failures} |")
    return "\n".join(lines)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="How long many hours of video take on many workers.")
    parser.add_argument("--hours", type=float, default=1000.0, help="of video (default: 1000)")
    parser.add_argument("--workers", type=int, nargs="+", default=WORKERS, help="of two cores (default: 1 10 100 1000)")
    parser.add_argument("--segment", type=int, nargs="+", default=SEGMENTS_S, help="seconds of video in a task")
    given = parser.parse_args()
    print(table(given.hours, tuple(given.segment), tuple(given.workers)))


if __name__ == "__main__":
    main()
