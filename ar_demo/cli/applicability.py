"""Options that cannot apply beside others are refused, never dropped."""

from argparse import Namespace
from collections.abc import Callable
from typing import NamedTuple

from ..errors import InputError

STDOUT = "-"


class Rule(NamedTuple):
    """Options that do nothing in some case, and why.

    Attributes:
        options: by their names in the parsed arguments.
        case: whether it is so, by the names of all that is given; `text` is how the case is called.
    """

    options: tuple[str, ...]
    text: str
    case: Callable[[Namespace], bool]
    reason: str


def _has(name: str) -> Callable[[Namespace], bool]:
    return lambda given: name in given


RULES = (
    Rule(
        ("ad", "quad", "find", "track", "keyframe", "surface", "region", "exclude"),
        "--job",
        _has("job"),
        "the job file has the surfaces",
    ),
    Rule(
        ("ad", "quad", "find", "track", "keyframe"), "--surface", _has("surface"), "it has an ad and corners of its own"
    ),
    Rule(("region", "exclude"), "--surface", _has("surface"), "each surface has its own: give them in a job file"),
    Rule(("quad", "snap", "start", "end", "region", "exclude"), "--track", _has("track"), "the track has its own"),
    Rule(
        ("quad", "start", "region", "exclude", "track", "keyframe"),
        "--find",
        _has("find"),
        "the picture says where the surface is",
    ),
    Rule(("find",), "--live", _has("live"), "the whole video is searched"),
    Rule(("first_frame",), "--job", _has("job"), "give it beside each track in the job file"),
    Rule(("track", "keyframe"), "--live", _has("live"), "frames are seen once, as they come"),
    Rule(("end",), "--time", _has("time"), "it has an end of its own"),
    Rule(("time",), "--live", _has("live"), "frames are seen once, as they come"),
    Rule(("dry_run",), "--live", _has("live"), "frames are seen once, as they come"),
    Rule(("progress",), "--dry-run", _has("dry_run"), "nothing is worked on"),
    Rule(
        ("report", "max_held", "max_lost", "fail_lost", "max_deviation"),
        "--live",
        _has("live"),
        "live tracks are not kept",
    ),
    Rule(("report",), "--frames", _has("frames"), "it is on the whole of a track: see ar-report"),
    Rule(("save_track",), "--live", _has("live"), "live tracks are not kept"),
    Rule(("max_frames",), "--live", _has("live"), "it goes on until Ctrl-C, or --end"),
    Rule(("fps",), "--live", _has("live"), "frames have the times at which they come"),
    Rule(
        ("layer", "save_matte", "alpha", "layer_codec", "start_number"),
        "--live",
        _has("live"),
        "a live output is a video alone",
    ),
    Rule(("frames",), "--live", _has("live"), "frames are seen once, as they come"),
    Rule(("parallel",), "--live", _has("live"), "frames are seen once, as they come"),
    Rule(("parallel",), "--frames", _has("frames"), "a part is rendered by one process"),
    Rule(("end",), "--frames", _has("frames"), "they have an end of their own"),
    Rule(("smooth",), "--live", _has("live"), "a 1 euro filter takes its place"),
    Rule(("first_light", "matte"), "--live", _has("live"), "frames are seen once, as they come"),
    Rule(("audio",), "--live", _has("live"), "a live output has no sound"),
    Rule(("streams", "location"), "--live", _has("live"), "a live output has the picture alone"),
    Rule(("depth", "tonemap"), "--live", _has("live"), "a live output has 8 bits, in SDR"),
    Rule(
        ("codec", "crf", "overwrite"),
        "-o -",
        lambda given: getattr(given, "output", None) == STDOUT,
        "standard output gets H.264 in MPEG-TS",
    ),
)


def inapplicable(given: Namespace) -> set[str]:
    """The options that would do nothing beside those that are given."""
    return {name for rule in RULES if rule.case(given) for name in rule.options}


def check_applicable(given: Namespace) -> None:
    """Raises InputError for an option that would do nothing beside the others that are given."""
    for rule in RULES:
        if rule.case(given):
            for name in rule.options:
                if name in given:
                    raise InputError(f"{flag(name)} and {rule.text} do not go together: {rule.reason}")
    for name, other in (("first_frame", "track"), ("format", "export"), ("size", "export"), ("lost_keys", "export")):
        if name in given and other not in given and not (name == "first_frame" and "export" in given):
            raise InputError(f"{flag(name)} does nothing without {flag(other)}: leave it out")
    if getattr(given, "output", None) == STDOUT and "live" not in given:
        raise InputError("only --live writes to standard output: name a file with -o")


def flag(name: str) -> str:
    """How an option is written on the command line."""
    named = {
        "ad": "an ad",
        "input": "an input",
        "playback": "--loop, --hold-last or --once",
        "location": "--no-location",
        "lost_keys": "--lost",
    }
    return named.get(name, "--" + name.replace("_", "-"))
