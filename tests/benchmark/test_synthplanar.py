"""SynthPlanar: is the truth true, do targets move as they should, and is a seed a promise?"""

import dataclasses
import json
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from hdn.benchmark.datasets import open_dataset
from hdn.benchmark.synthplanar.cli import Setting, generate, main
from hdn.benchmark.synthplanar.light import Focus
from hdn.benchmark.synthplanar.motion import HEIGHT, WIDTH, Ranges, Trajectory
from hdn.benchmark.synthplanar.pictures import Pictures
from hdn.benchmark.synthplanar.render import Renderer, Scene, visible_corners
from hdn.benchmark.synthplanar.scenes import APPEARANCE, CHALLENGES, CONTROLS, INTERRUPTED, make_scene
from hdn.benchmark.synthplanar.video import Clip
from hdn.errors import InputError, RunError
from hdn.imaging.arrays import Array, Image
from hdn.imaging.homography import from_corners, transform
from hdn.imaging.quads import area, square

SMALL = Setting(256, 144, 12)
DRAWN = Pictures(None)


def scene(attribute: str, seed: int = 0, width: int = 320, frames: int = 60) -> tuple[Scene, np.random.Generator]:
    rng = np.random.default_rng(seed)
    return make_scene(
        (CHALLENGES | INTERRUPTED | APPEARANCE)[attribute], width, width * 9 // 16, frames, DRAWN, rng
    ).scene, rng


def rectified(frame: Image, corners: Array, size: int = 96) -> Image:
    """The target, seen frontally, in grey."""
    matrix = from_corners(corners, square(size))
    return np.asarray(cv2.cvtColor(cv2.warpPerspective(frame, matrix, (size, size)), cv2.COLOR_RGB2GRAY), np.uint8)


def likeness(a: Image, b: Image) -> float:
    inner = slice(6, -6), slice(6, -6)
    return float(np.corrcoef(a[inner].ravel(), b[inner].ravel())[0, 1])


def read(path: Path) -> list[Image]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def paths(attribute: str, frames: int, count: int = 6) -> list[Array]:
    """The corners (frames, 4, 2) of several targets."""
    tracks = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        trajectory = Trajectory(CHALLENGES[attribute].ranges, float(rng.uniform(0.6, 1.6)), frames, rng)
        tracks.append(trajectory.corners(np.arange(float(frames))))
    return tracks


def test_speed_is_that_of_hand_held_video() -> None:
    tracks = [track for attribute in CHALLENGES for track in paths(attribute, 500)]
    motion = np.concatenate([np.linalg.norm(np.diff(t, axis=0), axis=2).ravel() for t in tracks])
    median, most, nearly_all = np.percentile(motion, [50, 90, 99])
    assert 7 < median < 9
    assert 21 < most < 27
    assert 55 < nearly_all < 75
    sizes = [np.sqrt([abs(area(quad)) for quad in track]) for track in tracks]
    assert 3 < np.median([s.max() / s.min() for s in sizes]) < 4.5


@pytest.mark.parametrize(("attribute", "least"), [("rotation", 150), ("unconstrained", 100)])
def test_targets_turn_past_a_right_angle(attribute: str, least: float) -> None:
    for track in paths(attribute, 300):
        edge = track[:, 1] - track[:, 0]
        turn = np.unwrap(np.arctan2(edge[:, 1], edge[:, 0]))
        assert np.rad2deg(np.ptp(turn)) > least


@pytest.mark.parametrize("attribute", CHALLENGES)
def test_only_some_targets_leave_the_frame_and_all_start_inside(attribute: str) -> None:
    for track in paths(attribute, 300):
        inside = ((track >= -0.5) & (track <= np.array([WIDTH, HEIGHT]) - 0.5)).all((1, 2))
        assert inside[0]
        if CHALLENGES[attribute].ranges.leaves:
            left = np.flatnonzero(~inside)
            assert len(left) > 20
            assert inside[left[0] :].any()  # and comes back
        else:
            assert inside.mean() > 0.9


def test_a_seed_is_one_path_whatever_the_frame_size() -> None:
    small, large = (visible_corners(scene("rotation", 3, width)[0], 5) for width in (320, 640))
    for a, b in zip(small, large, strict=True):
        assert a is not None
        assert b is not None
        # Texel counts are rounded, so that the aspect may differ by a little.
        np.testing.assert_allclose((a + 0.5) * 2, b + 0.5, atol=4)


