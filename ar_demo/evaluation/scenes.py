"""One sequence of SynthPlanar through the whole pipeline, and what came out against its true ad clip."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from dataclasses import replace as changed
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Image
from hdn.imaging.quads import is_convex
from hdn.state import State

from ..errors import InputError, RunError
from ..media.reader import VideoReader
from ..options import OutputOptions, TrackingOptions
from ..pipeline import replace
from ..surface import Moment, Surface
from ..tracks import Source, Track
from .quality import plain_warp, quality

COMPOSITES = ("ours", "true corners", "plain warp")
LOSSLESS = OutputOptions(codec="libx264rgb", crf=0.0, audio="none")
CELL = 320, 220  # px of a picture in a row


@dataclass(frozen=True)
class Scene:
    """A sequence of SynthPlanar.

    Attributes:
        clip, ad, truth: the poster's clip, the ad's image, and the clip with the ad.
        corners: (N, 4, 2) px, NaN where the surface is out of view.
        size: width and height, px. rate: frames per second.
        file: the JSON that says so.
    """

    name: str
    attribute: str
    clip: Path
    ad: Path
    truth: Path
    corners: Array
    size: tuple[int, int]
    rate: Fraction
    file: Path

    def limited(self, frames: int | None) -> "Scene":
        """Only its first frames; None keeps them all."""
        return self if frames is None else changed(self, corners=self.corners[:frames])

    def true_track(self) -> Track:
        """The truth as a track."""
        known = np.asarray(np.isfinite(self.corners).all((1, 2)))
        states: list[State] = ["tracked" if k else "lost" for k in known]
        times = [i / self.rate for i in range(len(states))]
        source = Source(str(self.clip), *self.size, self.rate, len(states))
        return Track(
            source, 0, self.corners[0], times, self.corners, states, np.asarray(known, np.float64), np.zeros(len(known))
        )


@dataclass(frozen=True)
class Scores:
    """Figures of one scene.

    Attributes:
        frames: (N, 3, 4) of COMPOSITES and evaluation_quality.NAMES, NaN where the surface is out of view.
        compositor: what drew, in words.
    """

    scene: Scene
    frames: Array
    compositor: str

    @property
    def mean(self) -> Array:
        """(3, 4) means over the frames."""
        return np.asarray(np.nanmean(self.frames, 0))

    @property
    def ranked(self) -> list[int]:
        """Frames from the worst to the best of our composites, by PSNR inside the quad."""
        inside = self.frames[:, 0, 0]
        return np.argsort(inside)[: np.isfinite(inside).sum()].tolist()


class Pictures(NamedTuple):
    """One frame (H, W, 3) as it was, as it would have been, and the three composites."""

    poster: Image
    truth: Image
    ours: Image
    true_corners: Image
    plain_warp: Image


def read_scenes(folder: Path) -> list[Scene]:
    """The sequences of a folder that hdn-synthplanar wrote.

    Raises:
        InputError: no such folder, none in it, or a part of one is missing.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder: give one that hdn-synthplanar wrote")
    scenes = []
    for file in sorted(folder.glob("*.json")):
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
            if not isinstance(data, dict) or data.get("generator") != "SynthPlanar":
                continue
            corners = [np.full((4, 2), np.nan) if c is None else c for c in data["corners"]]
            scene = Scene(
                name=file.stem,
                attribute=data["attributes"][0],
                clip=folder / f"{file.stem}.mp4",
                ad=folder / data["ad"]["image"],
                truth=folder / data["ad"]["clip"],
                corners=np.array(corners, np.float64).reshape(-1, 4, 2),
                size=(data["width"], data["height"]),
                rate=Fraction(data["fps"]),
                file=file,
            )
        except (ValueError, KeyError, TypeError, IndexError) as error:
            raise InputError(f"{file} is damaged: make it again with hdn-synthplanar") from error
        missing = [path for path in (scene.clip, scene.ad, scene.truth) if not path.is_file()]
        if missing:
            raise InputError(f"{missing[0]} is missing: make the sequence again with hdn-synthplanar")
        scenes.append(scene)
    if not scenes:
        raise InputError(f"{folder} holds no sequence of SynthPlanar: make some with hdn-synthplanar")
    return scenes


