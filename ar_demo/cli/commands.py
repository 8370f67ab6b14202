"""Command lines: `ar-replace` and `ar-track`, thin skins over the Python functions of the same names."""

import argparse
import json
import logging
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from hdn.commandline import FAILED, Parser

from ..errors import InputError
from ..live import replace_live
from ..options import CHOICES, Keyframe, Moment, Options, parse_quad
from ..pipeline import Surface, default_output, replace_surfaces
from ..rendering.loop import check_output
from ..track import Track
from ..tracking.corrections import retrack
from ..tracking.passes import track
from ..tracking.smoothing import smooth
from .bar import Bar
from .jobs import load_job, placing


def replace_command(arguments: Sequence[str] | None) -> int:
    parser = Parser(
        prog="ar-replace",
        description="Put an ad (video, image or animated image) on a planar surface of a video.",
        epilog="Corners are pixels, x right and y down, in the frame that --start names. "
        "Exit status: 0 done, 1 failed while working, 2 wrong input.",
    )
    parser.add_argument("input", help="the video; with --live a camera (0, /dev/video0), a URL, or a file")
    parser.add_argument("ad", type=Path, nargs="?", help="video, image or animated image; not needed by some effects")
    parser.add_argument("-o", "--output", type=Path, help="video to write (default: INPUT.ar.mp4 beside the input)")
    parser.add_argument(
        "--save-track", type=Path, metavar="JSON", help="also write the track; of several NAME.1.json ..."
    )
    parser.add_argument(
        "--live",
        action="store_true",
        help="take frames as they come, dropping late ones, until Ctrl-C; -o is a file (default: live.mp4) or - for "
        "MPEG-TS on standard output",
    )
    group = parser.add_argument_group("several surfaces")
    group.add_argument(
        "--surface",
        nargs=5,
        action="append",
        metavar=("AD", "X,Y", "X,Y", "X,Y", "X,Y"),
        help="an ad (- where the effect needs none) and its corners; once for each surface, later ones on top",
    )
    group.add_argument("--job", type=Path, metavar="JSON", help="surfaces with options of their own, see the README")
    _add_tracking(parser, "render this track instead of tracking")
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
    group.add_argument(
        "--flat", action="store_true", help="lay the ad on as it is: not lit, blurred and hidden as the surface is"
    )
    group.add_argument("--effect", choices=CHOICES["effect"], default="replace", help="all but replace need no ad")
    group = parser.add_argument_group("the output")
    group.add_argument("--audio", choices=CHOICES["audio"], default="source", help="whose sound")
    group.add_argument("--backend", choices=CHOICES["backend"], default="auto", help="what composites")
    group.add_argument("--crf", type=float, help="quality, lower is better")
    group.add_argument("--codec", help="encoder by FFmpeg's name, such as libx264 or libx265")
    _add_common(parser)
    chosen = parser.parse_args(arguments)
    _set_up_logging(chosen.quiet)

    options = _options(chosen)
    surfaces = _surfaces(chosen, options)
    with Bar(chosen.quiet) as bar:
        if chosen.live:
            if chosen.save_track:
                raise InputError("live tracks are not kept: leave --save-track out")
            result = replace_live(chosen.input, surfaces, options, chosen.output or Path("live.mp4"), bar)
        else:
            output = chosen.output or default_output(Path(chosen.input))
            result = replace_surfaces(chosen.input, surfaces, options, output, bar, chosen.save_track)
    if chosen.json:
        print(json.dumps(result.summary()))
    else:
        dropped = "" if result.dropped is None else f", {result.dropped} dropped"
        print(
            f"{result.output}: {result.frames} frames ({_in_words(result.states)}), "
            f"{result.fps:.1f} frames/s{dropped}, {result.compositor}"
        )
        for number, surface in enumerate(result.surfaces if len(result.surfaces) > 1 else [], 1):
            print(f"  surface {number}, {surface['ad'] or 'no ad'}: {_in_words(surface['states'])}")
    return _warn(result.warnings, chosen.strict)


def track_command(arguments: Sequence[str] | None) -> int:
    parser = Parser(prog="ar-track", description="Track a planar surface of a video and write the track as JSON.")
    parser.add_argument("input", type=Path, help="the video")
    parser.add_argument("-o", "--output", type=Path, help="track file to write (default: INPUT.track.json)")
    _add_tracking(parser, "correct this track: track anew only next to keyframes that are new to it")
    _add_common(parser)
    chosen = parser.parse_args(arguments)
    _set_up_logging(chosen.quiet)
    known = Track.load(chosen.track) if chosen.track else None
    if known is None and chosen.quad is None:
        raise InputError("say where the surface is: --quad x,y x,y x,y x,y, or --track track.json")
    options = _options(chosen)
    output = chosen.output or chosen.input.with_name(f"{chosen.input.stem}.track.json")
    check_output(output, options, chosen.input)
    with Bar(chosen.quiet) as bar:
        if known is not None:
            result = retrack(chosen.input, known, options.keyframes, options, bar)
        else:
            result = smooth(track(chosen.input, options, bar), options.smooth)
    result.save(output)
    summary = {"output": str(output), "frames": len(result), "states": result.counts, "warnings": result.warnings}
    if chosen.json:
        print(json.dumps(summary))
    else:
        print(f"{output}: {len(result)} frames ({_in_words(result.counts)})")
    return _warn(result.warnings, chosen.strict)


def _add_tracking(parser: argparse.ArgumentParser, use_of_track: str) -> None:
    group = parser.add_argument_group("the surface")
    group.add_argument(
        "--quad", nargs=4, metavar="X,Y", help="its corners: top-left, top-right, bottom-right, bottom-left of the ad"
    )
    group.add_argument(
        "--start", default="0", metavar="WHEN", help="frame of the quad: number (120) or time (4.5s, 0:04.5)"
    )
    group.add_argument("--track", type=Path, metavar="JSON", help=use_of_track)
    group.add_argument(
        "--keyframe",
        action="append",
        default=[],
        metavar="WHEN:X,Y,X,Y,X,Y,X,Y",
        help="corners in another frame, which the track passes through; may be repeated",
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
    given["keyframes"] = tuple(map(Keyframe.parse, chosen.keyframe))
    return Options(**given)


def _surfaces(chosen: argparse.Namespace, options: Options) -> list[Surface]:
    """The surfaces in whichever of three ways they are given: --quad or --track, --surface, --job."""
    single = [name for name in ("ad", "quad", "track", "keyframe") if getattr(chosen, name)]
    several = [name for name in ("surface", "job") if getattr(chosen, name)]
    if len(several) + bool(several and single) > 1:
        given = ", ".join(name if name == "ad" else f"--{name}" for name in [*single, *several])
        raise InputError(f"{given} do not go together: give one surface, or several by --surface or by --job")
    if chosen.job:
        return load_job(chosen.job, options)
    if chosen.surface:
        return [
            Surface(None if ad == "-" else Path(ad), placing(options, quad=parse_quad(corners)))
            for ad, *corners in chosen.surface
        ]
    known = Track.load(chosen.track) if chosen.track else None
    if known is None and chosen.quad is None:
        raise InputError("say where the surface is: --quad x,y x,y x,y x,y, or --track track.json")
    return [Surface(chosen.ad, options, known)]


def _in_words(states: dict[str, int]) -> str:
    return ", ".join(f"{count} {state}" for state, count in states.items())


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