@pytest.mark.parametrize("attribute", ["scale", "rotation", "perspective", "motion blur", "low light"])
def test_rectified_by_the_truth_all_frames_show_the_same(attribute: str) -> None:
    """Independent of how the frames are made: only pixels and corners are used."""
    shown, rng = scene(attribute, width=480)
    steady = dataclasses.replace(shown.light, ambient=1.0, glare=0.0, swing=0.0)  # what differs is to be geometry
    shown = dataclasses.replace(shown, light=steady)
    corners, renderer = visible_corners(shown, 60), Renderer(shown, 60, rng)
    first = corners[0]
    assert first is not None
    template = rectified(renderer.render(0).poster, first)
    right, wrong, shifts = [], [], []
    for index in range(6, 60, 9):
        frame, quad = renderer.render(index).poster, corners[index]
        assert quad is not None
        now = rectified(frame, quad)
        right.append(likeness(template, now))
        aside = quad + 0.03 * np.sqrt(abs(area(quad)))
        wrong.append(likeness(template, rectified(frame, aside)))
        window = np.outer(np.hanning(96), np.hanning(96)).astype(np.float32)
        shifts.append(cv2.phaseCorrelate(template.astype(np.float32), now.astype(np.float32), window)[0])
    assert np.median(right) > 0.94
    assert np.median(right) > np.median(wrong) + 0.02
    assert np.abs(np.median(shifts, 0)).max() < 0.25  # of 96 px


