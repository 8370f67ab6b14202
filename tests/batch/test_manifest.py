"""Manifests: what they stand for, and what is refused with line and column."""

import json
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from ar_demo.batch.commands import MISSING
from ar_demo.batch.documents import read
from ar_demo.batch.jobs import Job, expand
from ar_demo.batch.manifest import SCHEMA, load, schema
from ar_demo.batch.options import LEFT_OUT, options
from ar_demo.cli.entry import batch_main
from ar_demo.cli.parsers import replace_parser
from ar_demo.errors import InputError

from ..conftest import Main, Run

QUAD = "0,0 90,0 90,90 0,90"
JOB = {"input": "a.mp4", "ad": "b.png", "quad": QUAD}
TOML = """version = 1
[defaults]
crf = 20
[[jobs]]
input = "a.mp4"
[[jobs]]
input = "b.mp4"
{} = {}
"""


@pytest.fixture
def main() -> Main:
    return batch_main


def write(folder: Path, text: str, name: str = "jobs.yaml") -> Path:
    file = folder / name
    file.write_text(text)
    return file


def jobs_of(folder: Path, content: dict[str, Any] | str, name: str = "jobs.yaml") -> list[Job]:
    text = content if isinstance(content, str) else json.dumps({"version": 1} | content)
    return expand(*load(write(folder, text, name)))


def refusal(folder: Path, text: str, name: str = "jobs.yaml") -> str:
    with pytest.raises(InputError) as caught:
        jobs_of(folder, text, name)
    return str(caught.value).replace(f"{folder}/", "")


def test_a_job_takes_what_its_defaults_say(tmp_path: Path) -> None:
    [job] = jobs_of(tmp_path, {"defaults": {"crf": 20, "fit": "cover"}, "jobs": [JOB | {"fit": "contain"}]})
    assert job.arguments == [
        f"{tmp_path}/a.mp4",
        f"{tmp_path}/b.png",
        f"--output={tmp_path}/a.ar.mp4",
        f"--quad={QUAD}",
        "--fit=contain",
        "--crf=20.0",
    ]


def test_every_form_says_the_same(tmp_path: Path) -> None:
    said = {"crf": 20, "snap": True, "playback": "once", "start": "0:04.5", "grain": "off"}
    expected = jobs_of(tmp_path, {"jobs": [JOB | said]}, "j.json")
    texts = {
        "j.yaml": f"version: 1\njobs:\n- input: a.mp4\n  ad: b.png\n  quad: {QUAD}\n  crf: 20\n  snap: true\n"
        "  playback: once\n  start: 0:04.5\n  grain: off\n",
        "j.toml": f'version = 1\n[[jobs]]\ninput = "a.mp4"\nad = "b.png"\nquad = "{QUAD}"\ncrf = 20\nsnap = true\n'
        'playback = "once"\nstart = "0:04.5"\ngrain = "off"\n',
        "j.csv": "input,ad,quad,crf,snap,playback,start,grain,region\n"
        f'a.mp4,b.png,"{QUAD}",20,true,once,0:04.5,off,\n\n',
    }
    for name, text in texts.items():
        assert [job.arguments for job in jobs_of(tmp_path, text, name)] == [job.arguments for job in expected], name


def test_globs_lists_and_the_matrix(tmp_path: Path) -> None:
    for name in ("one.mp4", "two.mp4"):
        (tmp_path / name).touch()
    jobs = jobs_of(
        tmp_path,
        {
            "defaults": {"output": "out/{clip}.{ad}.{number}.mp4", "track": "{clip}.json"},
            "jobs": [{"input": "*.mp4", "effect": "blur"}, {"input": ["x.mp4", "y.mp4"], "ad": ["p.png", "q.png"]}],
            "clips": [{"input": "c.mp4"}, {"input": "d.mp4", "start": 4}],
            "ads": [{"ad": "e.png"}, {"ad": "f.png", "fit": "cover"}],
        },
    )
    assert [Path(job.name).name for job in jobs] == [
        *("one.blur.1.mp4", "two.blur.2.mp4", "x.p.3.mp4", "x.q.4.mp4", "y.p.5.mp4", "y.q.6.mp4"),
        *("c.e.7.mp4", "c.f.8.mp4", "d.e.9.mp4", "d.f.10.mp4"),
    ]
    assert f"--track={tmp_path}/one.json" in jobs[0].arguments
    assert {"--start=4", "--fit=cover"} <= set(jobs[-1].arguments)


