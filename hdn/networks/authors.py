"""Tracking as the HDN authors' released code does it, for parity with it and as a baseline of speed.

Whole frames are warped and rotated, windows are cut at whole pixels, the best cell decides alone, and homographies
accumulate. `tracker.Tracker` samples its crops straight from the frame, and refines against the template instead.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..imaging.arrays import Array, Floats, Image
from ..imaging.homography import normalised, similarity, transform, translation
from .engine import Shift
from .geometry import polar_crop
from .polar import polar_points
from .pytorch import Hdn


@dataclass(frozen=True)
class Thresholds:
    """Where the authors' tracker trusts its networks; all values are those of their released configuration."""

    window_influence: float = 0.16325  # share that a Hann window has in the choice of the translation's best cell
    centre_score: float = 0.05  # of translation, 0..1: under it the centre stays
    similarity_score: float = 0.25  # of the log-polar branch, 0..1: under it scale and rotation stay
    residual_distance: float = 2.5  # between features, standard deviations of grey: above it the residual is dropped


THRESHOLDS = Thresholds()


def cut_window(frame: Image, centre: Array, size: float, crop_size: int, fill: Array) -> Image:
    """A square window of a frame, cut at whole pixels and resized; what lies outside the frame has the fill colour."""
    side = int(size)
    left, top = (int(v) for v in window_corner(centre, side))
    height, width = frame.shape[:2]
    window = np.empty((side, side, 3), np.uint8)
    window[:] = fill.astype(np.uint8)
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + side, width), min(top + side, height)
    if x0 < x1 and y0 < y1:
        window[y0 - top : y1 - top, x0 - left : x1 - left] = frame[y0:y1, x0:x1]
    return np.asarray(cv2.resize(window, (crop_size, crop_size)), np.uint8)


def window_corner(centre: Array, side: int) -> Array:
    """Top-left pixel (2,) of a window."""
    return np.floor(centre - (side - 1) / 2 + 0.5)


