"""Every option in every mode: either it makes a difference to what is done, or it is refused."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ar_demo.cli import commands, entry
from ar_demo.cli.parsers import replace_parser, track_parser
from ar_demo.media.limits import current
from ar_demo.results import Result
from ar_demo.surface import Surface
from ar_demo.tracks import Source, Track

from ..conftest import Run

QUAD = ["10,10", "90,10", "90,90", "10,90"]
# Where each kind of surface comes from, and where frames do: what is always given.
MODES = {
    "quad": ["in.mp4", "ad.png", "--quad", *QUAD],
    "track": ["in.mp4", "ad.png", "--track", "t.json"],
    "track to correct": ["in.mp4", "ad.png", "--track", "t.json", "--keyframe", "1:10,10,90,10,90,90,10,95"],
    "find": ["in.mp4", "ad.png", "--find", "poster.png"],
    "surfaces": ["in.mp4", "--surface", "ad.png", *QUAD],
    "job": ["in.mp4", "--job", "job.json"],
    "live": ["0", "ad.png", "--live", "--quad", *QUAD],
    "live surfaces": ["0", "--live", "--surface", "ad.png", *QUAD],
    "live on standard output": ["0", "ad.png", "--live", "--quad", *QUAD, "-o", "-"],
}
OPTIONS: dict[str, list[str]] = {
    "output": ["-o", "other.mp4"],
    "ad": [],
    "pick": ["--pick"],
    "save_track": ["--save-track", "s.json"],
    "live": ["--live"],
    "surface": ["--surface", "b.png", *QUAD],
    "job": ["--job", "job.json"],
    "quad": ["--quad", "20,10", *QUAD[1:]],
    "find": ["--find", "other.png"],
    "snap": ["--snap"],
    "start": ["--start", "1"],
    "region": ["--region", "5,5", "95,5", "50,95"],
    "exclude": ["--exclude", "20,20", "30,20", "30,30"],
    "track": ["--track", "t.json"],
    "first_frame": ["--first-frame", "1001"],
    "keyframe": ["--keyframe", "2:10,10,90,10,90,90,10,99"],
    "end": ["--end", "1"],
    "time": ["--time", "1..2"],
    "smooth": ["--smooth", "2"],
    "device": ["--device", "cpu"],
    "weights": ["--weights", "w.safetensors"],
    "fit": ["--fit", "cover"],
    "playback": ["--once"],
    "blend": ["--blend", "screen"],
    "opacity": ["--opacity", "0.5"],
    "feather": ["--feather", "3"],
    "inset": ["--inset", "2"],
    "radius": ["--radius", "5"],
    "lost": ["--lost", "hide"],
    "flat": ["--flat"],
    "shutter": ["--shutter", "180"],
    "grain": ["--grain", "off"],
    "softness": ["--softness", "off"],
    "first_light": ["--first-light", "even"],
    "surface_kind": ["--surface-kind", "cloth"],
    "matte": ["--matte", "roto.mov"],
    "effect": ["--effect", "mosaic"],
    "audio": ["--audio", "mix"],
    "streams": ["--streams", "first"],
    "location": ["--no-location"],
    "backend": ["--backend", "opencv"],
    "crf": ["--crf", "30"],
    "codec": ["--codec", "libx265"],
    "depth": ["--depth", "source"],
    "fps": ["--fps", "24"],
    "tonemap": ["--tonemap"],
    "layer": ["--layer", "l.mov"],
    "save_matte": ["--save-matte", "m.%04d.png"],
    "alpha": ["--alpha", "premultiplied"],
    "layer_codec": ["--layer-codec", "animation"],
    "start_number": ["--start-number", "1001"],
    "frames": ["--frames", "1-2"],
    "max_frames": ["--max-frames", "1000"],
    "max_pixels": ["--max-pixels", "1000000"],
    "overwrite": ["--overwrite"],
    "report": ["--report", "r.html"],
    "max_held": ["--max-held", "10%"],
    "max_lost": ["--max-lost", "0.3"],
    "fail_lost": ["--fail-lost", "90%"],
    "max_deviation": ["--max-deviation", "2.5"],
    "parallel": ["--parallel", "2"],
}
OF_BOTH = (
    "report",
    "max_held",
    "max_lost",
    "fail_lost",
    "max_deviation",
    "fps",
    "first_frame",
    "quad",
    "find",
    "snap",
    "start",
    "region",
    "exclude",
    "track",
    "keyframe",
    "time",
    "end",
    "smooth",
    "device",
    "weights",
    "max_frames",
    "max_pixels",
    "parallel",
)
OPTIONS_OF_TRACK = {name: OPTIONS[name] for name in OF_BOTH} | {
    "save_map": ["--save-map", "map.png"],
    "save_steady": ["--save-steady", "steady.mp4"],
    "export": ["--export", "pin.nk"],
    "format": ["--format", "nuke"],
    "size": ["--size", "40x30"],
    "lost_keys": ["--lost", "omit"],
}
# What is said about the work, and not what is done.
REPORTING = {"help", "version", "print_completion", "progress", "dry_run", "strict", "quiet", "json", "input"}


@pytest.fixture
def done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the commands ask for, in place of doing it; the folder has the files that are named."""
    asked: list[Any] = []

    def surfaces(given: Any) -> list[Any]:
        return [(vars(s) | {"track": s.track is not None}) for s in ([given] if isinstance(given, Surface) else given)]

    def replace(
        input: Any, given: Any, output: Any, tracking: Any, options: Any, bar: Any, save_track: Any, **others: Any
    ) -> Result:
        asked.append(("replace", input, surfaces(given), output, tracking, options, (save_track, others), current()))
        return Result(Path("o.mp4"), 1, {}, 1.0, "", surfaces=[{}])

    class Live:
        def __init__(self, source: str, given: Any, bar: Any) -> None:
            self.asked = ["live", source, surfaces(given)]

        def stop(self) -> None: ...

        def run(self, output: Any, tracking: Any, options: Any) -> Result:
            asked.append((*self.asked, "-" if isinstance(output, io.BytesIO) else output, tracking, options, current()))
            return Result(Path("o.mp4"), 1, {}, 1.0, "", surfaces=[{}])

    def track(input: Any, surface: Any, tracking: Any, bar: Any, **others: Any) -> Any:
        asked.append(("track", input, surfaces(surface), tracking, others, current()))
        return Track.load("t.json")

    for name, stand_in in (("replace", replace), ("LiveSession", Live), ("track", track)):
        monkeypatch.setattr(commands, name, stand_in)
    monkeypatch.setattr(commands, "export_track", lambda track, *others: asked.append(("export", *others)) or [])
    monkeypatch.setattr(commands, "standard_output", io.BytesIO)
    monkeypatch.setattr(commands, "_check_strict", lambda given, input: None)  # which looks into the video
    monkeypatch.chdir(tmp_path)
    quad = np.array([[10.0, 10], [90, 10], [90, 90], [10, 90]])
    times = [np.float64(i / 25) for i in range(4)]
    source = Source("in.mp4", 100, 100, 25, 4)  # type: ignore[arg-type]
    Track(source, 0, quad, times, np.repeat(quad[None], 4, 0), ["tracked"] * 4, np.ones(4), np.ones(4)).save("t.json")  # type: ignore[arg-type]
    Path("job.json").write_text('{"version": 1, "surfaces": [{"ad": "a.png", "quad": "10,10 90,10 90,90 10,90"}]}')
    return asked


