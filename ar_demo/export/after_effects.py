"""After Effects' keyframe text, as it copies keys to the clipboard: Corner Pin and CC Power Pin.

Values are in the space of the layer that has the effect, px from its upper left corner, y down. A layer of another size
than the video's is taken to lie in the composition's middle, where After Effects puts it.
"""

from collections.abc import Sequence

import numpy as np

from .coordinates import BL, BR, TL, TR, from_top_left
from .keys import Keys, number

FIRST_LINE = "Adobe After Effects 8.0 Keyframe Data"
LAST_LINE = "End of Keyframe Data"
CORNER_PIN = {f"ADBE Corner Pin-000{n}": place for n, place in enumerate((TL, TR, BL, BR), 1)}
POWER_PIN = {f"CC Power Pin-000{n}": place for n, place in enumerate((TL, TR, BL, BR), 2)}


def corner_pin(keys: Keys) -> str:
    """Keys of the effect Corner Pin."""
    return _keyframes(keys, "ADBE Corner Pin", CORNER_PIN)


def power_pin(keys: Keys) -> str:
    """Keys of the effect CC Power Pin."""
    return _keyframes(keys, "CC Power Pin", POWER_PIN)


def _keyframes(keys: Keys, effect: str, properties: dict[str, int]) -> str:
    source = keys.track.source
    aspect = number(float(source.pixel_aspect), 6)
    margin = (np.array(keys.size) - keys.insert) / 2
    corners = from_top_left(keys.corners) - margin
    lines = [
        FIRST_LINE,
        "",
        f"\tUnits Per Second\t{float(source.fps):.7g}",
        f"\tSource Width\t{keys.insert[0]}",
        f"\tSource Height\t{keys.insert[1]}",
        f"\tSource Pixel Aspect Ratio\t{aspect}",
        f"\tComp Pixel Aspect Ratio\t{aspect}",
        "",
    ]
    for name, place in properties.items():
        lines += [f"Effects\t{effect} #1\t{name}", "\tFrame\tX pixels\tY pixels\t"]
        lines += _rows(keys.frames, corners[:, place])
        lines.append("")
    return "\n".join([*lines, "", LAST_LINE, ""])


def _rows(frames: Sequence[int], points: np.ndarray) -> list[str]:
    return [f"\t{frame}\t{number(x)}\t{number(y)}\t" for frame, (x, y) in zip(frames, points, strict=True)]
