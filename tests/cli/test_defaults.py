"""Defaults: the command line before the job file, that before the environment, and that before the file."""

import json
from pathlib import Path
from typing import Any

import pytest

from ar_demo.cli import commands, defaults, entry
from ar_demo.cli.defaults import KEYS, load_defaults
from ar_demo.cli.parsers import replace_parser
from ar_demo.errors import InputError
from ar_demo.options import OutputOptions

from ..conftest import Run
from . import test_applicability
from .test_applicability import MODES, QUAD

done = test_applicability.done  # what the commands ask for, in place of doing it


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "config" / "ar-replace" / "config.toml"
    path.parent.mkdir(parents=True)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setattr(defaults, "config_file", lambda: path)
    return path


def test_keys_are_options() -> None:
    assert KEYS.keys() <= {action.dest for action in replace_parser()._actions}


def test_where_the_file_is(monkeypatch: pytest.MonkeyPatch) -> None:
    assert defaults.config_file().parts[-2:] == ("ar-replace", "config.toml")


def test_who_counts_before_whom(run: Run, done: list[Any], file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file.write_text('crf = 20\naudio = "mix"\nopacity = 0.5\nsmooth = 2\nbackend = "opencv"\n')
    Path("job.json").write_text(
        json.dumps({"version": 1, "rendering": {"audio": "ad"}, "surfaces": [{"ad": "a.png", "quad": " ".join(QUAD)}]})
    )

    def asked(*arguments: str) -> tuple[Any, Any, Any, Any, Any]:
        code, _, err = run(*arguments)
        assert code == 0, err
        _, _, [surface], _, tracking, options, *_ = done[-1]
        return options.crf, options.audio, options.backend, surface["opacity"], tracking.smooth

    assert asked(*MODES["quad"]) == (20, "mix", "opencv", 0.5, 2)
    monkeypatch.setenv("AR_REPLACE_CRF", "25")
    monkeypatch.setenv("AR_REPLACE_AUDIO", "none")
    assert asked(*MODES["quad"]) == (25, "none", "opencv", 0.5, 2)
    assert asked(*MODES["job"]) == (25, "ad", "opencv", 0.5, 2)
    assert asked(*MODES["job"], "--audio", "source", "--opacity", "1") == (25, "source", "opencv", 1, 2)
    assert asked(*MODES["surfaces"], "--crf", "30", "--smooth", "0") == (30, "none", "opencv", 0.5, 0)


def of_live(stand_in: Any) -> Any:
    """The stand-in for live sessions, which sees to it that options are those that live sessions take."""

    class Checked(stand_in):
        def run(self, output: Any, tracking: Any, options: Any) -> Any:
            assert (options.audio, options.depth, options.streams) == ("source", OutputOptions().depth, "all")
            return super().run(output, tracking, options)

    return Checked


@pytest.mark.parametrize("mode", MODES)
def test_defaults_without_a_place_are_left_out(
    run: Run, done: list[Any], file: Path, mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None of these is refused, as it would be on the command line."""
    monkeypatch.setattr(commands, "LiveSession", of_live(commands.LiveSession))
    file.write_text(
        'fit = "cover"\nplayback = "once"\nflat = true\nsmooth = 2\ncrf = 20\naudio = "mix"\ndepth = "source"\n'
        'overwrite = true\nstreams = "first"\n'
    )
    code, _, err = run(*MODES[mode])
    assert code == 0, err
    if mode != "job":
        effect = [argument for argument in MODES[mode] if argument != "ad.png"]
        effect += ["--effect", "blur"] if "--surface" not in effect else []
        if "--surface" not in effect:
            code, _, err = run(*effect)
            assert code == 0, err
            assert done[-1][2][0]["fit"] == "stretch"


@pytest.mark.parametrize(
    ("video", "codec", "left"),
    [
        ("o.mp4", None, {"codec": "h265", "crf": 20}),
        ("o.webm", None, {"crf": 20}),
        ("o.gif", None, {}),
        ("o.%05d.png", None, {}),
        (None, None, {}),
        ("o.mov", "prores", {"codec": "h265"}),
        ("o.xyz", None, {"codec": "h265", "crf": 20}),  # which is refused for its name
    ],
)
def test_codec_and_quality_are_for_videos_that_have_them(
    file: Path, video: str | None, codec: str | None, left: dict[str, Any]
) -> None:
    file.write_text('codec = "h265"\ncrf = 20\n')
    assert load_defaults().fitting(None if video is None else Path(video), codec).output() == left


def test_how_is_reported(run: Run, done: list[Any], file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file.write_text('json = true\nprogress = "openjd"\nquiet = true\n')
    for main, files in ((entry.replace_main, MODES["quad"]), (entry.track_main, ["in.mp4", "--quad", *QUAD])):
        code, out, err = run(*files, main=main)
        assert (code, err) == (0, "")
        assert '"frames"' in out
        assert "openjd_progress: 100" in out
    monkeypatch.setenv("AR_REPLACE_JSON", "false")
    assert '"frames"' not in run(*MODES["quad"])[1]


def test_exports_take_them(run: Run, done: list[Any], file: Path) -> None:
    Path("t.csv").write_text("old")
    assert run("t.json", "t.csv", main=entry.export_main)[0] == 2
    file.write_text("overwrite = true\njson = true\n")
    code, out, _ = run("t.json", "t.csv", main=entry.export_main)
    assert (code, json.loads(out)["frames"]) == (0, 4)


def test_weights_are_beside_the_file(file: Path) -> None:
    file.write_text('weights = "mine.safetensors"')
    assert load_defaults().tracking() == {"weights": file.parent / "mine.safetensors"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# taste\n\ncrff = 20", "config.toml, line 3: 'crff' is unknown: choose one of audio, "),
        ("[rendering]\ncrf = 20", "line 1: 'rendering' is unknown"),
        ('opacity = 1\ncrf = "20"', "line 2: crf = '20' cannot be: expected `float`"),
        ("opacity = 7", "line 1: opacity = 7 cannot be"),
        ('fit = "squeeze"', "line 1: fit = 'squeeze' cannot be: invalid enum value"),
        ('quad = "1,2"', "'quad' is unknown"),
        ("crf = \n", "is not TOML.*line 1"),
    ],
)
def test_refuses_what_the_file_cannot_say(run: Run, done: list[Any], file: Path, text: str, message: str) -> None:
    file.write_text(text)
    code, _, err = run(*MODES["quad"])
    assert (code, done, err.count("\n")) == (2, [], 1)
    with pytest.raises(InputError, match=message):
        load_defaults()


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("AR_REPLACE_CRFF", "20", "the environment's AR_REPLACE_CRFF: 'crff' is unknown"),
        ("AR_REPLACE_CRF", "low", "AR_REPLACE_CRF: crf = 'low' cannot be"),
        ("AR_REPLACE_QUIET", "maybe", "AR_REPLACE_QUIET"),
    ],
)
def test_refuses_what_the_environment_cannot_say(
    file: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: str, message: str
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(InputError, match=message):
        load_defaults()


def test_bytes_are_refused(file: Path) -> None:
    file.write_bytes(b"\xff")
    with pytest.raises(InputError, match="no text"):
        load_defaults()


@pytest.mark.parametrize(
    ("video", "left"),
    [
        (None, {"backend": "opencv"}),
        ("o.gif", {"backend": "opencv", "depth": "10"}),
        ("o.%d.png", {"backend": "opencv", "depth": "10"}),
        ("o.mov", {"backend": "opencv", "depth": "10", "audio": "mix", "streams": "first"}),
    ],
)
def test_sound_is_for_videos_that_hold_it(file: Path, video: str | None, left: dict[str, str]) -> None:
    file.write_text('audio = "mix"\nstreams = "first"\nbackend = "opencv"\ndepth = "10"\n')
    assert load_defaults().fitting(None if video is None else Path(video), None).output() == left