def test_all_options_are_tried() -> None:
    assert {action.dest for action in replace_parser()._actions} == REPORTING | OPTIONS.keys()
    alike = {"output", "overwrite"}  # the track file's; tried with the command lines
    assert {action.dest for action in track_parser()._actions} == REPORTING | OPTIONS_OF_TRACK.keys() | alike


@pytest.mark.parametrize("option", OPTIONS)
@pytest.mark.parametrize("mode", MODES)
def test_an_option_of_ar_replace_counts_or_is_refused(run: Run, done: list[Any], mode: str, option: str) -> None:
    usual = MODES[mode]
    arguments = [*usual, *OPTIONS[option]]
    if option == "ad" and "ad.png" not in usual[:2]:
        arguments.insert(1, "ad.png")
    elif any(argument in usual for argument in OPTIONS[option][:1] or ["ad.png"]):
        return  # it is what makes the mode
    run(*usual)
    code, _, err = run(*arguments)
    if code == 2:
        assert err.count("\n") == 1
        assert len(done) == 1
    else:
        assert code == 0, err
        before, after = map(repr, done)
        assert before != after, f"{option} made no difference"


@pytest.mark.parametrize("option", OPTIONS_OF_TRACK)
@pytest.mark.parametrize("mode", ["quad", "find", "track", "track to correct"])
def test_an_option_of_ar_track_counts_or_is_refused(run: Run, done: list[Any], mode: str, option: str) -> None:
    usual = [a for a in MODES[mode] if a != "ad.png"]
    arguments = OPTIONS_OF_TRACK[option]
    if arguments[0] in usual:
        return
    run(*usual, "--overwrite", main=entry.track_main)
    code, _, err = run(*usual, *arguments, "--overwrite", main=entry.track_main)
    if code == 2:
        assert err.count("\n") == 1
    else:
        assert repr(done[:1]) != repr(done[1:])


