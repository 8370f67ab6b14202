"""Fusion and DaVinci Resolve: a setting with a CornerPositioner, as Fusion copies its tools.

Shares of the picture's width and height from the lower left corner, y up. Each corner is an XYPath of two splines.
"""

import json

from hdn.imaging.arrays import Array

from .coordinates import BL, BR, TL, TR, normalised
from .keys import Keys, number

TOOL = "SurfaceCorners"
INPUTS = {"TopLeft": TL, "TopRight": TR, "BottomLeft": BL, "BottomRight": BR}


def setting(keys: Keys) -> str:
    """A CornerPositioner for the insert, which is merged over the video."""
    points = normalised(keys.corners, *keys.size)
    notes = json.dumps("\n".join(keys.notes), ensure_ascii=False)
    inputs = "".join(f'\t\t\t\t{name} = Input {{ SourceOp = "{TOOL}{name}", Source = "Value", }},\n' for name in INPUTS)
    paths = "".join(_path(keys, f"{TOOL}{name}", points[:, place]) for name, place in INPUTS.items())
    return (
        "{\n\tTools = ordered() {\n"
        f"\t\t{TOOL} = CornerPositioner {{\n\t\t\tNameSet = true,\n\t\t\tInputs = {{\n"
        f"{inputs}\t\t\t\tComments = Input {{ Value = {notes}, }},\n"
        "\t\t\t},\n\t\t\tViewInfo = OperatorInfo { Pos = { 0, 0 } },\n\t\t},\n"
        f'{paths}\t}},\n\tActiveTool = "{TOOL}"\n}}\n'
    )


def _path(keys: Keys, name: str, points: Array) -> str:
    """A point (n, 2) on its way: its two splines."""
    links = "".join(f'\t\t\t\t{axis} = Input {{ SourceOp = "{name}{axis}", Source = "Value", }},\n' for axis in "XY")
    path = (
        f"\t\t{name} = XYPath {{\n\t\t\tShowKeyPoints = false,\n"
        f'\t\t\tDrawMode = "ModifyOnly",\n\t\t\tInputs = {{\n{links}\t\t\t}},\n\t\t}},\n'
    )
    return path + _spline(keys, f"{name}X", points[:, 0]) + _spline(keys, f"{name}Y", points[:, 1])


def _spline(keys: Keys, name: str, values: Array) -> str:
    rows = "".join(
        f"\t\t\t\t[{frame}] = {{ {number(value, 8)}, Flags = {{ Linear = true }} }},\n"
        for frame, value in zip(keys.frames, values, strict=True)
    )
    colour = "SplineColor = { Red = 255, Green = 128, Blue = 0 }"
    return f"\t\t{name} = BezierSpline {{\n\t\t\t{colour},\n\t\t\tKeyFrames = {{\n{rows}\t\t\t}},\n\t\t}},\n"
