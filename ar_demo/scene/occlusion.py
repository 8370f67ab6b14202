"""What hides a surface in a frame: found in the matte, and cut out of the frame with its own soft edge."""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Floats, Grey, Image


@dataclass(frozen=True)
class OcclusionModel:
    """The constants by which what hides a surface is found and cut out; all set by trial."""

    # Where it is: as the matte tells, with two thresholds (Canny, 1986).
    sure: float = 0.5  # probability from which a pixel is hidden ...
    likely: float = 0.1  # ... and from which it is so beside those
    beside_share: float = 0.03  # how far beside them, share of the crop's longer side
    min_sure_share: float = 0.002  # of the surface that must be surely hidden
    # Before a surface without texture, where colours alone tell.
    foreign_grey: tuple[float, float] = (24.0, 48.0)  # distance from its colour: surely the surface, surely not
    # Its edge.
    edge_share: float = 0.02  # half the width that a soft edge may have, share of the crop's longer side
    outline_px: float = 1.0  # of the crop, over which an edge is soft where colours do not tell
    edge_blur_px: float = 1.5  # px of the frame, over which neighbours tell an edge's softness together
    mixture_grey: float = 30.0  # between occluder and surface, from which their mixture tells more than the outline
    min_edge_weight: float = 1e-2  # of an occluder's own colour where all of it is edge


MODEL = OcclusionModel()


def find(hidden: Grey) -> Grey:
    """What is hidden (h, w), 0 or 1, by its probability (h, w): what surely is, and what likely is beside that."""
    count, parts = cv2.connectedComponents((hidden > MODEL.sure).astype(np.uint8), connectivity=4)
    kept = np.bincount(parts.ravel(), minlength=count) >= max(MODEL.min_sure_share * hidden.size, 1)
    kept[0] = False
    beside = cv2.dilate(kept[parts].astype(np.uint8), _disc(MODEL.beside_share, hidden.shape))
    return ((hidden > MODEL.likely) & (beside > 0)).astype(np.float32)


def seen_by_colour(seen: Grey, view: Floats, template: Floats) -> Grey:
    """How probably each pixel (h, w) of a view shows a surface of one colour, 0..1.

    It does where it has that colour, and does not where it has another hue or is brighter; where it is darker, that may
    be a shadow.

    Args:
        seen: (h, w) 0..1, what is known otherwise, which counts where it is darker.
        view, template: (h, w, 3) grey levels, aligned.
    """
    mean = template.mean((0, 1))
    axis = mean / max(float(np.linalg.norm(mean)), 1e-6)
    along = view @ axis
    aside = np.linalg.norm(view - along[..., None] * axis, axis=2)
    brighter = along - template @ axis
    brighter -= np.median(brighter)  # as most of it is: it is lit otherwise
    foreign = np.interp(np.maximum(aside, brighter), MODEL.foreign_grey, [0, 1])
    own = np.interp(np.maximum(aside, np.abs(brighter)), MODEL.foreign_grey, [1, 0])
    return np.maximum(np.minimum(seen, 1 - foreign), own).astype(np.float32)


@dataclass(frozen=True)
class Occluder:
    """What hides a surface in a box of the frame.

    Attributes:
        box: rows and columns of the frame.
        share: (h, w, 3) 0..1, how much of each pixel it takes, the same in all channels.
        colour: (h, w, 3) its light in each pixel, so times the share.
        behind: (h, w, 3) what would be seen there without it.
    """

    box: tuple[slice, slice]
    share: Floats
    colour: Floats
    behind: Floats


@dataclass(frozen=True)
class Outline:
    """An occluder as far as the rectified crop (h, w) tells: bounds and guess of its share, and its colour.

    least, most: (h, w) the share's bounds. guess: (h, w) the share by the outline alone. colour: (h, w, 3).
    """

    least: Grey
    most: Grey
    guess: Grey
    colour: Floats

    @staticmethod
    def of(hidden: Grey, view: Floats) -> "Outline":
        """From what is hidden (h, w), 0 or 1, in a view of the surface (h, w, 3)."""
        reach = max(1, round(MODEL.edge_share * max(hidden.shape)))
        disc = _disc(MODEL.edge_share, hidden.shape)
        inner, outer = cv2.erode(hidden, disc), cv2.dilate(hidden, disc)
        least, most = (cv2.GaussianBlur(mask, (0, 0), reach / 2) for mask in (inner, outer))
        guess = cv2.GaussianBlur(hidden, (0, 0), MODEL.outline_px)
        # Its colour at the edge is that of what is surely the occluder nearby.
        sure = cv2.max(inner, MODEL.min_edge_weight * hidden)
        weight = cv2.GaussianBlur(sure, (0, 0), reach)
        near = cv2.GaussianBlur(view * sure[..., None], (0, 0), reach)
        mean = (view * sure[..., None]).mean((0, 1)) / max(float(sure.mean()), 1e-9)
        return Outline(least, most, guess, (near + 1e-4 * mean) / (weight[..., None] + np.float32(1e-4)))

    def cut_out(
        self, part: Floats, surface: Floats, on: Floats, crop_to_part: Array, box: tuple[slice, slice]
    ) -> Occluder:
        """The occluder out of a part of the frame, pixel by pixel.

        Where it mixes with the surface, at its soft edge, the pixel lies between the occluder's colour and that of the
        surface, which are both known; how far, is its share.

        Args:
            part: (h, w, 3) the frame in the box.
            surface: (h, w, 3) what would be seen there without an occluder.
            on: (h, w, 1) 0..1, how much of each pixel the surface takes.
            crop_to_part: (3, 3) homography, pixels to pixels.
        """
        size = part.shape[1::-1]
        maps = cv2.warpPerspective(
            cv2.merge([self.least, self.most, self.guess]), crop_to_part, size, borderMode=cv2.BORDER_REPLICATE
        )
        least, most, guess = cv2.split(maps)
        colour = cv2.warpPerspective(self.colour, crop_to_part, size, borderMode=cv2.BORDER_REPLICATE)
        apart, beyond = colour - surface, part - surface
        square, along = (cv2.transform(x * apart, np.ones((1, 3))) for x in (apart, beyond))
        # The less a pixel is a mixture of both, the less it tells.
        between = np.clip(along / (square + MODEL.mixture_grey**2), 0, 1)[..., None] * apart
        doubt = cv2.transform(np.square(beyond - between), np.ones((1, 3))) + MODEL.mixture_grey**2
        square, along = square + doubt, along + doubt * guess
        # Over some pixels together, since the surface's own edges do not quite fit.
        along, square = (cv2.GaussianBlur(x, (0, 0), MODEL.edge_blur_px) for x in (along, square))
        share = cv2.merge([cv2.max(cv2.min(along / square, most), least)] * 3)
        unmixed = cv2.max(cv2.min(part - (1 - share) * surface, 255 * share), 0.0)
        weight = 1 - on * (1 - share**2)  # where little of it is seen, its colour nearby is a better guess
        light = weight * unmixed + (1 - weight) * share * colour
        return Occluder(box, share, light, surface)


def _disc(share: float, shape: tuple[int, ...]) -> Image:
    """A disc with a radius that is a share of a crop's longer side, at least a pixel."""
    reach = max(1, round(share * max(shape)))
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1)), np.uint8)
