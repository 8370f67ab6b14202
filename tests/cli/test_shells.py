"""What every command has: a version, completion; and manual pages of those that people use."""

import shutil
import subprocess
import tomllib
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest

from ar_demo.cli import entry
from ar_demo.cli.parsers import PARSERS
from hdn.commandline import SHELLS

from ..conftest import Run

ROOT = Path(__file__).parents[2]
SCRIPTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_command_tells_its_version_and_completes(
    run: Run, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module, _, function = SCRIPTS[name].partition(":")
    main = getattr(import_module(module), function)
    for argument, expected in (("--version", f"{name} {version('ar-replace')}"), ("--print-completion=bash", name)):
        monkeypatch.setattr("sys.argv", [name, argument])
        with pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code
        assert expected in capsys.readouterr().out


@pytest.mark.parametrize("shell", SHELLS)
def test_completion_knows_the_options(run: Run, shell: str) -> None:
    code, out, err = run("--print-completion", shell)
    assert (code, err) == (0, "")
    assert "overwrite" in out
    assert "soft-light" in out


def test_bash_takes_the_completion(run: Run, tmp_path: Path) -> None:
    _, out, _ = run("--print-completion", "bash", main=entry.track_main)
    script = tmp_path / "complete.bash"
    script.write_text(
        out + '\nCOMP_WORDS=(ar-track --dev) COMP_CWORD=1\n_shtab_ar_track\necho "found ${COMPREPLY[*]}"\n'
    )
    done = subprocess.run(["bash", script], capture_output=True, text=True, timeout=60)
    assert "found --device" in done.stdout, done.stderr


def test_an_unknown_shell_is_refused(run: Run) -> None:
    code, _, err = run("--print-completion", "cmd")
    assert code == 2
    assert "cmd" in err


@pytest.mark.parametrize("name", PARSERS)
def test_a_manual_page_has_every_option(name: str) -> None:
    pytest.importorskip("argparse_manpage")
    pytest.importorskip("hatchling")
    from ar_demo.cli.manual import page

    text = page(name)
    options = {option for action in PARSERS[name]()._actions for option in action.option_strings} - {"-h", "--help"}
    plain = text.replace("\\-", "-")
    assert not {option for option in options if option not in plain}
    if shutil.which("groff"):
        done = subprocess.run(
            ["groff", "-man", "-Tutf8", "-ww"], input=text, capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0
        assert PARSERS[name]().description.split()[0] in done.stdout


def test_the_wheel_gets_the_pages(tmp_path: Path) -> None:
    pytest.importorskip("argparse_manpage")
    pytest.importorskip("hatchling")
    from ar_demo.cli.manual import ManualPages

    hook = ManualPages(str(ROOT), {}, None, None, str(tmp_path), "wheel")
    for build, pages in (("standard", [f"share/man/man1/{name}.1" for name in PARSERS]), ("editable", [])):
        data = {"shared_data": {}}
        hook.initialize(build, data)
        assert [*data["shared_data"].values()] == pages
        assert all(".TH" in Path(file).read_text() for file in data["shared_data"])
        hook.finalize(build, data, "")
