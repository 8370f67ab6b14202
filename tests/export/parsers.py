"""Readers of what is exported, written from the formats' descriptions and not from the exporters.

Each gives corners (4, 2) by frame: top-left, top-right, bottom-right, bottom-left, px, the centre of the top-left pixel
at (0, 0), y down.
"""

import ast
import csv
import json
import re
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from hdn.imaging.arrays import Array

STAND_IN = Path(__file__).with_name("after_effects_stand_in.js")


def words(text: str) -> list[object]:
    """Nested lists of a text with braces, words in quotes being one."""
    stack: list[list[object]] = [[]]
    for token in re.findall(r'"[^"]*"|[{}]|[^\s{}]+', re.sub(r"^#.*$", "", text, flags=re.M)):
        if token == "{":
            stack.append([])
        elif token == "}":
            done = stack.pop()
            stack[-1].append(done)
        else:
            stack[-1].append(token.strip('"'))
    assert len(stack) == 1
    return stack[0]


def nuke_nodes(text: str) -> dict[str, dict[str, object]]:
    """Knobs by the node's class; a node is its class and a list of knobs and values."""
    tokens = words(text)
    assert tokens[:3] == ["set", "cut_paste_input", ["stack", "0"]] or "[stack" in tokens
    nodes = {}
    for kind, body in pairwise(tokens):
        if isinstance(kind, str) and isinstance(body, list) and kind[0].isupper():
            nodes[kind] = dict(zip(body[::2], body[1::2], strict=True))
    return nodes


def nuke_curve(curve: object) -> dict[int, float]:
    assert isinstance(curve, list)
    assert curve[0] == "curve"
    return {int(x[1:]): float(v) for x, v in zip(curve[1::2], curve[2::2], strict=True)}


def nuke(text: str, width: int, height: int, node: str = "CornerPin2D") -> dict[int, Array]:
    knobs = nuke_nodes(text)[node]
    if node == "Tracker4":
        rows = knobs["tracks"][-1]  # type: ignore[index]
        assert [row[1] for row in rows] == ["bottom left", "bottom right", "top right", "top left"]
        assert {len(row) for row in rows} == {31}
        points = [(nuke_curve(row[2]), nuke_curve(row[3])) for row in rows]
    else:
        points = [tuple(map(nuke_curve, knobs[f"to{n}"])) for n in range(1, 5)]  # type: ignore[misc, call-overload]
    bottom_left, bottom_right, top_right, top_left = points
    order = top_left, top_right, bottom_right, bottom_left
    return {f: np.array([[x[f] - 0.5, height - 0.5 - y[f]] for x, y in order]) for f in order[0][0]}


def after_effects(text: str, width: int, height: int) -> dict[int, Array]:
    lines = text.split("\n")
    assert lines[0] == "Adobe After Effects 8.0 Keyframe Data"
    assert [line for line in lines if line][-1] == "End of Keyframe Data"
    sections = re.split(r"^Effects\t", text, flags=re.M)
    head = dict(re.findall(r"^\t(\w[\w ]+)\t(\S+)$", sections[0], re.M))
    shift = (width - int(head["Source Width"])) / 2, (height - int(head["Source Height"])) / 2
    found: dict[str, dict[int, tuple[float, float]]] = {}
    for section in sections[1:]:
        name = section.split("\n")[0].split("\t")[1]
        rows = re.findall(r"^\t(\d+)\t(\S+)\t(\S+)\t$", section, re.M)
        found[name] = {int(f): (float(x) + shift[0] - 0.5, float(y) + shift[1] - 0.5) for f, x, y in rows}
    upper_left, upper_right, lower_left, lower_right = (found[name] for name in sorted(found))
    order = upper_left, upper_right, lower_right, lower_left
    return {frame: np.array([point[frame] for point in order]) for frame in upper_left}


def after_effects_script(text: str, width: int, height: int) -> dict[int, Array]:
    """What the script does to a layer, in the stand-in's object model."""
    keys = run_in_node(text, width, height)["keys"]
    frames = [round(time * 30000 / 1001) for time, _ in keys["ADBE Corner Pin-0001"]]
    order = [keys[f"ADBE Corner Pin-000{n}"] for n in (1, 2, 4, 3)]
    return {f: np.array([point[i][1] for point in order]) - 0.5 for i, f in enumerate(frames)}


def run_in_node(text: str, width: int, height: int, layers: int = 1) -> dict[str, dict[str, list[object]]]:
    node = shutil.which("node")
    if node is None:
        pytest.skip("there is no Node to run the script")
    stand_in = STAND_IN.read_text().replace("WIDTH", str(width)).replace("HEIGHT", str(height))
    code = stand_in.replace("LAYERS", str(layers)).replace("SCRIPT", text)
    done = subprocess.run([node, "-"], input=code, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def fusion(text: str, width: int, height: int) -> dict[int, Array]:
    def body(name: str, kind: str) -> str:
        match = re.search(rf"^\t\t{name} = {kind} \{{\n(.*?)^\t\t\}},", text, re.M | re.S)
        assert match, name
        return match[1]

    def spline(name: str) -> dict[int, float]:
        rows = re.findall(r"\[(-?\d+)\] = \{ (\S+), Flags = \{ Linear = true \} \}", body(name, "BezierSpline"))
        return {int(frame): float(value) for frame, value in rows}

    tool = re.search(r'ActiveTool = "(\w+)"', text)
    assert tool
    inputs = dict(
        re.findall(r'(\w+) = Input \{ SourceOp = "(\w+)", Source = "Value"', body(tool[1], "CornerPositioner"))
    )
    points = []
    for name in ("TopLeft", "TopRight", "BottomRight", "BottomLeft"):
        axes = dict(re.findall(r'(\w) = Input \{ SourceOp = "(\w+)"', body(inputs[name], "XYPath")))
        points.append((spline(axes["X"]), spline(axes["Y"])))
    return {f: np.array([[x[f] * width - 0.5, (1 - y[f]) * height - 0.5] for x, y in points]) for f in points[0][0]}


def blender(text: str, width: int, height: int) -> dict[int, Array]:
    named = {
        node.targets[0].id: ast.literal_eval(node.value)
        for node in ast.parse(text).body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    found = {}
    for marker, corners in zip(named["MARKERS"], named["CORNERS"], strict=True):
        bottom_left, bottom_right, top_right, top_left = corners
        points = np.array([top_left, top_right, bottom_right, bottom_left])
        found[named["START"] + marker - 1] = np.array([0, 1] - points * [-1, 1]) * [width, height] - 0.5
    return found


def table(text: str, width: int, height: int) -> dict[int, Array]:
    rows = csv.DictReader(line for line in text.splitlines() if line[0] != "#")
    return {
        int(row["frame"]): np.array([[float(row[f"x{n}"]), float(row[f"y{n}"])] for n in range(1, 5)]) for row in rows
    }


def track_file(text: str, width: int, height: int) -> dict[int, Array]:
    frames = json.loads(text)["frames"]
    return {frame["index"]: np.array(frame["corners"]) for frame in frames if frame["corners"] is not None}


def timeline(text: str, width: int, height: int) -> dict[int, Array]:
    io = pytest.importorskip("opentimelineio")
    [clip] = io.adapters.read_from_string(text, "otio_json").find_clips()
    data = clip.metadata["ar_replace"]
    corners = [data["corners"][name] for name in ("top_left", "top_right", "bottom_right", "bottom_left")]
    return {f: np.array([list(points[i]) for points in corners]) for i, f in enumerate(data["frames"])}
