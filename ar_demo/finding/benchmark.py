"""How often pictures are found, how exactly, and how often where they are not shown.

    python -m ar_demo.finding.benchmark seen FOLDER... [--out DIR]
    python -m ar_demo.finding.benchmark unseen --videos FOLDER --pictures FOLDER [--most N]
    python -m ar_demo.finding.benchmark speed VIDEO PICTURES

`seen` takes folders of clips with known corners (NAME.mp4 or .avi with NAME.json), where each picture is cut from the
clip's last known view and looked for in its first half, as it is and as a bad photograph of it; of pairs of views
(img1.webp and others with homographies), where a picture of the first view is looked for in each other one, whole and
its middle, at the size that it has and at a quarter; and of hdn-synthplanar, whose ads are looked for as they were
before they were drawn into the scene. `unseen` looks for many pictures in clips that show none of them.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from hdn import Observation
from hdn.commandline import DONE, Parser, natural, run
from hdn.imaging.arrays import Array, Image
from hdn.imaging.homography import from_corners, transform
from hdn.imaging.quads import is_drawable, mean_size, outline, side
from hdn.networks.loading import load_engine

from ..errors import InputError
from ..media.reader import VideoReader
from ..options import TrackingOptions
from ..progress import silent
from ..stopping import StopSignal
from ..surface import Moment, Span
from .pictures import Picture, read_pictures
from .search import Found, search
from .sightings import Sighting, is_whole

FOUND_PX = 10.0  # of a sighting's corners, root mean square, up to which the picture was found
HALF = 0.5  # of a clip, in which a picture from its other end is looked for
PAIR_SIZES = (1.0, 0.25)
SMALLEST_PX = 40.0  # side of the surface in the smallest view of a pair
MIN_SIDE_PX = 16.0  # of a surface whose corners are known


@dataclass(frozen=True)
class Case:
    """A picture, a video that shows it, and where.

    Attributes:
        group: of the table.
        truth: (4, 2) px, by frame.
        options: the part of the video that is searched.
    """

    group: str
    name: str
    picture: Picture
    video: Path
    truth: dict[int, Array]
    options: TrackingOptions


def cases(folder: Path, scratch: Path) -> Iterator[Case]:
    """The cases of a folder, see the module; what has to be written for them goes to the folder `scratch`."""
    for file in sorted(folder.rglob("img1.webp")):
        yield from _pairs(file.parent, scratch)
    for file in sorted(folder.glob("*.json")):
        known = json.loads(file.read_text())
        videos = [video for ending in (".mp4", ".avi") if (video := file.with_suffix(ending)).exists()]
        if isinstance(known, dict) and "corners" in known and videos:
            truth = _measured(known["corners"])
            drawn = folder / "ads" / f"{file.stem}.png"
            yield from (_drawn if drawn.exists() else _cut)(file.stem, videos[0], truth)


def _measured(corners: Sequence[Sequence[Sequence[float]] | None]) -> dict[int, Array]:
    """Corners (4, 2) by frame, where there are such of a surface."""
    known = {index: np.array(quad, np.float64) for index, quad in enumerate(corners) if quad is not None}
    return {index: quad for index, quad in known.items() if is_drawable(quad) and side(quad) > MIN_SIDE_PX}


def _pairs(folder: Path, scratch: Path) -> Iterator[Case]:
    first = _read(folder / "img1.webp")
    height, width = first.shape[:2]
    parts = {"whole": (0, 0, width, height), "middle": (width // 4, height // 4, 3 * width // 4, 3 * height // 4)}
    for part, (left, top, right, bottom) in parts.items():
        picture = Picture(folder / f"{part}.png", first[top:bottom, left:right])
        corners = outline(right - left, bottom - top) + np.array([left, top])
        for file in sorted(folder.glob("H*")):
            number = next(digit for digit in reversed(file.name) if digit.isdecimal())
            there = transform(np.loadtxt(file), corners)
            view = _read(folder / f"img{number}.webp")
            for size in PAIR_SIZES:
                if side(there) * size < SMALLEST_PX:
                    continue
                small = cv2.resize(view, None, fx=size, fy=size, interpolation=cv2.INTER_AREA)
                path = scratch / f"{folder.name}-{number}-{size}.png"
                cv2.imwrite(str(path), cv2.cvtColor(small, cv2.COLOR_RGB2BGR))
                scale = np.array(small.shape[1::-1]) / view.shape[1::-1]
                name = f"{folder.name} {part} in view {number} at {size}"
                yield Case(f"pairs, {part}", name, picture, path, {0: (there + 0.5) * scale - 0.5}, TrackingOptions())


def _cut(name: str, video: Path, truth: dict[int, Array]) -> Iterator[Case]:
    """A picture from the last view of a clip, for its first half."""
    with VideoReader(video) as reader:
        size, count = (reader.info.width, reader.info.height), len(reader.times)
        last = max(index for index, corners in truth.items() if is_whole(corners, *size))
        frame = next(reader.frames(last, last + 1)).view
    width, height = np.round(mean_size(truth[last])).astype(int).tolist()
    picture = Observation(frame).colour.crop(from_corners(outline(width, height), truth[last]), width, height)
    options = TrackingOptions(time=Span(None, Moment(frame=min(int(HALF * count), last - 1))))
    for group, image in (("clips", picture), ("clips, bad photograph", _photographed(picture))):
        try:
            yield Case(group, name, Picture(Path(f"{name}.png"), image), video, truth, options)
        except InputError as error:
            print(f"{name}: {error}", file=sys.stderr)


def _drawn(name: str, video: Path, truth: dict[int, Array]) -> Iterator[Case]:
    """The ad of a SynthPlanar scene, as it was before it was drawn."""
    ads = video.parent / "ads"
    picture = Picture(ads / f"{name}.png", _read(ads / f"{name}.png"))
    yield Case("SynthPlanar", name, picture, ads / f"{name}.mp4", truth, TrackingOptions())


def _photographed(picture: Image) -> Image:
    """The picture as a bad photograph: half as large, blurred, dark to one side, yellowish, noisy, and compressed."""
    small = (
        cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        if min(picture.shape[:2]) > 96
        else picture
    )
    rng = np.random.default_rng(0)
    light = np.linspace(0.5, 1.0, small.shape[1])[None, :, None] * np.array([1.0, 0.9, 0.7])
    photo = cv2.GaussianBlur(small, (0, 0), 0.8) * light + 20 + rng.normal(0, 4, small.shape)
    _, packed = cv2.imencode(".jpg", np.clip(photo, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 60])
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)


def _read(path: Path) -> Image:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{path} cannot be read: give a folder whose pictures are whole")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def searched(video: Path, pictures: Sequence[Picture], options: TrackingOptions) -> Found:
    """What is found in a video, with the shipped networks."""
    with VideoReader(video) as reader:
        return search(reader, pictures, options, load_engine, silent, StopSignal())


def _error(sighting: Sighting, truth: dict[int, Array]) -> float:
    """Root mean square over the corners, px; NaN where they are not known."""
    if sighting.index not in truth:
        return np.nan
    return float(np.sqrt(np.square(sighting.corners - truth[sighting.index]).sum(1).mean()))


def seen(folders: Sequence[Path]) -> int:
    """Prints a line for each case, and a table by groups."""
    rows: dict[str, list[tuple[float, float, float, float]]] = {}
    with TemporaryDirectory() as scratch:
        for case in (case for folder in folders for case in cases(folder, Path(scratch))):
            found = searched(case.video, [case.picture], case.options)
            sightings = [one for copy in found.instances[0] for each in copy.appearances for one in each.sightings]
            errors = [error for one in sightings if np.isfinite(error := _error(one, case.truth))]
            best = _error(found.instances[0][0].best, case.truth) if found.instances[0] else np.nan
            if found.instances[0] and not np.isfinite(best):
                best = float(np.median(errors)) if errors else np.nan
            wrong = sum(error > FOUND_PX for error in errors)
            print(f"{case.group}: {case.name}: seen in {len(sightings)} of {found.looks}, best {best:.2f} px, "
                  f"median {np.median(errors) if errors else np.nan:.2f} px, {wrong} wrong", flush=True)  # fmt: skip
            rows.setdefault(case.group, []).append(
                (best, float(np.median(errors)) if errors else np.nan, wrong, len(errors))
            )
    print("\n| pictures | cases | found | corners where tracking begins | corners, all sightings | wrong sightings |")
    print("|---|---|---|---|---|---|")
    for group, values in rows.items():
        best, median, wrong, count = np.array(values).T
        good = best <= FOUND_PX
        told = f"{np.median(best[good]):.2f}, {np.quantile(best[good], 0.9):.2f} px" if good.any() else "-"
        print(f"| {group} | {len(values)} | {good.sum()} | {told} | {np.nanmedian(median):.2f} px | "
              f"{int(wrong.sum())} of {int(count.sum())} |")  # fmt: skip
    return DONE


def unseen(videos: Path, folder: Path, most: int) -> int:
    """Looks for so many pictures, evenly chosen, in clips that do not show them; prints what it takes for one."""
    files = sorted(file for ending in ("webp", "png", "jpg") for file in folder.rglob(f"*.{ending}"))
    chosen = [files[i] for i in np.unique(np.linspace(0, len(files) - 1, most).round().astype(int))]
    pictures: list[Picture] = []
    for file in chosen:
        try:
            pictures += read_pictures([file])
        except InputError as error:
            print(error, file=sys.stderr)
    clips, wrong, hit = 0, 0, set()
    for video in sorted(file for ending in ("mp4", "avi") for file in videos.glob(f"*.{ending}")):
        found = searched(video, pictures, TrackingOptions())
        clips += 1
        for picture, copies in zip(pictures, found.instances, strict=True):
            if copies:
                wrong += 1
                hit.add(video)
                print(f"{video.name}: {picture.path}, {copies[0].best.summary()}", flush=True)
        near = [one.score for one in found.nearest if one is not None]
        like = f"{len(near)} pictures had a candidate, the best {max(near, default=0):.2f}"
        print(f"{video.name}: {found.looks} looks, {like}", flush=True)
    print(
        f"{clips} clips x {len(pictures)} pictures: {wrong} false finds of {clips * len(pictures)}, in {len(hit)} clips"
    )
    return DONE


def speed(video: Path, pictures: Sequence[Path]) -> int:
    """Prints how long a search takes, the networks' loading apart."""
    engine = load_engine()
    with VideoReader(video) as reader:
        count, read = len(reader.times), read_pictures(pictures)
        wall, cpu = time.perf_counter(), time.process_time()
        found = search(reader, read, TrackingOptions(), lambda: engine, silent, StopSignal())
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    print(f"{count} frames of {reader.info.width}x{reader.info.height}, {len(read)} pictures, {found.looks} looks: "
          f"{1000 * cpu / count:.1f} ms of processor time a frame, {count / wall:.0f} frames/s")  # fmt: skip
    return DONE


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point."""
    sys.exit(run(_command, arguments, "nothing was written"))


def _command(arguments: Sequence[str] | None) -> int:
    parser = Parser("ar_demo.finding.benchmark", "How well pictures are found in videos.")
    kinds = parser.add_subparsers(dest="kind", required=True, parser_class=argparse.ArgumentParser)
    kind = kinds.add_parser("seen")
    kind.add_argument("folders", type=Path, nargs="+")
    kind = kinds.add_parser("unseen")
    kind.add_argument("--videos", type=Path, required=True)
    kind.add_argument("--pictures", type=Path, required=True)
    kind.add_argument("--most", type=natural, default=60, metavar="N", help="pictures, evenly chosen (default 60)")
    kind = kinds.add_parser("speed")
    kind.add_argument("video", type=Path)
    kind.add_argument("pictures", type=Path, nargs="+")
    given = parser.parse_args(arguments)
    if given.kind == "seen":
        return seen(given.folders)
    return (
        unseen(given.videos, given.pictures, given.most)
        if given.kind == "unseen"
        else speed(given.video, given.pictures)
    )


if __name__ == "__main__":
    main()