def test_files_of_a_job_file_are_known(tmp_path: Path) -> None:
    content = {"version": 1, "input": "in.mp4", "output": "o.mp4", "surfaces": [{"ad": "a.png", "quad": QUAD}]}
    (tmp_path / "jobs").mkdir()
    (tmp_path / "jobs" / "one.json").write_text(json.dumps(content))
    [job] = jobs_of(tmp_path, {"jobs": [{"job": "jobs/one.json"}]})
    assert job.outputs == {"output": f"{tmp_path}/jobs/o.mp4"}
    assert job.arguments[0] == f"{tmp_path}/jobs/in.mp4"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (
            "j.yaml",
            "version: 1\njobs:\n  - input: a.mp4\n    crff: 20\n",
            "line 4, column 11: 'crff' is unknown: did you mean crf?",
        ),
        (
            "j.yaml",
            "version: 1\njobs:\n  - input: a.mp4\n    crf: best\n",
            "line 4, column 10: input should be a valid number",
        ),
        (
            "j.yaml",
            "version: 1\njobs:\n  - input: a.mp4\n    fit: wide\n",
            "line 4, column 10: input should be 'stretch'",
        ),
        ("j.yaml", "version: 1\njobs:\n  - input: a.mp4\n    quad: 1,2\n", "line 4, column 11: a polygon needs three"),
        ("j.yaml", "version: 1\njobs:\n  - ad: a.mp4\n", "line 3, column 5: it has no input"),
        ("j.yaml", "version: 1\njobs:\n  - input: none*.mp4\n", "line 3, column 12: there is no file none*.mp4"),
        (
            "j.yaml",
            "version: 1\njobs:\n - {input: a.mp4, output: '{clp}.mp4'}\n",
            "line 3, column 27: {clp} is unknown",
        ),
        ("j.yaml", "version: 1\njobs: [a: b\n", "line 3, column 1: not YAML"),
        ("j.yaml", "version: 2\njobs: []\n", "line 1, column 10: input should be 1"),
        ("j.yaml", "version: 1\njobs:\n - &a {input: a.mp4}\n - *a\n", "aliases (& and *) are not taken"),
        (
            "j.yaml",
            "version: 1\njobs:\n - input: a.mp4\n   input: b.mp4\n",
            "line 4, column 4: not YAML: found duplicate key",
        ),
        ("j.yaml", "version: 1\njobs:\n - {input: a.mp4, time_limit: soon}\n", "'soon' is no length of time"),
        ("j.yaml", "", "is empty"),
        (
            "j.json",
            '{"version": 1,\n\t"jobs": [{"input": "a.mp4",\n"crf": "x"}]}',
            "line 3, column 8: input should be a",
        ),
        ("j.json", '{"version": 1,\n}', "line 2, column 1: not JSON"),
        ("j.json", '{"version": 1, "jobs": []}', "has no jobs"),
        ("j.json", '{"jobs": []}', "'version' is missing"),
        ("j.json", '{"version": 1, "ads": [{"ad": "a.png"}]}', "there are ads, but no clips"),
        ("j.json", "[" * 100_000, "nested too deeply"),
        ("j.toml", TOML.format("crf", '"x"'), "line 8, column 1: input should be a valid number"),
        ("j.toml", TOML.format("wrong", "1"), "line 8, column 1: 'wrong' is unknown"),
        ("j.toml", "version = \n", "line 1, column 11: not TOML: invalid value"),
        ("j.csv", "input,crf\na.mp4,20\nb.mp4,x\n", "line 3, column 2: input should be a valid number"),
        ("j.csv", "input,wrong\na.mp4,20\n", "line 2, column 2: 'wrong' is unknown"),
        ("j.csv", "input,quad\na.mp4,0,0 1,0 1,1\n", "there are only 2 columns"),
        ("j.txt", "", "its name must end in"),
    ],
)
def test_what_is_wrong_is_named_with_line_and_column(tmp_path: Path, name: str, text: str, message: str) -> None:
    assert message in refusal(tmp_path, text, name)


def test_two_jobs_with_one_output_are_refused(tmp_path: Path) -> None:
    job = {"input": "a.mp4", "ad": ["x.png", "y.png"], "output": "o.mp4"}
    assert "jobs 1 and 2 would both write" in refusal(tmp_path, json.dumps({"version": 1, "jobs": [job]}))


