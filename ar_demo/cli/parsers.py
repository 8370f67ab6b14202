"""The arguments of the command lines. What is not given is absent, so that it can be told from a given default."""

import argparse
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from hdn.commandline import Parser, natural

from ..choices import CHOICES
from ..units import parse_bytes, parse_seconds

CORNER = r"\s*[^\s,]+,[^\s,.]+(\.\d*)?\s*"  # x,y and not a file's name with a comma in it
CORNERS = re.compile(f"({CORNER})+")
FIRST_FRAME = (
    "number of the video's first frame in other programs (default: an image sequence's, 1 in Nuke and Blender, else 0)"
)
T = TypeVar("T")
STATUSES = (
    "Exit status: 0 done, 1 failed while working, 2 wrong input, 3 a picture that is to be found is not seen; 130, 143 "
    "and 129 ended by Ctrl-C, SIGTERM and SIGHUP."
)
WITH_VERDICT = f"{STATUSES} With --strict also 4 and 5: the verdict on the track is check, or fail."
STRICT = "exit with 1 where there was a warning, as for a damaged input"
STRICT_WITH_VERDICT = f"{STRICT}, and with 4 or 5 by the verdict on the track"
REPORT = "also write a page by which the track can be judged without watching it all, see docs/report.md"


class _Parser(Parser):
    """Takes corners that follow each other as one argument, however they are quoted: 'x,y x,y ...'."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        words: list[str] = []
        for word in sys.argv[1:] if args is None else args:
            if words and CORNERS.fullmatch(word) and CORNERS.fullmatch(words[-1]):
                words[-1] += f" {word}"
            else:
                words.append(word)
        return super().parse_known_args(words, namespace)


def replace_parser() -> Parser:
    """Of ar-replace."""
    parser = _parser(
        "ar-replace",
        "Put an ad (video, image or animated image) on a planar surface of a video.",
        f"Corners are pixels, x right and y down, in the frame that --start names. {WITH_VERDICT}",
    )
    add = parser.add_argument
    add(
        "input",
        nargs="?",
        help="the video or its http(s) address, or pictures: a folder, in.%%05d.png, a glob in quotes; with --live a "
        "camera (0, /dev/video0), a URL, - for standard input, or a file",
    )
    add("ad", nargs="?", help="video, image or animated image; not needed by some effects")
    add("-o", "--output", help="video to write (default: INPUT.ar.mp4 beside the input)")
    add("--pick", action="store_true", help="do it all on a page in the browser, as ar-studio does")
    add("--save-track", type=Path, metavar="JSON", help="also write the track; of several NAME.1.json ...")
    add(
        "--layer",
        type=Path,
        metavar="OUT",
        help="write what is laid on the video by itself, with alpha: .mov, .webm, .mkv, .webp, or pictures as "
        "l.%%05d.png or .exr; with -o both, else it alone",
    )
    add("--save-matte", type=Path, metavar="OUT", help="write its alpha alone, white on black; likewise")
    add("--report", type=Path, metavar="HTML", help=REPORT)
    add(
        "--live",
        action="store_true",
        help="take frames as they come, dropping late ones, until Ctrl-C; -o is a file (default: live.mp4) or - for "
        "MPEG-TS on standard output",
    )
    add = parser.add_argument_group("several surfaces").add_argument
    add(
        "--surface",
        nargs=2,
        action="append",
        metavar=("AD", "X,Y X,Y X,Y X,Y"),
        help="an ad, or - for --effect, and its corners; once for each surface, later ones on top",
    )
    add("--job", type=Path, metavar="JSON", help="a job file: surfaces with options of their own, see the README")
    _add_progress(parser)
    _add_tracking(parser, "render this track instead of tracking", "PICTURE[=AD]")
    add = parser.add_argument_group("the ad").add_argument
    add("--fit", choices=CHOICES["fit"], help="how its shape is brought to the surface's (default: stretch)")
    for name, value, text in (
        ("--loop", "loop", "start a moving ad again when it is over (default)"),
        ("--hold-last", "hold", "hold its last frame"),
        ("--once", "once", "play it once, then show the surface"),
    ):
        add(name, dest="playback", action="store_const", const=value, help=text)
    add("--blend", choices=CHOICES["blend"], help="how its colours mix with the surface's (default: normal)")
    add("--opacity", type=float, metavar="0..1")
    add("--feather", type=float, metavar="PX", help="soft edge, px of the frame")
    add("--inset", type=float, metavar="PX", help="keep the ad so far within the quad, px of the quad's frame")
    add("--radius", type=float, metavar="PX", help="of rounded corners, px of the quad's frame")
    add("--lost", choices=CHOICES["lost"], help="the ad while the surface is lost (default: fade)")
    add("--flat", action="store_true", help="lay the ad on as it is: not lit, blurred and hidden as the surface is")
    add(
        "--shutter",
        type=_shutter,
        metavar="DEG",
        help="degrees of 360 that the camera's shutter is open, for blur along the motion; 0 for none (default: auto)",
    )
    add("--grain", choices=CHOICES["grain"], help="the video's grain on the ad (default: auto)")
    add("--softness", choices=CHOICES["softness"], help="the video's softness on the ad (default: auto)")
    add(
        "--first-light",
        choices=CHOICES["first_light"],
        help="shadows and glare of the quad's own frame: told from the video, or taken for none (default: auto)",
    )
    add(
        "--surface-kind",
        choices=CHOICES["surface_kind"],
        help="a screen shines by itself, the folds of cloth are shaded (default: print)",
    )
    add(
        "--matte",
        type=Path,
        metavar="PATH",
        help="what is in front, made elsewhere: video, image sequence or picture, black there and white where the ad "
        "may be seen, as --save-matte writes it (default: told from the video)",
    )
    add("--effect", choices=CHOICES["effect"], help="all but replace need no ad")
    add = parser.add_argument_group("the output").add_argument
    add("--audio", choices=CHOICES["audio"], help="whose sound (default: source)")
    _add_streams(add)
    add("--backend", choices=CHOICES["backend"], help="what draws (default: auto)")
    add("--crf", type=float, help="quality, lower is better")
    add(
        "--codec",
        help="h264, h265, av1, vp9, prores, prores4444, dnxhr, animation or ffv1 (default: the container's usual), or "
        "an encoder by FFmpeg's name",
    )
    add(
        "--depth",
        choices=CHOICES["depth"],
        help="bits a sample: 8, 10, 12; source: as many as it has, and its chroma; auto (default): as many, as "
        "far as the codec has them",
    )
    add("--tonemap", action="store_const", const=True, help="show an HDR source in SDR (default: it stays HDR)")
    add("--alpha", choices=CHOICES["alpha"], help="colours of the layer (default: straight; OpenEXR is premultiplied)")
    add(
        "--start-number", type=int, metavar="N", help="of image sequences that are written (default: the input's, or 0)"
    )
    add(
        "--frames",
        metavar="A-B",
        help="render these frames of a --track alone, by the numbers of their pictures; others that are there stay",
    )
    add("--layer-codec", metavar="CODEC", help="prores4444, animation, ffv1 or vp9 (default: the container's usual)")
    _add_verdict(parser)
    _add_common(parser, STRICT_WITH_VERDICT)
    return parser


def track_parser() -> Parser:
    """Of ar-track."""
    parser = _parser("ar-track", "Track a planar surface of a video and write the track as JSON.", WITH_VERDICT)
    parser.add_argument(
        "input", help="the video or its http(s) address, or pictures: a folder, in.%%05d.png, a glob in quotes"
    )
    parser.add_argument("-o", "--output", type=Path, help="track file to write (default: INPUT.track.json)")
    add = parser.add_argument
    add("--save-map", type=Path, metavar="PNG", help="also write a picture of the plane, put together from the video")
    add("--save-steady", type=Path, metavar="MP4", help="also write a video in which the surface stands still")
    add("--report", type=Path, metavar="HTML", help=REPORT)
    _add_progress(parser)
    _add_tracking(parser, "correct this track: track anew only next to keyframes that are new to it", "PICTURE")
    add = parser.add_argument_group("other programs").add_argument
    add(
        "--export",
        type=Path,
        action="append",
        metavar="FILE",
        help="also write the track for another program; may be repeated",
    )
    _add_export(add)
    _add_verdict(parser)
    _add_common(parser, STRICT_WITH_VERDICT)
    return parser


def export_parser() -> Parser:
    """Of ar-export."""
    parser = _parser("ar-export", "Write a track for other programs: Nuke, After Effects, Fusion, Blender.", STATUSES)
    add = parser.add_argument
    add("track", type=Path, help="the track file")
    add("files", type=Path, nargs="+", metavar="FILE", help="files to write, each of the format that its ending says")
    _add_export(add)
    add("--first-frame", type=int, metavar="N", help=FIRST_FRAME)
    _add_common(parser)
    return parser


def find_parser() -> Parser:
    """Of ar-find."""
    parser = _parser("ar-find", "Say where and when a video shows pictures.", STATUSES)
    add = parser.add_argument
    add("input", help="the video or its http(s) address, or pictures: a folder, in.%%05d.png, a glob in quotes")
    add("pictures", type=Path, nargs="+", metavar="PICTURE", help="what is looked for: pictures, or folders of them")
    add("--end", metavar="WHEN", help="last frame that is looked at: number (120) or time (4.5s, 0:04.5)")
    add("--time", metavar="A..B", help="look at this part only, as 10s..20s or 250..")
    _add_fps(add)
    _add_limits(add, "videos and pictures")
    _add_networks(add)
    _add_progress_kind(add)
    add("--strict", action="store_true", help="exit with 1 where there was a warning, as for a damaged input")
    add("--quiet", action="store_true", help="no log, and no progress but what --progress asks for")
    add("--json", action="store_true", help="print where and when each is seen as JSON, in place of a table")
    return parser


def join_parser() -> Parser:
    """Of ar-join."""
    parser = _parser(
        "ar-join",
        "Join parts of a video that ar-replace --frames rendered, without encoding them anew, and add its sound.",
        STATUSES,
    )
    add = parser.add_argument
    add("input", help="the video that the parts are of, whose sound and times the output gets")
    add("parts", type=Path, nargs="+", metavar="PART", help="the parts, in their order, rendered with the same options")
    add("-o", "--output", type=Path, required=True, help="video to write")
    add("--audio", choices=("source", "none"), help="whose sound (default: source)")
    _add_streams(add)
    add("--overwrite", action="store_true", help="replace an existing output")
    add("--strict", action="store_true", help=STRICT)
    add("--quiet", action="store_true", help="no log")
    add("--json", action="store_true", help="print a machine-readable summary")
    return parser


def report_parser() -> Parser:
    """Of ar-report."""
    parser = _parser(
        "ar-report",
        "Judge a track, and write a page that shows where it is to be looked at.",
        WITH_VERDICT,
    )
    add = parser.add_argument
    add("track", type=Path, help="the track file")
    add("input", nargs="?", help="the video that it was made of; without it the page has plots and no pictures")
    add("-o", "--output", type=Path, help="page to write (default: TRACK.html beside the track)")
    add("--composite", type=Path, metavar="VIDEO", help="what was rendered with it, for stills before and after")
    _add_verdict(parser)
    _add_limits(add, "videos")
    add("--overwrite", action="store_true", help="replace an existing page")
    add("--strict", action="store_true", help="exit with 4 where the verdict is check, and with 5 where it is fail")
    add("--quiet", action="store_true", help="no log")
    add("--json", action="store_true", help="print a machine-readable summary")
    return parser


def batch_parser() -> Parser:
    """Of ar-batch."""
    parser = _parser(
        "ar-batch", "Do many jobs of ar-replace, each as a process of its own, and go on where it was ended.", STATUSES
    )
    add = parser.add_argument
    add("manifest", type=Path, help="the jobs, as .yaml, .json, .toml or .csv; see docs/batch.md")
    add("--dry-run", action="store_true", help="print a shell command a line, one for each job, and do nothing")
    add("--workers", type=natural, metavar="N", help="jobs at a time (default: one for two cores)")
    add("--retries", type=_count, metavar="N", help="further tries of a job that failed while working (default: 1)")
    add("--time-limit", type=_seconds, metavar="TIME", help="that a job may take at most, as 90s, 10m or 1.5h")
    add("--memory-limit", type=_bytes, metavar="SIZE", help="that a job may take at most, as 4GB")
    add("--root", type=Path, metavar="FOLDER", help="refuse names of files that lead out of this folder")
    add(
        "--schemes",
        metavar="NAMES",
        help="addresses that jobs may read and write begin with one of these (default: https,s3,gs)",
    )
    add("--max-frames", type=natural, metavar="N", help="refuse videos and ads that have more frames, in every job")
    add("--max-pixels", type=natural, metavar="N", help="refuse those whose pictures have more pixels, in every job")
    add(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask cluster whose workers do the jobs, as tcp://host:8786, or its file (default: local)",
    )
    add("--resources", metavar="NAME=N", help="of a Dask worker that each job takes, as GPU=1")
    add("--cache", type=Path, metavar="FOLDER", help="for files from addresses (default: the system's)")
    add("--cache-size", type=_bytes, metavar="SIZE", help="that they may have together (default: 20GB)")
    add("--state", type=Path, metavar="FOLDER", help="what is done so far, and the summary (default: MANIFEST.batch)")
    add("--quiet", action="store_true", help="no log")
    add("--json", action="store_true", help="print a machine-readable summary")
    return parser


def studio_parser() -> Parser:
    """Of ar-studio."""
    parser = _parser(
        "ar-studio",
        "Pick surfaces, track, check, mend and render in a browser: a server for this machine alone.",
        f"What is done is kept in VIDEO.job.json beside the video; 'ar-replace --job' renders it anywhere. {STATUSES}",
    )
    add = parser.add_argument
    add("video", nargs="?", help="the video, or a job file (.json); without it the page shows the files to choose from")
    add("ad", nargs="?", help="video, image or animated image, for the first surface")
    add(
        "--root",
        type=Path,
        metavar="FOLDER",
        help="files in it may be chosen on the page (default: the current folder where no video is given, else none)",
    )
    add("--port", type=int, metavar="N", help="of the server (default: a free one)")
    add("--no-browser", action="store_true", help="open none; print the address only")
    _add_limits(add, "videos and ads")
    add("--quiet", action="store_true", help="no log")
    return parser


def _parser(name: str, description: str, epilog: str) -> Parser:
    parser = _Parser(name, description, epilog)
    parser.argument_default = argparse.SUPPRESS
    return parser


def _add_tracking(parser: Parser, use_of_track: str, find: str) -> None:
    add = parser.add_argument_group("the surface").add_argument
    add(
        "--quad",
        metavar="X,Y X,Y X,Y X,Y",
        help="its corners: top-left, top-right, bottom-right, bottom-left of the ad",
    )
    add(
        "--find",
        action="append",
        metavar=find,
        help="in place of the quad, a picture of the surface, or a folder of such, by which it is found in the video"
        + (", and the ad for it; may be repeated; every copy of it is replaced" if find != "PICTURE" else ""),
    )
    add("--snap", action="store_true", help="move the corners of the quad to clear edges a few pixels beside it")
    add(
        "--region",
        metavar="X,Y X,Y X,Y ...",
        help="polygon to track, in the frame of the quad: around it where more of its plane is seen, or smaller "
        "(default: found by the tracker)",
    )
    add(
        "--exclude",
        action="append",
        metavar="X,Y X,Y X,Y ...",
        help="polygon that tracking ignores, in the frame of the quad; may be repeated",
    )
    add("--start", metavar="WHEN", help="frame of the quad: number (120) or time (4.5s, 0:04.5); default 0")
    add(
        "--track",
        type=Path,
        metavar="FILE",
        help=f"{use_of_track}; also of Nuke (.nk), After Effects (.txt), or a .csv",
    )
    add("--first-frame", type=int, metavar="N", help=FIRST_FRAME)
    add(
        "--keyframe",
        action="append",
        metavar="WHEN:X,Y,X,Y,X,Y,X,Y",
        help="corners in another frame, as exact as a hand sets them; may be repeated",
    )
    add("--end", metavar="WHEN", help="last frame; later ones are left out")
    add("--time", metavar="A..B", help="track, and draw on, this part only, as 10s..20s or 250..; the rest is copied")
    add("--smooth", type=float, metavar="X", help="0 off, 1 by the track's noise (default), more is stronger")
    _add_fps(add)
    _add_limits(add, "videos and ads")
    _add_networks(add)


def _add_limits(add: Any, inputs: str) -> None:
    add("--max-frames", type=natural, metavar="N", help=f"refuse {inputs} that have more frames")
    add("--max-pixels", type=natural, metavar="N", help=f"refuse {inputs} whose pictures have more pixels")


def _add_fps(add: Any) -> None:
    add("--fps", metavar="N", help="frames a second of an image sequence: 24, 23.976, 30000/1001 (default: 25)")


def _add_networks(add: Any) -> None:
    add("--device", choices=CHOICES["device"], help="what runs the networks (default: auto)")
    add("--weights", type=Path, help="another weights file (.safetensors)")
    add(
        "--parallel",
        type=natural,
        metavar="N",
        help="processes that share the work on this machine: a video is cut at scene cuts and keyframes (default: 1)",
    )


def _add_streams(add: Any) -> None:
    add(
        "--streams",
        choices=CHOICES["streams"],
        help="all of the source's sound tracks, subtitles and data (default), or its first sound alone",
    )
    add(
        "--no-location",
        dest="location",
        action="store_const",
        const=False,
        help="leave out the place where the source was taken",
    )


def _add_export(add: Any) -> None:
    add(
        "--format",
        action="append",
        metavar="NAME",
        help=f"format of the files whose ending it has, or of a single file: {', '.join(CHOICES['format'])}, or one "
        "that another package adds; may be repeated",
    )
    add("--size", metavar="WxH", help="of the picture that will be pinned (default: the video's)")
    add(
        "--lost",
        dest="lost_keys",
        choices=CHOICES["lost_keys"],
        help="frames that the surface is lost in: hold the corners before (default), or omit",
    )


def _add_progress(parser: Parser) -> None:
    parser.add_argument(
        "--dry-run", action="store_true", help="check everything, say what would be done, and write nothing"
    )
    _add_progress_kind(parser.add_argument)


def _add_progress_kind(add: Any) -> None:
    add(
        "--progress",
        choices=CHOICES["progress"],
        help="a bar (default on a terminal), a line now and then (both on stderr), or JSON lines or the lines of Open "
        "Job Description (both on stdout)",
    )


def _add_verdict(parser: Parser) -> None:
    add = parser.add_argument_group("the verdict: what passes unseen").add_argument
    add("--max-held", metavar="SHARE", help="of the frames, that may be held (default: 50%%), else check")
    add("--max-lost", metavar="SHARE", help="of the frames, that may be lost (default: 0%%), else check")
    add("--fail-lost", metavar="SHARE", help="of lost frames, beyond which it fails (default: 50%%)")
    add(
        "--max-deviation",
        type=float,
        metavar="PX",
        help="standard deviation of the corners that no frame may exceed (default: 1.5; more, in proportion, where "
        "frames are larger than 1280 px), else check",
    )


def _add_common(parser: Parser, strict: str = STRICT) -> None:
    add = parser.add_argument
    add("--overwrite", action="store_true", help="replace an existing output")
    add("--strict", action="store_true", help=strict)
    add("--quiet", action="store_true", help="no log, and no progress but what --progress asks for")
    add("--json", action="store_true", help="print a machine-readable summary")


# The commands that people use every day; each has a manual page.
PARSERS = {
    "ar-replace": replace_parser,
    "ar-track": track_parser,
    "ar-export": export_parser,
    "ar-find": find_parser,
    "ar-join": join_parser,
    "ar-report": report_parser,
    "ar-batch": batch_parser,
    "ar-studio": studio_parser,
}


def _shutter(text: str) -> float | None:
    return None if text == "auto" else float(text)


def _count(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 0 on")
    return int(text)


def _seconds(text: str) -> float:
    return _said(parse_seconds, text)


def _bytes(text: str) -> int:
    return _said(parse_bytes, text)


def _said(parse: Callable[[str], T], text: str) -> T:
    """What a text says; argparse tells the reason of its own errors alone."""
    try:
        return parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
