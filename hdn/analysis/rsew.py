"""Rotation-scale equivariant warping, seen and measured: on the log-polar warp, rotation and scale are shifts."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..benchmark.synthplanar.drawings import draw_poster
from ..errors import InputError
from ..imaging.arrays import Array, Image
from ..imaging.homography import similarity, translation
from ..imaging.pyramid import Pyramid
from ..networks.config import Config
from ..networks.polar import polar_points
from .figures import new_figure, save

# Scale and rotation (rad): none, the paper's extremes, and both at once.
MOTIONS = [(1.0, 0.0), (1.0, 0.35), (1.0, -0.7), (1.38, 0.0), (1 / 1.38, 0.0), (1.2, 0.5)]


@dataclass(frozen=True)
class View:
    """An image after a rotation and a change of scale about its centre, and what its log-polar warp makes of them.

    Attributes:
        crop, polar: the network's crop (n, n, 3) of it, and the log-polar crop (m, m, 3) of that.
        predicted, measured: (2,) shift of the log-polar crop against that of the image as it was, px: columns, rows.
    """

    scale: float
    rotation: float
    crop: Image
    polar: Image
    predicted: Array
    measured: Array


def views(image: Image, config: Config) -> list[View]:
    """The image (H, W, 3) under each of the motions."""
    reference = log_polar(crop(image, config.template_size, 1, 0), config)
    seen = []
    for scale, rotation in MOTIONS:
        moved = crop(image, config.template_size, scale, rotation)
        polar = log_polar(moved, config)
        predicted = np.array([np.log(scale) / config.log_scale_per_pixel, rotation / config.radians_per_pixel])
        seen.append(View(scale, rotation, moved, polar, predicted, measured_shift(reference, polar)))
    return seen


def crop(image: Image, size: int, scale: float, rotation: float) -> Image:
    """A crop (size, size, 3) about the image's centre after a rotation (rad) and a change of scale.

    It shows two thirds of the image's shorter side at scale 1, so that smaller scales still fill it.
    """
    height, width = image.shape[:2]
    unit = min(height, width) * 2 / 3 / size  # image px per crop px
    to_centre = translation(-(size - 1) / 2, -(size - 1) / 2)
    back = np.linalg.inv(similarity(scale / unit, rotation, 0, 0))
    return Pyramid(image).crop(translation((width - 1) / 2, (height - 1) / 2) @ back @ to_centre, size, size)


def log_polar(crop: Image, config: Config) -> Image:
    """The log-polar crop about the centre of a crop, as the networks see it."""
    points = polar_points(config) + np.float32((len(crop) - 1) / 2)
    return np.asarray(cv2.remap(crop, points, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def measured_shift(one: Image, other: Image) -> Array:
    """By how much the second log-polar crop (n, n, 3) is shifted against the first, px: columns, rows.

    Phase correlation: rows are cyclic as they are, columns fade out to both ends.
    """
    n = len(one)
    window = np.hanning(n)
    spectra = []
    for crop in (one, other):
        grey = crop.mean(2)
        spectra.append(np.fft.fft2((grey - grey.mean()) * window))
    cross = spectra[1] * spectra[0].conj()
    # A floor under the amplitudes, for the warp of few pixels to many has no fine detail but rounding errors.
    response = np.fft.ifft2(cross / (np.abs(cross) + 1e-3 * np.abs(cross).max())).real
    row, column = (int(i) for i in np.unravel_index(response.argmax(), response.shape))
    around = np.roll(response, (1 - row, 1 - column), (0, 1))[:3, :3]  # the peak is its middle
    shift = np.array([column + _vertex(*around[1]), row + _vertex(*around[:, 1])])
    return (shift + n / 2) % n - n / 2


def _vertex(before: float, at: float, after: float) -> float:
    """Where the parabola through three values at -1, 0 and 1 has its vertex."""
    bend = before - 2 * at + after
    return 0.5 * (before - after) / bend if bend else 0.0


def read_image(path: Path | None) -> Image:
    """An image file as RGB (H, W, 3), or a drawn poster.

    Raises:
        InputError: the file cannot be read as an image.
    """
    if path is None:
        return draw_poster((400, 400), np.random.default_rng(11))
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{path} cannot be read as an image: give a PNG or JPEG file")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def write(folder: Path, config: Config, image: Path | None) -> tuple[list[str], list[Path]]:
    """Writes the illustration into a folder; returns lines to print and the path written."""
    seen = views(read_image(image), config)
    path = folder / f"rsew-{config.name}.png"
    _draw(path, seen)
    lines = [f"{'scale':>6}{'rotation':>10}{'columns':>10}{'measured':>10}{'rows':>10}{'measured':>10}"]
    lines += [
        f"{v.scale:6.3f}{v.rotation:10.2f}{v.predicted[0]:10.2f}{v.measured[0]:10.2f}"
        f"{v.predicted[1]:10.2f}{v.measured[1]:10.2f}"
        for v in seen
    ]
    return lines, [path]


def _draw(path: Path, seen: list[View]) -> None:
    """Crops above, their log-polar warps below; an arrow shows where a point of the first has gone, as measured."""
    figure = new_figure(2 * len(seen), 4.9, dpi=72)
    columns = figure.subplots(2, len(seen)).T
    n = len(seen[0].polar)
    start = np.array([n / 2, n / 2])
    for (above, below), view in zip(columns, seen, strict=True):
        above.imshow(view.crop)
        above.set_title(f"scale {view.scale:.2f}\nrotation {view.rotation:.2f} rad", fontsize="small")
        below.imshow(view.polar)
        below.annotate(
            "",
            start + view.measured,
            start,
            arrowprops={"arrowstyle": "->", "color": "red", "linewidth": 2, "shrinkA": 0, "shrinkB": 0},
        )
        below.plot(*start, "o", color="red", markersize=4)
        shifts = "\n".join(
            f"{axis}: {p:+.1f}, measured {m:+.1f}"
            for axis, p, m in zip(("columns", "rows"), view.predicted, view.measured, strict=True)
        )
        below.set_xlabel(shifts, fontsize="small")
        for axes in (above, below):
            axes.set(xticks=[], yticks=[])
    columns[0][0].set_ylabel("image")
    columns[0][1].set_ylabel("log-polar warp")
    save(figure, path)
