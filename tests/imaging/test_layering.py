"""`hdn.imaging` lies at the bottom: anything may use it, and it costs NumPy and OpenCV alone."""

import ast
import sys
from pathlib import Path

import pytest

from hdn import imaging

ALLOWED = {"numpy", "cv2", "..errors"}
MODULES = sorted(Path(imaging.__path__[0]).glob("*.py"))


def imported(path: Path) -> set[str]:
    """What a module imports from outside its folder and the standard library."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level != 1:
            names.add("." * node.level + (node.module or "").partition(".")[0])
    return names - sys.stdlib_module_names


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_imaging_imports_numpy_and_opencv_alone(path: Path) -> None:
    assert imported(path) <= ALLOWED


def test_some_modules_are_looked_at() -> None:
    assert {"homography", "quads", "pyramid"} <= {path.stem for path in MODULES}
