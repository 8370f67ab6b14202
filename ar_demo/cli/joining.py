"""ar-join, by what is given on its command line."""

import json
from argparse import Namespace
from dataclasses import fields
from pathlib import Path

from ..joining import join
from ..options import OutputOptions
from ..words import counted
from .defaults import load_defaults
from .reporting import set_up_logging, warn


def join_command(given: Namespace) -> int:
    """Joins the parts of a video."""
    defaults = load_defaults()
    defaults.fill(given)
    log = set_up_logging("quiet" in given)
    usual = {name: value for name, value in defaults.output().items() if name in ("streams", "location", "overwrite")}
    said = {f.name: getattr(given, f.name) for f in fields(OutputOptions) if f.name in given}
    joined = join(given.input, given.parts, Path(given.output), OutputOptions(**usual | said))
    if "json" in given:
        print(json.dumps({"output": str(given.output), "frames": joined.frames, "warnings": joined.warnings}))
    else:
        print(f"{given.output}: {counted(joined.frames, 'frame')} of {counted(len(given.parts), 'part')}")
    return warn(joined.warnings, log, "strict" in given)
