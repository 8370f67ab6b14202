"""What hides a surface in a frame, told from light, and cut out of the frame with its own soft edge."""

from dataclasses import dataclass

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Floats, Grey

from .light import grey


@dataclass(frozen=True)
class OcclusionModel:
    """The constants by which what hides a surface is told from light and cut out; all set by trial."""

    # Evidence by colour.
    noise_grey: float = 4.0  # grey levels, standard deviation of a pixel's noise
    hue_share: float = 0.08  # standard deviation of a colour beside the light's, share of the brightness
    light_share: float = 0.22  # standard deviation of the brightness, share of it
    slack_deviations: float = 1.5  # standard deviations of the pose by which a pixel may lie beside its place
    min_slack_px: float = 0.5  # the least of that
    unlike_deviations: float = 3.0  # from the lit template, from which something else is likelier
    evidence_range: tuple[float, float] = (-1.0, 4.0)  # of colour, in deviations beyond that
    dark_grey: float = 50.0  # brightness at which to look like the template says half as much
    # Evidence by texture.
    window_share: float = 1 / 12  # width of the window that contrast is measured in, share of the crop's longer side
    min_blur_px: float = 0.7  # standard deviation, that contrast and evidence are smoothed by at least
    texture_grey: float = 4.0  # contrast that tells half as much as a strong one
    texture_weight: float = 2.5  # of the evidence by texture against that by colour
    # Where it is.
    reach_share: float = 0.016  # standard deviation that evidence is averaged over, share of the crop's longer side
    lasting: float = 0.5  # evidence that what hid the surface in the last frame still does
    sure: float = 1.2  # evidence that something hides the surface
    min_sure_share: float = 0.003  # of the surface that must be surely hidden ...
    min_sure_px: int = 4  # ... and px of it
    seen_share: float = 0.1  # of an enclosed part that must be surely seen for it to be no part of the occluder
    # Its edge.
    edge_share: float = 0.05  # half the width that a soft edge may have, share of the crop's longer side
    edge_blur_px: float = 1.5  # px of the frame, over which neighbours tell an edge's softness together
    mixture_grey: float = 30.0  # between occluder and surface, from which their mixture tells more than the outline
    min_edge_weight: float = 1e-2  # of an occluder's own colour where all of it is edge


MODEL = OcclusionModel()


def evidence(view: Floats, lit: Floats, slack: float, before: Grey | None) -> Grey:
    """Evidence (h, w) that something hides the surface, pixel by pixel; below 0 for the surface itself.

    Light is smooth or scales what is there, and a surface that is seen a little beside its place, or less sharply,
    shows no colours but those around. An occluder has its own colours, and not the surface's texture.

    Args:
        view, lit: (h, w, 3) the surface in the frame, and the template as it would look there.
        slack: px by which they may be misaligned.
        before: (h, w) 0..1, what was hidden in the last frame.
    """
    reach = 2 * int(np.ceil(max(MODEL.slack_deviations * slack, MODEL.min_slack_px))) + 1
    around = np.ones((reach, reach), np.uint8)
    off = cv2.max(cv2.max(view - cv2.dilate(lit, around), cv2.erode(lit, around) - view), 0.0)
    brightness = cv2.sqrt(cv2.transform(lit * lit, np.ones((1, 3)))) + 1e-3
    brighter = cv2.transform(off * lit, np.ones((1, 3))) / brightness
    other = cv2.sqrt(cv2.max(cv2.transform(off * off, np.ones((1, 3))) - brighter * brighter, 0.0))
    light_deviation = MODEL.noise_grey + MODEL.light_share * brightness
    deviations = cv2.magnitude(brighter / light_deviation, other / (MODEL.noise_grey + MODEL.hue_share * brightness))
    colour = np.clip(deviations - MODEL.unlike_deviations, *MODEL.evidence_range)
    colour[colour < 0] *= (brightness / (brightness + MODEL.dark_grey))[colour < 0]

    # The slope of the view's contrast over the template's: 1 where it is seen, 0 where it is not. Blur alone lowers it
    # as well, but leaves the mean colour.
    longer = max(view.shape)
    window = 2 * round(longer * MODEL.window_share / 2) + 1
    a, b = (cv2.GaussianBlur(grey(image), (0, 0), max(slack, MODEL.min_blur_px)) for image in (lit, view))
    a, b = a - cv2.blur(a, (window, window)), b - cv2.blur(b, (window, window))
    square, product = cv2.blur(a * a, (window, window)), cv2.blur(a * b, (window, window))
    slope = np.clip(product / (square + 1e-3), 0, 1)
    apart = cv2.absdiff(cv2.blur(view, (window, window)), cv2.blur(lit, (window, window)))
    apart = cv2.transform(apart, np.full((1, 3), 1 / 3)) / light_deviation
    texture = MODEL.texture_weight * square / (square + MODEL.texture_grey**2) * (1 - 2 * slope)
    texture = np.where(texture > 0, texture * np.minimum(apart, 1), texture)
    total = cv2.GaussianBlur(colour + texture, (0, 0), max(MODEL.reach_share * longer, MODEL.min_blur_px))
    if before is not None:
        total += MODEL.lasting * before
    return np.asarray(total, np.float32)


def find(evidence: Grey) -> Grey:
    """What is hidden (h, w), 0 or 1: the parts with some evidence that are sure somewhere and not tiny, without holes.

    What they enclose is hidden as well, unless it is surely seen.
    """
    likely = (evidence > 0).astype(np.uint8)
    count, parts = cv2.connectedComponents(likely, connectivity=4)
    surely = np.bincount(parts[evidence > MODEL.sure], minlength=count)
    kept = surely >= max(MODEL.min_sure_share * likely.size, MODEL.min_sure_px)
    kept[0] = False
    hidden = kept[parts]
    if hidden.any():
        count, parts = cv2.connectedComponents((~hidden).astype(np.uint8), connectivity=4)
        open_ended = np.union1d(np.union1d(parts[0], parts[-1]), np.union1d(parts[:, 0], parts[:, -1]))
        surely_seen = np.bincount(parts[evidence < -MODEL.sure], minlength=count)
        seen = surely_seen >= MODEL.seen_share * np.bincount(parts.ravel(), minlength=count)
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
        reach = max(1, round(MODEL.edge_share * max(hidden.shape)))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        inner, outer = cv2.erode(hidden, disc), cv2.dilate(hidden, disc)
        least, most, guess = (cv2.GaussianBlur(mask, (0, 0), reach / 2) for mask in (inner, outer, hidden))
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
        apart = colour - surface
        square = cv2.transform(apart * apart, np.ones((1, 3))) + MODEL.mixture_grey**2
        along = cv2.transform((part - surface) * apart, np.ones((1, 3))) + MODEL.mixture_grey**2 * guess
        # Over some pixels together, since the surface's own edges do not quite fit.
        along, square = (cv2.GaussianBlur(x, (0, 0), MODEL.edge_blur_px) for x in (along, square))
        share = cv2.merge([cv2.max(cv2.min(along / square, most), least)] * 3)
        unmixed = cv2.max(cv2.min(part - (1 - share) * surface, 255 * share), 0.0)
        weight = 1 - on * (1 - share**2)  # where little of it is seen, its colour nearby is a better guess
        light = weight * unmixed + (1 - weight) * share * colour
        return Occluder(box, share, light, surface)
