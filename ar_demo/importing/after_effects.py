"""After Effects' keyframe text: Corner Pin and CC Power Pin, px of the layer, y down."""

import re

import numpy as np

from ..errors import InputError
from ..export.after_effects import CORNER_PIN, POWER_PIN
from ..export.coordinates import to_top_left
from .curves import Corners, Curve, sampled

FIRST_LINE = re.compile(r"\ufeff?Adobe After Effects [\d.]+ Keyframe Data")
FIRST_FRAME = 0


def is_ours(text: str) -> bool:
    """Whether a file's text is keyframe text."""
    return FIRST_LINE.match(text) is not None


def read(text: str, width: int, height: int) -> Corners:
    """The corners of a Corner Pin or a CC Power Pin.

    Args:
        width, height: px, of the video; a layer of another size is taken to lie in its middle.

    Raises:
        InputError: it has no four corners, or their keys are no numbers.
    """
    curves: dict[str, list[Curve]] = {}
    size = {"Source Width": float(width), "Source Height": float(height)}
    point: list[Curve] = [{}, {}]
    for line in text.splitlines()[1:]:
        words = [word.strip() for word in line.split("\t")]
        if line.startswith("Effects"):
            point = curves.setdefault(words[-1] or words[-2], [{}, {}])
        elif not line.startswith("\t"):
            point = [{}, {}]
        elif len(words) >= 3 and words[1] in size:
            size[words[1]] = _number(words[2])
        elif len(words) >= 4 and words[1] not in ("", "Frame"):
            for curve, word in zip(point, words[2:4], strict=True):
                curve[_number(words[1])] = _number(word)
    for properties in (CORNER_PIN, POWER_PIN):
        if properties.keys() <= curves.keys():
            points, between = sampled([curves[name] for name in properties])
            order = np.argsort(list(properties.values()))
            margin = (np.array([width, height]) - [size["Source Width"], size["Source Height"]]) / 2
            if points:
                return Corners({f: to_top_left(c[order] + margin) for f, c in points.items()}, None, between)
    raise InputError("it has no Corner Pin and no CC Power Pin with keys: copy the keys of all four corners")


def _number(word: str) -> float:
    try:
        number = float(word)
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise InputError(f"'{word}' is no number: the file is not as After Effects writes it")
    return number
