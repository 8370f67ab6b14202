"""Draw with OpenGL 3.3, off screen: on a GPU through EGL, or in software through EGL or OSMesa.

Nothing goes up but the picture, each level of its mipmap when it is first looked at; nothing comes back but the box.
In software each instruction of the shader counts: it is compiled without what is not needed, as a second level where
one serves.
"""

from collections import deque
from contextlib import AbstractContextManager
from typing import Any

import moderngl
import numpy as np

from hdn.imaging.arrays import Array, Picture
from hdn.imaging.homography import translation

from ..errors import RunError
from .layer import Layer, as_box
from .mipmap import Mipmap, PictureCache
from .osmesa import OSMesaContext
from .raster import WHOLE, Raster, Region, rasterise

TARGET_STEP = 128  # px: the render target grows in steps, so that a growing quad does not re-allocate it each frame
SPARE_TEXTURES = 16  # of pictures that are gone, kept for the next ones of the same size
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software")  # in the names of renderers that use no GPU
KINDS = {"uint8": "f1", "float32": "f4"}  # moderngl's names of the types of texels

# Row 0 of a texture is the first row in memory. The box's top row is therefore row 0 of the target, gl_FragCoord.y
# runs down the frame, and v runs down the picture: nothing is ever flipped.
# What is a linear function of the pixel is worked out at the corners of what is drawn, and interpolated: in software
# that takes half the time of working it out pixel by pixel.
VERTEX_SHADER = """
uniform vec2 centre;         // of the box, in pixels from its top-left corner
uniform mat3 to_picture;     // columns: from (x, y, 1), pixels from the centre, to (u, v, 1) * w, 0..1 in the picture
uniform mat3x4 to_steps;     // likewise, to two footprints in texels of the fine level, times w squared
uniform mat3x4 to_sides;     // likewise, to what each edge leaves of the pixel
in vec2 corner;              // of what is drawn, in pixels from the box's top-left corner
noperspective out vec3 uvw;
noperspective out vec4 steps;
noperspective out vec4 sides;

void main() {
    vec3 p = vec3(corner - centre, 1.0);
    uvw = to_picture * p;
    steps = to_steps * p;
    sides = to_sides * p;
    gl_Position = vec4(p.xy / centre, 0.0, 1.0);
}
"""

FRAGMENT_SHADER = """
uniform sampler2D fine;      // a level of the premultiplied picture
uniform sampler2D coarse;    // the next level
uniform vec3 first_tap;      // from a pixel to its first tap, in (u, v, 1) * w
uniform vec3 next_tap;       // from one tap to the next
uniform int taps;
noperspective in vec3 uvw;
noperspective in vec4 steps;
noperspective in vec4 sides;
out vec4 colour;             // premultiplied
const float MIN_WEIGHT = 1e-6;

vec4 look(vec2 uv, float share) {
#if MIXED
    return mix(textureLod(fine, uv, 0.0), textureLod(coarse, uv, 0.0), share);
#else
    return textureLod(fine, uv, 0.0);
#endif
}

void main() {
    float per_w = 1.0 / max(uvw.z, MIN_WEIGHT);
    float share = 0.0;
#if MIXED
    vec2 a = steps.xy * (per_w * per_w), b = steps.zw * (per_w * per_w);
    float aa = dot(a, a), bb = dot(b, b);
    float longer2 = (aa + bb) / 2.0 + length(vec2((aa - bb) / 2.0, dot(a, b)));
    float level = 0.5 * log2(max(longer2, MIN_WEIGHT));  // above the fine one
    share = clamp(level, 0.0, 1.0);
#endif
#if AGAIN
    if (level < 0.0) discard;
#endif
#if MANY
    colour = vec4(0.0);
    for (int i = 0; i < taps; ++i) {
        vec3 tap = uvw + first_tap + float(i) * next_tap;
        colour += look(tap.xy / max(tap.z, MIN_WEIGHT), share);
    }
    colour /= float(taps);
#else
    colour = look(uvw.xy * per_w, share);
#endif
    vec4 ramps = clamp(sides, 0.0, 1.0);
    vec2 pairs = max(ramps.xy + ramps.zw - 1.0, 0.0);
    colour *= pairs.x * pairs.y;
}
"""
SWITCHES = ("MIXED", "AGAIN", "MANY")


def open_egl() -> tuple[moderngl.Context, str]:
    """A windowless context from EGL, and the name of its kind.

    Raises:
        RunError: there is none on this machine.
    """
    return _open("EGL", "libegl1 and libgl1-mesa-dri", standalone=True, backend="egl")