@pytest.mark.parametrize(
    "arguments",
    [
        ["in.mp4", "ad.png", "--job", "job.json"],
        ["in.mp4", "--job", "job.json", "--surface", "a.png", *QUAD],
        ["in.mp4", "--surface", "a.png", *QUAD, "--quad", *QUAD],
        ["in.mp4", "--job", "job.json", "--keyframe", "4:1,2,3,4,5,6,7,8"],
        ["in.mp4", "ad.png", "--track", "t.json", "--end", "3"],
        ["in.mp4", "ad.png", "--track", "t.json", "--quad", *QUAD],
        ["in.mp4", "ad.png", "--track", "t.json", "--region", *QUAD],
        ["in.mp4", "--surface", "a.png", *QUAD, "--exclude", *QUAD],
        ["in.mp4", "--job", "job.json", "--region", *QUAD],
        ["0", "ad.png", "--live", "--quad", *QUAD, "-o", "-", "--codec", "libx264"],
        ["0", "ad.png", "--live", "--quad", *QUAD, "-o", "-", "--crf", "20"],
        ["0", "ad.png", "--live", "--quad", *QUAD, "--save-track", "t.json"],
    ],
)
def test_what_does_not_go_together(run: Run, done: list[Any], arguments: list[str]) -> None:
    code, _, err = run(*arguments)
    assert (code, done) == (2, [])
    assert "do not go together" in err


def test_options_of_tracking_do_nothing_for_a_complete_track(run: Run, done: list[Any]) -> None:
    code, _, err = run(*MODES["track"], "--smooth", "2")
    assert (code, done) == (2, [])
    assert "--smooth does nothing, for the track is complete" in err


@pytest.mark.parametrize(
    "corners",
    [
        ["10,10", "90,10", "90,90", "10,90"],
        ["10,10 90,10 90,90 10,90"],
        ["10,10 90,10", " 90,90  10,90 "],
    ],
)
@pytest.mark.parametrize("option", ["--quad", "--region", "--surface"])
def test_corners_are_one_argument_or_several(run: Run, done: list[Any], option: str, corners: list[str]) -> None:
    others = ["ad.png"] if option != "--surface" else []
    before = [*others, *(["--quad", *QUAD] if option == "--region" else [])]
    given = ["--surface", "ad.png", *corners] if option == "--surface" else [option, *corners]
    assert run("in.mp4", *before, *given)[0] == 0
    [(_, _, [surface], *_)] = done
    polygon = surface["region" if option == "--region" else "quad"]
    np.testing.assert_array_equal(polygon, [[10, 10], [90, 10], [90, 90], [10, 90]])


