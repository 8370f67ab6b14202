"""Live use: track, filter, draw and write each frame as it comes."""

import logging
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

import numpy as np

from hdn import Observation
from hdn.imaging.arrays import Array, Picture
from hdn.networks.loading import shared_matte
from hdn.state import STATES, State

from .compositing.compositor import open_compositor
from .errors import InputError
from .media.claims import Claim
from .media.live_stream import Stream
from .media.reader import Frame
from .media.sinks import StreamWriter
from .media.threads import behind
from .media.writer import VideoWriter
from .options import OutputOptions, TrackingOptions
from .pace import Lateness, Pace
from .progress import Listener, Stage, silent
from .rendering.painting import Painter, check_ad
from .rendering.presentation import FADE_SECONDS
from .results import Result, total
from .scene.conditions import Appearance, Conditions
from .session import claimed_output
from .stopping import StopSignal
from .surface import Moment, Surface
from .tracking.cuts import CutDetector
from .tracking.oneeuro import OneEuro
from .tracking.protocol import MakeTracker, PlanarTracker, hdn_trackers
from .words import counted

log = logging.getLogger(__name__)

STDOUT = Path("-")
TOO_SLOW = "this machine is too slow for the source: light on the surface and what hides it were not measured"


class LiveSession:
    """Puts ads on surfaces of a live source.

    Each frame is drawn before the next one is taken, and encoded meanwhile; what comes while it is busy is dropped, but
    for the newest. A 1 euro filter takes the place of smoothing. Where there is no time for it, the surface's light and
    what hides it are not measured. There is no sound.
    """

    def __init__(
        self,
        source: str,
        surfaces: Sequence[Surface],
        listen: Listener = silent,
        make_tracker: MakeTracker | None = None,
    ) -> None:
        """Args:
            source: see `Stream`.
            surfaces: with their quads.
            listen: called after each frame.
            make_tracker: makes a tracker for each surface; None makes HDN's.

        Raises:
            InputError: a surface that live use cannot have, or an ad that cannot be read.
        """
        if any(surface.quad is None or surface.keyframes or surface.track for surface in surfaces):
            raise InputError(
                "live tracking needs each surface's quad, and knows neither tracks nor keyframes: give --quad"
            )
        for surface in surfaces:
            check_ad(surface)
        self.source, self.surfaces, self.listen = source, list(surfaces), listen
        self._make_tracker = make_tracker
        self._stop = StopSignal()

    def stop(self) -> None:
        """Ends `run` after the frame under way, its output being complete; may be called from any thread."""
        self._stop.set()

    def run(
        self,
        output: Path | str | BinaryIO,
        tracking: TrackingOptions | None = None,
        options: OutputOptions | None = None,
    ) -> Result:
        """Works until the source ends, `tracking.end` is reached, or `stop` is called.

        Args:
            output: a video file, or an open binary file that H.264 in MPEG-TS is written to.

        Returns:
            The summary; its frame rate is that of the frames written, and `dropped` counts the others.

        Raises:
            InputError: a source or a quad that cannot be used, an option that live use cannot keep.
            RunError: the output cannot be written.
        """
        tracking, options = tracking or TrackingOptions(), options or OutputOptions()
        if options.audio in ("ad", "mix"):
            raise InputError("a live output has no sound: leave --audio out")
        output = Path(output) if isinstance(output, str) else output
        make_tracker = self._make_tracker or hdn_trackers(tracking)
        cuts, frames, began, at_start = CutDetector(), 0, 0.0, 0
        late, warnings = Lateness(), []
        with ExitStack() as stack:
            inputs = self.source, *(surface.ad for surface in self.surfaces)
            sink = stack.enter_context(claimed_output(output, options, *inputs)) if isinstance(output, Path) else output
            stream = stack.enter_context(Stream(self.source))
            compositor = stack.enter_context(open_compositor(options.backend))
            targets = []
            for surface in self.surfaces:
                assert surface.quad is not None
                painter = Painter(surface, surface.quad, (stream.width, stream.height), compositor)
                targets.append(_Target(surface, make_tracker(), stack.enter_context(painter)))
            writer = _open_output(sink, stream, options)
            stack.enter_context(writer)

            def write(image: Picture, time: Fraction, came: float) -> None:
                writer.write(image, time)
                late.wrote(came, writer.packets)

            write_behind = stack.enter_context(behind(write, depth=1))
            pace, in_scene = Pace(float(1 / stream.rate)), any(surface.in_scene for surface in self.surfaces)
            log.info("live: %dx%d, without sound", stream.width, stream.height)
            show = Stage(self.listen, "live", 0, None)
            zero = None
            for frame in stream.frames(self._stop.event):
                taken = time.monotonic()
                zero, began = (frame.time, time.perf_counter()) if zero is None else (zero, began)
                elapsed = frame.time - zero
                if tracking.end != Moment() and tracking.end.reached(frame.index, elapsed):
                    self.stop()
                seen = Observation(frame.image)
                cut = cuts.is_cut(frames, seen.grey)
                states = tuple(target.see(frame, seen, elapsed, cut, pace.hurried) for target in targets)
                for target in targets:
                    target.draw(frame, elapsed)
                write_behind(frame.image, frame.time, stream.came)
                if frames == 0:
                    at_start = stream.dropped  # beginning takes its time
                elif in_scene:
                    self._keep_pace(pace, taken)
                frames += 1
                show(states, frame.image)
            if all(target.started is None for target in targets):
                raise InputError(
                    f"start ({self.surfaces[0].start}) was not reached: {self.source} had {counted(frames, 'frame')}"
                )
            seconds = time.perf_counter() - began
            if pace.count:
                warnings.append(f"{TOO_SLOW} in {pace.count} of {counted(frames, 'frame')}")
        return Result(
            output if isinstance(output, Path) else STDOUT,
            frames,
            total(target.counts for target in targets),
            seconds,
            compositor.description,
            [*stream.warnings, *warnings],
            [{"ad": target.surface.name, "states": target.counts} for target in targets],
            stream.dropped,
            at_start,
            late.told,
        )

    def _keep_pace(self, pace: Pace, taken: float) -> None:
        """Tells the pace how long a frame took that was taken at a time, and says what that leads to."""
        was_hurried, now = pace.hurried, time.monotonic()
        pace.took(now - taken, now)
        if pace.hurried and not was_hurried:
            log.warning("%s for a while; --flat leaves them out altogether", TOO_SLOW)


