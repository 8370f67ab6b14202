"""The templates for render farms: right by their farms' schemas, and their commands by our parsers."""

import json
import os
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from ar_demo.cli.parsers import PARSERS
from ar_demo.frame_range import FrameRange
from ar_demo.media.reader import VideoReader
from ar_demo.tracks import Source, Track
from hdn.commandline import BAD_INPUT, DONE, FAILED, INTERRUPTED

from .clips import make_clip, numbered, sound_packets, tone

ROOT = Path(__file__).parents[1]
FARMS = ROOT / "examples" / "farms"
QUAD = "10,10 50,10 50,50 10,50"


def accepted(command: list[str]) -> Any:
    """What a command line of ours says, as its parser reads it; a range of frames is one."""
    given = PARSERS[command[0]]().parse_args(command[1:])
    if hasattr(given, "frames"):
        FrameRange.parse(given.frames)
    return given


def documents(path: Path) -> list[Any]:
    yaml = pytest.importorskip("yaml")
    return list(yaml.safe_load_all(path.read_text()))


def test_every_exit_status_is_documented_in_one_place() -> None:
    table = (ROOT / "docs/farms.md").read_text().partition("## Exit status")[2]
    told = {row.split("|")[1].strip() for row in table.splitlines() if row.startswith("| ")}
    assert {str(DONE), str(FAILED), str(BAD_INPUT)} <= told
    assert f"{INTERRUPTED} Ctrl-C" in table


def test_deadline_takes_the_template() -> None:
    openjd = pytest.importorskip("openjd.model")
    text = (FARMS / "deadline/template.yaml").read_text()
    content = openjd.document_string_to_object(document=text, document_type=openjd.DocumentType.YAML)
    template = openjd.decode_job_template(template=content, supported_extensions=["TASK_CHUNKING"])
    values = {"Video": "/a/street.mp4", "Ad": "/a/ad.mp4", "Quad": QUAD, "Frames": "0-299", "Output": "/a/out"}
    inputs = openjd.preprocess_job_parameters(
        job_template=template,
        job_parameter_values=values,
        job_template_dir=Path("/a"),
        current_working_dir=Path("/a"),
    )
    job = openjd.create_job(job_template=template, job_parameter_values=inputs)
    track, render = job.steps
    assert [task["Frames"].value for task in openjd.StepParameterSpaceIterator(space=render.parameterSpace)] == [
        "0-149",
        "150-299",
    ]
    for step in (track, render):
        action = step.script.actions.onRun
        words = [str(action.command), *map(str, action.args)]
        words = words[next(index for index, word in enumerate(words) if word in PARSERS) :]
        for name, value in values.items():
            words = [word.replace(f"{{{{Param.{name}}}}}", value) for word in words]
        given = accepted([word.replace("{{Task.Param.Frames}}", "0-149") for word in words])
        assert given.progress == "openjd"


