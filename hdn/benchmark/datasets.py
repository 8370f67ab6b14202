"""Readers of planar-tracking data sets, each in the layout in which it is published.

The public sets are not ours to ship, and no reader here was tried on a whole original: layouts were taken from the
sources that each reader names. Corners are used as the files give them; whether those count pixels from 0 or from 1
none of the sources says, so that a constant offset of up to 1 px is possible.
"""

import json
import logging
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from ..errors import InputError
from ..imaging.arrays import Array
from ..imaging.homography import transform
from .sequences import IMAGES, Sequence, find_source

log = logging.getLogger(__name__)

Reader = Callable[[Path], list[Sequence]]

POT_ATTRIBUTES = (
    "scale",
    "rotation",
    "perspective",
    "motion blur",
    "occlusion",
    "out of view",
    "unconstrained",
)
PLANARTRACK_ATTRIBUTES = (
    "occlusion",
    "motion blur",
    "rotation",
    "scale",
    "perspective",
    "out of view",
    "low resolution",
    "background clutter",
)


def open_dataset(spec: str) -> list[Sequence]:
    """The sequences of a data set, by name.

    Args:
        spec: a folder, whose layout is recognised, or READER:FOLDER to name it, as in pot210:/data/POT.

    Raises:
        InputError: no such folder, no known layout, annotations that do not make sense, no frames at all.
    """
    reader, _, rest = spec.partition(":")
    if reader in READERS:
        folder = Path(rest)
    else:
        folder = Path(spec)
        reader = _recognise(folder)
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder: give one that holds a data set")
    sequences = READERS[reader](folder)
    if not sequences:
        raise InputError(f"{folder} has annotations but no frames for any of them: put videos or image folders there")
    return sequences


def read_pot280(root: Path) -> list[Sequence]:
    """POT-280 (Liang et al., 2021): POT-210 and the objects V31 to V40, or as much of them as is there.

    Layout: V01/V01_1.avi (or a folder V01/V01_1 of images) and annotation/V01_1_gt_points.txt, V01_1_flag.txt,
    V01_1_gt_homography.txt, a row for each of the 501 frames. The points are x1 y1 .. x4 y4; every second frame is
    annotated (0, 1, 3, 5, ..), the rows of the others are blank (zeros or NaN). Flags: 0 normal, 1 occluded for more
    than half, 2 out of view for more than half, 3 heavily blurred; only frames with flag 0 count. The suffix of a name,
    1 to 7, is the challenge. Sources: README.txt on POT-210's page (Stony Brook University); which frames are annotated
    and that the other rows are blank: evaluation code of HDN and of WOFT.
    Not confirmed: that the suffixes follow the order in which the paper lists the challenges, as POT_ATTRIBUTES does,
    and that POT-280 keeps POT-210's layout in every file.
    """
    return _pot(root, "POT-280")


def read_pot210(root: Path) -> list[Sequence]:
    """POT-210 (Liang et al., ICRA 2018): the objects V01 to V30 of the layout that `read_pot280` describes."""
    return [s for s in _pot(root, "POT-210") if int(s.name[1:3]) <= 30]


def read_planartrack(root: Path) -> list[Sequence]:
    """PlanarTrack (Liu et al., ICCV 2023); where a list of test sequences is there, those alone.

    Layout: sequences/Seq_00001/ of images; annotation/ (in the download: annos/) with Seq_00001.txt (x1 y1 .. x4 y4,
    zeros where not annotated), Seq_00001_flag.txt (0 where the frame counts), Seq_00001_homography.txt;
    challenging_factor/Seq_00001_challenging_factor.txt (eight 0 or 1, separated by commas), beside the annotations'
    folder or in it; test_split/test_seq.txt or training-test-splits/test_seq.txt. Sources: the evaluation toolkit
    HengLan/PlanarTrack and its annotation files; for the download's folders, WOFT's evaluation code.
    """
    annotations = next((f for f in (root / "annos", root / "annotation") if f.is_dir()), root)
    lists = [root / folder / "test_seq.txt" for folder in ("test_split", "training-test-splits")]
    tested = next((set(_text(path).split()) for path in lists if path.is_file()), None)
    sequences = []
    for path in sorted(annotations.glob("*_flag.txt")):
        name = path.name.removesuffix("_flag.txt")
        if tested is not None and name not in tested:
            continue
        rows = _corners(annotations / f"{name}.txt")
        factors = [f / "challenging_factor" / f"{name}_challenging_factor.txt" for f in (annotations, root)]
        present = next((_numbers(f, 8)[0] for f in factors if f.is_file()), np.zeros(8))
        attributes = tuple(a for a, there in zip(PLANARTRACK_ATTRIBUTES, present, strict=True) if there > 0)
        truth = _counted(rows, path)
        sequences.append(_sequence("PlanarTrack", name, [root / "sequences", root], rows[0], truth, attributes))
    return _present(sequences, root)


