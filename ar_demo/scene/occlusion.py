"""What hides a surface in a frame, told from light, and cut out of the frame with its own soft edge."""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Grey

from .light import Floats, grey

NOISE = 4.0  # grey levels
HUE, LIGHT = 0.08, 0.22  # what light leaves open: of colour and of brightness, as shares of the brightness
FAR = 1.5  # deviations by which the pose may be off
UNLIKE = 3.0  # deviations from the lit template, from which something else is likelier
DARK = 50.0  # grey levels, under which to look like the template says little
TEXTURE = 4.0  # grey levels of contrast that tell as much as not
WEIGHT = 2.5  # of the texture's evidence
NEAR = 0.016  # of the crop's longer side: evidence is averaged over so far
SURE = 1.2  # evidence that something hides the surface
LEAST = 0.003  # share of the surface that is worth a look
LASTING = 0.5  # evidence that what hid the surface still does
EDGE = 0.05  # of the crop's longer side: half the width that an occluder's soft edge may have
TOGETHER = 1.5  # px of the frame, over which an edge is as soft as next to it
UNCERTAIN = 30.0  # grey levels between occluder and surface, from which their mixture tells more than the outline


def evidence(view: Floats, lit: Floats, slack: float, before: Grey | None) -> Grey:
    """Evidence (h, w) that something hides the surface, pixel by pixel; below 0 for the surface itself.

    Light is smooth or scales what is there, and a surface that is seen a little beside its place, or less sharply,
    shows no colours but those around. An occluder has its own colours, and not the surface's texture.

    Args:
        view, lit: (h, w, 3) the surface in the frame, and the template as it would look there.
        slack: px by which they may be misaligned.
        before: (h, w) 0..1, what was hidden in the last frame.
    """
    reach = 2 * int(np.ceil(max(FAR * slack, 0.5))) + 1
    around = np.ones((reach, reach), np.uint8)
    off = cv2.max(cv2.max(view - cv2.dilate(lit, around), cv2.erode(lit, around) - view), 0.0)
    brightness = cv2.sqrt(cv2.transform(lit * lit, np.ones((1, 3)))) + 1e-3
    brighter = cv2.transform(off * lit, np.ones((1, 3))) / brightness
    other = cv2.sqrt(cv2.max(cv2.transform(off * off, np.ones((1, 3))) - brighter * brighter, 0.0))
    deviations = cv2.magnitude(brighter / (NOISE + LIGHT * brightness), other / (NOISE + HUE * brightness))
    colour = np.clip(deviations - UNLIKE, -1, 4)
    colour[colour < 0] *= (brightness / (brightness + DARK))[colour < 0]

    # The slope of the view's contrast over the template's: 1 where it is seen, 0 where it is not. Blur alone lowers it
    # as well, but leaves the mean colour.
    window = 2 * round(max(view.shape) / 24) + 1
    a, b = (cv2.GaussianBlur(grey(image), (0, 0), max(slack, 0.7)) for image in (lit, view))
    a, b = a - cv2.blur(a, (window, window)), b - cv2.blur(b, (window, window))
    square, product = cv2.blur(a * a, (window, window)), cv2.blur(a * b, (window, window))
    slope = np.clip(product / (square + 1e-3), 0, 1)
    apart = cv2.absdiff(cv2.blur(view, (window, window)), cv2.blur(lit, (window, window)))
    apart = cv2.transform(apart, np.full((1, 3), 1 / 3)) / (NOISE + LIGHT * brightness)
    texture = WEIGHT * square / (square + TEXTURE**2) * (1 - 2 * slope)
    texture = np.where(texture > 0, texture * np.minimum(apart, 1), texture)
    total = cv2.GaussianBlur(colour + texture, (0, 0), max(NEAR * max(view.shape), 0.7))
    if before is not None:
        total += LASTING * before
    return np.asarray(total, np.float32)


def find(evidence: Grey) -> Grey:
    """What is hidden (h, w), 0 or 1: the parts with some evidence that are sure somewhere and not tiny, without holes.

    What they enclose is hidden as well, unless it is surely seen.
    """
    likely = (evidence > 0).astype(np.uint8)
    count, parts = cv2.connectedComponents(likely, connectivity=4)
    surely = np.bincount(parts[evidence > SURE], minlength=count)
    kept = surely >= max(LEAST * likely.size, 4)
    kept[0] = False
    hidden = kept[parts]
    if hidden.any():
        count, parts = cv2.connectedComponents((~hidden).astype(np.uint8), connectivity=4)
        open_ended = np.union1d(np.union1d(parts[0], parts[-1]), np.union1d(parts[:, 0], parts[:, -1]))
        seen = np.bincount(parts[evidence < -SURE], minlength=count) >= 0.1 * np.bincount(
            parts.ravel(), minlength=count
        )
        seen[open_ended] = True
        hidden |= ~seen[parts]
    return hidden.astype(np.float32)


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
        reach = max(1, round(EDGE * max(hidden.shape)))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        inner, outer = cv2.erode(hidden, disc), cv2.dilate(hidden, disc)
        least, most, guess = (cv2.GaussianBlur(mask, (0, 0), reach / 2) for mask in (inner, outer, hidden))
        # Its colour at the edge is that of what is surely the occluder nearby.
        sure = cv2.max(inner, 1e-2 * hidden)
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
        apart = colour - surface
        square = cv2.transform(apart * apart, np.ones((1, 3))) + UNCERTAIN**2
        along = cv2.transform((part - surface) * apart, np.ones((1, 3))) + UNCERTAIN**2 * guess
        # Over some pixels together, since the surface's own edges do not quite fit.
        along, square = (cv2.GaussianBlur(x, (0, 0), TOGETHER) for x in (along, square))
        share = cv2.merge([cv2.max(cv2.min(along / square, most), least)] * 3)
        unmixed = cv2.max(cv2.min(part - (1 - share) * surface, 255 * share), 0.0)
        weight = 1 - on * (1 - share**2)  # where little of it is seen, its colour nearby is a better guess
        light = weight * unmixed + (1 - weight) * share * colour
        return Occluder(box, share, light, surface)
