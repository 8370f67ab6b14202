"""ar-export, and what ar-track exports."""

import json
import re
from argparse import Namespace
from pathlib import Path

from ..errors import InputError
from ..export.exporting import ExportOptions, check_options, export_track
from ..export.formats import choose
from ..media.claims import check_different
from ..options import OutputOptions
from ..session import check_output
from ..tracks import Track
from ..words import counted
from .defaults import load_defaults
from .reporting import set_up_logging, warn


def export_command(given: Namespace) -> int:
    """ar-export, by what is given on its command line."""
    defaults = load_defaults()
    defaults.fill(given)
    log = set_up_logging("quiet" in given)
    overwrite = "overwrite" in given or defaults.output().get("overwrite", False)
    given.export = given.files
    files, options = exports_of(given)
    for file in files:
        check_output(file, OutputOptions(overwrite=overwrite), given.track)
    check_different(files)
    track = Track.load(given.track)
    warnings = export_track(track, files, getattr(given, "format", ()), options)
    if "json" in given:
        print(
            json.dumps(
                {
                    "outputs": [str(file) for file in files],
                    "frames": len(track),
                    "states": track.counts,
                    "warnings": warnings,
                }
            )
        )
    else:
        print(f"{', '.join(map(str, files))}: {counted(len(track), 'frame')}")
    return warn(warnings, log, "strict" in given)


def exports_of(given: Namespace) -> tuple[list[Path], ExportOptions]:
    """The files to export to, and how.

    Raises:
        InputError: an unknown format, or an option that makes no difference.
    """
    files: list[Path] = getattr(given, "export", [])
    values = {name: getattr(given, name) for name in ("first_frame", "lost_keys") if name in given}
    if "size" in given:
        values["size"] = parse_size(given.size)
    options = ExportOptions(**values)
    if files:
        check_options(choose(files, getattr(given, "format", ())), options)
    return files, options


def parse_size(text: str) -> tuple[int, int]:
    """Reads 'WxH'.

    Raises:
        InputError: it is something else.
    """
    match = re.fullmatch(r"(\d+)[x×](\d+)", text.strip())
    if match is None:
        raise InputError(f"size '{text}' is not WIDTHxHEIGHT: give it as in 1920x1080")
    return int(match[1]), int(match[2])
