"""What made a result: none is taken for that of other code or weights, and reports say where theirs are from."""

import hashlib
import os
import platform
import subprocess
from collections.abc import Iterable
from pathlib import Path

import cv2

from ..networks.weights import MATTE_FILE_NAME, shipped

HERE = Path(__file__).parent
ROOT = HERE.parents[1]  # the checkout, where there is one
# Parts of hdn that have nothing to do with tracking, by their path in it.
NOT_TRACKING = ("analysis", "benchmark", "networks/importing", "synthesis", "training")


def digest(files: Iterable[Path]) -> str:
    """16 hexadecimal digits that change with the names, places or contents of any of the files."""
    total = hashlib.sha256()
    for path in files:
        name = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name
        total.update(name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()[:16]


def sources(package: Path, without: Iterable[str] = ()) -> list[Path]:
    """The Python files of a package, in all of its folders.

    Args:
        without: what is left out, each a path from the package on, of a folder ("training") or a module ("cli/bar").
    """
    found = {path.relative_to(package).with_suffix(""): path for path in sorted(package.rglob("*.py"))}
    return [path for place, path in found.items() if not any(place.is_relative_to(other) for other in without)]


def tracker_sources() -> list[Path]:
    """The files of the `hdn` package that may have a part in tracking."""
    return sources(HERE.parent, NOT_TRACKING)


def frame_sources() -> list[Path]:
    """The files that make a sequence's frames of its source."""
    return [HERE / "sequences.py", HERE / "degradation.py"]


def made_by(weights: Path | None) -> str:
    """The digest of what makes a track besides the frames: one of ours with its weights, or a peer (None)."""
    files = [HERE / "trackers.py", *frame_sources()]
    if weights is None:
        return f"{digest([*files, *sources(HERE.parent / 'imaging')])}, OpenCV {cv2.__version__}"
    return digest([*files, *tracker_sources(), weights, shipped(MATTE_FILE_NAME)])


def machine() -> str:
    """The processor's name, how many cores there are, and how busy they are."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), name)
    except OSError:
        pass  # not Linux
    load = f", load {os.getloadavg()[0]:.1f} by other work" if hasattr(os, "getloadavg") else ""
    return f"{name}, {os.cpu_count()} cores{load}"


def commit() -> str:
    """The checkout's commit, and whether files differ from it; "unknown" where there is no git or no checkout."""
    try:
        head, changes = (
            subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True, timeout=30).stdout
            for words in (["rev-parse", "--short", "HEAD"], ["status", "--porcelain", "hdn", "ar_demo", "assets"])
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return head.strip() + (" with changes" if changes.strip() else "")