@pytest.fixture
def outline(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Stands in for OpenCue's library; the layers of the job that was launched."""
    layers: list[Any] = []

    class Shell:
        def __init__(self, name: str, **options: Any) -> None:
            self.name, self.options, self.waits = name, options, None

        def depend_all(self, other: Any) -> None:
            self.waits = other

    class Outline:
        def __init__(self, name: str, **options: Any) -> None: ...

        def add_layer(self, layer: Shell) -> None:
            layers.append(layer)

    modules = {name: ModuleType(name) for name in ("outline", "outline.cuerun", "outline.modules")}
    shell: Any = ModuleType("outline.modules.shell")
    shell.Shell = Shell
    top: Any = modules["outline"]
    top.Outline, top.cuerun = Outline, modules["outline.cuerun"]
    top.cuerun.launch = lambda job, use_pycuerun: None
    for name, module in (modules | {"outline.modules.shell": shell}).items():
        monkeypatch.setitem(sys.modules, name, module)
    return layers


def test_opencue(outline: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    script = str(FARMS / "opencue/submit.py")
    monkeypatch.setattr(sys, "argv", [script, "street.mp4", "ad.mp4", QUAD, "0-299", "o.%05d.png", "--chunk", "50"])
    runpy.run_path(script, run_name="__main__")
    track, render = outline
    assert (render.waits, render.options["range"], render.options["chunk"]) == (track, "0-299", 50)
    accepted(track.options["command"])
    tokens = {"#FRAME_START#": "50", "#FRAME_END#": "99"}
    command = render.options["command"]
    for token, value in tokens.items():
        command = [word.replace(token, value) for word in command]
    assert accepted(command).frames == "50-99"


@pytest.mark.skipif(shutil.which("node") is None, reason="there is no Node.js")
def test_flamenco() -> None:
    stand_in = """
        const made = [];
        const author = {
            Task: (name, type) => ({ name, type, commands: [], after: [],
                addCommand(command) { this.commands.push(command); },
                addDependency(task) { this.after.push(task.name); } }),
            Command: (name, parameters) => ({ name, ...parameters }),
        };
        const frameChunker = (frames, size) => ["0-99", "100-150"];
        const settings = { video: "a.mp4", ad: "b.mp4", quad: QUAD, frames: "0-150", chunk_size: 100, output: "o.png" };
        compileJob({ settings, addTask: (task) => made.push(task) });
        console.log(JSON.stringify({ made, asked: JOB_TYPE.settings.map((s) => s.key), given: Object.keys(settings) }));
    """
    source = f'const QUAD = "{QUAD}";\n{(FARMS / "flamenco/ar_replace.js").read_text()}\n{stand_in}'
    done = subprocess.run(["node", "--eval", source], capture_output=True, text=True, check=True)
    told = json.loads(done.stdout)
    assert sorted(told["asked"]) == sorted(told["given"])
    assert [task["after"] for task in told["made"]] == [[], ["track"], ["track"]]
    for task in told["made"]:
        [command] = task["commands"]
        assert command["name"] == "exec"
        accepted([command["exe"], *command["args"]])


def scripts_of(job: dict[str, Any]) -> list[str]:
    """What a shell runs in a job of Kubernetes, each command of ours with its words."""
    [container] = job["spec"]["template"]["spec"]["containers"]
    command: list[str] = container["command"]
    return [command[2] if command[:2] == ["sh", "-c"] else shlex.join(command)]


def said(script: str, folder: Path, **environment: str) -> list[list[str]]:
    """The commands of ours that a script would run."""
    shims = folder / "shims"
    shims.mkdir(exist_ok=True)
    for name in PARSERS:
        shim = shims / name
        shim.write_text(f'#!/bin/sh\nfor word in {name} "$@"; do printf "%s\\n" "$word"; done >> said\necho >> said\n')
        shim.chmod(0o755)
    (folder / "said").write_text("")
    env = os.environ | {"PATH": f"{shims}:{os.environ['PATH']}"} | environment
    subprocess.run(["bash", "-euo", "pipefail", "-c", script], check=True, cwd=folder, env=env)
    return [command.splitlines() for command in (folder / "said").read_text().split("\n\n") if command.strip()]


def test_kubernetes(tmp_path: Path) -> None:
    validate = pytest.importorskip("kubernetes_validate")
    jobs = documents(FARMS / "kubernetes/jobs.yaml")
    for job in jobs:
        validate.validate(job, validate.latest_version(), strict=True)
        container = job["spec"]["template"]["spec"]["containers"][0]
        assert container["securityContext"]["readOnlyRootFilesystem"]
    (tmp_path / "parts").mkdir()
    commands = []
    for job in jobs:
        [script] = scripts_of(job)
        commands += said(script.replace("/clips/", f"{tmp_path}/"), tmp_path, JOB_COMPLETION_INDEX="3")
    assert [command[0] for command in commands] == ["ar-track", "ar-replace", "ar-join"]
    assert [accepted(command) for command in commands][1].frames == "1500-1999"


@pytest.mark.parametrize(
    ("schema", "name"),
    [
        ("vendor.github-actions", "github/action.yml"),
        ("vendor.github-workflows", "github/workflow.yml"),
        ("vendor.gitlab-ci", "gitlab/ar-replace.gitlab-ci.yml"),
    ],
)
def test_ci_by_its_schema(schema: str, name: str) -> None:
    pytest.importorskip("check_jsonschema")
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema, str(FARMS / name)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_commands_of_ci(tmp_path: Path) -> None:
    [workflow] = documents(FARMS / "github/workflow.yml")
    [pipeline] = documents(FARMS / "gitlab/ar-replace.gitlab-ci.yml")
    runs = [
        step["with"]["run"]
        for job in workflow["jobs"].values()
        for step in job["steps"]
        if "run" in step.get("with", {})
    ]
    runs += ["\n".join(pipeline[job]["script"]) for job in ("track", "render", "join")]
    assert len(runs) == 6
    (tmp_path / "parts").mkdir()
    for run in runs:
        [command] = said(run, tmp_path, PART="2", CI_NODE_INDEX="3", FRAMES_A_PART="500")
        given = accepted(command)
        if command[0] == "ar-replace":
            assert given.frames == "1000-1499"
    [action] = documents(FARMS / "github/action.yml")
    for step in action["runs"]["steps"]:
        if "run" in step:
            subprocess.run(["bash", "-n", "-c", step["run"]], check=True)


@pytest.fixture
def cluster(tmp_path: Path) -> Callable[..., str]:
    """Runs a script where sbatch runs what it is given at once, and tracking has been done."""
    make_clip(tmp_path / "in.mp4", numbered(30), rate=25, sound=tone(30 / 25))
    quad = np.array([[10.0, 10], [50, 10], [50, 50], [10, 50]])
    times = [Fraction(index, 25) for index in range(30)]
    source = Source("in.mp4", 96, 64, Fraction(25), 30)
    track = Track(source, 0, quad, times, np.repeat(quad[None], 30, 0), ["tracked"] * 30, np.ones(30), np.ones(30))
    track.save(tmp_path / "t.json")
    shims = tmp_path / "shims"
    shims.mkdir()
    run = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from ar_demo.cli.entry import"
    shim = {
        "ar-track": f'case "$*" in *--dry-run*) echo \'{{"frames": 30}}\';; *) cp {tmp_path}/t.json "$5";; esac',
        "ar-replace": f'exec {sys.executable} -c "{run} replace_main; replace_main()" "$@" --backend opencv --quiet',
        "ar-join": f'exec {sys.executable} -c "{run} join_main; join_main()" "$@" --quiet',
        "sbatch": """
            for word; do
                case $word in --array=*) last=${word#--array=0-};; esac
                script=$word
            done
            for index in $(seq 0 ${last:-0}); do SLURM_ARRAY_TASK_ID=$index bash -c "$script" >&2 || exit; done
            echo 1""",
    }
    for name, text in shim.items():
        (shims / name).write_text(f"#!/bin/bash\n{text}\n")
        (shims / name).chmod(0o755)

    def run_script(script: Path, *arguments: str) -> str:
        env = os.environ | {"PATH": f"{shims}:{os.environ['PATH']}"}
        done = subprocess.run([script, *arguments], capture_output=True, text=True, cwd=tmp_path, env=env, check=False)
        assert done.returncode == 0, done.stderr
        return done.stderr

    return run_script


def test_slurm_from_the_clip_to_the_output(cluster: Callable[..., str], tmp_path: Path) -> None:
    cluster(FARMS / "slurm/submit.sh", "in.mp4", str(ROOT / "assets/ad.mp4"), QUAD, "out.mp4", "20")
    assert sorted(path.name for path in tmp_path.glob("out*")) == ["out.mp4", "out.mp4.track.json"]
    with VideoReader(tmp_path / "out.mp4") as out, VideoReader(tmp_path / "in.mp4") as source:
        assert out.times == source.times
    assert [p for _, p in sound_packets(tmp_path / "out.mp4")] == [p for _, p in sound_packets(tmp_path / "in.mp4")]
