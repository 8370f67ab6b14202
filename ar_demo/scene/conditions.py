"""What the scene does to a surface in a frame: how it is lit, what hides it, how it is blurred.

The surface as it is seen, rectified by its pose, is compared with how the reference frame shows it.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np

from hdn.alignment.agreement import cell_means
from hdn.imaging.arrays import Array, Floats, Grey, Image
from hdn.imaging.blur import blurred, equalising_blurs, relative_blur, spectral_blur
from hdn.imaging.homography import derivative, from_corners, transform, translation
from hdn.imaging.observation import Observation
from hdn.imaging.pyramid import Pyramid
from hdn.imaging.quads import is_drawable, mean_size, outline
from hdn.networks.config import MATTE_SURFACE
from hdn.networks.matte import Matte
from hdn.plane.occlusion import Occlusion

from ..choices import SurfaceKind
from . import light as relighting
from . import occlusion
from .first_light import FirstLight
from .grain import Grain, GrainMeter
from .light import FINE, GRID, Light, grey
from .occlusion import Occluder, Outline
from .shading import CLOTH, shading
from .shading import MODEL as SHADING
from .shutter import Shutter
from .softness import SoftnessMeter


@dataclass(frozen=True)
class ComparisonModel:
    """The constants by which a rectified surface is compared with its template; all set by trial."""

    longest_px: int = 160  # of the rectified surface's longer side, at most
    margin_px: int = 4  # of the frame around the surface that are looked at
    min_in_frame_share: float = 0.05  # of the surface that must be in the frame to be compared
    saturated_grey: float = 250.0  # from which a pixel does not tell how bright it is
    unknown_deviation_px: float = 8.0  # of the corners where it is not known, and the most that is allowed for
    light_blur_px: float = 2.0  # of the crop: light is told by what is larger, since blur takes contrast from the rest
    # Misalignment, as of a pose that is a little wrong: px of the crop, from which it counts; as a share of the crop's
    # longer side, at most; and the share of what the agreement lacks to 1 that is left without it, at most.
    min_shift_px: float = 1.0
    max_shift_ratio: float = 0.1
    left_by_shift: float = 0.7
    blank_share: float = 0.15  # of a surface's cells with texture, below which it has none to be compared
    max_mirrored: float = 0.12  # share of a print's grey level that may be mirrored where shadows are told


@dataclass(frozen=True)
class BlurModel:
    """The constants by which blur is measured and believed; variances are of Gaussians, along their widest axis."""

    max_slack_px: float = 2.0  # of the crop: beyond such misalignment, which looks like blur, none is measured
    min_cells: int = 6  # of the surface's 64, that it is measured by
    min_cell_in_frame: float = 0.9  # share of a cell that must lie in the frame
    min_variance_px2: float = 0.8  # of the crop: less is taken for none
    min_matched_px2: float = 0.2  # of the crop: with less the template is left as it is
    # Trials of the measured covariance, which tends to be too much.
    trials: tuple[float, ...] = (0.0, 0.25, 0.5, 1.0)
    # Share of what the agreement lacks to 1 that matching blur must bring: for any of it, and for all.
    gains: tuple[float, float] = (0.05, 0.15)
    faint_px2: float = 3.0  # of the frame: so much the ad does not take on, twice as much it does in full


@dataclass(frozen=True)
class RestModel:
    """When a surface is taken to be seen as it was in a frame before, so that it need not be compared anew."""

    most_frames: int = 3  # in a row
    after_frames: int = 8  # that were compared, since the surface was lost or the shot began
    cell_px: int = 8  # of the crop: side of the cells whose means are looked at ...
    cell_grey: float = 8.0  # ... of which none has changed by so much ...
    mean_grey: float = 1.0  # ... nor the whole by that


MODEL = ComparisonModel()
BLUR = BlurModel()
REST = RestModel()
STILL: Array = np.zeros((4, 2))


@dataclass(frozen=True)
class Conditions:
    """Under which a surface is seen in a frame.

    Attributes:
        light: on a picture on the surface.
        occluder: what hides it; None for nothing.
        blur: (2, 2) px^2 of the frame, covariance of the Gaussian that a picture on the surface is blurred by, but for
            its motion.
        way: (4, 2) px, of its corners while the shutter is open.
        grain: what lies on the frame; None for nothing.
    """

    light: Light
    occluder: Occluder | None
    blur: Array
    way: Array = field(default_factory=lambda: STILL)
    grain: Grain | None = None


@dataclass(frozen=True)
class _Compared:
    """What a frame told in which nothing hid the surface: its view, the light, and the blur, px^2 of the crop."""

    view: Floats
    light: Light
    blur: Array

    def looks_like(self, view: Floats) -> bool:
        """Whether another view is much the same."""
        size = [max(side // REST.cell_px, 1) for side in view.shape[1::-1]]
        cells = cv2.resize(cv2.subtract(view, self.view), size, interpolation=cv2.INTER_AREA)
        return bool(np.abs(cells).max() < REST.cell_grey and np.abs(cells.mean((0, 1))).max() < REST.mean_grey)


class Appearance:
    """Compares a surface in frame after frame with the reference frame.

    Attributes:
        is_blank: whether it has no texture: what is in front is told by colour and border alone then.
    """

    def __init__(
        self,
        reference: Image,
        quad: Array,
        matte: Matte,
        shutter: float | None = None,
        grain: bool = True,
        softness: bool = True,
        first_light: FirstLight | None = None,
        kind: SurfaceKind = "print",
    ) -> None:
        """Args:
        reference: (H, W, 3) the frame that shows the surface as it is.
        quad: (4, 2) its corners there, px.
        matte: tells the surface from what hides it; several surfaces may share one.
        shutter: degrees that it is open; None tells it by streaks.
        grain, softness: whether they are measured.
        first_light: on the surface in the reference frame; None for even light.
        kind: of the surface: see `Surface`.
        """
        size = mean_size(quad)
        size *= min(1.0, MODEL.longest_px / size.max())
        self._width, self._height = (np.maximum(np.round(size / GRID), 1) * GRID).astype(int).tolist()
        self._outline = outline(self._width, self._height)
        self._grid_to_crop = from_corners(outline(GRID, GRID), self._outline)
        self._window = relighting.window_px(max(self._width, self._height))  # px of the halved crop
        self._quad, self._exposure = quad, relighting.exposure(reference)
        self._reference = _Box(reference, quad)
        if kind == "screen" and first_light is not None:
            first_light = first_light.mirrored
        self._staying = None if first_light is None else first_light.staying.resized(FINE, FINE)
        if first_light is not None:  # what goes away is no part of what is compared
            grid_to_box = self._reference.to_box @ from_corners(outline(GRID, GRID), quad)
            height, width = self._reference.image.shape[:2]
            self._reference.image = first_light.moving.over(grid_to_box, (width, height)).off(self._reference.image)
        self._template, _ = self._rectify(self._reference, quad)
        textured = relighting.shows(grey(self._template), grey(self._template))[1]
        self.is_blank = float(textured.mean()) < MODEL.blank_share
        self._small_template = self._halved(grey(self._template))
        self._towards_edge = cv2.createHanningWindow(self._small_template.shape[::-1], cv2.CV_32F)
        self._occlusion = Occlusion(matte, Observation(reference), quad, Matte.size, framed=True)
        self._degrees, self._shines = shutter, kind == "screen"
        self._shading = CLOTH if kind == "cloth" else SHADING
        self._grain = GrainMeter() if grain else None
        self._softness = SoftnessMeter() if softness else None
        self.forget()

    def forget(self) -> None:
        """Begins anew, as after a cut: the light may be another now."""
        self._light: Light | None = None
        self._lost = False
        self._begin()
        self._shutter = Shutter(self._degrees)
        if self._softness is not None:
            self._softness.forget()
        if self._grain is not None:
            self._grain.forget()

    def _begin(self) -> None:
        """Nothing has been compared that further frames might look like."""
        self._compared: _Compared | None = None
        self._count = self._rested = 0  # frames that were compared; those since that were not

    def conditions(
        self,
        frame: Image,
        pose: Array,
        deviation: float,
        lost: bool,
        cut: bool,
        motion: Array = STILL,
        matte: Grey | None = None,
    ) -> Conditions:
        """The conditions in the next frame, as far as tracking knows the surface in it.

        Args:
            pose, deviation, motion, matte: as `see` takes them, or not finite.
            cut: whether the frame begins another shot.
        """
        if cut:
            self.forget()
        return self.last() if lost or not np.isfinite(pose).all() else self.see(frame, pose, deviation, motion, matte)

    def last(self) -> Conditions:
        """The conditions of a frame that nothing can be told of: the last light, and nothing else."""
        self._lost = True
        self._begin()
        grain = self._grain.missed() if self._grain is not None else None
        light = self._exposed(self._light or relighting.as_it_was())
        soft = self._softness.variance if self._softness is not None else 0.0
        return Conditions(light, None, soft * np.eye(2), STILL, grain)

    def see(
        self, frame: Image, pose: Array, deviation: float, motion: Array = STILL, matte: Grey | None = None
    ) -> Conditions:
        """The conditions in a frame (H, W, 3) in which the surface has the corners `pose` (4, 2).

        Args:
            deviation: px, standard deviation of the corners; infinite where it is not known.
            motion: (4, 2) px from one frame to the next, of the corners in this one.
            matte: (H, W) 1 where the surface is seen, 0 where something is in front; None tells it.
        """
        part = _Box(frame, pose)
        if part.image.size == 0 or not is_drawable(pose):
            return self.last()
        view, inside = self._rectify(part, pose)
        if inside.mean() < MODEL.min_in_frame_share:
            return self.last()
        if self._lost:
            self._light, self._lost = None, False
        if matte is None and self._rests(part, view, deviation):
            return self._as_before(frame, pose, motion)
        pose, view, inside = self._aligned(part, pose, view, inside)
        scale = self._scale(pose)
        slack = min(deviation, MODEL.unknown_deviation_px) / np.sqrt(max(abs(np.linalg.det(scale)), 1e-6))
        seen = (self._seen(frame, pose) if matte is None else self._seen_by(matte, pose)) * inside
        if self.is_blank and matte is None:
            seen = occlusion.seen_by_colour(seen, view, self._template) * inside
        hidden = occlusion.find((1 - seen) * inside)
        way, streak = self._streak(view, inside, motion, np.asarray(np.linalg.inv(scale), np.float64))
        template = _blurred(self._template, streak)
        blur = self._blur(template, view, inside) if slack < BLUR.max_slack_px else np.zeros((2, 2))
        template = _blurred(template, blur)
        unsaturated = cv2.inRange(cv2.max(view, template), (0, 0, 0), (MODEL.saturated_grey,) * 3)
        usable = unsaturated.astype(np.float32) / 255 * seen
        small_view, small_template, small_usable = (
            self._halved(x, max(slack, MODEL.light_blur_px)) for x in (view, template, usable)
        )
        light = relighting.measure(small_view, small_template, small_usable, self._light, self._shines)
        self._light = relighting.follow(self._light, light, 1 / (1 + slack * slack))
        light = self._shaded(self._light, view, template, unsaturated / np.float32(255) * inside * (1 - hidden), slack)
        blur_in_frame = scale @ _worth(blur) @ scale.T
        grain = self._grain.see(frame, pose) if self._grain is not None else None
        occluder = None
        if hidden.any():
            in_all = blur_in_frame + scale @ streak @ scale.T
            if matte is None:
                occluder = self._cut_out(Outline.of(hidden, view), frame, pose, in_all, light)
            else:
                occluder = self._behind(part, pose, in_all, light)
        is_clear = matte is None and part.whole and not hidden.any()
        self._compared = _Compared(view, light, blur) if is_clear else None
        self._count, self._rested = self._count + 1, 0
        if self._softness is not None:
            blur_in_frame = _at_least(self._softness.see(frame, pose), blur_in_frame)
        return Conditions(self._exposed(light), occluder, blur_in_frame, way, grain)

    def _rests(self, part: "_Box", view: Floats, deviation: float) -> bool:
        """Whether a frame shows the surface as it was when it was compared last, not long ago."""
        last = self._compared
        if last is None or self._count < REST.after_frames or self._rested >= REST.most_frames:
            return False
        return part.whole and deviation < MODEL.unknown_deviation_px and last.looks_like(view)

    def _as_before(self, frame: Image, pose: Array, motion: Array) -> Conditions:
        """The conditions in a frame that shows the surface as it was when it was compared last."""
        last = self._compared
        assert last is not None
        self._rested += 1
        scale = self._scale(pose)
        blur_in_frame = scale @ _worth(last.blur) @ scale.T
        if self._softness is not None:
            blur_in_frame = _at_least(self._softness.variance, blur_in_frame)
        way = self._shutter.share * motion if np.isfinite(motion).all() else STILL
        grain = self._grain.passed(frame, pose) if self._grain is not None else None
        return Conditions(self._exposed(last.light), None, blur_in_frame, way, grain)

    def _scale(self, pose: Array) -> Array:
        """(2, 2) px of the frame for px of the crop, in its middle."""
        middle = np.array([(self._width - 1) / 2, (self._height - 1) / 2])
        return derivative(from_corners(self._outline, pose), middle)

    def _rectify(self, part: "_Box", pose: Array) -> tuple[Floats, Grey]:
        """The surface (h, w, 3) in a part of a frame, and which of it lies in the frame (h, w), 0 or 1."""
        crop_to_part = part.to_box @ from_corners(self._outline, pose)
        view = Pyramid(part.image).crop(crop_to_part, self._width, self._height).astype(np.float32)
        if part.whole:
            return view, np.ones(view.shape[:2], np.float32)
        whole = np.full(part.image.shape[:2], 255, np.uint8)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        inside = cv2.warpPerspective(whole, crop_to_part, (self._width, self._height), flags=flags)
        return view, (inside > 250).astype(np.float32)

    def _aligned(self, part: "_Box", pose: Array, view: Floats, inside: Grey) -> tuple[Array, Floats, Grey]:
        """The pose by which the surface is compared, with its view and what is inside: misalignment is no blur.

        It is the pose that is given, but where the view is clearly the template, shifted (Kuglin and Hines, 1975).
        """
        # It multiplies the pictures themselves by the window where their size is one that FFTs like.
        pictures = self._small_template.copy(), self._halved(grey(view))
        found, _ = cv2.phaseCorrelate(*pictures, self._towards_edge)
        shift = 2 * np.array(found)
        if not MODEL.min_shift_px < np.hypot(*shift) < MODEL.max_shift_ratio * max(self._width, self._height):
            return pose, view, inside
        better = transform(from_corners(self._outline, pose), self._outline + shift)
        there, inside_there = self._rectify(part, better)
        lacking = [1 - self._agreement(x, y) for x, y in ((view, inside), (there, inside_there))]
        if lacking[1] > MODEL.left_by_shift * lacking[0]:
            return pose, view, inside
        return better, there, inside_there

    def _agreement(self, view: Floats, inside: Grey) -> float:
        """How well a view agrees with the template, median over the cells that can tell; -1 where none can."""
        correlation, textured = relighting.shows(grey(view), grey(self._template))
        telling = textured & (cell_means(inside) > BLUR.min_cell_in_frame)
        return float(np.median(correlation[telling])) if telling.any() else -1.0

    def _seen(self, frame: Image, pose: Array) -> Floats:
        """How probably each pixel (h, w) of the crop shows the surface, 0..1; 0 outside the frame."""
        around = pose.mean(0) + (pose - pose.mean(0)) / MATTE_SURFACE
        part = _Box(frame, around)
        to_part = part.to_box @ from_corners(self._quad, pose)
        seen = self._occlusion.seen(Observation(part.image), to_part)
        return np.asarray(cv2.resize(seen, (self._width, self._height), interpolation=cv2.INTER_LINEAR), np.float32)

    def _seen_by(self, matte: Grey, pose: Array) -> Floats:
        """The same by a matte (H, W)."""
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(matte, from_corners(self._outline, pose), (self._width, self._height), flags=flags)
        return np.asarray(seen, np.float32)

    def _streak(self, view: Floats, inside: Grey, motion: Array, to_crop: Array) -> tuple[Array, Array]:
        """The way (4, 2) px of the corners while the shutter is open, and the blur (2, 2) of that, px^2 of the crop."""
        if not np.isfinite(motion).all():
            return STILL, np.zeros((2, 2))
        along = to_crop @ motion.mean(0)  # px of the crop
        if inside.mean() > BLUR.min_cell_in_frame and self._shutter.can_learn(along):
            self._shutter.learn(4 * spectral_blur(self._small_template, self._halved(grey(view))), along)
        share = self._shutter.share
        return np.asarray(share * motion), np.outer(along, along) * (share**2 / 12)

    def _shaded(self, light: Light, view: Floats, template: Floats, usable: Grey, slack: float) -> Light:
        """The light, with the shadows on a view of the surface whose edges are sharper than it knows."""
        if slack > BLUR.max_slack_px or self._shines:
            return light
        seen, own, trust = (self._halved(x) for x in (view, template, usable))
        light_here = light.resized(*own.shape[1::-1])
        expected, printed = grey(light_here.on(own)), grey(light_here.without_gloss().on(own))
        # Where much is mirrored, or was in the reference frame, a ratio does not tell how the print is lit.
        plain = np.abs(expected - printed) < MODEL.max_mirrored * printed
        return light.shaded(shading(grey(seen), expected, trust * plain, slack / 2, self._shading))

    def _blur(self, own: Floats, view: Floats, inside: Grey) -> Array:
        """Covariance (2, 2), px^2 of the crop, by which a view is blurred more than the template `own`; 0 where less.

        Measured at half the size, since blur that matters is larger than a pixel; on the half of the surface that
        agrees best, since an occluder looks like anything; and believed where that agrees better for it.
        """
        template, seen, usable = (self._halved(x) for x in (grey(own), grey(view), inside))
        correlation, textured = relighting.shows(seen, template)
        telling = textured & (cell_means(usable) > BLUR.min_cell_in_frame)
        if telling.sum() < BLUR.min_cells:
            return np.zeros((2, 2))
        best = telling & (correlation >= np.median(correlation[telling]))
        where = cv2.resize(best.astype(np.float32), seen.shape[::-1], interpolation=cv2.INTER_NEAREST)
        blur = 4 * equalising_blurs(relative_blur(template, seen, where, self._window))[0]
        if np.linalg.eigvalsh(blur).max() < BLUR.min_variance_px2:
            return np.zeros((2, 2))
        # What was measured by halves is checked by the whole; it tends to be too much.
        template, seen = grey(own), grey(view)
        trials = [part * blur for part in BLUR.trials]
        lacking = [1 - relighting.shows(seen, _blurred(template, b))[0][best].mean() for b in trials]
        least = int(np.argmin(lacking))
        better = 1 - lacking[least] / max(lacking[0], 1e-3)
        return trials[least] * float(np.interp(better, BLUR.gains, [0, 1]))

    def _halved(self, image: Floats, slack: float = 0.0) -> Floats:
        """A crop at half the size, so soft that being misaligned by `slack` px of the crop makes little difference."""
        half = cv2.resize(image, (self._width // 2, self._height // 2), interpolation=cv2.INTER_AREA)
        return np.asarray(cv2.GaussianBlur(half, (0, 0), slack / 2) if slack else half, np.float32)

    def _exposed(self, light: Light) -> Light:
        """The light on a picture: what stays of the first view's is on it as well, and no gloss can be missing."""
        if self._staying is not None:
            light = self._staying.under(light.resized(FINE, FINE))
        return Light(light.gain * np.float32(self._exposure), np.maximum(light.gloss, 0))

    def _cut_out(self, outline: Outline, frame: Image, pose: Array, blur: Array, light: Light) -> Occluder | None:
        """The occluder out of the part of the frame that it is in."""
        y, x = np.nonzero(outline.most > 0.01)
        left, top, right, bottom = x.min() - 1, y.min() - 1, x.max() + 1, y.max() + 1
        around = np.array([[left, top], [right, top], [right, bottom], [left, bottom]], np.float64)
        crop_to_frame = from_corners(self._outline, pose)
        part = _Box(frame, transform(crop_to_frame, around))
        if part.image.size == 0:
            return None
        surface, mine = self._surface_in(part, pose, blur, light)
        return outline.cut_out(part.image.astype(np.float32), surface, mine, part.to_box @ crop_to_frame, part.box)

    def _behind(self, part: "_Box", pose: Array, blur: Array, light: Light) -> Occluder:
        """What is behind an occluder that a matte gives, and is cut out with the layer: see `compositing.bound`."""
        surface, _ = self._surface_in(part, pose, blur, light)
        nothing = np.zeros_like(surface)
        return Occluder(part.box, nothing, nothing, surface)

    def _surface_in(self, part: "_Box", pose: Array, blur: Array, light: Light) -> tuple[Floats, Floats]:
        """A part of the frame as it would look with nothing in front (h, w, 3), and the surface's share (h, w, 1)."""
        height, width = part.image.shape[:2]
        crop_to_part = part.to_box @ from_corners(self._outline, pose)
        part_to_reference = self._reference.to_box @ from_corners(pose, self._quad) @ np.linalg.inv(part.to_box)
        own = Pyramid(self._reference.image).crop(part_to_reference, width, height)
        on_part = light.over(crop_to_part @ self._grid_to_crop, (width, height))
        surface = _blurred(np.minimum(on_part.on(own), 255), blur)
        seen = part.image.astype(np.float32)
        # Beside the surface there is what there is.
        mine = np.ones((self._height, self._width), np.float32)
        mine = cv2.warpPerspective(mine, crop_to_part, (width, height))[..., None]
        return seen + mine * (surface - seen), mine


