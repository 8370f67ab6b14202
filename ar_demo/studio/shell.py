"""The command line that does what a project says, to be copied into a shell."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET

from ..cli.jobs import JobEntry, SurfaceEntry

PLAYBACK = {"loop": "--loop", "hold": "--hold-last", "once": "--once"}


def command(entry: JobEntry, job_file: Path, video: Path, output: Path) -> str:
    """The command line, quoted for a POSIX shell.

    It says it all where that is a single surface, and names the job file where that is more.

    Args:
        entry: what the job file says.
        video, output: where they are.
    """
    words = ["ar-replace"]
    if len(entry.surfaces) != 1 or not _is_placed(entry.surfaces[0]):
        words += ["--job", _name(job_file)]
    else:
        words.append(_name(video))
        surface = msgspec.to_builtins(entry.surfaces[0])
        ad = surface.pop("ad", None)
        if ad is not None:
            words.append(_name(job_file.parent / ad))
        if "track" in surface:
            words += ["--track", _name(job_file.parent / surface.pop("track"))]
        for name, value in surface.items():
            words += _option(name, value)
        for part in (entry.tracking, entry.rendering):
            for name, value in msgspec.to_builtins(part).items():
                value = _name(job_file.parent / value) if name == "weights" else value
                words += _option(name, value)
        if entry.fps is not UNSET:
            words += ["--fps", f"{entry.fps}"]
    return shlex.join([*words, "-o", _name(output)])


def _is_placed(surface: SurfaceEntry) -> bool:
    return surface.track is not UNSET or surface.quad is not UNSET


def _option(name: str, value: Any) -> list[str]:
    """An option of a job as the command line has it."""
    flag = "--" + name.replace("_", "-")
    if name == "playback":
        return [PLAYBACK[value]]
    if name == "location":
        return [] if value else ["--no-location"]
    if name == "exclude":
        return [word for polygon in value for word in (flag, *_corners(polygon))]
    if name == "keyframes":
        marked = ((keyframe["frame"], ",".join(_corners(keyframe["corners"]))) for keyframe in value)
        return [word for frame, corners in marked for word in ("--keyframe", f"{frame}:{corners}")]
    if name in ("quad", "region"):
        return [flag, *_corners(value)]
    if isinstance(value, bool):
        return [flag] if value else []
    return [] if value is None else [flag, f"{value}"]


def _corners(points: str | Sequence[Sequence[float]]) -> list[str]:
    return points.split() if isinstance(points, str) else [f"{x:.10g},{y:.10g}" for x, y in points]


def _name(path: Path) -> str:
    """A file as it is called from the current folder."""
    here = Path.cwd()
    path = path.relative_to(here) if path.is_absolute() and path.is_relative_to(here) else path
    return f"./{path}" if str(path).startswith("-") else str(path)
