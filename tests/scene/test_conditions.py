"""Light, occluders and blur are found where they are and nowhere else, and ads take them on."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

import ar_demo
from ar_demo.compositing.opencv import CvCompositor
from ar_demo.media.reader import VideoReader
from ar_demo.options import OutputOptions
from ar_demo.rendering.painting import Painter
from ar_demo.scene.conditions import REST, Appearance, Conditions
from ar_demo.scene.light import as_it_was, exposure
from ar_demo.surface import Surface
from ar_demo.tracks import Source, Track
from hdn.imaging.arrays import Array
from hdn.imaging.homography import from_corners
from hdn.networks.loading import load_matte
from hdn.networks.matte import Matte

from ..clips import make_clip
from ..scenes import Scene, moved

SCENE = Scene(640, 480, seed=3)
SCENE.quad = np.array([[200.0, 140], [440, 148], [432, 332], [204, 320]])
UNIT = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


@pytest.fixture(scope="module")
def reference() -> np.ndarray:
    return SCENE.draw(SCENE.quad)


@pytest.fixture(scope="module")
def matte() -> Matte:
    return load_matte()


@pytest.fixture
def appearance(reference: np.ndarray, matte: Matte) -> Appearance:
    return Appearance(reference, SCENE.quad, matte, softness=False)


def look(appearance: Appearance, frame: np.ndarray, pose: Array = SCENE.quad, deviation: float = 0.3) -> Conditions:
    """The conditions in a frame that stays for a while."""
    for _ in range(4):
        conditions = appearance.see(frame, pose, deviation)
    return conditions


@pytest.mark.parametrize("sigma", [0.0, 2.0])
@pytest.mark.parametrize("off", [2.0, 3.0, 6.0])
def test_misalignment_is_neither_blur_nor_an_occluder(
    appearance: Appearance, reference: np.ndarray, off: float, sigma: float
) -> None:
    """A pose that is wrong by some px, and believed to be good."""
    frame = cv2.GaussianBlur(reference, (0, 0), sigma) if sigma else reference
    aligned, beside = look(appearance, frame), look(appearance, frame, SCENE.quad + np.array([off, -off / 2]))
    np.testing.assert_allclose(beside.blur, aligned.blur, atol=2.5)
    assert hidden(beside).mean() < 1e-3
    assert np.abs(beside.light.gain - aligned.light.gain).mean() < 0.05


def hidden(conditions: Conditions, shape: tuple[int, ...] = (480, 640)) -> np.ndarray:
    """What is hidden of each pixel of a frame, (h, w) 0..1."""
    share = np.zeros(shape[:2])
    if conditions.occluder is not None:
        share[conditions.occluder.box] = conditions.occluder.share[..., 0]
    return share


def inside(quad: Array) -> np.ndarray:
    mask = np.zeros((480, 640), np.uint8)
    cv2.fillConvexPoly(mask, np.round(quad).astype(np.int32), 1)
    return mask > 0


def passer_by(frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A frame with somebody in green before the surface's left third, and how much they take of each pixel (h, w)."""
    share = np.zeros(frame.shape[:2], np.float32)
    cv2.ellipse(share, (250, 300), (45, 120), 0, 0, 360, 1.0, -1)
    share = cv2.GaussianBlur(share, (0, 0), 2.5)
    return (frame + share[..., None] * (np.array([40.0, 150, 60]) - frame)).astype(np.uint8), share


