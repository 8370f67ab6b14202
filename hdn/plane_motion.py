"""The motion of a target's plane from one frame to the next, by the parts of it that are seen in both."""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from .alignment.agreement import CELLS
from .alignment.lucas_kanade import Level
from .imaging.arrays import Array, Floats
from .imaging.homography import normalised, transform
from .imaging.pyramid import Pyramid
from .imaging.quads import is_convex


@dataclass(frozen=True)
class PlaneMotionModel:
    """Constants of the plane's motion; px are those of the crop."""

    sides_px: tuple[int, ...] = (40, 80)  # the target's longer side in the crops, coarse to fine
    blur_px: float = 1.0
    points: tuple[int, ...] = (2000, 4000)
    steps: int = 3  # per crop
    settled_px: float = 0.2
    min_correlation: float = 0.6
    min_agreement: float = 0.5
    min_trust: float = 3.0  # sum of the cells' trust, below which there is nothing to follow
    # Standard deviation that a step adds to the eight parameters whatever it claims, px at the edge of the standard crop.
    deviation_px: tuple[float, ...] = (0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.12, 0.12)


MODEL = PlaneMotionModel()
OWN_COVARIANCE = np.diag(np.square(MODEL.deviation_px))


class Step(NamedTuple):
    """The plane's motion.

    Attributes:
        homography: (3, 3) pixels of the frame before to those of this one.
        covariance: (8, 8) of it, px^2 at the edge of the standard crop.
        agreement: share of the trusted cells that agree, 0..1.
    """

    homography: Array
    covariance: Array
    agreement: float


def plane_motion(
    before: Pyramid, after: Pyramid, corners: Array, lengths: Array, trust: Floats, margin: int, standard_side: int,
    starts: list[Array], prior_covariance: Array,
) -> Step | None:
    trust, margin = _cropped(trust, margin)
    levels = []
    for side, points in zip(MODEL.sides_px, MODEL.points, strict=True):
        size = np.maximum(np.round(side * lengths / lengths.max() / CELLS), 3).astype(int) * CELLS
        levels.append(Level(before, corners, (int(size[0]), int(size[1])), MODEL.blur_px, standard_side, points, margin))
    best = None
    for start in starts:
        found = _align(levels, after, start, trust, prior_covariance)
        if found is not None and (best is None or found.agreement > best.agreement) and is_convex(transform(found.homography, corners)):
            best = found
            if best.agreement > 0.9:
                break
    return best


def _align(levels: list[Level], frame: Pyramid, start: Array, trust: Floats, prior: Array) -> Step | None:
    pose = start
    scale = len(trust) // levels[0].cells
    cells = cv2.resize(trust, (levels[0].cells,) * 2, interpolation=cv2.INTER_AREA)
    for level in levels:
        for _ in range(MODEL.steps):
            search = level.rectify(frame, pose)
            correlation = level.correlation(search)
            weight = cells * level.in_frame(frame, pose)
            if weight.sum() < MODEL.min_trust:
                return None
            good = correlation > MODEL.min_correlation
            weight = level.in_frame(frame, pose).astype(np.float32)
            if (weight * cells * good).sum() > 0.3 * (weight * cells).sum():
                weight = weight * np.clip((correlation - 0.3) / 0.4, 0, 1)
            weight = trust * np.repeat(np.repeat(weight, scale, 0), scale, 1)
            warp_prior = level.from_template @ np.linalg.inv(pose) @ start @ level.to_template
            warp, covariance = level.align(search, weight.astype(np.float32), warp_prior, prior)
            pose = normalised(pose @ level.to_template @ warp @ level.from_template)
            if not np.isfinite(pose).all():
                return None
            if level.corner_motion(warp) < MODEL.settled_px:
                break
    correlation = level.correlation(level.rectify(frame, pose))
    weight = cells * level.in_frame(frame, pose)
    agreement = float((weight * (correlation > MODEL.min_correlation)).sum() / max(weight.sum(), 1e-6))
    if agreement < MODEL.min_agreement:
        return None
    return Step(pose, covariance + OWN_COVARIANCE, agreement)


def _cropped(trust: Floats, margin: int) -> tuple[Floats, int]:
    """Trust (m, m) without the outer cells that have none, and how many cells of margin are left."""
    scale = len(trust) // (CELLS + 2 * margin)
    cut = 0
    while cut < margin:
        ring = trust[cut * scale : len(trust) - cut * scale, cut * scale : len(trust) - cut * scale]
        if max(ring[:scale].max(), ring[-scale:].max(), ring[:, :scale].max(), ring[:, -scale:].max()) > 0:
            break
        cut += 1
    return np.ascontiguousarray(trust[cut * scale : len(trust) - cut * scale, cut * scale : len(trust) - cut * scale]), margin - cut