def read_poic(root: Path) -> list[Sequence]:
    """POIC (Chen et al., "Robust Visual Tracking for Planar Objects Using Gradient Orientation Pyramid", 2019).

    20 sequences with changes of light. Layout: sequences/bear/frame00001.jpg .., gt/bear.txt with a heading (frame ulx
    uly urx ury lrx lry llx lly) and rows of a frame's name and the corners. Source: the authors' repository,
    LinChen-Cherry/POIC, which names no attributes.
    """
    return _framed(root, "POIC", root / "gt", [root / "sequences"])


def read_ucsb(root: Path) -> list[Sequence]:
    """UCSB (Gauglitz et al., IJCV 2011): 6 textures, 16 kinds of motion or light each.

    Layout: TEXTURE_MOTION/ of images and TEXTURE_MOTION.txt beside it, with a heading (frame ulx uly urx ury lrx lry
    llx lly) and rows of a frame's name and the corners. The motion is the attribute: bricks_motion4 has "motion".
    Sources: HDN's evaluation code and the Modular Tracking Framework, in whose form the set is passed on.
    Not confirmed: the authors' own archive, which seems to give warps instead of corners; it is not read here.
    """
    sequences = _framed(root, "UCSB", root, [root])
    attributes = [s.name.partition("_")[2].rstrip("0123456789").replace("_", " ") for s in sequences]
    return [
        Sequence(s.dataset, s.name, s.source, s.quad, s.truth, (a,) if a else ())
        for s, a in zip(sequences, attributes, strict=True)
    ]


def read_clips(root: Path) -> list[Sequence]:
    """Any folder of clips: NAME.mp4 (or .avi .mov .mkv .webm .m4v, or a folder NAME of images) beside NAME.json.

    The JSON object has "corners": for each frame four [x, y], px, centre of the top-left pixel (0, 0), or null where
    unknown; "quad": the target in the first frame, where that differs from the first corners; and, where there are any,
    "attributes": a list of names. A JSON file without corners is none of ours and is passed over.
    """
    sequences = []
    for path in sorted(root.glob("*.json")):
        data = _json(path)
        if not isinstance(data, dict) or not isinstance(data.get("corners"), list) or not data["corners"]:
            continue
        rows = [np.full((4, 2), np.nan) if c is None else _quad(c, path) for c in data["corners"]]
        quad = _quad(data["quad"], path) if "quad" in data else rows[0]
        attributes = tuple(str(a) for a in data.get("attributes", []))
        sequences.append(_sequence(root.resolve().name, path.stem, [root], quad, np.stack(rows), attributes))
    return _present(sequences, root)


def read_pairs(root: Path) -> list[Sequence]:
    """Pairs of images: each is a sequence of two frames, and the target the inner half of the first image.

    Layout, of Oxford's affine covariant features and of HPatches: a folder a scene (or one scene alone) with img1.*,
    img2.* .. (or 1.*, 2.* ..), and H1to2p .. (or H_1_2 ..) that map pixels of the first image to the other's.
    """
    scenes = [root, *sorted(f for f in root.iterdir() if f.is_dir())]
    sequences = []
    for scene in scenes:
        images = {p.stem.removeprefix("img"): p for p in scene.iterdir() if p.suffix.lower() in IMAGES}
        for path in sorted(scene.iterdir()):
            match = HOMOGRAPHY.match(path.name)
            if match is None:
                continue
            if "1" not in images or match[1] not in images:
                raise InputError(f"{path} has no images img1 and img{match[1]} beside it: put them there")
            first = cv2.imread(str(images["1"]), cv2.IMREAD_COLOR)
            if first is None:
                raise InputError(f"{images['1']} cannot be read as an image: copy it again from its data set")
            right, bottom = first.shape[1] - 1, first.shape[0] - 1
            quad = np.array([[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]]) * [right, bottom]
            truth = np.stack([quad, transform(_numbers(path, 3).reshape(3, 3), quad)])
            name = f"{scene.resolve().name}_1_{match[1]}"
            sequences.append(Sequence(root.resolve().name, name, (images["1"], images[match[1]]), quad, truth))
    return sequences


HOMOGRAPHY = re.compile(r"^H_?1(?:to|_)(\d+)p?$")

READERS: dict[str, Reader] = {
    "pot210": read_pot210,
    "pot280": read_pot280,
    "planartrack": read_planartrack,
    "poic": read_poic,
    "ucsb": read_ucsb,
    "clips": read_clips,
    "pairs": read_pairs,
}


