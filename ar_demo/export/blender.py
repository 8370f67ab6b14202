"""Blender: a script that makes four tracks and a plane track of a movie clip, or keys a Corner Pin node.

Shares of the picture's width and height from the lower left corner, y up. A clip's markers are numbered from 1.
"""

import json
from pathlib import Path

from .coordinates import BL, BR, TL, TR, normalised
from .keys import Keys, number

ORDER = (BL, BR, TR, TL)  # of a plane track's corners

SCRIPT = '''import os

import bpy

CLIP = %(clip)s
NAME = %(name)s
START = %(start)d  # the scene's frame that shows the clip's first
MARKERS = [%(markers)s]  # frames of the clip, from 1
LOST = [%(lost)s]  # frames of the clip without a key that follow one with a key
# Of each frame: bottom left, bottom right, top right, top left.
CORNERS = [
%(corners)s
]


def movie_clip():
    """The clip, if Blender has it or it is where it was."""
    for clip in bpy.data.movieclips:
        if os.path.basename(bpy.path.abspath(clip.filepath)) == os.path.basename(CLIP):
            return clip
    return bpy.data.movieclips.load(CLIP) if os.path.exists(CLIP) else None


def plane_track(clip):
    """Four tracks and a plane track of them; an editor becomes a clip editor for as long."""
    window = bpy.context.window
    area = max(window.screen.areas, key=lambda area: area.width * area.height)
    usual, area.type = area.type, "CLIP_EDITOR"
    try:
        area.spaces.active.clip = clip
        area.spaces.active.mode = "TRACKING"
        for track in clip.tracking.tracks:
            track.select = False
        clip.frame_start = 1
        tracks = []
        for corner, name in enumerate(("bottom left", "bottom right", "top right", "top left")):
            track = clip.tracking.tracks.new(name="%%s %%s" %% (NAME, name), frame=MARKERS[0])
            for frame, corners in zip(MARKERS, CORNERS):
                track.markers.insert_frame(frame, co=corners[corner])
            track.select = True
            tracks.append(track)
        region = next(region for region in area.regions if region.type == "WINDOW")
        with bpy.context.temp_override(window=window, screen=window.screen, area=area, region=region):
            bpy.ops.clip.create_plane_track()
        plane = clip.tracking.plane_tracks[-1]
        plane.name = NAME
        for frame, corners in zip(MARKERS, CORNERS):
            plane.markers.insert_frame(frame).corners = corners
        keyed = set(MARKERS)
        for marker in plane.markers:
            marker.mute = marker.frame not in keyed  # there is one at the frame that the editor shows
        for frame in LOST:
            for track in (plane, *tracks):
                track.markers.insert_frame(frame).mute = True
        clip.frame_start = START
    finally:
        area.type = usual
    return plane


def corner_pin_node():
    """A Corner Pin node with keys; connect the insert with the Scale node before it: it pins what fills the frame."""
    scene = bpy.context.scene
    if hasattr(scene, "compositing_node_group"):  # Blender 5
        if scene.compositing_node_group is None:
            scene.compositing_node_group = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        tree = scene.compositing_node_group
    else:
        scene.use_nodes = True
        tree = scene.node_tree
    node = tree.nodes.new("CompositorNodeCornerPin")
    node.name = node.label = NAME
    scale = tree.nodes.new("CompositorNodeScale")
    scale.location = (node.location[0] - 200, node.location[1])
    if hasattr(scale, "space"):
        scale.space, scale.frame_method = "RENDER_SIZE", "STRETCH"
    else:  # Blender 5
        scale.inputs["Type"].default_value, scale.inputs["Frame Type"].default_value = "Render Size", "Stretch"
    tree.links.new(scale.outputs["Image"], node.inputs["Image"])
    for corner, name in enumerate(("Lower Left", "Lower Right", "Upper Right", "Upper Left")):
        socket = node.inputs[name]
        for frame, corners in zip(MARKERS, CORNERS):
            socket.default_value[0], socket.default_value[1] = corners[corner]
            socket.keyframe_insert("default_value", frame=frame - 1 + START)
    return node


if __name__ == "__main__":
    found = movie_clip()
    made = plane_track(found) if found is not None and bpy.context.window is not None else corner_pin_node()
'''


def script(keys: Keys) -> str:
    """A script for Blender's text editor, or for `blender --python`."""
    points = normalised(keys.corners, *keys.size)[:, ORDER]
    known = set(keys.indices)
    rows = (", ".join(f"({number(x, 8)}, {number(y, 8)})" for x, y in corners) for corners in points)
    filled = SCRIPT % {
        "clip": json.dumps(str(Path(keys.track.source.path).absolute())),
        "name": json.dumps("surface"),
        "start": keys.first_frame,
        "markers": ", ".join(str(index + 1) for index in keys.indices),
        "lost": ", ".join(str(i + 1) for i in range(1, len(keys.track)) if i - 1 in known and i not in known),
        "corners": "\n".join(f"    ({row})," for row in rows),
    }
    return "".join(f"# {note}\n" for note in keys.notes) + filled
