"""What tells whether a cached figure is still valid."""

import subprocess
import sys
from pathlib import Path

from hdn.benchmark.identity import ROOT, digest, sources, tracker_sources


def test_sources_are_those_of_all_folders(tmp_path: Path) -> None:
    names = ("a.py", "cli/bar.py", "cli/jobs.py", "deep/er/b.py", "training/loop.py", "training_data.py", "notes.txt")
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = sources(tmp_path, ("training", "cli/bar"))
    assert [path.relative_to(tmp_path).as_posix() for path in found] == [
        "a.py", "cli/jobs.py", "deep/er/b.py", "training_data.py",
    ]  # fmt: skip


def test_every_module_that_the_tracker_imports_counts() -> None:
    """Run apart, since in this process other tests have imported more."""
    show = "import sys, hdn.tracker; print(*(m.__file__ for n, m in sys.modules.items() if n.split('.')[0] == 'hdn'))"
    command = [sys.executable, "-c", show]
    printed = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    imported = {Path(name).resolve() for name in printed.split()}
    assert len(imported) > 10
    assert imported <= {path.resolve() for path in tracker_sources()}


def test_a_digest_changes_with_names_and_contents(tmp_path: Path) -> None:
    one, two = tmp_path / "one.py", tmp_path / "two.py"
    one.write_text("x = 1")
    two.write_text("x = 1")
    first = digest([one])
    assert digest([two]) != first
    one.write_text("x = 2")
    assert digest([one]) != first
