"""Folders of images and clips, and what of them is in memory."""

import logging
import os
import random
import re
import zlib
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from pathlib import Path

import av
import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from ..synthesis import SIDE, Photos, read_photo, squared

HELD_OUT_SOURCES = ("kodak", "clic2025", "urban100", "val2017", "val2014")  # folders that training never sees
IMAGES = {".webp", ".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".ppm"}
VIDEOS = {".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v"}
IMAGES_IN_MEMORY = 8_000  # 2.2 GB
FRAMES_IN_MEMORY = 4_000  # of all clips together; 1.1 GB
MIN_FRAMES_OF_A_CLIP = 30  # at least, where it has them

Clip = Path | list[Path]  # a video file, or the images of its frames

log = logging.getLogger(__name__)


def walk(folders: Sequence[Path], option: str) -> Iterator[tuple[Path, list[str]]]:
    """Folders with the names of their files, both in order, through all trees.

    Raises:
        InputError: a folder is missing.
    """
    for root in folders:
        if not root.is_dir():
            raise InputError(f"{option} {root} is not a folder: name folders that exist")
        for path, below, names in os.walk(root):
            below.sort()
            yield Path(path), sorted(names)


def held_out(path: Path) -> bool:
    """Whether a path belongs to a source that is kept for validation."""
    return any(part in HELD_OUT_SOURCES for part in path.parts)


def find_images(folders: Sequence[Path]) -> list[Path]:
    """All images in the trees.

    Raises:
        InputError: a folder is missing, or there are none.
    """
    found = [p / n for p, names in walk(folders, "--images") for n in names if Path(n).suffix.lower() in IMAGES]
    if not found:
        raise InputError(f"no images under {', '.join(map(str, folders)) or 'no folder'}: name folders with --images")
    return found


def split(paths: Sequence[Path]) -> tuple[list[Path], list[Path], str]:
    """What is trained on, what is kept for validation, and how that was chosen.

    Held-out sources are kept. Without any of them it is every fiftieth image, by the checksums of their names.

    Raises:
        InputError: one of both would be empty.
    """
    kept = [p for p in paths if held_out(p)]
    rule = f"held out: {', '.join(sorted({part for p in kept for part in p.parts if part in HELD_OUT_SOURCES}))}"
    if not kept:
        kept = sorted(paths, key=lambda p: zlib.crc32(p.name.encode()))[: max(1, len(paths) // 50)]
        rule = "held out: every fiftieth, by its name's checksum"
    chosen = set(kept)
    trained = [p for p in paths if p not in chosen]
    if not trained:
        raise InputError(
            f"all {len(paths)} images are of held-out sources ({', '.join(HELD_OUT_SOURCES)}): name more --images"
        )
    return trained, kept, rule


class Pool(Photos):
    """Photos of which a limited number is in memory; `refresh` exchanges the oldest twentieth for others.

    What comes next is read by threads meanwhile. Which images are in memory when depends on the seed alone.
    """

    def __init__(self, paths: Sequence[Path], device: torch.device, seed: int, limit: int = IMAGES_IN_MEMORY) -> None:
        self.paths = random.Random(seed).sample(paths, len(paths)) if len(paths) > limit else list(paths)
        first = Photos.read(self.paths[:limit], device)
        super().__init__(first.pixels, device)
        self.taken = len(self)
        self.readers = ThreadPoolExecutor(4)
        self.coming: list[Future[Tensor]] = []
        self._read_on()

    def _read_on(self) -> None:
        if len(self.paths) > len(self):
            following = range(self.taken, self.taken + max(1, len(self) // 20))
            self.coming = [self.readers.submit(read_photo, self.paths[i % len(self.paths)]) for i in following]

    def refresh(self) -> None:
        """Exchanges images where there are more than fit; raises InputError for one that cannot be read."""
        for future in self.coming:
            self.pixels[self.taken % len(self)] = future.result().to(self.device)
            self.taken += 1
        self._read_on()


def find_clips(places: Sequence[Path]) -> list[Clip]:
    """Videos, and folders of at least two numbered frames, under folders; a place may be a video file itself.

    Those of held-out sources are left out.

    Raises:
        InputError: a place is missing, or there are no clips.
    """
    clips: list[Clip] = [p for p in places if p.is_file() and p.suffix.lower() in VIDEOS]
    for folder, names in walk([p for p in places if p not in clips], "--videos"):
        clips += [folder / n for n in names if Path(n).suffix.lower() in VIDEOS]
        numbers = {n: re.fullmatch(r"\D*(\d+)", Path(n).stem) for n in names if Path(n).suffix.lower() in IMAGES}
        frames = sorted((int(found[1]), name) for name, found in numbers.items() if found)
        if len(frames) > 1:
            clips.append([folder / name for _, name in frames])
    clips = [c for c in clips if not held_out(c if isinstance(c, Path) else c[0])]
    if not clips:
        raise InputError(f"no clips under {', '.join(map(str, places))}: give videos or folders of numbered frames")
    return clips


class Clips(Photos):
    """Frames of clips in memory, each clip's one after another.

    Where not all fit, each clip gives a stretch of its frames from somewhere in it, and some clips give none.
    """

    def __init__(self, clips: Sequence[Clip], device: torch.device, seed: int, limit: int = FRAMES_IN_MEMORY) -> None:
        chance = random.Random(seed)
        stretch = max(limit // len(clips), MIN_FRAMES_OF_A_CLIP)
        chosen = chance.sample(list(clips), min(len(clips), max(1, limit // stretch)))
        pixels: list[Tensor] = []
        first, last = [], []  # of the clip that each frame belongs to
        for clip in chosen:
            frames = list(islice(read_clip(clip, chance.random(), stretch), stretch))
            if len(frames) < 2:
                log.warning("%s has only %d frames: left out", clip if isinstance(clip, Path) else clip[0], len(frames))
                continue
            first += [len(pixels)] * len(frames)
            pixels += frames
            last += [len(pixels) - 1] * len(frames)
        if not pixels:
            raise InputError("no clip has two frames that can be read: name others with --videos")
        super().__init__(torch.stack(pixels), device)
        self.count = len(set(first))
        self.first, self.last = (torch.tensor(v, device=device) for v in (first, last))

    def pairs(self, batch: int, gap: int) -> tuple[Tensor, Tensor]:
        """Indices (B,) of frames, and of others (B,) of the same clips, up to `gap` frames before or after."""
        index = torch.randint(len(self), (batch,), device=self.device)
        step = torch.randint(1, gap + 1, (batch,), device=self.device)
        step = torch.where(torch.rand(batch, device=self.device) < 0.5, step, -step)
        later = (index + step).clamp(self.first[index], self.last[index])
        beyond = later == index  # a clip's end, looked beyond
        return index, torch.where(beyond, (index - step).clamp(self.first[index], self.last[index]), later)


def read_clip(clip: Clip, start: float, count: int) -> Iterator[Tensor]:
    """Frames of a clip, uint8 (3, SIDE, SIDE) each, from a share `start` of what may come before the last `count`.

    Raises:
        InputError: it cannot be read.
    """
    if not isinstance(clip, Path):
        begin = int(start * max(len(clip) - count + 1, 1))
        yield from map(read_photo, clip[begin:])
        return
    try:
        with av.open(str(clip)) as container:
            stream = container.streams.video[0]
            if container.duration and stream.average_rate:
                seconds = container.duration / av.time_base - count / float(stream.average_rate)
                container.seek(int(start * max(seconds, 0) * av.time_base))  # to the key frame before
            for frame in container.decode(stream):
                # Scaled by FFmpeg, so that no whole frame is ever converted.
                small = frame.reformat(SIDE, SIDE, "rgb24", interpolation="AREA")
                yield squared(np.asarray(small.to_ndarray(), np.uint8))
    except (av.FFmpegError, IndexError, OSError) as error:
        raise InputError(f"{clip} is not a video that can be read: remove it from the training folders") from error
