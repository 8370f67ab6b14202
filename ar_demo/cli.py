"""Command lines: `ar-replace` and `ar-track`, thin skins over the Python functions of the same names."""

import argparse
import json
import logging
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from hdn.commandline import FAILED, Parser, run
from hdn.errors import InputError

from .options import CHOICES, Moment, Options, parse_quad
from .pipeline import replace
from .progress import Bar
from .rendering import check_output
from .smoothing import smooth
from .trackfile import Track
from .tracking import track

log = logging.getLogger("ar_demo")

LEFT_BEHIND = "nothing was written"


def replace_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-replace."""
    sys.exit(run(_replace, arguments, LEFT_BEHIND))


def track_main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ar-track."""
    sys.exit(run(_track, arguments, LEFT_BEHIND))


def _replace(arguments: Sequence[str] | None) -> int:
    parser = Parser(
        prog="ar-replace",
        description="Put an ad (video, image or animated image) on a planar surface of a video.",
        epilog="Corners are pixels, x right and y down, in the frame that --start names. "
        "Exit status: 0 done, 1 failed while working, 2 wrong input.",
    )
    parser.add_argument("input", type=Path, help="the video")
    parser.add_argument("ad", type=Path, nargs="?", help="video, image or animated image; not needed by some effects")
    parser.add_argument("-o", "--output", type=Path, help="video to write (default: INPUT.ar.mp4 beside the input)")
    parser.add_argument("--track", type=Path, metavar="JSON", help="render this track instead of tracking")
    parser.add_argument("--save-track", type=Path, metavar="JSON", help="also write the track")
    _add_tracking(parser)
    group = parser.add_argument_group("the ad")
    group.add_argument(
        "--fit", choices=CHOICES["fit"], default="stretch", help="how its shape is brought to the surface's"
    )
    playback = group.add_mutually_exclusive_group()
    for name, value, text in (
        ("--loop", "loop", "start a moving ad again when it is over (default)"),
        ("--hold-last", "hold", "hold its last frame"),
        ("--once", "once", "play it once, then show the surface"),
    ):
        playback.add_argument(name, dest="playback", action="store_const", const=value, default="loop", help=text)
    group.add_argument("--opacity", type=float, default=1.0, metavar="0..1")
    group.add_argument("--feather", type=float, default=0.0, metavar="PX", help="soft edge, px of the frame")
    group.add_argument("--lost", choices=CHOICES["lost"], default="fade", help="the ad while the surface is lost")
    group.add_argument("--effect", choices=CHOICES["effect"], default="replace", help="all but replace need no ad")
    group = parser.add_argument_group("the output")
    group.add_argument("--audio", choices=CHOICES["audio"], default="source", help="whose sound")
    group.add_argument("--backend", choices=CHOICES["backend"], default="auto", help="what composites")
    group.add_argument("--crf", type=float, help="quality, lower is better")
    group.add_argument("--codec", help="encoder by FFmpeg's name, such as libx264 or libx265")
    _add_common(parser)
    chosen = parser.parse_args(arguments)
    _set_up_logging(chosen.quiet)

    known = Track.load(chosen.track) if chosen.track else None
    if known is None and chosen.quad is None:
        raise InputError("say where the surface is: --quad x,y x,y x,y x,y, or --track track.json")
    options = _options(chosen)
    with Bar(chosen.quiet) as bar:
        result = replace(chosen.input, chosen.ad, options, chosen.output, known, bar, chosen.save_track)
    if chosen.json:
        print(json.dumps(result.summary()))
    else:
        states = ", ".join(f"{count} {state}" for state, count in result.states.items())
        print(f"{result.output}: {result.frames} frames ({states}), {result.fps:.1f} frames/s, {result.compositor}")
    return _warn(result.warnings, chosen.strict)


def _track(arguments: Sequence[str] | None) -> int:
    parser = Parser(prog="ar-track", description="Track a planar surface of a video and write the track as JSON.")
    parser.add_argument("input", type=Path, help="the video")
    parser.add_argument("-o", "--output", type=Path, help="track file to write (default: INPUT.track.json)")
    _add_tracking(parser)
    _add_common(parser)
    chosen = parser.parse_args(arguments)
    _set_up_logging(chosen.quiet)
    if chosen.quad is None:
        raise InputError("say where the surface is: --quad x,y x,y x,y x,y")
    options = _options(chosen)
    output = chosen.output or chosen.input.with_name(f"{chosen.input.stem}.track.json")
    check_output(output, options, chosen.input)
    with Bar(chosen.quiet) as bar:
        measured = track(chosen.input, options, bar)
    smooth(measured, options.smooth).save(output)
    summary = {"output": str(output), "frames": len(measured), "states": measured.counts, "warnings": measured.warnings}
    if chosen.json:
        print(json.dumps(summary))
    else:
        print(f"{output}: {len(measured)} frames ({', '.join(f'{n} {s}' for s, n in measured.counts.items())})")
    return _warn(measured.warnings, chosen.strict)


def _add_tracking(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("the surface")
    group.add_argument(
        "--quad", nargs=4, metavar="X,Y", help="its corners: top-left, top-right, bottom-right, bottom-left of the ad"
    )
    group.add_argument(
        "--start", default="0", metavar="WHEN", help="frame of the quad: number (120) or time (4.5s, 0:04.5)"
    )
    group.add_argument("--end", metavar="WHEN", help="last frame; later ones are left out")
    group.add_argument(
        "--smooth", type=float, default=1.0, metavar="X", help="0 off, 1 by the track's noise, more is stronger"
    )
    group.add_argument("--device", choices=CHOICES["device"], default="auto", help="what runs the networks")
    group.add_argument("--weights", type=Path, help="another weights file (.safetensors)")


def _add_common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--overwrite", action="store_true", help="replace an existing output")
    parser.add_argument(
        "--strict", action="store_true", help="exit with 1 where there was a warning, as for a damaged input"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress, no log")
    parser.add_argument("--json", action="store_true", help="print a machine-readable summary")


def _options(chosen: argparse.Namespace) -> Options:
    """The parsed arguments that are options, by name."""
    given: dict[str, Any] = {f.name: getattr(chosen, f.name) for f in fields(Options) if hasattr(chosen, f.name)}
    given["quad"] = parse_quad(chosen.quad) if chosen.quad else None
    given["start"] = Moment.parse(chosen.start)
    given["end"] = Moment.parse(chosen.end) if chosen.end else Moment()
    return Options(**given)


def _set_up_logging(quiet: bool) -> None:
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(levelname)s: %(message)s"))
    for name in ("ar_demo", "hdn"):
        logger = logging.getLogger(name)
        logger.handlers[:] = [handler]
        logger.setLevel(logging.ERROR if quiet else logging.INFO)


def _warn(warnings: list[str], strict: bool) -> int:
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)
    return FAILED if warnings and strict else 0
