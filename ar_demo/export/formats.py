"""The formats that tracks are exported to, and those that other packages add."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

from ..choices import CHOICES
from ..errors import InputError
from . import after_effects, blender, csv_table, fusion, json_track, jsx, nuke, otio
from .keys import Keys

log = logging.getLogger(__name__)

GROUP = "ar_replace.exporters"  # of entry points
ALL_OPTIONS = ("first_frame", "lost_keys")


@dataclass(frozen=True)
class Exporter:
    """A format.

    Attributes:
        name: what `--format` calls it.
        suffixes: endings of its files, in lower case; the first that has one is what a file of that ending is.
        write: makes the file's text.
        first_frame: what the program calls the first frame of a video, where nobody says.
        options: those of `ExportOptions` that make a difference to it.
        timed: whether its keys have times, so that a variable frame rate is no matter.
    """

    name: str
    suffixes: tuple[str, ...]
    write: Callable[[Keys], str]
    first_frame: int = 0
    options: tuple[str, ...] = ALL_OPTIONS
    timed: bool = False


SIZED = (*ALL_OPTIONS, "size")

OURS = (
    Exporter("nuke", (".nk",), nuke.corner_pin, 1, SIZED),
    Exporter("nuke-tracker", (".nk",), nuke.tracker, 1),
    Exporter("nuke-stabilize", (".nk",), nuke.stabilise, 1),
    Exporter("ae", (".txt",), after_effects.corner_pin, 0, SIZED),
    Exporter("ae-power-pin", (".txt",), after_effects.power_pin, 0, SIZED),
    Exporter("ae-script", (".jsx",), jsx.corner_pin_script, timed=True),
    Exporter("fusion", (".setting",), fusion.setting),
    Exporter("blender", (".py",), blender.script, 1),
    Exporter("csv", (".csv",), csv_table.table, timed=True),
    Exporter("json", (".json",), json_track.track_file, options=(), timed=True),
    Exporter("otio", (".otio",), otio.timeline),
)
assert tuple(exporter.name for exporter in OURS) == CHOICES["format"]


@cache
def exporters() -> dict[str, Exporter]:
    """All formats by name: ours, then those of other packages, which take no name of ours."""
    found = {exporter.name: exporter for exporter in OURS}
    for point in entry_points(group=GROUP):
        try:
            exporter = point.load()
        except Exception as error:  # whatever another package does wrong
            log.warning("the exporter %s cannot be loaded (%s): it is left out", point.value, error)
            continue
        if not isinstance(exporter, Exporter):
            log.warning("the exporter %s is no ar_demo.Exporter: it is left out", point.value)
        elif exporter.name in found:
            log.warning("the exporter %s is called %s as another is: it is left out", point.value, exporter.name)
        else:
            found[exporter.name] = exporter
    return found


def choose(files: Sequence[Path], formats: Sequence[str] = ()) -> list[Exporter]:
    """The format of each file: of those named the one that has the file's ending, else the first of all that has it.

    A format named for a single file counts whatever the file's ending.

    Raises:
        InputError: a format or an ending that is unknown, or a format that fits none of the files.
    """
    known = exporters()
    for name in formats:
        if name not in known:
            raise InputError(f"format '{name}' is unknown: choose {', '.join(known)}")
    named = [known[name] for name in formats]
    if len(files) == len(named) == 1:
        return named
    chosen = []
    for file in files:
        fitting = (e for e in (*named, *known.values()) if file.suffix.lower() in e.suffixes)
        exporter = next(fitting, None)
        if exporter is None:
            endings = dict.fromkeys(suffix for e in known.values() for suffix in e.suffixes)
            raise InputError(
                f"{file}: no format is known by its ending: choose one of {', '.join(endings)}, or --format"
            )
        chosen.append(exporter)
    for exporter in named:
        if exporter not in chosen:
            raise InputError(f"format {exporter.name} is for {' or '.join(exporter.suffixes)}, and no file ends so")
    return chosen
