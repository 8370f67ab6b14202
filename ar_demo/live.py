"""Live use: track, filter, draw and write each frame as it comes."""

import logging
import signal
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from fractions import Fraction
from pathlib import Path
from threading import Event, current_thread, main_thread
from types import FrameType
from typing import Any

import numpy as np

from hdn import Observation, Tracker
from hdn.imaging.arrays import Array

from .errors import InputError
from .media.live_stream import Stream
from .media.reader import Frame
from .media.sinks import StreamWriter, standard_output
from .media.writer import VideoWriter
from .options import Moment, Options
from .pipeline import Surface
from .progress import Progress, silent
from .rendering.loop import check_output
from .rendering.painting import Painter, check_ad
from .rendering.presentation import FADE_SECONDS
from .results import Result, total
from .scene.conditions import Appearance, Conditions
from .track import STATES
from .tracking.cuts import CutDetector
from .tracking.oneeuro import OneEuro
from .tracking.passes import load_trackers

log = logging.getLogger(__name__)

STDOUT = Path("-")


class _Target:
    """One surface, live."""

    def __init__(self, surface: Surface, tracker: Tracker, painter: Painter) -> None:
        self.ad, self.placing, self.tracker, self.painter = surface.ad, surface.placing, tracker, painter
        self.states: Counter[str] = Counter()
        self.started: Fraction | None = None
        self._filter = OneEuro()
        self._pose: Array = np.full((4, 2), np.nan)
        self._opacity, self._time = 0.0, Fraction(0)
        self._appearance: Appearance | None = None
        self._conditions: Conditions | None = None

    @property
    def counts(self) -> dict[str, int]:
        return {state: self.states[state] for state in STATES}

    def see(self, frame: Frame, seen: Observation, elapsed: Fraction, cut: bool) -> str:
        """Tracks the surface in a frame and draws on it; the state that it is in, '' before its start."""
        if self.started is None:
            if not self.placing.start.reached(frame.index, elapsed):
                return ""
            assert self.placing.quad is not None
            self.tracker.init(seen, self.placing.quad)
            self.started, self._opacity = elapsed, 1.0
            if self.placing.in_scene:
                self._appearance = Appearance(frame.image, self.placing.quad)
        if cut:
            self.tracker.lose()
            self._opacity = 0.0
        estimate = self.tracker.track(seen)
        self.states[estimate.state] += 1
        self._appear(estimate.state == "lost", elapsed, cut)
        if estimate.state == "lost":
            self._filter.reset()
        else:
            self._pose = self._filter(estimate.corners, float(frame.time))
        if self._appearance is not None:
            lost = estimate.state == "lost"
            self._conditions = self._appearance.conditions(frame.image, self._pose, estimate.deviation, lost, cut)
        return estimate.state

    def draw(self, frame: Frame, elapsed: Fraction) -> None:
        if self.started is not None:
            opacity = self._opacity * self.placing.opacity
            self.painter.draw(frame.image, self._pose, opacity, elapsed - self.started, self._conditions)

    def _appear(self, lost: bool, elapsed: Fraction, cut: bool) -> None:
        """Lets the ad come and go as `Placing.lost` says, as far as that can be without knowing what comes."""
        step = float(elapsed - self._time) / FADE_SECONDS
        self._time = elapsed
        if self.placing.lost == "hide" or (cut and not lost):
            self._opacity = float(not lost)
        elif not lost:
            self._opacity = min(1.0, self._opacity + step)
        elif self.placing.lost == "fade":
            self._opacity = max(0.0, self._opacity - step)


def replace_live(
    source: str, surfaces: Sequence[Surface], options: Options, output: Path | str, progress: Progress = silent
) -> Result:
    """Puts ads on surfaces of a live source until it ends, `options.end` is reached, or Ctrl-C is pressed.

    Each frame is written before the next one is taken; what comes meanwhile is dropped, but for the newest. A 1 euro
    filter takes the place of smoothing. There is no sound.

    Args:
        source: see `Stream`. surfaces: with their quads; tracks are not used.
        output: a video file, or '-' for H.264 in MPEG-TS on standard output.

    Returns:
        The summary; its frame rate is that of the frames written, and `dropped` counts the others.

    Raises:
        InputError: a source, an ad or a quad that cannot be used. RunError: the output cannot be written.
    """
    output = Path(output)
    if output != STDOUT:
        check_output(output, options, source, *(surface.ad for surface in surfaces))
    if any(surface.placing.quad is None or surface.placing.keyframes or surface.track for surface in surfaces):
        raise InputError("live tracking needs each surface's quad, and knows neither tracks nor keyframes: give --quad")
    if options.audio in ("ad", "mix"):
        raise InputError("a live output has no sound: leave --audio out")
    for surface in surfaces:
        check_ad(surface.ad, surface.placing)
    trackers = load_trackers(options, len(surfaces))
    cuts, frames, began = CutDetector(), 0, 0.0
    with ExitStack() as stack:
        stop = stack.enter_context(_interrupts())
        stream = stack.enter_context(Stream(source))
        size = stream.width, stream.height
        targets = []
        for surface, tracker in zip(surfaces, trackers, strict=True):
            assert surface.placing.quad is not None
            painter = Painter(surface.ad, surface.placing, surface.placing.quad, size, options.backend)
            targets.append(_Target(surface, tracker, stack.enter_context(painter)))
        writer = _open_output(output, stream, options)
        stack.enter_context(writer)
        log.info("live: %dx%d, without sound; Ctrl-C ends it", *size)
        zero = None
        for frame in stream.frames(stop):
            zero, began = (frame.time, time.perf_counter()) if zero is None else (zero, began)
            elapsed = frame.time - zero
            if options.end != Moment() and options.end.reached(frame.index, elapsed):
                stop.set()
            seen = Observation(frame.image)
            cut = cuts.is_cut(frames, seen.grey)
            states = [target.see(frame, seen, elapsed, cut) for target in targets]
            for target in targets:
                target.draw(frame, elapsed)
            writer.write(frame.image, frame.time)
            frames += 1
            progress("live", frames, None, states[0])
        if all(target.started is None for target in targets):
            raise InputError(f"start ({surfaces[0].placing.start}) was not reached: {source} had {frames} frames")
        seconds = time.perf_counter() - began
    return Result(
        output,
        frames,
        total(target.counts for target in targets),
        seconds,
        targets[0].painter.description,
        stream.warnings,
        [{"ad": target.ad and str(target.ad), "states": target.counts} for target in targets],
        stream.dropped,
    )


def _open_output(output: Path, stream: Stream, options: Options) -> VideoWriter | StreamWriter:
    if output == STDOUT:
        return StreamWriter(standard_output(), stream.width, stream.height, stream.rate, stream.time_base)
    return VideoWriter(
        output,
        stream.width,
        stream.height,
        stream.rate,
        codec=options.codec,
        crf=options.crf,
        time_base=stream.time_base,
        fast=True,
    )


@contextmanager
def _interrupts() -> Iterator[Event]:
    """An event that Ctrl-C and a request to terminate set; the second time they act as usual."""
    stop = Event()
    if current_thread() is not main_thread():
        yield stop  # signals come to the main thread only
        return
    usual: dict[int, Any] = {}

    def ask(number: int, frame: FrameType | None) -> None:
        stop.set()
        signal.signal(number, usual[number])

    for number in (int(signal.SIGINT), int(signal.SIGTERM)):
        usual[number] = signal.signal(number, ask)
    try:
        yield stop
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)
