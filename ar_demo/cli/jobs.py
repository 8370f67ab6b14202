"""The job file: several surfaces of one video, each with its own ad, as JSON.

    {"surfaces": [
        {"ad": "shop.mp4", "quad": [[476, 128], [759, 122], [759, 480], [482, 476]]},
        {"ad": "sale.png", "quad": [[90, 60], [210, 64], [208, 170], [88, 160]], "start": "4.5s", "fit": "contain",
         "keyframes": [{"frame": 120, "corners": [[95, 61], [214, 66], [212, 171], [93, 162]]}]},
        {"effect": "blur", "track": "plate.track.json"}]}

A surface may have "ad", "track" and the fields of `Placing`; what it does not say is as on the command line. Files are
looked for beside the job file.
"""

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..options import Keyframe, Moment, Options, Placing, parse_quad
from ..pipeline import Surface
from ..track import Track

PLACING = tuple(field.name for field in fields(Placing))


def load_job(path: Path, common: Options) -> list[Surface]:
    """Reads the surfaces of a job file; `common` has what they do not say.

    Raises:
        InputError: not a job file, or a surface in it that is not as described.
    """
    try:
        content = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f"cannot read job file {path}: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{path} is not a job file (not JSON): see the README for its form") from error
    surfaces = content.get("surfaces") if isinstance(content, dict) else None
    if not isinstance(surfaces, list) or not surfaces or not all(isinstance(s, dict) for s in surfaces):
        raise InputError(f'{path} is not a job file: it must be {{"surfaces": [{{"ad": ..., "quad": ...}}, ...]}}')
    found = []
    for number, given in enumerate(surfaces, 1):
        try:
            found.append(_surface(given, path.parent, common))
        except InputError as error:
            raise InputError(f"surface {number} of {path}: {error}") from error
        except (KeyError, TypeError, ValueError) as error:
            reason = f"{type(error).__name__}: {error}".replace("\n", " ")
            raise InputError(f"surface {number} of {path} is not as it must be ({reason}): see the README") from error
    return found


def placing(common: Options, **given: Any) -> Placing:
    """What the options say of a surface, but for what is given."""
    return Placing(**{name: getattr(common, name) for name in PLACING} | given)


def _surface(given: dict[str, Any], folder: Path, common: Options) -> Surface:
    if unknown := given.keys() - {"ad", "track", *PLACING}:
        raise InputError(f"'{min(unknown)}' is unknown: choose ad, track, {', '.join(PLACING)}")
    values = {name: value for name, value in given.items() if name in PLACING}
    if "quad" in values:
        values["quad"] = parse_quad(values["quad"])
    if "start" in values:
        values["start"] = Moment.parse(values["start"])
    if "keyframes" in values:
        values["keyframes"] = tuple(
            Keyframe(Moment.parse(k["frame"]), parse_quad(k["corners"])) for k in values["keyframes"]
        )
    track = Track.load(folder / given["track"]) if "track" in given else None
    if track is None and "quad" not in values:
        raise InputError("it has neither quad nor track: give its corners")
    return Surface(folder / given["ad"] if given.get("ad") else None, placing(common, **values), track)
