"""ar-report: the verdict on a track, and the page that shows why."""

import json
from argparse import Namespace

from ..errors import InputError
from ..importing.loading import load_track
from ..media.limits import limited
from ..media.sequences import ImageSequence
from ..options import OutputOptions
from ..report.facts import settings
from ..report.report import Report, check_page
from ..session import claimed_output
from ..verdict import Limits
from .commands import reading_limits
from .defaults import load_defaults
from .jobs import limits_of
from .reporting import set_up_logging, warn


def report_command(given: Namespace) -> int:
    """ar-report, by what is given on its command line."""
    defaults = load_defaults()
    defaults.fill(given)
    log = set_up_logging("quiet" in given)
    if "composite" in given and "input" not in given:
        raise InputError("--composite does nothing without the video: name that as well")
    output = check_page(given.output if "output" in given else given.track.with_suffix(".html"))
    options = OutputOptions(overwrite="overwrite" in given or defaults.output().get("overwrite", False))
    video, composite = given.input if "input" in given else None, getattr(given, "composite", None)
    if video is not None:
        video = ImageSequence.find(video) or video
    limits = Limits(**defaults.limits() | limits_of(vars(given)))
    with (
        limited(*reading_limits(given)),
        claimed_output(output, options, given.track, video, composite) as claim,
    ):
        report = Report.of(
            load_track(given.track, video),
            video,
            composite,
            limits,
            settings=settings({"track": str(given.track)}, limits),
        )
        report.save(claim)
    if "json" in given:
        verdict = report.verdict.summary()
        print(json.dumps({"output": str(output), "verdict": verdict, "warnings": report.warnings}))
    else:
        print(f"{output}: {report.verdict}")
    return warn(report.warnings, log, "strict" in given, report.verdict)