@pytest.mark.parametrize("attribute", ["rotation", "motion blur"])
def test_the_ad_fills_the_quad_and_nothing_else_changes(attribute: str) -> None:
    shown, rng = scene(attribute, 1)
    shown = dataclasses.replace(shown, shutter=0.05)  # the outline is to be sharp
    corners, renderer = visible_corners(shown, 60), Renderer(shown, 60, rng)
    for index in (0, 20, 40):
        rendered, quad = renderer.render(index), corners[index]
        assert quad is not None
        changed = (rendered.poster != rendered.ad).any(2)
        # Closed, for poster and ad may agree here and there.
        closed = cv2.morphologyEx(changed.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
        truth = np.zeros_like(closed)
        cv2.fillConvexPoly(truth, np.round(quad * 16).astype(np.int32), 1, shift=4)
        assert (closed & truth).sum() / (closed | truth).sum() > 0.9
        far = cv2.dilate(truth, np.ones((7, 7), np.uint8)) == 0
        assert not changed[far].any()


def test_visible_is_the_share_inside_the_frame() -> None:
    shown, rng = scene("out of view", 2, frames=300)
    renderer, corners = Renderer(shown, 300, rng), shown.trajectory.corners(np.arange(300.0))
    corners = (corners + 0.5) * (shown.width / WIDTH) - 0.5
    right, bottom = shown.width - 0.5, shown.height - 0.5
    frame = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]], np.float32)
    shares = [cv2.intersectConvexConvex(c.astype(np.float32), frame)[0] / abs(area(c)) for c in corners]
    cut = [index for index, share in enumerate(shares) if 0.1 < share < 0.9]
    assert len(cut) > 8
    for index in (0, *cut[:: len(cut) // 8]):
        assert renderer.render(index).visible == pytest.approx(shares[index], abs=0.04)


def test_corners_are_null_where_nothing_is_in_the_frame() -> None:
    ranges = Ranges(leaves=True, speed=2)
    shown, _ = scene("out of view")
    tracks = [Trajectory(ranges, 1.0, 300, np.random.default_rng(seed)) for seed in range(4)]
    for trajectory in tracks:
        known = visible_corners(dataclasses.replace(shown, trajectory=trajectory), 300)
        for quad, corners in zip(known, trajectory.corners(np.arange(300.0)) / 4, strict=True):
            beyond = (corners < -1).all(0) | (corners > np.array([320, 180])).all(0)  # roughly, on one side of it
            assert quad is None or not beyond.any()
            assert quad is not None or not ((corners > 0) & (corners < [319, 179])).all(1).any()
    assert any(quad is None for t in tracks for quad in visible_corners(dataclasses.replace(shown, trajectory=t), 300))


@pytest.mark.parametrize("seed", range(4))
def test_passers_by_hide_the_target_for_a_while_but_not_at_first(seed: int) -> None:
    shown, rng = scene("occlusion", seed, width=192, frames=90)
    renderer = Renderer(shown, 90, rng)
    visible = [renderer.render(index).visible for index in range(0, 90, 3)]
    assert visible[0] > 0.97
    assert min(visible) < 0.8
    assert visible[int(np.argmin(visible)) :][-1] > min(visible)


def surroundings_likeness(attribute: str, seed: int) -> float:
    """How alike the band around the target, rectified by the truth, is in the first frame and in free ones."""
    shown, rng = scene(attribute, seed, width=480)
    light = dataclasses.replace(shown.light, ambient=1.0, glare=0.0, swing=0.0)  # what differs is to be geometry
    shown = dataclasses.replace(shown, light=light, passages=())
    corners, renderer = visible_corners(shown, 60), Renderer(shown, 60, rng)
    around = cv2.copyMakeBorder(np.zeros((58, 58), np.uint8), *[19] * 4, cv2.BORDER_CONSTANT, value=1) > 0
    around[:6] = around[-6:] = around[:, :6] = around[:, -6:] = False
    larger = square(96) * 1.6 - square(96).mean() * 0.6
    views = []
    for index in (0, 25, 40, 55):
        quad = corners[index]
        assert quad is not None
        matrix = from_corners(transform(from_corners(square(96), quad), larger), square(96))
        grey = cv2.cvtColor(cv2.warpPerspective(renderer.render(index).poster, matrix, (96, 96)), cv2.COLOR_RGB2GRAY)
        views.append(grey[around])
    return float(np.median([np.corrcoef(views[0], view)[0, 1] for view in views[1:]]))


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("attribute", "coplanar"), [("wall", True), ("board", True), ("hands", False)])
def test_a_wall_and_a_board_move_with_the_target_and_a_street_does_not(
    attribute: str, coplanar: bool, seed: int
) -> None:
    assert (surroundings_likeness(attribute, seed) > 0.8) == coplanar


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("attribute", ["hands", "wall"])
def test_hands_reach_over_most_of_the_target_and_withdraw(attribute: str, seed: int) -> None:
    shown, rng = scene(attribute, seed, width=192, frames=70)
    renderer = Renderer(shown, 70, rng)
    visible = [renderer.render(index).visible for index in range(0, 70, 3)]
    assert visible[0] > 0.97
    assert 0.2 < min(visible) < 0.65
    assert max(visible[int(np.argmin(visible)) :]) > min(visible) + 0.2


@pytest.mark.parametrize("seed", range(4))
def test_an_absent_target_is_out_of_view_for_40_frames_of_120_and_comes_back(seed: int) -> None:
    shown, _ = scene("absence", seed, frames=120)
    known = np.array([quad is not None for quad in visible_corners(shown, 120)])
    gone = np.flatnonzero(~known)
    assert 40 <= len(gone) < 70
    assert (np.diff(gone) == 1).all()
    assert known[:25].all()
    assert known[-25:].all()
    steps = np.linalg.norm(np.diff(shown.trajectory.corners(np.arange(120.0)), axis=0), axis=2)
    assert steps.max() < 100  # it moves out; it does not jump


def test_a_hidden_target_s_corners_are_null(tmp_path: Path) -> None:
    truth = json.loads(generate(tmp_path, "hidden", 0, Setting(128, 72, 120), 120, 0, DRAWN).read_text())
    known = np.array([corners is not None for corners in truth["corners"]])
    assert 36 <= (~known).sum() < 70
    assert known[:20].all()
    assert known[-20:].all()
    assert (np.array(truth["visible"])[~known] == 0).all()
    assert min(np.array(truth["visible"])[known]) > 0


def test_a_long_exposure_blurs_by_motion() -> None:
    sharpness = []
    for shutter in (0.05, 1.0):
        shown, rng = scene("motion blur")
        shown = dataclasses.replace(shown, shutter=shutter, grain=0.0)
        steps = np.linalg.norm(np.diff(shown.trajectory.corners(np.arange(60.0)), axis=0), axis=2).mean(1)
        fastest = int(steps.argmax())
        quad = visible_corners(shown, 60)[fastest]
        assert quad is not None
        grey = rectified(Renderer(shown, 60, rng).render(fastest).poster, quad)
        sharpness.append(cv2.Laplacian(grey, cv2.CV_32F).var())
    assert sharpness[1] < 0.5 * sharpness[0]


@pytest.mark.parametrize(("attribute", "darkest", "brightest"), [("low light", 10, 75), ("scale", 60, 220)])
def test_light(attribute: str, darkest: float, brightest: float) -> None:
    shown, rng = scene(attribute, width=192)
    assert darkest < Renderer(shown, 60, rng).render(0).poster.mean() < brightest


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("attribute", "stays"), [("shadow", False), ("still shadow", True)])
def test_a_shadow_lies_on_the_target_in_the_first_frame_and_stays_only_where_it_shall(
    attribute: str, stays: bool, seed: int
) -> None:
    shown, rng = scene(attribute, seed)
    flat = [dataclasses.replace(shown.poster, levels=tuple(np.full_like(x, 255) for x in shown.poster.levels))] * 2
    shown = dataclasses.replace(shown, poster=flat[0], ad=flat[1], grain=0.0)
    corners, renderer = visible_corners(shown, 60), Renderer(shown, 60, rng)
    views = []
    for index in (0, 55):
        quad = corners[index]
        assert quad is not None
        views.append(rectified(renderer.render(index).ad, quad)[8:-8, 8:-8].astype(float))
    assert views[0].max() > 1.15 * views[0].min()
    assert (np.corrcoef(views[0].ravel(), views[1].ravel())[0, 1] > 0.9) == stays


