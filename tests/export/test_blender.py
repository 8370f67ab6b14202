"""The script for Blender, in Blender: opt-in, by `BPY_PYTHON=python-with-bpy pytest -m bpy tests/export`."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo.export import blender
from ar_demo.export.keys import keys_of
from ar_demo.tracks import Source

from .. import clips
from .tracks import FRAMES, LOST, TRACKS

DRIVER = """
import json, runpy, sys
import bpy
names = runpy.run_path(sys.argv[1], run_name="__main__")
made = names["made"]
node = names["corner_pin_node"]()
bpy.context.scene.frame_set(12)
print("FOUND", json.dumps({
    "start": bpy.data.movieclips[0].frame_start,
    "plane": {m.frame: [list(c) for c in m.corners] for m in made.markers if not m.mute},
    "muted": [m.frame for m in made.markers if m.mute],
    "points": {t.name: {m.frame: list(m.co) for m in t.markers if not m.mute}
               for t in bpy.data.movieclips[0].tracking.tracks},
    "node": {s.name: list(s.default_value)[:2] for s in node.inputs if s.type == "VECTOR"},
}))
"""


@pytest.mark.bpy
@pytest.mark.parametrize("lost", ["hold", "omit"])
@pytest.mark.parametrize("kind", ["moving", "lost"])
def test_blender_makes_what_the_track_says(tmp_path: Path, kind: str, lost: str) -> None:
    python = os.environ.get("BPY_PYTHON") or (sys.executable if find_spec("bpy") else None)
    if python is None:
        pytest.skip("bpy is not installed: BPY_PYTHON names a Python that has it")
    clip = clips.make_clip(tmp_path / "street.mp4", clips.numbered(FRAMES, 320, 240))
    track = TRACKS[kind]()
    track.source = Source(str(clip), 320, 240, track.source.fps, FRAMES)
    (tmp_path / "pin.py").write_text(blender.script(keys_of(track, 10, None, lost)))  # type: ignore[arg-type]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [python, "-c", DRIVER, tmp_path / "pin.py"], capture_output=True, text=True, env=environment, timeout=300
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("FOUND"))[6:])
    assert found["start"] == 10
    keyed = range(FRAMES) if lost == "hold" else np.flatnonzero(track.known)
    assert {int(frame) for frame in found["plane"]} == {int(index) + 1 for index in keyed}
    assert found["muted"] == ([LOST[0] + 1, LOST[-1] + 1] if (kind, lost) == ("lost", "omit") else [])
    for index in np.flatnonzero(track.known):
        corners = np.array(found["plane"][str(index + 1)])[[3, 2, 1, 0]] * [320, -240] + [-0.5, 239.5]
        assert np.abs(corners - track.corners[index]).max() < 0.01
        point = np.array(found["points"]["surface top left"][str(index + 1)]) * [320, -240] + [-0.5, 239.5]
        assert np.abs(point - track.corners[index, 0]).max() < 0.01
    names = ("Upper Left", "Upper Right", "Lower Right", "Lower Left")
    pinned = np.array([found["node"][name] for name in names]) * [320, -240] + [-0.5, 239.5]
    assert np.abs(pinned - track.corners[2]).max() < 0.01


RENDER = """
import runpy, sys
import bpy
scene = bpy.context.scene
scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 320, 240, 100
scene.view_settings.view_transform = "Raw"
scene.render.engine, scene.cycles.samples = "CYCLES", 1
node = runpy.run_path(sys.argv[1], run_name="__main__")["made"]
tree = node.id_data


def picture(name, width, height, level):
    image = bpy.data.images.new(name, width, height)
    image.pixels = [level, level, level, 1.0] * (width * height)
    image.update()
    made = tree.nodes.new("CompositorNodeImage")
    made.image = image
    return made.outputs["Image"]


over = tree.nodes.new("CompositorNodeAlphaOver")
if hasattr(scene, "compositing_node_group"):
    tree.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    back, front, shown = over.inputs["Background"], over.inputs["Foreground"], tree.nodes.new("NodeGroupOutput")
else:  # Blender 4, which begins with a Composite node of its own
    tree.nodes.remove(next(node for node in tree.nodes if node.bl_idname == "CompositorNodeComposite"))
    back, front, shown = over.inputs[1], over.inputs[2], tree.nodes.new("CompositorNodeComposite")
tree.links.new(picture("insert", 640, 360, 1.0), node.inputs["Image"].links[0].from_node.inputs["Image"])
tree.links.new(picture("plate", 320, 240, 0.0), back)
tree.links.new(node.outputs["Image"], front)
tree.links.new(over.outputs["Image"], shown.inputs[0])
scene.frame_set(int(sys.argv[3]))
scene.render.filepath = sys.argv[2]
bpy.ops.render.render(write_still=True)
"""


@pytest.mark.bpy
def test_blender_draws_where_the_track_says(tmp_path: Path) -> None:
    """Without the clip, by a Corner Pin node: the middle of what it draws, and how much that is."""
    python = os.environ.get("BPY_PYTHON") or (sys.executable if find_spec("bpy") else None)
    if python is None:
        pytest.skip("bpy is not installed: BPY_PYTHON names a Python that has it")
    track = TRACKS["moving"]()
    track.source = Source(str(tmp_path / "gone.mp4"), 320, 240, track.source.fps, FRAMES)
    (tmp_path / "pin.py").write_text(blender.script(keys_of(track, 10)))
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [python, "-c", RENDER, tmp_path / "pin.py", tmp_path / "out.png", "15"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300)
    assert done.returncode == 0, done.stderr
    drawn = cv2.imread(str(tmp_path / "out.png"))[..., 1] / 255.0
    moments, expected = cv2.moments(drawn), cv2.moments(track.corners[5].astype(np.float32))
    assert moments["m00"] == pytest.approx(expected["m00"], rel=0.005)
    for axis in ("m10", "m01"):
        assert moments[axis] / moments["m00"] == pytest.approx(expected[axis] / expected["m00"], abs=0.2)
