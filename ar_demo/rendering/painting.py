"""What belongs on one surface: its ad, or effect, lit as the surface is, drawn as a layer, and merged into frames."""

from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from fractions import Fraction

import cv2
import numpy as np

from hdn.imaging.arrays import Array, Box, Floats, Grey, Image, Picture
from hdn.imaging.homography import from_corners
from hdn.imaging.quads import mean_size, outline

from ..compositing.bound import in_front
from ..compositing.compositor import Compositor
from ..compositing.effects import outlined, texture
from ..compositing.fit import fit_region, quad_aspect
from ..compositing.layer import Frame, Layer, in_float, overlap, peak, within
from ..compositing.merge import blurred_layer, merge
from ..compositing.raster import WHOLE
from ..compositing.spill import without_spill
from ..compositing.streak import smeared
from ..compositing.trim import inset_pose, rounded
from ..errors import InputError
from ..hdr import Hdr
from ..media.ad import Ad, open_ad
from ..scene.conditions import Conditions
from ..scene.grain import Grain
from ..scene.light import GRID, Light, as_it_was
from ..scene.occlusion import Occluder
from ..surface import Surface

NO_AD = "no ad is given: name a video or image, or choose --effect mosaic, blur or outline"


@dataclass(frozen=True)
class LightingModel:
    """When a picture is lit anew."""

    same_light: float = 0.004  # share of white's grey level, by which light may differ without that
    pixels: int = 32768  # that are worked on at a time: they fit the cache


LIGHTING = LightingModel()