@pytest.mark.parametrize("seed", range(2))
def test_a_lamp_is_mirrored_in_the_target_in_the_first_frame(seed: int) -> None:
    shown, _ = scene("still glare", seed)
    quad = visible_corners(shown, 60)[0]
    assert quad is not None
    dark = dataclasses.replace(shown, light=dataclasses.replace(shown.light, glare=0.0))
    with_lamp, without = (Renderer(s, 60, np.random.default_rng(1)).render(0).ad.astype(float) for s in (shown, dark))
    assert rectified(np.clip(with_lamp - without, 0, 255).astype(np.uint8), quad).max() > 20


def test_focus_comes_and_goes_and_keeps_the_light() -> None:
    focus, light = Focus(0.0, 9.0, 0.1, -np.pi / 2), np.zeros((41, 41, 3), np.float32)
    light[20, 20] = 100
    sharp, soft = focus.blur(light, 0.0, 0.5), focus.blur(light, np.pi / 0.1, 0.5)
    np.testing.assert_allclose(sharp, light, atol=1e-3)
    assert soft.sum() == pytest.approx(light.sum(), rel=1e-4)
    assert (soft[..., 0] > soft.max() / 2).sum() == pytest.approx(np.pi * 4.5**2, rel=0.1)  # a disc


def test_no_light_falls_on_a_screen() -> None:
    shown, _ = scene("screen", 1)
    shown = dataclasses.replace(shown, light=dataclasses.replace(shown.light, glare=0.0), grain=0.0)
    dark = dataclasses.replace(shown, light=dataclasses.replace(shown.light, exposure=0.2))
    quad = visible_corners(shown, 60)[0]
    assert quad is not None
    a, b = (Renderer(s, 60, np.random.default_rng(2)).render(0).poster for s in (shown, dark))
    inner = rectified(a, quad)[8:-8, 8:-8].astype(float), rectified(b, quad)[8:-8, 8:-8].astype(float)
    assert np.abs(inner[0] - inner[1]).max() <= 3
    assert b.mean() < 0.7 * a.mean()


def test_low_texture_has_little() -> None:
    def edges(attribute: str) -> float:
        picture = scene(attribute)[0].poster.levels[0]
        inner = np.ascontiguousarray(picture[48:-48, 48:-48, 1])
        return float(np.abs(cv2.Laplacian(inner, cv2.CV_32F)).mean())

    assert edges("low texture") < 0.25 * edges("scale")


def test_a_clip_that_is_broken_off_leaves_nothing(tmp_path: Path) -> None:
    def broken_off() -> None:
        with Clip(tmp_path / "clip.mp4", 64, 36, 23) as clip:
            clip.write(np.zeros((36, 64, 3), np.uint8))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken_off()
    assert not list(tmp_path.iterdir())


def test_where_no_file_can_be_written_it_is_said(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="cannot write"):
        Clip(tmp_path / "none" / "clip.mp4", 64, 36, 23)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("synthplanar")
    for attribute in ("unconstrained", "low light"):
        generate(folder, attribute, 0, SMALL, SMALL.frames, 5, DRAWN)
    return folder


def test_the_folder_is_a_data_set(made: Path) -> None:
    sequences = {s.name: s for s in open_dataset(str(made))}
    assert set(sequences) == {"unconstrained-01", "low-light-01"}  # and none of the ads'
    sequence = sequences["low-light-01"]
    assert sequence.attributes == ("low light",)
    assert sequence.truth.shape == (SMALL.frames, 4, 2)
    assert sum(1 for _ in sequence.frames()) == SMALL.frames
    np.testing.assert_array_equal(sequence.quad, sequence.truth[0])


