"""The container's steps, as far as they run without Docker: a clean installation, read-only, for anybody."""

import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "examples" / "container"
SCRIPT = FOLDER / "install.sh"
MOST_MB = 590  # of the program with all its libraries; Debian's packages and the base take 320
NO_INDEX = ("No matching distribution", "Temporary failure", "Connection", "Max retries")
NOBODY = "65534"
CLEAN = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


@pytest.fixture(scope="module")
def program() -> Iterator[Path]:
    """The program, installed as the image has it, where others may read it."""
    with TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield installed(Path(folder))


def installed(folder: Path) -> Path:
    system = shutil.which("python3.11", path="/usr/bin") or shutil.which("python3")
    to = folder / "ar-replace"
    env = CLEAN | {"PYTHON": str(system)}
    done = subprocess.run([SCRIPT, "program", ROOT, to], env=env, capture_output=True, text=True, check=False)
    if any(reason in done.stderr for reason in NO_INDEX):
        pytest.skip("there is no package index")
    assert done.returncode == 0, done.stderr
    return to


def megabytes(folder: Path) -> float:
    return sum(file.lstat().st_size for file in folder.rglob("*")) / 2**20


def test_the_program_is_whole_and_small(program: Path) -> None:
    assert not list(program.glob("lib/python*/site-packages/torch"))
    assert megabytes(program) < MOST_MB
    done = subprocess.run([SCRIPT, "check", program], env=CLEAN, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["states"] == {"tracked": 6, "held": 0, "lost": 0}


def test_it_needs_no_writable_root_and_no_rights(program: Path) -> None:
    work = program.parent / "clips"
    work.mkdir()
    shutil.copy(SCRIPT, program.parent)
    readable = all(parent.stat().st_mode & 0o005 for parent in (program / "bin/python").resolve().parents)
    if os.getuid() or not readable or not shutil.which("unshare") or not shutil.which("setpriv"):
        pytest.skip("it takes root, and a Python that others may run")
    script = f"""
        mount --make-rprivate / && mount -o remount,bind,ro / && mount -t tmpfs -o mode=777 tmpfs {work} || exit 99
        ! touch {ROOT}/written 2>/dev/null || exit 98
        cd {work} && TMPDIR={work} HOME={work} exec setpriv --reuid={NOBODY} --regid={NOBODY} --clear-groups \\
            sh {program.parent}/install.sh check {program}
    """
    command = ["unshare", "--mount", "sh", "-c", script]
    done = subprocess.run(command, env=CLEAN, capture_output=True, text=True, check=False)
    if done.returncode == 99:
        pytest.skip("mounting is not allowed here")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["frames"] == 6


def test_the_dockerfile_is_of_these_steps() -> None:
    text = (FOLDER / "Dockerfile").read_text()
    steps = re.findall(r"install\.sh (\w+)", text)
    assert {"program", "system"} <= set(steps)
    for step in steps:
        assert f"{step}() {{" in SCRIPT.read_text()
    last = text.split("\nFROM ")[-1]
    assert "USER 1000:1000" in last
    for source in re.findall(r"^COPY (?!--from)(\S+)", text, re.MULTILINE):
        assert (ROOT / source).exists()
    subprocess.run(["sh", "-n", SCRIPT], check=True)
