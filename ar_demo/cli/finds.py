"""ar-find: where and when a video shows pictures."""

import json
from argparse import Namespace
from typing import Any

from hdn.commandline import DONE

from ..errors import NotFound
from ..finding.search import Found
from ..media.limits import limited
from ..options import TrackingOptions
from ..session import Session
from ..surface import Moment, Span
from ..words import counted
from .commands import reading_limits, source_of
from .defaults import load_defaults
from .display import display_of
from .reporting import set_up_logging, warn


def find_command(given: Namespace) -> int:
    """ar-find, by what is given on its command line."""
    defaults = load_defaults()
    defaults.fill(given)
    log = set_up_logging("quiet" in given)
    said: dict[str, Any] = {name: getattr(given, name) for name in ("device", "weights") if name in given}
    if "end" in given:
        said["end"] = Moment.parse(given.end)
    if "time" in given:
        said["time"] = Span.parse(given.time)
    options = TrackingOptions(**defaults.tracking() | said)
    input = source_of(given.input, getattr(given, "fps", None))
    with (
        limited(*reading_limits(given)),
        display_of(given, renders=False) as display,
        Session(input, display) as session,
    ):
        found = session.find(given.pictures, options)
        warnings = session.reader.warnings
    print(json.dumps(found.summary()) if "json" in given else "\n".join(table(found)))
    status = warn(warnings, log, "strict" in given)
    return status if status != DONE or any(found.instances) else NotFound.exit_status


def table(found: Found) -> list[str]:
    """Where and when each picture is seen, a line for each stretch of frames; what is not seen comes last."""
    rows = [("picture", "frames", "seconds", "best", "score", "corners")]
    missing = []
    for number, (picture, copies) in enumerate(zip(found.pictures, found.instances, strict=True)):
        if not copies:
            missing.append(f"{picture.name} is not seen: {found.in_words(number)}")
        for count, copy in enumerate(copies, 1):
            for each in copy.appearances:
                best = each.best
                rows.append(
                    (
                        picture.name if len(copies) == 1 else f"{picture.name} ({count})",
                        f"{each.first.index}-{each.last.index}",
                        f"{float(each.first.time):.1f}-{float(each.last.time):.1f}",
                        str(best.index),
                        f"{best.score:.2f}",
                        " ".join(f"{x:.1f},{y:.1f}" for x, y in best.corners),
                    )
                )
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return [*(lines if len(rows) > 1 else []), *missing, f"{counted(found.looks, 'frame')} looked at"]
