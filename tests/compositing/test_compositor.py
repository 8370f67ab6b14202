"""Compositing: one picture from every backend, edges and sampling against exact references, nothing else touched."""

import ctypes
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, get_args

import cv2
import numpy as np
import pytest

from ar_demo.choices import Blend
from ar_demo.compositing import opengl as compositor_gl
from ar_demo.compositing import osmesa
from ar_demo.compositing.compositor import Compositor, open_compositor
from ar_demo.compositing.fit import fit_region, quad_aspect
from ar_demo.compositing.layer import Layer
from ar_demo.compositing.merge import blurred_layer, merge
from ar_demo.compositing.opengl import GlCompositor
from hdn.errors import InputError, RunError
from hdn.imaging.arrays import Array, Image, Picture

WIDTH, HEIGHT = 200, 140


def opened(backend: str) -> Compositor:
    try:
        return open_compositor(backend)
    except RunError as error:
        pytest.skip(str(error))


@contextmanager
def no_gl_error(compositor: Compositor) -> Iterator[None]:
    """Asserts that OpenGL reports no error, neither before nor after."""

    def check() -> None:
        if isinstance(compositor, GlCompositor):
            with compositor.context:
                assert compositor.context.error == "GL_NO_ERROR"

    check()
    yield
    check()


@pytest.fixture(params=["opencv", "egl", "osmesa"])
def compositor(request: pytest.FixtureRequest) -> Iterator[Compositor]:
    with opened(request.param) as compositor, no_gl_error(compositor):
        yield compositor


def new_frame() -> Image:
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    return np.ascontiguousarray(cv2.GaussianBlur(noise, (0, 0), 2))