class _Target:
    """One surface, live."""

    def __init__(self, surface: Surface, tracker: PlanarTracker, painter: Painter) -> None:
        self.surface, self.tracker, self.painter = surface, tracker, painter
        self.states: Counter[str] = Counter()
        self.started: Fraction | None = None
        self._filter = OneEuro()
        self._pose: Array = np.full((4, 2), np.nan)
        self._opacity, self._time, self._index = 0.0, Fraction(0), 0
        self._appearance: Appearance | None = None
        self._conditions: Conditions | None = None

    @property
    def counts(self) -> dict[str, int]:
        return {state: self.states[state] for state in STATES}

    def see(self, frame: Frame, seen: Observation, elapsed: Fraction, cut: bool, hurried: bool) -> State | None:
        """Tracks the surface in a frame; the state that it is in, None before its start.

        Args: hurried: whether the last light stays, and nothing is measured of what the scene does to the surface.
        """
        if self.started is None:
            if not self.surface.start.reached(frame.index, elapsed):
                return None
            quad = self.surface.quad_in(seen)
            self.tracker.init(seen, quad, self.surface.tracking_region)
            self.started, self._opacity = elapsed, 1.0
            if self.surface.in_scene:
                self._appearance = Appearance(
                    frame.image,
                    quad,
                    shared_matte(),
                    self.surface.shutter,
                    grain=self.surface.grain == "auto",
                    softness=self.surface.softness == "auto",
                    kind=self.surface.surface_kind,
                )
        if cut:
            self.tracker.lose()
            self._opacity = 0.0
        estimate = self.tracker.track(seen)
        self.states[estimate.state] += 1
        lost = estimate.state == "lost"
        before = self._pose
        self._appear(lost, elapsed)
        if lost:
            self._filter.reset()
        else:
            self._pose = self._filter(estimate.corners, float(frame.time))
        if self._appearance is not None:
            motion = (self._pose - before) / max(frame.index - self._index, 1)
            self._conditions = self._appearance.conditions(
                frame.image, self._pose, estimate.deviation, lost or hurried, cut, motion
            )
        self._index = frame.index
        return estimate.state

    def draw(self, frame: Frame, elapsed: Fraction) -> None:
        if self.started is not None:
            opacity = self._opacity * self.surface.opacity
            self.painter.draw(frame.image, self._pose, opacity, elapsed - self.started, self._conditions)

    def _appear(self, lost: bool, elapsed: Fraction) -> None:
        """Lets the ad come and go as `Surface.lost` says, as far as that can be without knowing what comes."""
        step = float(elapsed - self._time) / FADE_SECONDS
        self._time = elapsed
        if not lost or self.surface.lost == "hide":
            self._opacity = float(not lost)
        elif self.surface.lost == "fade":
            self._opacity = max(0.0, self._opacity - step)


def _open_output(output: Claim | BinaryIO, stream: Stream, options: OutputOptions) -> VideoWriter | StreamWriter:
    if not isinstance(output, Claim):
        return StreamWriter(output, stream.width, stream.height, stream.rate, stream.time_base)
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