def _recognise(root: Path) -> str:
    """The reader for a folder, by what lies in it."""
    if not root.is_dir():
        raise InputError(f"{root} is not a folder: give one that holds a data set")
    if _pot_annotations(root):
        return "pot280"
    if any((root / folder).is_dir() for folder in ("annos", "annotation")):
        return "planartrack"
    if (root / "gt").is_dir() and (root / "sequences").is_dir():
        return "poic"
    if any(path.with_suffix("").is_dir() for path in root.glob("*.txt")):
        return "ucsb"
    if any(root.glob("*.json")):
        return "clips"
    if any(HOMOGRAPHY.match(path.name) for pattern in ("*", "*/*") for path in root.glob(pattern)):
        return "pairs"
    raise InputError(f"{root} is laid out as no data set known here: name its reader, one of {', '.join(READERS)}")


def _pot_annotations(root: Path) -> list[Path]:
    folders = (root, root / "annotation", root / "annotation" / "annotation")
    return [path for folder in folders for path in sorted(folder.glob("V[0-9][0-9]_[0-9]_gt_points.txt"))]


def _pot(root: Path, dataset: str) -> list[Sequence]:
    sequences = []
    for path in _pot_annotations(root):
        name = path.name.removesuffix("_gt_points.txt")
        rows = _corners(path)
        truth = _counted(rows, path.with_name(f"{name}_flag.txt"))
        folders = [root / name[:3], root, root / "extracted" / "images"]
        challenge = int(name[4:]) - 1
        attributes = POT_ATTRIBUTES[challenge : challenge + 1]
        sequences.append(_sequence(dataset, name, folders, rows[0], truth, attributes))
    return _present(sequences, root)


def _framed(root: Path, dataset: str, annotations: Path, folders: list[Path]) -> list[Sequence]:
    """Sequences whose corner files have a heading, and a frame's name before the corners."""
    sequences = []
    for path in sorted(annotations.glob("*.txt")):
        if "frame" not in _text(path)[:200].lower():
            continue  # a readme or the like
        rows = _corners(path, heading=1, names=1)
        sequences.append(_sequence(dataset, path.stem, folders, rows[0], rows, ()))
    return _present(sequences, root)


def _sequence(
    dataset: str, name: str, folders: list[Path], quad: Array, truth: Array, attributes: tuple[str, ...]
) -> Sequence:
    if np.isnan(quad).any():
        raise InputError(f"{dataset}, {name}: its first frame has no corners to start from")
    return Sequence(dataset, name, find_source(name, folders) or (), quad, truth, attributes)


def _present(sequences: list[Sequence], root: Path) -> list[Sequence]:
    """Those whose frames are there: a part of a large set may be all that was downloaded."""
    present = [s for s in sequences if s.source]
    if len(present) < len(sequences):
        log.warning("%s: no frames for %d of %d sequences", root, len(sequences) - len(present), len(sequences))
    return present


def _counted(rows: Array, flags: Path) -> Array:
    """The corners of the frames whose flag is 0."""
    values = _numbers(flags, 1)[:, 0]
    if len(values) != len(rows):
        raise InputError(f"{flags} has {len(values)} flags for {len(rows)} frames: copy it again from its data set")
    return np.where((values == 0)[:, None, None], rows, np.nan)


def _corners(path: Path, heading: int = 0, names: int = 0) -> Array:
    """Rows x1 y1 .. x4 y4 as (N, 4, 2); blank ones, all zero or not a number, as NaN."""
    rows = _numbers(path, 8, heading, names).reshape(-1, 4, 2)
    blank = np.isnan(rows).any((1, 2)) | (rows == 0).all((1, 2))
    rows[blank] = np.nan
    return rows


def _numbers(path: Path, columns: int, heading: int = 0, names: int = 0) -> Array:
    """A table of numbers (N, columns) separated by blanks or commas, after `heading` lines and `names` leading words.

    Raises:
        InputError: no such file, an empty one, or a row that is not as said.
    """
    rows = []
    for number, line in enumerate(_text(path).splitlines()[heading:], heading + 1):
        words = line.replace(",", " ").split()[names:]
        if not words:
            continue
        try:
            rows.append([float(word) for word in words])
        except ValueError:
            rows.append([])
        if len(rows[-1]) != columns:
            raise InputError(f"{path}, line {number}: {columns} numbers are expected; copy it again from its data set")
    if not rows:
        raise InputError(f"{path} holds no numbers: copy it again from its data set")
    return np.array(rows)


def _quad(value: object, path: Path) -> Array:
    try:
        quad = np.array(value, np.float64)
    except (TypeError, ValueError):
        quad = np.empty(0)
    if quad.shape != (4, 2):
        raise InputError(f"{path}: corners are four [x, y] for each frame, or null")
    return quad


def _json(path: Path) -> object:
    try:
        return json.loads(_text(path))
    except json.JSONDecodeError as error:
        raise InputError(f"{path} is not valid JSON (line {error.lineno}): correct or remove it") from error


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError as error:
        raise InputError(f"{path} is missing: copy it from its data set") from error
