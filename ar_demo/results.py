"""What was made: the summary of a job."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass
class Result:
    """What was made: the summary that `--json` prints.

    Attributes:
        output: the video written, None for none; layer, matte: what was laid on it by itself, and its alpha alone.
        frames: frames in it; states: how many of them were tracked, held, lost, over all surfaces.
        seconds: wall time of tracking and rendering; fps: frames per second of it.
        compositor: backend and renderer.
        warnings: what went differently from what was asked, one sentence each.
        surfaces: of each surface its ad and the states of its frames.
        dropped: frames of a live source that came too fast; None where there was no such source.
    """

    output: Path | None
    frames: int
    states: dict[str, int]
    seconds: float
    compositor: str
    warnings: list[str] = field(default_factory=list)
    surfaces: list[dict[str, Any]] = field(default_factory=list)
    dropped: int | None = None
    layer: Path | None = None
    matte: Path | None = None

    @property
    def outputs(self) -> list[Path]:
        """All files, or image sequences, written."""
        return [path for path in (self.output, self.layer, self.matte) if path is not None]

    @property
    def fps(self) -> float:
        return self.frames / max(self.seconds, 1e-9)

    def summary(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return {
            "output": None if self.output is None else str(self.output),
            **{name: str(path) for name, path in (("layer", self.layer), ("matte", self.matte)) if path is not None},
            "frames": self.frames,
            "states": self.states,
            "surfaces": self.surfaces,
            **({} if self.dropped is None else {"dropped": self.dropped}),
            "seconds": round(self.seconds, 3),
            "fps": round(self.fps, 2),
            "compositor": self.compositor,
            "warnings": self.warnings,
        }


def total(counts: Iterable[dict[str, int]]) -> dict[str, int]:
    """The sum of counts by state."""
    summed: Counter[str] = Counter()
    for count in counts:
        summed.update(count)
    return dict(summed)
