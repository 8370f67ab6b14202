"""Nuke's CornerPin2D, as it copies or saves it: px from the picture's lower left corner, y up."""

import re

import numpy as np

from ..errors import InputError
from ..export.coordinates import to_bottom_left
from ..export.nuke import ORDER
from .curves import Corners, Curve, sampled

NODE = re.compile(r"^\s*CornerPin2D\s*\{", re.M)
KNOB = re.compile(r"^\s*to([1-4])\s+\{", re.M)
OURS = re.compile(r"^# ar-replace: .* frames from frame (-?\d+) on$", re.M)
FIRST_FRAME = 1  # Nuke numbers the frames of a video file from 1


def is_ours(text: str) -> bool:
    """Whether a file's text has a CornerPin2D."""
    return NODE.search(text) is not None


def read(text: str, width: int, height: int) -> Corners:
    """The corners of the first CornerPin2D in a text.

    Args:
        width, height: px, of the video.

    Raises:
        InputError: it is inverted, has an expression, or lacks a corner.
    """
    node = NODE.search(text)
    assert node is not None
    body = _braced(text, node.end())
    if re.search(r"^\s*invert\s+true", body, re.M):
        raise InputError("its CornerPin2D is inverted, as to stabilise: give one that pins")
    curves: dict[int, list[Curve]] = {}
    for knob in KNOB.finditer(body):
        curves[int(knob[1])] = _point(_braced(body, knob.end()))
    if missing := {1, 2, 3, 4} - curves.keys():
        raise InputError(f"its CornerPin2D has no to{min(missing)}: give one whose corners are set")
    points, between = sampled([curves[number] for number in (1, 2, 3, 4)])
    if not points:
        raise InputError("its CornerPin2D does not move: give one with keys, or the corners by --quad")
    order = np.argsort(ORDER)
    ours = OURS.search(text)
    return Corners(
        {frame: to_bottom_left(corners[order], height) for frame, corners in points.items()},
        int(ours[1]) if ours else None,
        between,
    )


def _braced(text: str, start: int) -> str:
    """What stands before the brace that closes the one before `start`."""
    depth = 1
    for place in range(start, len(text)):
        depth += {"{": 1, "}": -1}.get(text[place], 0)
        if depth == 0:
            return text[start:place]
    raise InputError("a brace is not closed: the file is not whole")


def _point(text: str) -> list[Curve]:
    """Two curves of '{curve ...} {curve ...}'; of '10 20', which never change, or of a mixture."""
    parts = re.findall(r"\{([^{}]*)\}|(\S+)", text)
    if len(parts) != 2:
        raise InputError(f"'{text.strip()[:40]}' is no point: bake expressions to keys first")
    return [_curve(braced.strip() or bare) for braced, bare in parts]


def _curve(text: str) -> Curve:
    """Frames 'xN' that are followed by values, at which frames count on by themselves; letters mean no more here."""
    words = text.split()
    if words and words[0] == "curve":
        words = words[1:]
        moving = True
    else:
        moving = False
    curve: Curve = {}
    frame = 0.0
    try:
        for word in words:
            if word[0] == "x":
                frame = float(word[1:])
            elif word[0] in "-+.0123456789" and np.isfinite(float(word)):
                curve[frame if moving else np.inf] = float(word)
                frame += 1
            elif not re.fullmatch(r"[A-Za-z]([-+.\d][-+.e\d]*)?", word):
                raise ValueError
    except ValueError:
        curve.clear()
    if not curve:
        raise InputError(f"'{text[:40]}' is no curve of keys: bake expressions to keys first")
    return curve
