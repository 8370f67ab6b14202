"""Composite with OpenGL 3.3, off screen: on a GPU through EGL, or in software through EGL or OSMesa."""

from typing import Any

import cv2
import moderngl
import numpy as np

from ..closing import Closing
from ..errors import RunError
from .osmesa import OSMesaContext
from .raster import WHOLE, Floats, Image, Placement, Pyramid, Region, check_frame, place

TARGET_STEP = 128  # the render target grows in steps, so that a quad growing pixel by pixel does not re-allocate it

# Row 0 of a texture is the first row in memory. The frame's top row is therefore row 0 of the target, gl_FragCoord.y
# runs down the frame, and v runs down the ad: nothing is ever flipped.
VERTEX_SHADER = """
#version 330 core
void main() {  // one triangle that covers the viewport
    gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}
"""

# Positions q are in -1..1 over the box, to spare float32; `_set_uniforms` changes the coordinates.
FRAGMENT_SHADER = """
#version 330 core
uniform sampler2D ad;        // premultiplied
uniform vec2 texels;         // size of the ad
uniform vec2 centre;         // of the box, in pixels from its top-left corner
uniform float scale;         // pixels per unit of q
uniform mat4x3 edges;        // columns: inward distance in pixels from an edge, as a function of (q, 1)
uniform float ramp;          // pixels
uniform float opacity;
uniform mat3 q_to_ad;        // (q, 1) to (u, v, 1) * w, u and v in 0..1 across the ad
uniform vec3 first_tap;      // from a pixel to its first tap, in (u, v, 1) * w
uniform vec3 next_tap;       // from one tap to the next
uniform int taps;
uniform mat2x3 squeeze;      // columns: the two steps that span one tap's footprint
uniform vec2 levels;         // lowest, highest
const float TINY_W = 1e-6;
out vec4 colour;             // premultiplied

vec4 look(vec3 uvw, float level) {
    return textureLod(ad, uvw.xy / max(uvw.z, TINY_W), level);
}

void main() {
    vec2 q = (gl_FragCoord.xy - centre) / scale;
    vec4 ramps = clamp((vec3(q, 1.0) * edges + 0.5) / ramp, 0.0, 1.0);
    vec2 pairs = max(ramps.xy + ramps.zw - 1.0, 0.0);
    float coverage = pairs.x * pairs.y * opacity;
    if (coverage <= 0.0) discard;

    vec3 uvw = q_to_ad * vec3(q, 1.0);
    float w = max(uvw.z, TINY_W);
    vec2 uv = uvw.xy / w;
    vec2 a = (squeeze[0].xy - uv * squeeze[0].z) * texels / w;
    vec2 b = (squeeze[1].xy - uv * squeeze[1].z) * texels / w;
    float aa = dot(a, a), bb = dot(b, b);
    float longer2 = (aa + bb) / 2.0 + length(vec2((aa - bb) / 2.0, dot(a, b)));
    float level = clamp(0.5 * log2(max(longer2, TINY_W)), levels.x, levels.y);

    vec4 sum = look(uvw + first_tap, level);
    for (int i = 1; i < taps; ++i) sum += look(uvw + first_tap + float(i) * next_tap, level);
    colour = sum / float(taps) * coverage;
}
"""


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