def test_what_is_written_beside_a_clip(made: Path) -> None:
    truth = json.loads((made / "unconstrained-01.json").read_text())
    assert (truth["seed"], truth["version"], truth["attributes"]) == (5, 3, ["unconstrained"])
    assert len(truth["visible"]) == len(truth["corners"]) == SMALL.frames
    assert cv2.imread(str(made / truth["ad"]["image"])) is not None
    clip, ad_clip = read(made / "unconstrained-01.mp4"), read(made / truth["ad"]["clip"])
    assert len(clip) == len(ad_clip) == SMALL.frames
    inside = np.zeros((SMALL.height, SMALL.width), np.uint8)
    cv2.fillConvexPoly(inside, np.round(truth["quad"]).astype(np.int32), 1)
    difference = np.abs(clip[0].astype(int) - ad_clip[0]).mean(2)
    assert difference[inside > 0].mean() > 10
    assert difference[cv2.dilate(inside, np.ones((9, 9), np.uint8)) == 0].mean() < 4
    assert not list(made.rglob("*.part*"))


def test_clips_are_tagged_bt709(made: Path) -> None:
    with av.open(str(made / "low-light-01.mp4")) as container:
        stream = container.streams.video[0]
        context = stream.codec_context
        assert (stream.width, stream.height, stream.average_rate) == (SMALL.width, SMALL.height, 30)
        assert (context.colorspace, context.color_primaries, context.color_trc, context.color_range) == (1, 1, 1, 1)


def test_a_seed_makes_one_sequence_whatever_is_made_beside_it(made: Path, tmp_path: Path) -> None:
    again = generate(tmp_path, "low light", 0, SMALL, SMALL.frames, 5, DRAWN)
    assert again.read_text() == (made / again.name).read_text()
    for one, other in zip(read(tmp_path / "low-light-01.mp4"), read(made / "low-light-01.mp4"), strict=True):
        np.testing.assert_array_equal(one, other)
    different = generate(tmp_path, "low light", 0, SMALL, SMALL.frames, 6, DRAWN)
    assert different.read_text() != (made / again.name).read_text()


def test_command_line_with_textures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    noise = np.random.default_rng(0).integers(0, 255, (40, 60, 3), np.uint8)
    cv2.imwrite(str(photos / "one.png"), cv2.resize(noise, (300, 200)))
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as ended:
        main([str(out), "--attributes", "motion-blur", "--frames", "2", "--sequences", "2", "--textures", str(photos)])
    assert ended.value.code == 0
    assert sorted(p.name for p in out.glob("*.mp4")) == ["motion-blur-01.mp4", "motion-blur-02.mp4"]
    assert json.loads((out / "motion-blur-02.json").read_text())["texture"] == "one.png"
    assert len(capsys.readouterr().out.splitlines()) == 2


def test_a_switch_leaves_all_but_the_interrupted_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path), "--interrupted", "--frames", "2"])
    assert ended.value.code == 0
    names = [Path(line).stem for line in capsys.readouterr().out.splitlines()]
    assert names == [f"{name}-01" for name in ("wall", "board", "hands", "absence", "hidden")]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--attributes", "scale", "--interrupted"], "not allowed with"),
        (["--attributes", "speed"], "choose from scale, rotation"),
        (["--frames", "0"], "whole number from 1"),
        (["--setting", "huge"], "quick"),
        (["--textures", "{empty}"], "holds no images"),
        (["--textures", "{empty}/none"], "not a folder"),
    ],
)
def test_wrong_input_is_said_in_one_line(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    filled = [a.replace("{empty}", str(tmp_path / "empty")) for a in arguments]
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path / "out"), *filled])
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1
    assert not list(tmp_path.rglob("*.mp4"))


def test_a_texture_that_is_no_image_is_named(tmp_path: Path) -> None:
    (tmp_path / "broken.png").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"broken\.png cannot be read"):
        generate(tmp_path / "out", "scale", 0, SMALL, 2, 0, Pictures(tmp_path))


def test_of_the_controls_one_stands_still_and_one_moves() -> None:
    steps = {}
    for name, control in CONTROLS.items():
        corners = Trajectory(control.ranges, 1.3, 40, np.random.default_rng(3)).corners(np.arange(40.0))
        steps[name] = np.abs(np.diff(corners, axis=0)).max()
    assert steps["static"] < 1e-9
    assert 1 < steps["clean"] < 60
