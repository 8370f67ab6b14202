"""`hdn-synthplanar`: makes sequences of a textured plane whose corners are known exactly, for benchmarks.

Each is a clip with the poster, NAME.mp4, its truth, NAME.json, and in the folder ads/ the same clip with an ad in the
poster's place, NAME.mp4, and that ad, NAME.png: the picture that a composite should come to. The folder is a data set
for `hdn-eval`.
"""

import argparse
import json
import sys
import zlib
from collections.abc import Iterable
from collections.abc import Sequence as Many
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from ...commandline import Parser, run
from ...errors import InputError, RunError
from .pictures import Pictures
from .render import Renderer, visible_corners
from .scenes import APPEARANCE, CHALLENGES, CONTROLS, INTERRUPTED, make_scene
from .video import FPS, Clip

VERSION = 3  # of the generator: whatever changes a sequence of a given seed raises it, and what is new
SEEDING = 1  # of the sequences' random numbers, apart from the version: what is new leaves other sequences as they are
ATTRIBUTES = CHALLENGES | INTERRUPTED | APPEARANCE | CONTROLS


@dataclass(frozen=True)
class Setting:
    """Frames of width x height, px, 16:9; how many of them by default.

    The height is even, the width a multiple of 128: with others, x264 makes not quite the same file each time.
    """

    width: int
    height: int
    frames: int


SEEN_SHARE = 0.005  # of the target, under which it counts as hidden wholly
SETTINGS = {"quick": Setting(640, 360, 150), "full": Setting(1280, 720, 500)}


def generate(
    out: Path, attribute: str, number: int, setting: Setting, frames: int, seed: int, pictures: Pictures
) -> Path:
    """Makes one sequence in the folder `out`, and returns its JSON file, which is written last.

    attribute: one of ATTRIBUTES. number: of the sequence, from 0. A seed means the same sequence whatever
    others are made beside it.

    Raises:
        InputError: a texture that cannot be read.
        RunError: writing fails.
    """
    name = _name(attribute, number)
    rng = np.random.default_rng([SEEDING, seed, zlib.crc32(attribute.encode()), number])
    challenge = ATTRIBUTES[attribute]
    cast = make_scene(challenge, setting.width, setting.height, frames, pictures, rng)
    crf = int(rng.integers(*challenge.crf))
    corners = visible_corners(cast.scene, frames)
    renderer = Renderer(cast.scene, frames, rng)
    visible = []
    try:
        (out / "ads").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"cannot make the folder {out / 'ads'}: {error.strerror}; choose another") from error
    with (
        Clip(out / f"{name}.mp4", setting.width, setting.height, crf) as clip,
        Clip(out / "ads" / f"{name}.mp4", setting.width, setting.height, crf) as ad_clip,
    ):
        for index in tqdm(range(frames), name, unit="frame", leave=False, disable=None):
            rendered = renderer.render(index)
            clip.write(rendered.poster)
            ad_clip.write(rendered.ad)
            if challenge.hidden and rendered.visible < SEEN_SHARE:
                corners[index] = None  # as where it is out of the frame: nobody can tell
            visible.append(0.0 if corners[index] is None else round(rendered.visible, 4))

    ad_image = out / "ads" / f"{name}.png"
    if not cv2.imwrite(str(ad_image), cv2.cvtColor(cast.ad, cv2.COLOR_RGB2BGR)):
        raise RunError(f"cannot write {ad_image}: see that there is room and leave to write there")
    rounded = [None if c is None else c.round(4).tolist() for c in corners]
    truth = {
        "generator": "SynthPlanar",
        "version": VERSION,
        "seed": seed,
        "attributes": [attribute],
        "width": setting.width,
        "height": setting.height,
        "fps": FPS,
        "shutter": round(cast.scene.shutter, 4),
        "crf": crf,
        "texture": cast.poster_name,
        "ad": {"image": f"ads/{name}.png", "clip": f"ads/{name}.mp4", "texture": cast.ad_name},
        "quad": rounded[0],
        "corners": rounded,
        "visible": visible,
    }
    path = out / f"{name}.json"
    try:
        path.write_text(json.dumps(truth), encoding="utf-8")
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}") from error
    return path


def made(out: Path, attribute: str, number: int, setting: Setting, frames: int, seed: int) -> bool:
    """Whether `generate` has made this sequence in the folder before, whatever its textures were."""
    try:
        truth = json.loads((out / f"{_name(attribute, number)}.json").read_text(encoding="utf-8"))
    except (FileNotFoundError, json.JSONDecodeError):
        return False
    wanted = {"version": VERSION, "seed": seed, "width": setting.width, "height": setting.height}
    return wanted.items() <= truth.items() and len(truth["corners"]) == frames


def _name(attribute: str, number: int) -> str:
    return f"{attribute.replace(' ', '-')}-{number + 1:02d}"


def main(arguments: Many[str] | None = None) -> None:
    """Entry point of hdn-synthplanar."""
    sys.exit(run(_command, arguments, "finished sequences are kept"))


def _command(arguments: Many[str] | None) -> int:
    options = _parser().parse_args(arguments)
    setting = SETTINGS[options.setting]
    pictures = Pictures(options.textures)
    group = INTERRUPTED if options.interrupted else APPEARANCE if options.appearance else CHALLENGES | INTERRUPTED
    named = options.attributes or group
    attributes = [_attribute(name) for name in named]
    for attribute in attributes:
        for number in range(options.sequences):
            frames = options.frames or setting.frames
            print(generate(options.out, attribute, number, setting, frames, options.seed, pictures), flush=True)
    return 0


def _attribute(name: str) -> str:
    attribute = name.replace("-", " ").lower()
    if attribute not in ATTRIBUTES:
        raise InputError(f"there is no attribute '{name}': choose from {_names(ATTRIBUTES)}")
    return attribute


def _names(attributes: Iterable[str]) -> str:
    return ", ".join(name.replace(" ", "-") for name in attributes)


def _parser() -> Parser:
    parser = Parser(
        prog="hdn-synthplanar",
        description="Make sequences of a moving poster with exact corners, each also with an ad in its place.",
    )
    parser.add_argument("out", type=Path, help="the folder to write to")
    parser.add_argument("--setting", choices=SETTINGS, default="quick", help="640x360 or 1280x720 (default quick)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--attributes",
        nargs="+",
        metavar="NAME",
        help=f"of {_names(CHALLENGES | INTERRUPTED)} (default all these); {_names(APPEARANCE)}, to see how well a "
        f"composite passes for real; or {_names(CONTROLS)}, to see how exact a tracker is",
    )
    which.add_argument(
        "--interrupted",
        action="store_true",
        help=f"only those whose view is covered or gone for long: {_names(INTERRUPTED)}",
    )
    which.add_argument("--appearance", action="store_true", help=f"only {_names(APPEARANCE)}")
    parser.add_argument("--sequences", type=_count, default=1, metavar="N", help="for each attribute (default 1)")
    parser.add_argument("--frames", type=_count, metavar="N", help="in each (default 150 quick, 500 full)")
    parser.add_argument("--seed", type=_seed, default=0, help="the same seed gives the same sequences (default 0)")
    parser.add_argument("--textures", type=Path, metavar="DIR", help="images to use (default: drawn by code)")
    return parser


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 1 on")
    return int(text)


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 0 on")
    return int(text)
