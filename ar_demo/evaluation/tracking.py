"""`ar-eval-track`: `hdn-eval` with one tracker more, `ar-track`: the product's own tracking of the whole clip.

Other trackers get the frames one by one. `ar-track` has them all, as `ar_demo.track` does by default: passes in both
directions, and what follows them. The frames of a sequence, degraded where that is asked for, are written to a
temporary video without loss, so that what is tracked is a video as any user's.
"""

import logging
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import av
import numpy as np

from hdn.benchmark.cli import command
from hdn.benchmark.identity import digest, frame_sources, sources, tracker_sources
from hdn.benchmark.running import ClipTracker, Track
from hdn.benchmark.sequences import Sequence as Clip
from hdn.commandline import run
from hdn.imaging.arrays import Image
from hdn.networks.weights import MATTE_FILE_NAME, shipped

from ..errors import InputError, RunError
from ..options import TrackingOptions
from ..pipeline import track
from ..surface import Surface
from ..tracking.protocol import MakeTracker, hdn_trackers

log = logging.getLogger(__name__)

# Modules that have no part in tracking.
NO_PART = (
    "cli",
    "compositing",
    "evaluation",
    "export",
    "live",
    "markup",
    "progress",
    "rendering",
    "report",
    "scene",
    "verdict",
)
FPS = 30  # of the temporary video: data sets seldom tell the rate
LOSSLESS = {"preset": "ultrafast", "qp": "0"}  # of libx264rgb


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-eval-track."""
    sys.exit(run(_command, arguments, "finished tracks are kept, the same command goes on from there"))


def _command(arguments: Sequence[str] | None) -> int:
    return command(arguments, "ar-eval-track", ("ar-track", "hdn", "sift"), CLIP_TRACKERS)


def track_clip(clip: Clip, weights: Path | None) -> Track:
    """Tracks a sequence as the product does with default options; a target that it refuses is lost in every frame.

    Every frame's time is the same share of the whole, which includes reading the video.

    Raises:
        InputError: the frames cannot be read, differ in size, or there are fewer than two.
        RunError: tracking failed.
    """
    title = f"{clip.dataset}/{clip.name}"
    with TemporaryDirectory() as folder:
        video = Path(folder) / "clip.mkv"
        count = write_lossless(clip.frames(), video, title)
        if count < 2:
            raise InputError(f"{title} has fewer than two frames: there is nothing to track")
        if count < len(clip.truth):
            log.warning("ar-track on %s ends after %d frames, its truth after %d", title, count, len(clip.truth))
        make_tracker = _trackers(weights)
        start = perf_counter()
        try:
            found = track(video, Surface(quad=clip.quad), TrackingOptions(weights=weights), make_tracker=make_tracker)
        except InputError as error:
            log.warning("ar-track on %s counts as lost throughout: %s", title, error)
            corners = np.full((count, 4, 2), np.nan)
            corners[0] = clip.quad
            return Track(corners, ("tracked", *["lost"] * (count - 1)), np.zeros(count - 1))
        seconds = (perf_counter() - start) / (count - 1)
    if len(found) != count:
        raise RunError(f"ar-track on {title} gives {len(found)} frames of {count}")
    return Track(found.corners, tuple(found.states), np.full(count - 1, seconds))


def write_lossless(frames: Iterator[Image], path: Path, title: str) -> int:
    """Writes RGB frames (H, W, 3) to a video that gives back the very same; returns how many there were.

    Raises:
        InputError: frames of several sizes.
    """
    count = 0
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264rgb", rate=FPS, options=LOSSLESS)
        for frame in frames:
            if count == 0:
                stream.height, stream.width = frame.shape[:2]
                stream.pix_fmt = "rgb24"
            if frame.shape[:2] != (stream.height, stream.width):
                raise InputError(f"{title} has frames of several sizes, which no video has: track it with others")
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, "rgb24")))
            count += 1
        if count:
            container.mux(stream.encode())
    return count


def made_by(weights: Path | None) -> str:
    """The digest of what makes a track besides the frames."""
    package = Path(__file__).parents[1]
    code = [Path(__file__), *sources(package, NO_PART), *tracker_sources(), *frame_sources()]
    return digest([*code, weights or shipped(), shipped(MATTE_FILE_NAME)])


@cache
def _trackers(weights: Path | None) -> MakeTracker:
    """Networks loaded once a process: loading takes longer than tracking a short clip."""
    return hdn_trackers(TrackingOptions(weights=weights))


CLIP_TRACKERS = {"ar-track": ClipTracker(track_clip, made_by)}

if __name__ == "__main__":
    main()