def poster(width: int = 320, height: int = 200) -> Image:
    """A checkerboard with writing on it: hard edges at every scale."""
    y, x = np.mgrid[:height, :width]
    ad = np.where(((x // 20 + y // 20) % 2)[..., None], (250, 240, 230), (20, 30, 120)).astype(np.uint8)
    cv2.putText(ad, "SALE 50%", (width // 20, height // 2), cv2.FONT_HERSHEY_SIMPLEX, width / 200, (255, 30, 30), 3)
    return ad


def with_alpha(ad: Image) -> Image:
    ramp = np.tile(np.linspace(0, 255, ad.shape[1]).astype(np.uint8), (ad.shape[0], 1))
    return np.dstack((ad, ramp))


def upright(x0: float, y0: float, x1: float, y1: float) -> Array:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], np.float64)


QUADS = {
    "front": upright(20.3, 15.7, 170.2, 120.4),
    "perspective": np.array([[60, 20], [130, 25], [190, 130], [10, 125]], np.float64),
    "strong": np.array([[85, 30], [112, 30], [195, 135], [5, 135]], np.float64),
    "rotated": np.array([[90, 5], [180, 75], [105, 132], [20, 70]], np.float64),
    "mirrored": np.array([[170, 20], [30, 30], [25, 120], [180, 110]], np.float64),
    "partly outside": np.array([[-60, -30], [120, 20], [110, 120], [-80, 200]], np.float64),
    "larger than the frame": np.array([[-150, -90], [420, -60], [380, 300], [-120, 260]], np.float64),
    "minified 8x": np.array([[80, 50], [120.5, 52], [119, 76], [81, 74.5]], np.float64),
    "tiny": np.array([[80, 50], [83.5, 50.4], [83.2, 52.6], [79.9, 52.3]], np.float64),
    "magnified 5x": np.array([[-700, -400], [900, -450], [950, 560], [-680, 540]], np.float64),
}


def composite(compositor: Compositor, frame: Image, ad: Picture, quad: Array, **options: Any) -> None:
    """Draws an ad and lays it on a frame."""
    opacity = options.pop("opacity", 1.0)
    layer = compositor.draw(ad, quad, (frame.shape[1], frame.shape[0]), **options)
    if layer is not None:
        merge(frame, layer, opacity=opacity)


def drawn(compositor: Compositor, ad: Picture, quad: Array, **options: Any) -> Image:
    frame = new_frame()
    composite(compositor, frame, ad, quad, **options)
    return frame


def as_depth(ad: Image, dtype: type) -> Picture:
    scale = {np.uint8: 1, np.uint16: 257, np.float32: 1 / 255}[dtype]
    return np.multiply(ad, scale, dtype=np.float64).astype(dtype)


@pytest.mark.parametrize("backend", ["egl", "osmesa"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_backends_draw_the_same_layers(backend: str, dtype: type) -> None:
    options: list[dict[str, Any]] = [
        {},
        {"feather": 5.0},
        {"region": fit_region("contain", 1.6, 1.0)},
        {"region": fit_region("cover", 1.6, 1.0)},
    ]
    layers: dict[str, list[Layer]] = {}
    for name in ("opencv", backend):
        with opened(name) as compositor, no_gl_error(compositor):
            layers[name] = [
                layer
                for ad in (as_depth(poster(), dtype), as_depth(with_alpha(poster()), dtype))
                for quad in QUADS.values()
                for option in options
                if (layer := compositor.draw(ad, quad, (WIDTH, HEIGHT), **option)) is not None
            ]
    assert len(layers[backend]) == len(QUADS) * len(options) * 2
    for one, other in zip(layers["opencv"], layers[backend], strict=True):
        assert one.box == other.box
        assert one.rgba.dtype == other.rgba.dtype == (np.uint8 if dtype is np.uint8 else np.float32)
        difference = np.abs(one.rgba.astype(float) - other.rgba) * (1 if dtype is np.uint8 else 255)
        drawn_on = (one.rgba > 0).any(axis=-1) | (other.rgba > 0).any(axis=-1)
        assert difference[drawn_on].mean() < (1.0 if dtype is np.uint8 else 0.6)
        assert np.percentile(difference[drawn_on], 99) <= 3


@pytest.mark.parametrize("backend", ["egl", "osmesa"])
@pytest.mark.parametrize("blend", get_args(Blend))
def test_backends_give_the_same_frames_in_all_modes(backend: str, blend: Blend) -> None:
    ads = [as_depth(ad, dtype) for ad in (poster(), with_alpha(poster())) for dtype in (np.uint8, np.float32)]
    frames: dict[str, list[Image]] = {}
    for name in ("opencv", backend):
        frames[name] = []
        with opened(name) as compositor, no_gl_error(compositor):
            for ad in ads:
                frame = new_frame()
                layer = compositor.draw(ad, QUADS["perspective"], (WIDTH, HEIGHT))
                assert layer is not None
                merge(frame, blurred_layer(layer, np.diag([2.0, 0.5]), frame.shape[:2]), blend, opacity=0.8)
                frames[name].append(frame)
    for one, other in zip(frames["opencv"], frames[backend], strict=True):
        touched = (one != new_frame()).any(axis=-1)
        difference = np.abs(one.astype(int) - other)[touched]
        assert difference.size
        assert difference.mean() < 1.0
        assert np.percentile(difference, 99) <= 3


@pytest.mark.parametrize("name", QUADS)
def test_close_to_the_mean_over_every_pixel(compositor: Compositor, name: str) -> None:
    """Against 64 samples a pixel: no aliasing where minified, no blur where not, edges in the right place.

    Without the pyramid the errors are 4 to 54, with levels one too coarse 5 to 37.
    """
    ad, fine = poster(), 8
    corners = np.array([[-0.5, -0.5], [319.5, -0.5], [319.5, 199.5], [-0.5, 199.5]], np.float32)
    ad_to_fine = cv2.getPerspectiveTransform(corners, ((QUADS[name] + 0.5) * fine - 0.5).astype(np.float32))
    background = cv2.resize(new_frame(), None, fx=fine, fy=fine, interpolation=cv2.INTER_NEAREST)
    size = (WIDTH * fine, HEIGHT * fine)
    mask = cv2.warpPerspective(np.ones(ad.shape[:2], np.uint8), ad_to_fine, size, flags=cv2.INTER_NEAREST)
    picture = cv2.warpPerspective(ad, ad_to_fine, size, borderMode=cv2.BORDER_REPLICATE)
    exact = cv2.resize(
        np.where(mask[..., None] > 0, picture, background), (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA
    )
    touched = (exact != new_frame()).any(axis=-1)
    error = np.abs(drawn(compositor, ad, QUADS[name]).astype(float) - exact)[touched]
    assert error.mean() < {"minified 8x": 10, "tiny": 6}.get(name, 3.5)


@pytest.mark.parametrize(
    ("x0", "x1", "expected"),
    [(50.0, 60.0, {49: 0.0, 50: 0.5, 51: 1.0, 59: 1.0, 60: 0.5, 61: 0.0}), (49.9, 50.15, {49: 0.0, 50: 0.25, 51: 0.0})],
)
def test_edge_pixels_are_covered_by_area(
    compositor: Compositor, x0: float, x1: float, expected: dict[int, float]
) -> None:
    frame = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    composite(compositor, frame, np.full((8, 8, 3), 200, np.uint8), upright(x0, 20, x1, 100))
    for x, coverage in expected.items():
        assert frame[60, x] == pytest.approx(200 * coverage, abs=1.5)


def test_a_last_pixel_on_its_own_is_covered_in_part_too(compositor: Compositor) -> None:
    """The quad's box is 257 x 129: a tile of the OpenCV backend, and one pixel more."""
    frame = np.zeros((160, 300, 3), np.uint8)
    composite(compositor, frame, np.full((8, 8, 3), 200, np.uint8), upright(9.5, 9.5, 265.75, 137.75))
    assert frame[138, 266] == pytest.approx(200 / 16, abs=1.5)
    assert frame[138, 200] == pytest.approx(200 / 4, abs=1.5)
    assert (frame[10:138, 10:266] == 200).all()


def test_feather_fades_inward(compositor: Compositor) -> None:
    frame = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    composite(compositor, frame, np.full((8, 8, 3), 200, np.uint8), upright(20, 20, 120, 120), feather=10)
    row = frame[70, :, 0].astype(int)
    assert (row[:20] == 0).all()
    assert (row[31:109] >= 199).all()
    assert (np.diff(row[20:31]) > 10).all()


def test_feather_wider_than_the_ad_still_shows_it(compositor: Compositor) -> None:
    frame = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    composite(compositor, frame, np.full((8, 8, 3), 200, np.uint8), upright(20, 20, 40, 40), feather=500)
    assert frame[30, 30].min() > 120


def test_corners_lie_where_the_quad_says(compositor: Compositor) -> None:
    ad = np.zeros((40, 60, 3), np.uint8)
    ad[:20, :30], ad[:20, 30:], ad[20:, 30:], ad[20:, :30] = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)
    for quad in (QUADS["front"], QUADS["rotated"], QUADS["mirrored"], QUADS["perspective"][[2, 3, 0, 1]]):
        frame = drawn(compositor, ad, quad)
        for corner, colour in zip(quad, [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)], strict=True):
            x, y = np.round(corner + (quad.mean(axis=0) - corner) * 0.15).astype(int)
            assert np.abs(frame[y, x].astype(int) - colour).max() <= 1


def test_straight_alpha_leaves_no_fringe(compositor: Compositor) -> None:
    """White on transparent black, over white: any grey pixel would be the hidden black bleeding in."""
    ad = np.zeros((64, 64, 4), np.uint8)
    ad[16:48, 16:48] = 255
    for quad in (upright(10, 10, 130, 130), upright(40.3, 40.7, 52.1, 52.9), QUADS["strong"]):
        frame = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
        composite(compositor, frame, ad, quad)
        assert frame.min() >= 253


def test_half_transparent_ad_and_opacity_mix(compositor: Compositor) -> None:
    ad = np.full((16, 16, 4), (200, 100, 0, 128), np.uint8)
    frame = np.full((HEIGHT, WIDTH, 3), 60, np.uint8)
    composite(compositor, frame, ad, upright(20, 20, 100, 100), opacity=0.5)
    alpha = 128 / 255 * 0.5
    assert frame[60, 60] == pytest.approx(np.array([200, 100, 0]) * alpha + 60 * (1 - alpha), abs=1.5)


def test_opaque_ad_has_no_dark_edge(compositor: Compositor) -> None:
    frame = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    composite(compositor, frame, np.full((300, 300, 3), 255, np.uint8), QUADS["rotated"])
    assert frame.min() >= 254


def test_beyond_the_region_the_frame_shows(compositor: Compositor) -> None:
    """A square ad contained in a surface twice as wide leaves a quarter of it free on either side."""
    frame = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    region = fit_region("contain", 1.0, 2.0)
    composite(compositor, frame, np.full((50, 50, 3), 200, np.uint8), upright(20, 20, 180, 100), region=region)
    row = frame[60, :, 0].astype(int)
    assert (row[:60] == 0).all()
    assert (row[61:140] == 200).all()
    assert (row[141:] == 0).all()
    assert row[60] == row[140] == pytest.approx(100, abs=1)


NOTHING = {
    "nan": np.full((4, 2), np.nan),
    "infinite": np.array([[0, 0], [np.inf, 0], [50, 50], [0, 50]]),
    "a point": np.full((4, 2), 50.0),
    "a line": np.array([[0, 0], [50, 50], [100, 100], [20, 20]], np.float64),
    "three corners in line": np.array([[0, 0], [50, 0], [100, 0], [50, 90]], np.float64),
    "concave": np.array([[10, 10], [100, 10], [40, 40], [10, 100]], np.float64),
    "crossed": np.array([[10, 10], [100, 100], [100, 10], [10, 100]], np.float64),
    "left of the frame": upright(-100, 10, -1, 90),
    "below the frame": upright(10, HEIGHT + 1, 90, HEIGHT + 90),
    "under half a pixel": upright(50, 50, 50.5, 50.5),
}


@pytest.mark.parametrize("name", NOTHING)
def test_nothing_is_drawn(compositor: Compositor, name: str) -> None:
    assert (drawn(compositor, poster(), NOTHING[name]) == new_frame()).all()


@pytest.mark.filterwarnings("error")
def test_any_corners_are_survived(compositor: Compositor) -> None:
    """Random corners near and far, and a surface turning edge-on: no exception, no warning."""
    rng = np.random.default_rng(1)
    ad = with_alpha(poster(64, 48))
    centre = np.array([WIDTH / 2, HEIGHT / 2])
    for scale in (30, 300, 1e5, 1e9):
        for _ in range(15):
            drawn(compositor, ad, rng.normal(centre, scale, (4, 2)), feather=2)
    for squeeze in np.geomspace(1, 1e-6, 12):
        drawn(compositor, ad, (QUADS["strong"] - (100, 80)) * (1, squeeze) + (100, 80))


@pytest.mark.parametrize("name", ["front", "rotated", "partly outside", "tiny"])
def test_only_pixels_near_the_quad_change(compositor: Compositor, name: str) -> None:
    frame = np.full((HEIGHT, WIDTH, 3), 77, np.uint8)
    composite(compositor, frame, np.full((8, 8, 3), 200, np.uint8), QUADS[name])
    contour = QUADS[name].astype(np.float32)
    for y, x in np.argwhere((frame != 77).any(axis=-1)):
        assert cv2.pointPolygonTest(contour, (float(x), float(y)), True) > -1.5


def test_a_moving_small_ad_does_not_shimmer(compositor: Compositor) -> None:
    """The mean light of a fine pattern stays the same wherever its pixels fall."""
    light = []
    for shift in np.linspace(0, 2, 9):
        frame = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        composite(compositor, frame, poster(), upright(50 + shift, 50 + shift / 2, 75 + shift, 66 + shift / 2))
        light.append(frame.sum() / (25 * 16))
    assert np.ptp(light) < 0.01 * np.mean(light)


def test_sampling_changes_smoothly_with_slant(compositor: Compositor) -> None:
    """As the surface turns, taps are added one by one; no step between frames may show."""
    ad, last = poster(), None
    for narrow in np.arange(1.0, 0.3, -0.004):
        frame = drawn(compositor, ad, (upright(-50, -30, 50, 30) * (narrow, 1.0)) + (100, 70))
        contrast = float(frame[50:90, 88:112].astype(float).std())
        assert last is None or abs(contrast - last) < 6
        last = contrast


def test_the_next_ad_is_taken_up(compositor: Compositor) -> None:
    """Also if it is of another size, or of the same size after the first is gone."""
    for value, size in ((10, (40, 30)), (90, (40, 30)), (170, (25, 60)), (250, (40, 30))):
        ad = np.full((*size, 3), value, np.uint8)
        assert (drawn(compositor, ad, QUADS["front"])[60, 90] == value).all()
        del ad


def test_quads_and_frames_of_growing_size(compositor: Compositor) -> None:
    for size in (8, 300, 20, 517):
        frame = np.zeros((size, size + 3, 3), np.uint8)
        composite(compositor, frame, np.full((4, 4, 3), 99, np.uint8), upright(-9, -9, size + 9, size + 9))
        assert (frame == 99).all()


def test_an_ad_too_large_for_the_texture_is_shrunk() -> None:
    with opened("egl") as compositor:
        assert isinstance(compositor, GlCompositor)
        large = drawn(compositor, poster(), QUADS["front"])
        compositor._max_side = 150
        small = drawn(compositor, poster(), QUADS["front"])
        assert compositor.context.error == "GL_NO_ERROR"
    assert 0 < np.abs(large.astype(int) - small).mean() < 10


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"picture": np.zeros((9, 9), np.uint8)}, "ad"),
        ({"picture": np.zeros((9, 9, 3), np.float64)}, "ad"),
        ({"quad": np.zeros((3, 2))}, "four corners"),
        ({"region": (0.5, 0, 0.5, 1)}, "region"),
        ({"feather": -1}, "feather"),
    ],
)
def test_wrong_input_is_told(compositor: Compositor, change: dict[str, Any], words: str) -> None:
    good = {"picture": poster(), "quad": QUADS["front"], "frame_size": (WIDTH, HEIGHT)}
    with pytest.raises(InputError, match=words):
        compositor.draw(**(good | change))