def _at_least(variance: float, blur: Array) -> Array:
    """A blur (2, 2), px^2, of no less than a variance any way: want of focus that both tell counts once."""
    more = variance - float(np.linalg.eigvalsh(blur).min())
    return blur + max(more, 0.0) * np.eye(2)


class _Box:
    """The part of a frame around a quad, with a margin; it may be empty.

    image: (h, w, 3). box: rows and columns of the frame. to_box: (3, 3) frame pixels to the box's. whole: whether all
    of the quad lies in the frame.
    """

    def __init__(self, frame: Image, quad: Array) -> None:
        bounds = np.array(frame.shape[1::-1])
        low = np.clip(np.floor(quad.min(0)) - MODEL.margin_px, 0, bounds).astype(int)
        high = np.clip(np.ceil(quad.max(0)) + MODEL.margin_px + 1, low, bounds).astype(int)
        self.box = slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
        self.image = frame[self.box]
        self.whole = bool((quad >= 0).all() and (quad <= bounds - 1).all())
        self.to_box = translation(-low[0], -low[1])


def _blurred(image: Floats, covariance: Array) -> Floats:
    return blurred(image, covariance) if np.linalg.eigvalsh(covariance).max() > BLUR.min_matched_px2 else image


def _worth(covariance: Array) -> Array:
    """Blur (2, 2) without what is too faint to be told from none; it sets in smoothly, so that nothing toggles."""
    values, axes = np.linalg.eigh(covariance)
    return (axes * (values * np.clip(values / BLUR.faint_px2 - 1, 0, 1))) @ axes.T