def open_osmesa() -> tuple[moderngl.Context, str]:
    """A software context from OSMesa, and the name of its kind.

    Raises:
        RunError: there is none on this machine.
    """
    return _open("OSMesa", "libosmesa6", context=OSMesaContext())


def _open(kind: str, packages: str, **settings: Any) -> tuple[moderngl.Context, str]:
    try:
        return moderngl.create_context(require=330, **settings), kind
    except Exception as error:  # whatever moderngl, its context library and the driver raise: they share no type
        reason = " ".join(str(error).split())
        raise RunError(f"{kind} gives no OpenGL 3.3 ({reason}): install {packages}") from error


class GlCompositor(AbstractContextManager["GlCompositor"]):
    """See `Compositor`. Takes over the context and releases it when closed.

    Raises:
        RunError: the driver cannot compile the shader, or, while drawing, reports an error.
    """

    def __init__(self, context: moderngl.Context, kind: str) -> None:
        self.context = context
        renderer = context.info["GL_RENDERER"]
        self.in_software = any(name in renderer.lower() for name in SOFTWARE)
        self.description = f"moderngl {kind}, {renderer}" + ", in software" * self.in_software
        self._max_side: int = context.info["GL_MAX_TEXTURE_SIZE"]
        self._programs: dict[tuple[bool, ...], moderngl.Program] = {}  # by the shader's switches
        try:
            self._program(mixed=True, again=True, many=True)
        except moderngl.Error as error:
            context.release()
            reason = " ".join(str(error).split())
            raise RunError(f"{self.description} cannot compile the shader ({reason}): update the driver") from error
        self._spare: deque[moderngl.Texture] = deque()
        self._textures = PictureCache(lambda picture: _Textures(context, Mipmap(picture, self._max_side), self._spare))
        self._targets: dict[str, moderngl.Framebuffer] = {}  # by the type of texels

    def _program(self, *, mixed: bool, again: bool, many: bool) -> moderngl.Program:
        """The shaders that mix two levels or not, draw over others or not, and look once or many times a pixel."""
        switches = mixed, again, many
        if switches not in self._programs:
            defines = "#version 330 core\n"
            defines += "".join(f"#define {name} {int(on)}\n" for name, on in zip(SWITCHES, switches, strict=True))
            self._programs[switches] = self.context.program(
                vertex_shader=defines + VERTEX_SHADER, fragment_shader=defines + FRAGMENT_SHADER
            )
        return self._programs[switches]

    def draw(
        self, picture: Picture, quad: Array, frame_size: tuple[int, int], region: Region = WHOLE, feather: float = 0.0
    ) -> Layer | None:
        """See `Compositor.draw`."""
        try:
            with self.context:
                textures = self._textures.of(picture)
                raster = rasterise(frame_size, textures.mipmap.size, quad, region, feather)
                return None if raster is None else self._draw(textures, raster)
        except moderngl.Error as error:
            raise RunError(f"{self.description} failed ({error}): use another compositor backend") from error

    def close(self) -> None:
        """Releases the context and all that lives in it; calling again does nothing."""
        self._textures.clear()
        self._spare.clear()
        self.context.release()

    def __exit__(self, *error: object) -> None:
        self.close()

    def _draw(self, textures: "_Textures", raster: Raster) -> Layer:
        x0, y0, x1, y1 = raster.box
        rgba = np.empty((y1 - y0, x1 - x0, 4), textures.mipmap.level(0).dtype)
        target = self._target_for(x1 - x0, y1 - y0, textures.kind)
        target.use()
        self.context.enable_only(moderngl.NOTHING)
        target.clear()
        target.viewport = (0, 0, x1 - x0, y1 - y0)
        many = len(raster.sampling.taps) > 1
        for step in raster.steps():
            program = self._program(mixed=step.mixed, again=step.again, many=many)
            _set(program, _uniforms(raster, step.fine))
            textures.level(step.fine).use(0)
            if step.mixed:
                textures.level(step.fine + 1).use(1)
            self._draw_polygon(program, step.polygon - [x0 - 0.5, y0 - 0.5])
        target.read_into(rgba, viewport=(x1 - x0, y1 - y0), components=4, dtype=textures.kind)
        if (error := self.context.error) != "GL_NO_ERROR":
            raise moderngl.Error(error)
        return Layer(as_box(*raster.box), rgba)

    def _draw_polygon(self, program: moderngl.Program, corners: Array) -> None:
        """Draws a convex polygon (n, 2), pixels from the box's top-left corner."""
        buffer = self.context.buffer(corners.astype(np.float32).tobytes())
        vertices = self.context.vertex_array(program, [(buffer, "2f", "corner")])
        vertices.render(moderngl.TRIANGLE_FAN, vertices=len(corners))
        vertices.release()
        buffer.release()

    def _target_for(self, width: int, height: int, kind: str) -> moderngl.Framebuffer:
        """A framebuffer of width x height or more; its texture lives as long as it."""
        old = self._targets.get(kind)
        if old is not None:
            if old.width >= width and old.height >= height:
                return old
            width, height = max(width, old.width), max(height, old.height)
        size = (-(-width // TARGET_STEP) * TARGET_STEP, -(-height // TARGET_STEP) * TARGET_STEP)
        target = self._targets[kind] = self.context.framebuffer([self.context.texture(size, 4, dtype=kind)])
        target.use()  # before the old one goes: a bound framebuffer must not be deleted
        if old is not None:
            texture = old.color_attachments[0]
            old.release()
            texture.release()
        return target


class _Textures:
    """The levels of a picture's mipmap as textures, each uploaded when first asked for; when gone, they are spare."""

    def __init__(self, context: moderngl.Context, mipmap: Mipmap, spare: deque[moderngl.Texture]) -> None:
        self.mipmap = mipmap
        self.kind = KINDS[mipmap.level(0).dtype.name]
        self._context, self._spare = context, spare
        self._levels: dict[int, moderngl.Texture] = {}

    def level(self, index: int) -> moderngl.Texture:
        """The texture of a level. The context must be current."""
        if index not in self._levels:
            pixels = self.mipmap.level(index)
            size = pixels.shape[1], pixels.shape[0]
            texture = self._spare_one(size) or self._new_one(size)
            texture.write(pixels)
            self._levels[index] = texture
        return self._levels[index]

    def _spare_one(self, size: tuple[int, int]) -> moderngl.Texture | None:
        for texture in self._spare:
            if texture.size == size and texture.dtype == self.kind:
                self._spare.remove(texture)
                return texture
        while len(self._spare) > SPARE_TEXTURES:
            self._spare.popleft().release()
        return None

    def _new_one(self, size: tuple[int, int]) -> moderngl.Texture:
        texture = self._context.texture(size, 4, dtype=self.kind)
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return texture

    def __del__(self) -> None:
        self._spare.extend(self._levels.values())


def _uniforms(raster: Raster, fine: int) -> dict[str, Any]:
    """What the shaders take, in coordinates of the box; `fine`: the level looked at."""
    x0, y0, x1, y1 = raster.box
    sampling = raster.sampling
    centre = np.array([x1 - x0, y1 - y0]) / 2
    to_frame = translation(centre[0] + x0 - 0.5, centre[1] + y0 - 0.5)
    steps = sampling.frame_to_picture[:, :2]  # what a step (dx, dy) in the frame adds to (u, v, 1) * w
    taps = sampling.taps @ steps.T
    # Along a step (du, dv, dw) of the footprint, u grows by (du - u dw) / w: by (du w - dw u w) / w^2.
    to_texel = np.diag([*sampling.texels / 2.0**fine, 1.0]) @ sampling.frame_to_picture @ to_frame
    footprint = (np.diag([*sampling.texels / 2.0**fine, 1.0]) @ steps @ sampling.footprint).T
    to_steps = [step[axis] * to_texel[2] - step[2] * to_texel[axis] for step in footprint for axis in (0, 1)]
    # GLSL stores columns, NumPy rows, so matrices go transposed.
    return {
        "fine": np.int32(0),
        "coarse": np.int32(1),
        "centre": centre,
        "to_picture": (sampling.frame_to_picture @ to_frame).T,
        "to_steps": np.transpose(to_steps),
        "to_sides": (raster.ramps @ to_frame).T,
        "first_tap": taps[0],
        "next_tap": taps[1] - taps[0] if len(taps) > 1 else np.zeros(3),
        "taps": np.int32(len(taps)),
    }


def _set(program: moderngl.Program, uniforms: dict[str, Any]) -> None:
    """Gives a program the uniforms that it has."""
    for name, value in uniforms.items():
        member = program.get(name, None)
        if isinstance(member, moderngl.Uniform):
            member.write((value if isinstance(value, np.int32) else np.asarray(value, np.float32)).tobytes())