class GlCompositor(Closing):
    """See `Compositor`. Takes over the context and releases it when closed.

    Raises:
        RunError: the driver cannot compile the shader, or, while compositing, reports an error.
    """

    def __init__(self, context: moderngl.Context, kind: str) -> None:
        self.context = context
        self.description = f"moderngl {kind}, {context.info['GL_RENDERER']}"
        try:
            self._program = context.program(vertex_shader=VERTEX_SHADER, fragment_shader=FRAGMENT_SHADER)
        except moderngl.Error as error:
            context.release()
            reason = " ".join(str(error).split())
            raise RunError(f"{self.description} cannot compile the shader ({reason}): update the driver") from error
        self._triangle = context.vertex_array(self._program, [])
        self._max_side: int = context.info["GL_MAX_TEXTURE_SIZE"]
        self._pyramid: Pyramid | None = None
        self._texture: moderngl.Texture | None = None
        self._uploaded: set[int] = set()
        self._canvas: moderngl.Texture | None = None  # what is drawn on; the target wraps it
        self._target: moderngl.Framebuffer | None = None
        self._pixels = np.empty(0, np.uint8)  # the box as RGBA, on its way there and back

    def composite(
        self,
        frame: Image,
        ad: Image,
        quad: Floats,
        region: Region = WHOLE,
        opacity: float = 1.0,
        feather: float = 0.0,
    ) -> None:
        """See `Compositor.composite`."""
        check_frame(frame)
        if self._pyramid is None or self._pyramid.ad is not ad:
            self._pyramid = Pyramid(ad, self._max_side)
            self._uploaded.clear()
        placement = place((frame.shape[1], frame.shape[0]), self._pyramid.size, quad, region, feather)
        if placement is None or not opacity > 0:
            return
        try:
            with self.context:
                self._upload_ad(self._pyramid, placement.levels)
                self._set_uniforms(placement, min(opacity, 1.0))
                self._draw(frame, placement.box)
        except moderngl.Error as error:
            raise RunError(f"{self.description} failed ({error}): use another compositor backend") from error

    def close(self) -> None:
        """Release the context and all that lives in it; calling again does nothing."""
        self._pyramid = None
        self.context.release()

    def _upload_ad(self, pyramid: Pyramid, levels: tuple[float, float]) -> None:
        """Bring the levels that this draw reads, and the texture has not yet, to the texture."""
        if self._texture is None or self._texture.size != pyramid.size:
            if self._texture is not None:
                self._texture.release()
            self._texture = self.context.texture(pyramid.size, 4)
            self._texture.build_mipmaps()  # allocates the levels; their content is written below
            self._texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
            self._texture.repeat_x = self._texture.repeat_y = False
        for level in range(int(levels[0]), int(np.ceil(levels[1])) + 1):
            if level not in self._uploaded:
                self._texture.write(pyramid.level(level), level=level)
                self._uploaded.add(level)
        self._texture.use(0)

    def _set_uniforms(self, placement: Placement, opacity: float) -> None:
        """Give the shader the placement in box coordinates: frame (x, y, 1) = q_to_frame @ (q, 1)."""
        x0, y0, x1, y1 = placement.box
        sampling = placement.sampling
        centre = np.array([x1 - x0, y1 - y0]) / 2
        scale = centre.max()
        q_to_frame = np.array([[scale, 0, x0 - 0.5 + centre[0]], [0, scale, y0 - 0.5 + centre[1]], [0, 0, 1]])
        steps_to_ad = sampling.frame_to_ad[:, :2]  # what a step (dx, dy) in the frame adds to (u, v, 1) * w
        taps = sampling.taps @ steps_to_ad.T
        # GLSL stores columns, numpy rows, so matrices go transposed.
        values = {
            "texels": sampling.texels,
            "centre": centre,
            "scale": scale,
            "edges": placement.edges @ q_to_frame,
            "ramp": placement.ramp,
            "opacity": opacity,
            "q_to_ad": (sampling.frame_to_ad @ q_to_frame).T,
            "first_tap": taps[0],
            "next_tap": taps[1] - taps[0] if len(taps) > 1 else np.zeros(3),
            "squeeze": (steps_to_ad @ sampling.squeeze).T,
            "levels": placement.levels,
        }
        for name, value in values.items():
            self._uniform(name).write(np.asarray(value, np.float32).tobytes())
        self._uniform("taps").value = len(taps)

    def _uniform(self, name: str) -> moderngl.Uniform:
        member = self._program[name]
        assert isinstance(member, moderngl.Uniform)
        return member

    def _draw(self, frame: Image, box: tuple[int, int, int, int]) -> None:
        """Send the box of the frame to the target, blend the ad over it there, and fetch it back."""
        x0, y0, x1, y1 = box
        width, height = x1 - x0, y1 - y0
        canvas, target = self._target_for(width, height)
        if self._pixels.size < width * height * 4:
            self._pixels = np.empty(width * height * 4, np.uint8)
        pixels = self._pixels[: width * height * 4].reshape(height, width, 4)
        part = frame[y0:y1, x0:x1]
        cv2.cvtColor(part, cv2.COLOR_RGB2RGBA, dst=pixels)
        canvas.write(pixels, viewport=(0, 0, width, height))
        target.viewport = (0, 0, width, height)
        target.use()
        self.context.enable_only(moderngl.BLEND)
        self.context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        self._triangle.render(moderngl.TRIANGLES, vertices=3)
        target.read_into(pixels, viewport=(width, height), components=4)
        if (error := self.context.error) != "GL_NO_ERROR":
            raise moderngl.Error(error)
        cv2.cvtColor(pixels, cv2.COLOR_RGBA2RGB, dst=part)

    def _target_for(self, width: int, height: int) -> tuple[moderngl.Texture, moderngl.Framebuffer]:
        """A canvas of width x height or more, and the framebuffer that draws on it."""
        old_canvas, old_target = self._canvas, self._target
        if old_canvas and old_target and old_canvas.width >= width and old_canvas.height >= height:
            return old_canvas, old_target
        if old_canvas:
            width, height = max(width, old_canvas.width), max(height, old_canvas.height)
        size = (-(-width // TARGET_STEP) * TARGET_STEP, -(-height // TARGET_STEP) * TARGET_STEP)
        self._canvas = self.context.texture(size, 4)
        self._target = self.context.framebuffer([self._canvas])
        self._target.use()  # before the old one goes: a bound framebuffer must not be deleted
        if old_canvas and old_target:
            old_target.release()
            old_canvas.release()
        return self._canvas, self._target