@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_contexts_can_follow_each_other_and_live_together(backend: str) -> None:
    for _ in range(5):
        opened(backend).close()
    with opened(backend) as one, opened(backend) as other, no_gl_error(other):
        first = drawn(one, poster(), QUADS["front"])
        second = drawn(other, poster(), QUADS["front"])
        again = drawn(one, poster(), QUADS["front"])
        one.close()
        one.close()
        last = drawn(other, poster(), QUADS["front"])
    assert (first == second).all()
    assert (first == again).all()
    assert (first == last).all()


def no_egl(**settings: object) -> None:
    raise RuntimeError("libEGL.so not\nloaded")


def no_library(name: str) -> None:
    raise OSError(f"{name}: cannot open shared object file")


@pytest.fixture
def without_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compositor_gl.moderngl, "create_context", no_egl)
    monkeypatch.setattr(ctypes, "CDLL", no_library)


def test_the_log_names_the_renderer_and_whether_it_uses_a_gpu(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), opened("osmesa") as compositor:  # which knows no GPU
        assert isinstance(compositor, GlCompositor)
    messages = [record.getMessage() for record in caplog.records]
    assert messages == [f"compositor: moderngl OSMesa, {compositor.context.info['GL_RENDERER']}, in software"]


@pytest.mark.usefixtures("without_opengl")
def test_auto_falls_back_aloud(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ar_demo.compositing.compositor.may_have_gpu", lambda: True)
    with caplog.at_level(logging.INFO), open_compositor("auto") as compositor:
        assert compositor.description.startswith("OpenCV")
        drawn(compositor, poster(), QUADS["front"])
    warnings = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
    assert len(warnings) == 1
    assert "egl" in warnings[0]
    assert "\n" not in warnings[0]
    assert any("OpenCV" in record.getMessage() for record in caplog.records if record.levelno == logging.INFO)


@pytest.mark.usefixtures("without_opengl")
@pytest.mark.parametrize(("backend", "package"), [("egl", "libegl1"), ("osmesa", "libosmesa6")])
def test_a_named_backend_is_not_replaced(backend: str, package: str) -> None:
    with pytest.raises(RunError, match=package):
        open_compositor(backend)


@pytest.mark.parametrize("gpu", [True, False])
def test_opencv_serves_where_opengl_is_in_software(monkeypatch: pytest.MonkeyPatch, gpu: bool) -> None:
    monkeypatch.setattr("ar_demo.compositing.compositor.may_have_gpu", lambda: gpu)
    with opened("egl") as compositor:
        in_software = isinstance(compositor, GlCompositor) and compositor.in_software
    with open_compositor("auto") as compositor:
        assert isinstance(compositor, GlCompositor) == (gpu and not in_software)
        assert (drawn(compositor, poster(), QUADS["front"]) != new_frame()).any()


def test_osmesa_without_a_context_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    opened("osmesa").close()
    library = ctypes.CDLL(osmesa.LIBRARY)
    monkeypatch.setattr(library, "OSMesaCreateContextAttribs", lambda *_: None)
    monkeypatch.setattr(ctypes, "CDLL", lambda name: library)
    with pytest.raises(RunError, match=r"3\.3"):
        open_compositor("osmesa")


def test_a_driver_that_cannot_compile_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    opened("egl").close()
    monkeypatch.setattr(compositor_gl, "FRAGMENT_SHADER", "#version 330 core\nnonsense")
    with pytest.raises(RunError, match="compile") as caught:
        open_compositor("egl")
    assert "\n" not in str(caught.value)


def test_an_error_of_the_driver_is_told_and_leaves_the_frame() -> None:
    with opened("egl") as compositor:
        assert isinstance(compositor, GlCompositor)
        frame = new_frame()
        before = frame.copy()
        texture = compositor.context.texture((4, 4), 4)
        texture.write(bytes(64), viewport=(3, 3, 4, 4))  # beyond the texture, which OpenGL refuses
        with pytest.raises(RunError, match="another compositor"):
            composite(compositor, frame, poster(), QUADS["tiny"])
        assert (frame == before).all()
        composite(compositor, frame, poster(), QUADS["tiny"])
        assert (frame != before).any()


def test_unknown_backend() -> None:
    with pytest.raises(InputError, match="auto, egl, osmesa, opencv"):
        open_compositor("vulkan")


@pytest.mark.parametrize(
    ("fit", "ad", "surface", "region"),
    [
        ("stretch", 2.0, 1.0, (0, 0, 1, 1)),
        ("contain", 2.0, 1.0, (0, -0.5, 1, 1.5)),
        ("contain", 1.0, 2.0, (-0.5, 0, 1.5, 1)),
        ("cover", 2.0, 1.0, (0.25, 0, 0.75, 1)),
        ("cover", 1.0, 2.0, (0, 0.25, 1, 0.75)),
        ("contain", 1.5, 1.5, (0, 0, 1, 1)),
    ],
)
def test_fit_region(fit: str, ad: float, surface: float, region: tuple[float, ...]) -> None:
    assert fit_region(fit, ad, surface) == pytest.approx(region)  # type: ignore[arg-type]


@pytest.mark.parametrize("arguments", [("fill", 1, 1), ("cover", 0, 1), ("cover", 1, float("nan"))])
def test_fit_region_wants_sense(arguments: tuple[str, float, float]) -> None:
    with pytest.raises(InputError):
        fit_region(*arguments)  # type: ignore[arg-type]


def seen_by_camera(aspect: float, focal: float, turn: Callable[[Array], Array]) -> Array:
    """Corners of a rectangle 4 heights away, in a 640x360 frame, for a focal length in frame widths."""
    corners = upright(-aspect / 2, -0.5, aspect / 2, 0.5)
    x, y, z = (turn(np.column_stack((corners, np.zeros(4)))) + np.array([0.3, -0.2, 4])).T
    return np.column_stack((x, y)) / z[:, None] * focal * 640 + (319.5, 179.5)


def rotation(*angles: float) -> Callable[[Array], Array]:
    matrix = cv2.Rodrigues(np.radians(np.array(angles)))[0]
    return lambda points: np.asarray(points @ matrix.T)


@pytest.mark.parametrize("aspect", [0.6, 1.0, 16 / 9])
@pytest.mark.parametrize("focal", [0.7, 0.9, 1.4])
def test_quad_aspect_sees_through_perspective(aspect: float, focal: float) -> None:
    for turn in (rotation(40, 35, 10), rotation(-30, 50, 0)):
        assert quad_aspect(seen_by_camera(aspect, focal, turn), (640, 360)) == pytest.approx(aspect, rel=0.01)


def test_quad_aspect_of_a_sign_turned_about_one_axis() -> None:
    """Nothing tells the focal length here; a common one still beats the foreshortened sides."""
    quad = seen_by_camera(1.5, 0.8, rotation(0, 55, 0))
    assert quad_aspect(quad, (640, 360)) == pytest.approx(1.5, rel=0.15)
    assert quad_aspect(quad) < 1.1


def test_quad_aspect_of_upright_and_crossed_quads() -> None:
    assert quad_aspect(upright(10, 10, 90, 50), (640, 360)) == pytest.approx(2)
    assert quad_aspect(upright(10, 10, 90, 50)) == pytest.approx(2)
    with pytest.raises(InputError):
        quad_aspect(NOTHING["crossed"])