def decode(cls: Floats, loc: Floats, stride: int, influence: float) -> Shift:
    """The shift at the best cell of logits (1, 2, n, n) and offsets (1, 2 or 4, n, n), px of the crop.

    Args: influence: share that a Hann window has in the choice; 0 for none.
    """
    score = 1 / (1 + np.exp(cls[0, 0] - cls[0, 1]))  # softmax of two
    n = score.shape[0]
    window = np.outer(np.hanning(n), np.hanning(n))
    row, column = divmod(int((score * (1 - influence) + window * influence).argmax()), n)
    dx, dy = loc[0, :: loc.shape[1] // 2, row, column]
    return Shift(float(column - n // 2 - dx) * stride, float(row - n // 2 - dy) * stride, float(score[row, column]))


class AuthorsTracker:
    """The authors' tracker on the paper's networks, in single precision.

    Example:
        tracker = AuthorsTracker(pytorch.load(path))
        tracker.init(first_frame, quad)
        for frame in frames:
            homography = tracker.track(frame)
    """

    def __init__(self, network: Hdn, device: str = "cpu") -> None:
        self.device = torch.device(device)
        self.network = network.to(self.device).eval()
        self.config = network.config
        # Their grid is divided by half the crop's size rounded down, so it is a little larger than the template's.
        n = self.config.search_size
        self._points = polar_points(self.config)
        self._search_points = torch.from_numpy(self._points * (n / (2 * (n // 2)))).to(self.device)

    @torch.inference_mode()
    def init(self, frame: Image, quad: Array) -> None:
        """Takes the target: its quad (4, 2), px, in an RGB frame (H, W, 3)."""
        c, s = self.config, self.network.similarity
        self.centre = quad.mean(0)
        width, height = quad.max(0) - quad.min(0)
        margin = c.context * (width + height)
        self.side = int(np.sqrt((width + margin) * (height + margin)))  # of the template's window, px
        self.residual_side = int(np.sqrt(width * height))
        self.fill = frame.mean((0, 1))
        self.template = cut_window(frame, self.centre, self.side, c.template_size, self.fill)
        self.template_polar = np.asarray(
            cv2.remap(self.template, self._points + np.float32(c.template_size // 2), None, cv2.INTER_LINEAR), np.uint8
        )
        self.residual_template = cut_window(frame, self.centre, self.residual_side, c.residual_size, self.fill)
        self.residual_grey = self.grey(self.residual_template)
        self.kernel = s.encode_template(s.backbone(self._tensor(self.template)))
        self.polar_kernel = s.encode_polar_template(s.backbone(self._tensor(self.template_polar)))
        self.homography = np.eye(3)

    @torch.inference_mode()
    def track(self, frame: Image) -> Array:
        """The homography (3, 3), reference-frame pixels to those of the next RGB frame."""
        frame = self.rectify(frame)
        shift = self.locate(*self.translation_maps(self.search_crop(frame, self.centre)))
        centre = self.centre + np.array([shift.x, shift.y]) * self.side / self.config.template_size
        scale, rotation = 1.0, 0.0
        if shift.score >= THRESHOLDS.centre_score:
            scale, rotation = self.scale_and_rotation(*self.polar_maps(self.search_crop(frame, centre)))
        residual, distance = self.residual(self.grey(self.residual_crop(frame, centre, scale, rotation)))
        self.homography = self.compose(
            centre, scale, rotation, residual if distance <= THRESHOLDS.residual_distance else np.eye(3)
        )
        return self.homography

    def rectify(self, frame: Image) -> Image:
        """The frame, warped back by the last homography."""
        height, width = frame.shape[:2]
        back = np.linalg.inv(self.homography)
        return np.asarray(cv2.warpPerspective(frame, back, (width, height), borderMode=cv2.BORDER_REPLICATE), np.uint8)

    def search_crop(self, frame: Image, centre: Array) -> Image:
        """The search crop about a point of the rectified frame."""
        return cut_window(frame, centre, 2 * self.side, self.config.search_size, self.fill)

    def residual_crop(self, frame: Image, centre: Array, scale: float, rotation: float) -> Image:
        """The residual crop after rotating the rectified frame back and scaling the window."""
        height, width = frame.shape[:2]
        turn = translation(*centre) @ similarity(1.0, -rotation, 0, 0) @ translation(*-centre)
        turned = cv2.warpAffine(frame, turn[:2], (width, height), borderMode=cv2.BORDER_REPLICATE)
        side = self.residual_side * scale
        return cut_window(np.asarray(turned, np.uint8), centre, side, self.config.residual_size, self.fill)

    def translation_maps(self, crop: Image) -> tuple[Floats, Floats]:
        """Search crop to logits (1, 2, 25, 25) and offsets (1, 2, 25, 25)."""
        s = self.network.similarity
        return _arrays(*s.translation(self.kernel, s.encode_search(s.backbone(self._tensor(crop)))))

    def polar_maps(self, crop: Image) -> tuple[Floats, Floats]:
        """Search crop about the target's centre to logits (1, 2, 13, 13) and offsets (1, 4, 13, 13)."""
        s = self.network.similarity
        polar = self.search_polar(crop)
        return _arrays(*s.polar(self.polar_kernel, s.encode_polar_search(s.backbone(polar))))

    def search_polar(self, crop: Image) -> Tensor:
        """Log-polar image (1, 3, 127, 127), 0..255, about the centre of a search crop."""
        return polar_crop(self._tensor(crop), torch.zeros(1, 2, device=self.device), self._search_points)

    def locate(self, cls: Floats, loc: Floats) -> Shift:
        """Translation, px of the search crop; none where the score is too low."""
        shift = decode(cls, loc, self.config.stride, THRESHOLDS.window_influence)
        return shift if shift.score >= THRESHOLDS.centre_score else Shift(0.0, 0.0, shift.score)

    def scale_and_rotation(self, cls: Floats, loc: Floats) -> tuple[float, float]:
        """Scale and rotation (rad); none where the score is too low."""
        shift = decode(cls, loc, self.config.stride, 0.0)
        if shift.score < THRESHOLDS.similarity_score:
            return 1.0, 0.0
        return float(np.exp(shift.x * self.config.log_scale_per_pixel)), shift.y * self.config.radians_per_pixel

    def grey(self, crop: Image) -> Tensor:
        """A residual crop as the residual network takes it: (1, 1, 127, 127)."""
        return self.network.residual.prepare(self._tensor(crop))

    def residual(self, search: Tensor) -> tuple[Array, float]:
        """Homography (3, 3), template to search pixels of the residual crop, and the features' distance after it."""
        n = self.network.residual
        offsets, _, embedded = n(self.residual_grey, search)
        matrix = n.homography(offsets.double())[0].cpu().numpy()
        warped = n.extractor(self._warped(self.residual_grey, matrix))
        return matrix, float((embedded - warped).abs().mean())

    def _warped(self, plane: Tensor, matrix: Array) -> Tensor:
        """A plane (1, 1, n, n) warped as their spatial transformer does: over 0..n instead of 0..n-1, zero beyond."""
        n = plane.shape[-1]
        y, x = np.mgrid[:n, :n] * (n / (n - 1))
        points = transform(np.asarray(np.linalg.inv(matrix), np.float64), np.stack([x, y], -1))
        inside = ((points >= 0) & (points < n - 1)).all(-1)
        grid, mask = (torch.from_numpy(a.astype(np.float32)).to(plane) for a in (points * 2 / (n - 1) - 1, inside))
        return F.grid_sample(plane, grid[None], padding_mode="border", align_corners=True) * mask

    def compose(self, centre: Array, scale: float, rotation: float, residual: Array) -> Array:
        """H_total . H_similarity . H_residual, from the residual homography in pixels of its crop."""
        to_origin = translation(*-self.centre)
        moved = translation(*centre) @ similarity(scale, rotation, 0, 0) @ to_origin
        ratio = self.residual_side / self.config.residual_size
        crop_to_frame = translation(*window_corner(self.centre, self.residual_side)) @ np.diag([ratio, ratio, 1.0])
        step = crop_to_frame @ residual @ np.linalg.inv(crop_to_frame)
        return normalised(self.homography @ moved @ step)

    def _tensor(self, crop: Image) -> Tensor:
        return torch.from_numpy(crop).to(self.device).permute(2, 0, 1)[None].float()


def _arrays(*tensors: Tensor) -> tuple[Floats, Floats]:
    first, second = (t.cpu().numpy() for t in tensors)
    return first, second