def test_too_many_jobs_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ar_demo.batch.jobs.MOST_JOBS", 10)
    many = {"input": ["a.mp4"] * 4, "ad": ["b.png"] * 4, "output": "{number}.mp4"}
    assert "more than 10 jobs" in refusal(tmp_path, json.dumps({"version": 1, "jobs": [many]}))


def test_every_option_can_be_said(tmp_path: Path) -> None:
    """Each one reaches the parser of ar-replace with the value that the manifest has."""
    known = {action.dest for action in replace_parser()._actions}
    assert set(options()) == known - LEFT_OUT
    for name, option in options().items():
        value: Any = "x"
        if option.flags:
            value = next(iter(option.flags))
        elif option.action.choices:
            value = next(iter(option.action.choices))
        elif option.action.nargs == 2:
            value = [["ad.png", QUAD]]
        elif (option.action.metavar or "").startswith("X,Y"):
            value = QUAD
        elif option.action.type not in (None, Path):
            value = 1
        [job] = (
            jobs_of(tmp_path, {"jobs": [{"input": "a.mp4", "output": "o.mp4", name: value}]})
            if name != "job"
            else [None]
        )
        if job is not None:
            assert name in vars(replace_parser().parse_args(job.arguments)), name


def test_pictures_to_find_and_their_ads_are_files(tmp_path: Path) -> None:
    (tmp_path / "a=b.png").touch()
    [job] = jobs_of(tmp_path, {"jobs": [{"input": "a.mp4", "find": ["p.png=ad.mp4", "a=b.png", "c.png"]}]})
    found = [word.partition("=")[2] for word in job.arguments if word.startswith("--find")]
    assert found == [f"{tmp_path}/p.png={tmp_path}/ad.mp4", f"{tmp_path}/a=b.png", f"{tmp_path}/c.png"]


def test_names_cannot_become_options(tmp_path: Path) -> None:
    [job] = jobs_of(tmp_path, {"jobs": [{"input": "--overwrite", "ad": "-o", "codec": "--json", "output": "--x.mp4"}]})
    given = replace_parser().parse_args(job.arguments)
    assert (given.input, given.ad, given.codec) == (f"{tmp_path}/--overwrite", f"{tmp_path}/-o", "--json")
    assert not {"overwrite", "json"} & set(vars(given))


def test_the_dry_run_prints_a_shell_command_a_line(tmp_path: Path, run: Run) -> None:
    nasty = "a; touch pwned $(b) 'c'.mp4"
    file = write(tmp_path, json.dumps({"version": 1, "jobs": [JOB | {"input": nasty}, JOB]}), "j.json")
    status, out, err = run(file, "--dry-run")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert [shlex.split(line)[:2] for line in lines] == [
        ["ar-replace", f"{tmp_path}/{nasty}"],
        ["ar-replace", f"{tmp_path}/a.mp4"],
    ]
    assert [path.name for path in tmp_path.iterdir()] == ["j.json"]


def test_the_schema_is_as_the_code_is_and_takes_what_the_code_takes(tmp_path: Path) -> None:
    assert SCHEMA.read_text() == schema(), "run python -m ar_demo.batch.manifest"
    checker = jsonschema.Draft202012Validator(json.loads(schema()))
    good = {"version": 1, "jobs": [JOB | {"crf": 20, "start": 120, "playback": "once", "time_limit": "10m"}]}
    assert checker.is_valid(good)
    assert not checker.is_valid({"version": 1, "jobs": [JOB | {"fit": "wide"}]})
    assert not checker.is_valid({"version": 1, "job": []})


def test_a_byte_order_mark_does_no_harm(tmp_path: Path) -> None:
    assert read(write(tmp_path, "\ufeffversion: 1\n")).content == {"version": 1}


@pytest.mark.parametrize("package", ["pydantic", "ruamel.yaml", "psutil"])
def test_without_the_extra_one_line_says_what_to_install(tmp_path: Path, package: str) -> None:
    program = (
        f"import sys; sys.modules[{package!r}] = None; "
        f"from ar_demo.cli.entry import batch_main; batch_main([{str(write(tmp_path, 'version: 1'))!r}])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == f"error: {MISSING}\n"