def lamp(frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A frame whose light falls off from left to right, redder than before; and the gain of its light (h, w, 3)."""
    across = np.linspace(1.0, 0.3, frame.shape[1])[None, :, None] * np.array([1.0, 0.85, 0.7])
    gain = np.broadcast_to(across, frame.shape)
    return (frame * np.sqrt(gain)).astype(np.uint8), gain


@pytest.mark.parametrize("occluded", [False, True])
def test_light_is_found_with_and_without_an_occluder(
    appearance: Appearance, reference: np.ndarray, occluded: bool
) -> None:
    frame, gain = lamp(reference)
    if occluded:
        frame, _ = passer_by(frame)
    light = look(appearance, frame).light
    n = len(light.gain)
    found = cv2.warpPerspective(
        light.gain, from_corners(UNIT * n - 0.5, SCENE.quad), (640, 480), borderMode=cv2.BORDER_REPLICATE
    )
    clear = inside(SCENE.quad) & (passer_by(reference)[1] == 0)
    error = np.abs(np.sqrt(found[clear]) / np.sqrt(gain[clear]) - 1)
    assert np.median(error) < 0.03
    assert np.quantile(error, 0.95) < 0.1


def test_a_reflection_is_light_that_is_added(appearance: Appearance, reference: np.ndarray) -> None:
    y, x = np.mgrid[:480, :640]
    spot = 0.3 * np.exp(-0.5 * (((x - 360) / 50.0) ** 2 + ((y - 230) / 40.0) ** 2))
    frame = np.clip(255 * np.sqrt((reference / 255.0) ** 2 + spot[..., None]), 0, 255).astype(np.uint8)
    conditions = look(appearance, frame)
    assert conditions.light.gloss.max() == pytest.approx(0.3, abs=0.12)
    gloss = conditions.light.gloss
    at = np.array(np.unravel_index(gloss.argmax(), gloss.shape)) / len(gloss)
    assert at == pytest.approx((0.5, 0.69), abs=0.16)
    assert hidden(conditions).sum() == 0


def test_an_occluder_is_cut_out_at_its_edge(appearance: Appearance, reference: np.ndarray) -> None:
    frame, share = passer_by(lamp(reference)[0])
    found = hidden(look(appearance, frame))[inside(SCENE.quad)]
    true = share[inside(SCENE.quad)]
    overlap = np.minimum(found, true).sum() / np.maximum(found, true).sum()
    assert overlap > 0.9
    assert np.abs(found - true).mean() < 0.02


def hand(frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A frame with three fingers before the surface, lit from one side, and how much they take of each pixel (h, w)."""
    share = np.zeros(frame.shape[:2], np.float32)
    for x, y in ((300, 250), (330, 220), (360, 240)):
        cv2.line(share, (x + 20, 470), (x, y), 1.0, 24, cv2.LINE_AA)
    share = cv2.GaussianBlur(share, (0, 0), 1.5)
    across = np.linspace(0.8, 1.1, frame.shape[1])[None, :, None]
    return (frame + share[..., None] * (np.array([196.0, 146, 122]) * across - frame)).astype(np.uint8), share


@pytest.mark.parametrize("deviation", [0.3, 4.0])
def test_a_hand_is_kept_in_front_however_well_the_pose_is_known(
    appearance: Appearance, reference: np.ndarray, deviation: float
) -> None:
    frame, share = hand(lamp(reference)[0])
    there = inside(SCENE.quad)
    found = hidden(appearance.see(frame, SCENE.quad, deviation))
    assert found[there & (share > 0.95)].mean() > 0.95
    near = cv2.dilate(share, np.ones((25, 25))) > 0.02
    assert found[there & ~near].mean() < 0.01


def test_what_covers_it_all_hides_it_all(appearance: Appearance, reference: np.ndarray) -> None:
    cloth = np.full_like(reference, (150, 40, 50))
    core = cv2.erode(inside(SCENE.quad).astype(np.uint8), np.ones((9, 9))) > 0
    assert hidden(appearance.see(cloth, SCENE.quad, 0.3))[core].mean() > 0.95


def _brighter(frame: np.ndarray) -> np.ndarray:
    return np.clip(frame * 1.25, 0, 255).astype(np.uint8)


def _in_shadow(frame: np.ndarray) -> np.ndarray:
    """A shadow's soft edge runs over the surface."""
    shade = np.ones(frame.shape[:2], np.float32)
    cv2.fillPoly(shade, [np.array([[0, 0], [300, 0], [360, 480], [0, 480]])], 0.6)
    return (frame * cv2.GaussianBlur(shade, (0, 0), 6)[..., None]).astype(np.uint8)


def _blurred(frame: np.ndarray) -> np.ndarray:
    return cv2.blur(frame, (13, 1))


def _beside(frame: np.ndarray) -> np.ndarray:
    return cv2.warpAffine(frame, np.array([[1, 0, 0.5], [0, 1, -0.5]]), (640, 480), borderMode=cv2.BORDER_REPLICATE)


def _noisy(frame: np.ndarray) -> np.ndarray:
    return np.clip(frame + np.random.default_rng(1).normal(0, 8, frame.shape), 0, 255).astype(np.uint8)


def _black(frame: np.ndarray) -> np.ndarray:
    return np.zeros_like(frame)


@pytest.mark.parametrize("change", [_brighter, _in_shadow, _blurred, _beside, _noisy])
def test_what_is_no_occluder_hides_nothing(appearance: Appearance, reference: np.ndarray, change: object) -> None:
    frame = change(reference)  # type: ignore[operator]
    for _ in range(4):
        assert hidden(appearance.see(frame, SCENE.quad, 0.3)).sum() == 0


def test_blur_is_found_along_its_direction(appearance: Appearance, reference: np.ndarray) -> None:
    assert (look(appearance, reference).blur == 0).all()
    blur = look(appearance, cv2.GaussianBlur(reference, (0, 0), sigmaX=5, sigmaY=0.1)).blur
    assert blur[0, 0] == pytest.approx(25, rel=0.4)
    assert abs(blur[1, 1]) < 0.15 * blur[0, 0]


def test_blur_is_not_measured_where_the_surface_is_not_well_known(
    appearance: Appearance, reference: np.ndarray
) -> None:
    assert (look(appearance, cv2.blur(reference, (17, 1)), deviation=np.inf).blur == 0).all()


def test_the_light_follows_a_lamp_that_goes_out_at_once(appearance: Appearance, reference: np.ndarray) -> None:
    look(appearance, reference)
    gain = np.sqrt(appearance.see((reference * 0.5).astype(np.uint8), SCENE.quad, 0.3).light.gain)
    assert gain.mean() == pytest.approx(0.5, abs=0.03)


def test_the_last_light_stays_where_nothing_can_be_told(appearance: Appearance, reference: np.ndarray) -> None:
    lit = look(appearance, passer_by(lamp(reference)[0])[0])
    last = appearance.last()
    assert last.occluder is None
    assert (last.blur == 0).all()
    ratio = last.light.resized(*lit.light.gain.shape[:2]).gain / lit.light.gain
    assert np.median(np.abs(ratio - 1)) < 0.01  # without the edges of shadows, which move on
    for pose in (SCENE.quad + 2000, SCENE.quad[[0, 2, 1, 3]]):  # out of the frame, no quad
        np.testing.assert_array_equal(appearance.see(reference, pose, 0.3).light.gain, last.light.gain)


def test_exposure_leaves_usual_frames_alone(reference: np.ndarray) -> None:
    assert exposure(reference) == pytest.approx(1, abs=0.1)
    noisy = _noisy((reference * 0.3).astype(np.uint8))
    assert np.sqrt(exposure(noisy)) == pytest.approx(0.3 * np.sqrt(exposure(reference)), abs=0.03)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("change", [_black, _brighter, _blurred])
@pytest.mark.parametrize(
    "quad",
    [
        SCENE.quad,
        moved(SCENE.quad, scale=0.05),
        moved(SCENE.quad, scale=0.009),
        moved(SCENE.quad, shift=(-260, -150)),
        moved(SCENE.quad, scale=4),
    ],
)
@pytest.mark.parametrize("blank", [False, True])
def test_hard_cases_give_numbers(reference: np.ndarray, matte: Matte, quad: Array, change: object, blank: bool) -> None:
    still = np.full_like(reference, 120) if blank else reference
    for first, second in ((still, change(still)), (change(still), still)):  # type: ignore[operator]
        appearance = Appearance(first, SCENE.quad, matte)
        for frame in (first, second):
            conditions = appearance.see(frame, quad, 1.0)
            assert np.isfinite(conditions.light.gain).all()
            assert np.isfinite(conditions.light.gloss).all()
            assert np.isfinite(conditions.blur).all()
            assert np.isfinite(hidden(conditions)).all()


# ---- drawing ----


@pytest.fixture(scope="module")
def ad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("ad") / "ad.png"
    cv2.imwrite(str(file), np.full((120, 160, 3), (30, 60, 200), np.uint8))  # BGR: red
    return file


RED = np.array([200.0, 60, 30])


def draw(ad: Path, frame: np.ndarray, conditions: Conditions | None, **options: object) -> np.ndarray:
    drawn = frame.copy()
    surface = Surface(ad, **options)  # type: ignore[arg-type]
    with CvCompositor() as compositor, Painter(surface, SCENE.quad, (640, 480), compositor) as painter:
        painter.draw(drawn, SCENE.quad, 1.0, Fraction(0), conditions)
    return drawn.astype(np.float64)


def test_an_ad_is_in_the_light_and_behind_the_occluder(appearance: Appearance, reference: np.ndarray, ad: Path) -> None:
    lit, gain = lamp(reference)
    frame, share = passer_by(lit)
    drawn = draw(ad, frame, look(appearance, frame))
    weight = share[..., None]
    ideal = np.sqrt(gain) * RED * (1 - weight) + weight * np.array([40.0, 150, 60])
    core = cv2.erode(inside(SCENE.quad).astype(np.uint8), np.ones((7, 7))) > 0
    error = np.abs(drawn - ideal)[core]
    assert np.median(error) < 4
    assert np.quantile(error, 0.98) < 25
    outside = cv2.dilate(inside(SCENE.quad).astype(np.uint8), np.ones((7, 7))) == 0
    assert np.abs(drawn - frame)[outside].max() <= 1


def test_usual_conditions_change_nothing(appearance: Appearance, reference: np.ndarray, ad: Path) -> None:
    usual = Conditions(as_it_was(), None, np.zeros((2, 2)))
    seen = inside(SCENE.quad).astype(np.uint8)
    edge = cv2.morphologyEx(seen, cv2.MORPH_GRADIENT, np.ones((5, 5))) > 0  # without what the old surface spilt there
    changed = (draw(ad, reference, usual) != draw(ad, reference, None)).any(2)
    assert not changed[~edge].any()


def test_blur_softens_the_ad_and_its_edge(reference: np.ndarray, ad: Path) -> None:
    frame = np.full_like(reference, 20)
    blurred = draw(ad, frame, Conditions(as_it_was(), None, np.diag([36.0, 0])))
    row = blurred[230, 150:260, 0]
    assert np.count_nonzero((row > 30) & (row < 190)) > 8  # six px of deviation, sideways
    column = blurred[100:200, 320, 0]
    assert np.count_nonzero((column > 30) & (column < 190)) <= 3
    assert blurred[230, 320] == pytest.approx(RED, abs=1)


def test_an_ad_with_alpha_lets_the_scene_through(reference: np.ndarray, appearance: Appearance, tmp_path: Path) -> None:
    picture = np.full((120, 160, 4), (30, 60, 200, 255), np.uint8)
    picture[:, 80:, 3] = 0
    cv2.imwrite(str(tmp_path / "half.png"), picture)
    frame, _ = passer_by(lamp(reference)[0])
    for blur in (np.zeros((2, 2)), np.diag([9.0, 9])):
        drawn = draw(tmp_path / "half.png", frame, replace(look(appearance, frame), blur=blur))
        assert np.abs(drawn - frame)[200:260, 350:420].max() <= 1
        assert drawn[230, 310, 0] > 2 * drawn[230, 310, 1]


@pytest.mark.parametrize("fit", ["contain", "cover"])
def test_light_stays_in_its_place_whatever_part_of_the_ad_is_shown(
    appearance: Appearance, reference: np.ndarray, tmp_path: Path, fit: str
) -> None:
    cv2.imwrite(str(tmp_path / "wide.png"), np.full((60, 400, 3), (30, 60, 200), np.uint8))
    frame, gain = lamp(reference)
    drawn = draw(tmp_path / "wide.png", frame, look(appearance, frame), fit=fit)
    for x in (230, 320, 400):
        assert drawn[236, x] == pytest.approx(np.sqrt(gain[236, x]) * RED, rel=0.06)


def _track(file: Path, frames: int) -> Track:
    corners = np.repeat(SCENE.quad[None], frames, 0)
    times = [Fraction(i, 25) for i in range(frames)]
    source = Source(str(file), 640, 480, Fraction(25), frames)
    return Track(source, 0, SCENE.quad, times, corners, ["tracked"] * frames, np.ones(frames), np.full(frames, 0.3))


@pytest.mark.parametrize("frames", [1, 4])
@pytest.mark.parametrize("flat", [False, True])
def test_a_video_end_to_end(reference: np.ndarray, ad: Path, tmp_path: Path, frames: int, flat: bool) -> None:
    lit, gain = lamp(reference)
    seen, _ = passer_by(lit)
    clip = make_clip(tmp_path / "in.mp4", [reference, *[seen] * (frames - 1)], rate=25)
    surface = Surface(ad, track=_track(clip, frames), flat=flat)
    ar_demo.replace(clip, surface, tmp_path / "out.mp4", options=OutputOptions(backend="opencv", crf=5))
    with VideoReader(tmp_path / "out.mp4") as reader:
        last = [frame.image for frame in reader.frames()][-1].astype(np.float64)
    assert last[230, 320] == pytest.approx(RED if flat or frames == 1 else np.sqrt(gain[230, 320]) * RED, abs=12)
    if frames > 1:
        assert last[280, 250] == pytest.approx(RED if flat else [40, 150, 60], abs=12)


def test_a_surface_that_looks_as_before_is_not_compared_anew(reference: np.ndarray, matte: Matte) -> None:
    """But now and then; and at once where something comes before it, or the light changes."""
    asked: list[int] = []

    class Counted(Matte):
        def __call__(self, *crops: np.ndarray | None) -> np.ndarray:
            asked.append(len(asked))
            return matte(*crops)  # type: ignore[arg-type]

    appearance = Appearance(reference, SCENE.quad, Counted(matte.function, ""), softness=False)
    rng = np.random.default_rng(0)

    def noisy(frame: np.ndarray) -> np.ndarray:
        return np.clip(frame + rng.normal(0, 3, frame.shape), 0, 255).astype(np.uint8)

    for _ in range(REST.after_frames):
        compared = appearance.see(noisy(reference), SCENE.quad, 0.3)
    assert len(asked) == REST.after_frames
    for _ in range(2 * (REST.most_frames + 1)):
        resting = appearance.see(noisy(reference), SCENE.quad, 0.3)
        assert resting.light.differs(compared.light) < 0.02
        assert resting.grain is not None
    assert len(asked) == REST.after_frames + 2
    assert hidden(appearance.see(noisy(passer_by(reference)[0]), SCENE.quad, 0.3)).any()
    for _ in range(REST.after_frames):
        appearance.see(noisy(reference), SCENE.quad, 0.3)
    count = len(asked)
    appearance.see(noisy((reference * 0.9).astype(np.uint8)), SCENE.quad, 0.3)
    assert len(asked) == count + 1


@pytest.mark.parametrize("colour", [(40, 170, 60), (12, 12, 14), (120, 120, 120)])
def test_before_a_blank_surface_colour_tells_what_is_in_front(matte: Matte, colour: tuple[int, int, int]) -> None:
    rng = np.random.default_rng(1)
    quad = np.array([[90.0, 60], [330, 70], [320, 240], [100, 230]])
    plate = cv2.GaussianBlur(rng.integers(0, 255, (300, 420, 3)).astype(np.uint8), (0, 0), 3)
    cv2.fillConvexPoly(plate, quad.round().astype(int), colour)
    inside, hand = np.zeros(plate.shape[:2], np.uint8), np.zeros(plate.shape[:2], np.uint8)
    cv2.fillConvexPoly(inside, quad.round().astype(int), 1)
    cv2.circle(hand, (220, 150), 40, 1, -1)
    cv2.line(hand, (220, 150), (260, 299), 1, 34)

    def noisy(image: np.ndarray) -> np.ndarray:
        return np.clip(image + rng.normal(0, 2.5, image.shape), 0, 255).astype(np.uint8)

    appearance = Appearance(noisy(plate), quad, matte, softness=False)
    assert appearance.is_blank
    shaded = plate * np.where(np.arange(420) < 200, 0.6, 1.0)[None, :, None]
    assert look(appearance, noisy(shaded), quad).occluder is None
    for skin in ((200, 150, 120), (110, 75, 60), (235, 200, 180)):
        appearance.forget()
        occluder = look(appearance, noisy(np.where(hand[..., None] > 0, skin, plate)), quad).occluder
        assert occluder is not None
        share = np.zeros(plate.shape[:2], np.float32)
        share[occluder.box] = occluder.share[..., 0]
        found, true = (share > 0.5) & (inside > 0), (hand > 0) & (inside > 0)
        assert (found & true).sum() / (found | true).sum() > 0.97


def test_a_print_is_not_blank(appearance: Appearance) -> None:
    assert not appearance.is_blank