def evaluate(scene: Scene, weights: Path | None) -> tuple[Scores, dict[str, Image]]:
    """Runs the pipeline with its default options, and both other composites; compares all with the truth.

    Returns:
        The scores, and a row of pictures each of our "worst" and "median" frame.

    Raises:
        InputError, RunError: see `replace`.
    """
    last = Moment(frame=len(scene.corners) - 1)
    ours, truth = Surface(scene.ad, scene.corners[0]), Surface(scene.ad, track=scene.true_track(), lost="hide")
    tracking = TrackingOptions(end=last, weights=weights)
    with TemporaryDirectory() as name:
        folder = Path(name)
        result = replace(scene.clip, ours, folder / "ours.mkv", tracking, LOSSLESS, save_track=folder / "track.json")
        replace(scene.clip, truth, folder / "true_corners.mkv", options=LOSSLESS)
        frames = np.full((len(scene.corners), len(COMPOSITES), 4), np.nan)
        for index, pictures in enumerate(_pictures(scene, folder)):
            if np.isfinite(scene.corners[index]).all():
                for number, composite in enumerate(pictures[2:]):
                    figures = quality(composite, pictures.truth, scene.corners[index])
                    frames[index, number] = np.nan if figures is None else figures
        scores = Scores(scene, frames, result.compositor)
        wanted = {"worst": scores.ranked[0], "median": scores.ranked[len(scores.ranked) // 2]}
        rows = {}
        for index, pictures in enumerate(_pictures(scene, folder)):
            for kind in (kind for kind, at in wanted.items() if at == index):
                psnr, similar = frames[index, 0, :2]
                caption = f"{scene.name} {index}: PSNR {psnr:.1f} dB, SSIM {similar:.2f}. Poster, true, ours, plain"
                rows[kind] = _row(caption, scene.corners[index], pictures)
            if index == max(wanted.values()):
                break
    return scores, rows


def _pictures(scene: Scene, folder: Path) -> Iterator[Pictures]:
    """The scene's frames, with the composites that lie in a folder."""
    corners = Track.load(folder / "track.json").corners
    ad = cv2.imread(str(scene.ad), cv2.IMREAD_COLOR)
    if ad is None or len(corners) < len(scene.corners):
        raise RunError(f"{scene.clip} or {scene.ad} is not whole: make the sequence again with hdn-synthplanar")
    ad = np.asarray(cv2.cvtColor(ad, cv2.COLOR_BGR2RGB), np.uint8)
    files = (scene.clip, scene.truth, folder / "ours.mkv", folder / "true_corners.mkv")
    streams = [VideoReader(path).frames(0, len(scene.corners)) for path in files]
    for index, together in enumerate(zip(*streams, strict=True)):
        poster, truth, ours, true_corners = (frame.image for frame in together)
        plain = poster.copy()
        if np.isfinite(corners[index]).all() and is_convex(corners[index]):
            plain_warp(plain, ad, corners[index])
        yield Pictures(poster, truth, ours, true_corners, plain)


def _row(caption: str, quad: Array, pictures: Pictures) -> Image:
    """Poster, true ad, ours and plain warp around the quad, side by side under a caption."""
    shape = pictures.poster.shape
    low, high = quad.min(0), quad.max(0)
    margin = 0.12 * (high - low).max()
    x0, y0 = np.clip(np.floor(low - margin), 0, np.array(shape[1::-1]) - 16).astype(int)
    x1, y1 = np.clip(np.ceil(high + margin), [x0 + 16, y0 + 16], shape[1::-1]).astype(int)
    cells = [_cell(p[y0:y1, x0:x1]) for p in (pictures.poster, pictures.truth, pictures.ours, pictures.plain_warp)]
    line = np.full((22, CELL[0] * len(cells), 3), 24, np.uint8)
    cv2.putText(line, caption, (6, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return np.vstack([line, np.hstack(cells)])


def _cell(picture: Image) -> Image:
    """The picture as large as it goes in the middle of a cell."""
    scale = min(CELL[0] / picture.shape[1], CELL[1] / picture.shape[0])
    width, height = (max(1, min(limit, round(n * scale))) for n, limit in zip(picture.shape[1::-1], CELL, strict=True))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    cell = np.zeros((CELL[1], CELL[0], 3), np.uint8)
    top, left = (CELL[1] - height) // 2, (CELL[0] - width) // 2
    cell[top : top + height, left : left + width] = cv2.resize(picture, (width, height), interpolation=how)
    return cell