def test_an_effect_beside_ads_is_of_the_surfaces_without_one(run: Run, done: list[Any]) -> None:
    surfaces = ["--surface", "ad.png", *QUAD, "--surface", "-", *QUAD]
    code, _, err = run("in.mp4", *surfaces, "--effect", "blur", "--fit", "cover", "--once", "--lost", "hide")
    assert code == 0, err
    [(_, _, [first, second], *_)] = done
    names = ("ad", "effect", "fit", "playback", "lost")
    assert [first[name] for name in names] == [Path("ad.png"), "replace", "cover", "once", "hide"]
    assert [second[name] for name in names] == [None, "blur", "stretch", "loop", "hide"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--surface", "ad.png", *QUAD, "--effect", "blur"], "ad does nothing with effect blur"),
        (["--surface", "-", *QUAD, "--effect", "blur", "--fit", "cover"], "fit does nothing with effect blur"),
    ],
)
def test_what_no_surface_can_use_is_refused(run: Run, done: list[Any], arguments: list[str], message: str) -> None:
    code, _, err = run("in.mp4", *arguments)
    assert (code, done) == (2, [])
    assert message in err


def test_files_may_come_after_corners(run: Run, done: list[Any]) -> None:
    code, _, err = run("--quad", *QUAD, "--exclude", "-5,20", "30,20", "30,30", "a,b.mp4", "ad.png")
    assert code == 0, err
    [(_, input, [surface], *_)] = done
    assert str(input) == "a,b.mp4"
    np.testing.assert_array_equal(surface["exclude"], [[[-5, 20], [30, 20], [30, 30]]])


@pytest.mark.parametrize(
    ("polygon", "message"),
    [
        (["10,10", "90,10"], "three corners"),
        (["10,10", "90,90", "90,10", "10,90"], "crosses itself"),
        (["10,10", "50,50", "90,90"], "flat"),
    ],
)
@pytest.mark.parametrize("option", ["--region", "--exclude"])
def test_refuses_polygons_that_are_none(
    run: Run, done: list[Any], option: str, polygon: list[str], message: str
) -> None:
    code, _, err = run(*MODES["quad"], option, *polygon)
    assert (code, done) == (2, [])
    assert err.count("\n") == 1
    assert message in err


def test_only_live_use_writes_to_standard_output(run: Run, done: list[Any]) -> None:
    code, _, err = run(*MODES["quad"], "-o", "-")
    assert (code, done) == (2, [])
    assert "only --live writes to standard output" in err


def test_the_command_line_counts_before_the_job(run: Run, done: list[Any]) -> None:
    Path("job.json").write_text(
        '{"version": 1, "input": "a.mp4", "output": "b.mp4", "rendering": {"crf": 20, "audio": "none"}, '
        '"tracking": {"smooth": 3}, "surfaces": [{"ad": "a.png", "quad": "10,10 90,10 90,90 10,90"}]}'
    )
    assert run("--job", "job.json")[0] == 0
    assert run("in.mp4", "--job", "job.json", "-o", "c.mp4", "--crf", "25", "--smooth", "0")[0] == 0
    (_, input, _, output, tracking, options, *_), (_, other_input, _, other_output, other_tracking, others, *_) = done
    assert (str(input), str(output), tracking.smooth, options.crf, options.audio) == ("a.mp4", "b.mp4", 3, 20, "none")
    assert (str(other_input), str(other_output), other_tracking.smooth) == ("in.mp4", "c.mp4", 0)
    assert (others.crf, others.audio) == (25, "none")


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
def test_warnings_of_a_track_are_told_once(run: Run, done: list[Any], quiet: tuple[str, ...]) -> None:
    track = Track.load("t.json")
    track.warnings = ["frames 1 to 2: hardly seen"]
    track.save("t.json")
    told = ["in.mp4", "--quad", *QUAD, "--overwrite", "--json", *quiet]
    code, out, err = run(*told, main=entry.track_main)
    assert (code, err) == (0, "warning: frames 1 to 2: hardly seen\n")
    assert '"warnings": ["frames 1 to 2: hardly seen"]' in out
    assert run(*told, "--strict", main=entry.track_main)[0] == 0  # whether it matters, the verdict says
    track.warnings = ["in.mp4 is damaged"]
    track.save("t.json")
    assert run(*told, "--strict", main=entry.track_main)[0] == 1


def test_parsers_have_no_defaults() -> None:
    assert vars(track_parser().parse_args(["in.mp4"])) == {"input": "in.mp4"}
    assert vars(replace_parser().parse_args([])) == {}
