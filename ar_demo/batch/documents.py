"""Files of data, YAML, JSON, TOML and CSV, with the line and column of each value."""

import csv
import io
import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from ..errors import InputError

Keys = tuple[str | int, ...]
Place = tuple[int, int]  # line and column, from 1

LARGEST_BYTES = 32 << 20
DEEPEST = 50  # lists and mappings within each other


class Document:
    """What a file says, and where.

    Attributes:
        path: the file; content: mappings, lists, texts and numbers.
    """

    def __init__(self, path: Path, content: Any, place: Callable[[Keys], Place | None]) -> None:
        self.path, self.content, self._place = path, content, place

    def wrong(self, keys: Keys, message: str) -> InputError:
        """What is wrong with the value at the end of keys and indices, with its line and column."""
        place = self._place(keys)
        name = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).lstrip(".")
        return _wrong(self.path, place, f"{message}{f' - at {name}' if name else ''}")


def read(path: Path) -> Document:
    """Reads a file by its ending.

    Raises:
        InputError: it cannot be read, is too large, or is not what its ending says.
    """
    readers = {".yaml": _yaml, ".yml": _yaml, ".json": _json, ".toml": _toml, ".csv": _csv}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path} is no manifest: its name must end in {', '.join(readers)}")
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise InputError(f"{path} has more than {LARGEST_BYTES >> 20} MiB: split it")
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or 'it is no text'}") from error
    try:
        return reader(path, text)
    except RecursionError as error:
        raise InputError(f"{path} is nested too deeply") from error


def _wrong(path: Path, place: Place | None, message: str) -> InputError:
    where = "" if place is None else f", line {place[0]}, column {place[1]}"
    return InputError(f"{path}{where}: {message}")


def _yaml(path: Path, text: str) -> Document:
    """YAML 1.2, in which 0:04.5 and off are texts.

    Aliases, by which a few lines can stand for gigabytes, are refused.
    """
    yaml = YAML(typ="safe", pure=True)
    try:
        node = yaml.compose(text)
        if node is None:
            raise InputError(f"{path} is empty")
        _check_tree(path, node, set(), 0)
        content = yaml.load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = None if mark is None else (mark.line + 1, mark.column + 1)
        raise _wrong(path, place, f"not YAML: {' '.join(str(error.problem or error.context).split())}") from error
    except (YAMLError, ValueError) as error:
        raise InputError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    return Document(path, content, lambda keys: _place_in(node, keys))


def _check_tree(path: Path, node: Node, seen: set[int], depth: int) -> None:
    """Raises InputError where a node is there twice, by an alias, or too deep down."""
    mark = node.start_mark
    place = mark.line + 1, mark.column + 1
    if id(node) in seen:
        raise _wrong(path, place, "anchors and aliases (& and *) are not taken: say it under defaults, or in quotes")
    if depth > DEEPEST:
        raise _wrong(path, place, "nested too deeply")
    seen.add(id(node))
    if isinstance(node, MappingNode):
        for pair in node.value:
            for each in pair:
                _check_tree(path, each, seen, depth + 1)
    elif isinstance(node, SequenceNode):
        for each in node.value:
            _check_tree(path, each, seen, depth + 1)


def _place_in(node: Node, keys: Keys) -> Place:
    """Where the value at the end of the keys stands, as far as they lead; a key that is unknown stands for itself."""
    mark = node.start_mark
    for key in keys:
        if isinstance(node, SequenceNode) and isinstance(key, int) and key < len(node.value):
            node = node.value[key]
            mark = node.start_mark
        elif isinstance(node, MappingNode):
            pair = next((p for p in node.value if isinstance(p[0], ScalarNode) and p[0].value == key), None)
            if pair is None:
                break
            node = pair[1]
            mark = pair[0].start_mark if key == keys[-1] and not isinstance(node, ScalarNode) else node.start_mark
        else:
            break
    return mark.line + 1, mark.column + 1


def _json(path: Path, text: str) -> Document:
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise _wrong(path, (error.lineno, error.colno), f"not JSON: {error.msg.lower()}") from error
    except ValueError as error:  # a number of thousands of digits
        raise InputError(f"{path} is not JSON: {error}") from error

    def place(keys: Keys) -> Place | None:
        try:  # JSON is YAML
            return _place_in(YAML(typ="safe", pure=True).compose(text), keys)
        except YAMLError:
            return None

    return Document(path, content, place)


def _toml(path: Path, text: str) -> Document:
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
        place = (int(match[1]), int(match[2])) if match else None
        raise _wrong(path, place, f"not TOML: {str(error).partition(' (at')[0].lower()}") from error
    except ValueError as error:
        raise InputError(f"{path} is not TOML: {error}") from error
    return Document(path, content, lambda keys: _place_in_toml(text, keys))


def _place_in_toml(text: str, keys: Keys) -> Place | None:
    """Where a key, or the table or list that it is in, stands."""
    counts: dict[str, int] = {}
    table: Keys = ()
    best: tuple[int, Place] | None = None
    for number, row in enumerate(text.splitlines(), 1):
        if match := re.match(r"\s*(\[\[?)\s*([\w.-]+)", row):
            table = tuple(match[2].split("."))
            if match[1] == "[[":
                counts[match[2]] = counts.get(match[2], -1) + 1
                table = (*table, counts[match[2]])
            found, column = table, match.start(2) + 1
        elif match := re.match(r"""\s*["']?([\w-]+)["']?\s*=""", row):
            found, column = (*table, match[1]), match.start(1) + 1
        else:
            continue
        if keys[: len(found)] == found and (best is None or len(found) > best[0]):
            best = len(found), (number, column)
    return None if best is None else best[1]


def _csv(path: Path, text: str) -> Document:
    """A job in each row; the first one names the options. An empty cell says nothing."""
    rows, places = [], {}
    reader = csv.reader(io.StringIO(text))
    names: list[str] = []
    begin = 1
    try:
        for row in reader:
            line, begin = begin, reader.line_num + 1
            if not any(cell.strip() for cell in row):
                continue
            if not names:
                names = [cell.strip() for cell in row]
                continue
            if len(row) > len(names):
                raise _wrong(path, (line, len(names) + 1), f"there are only {len(names)} columns: put it in quotes")
            rows.append({name: cell.strip() for name, cell in zip(names, row, strict=False) if cell.strip()})
            places[len(rows) - 1] = line
    except csv.Error as error:
        raise _wrong(path, (reader.line_num, 1), f"not CSV: {error}") from error

    def place(keys: Keys) -> Place | None:
        if len(keys) < 2 or keys[1] not in places:
            return None
        named = keys[2] if len(keys) > 2 else None
        return places[int(keys[1])], names.index(str(named)) + 1 if named in names else 1

    return Document(path, {"version": 1, "jobs": rows}, place)
