"""Imports point one way: `ar_demo` to `hdn`, and inside each, among its folders and top modules, never in a circle."""

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def imports(file: Path) -> Iterator[str]:
    """The modules that a file imports, by their full names, wherever in the file that is."""
    package = file.parent.relative_to(ROOT).parts
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = [*base, *(node.module or "").split(".")] if node.module else list(base)
            yield ".".join(module)
            yield from (".".join([*module, alias.name]) for alias in node.names)


def room(name: str) -> str:
    """The folder, or the module beside the folders, that a module belongs to: its first two names."""
    return ".".join(name.split(".")[:2])


def rooms(package: str) -> dict[str, set[str]]:
    """Each room of a package with those that it imports; the package's face is none."""
    files = [file for file in (ROOT / package).rglob("*.py") if file != ROOT / package / "__init__.py"]
    names = {file: ".".join(file.relative_to(ROOT).with_suffix("").parts) for file in files}
    known = {room(name) for name in names.values()}
    found: dict[str, set[str]] = {name: set() for name in known}
    for file, name in names.items():
        found[room(name)] |= {room(other) for other in imports(file)} & known - {room(name)}
    return found


@pytest.mark.parametrize("package", ["hdn", "ar_demo"])
def test_no_circle_among_folders(package: str) -> None:
    found = rooms(package)
    assert len(found) > 10
    assert sum(map(len, found.values())) > 20
    TopologicalSorter(found).prepare()  # raises CycleError, which names the circle


def test_hdn_knows_nothing_of_ads() -> None:
    seen = {name for file in (ROOT / "hdn").rglob("*.py") for name in imports(file)}
    assert not {name for name in seen if name.split(".")[0] == "ar_demo"}
    assert "numpy" in seen