class Painter(AbstractContextManager["Painter"]):
    """Draws what belongs on a surface; a context manager that holds the ad's file."""

    def __init__(self, surface: Surface, quad: Array, size: tuple[int, int], compositor: Compositor) -> None:
        """Args:
            quad: (4, 2) the surface's corners in a frame of the size given, px, by which the ad's shape is fitted.
            compositor: what draws; it may serve other surfaces too, and is not closed here.

        Raises:
            InputError: no ad, or not one that can be read; an inset or radius that leaves nothing.
        """
        self._size = mean_size(quad)
        room = float(self._size.min()) / 2
        if surface.inset >= room or surface.radius > room - surface.inset:
            raise InputError(
                f"an inset of {surface.inset:g} px and a radius of {surface.radius:g} px do not go into a surface "
                f"{2 * room:.0f} px wide: give less"
            )
        if surface.effect == "replace" and surface.ad is None:
            raise InputError(NO_AD)
        self.surface = surface
        self._compositor = compositor
        self._ad: Ad | None = None
        self._region = WHOLE
        if surface.effect == "replace" and surface.ad is not None:
            self._ad = open_ad(surface.ad, surface.playback)
            inner = inset_pose(quad, self._size, surface.inset)
            self._region = fit_region(surface.fit, self._ad.width / self._ad.height, quad_aspect(inner, size))
        self._opaque = False  # whether the last picture was
        self._lit: tuple[Picture, Light, Picture] | None = None  # a picture, a light, and the picture in this light

    def draw(
        self,
        image: Frame,
        pose: Array,
        strength: float,
        time: Fraction,
        conditions: Conditions | None = None,
        cover: Grey | None = None,
        hdr: Hdr | None = None,
        matte: Grey | None = None,
    ) -> Box | None:
        """Draws into a frame (H, W, 3), in place.

        Args:
            pose: (4, 2) the surface's corners, px; not finite where it is not known.
            strength: 0..1, the opacity.
            time: seconds since the ad began.
            conditions: under which the surface is seen; None draws an ad as it is.
            cover: (H, W) 0..1, how much of each pixel is covered already; this is added.
            hdr: how the frame's samples stand for light; None for SDR.
            matte: (H, W) 0..1, the most of each pixel that an ad takes; None leaves that to the conditions.

        Returns:
            The part of the frame that may have changed; None for none.
        """
        if strength <= 0 or not np.isfinite(pose).all():
            return None
        # In all other modes the surface's colours, which have the light on them already, are part of what is seen.
        light = conditions.light if conditions and self.surface.blend == "normal" else None
        deep = image.dtype != np.uint8
        layer = self.layer(image, pose, time, light, deep)
        if layer is None:
            return None
        if self.surface.effect in ("mosaic", "blur"):
            hdr = None  # they are made of the frame's own samples
        occluder = None
        if conditions is not None:
            if deep:
                layer = Layer(layer.box, in_float(layer.rgba))
            layer, occluder = self._as_seen(layer, pose, conditions, image.shape[:2]), conditions.occluder
            if matte is not None:
                occluder = _in_front(image, layer, strength, matte, occluder, hdr)
            if self._fills_the_surface and hdr is None:
                without_spill(image, layer, pose, float(np.trace(conditions.blur)) / 2, occluder)
        return merge(image, layer, self.surface.blend, strength, occluder, cover, hdr)

    @property
    def _fills_the_surface(self) -> bool:
        """Whether the ad, as it was drawn last, has the surface's edge, and nothing of that is seen through it."""
        surface = self.surface
        whole = surface.fit != "contain" and not (surface.inset or surface.radius or surface.feather)
        return self._opaque and whole and surface.blend == "normal" and surface.opacity == 1

    def layer(
        self, image: Frame, pose: Array, time: Fraction, light: Light | None = None, deep: bool = False
    ) -> Layer | None:
        """What is to be laid on a frame (H, W, 3); None where there is nothing to see. See `draw`.

        Args: deep: whether 8 bits are too few for an ad in a light.
        """
        size = image.shape[1], image.shape[0]
        if self.surface.effect == "outline":
            return outlined(pose, size)
        inner = inset_pose(pose, self._size, self.surface.inset)
        if self._ad is None:
            layer = self._compositor.draw(texture(self.surface.effect, image, inner), inner, size)
            return self._rounded(layer, inner)
        picture: Picture | None = self._ad.at(time)
        if picture is None:
            return None
        self._opaque = picture.shape[2] == 3
        if light is not None:
            picture = self._in_light(picture, pose, light, deep)
        layer = self._compositor.draw(picture, inner, size, self._region, self.surface.feather)
        return self._rounded(layer, inner)

    def _rounded(self, layer: Layer | None, pose: Array) -> Layer | None:
        """A layer at a pose, that of what the inset leaves, with rounded corners."""
        if layer is None:
            return None
        return rounded(layer, pose, self._size - 2 * self.surface.inset, self.surface.radius, self.surface.feather)

    def _as_seen(self, layer: Layer, pose: Array, conditions: Conditions, frame_shape: tuple[int, int]) -> Layer:
        """A layer at a pose (4, 2), through the camera: moved while the shutter is open, out of focus, with grain."""
        layer = smeared(layer, pose, conditions.way, frame_shape)
        layer = blurred_layer(layer, conditions.blur, frame_shape)
        # In all other modes the surface's own grain is part of what is seen.
        if conditions.grain is None or self.surface.blend != "normal":
            return layer
        return grained(layer, conditions.grain)

    def _in_light(self, picture: Picture, pose: Array, light: Light, deep: bool) -> Picture:
        """A picture (h, w, 3 or 4) in a light over the surface; the same array as before for much the same light.

        It has no more pixels than are shown, about.
        """
        if light.differs(as_it_was()) < LIGHTING.same_light:
            return picture
        if self._lit is not None and self._lit[0] is picture and self._lit[1].differs(light) < LIGHTING.same_light:
            return self._lit[2]
        u0, v0, u1, v1 = self._region
        whole = np.array(picture.shape[1::-1]) * [u1 - u0, v1 - v0]
        sides = np.linalg.norm(np.roll(pose, -1, 0) - pose, axis=1)
        shrink = max(1, int((whole / [max(sides[0], sides[2]), max(sides[1], sides[3])]).min()))
        size = tuple(max(1, n // shrink) for n in picture.shape[1::-1])
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA) if shrink > 1 else picture
        corners = np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]]) * size - 0.5
        inset = self.surface.inset * GRID / self._size  # cells
        on_grid = outline(GRID, GRID) + inset * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        grid_to_picture = from_corners(on_grid, corners)
        self._lit = picture, light, lit(small, light.over(grid_to_picture, size), deep)
        return self._lit[2]

    def close(self) -> None:
        """Closes the ad."""
        if self._ad is not None:
            self._ad.close()

    def __exit__(self, *error: object) -> None:
        self.close()


