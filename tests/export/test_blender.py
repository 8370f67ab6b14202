"""The script for Blender, in Blender: opt-in, by `BPY_PYTHON=python-with-bpy pytest -m bpy tests/export`."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

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
