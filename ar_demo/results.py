"""What was made: the summary of a job."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .markup import items, table
from .pace import Latency
from .verdict import Verdict
from .words import counted


@dataclass
class Result:
    """What was made: the summary that `--json` prints.

    Attributes:
        output: the video written, None for none; layer, matte: what was laid on it by itself, and its alpha alone.
        frames: frames in it; states: how many of them were tracked, held, lost, over all surfaces.
        seconds: wall time of tracking and rendering; fps: frames per second of it.
        compositor: backend and renderer.
        warnings: what went differently from what was asked, one sentence each.
        surfaces: of each surface its ad, the states of its frames, and what is told of the light on it in its reference
            frame: the least gain, the most glare, whether they move on; None for nothing; and whether it is blank, so
            that colour and border tell what is in front of it.
        dropped: frames of a live source that came too fast; at_start: those of them that came before the first one was
            written, while surfaces were looked at; None where there was no such source.
        latency: of a live source's frames; None where there was none.
        verdict: whether the tracks can be believed unseen; None where they are not kept, as of a live source.
    """

    output: Path | None
    frames: int
    states: dict[str, int]
    seconds: float
    compositor: str
    warnings: list[str] = field(default_factory=list)
    surfaces: list[dict[str, Any]] = field(default_factory=list)
    dropped: int | None = None
    at_start: int | None = None
    latency: Latency | None = None
    layer: Path | None = None
    matte: Path | None = None
    verdict: Verdict | None = None

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
            **({} if self.verdict is None else {"verdict": self.verdict.summary()}),
            **({} if self.dropped is None else {"dropped": self.dropped, "dropped_at_start": self.at_start}),
            **({} if self.latency is None else {"latency_ms": self.latency.summary()}),
            "seconds": round(self.seconds, 3),
            "fps": round(self.fps, 2),
            "compositor": self.compositor,
            "warnings": self.warnings,
        }

    def _repr_html_(self) -> str:
        rows = [
            ("Written", ", ".join(map(str, self.outputs))),
            ("Frames", f"{self.frames}: " + ", ".join(f"{count} {state}" for state, count in self.states.items())),
            ("Time", f"{self.seconds:.1f} s, {self.fps:.1f} frames/s"),
            ("Drawn by", self.compositor),
        ]
        if self.verdict is not None:
            rows.append(("Verdict", str(self.verdict)))
        return f"{table(rows)}{items(self.warnings)}"


@dataclass
class Plan:
    """What would be done, after all checks: the summary of a dry run.

    Attributes:
        input: the video; size: (width, height) px; rate: frames per second; frames: None where it is not known.
        surfaces: of each its ad, the frame of its quad, the first and last frame that are tracked (None for the video's
            last), or, where it has a track, the states of its frames.
        outputs: files that would be written.
        warnings: what there is to say of the input.
    """

    input: Path
    size: tuple[int, int]
    rate: float
    frames: int | None
    surfaces: list[dict[str, Any]]
    outputs: list[Path]
    warnings: list[str]

    def lines(self) -> list[str]:
        """In words."""
        long = "" if self.frames is None else f", {counted(self.frames, 'frame')}"
        told = [f"{self.input}: {self.size[0]}x{self.size[1]}, {self.rate:.6g} frames/s{long}"]
        for number, surface in enumerate(self.surfaces, 1):
            if surface["states"] is None:
                last = "the last" if surface["last"] is None else surface["last"]
                how = f"corners in frame {surface['quad_frame']}, tracked from frame {surface['first']} to {last}"
            else:
                how = "has its track: " + ", ".join(f"{count} {state}" for state, count in surface["states"].items())
            told.append(f"  surface {number}, {surface['ad'] or 'no ad'}: {how}")
        return [*told, *(f"would write {path}" for path in self.outputs)]

    def summary(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return {
            "dry_run": True,
            "input": str(self.input),
            "width": self.size[0],
            "height": self.size[1],
            "fps": round(self.rate, 6),
            "frames": self.frames,
            "surfaces": self.surfaces,
            "outputs": [str(path) for path in self.outputs],
            "warnings": self.warnings,
        }


def total(counts: Iterable[dict[str, int]]) -> dict[str, int]:
    """The sum of counts by state."""
    summed: Counter[str] = Counter()
    for count in counts:
        summed.update(count)
    return dict(summed)