def _in_front(
    image: Frame, layer: Layer, opacity: float, matte: Grey, known: Occluder | None, hdr: Hdr | None
) -> Occluder:
    """What a matte leaves in front of a layer on a frame; known: has what is behind it, where that is told."""
    part = image[layer.box]
    if part.dtype != np.uint8:
        deep = np.asarray(part, np.uint16)
        part = ((deep if hdr is None else hdr.to_sdr(deep)) >> 8).astype(np.uint8)
    behind = None
    if known is not None:
        behind = part.astype(np.float32)
        shared = overlap(layer.box, known.box)
        if shared is not None:
            behind[within(shared, layer.box)] = known.behind[within(shared, known.box)]
    return in_front(layer, opacity, matte, np.asarray(part, np.uint8), behind)


def grained(layer: Layer, grain: Grain) -> Layer:
    """A layer with grain on it."""
    out = np.empty_like(layer.rgba)
    for rows in _bands(layer.rgba):
        rgba = layer.rgba[rows]
        colour, alpha = cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB), cv2.extractChannel(rgba, 3)
        noise = grain.on(colour, rows.start)
        depth = cv2.CV_8U if colour.dtype == np.uint8 else cv2.CV_32F
        if alpha.min() < peak(alpha.dtype):
            each = cv2.cvtColor(alpha, cv2.COLOR_GRAY2RGB)
            noise = cv2.multiply(noise, each, scale=1 / peak(alpha.dtype), dtype=cv2.CV_32F)
            cv2.add(colour, noise, dst=colour, dtype=depth)
            cv2.min(cv2.max(colour, 0.0, dst=colour), each, dst=colour)
        else:
            cv2.add(colour, noise, dst=colour, dtype=depth)
            if colour.dtype != np.uint8:
                np.clip(colour, 0, 1, out=colour)
        cv2.mixChannels([colour, alpha], [out[rows]], [0, 0, 1, 1, 2, 2, 3, 3])
    return Layer(layer.box, out)


def lit(picture: Picture, light: Light, deep: bool = True) -> Image | Floats:
    """A picture (h, w, 3 or 4) in the light on each of its pixels: what would be brighter than white is white.

    Args: deep: whether it comes as 0..1 in float, else, as the picture, in 8 bits.
    """
    out = np.empty(picture.shape, np.float32 if deep else np.uint8)
    for rows in _bands(picture):
        # Light is laid on grey levels of 8 bit.
        levels = picture[rows] if picture.dtype == np.uint8 else in_float(picture[rows]) * np.float32(255)
        shown = Light(light.gain[rows], light.gloss[rows]).on(np.ascontiguousarray(levels[..., :3]))
        if deep:
            np.minimum(shown * np.float32(1 / 255), 1, out=out[rows, :, :3])
        else:
            out[rows, :, :3] = cv2.convertScaleAbs(shown)
    if picture.shape[2] == 4:
        alpha = picture[..., 3]
        out[..., 3] = in_float(alpha) if deep else alpha
    return out


def _bands(picture: Picture) -> Iterator[slice]:
    """The rows of a picture (h, w, ...), some at a time."""
    step = max(LIGHTING.pixels // picture.shape[1], 1)
    for top in range(0, len(picture), step):
        yield slice(top, min(top + step, len(picture)))


def check_ad(surface: Surface) -> None:
    """Raises InputError where an ad is needed and there is none, or none that can be read."""
    if surface.effect != "replace":
        return
    if surface.ad is None:
        raise InputError(NO_AD)
    open_ad(surface.ad, surface.playback).close()
