"""Tracking between known poses, by a tracker whose every word is known."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

import ar_demo
from ar_demo.options import TrackingOptions
from ar_demo.progress import Progress
from ar_demo.session import Session
from ar_demo.surface import Keyframe, Moment, Span, Surface
from ar_demo.tracks import Track
from hdn import Observation
from hdn.errors import InputError
from hdn.evidence import Evidence
from hdn.imaging.arrays import Array
from hdn.imaging.homography import transform
from hdn.imaging.regions import EVERYWHERE, Region
from hdn.state import State
from hdn.tracker import Estimate

from ..clips import Image, make_clip
from ..scenes import texture

WIDTH, HEIGHT, FRAMES = 128, 96, 60
RIGHT = np.array([1.0, 0])
QUAD = np.array([[20.0, 20], [80, 22], [78, 70], [22, 68]])


def numbered(number: int, view: Image) -> Image:
    """A view with a number (0..255) in it."""
    image = view.copy()
    for bit in range(8):
        image[:8, 16 * bit : 16 * bit + 16] = 255 * (number >> bit & 1)
    return image


def number_of(image: Image) -> int:
    return sum(1 << bit for bit in range(8) if image[4, 16 * bit + 8, 1] > 127)


def truth(index: int) -> Array:
    return QUAD + np.array([0.5 * index, 3 * np.sin(index / 9)])


@dataclass
class World:
    """What there is to see: elsewhere than in these frames the surface is seen at once.

    Attributes:
        hidden: frames in which it cannot be found; faint: in which it can be by one who knew where it was before.
        bias: px by which the tracker is off along x, by frame.
        seen: frames that were tracked, in their order.
        regions: where trackers were told to look.
    """

    hidden: set[int] = field(default_factory=set)
    faint: set[int] = field(default_factory=set)
    bias: Callable[[int], float] = lambda index: 0.0
    seen: list[int] = field(default_factory=list)
    regions: list[Region] = field(default_factory=list)


class Scripted:
    """A tracker of that world, which holds for three frames."""

    def __init__(self, world: World) -> None:
        self.world = world

    def init(self, frame: Image | Observation, quad: Array, region: Region = EVERYWHERE) -> None:
        self.quad = quad
        self.world.regions.append(region)
        self.shift = quad - truth(number_of(frame.image if isinstance(frame, Observation) else frame))
        self.place(np.eye(3))

    def place(self, homography: Array) -> None:
        self.corners, self.missed = transform(homography, self.quad), 0

    def lose(self) -> None:
        self.missed = 3

    def track(self, frame: Observation) -> Estimate:
        index = number_of(frame.image)
        self.world.seen.append(index)
        found = index not in self.world.hidden and (index not in self.world.faint or self.missed == 0)
        state: State = "tracked"
        if found:
            self.corners, self.missed = truth(index) + self.shift + [self.world.bias(index), 0], 0
        else:
            self.missed += 1
            state = "held" if self.missed <= 3 else "lost"
        confidence, deviation = (0.9, 0.3) if found else (0.2, np.inf)
        return Estimate(
            np.eye(3), self.corners.copy(), state, confidence, deviation, np.ones((8, 8), np.float32), Evidence()
        )


class Distracted(Scripted):
    """From the reference frame on it follows what moves on in front of the surface, 4 px a frame, up to frame 20."""

    follows = False

    def place(self, homography: Array) -> None:
        super().place(homography)
        self.follows = False

    def track(self, frame: Observation) -> Estimate:
        index = number_of(frame.image)
        self.follows = index == 0 or (self.follows and index <= 20)
        follows = self.follows
        self.world.bias = lambda index: 4.0 * index if follows else 0.0
        return super().track(frame)


AS_MEASURED = TrackingOptions(smooth=0)


@pytest.fixture
def world() -> World:
    return World()


def track(clip: Path, surface: Surface, world: World) -> Track:
    """The track as measured by a tracker of that world."""
    return ar_demo.track(clip, surface, AS_MEASURED, make_tracker=lambda: Scripted(world))


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    view = texture(1, WIDTH, HEIGHT)
    return make_clip(tmp_path_factory.mktemp("clip") / "a.mp4", [numbered(i, view) for i in range(FRAMES)], rate=30)


@pytest.fixture(scope="module")
def cut_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another shot from frame 20 to 39."""
    views = [texture(1, WIDTH, HEIGHT), 255 - texture(5, WIDTH, HEIGHT)]
    images = [numbered(i, views[20 <= i < 40]) for i in range(FRAMES)]
    return make_clip(tmp_path_factory.mktemp("clip") / "cut.mp4", images, rate=30)


def keyframe(index: int, corners: Array) -> Keyframe:
    return Keyframe(Moment(frame=index), corners)


def off(track: Track) -> Array:
    """(N,) distance from the truth, px."""
    return np.abs(track.corners - [truth(i) for i in range(len(track))]).max((1, 2))


@pytest.mark.parametrize("start", [0, 25, FRAMES - 1])
def test_plain_tracking_goes_both_ways_once(world: World, clip: Path, start: int) -> None:
    found = track(clip, Surface(quad=truth(start), start=Moment(frame=start)), world)
    assert found.counts == {"tracked": FRAMES, "held": 0, "lost": 0}
    assert off(found).max() < 1e-4
    assert sorted(world.seen) == sorted([*range(FRAMES), *([start] if start else [])])
    assert found.keyframes == {}


@pytest.mark.parametrize("start", [0, 59])
def test_a_gap_is_filled_from_its_other_end(world: World, clip: Path, start: int) -> None:
    """The surface comes back faint: only who comes from where it is clear can follow it there."""
    forward = start == 0
    world.hidden = set(range(20, 30))
    world.faint = set(range(30, 45)) if forward else set(range(5, 20))
    found = track(clip, Surface(quad=truth(start), start=Moment(frame=start)), world)
    assert off(found)[sorted(world.faint)].max() < 0.1
    assert all(found.states[i] == "tracked" for i in world.faint)
    assert {found.states[i] for i in range(20, 30)} == {"held"}  # bridged from both ends
    assert off(found)[20:30].max() < 0.5


def test_of_two_ways_the_one_that_leads_to_the_reference_frame_is_right(world: World, clip: Path) -> None:
    """The tracker follows something in front at first, loses it, and finds the surface, which may be as wrong."""
    world.hidden = {21, 22, 23}
    found = ar_demo.track(clip, Surface(quad=QUAD), AS_MEASURED, make_tracker=lambda: Distracted(world))
    assert off(found).max() < 0.3
    assert found.counts["lost"] == 0


def test_held_frames_are_led_from_fix_to_fix(world: World, clip: Path) -> None:
    world.hidden = {20, 21, 22}
    found = track(clip, Surface(quad=QUAD), world)
    assert [found.states[i] for i in (19, 20, 22, 23)] == ["tracked", "held", "held", "tracked"]
    assert off(found).max() < 0.2  # a straight line along a slight bend
    assert np.abs(truth(22) - truth(19)).max() > 1


def test_a_keyframe_mends_a_slip(world: World, clip: Path) -> None:
    """The tracker slips, more and more, up to a frame where somebody corrects it, and is right from there on."""
    world.bias = lambda i: 0.3 * (i - 10) if 10 <= i <= 30 else 0.0
    given = keyframe(30, truth(30))
    found = track(clip, Surface(quad=QUAD, keyframes=(given,)), world)
    np.testing.assert_allclose(found.corners[30], truth(30), atol=0.1)
    assert found.deviation[30] == pytest.approx(2, abs=0.3)  # a hand's
    assert off(found)[:31].max() < 2.1 < 6 == world.bias(30)  # what is linear in it is gone
    assert off(found)[31 + 30 :].max(initial=0) < 1e-4
    assert found.keyframes.keys() == {30}
    np.testing.assert_array_equal(found.corners[0], QUAD)


def test_a_correction_is_spread_linearly(world: World, clip: Path) -> None:
    """A person who sees everything 8 px further right at a keyframe moves all between, the less the farther."""
    found = track(clip, Surface(quad=QUAD, keyframes=(keyframe(40, truth(40) + 8 * RIGHT),)), world)
    shift = (found.corners - [truth(i) for i in range(FRAMES)])[..., 0].mean(1)
    np.testing.assert_allclose(shift[:41], np.arange(41) / 5, atol=0.5)
    assert np.abs(np.diff(shift[40:])).max() < 0.2  # and does not jump afterwards


def test_a_keyframe_mends_a_finished_track_where_its_error_arose(world: World, clip: Path) -> None:
    """The tracker slips at frame 30, and says nothing of it: a keyframe at 40 leaves the frames before as they are."""
    world.bias = lambda i: 15.0 if 30 <= i < 50 else 0.0
    old = track(clip, Surface(quad=QUAD), world)
    assert off(old)[30:50].max() > 10
    new = track(clip, Surface(track=old, keyframes=(keyframe(40, truth(40)),)), world)
    assert off(new)[30:50].max() < 1
    assert (off(new)[:30] < off(old)[:30] + 0.05).all()
    assert any("contradicts" in warning for warning in new.warnings)


def test_keyframes_lead_over_what_the_tracker_cannot_see(world: World, clip: Path) -> None:
    world.hidden = set(range(22, 40)) - {31}
    found = track(clip, Surface(quad=QUAD, keyframes=(keyframe(25, truth(25)), keyframe(28, truth(28)))), world)
    assert off(found)[19:29].max() < 0.2
    assert found.states[23:29] == ["held"] * 6
    assert off(found)[25] < 0.15 < found.deviation[25] < 2.1
    assert off(found)[31] < 0.1


@pytest.mark.parametrize("start", [0, 30, 59])
def test_a_keyframe_may_come_before_or_after_the_reference_frame(world: World, clip: Path, start: int) -> None:
    given = tuple(keyframe(i, truth(i) + 2) for i in (5, 45))
    found = track(clip, Surface(quad=truth(start), start=Moment(frame=start), keyframes=given), world)
    np.testing.assert_allclose(found.corners[start], truth(start), atol=1e-4)
    assert found.counts["tracked"] == FRAMES
    assert off(found).max() < 0.1
    assert found.keyframes.keys() == found.used.keys() == {5, 45}


def test_retracks_only_between_the_neighbours_of_what_changed(world: World, clip: Path, tmp_path: Path) -> None:
    kept = (keyframe(20, truth(20)), keyframe(40, truth(40)))
    track(clip, Surface(quad=QUAD, keyframes=kept), world).save(tmp_path / "t.json")
    old = Track.load(tmp_path / "t.json")
    old.corners[10], old.corners[50] = old.corners[10] + 7, old.corners[50] - 7  # as somebody edited it
    world.seen.clear()
    new = track(clip, Surface(track=old, keyframes=(keyframe(31, truth(31) + 8 * RIGHT),)), world)
    assert set(world.seen) == set(range(20, 41))
    untouched = [*range(20), *range(41, FRAMES)]
    np.testing.assert_array_equal(new.corners[untouched], old.corners[untouched])
    np.testing.assert_allclose(new.corners[31], truth(31) + 8 * RIGHT, atol=0.1)
    assert 4 < off(new)[28] < 8
    assert new.keyframes.keys() == {20, 31, 40}
    assert 31 not in old.keyframes


def test_a_keyframe_edited_in_the_file_is_new(world: World, clip: Path) -> None:
    old = track(clip, Surface(quad=QUAD, keyframes=(keyframe(20, truth(20)), keyframe(40, truth(40)))), world)
    world.seen.clear()
    assert track(clip, Surface(track=old), world) is old
    assert world.seen == []
    old.keyframes[40] = truth(40) + 2
    new = track(clip, Surface(track=old), world)
    assert set(world.seen) == set(range(20, FRAMES))
    np.testing.assert_array_equal(new.used[40], truth(40) + 2)
    assert new.counts["tracked"] == FRAMES
    assert off(new).max() < 0.1  # for a hand may err so much
    world.seen.clear()
    assert track(clip, Surface(track=new), world) is new
    assert world.seen == []


@pytest.mark.parametrize("backward", [False, True])
def test_a_cut_loses_at_once(world: World, cut_clip: Path, backward: bool) -> None:
    world.hidden = set(range(20, 40))
    start = FRAMES - 1 if backward else 0
    found = track(cut_clip, Surface(quad=truth(start), start=Moment(frame=start)), world)
    assert found.cuts == [20, 40]
    assert found.states == ["tracked"] * 20 + ["lost"] * 20 + ["tracked"] * 20
    assert np.isnan(found.corners[20:40]).all()


def test_several_surfaces_share_one_pass(world: World, clip: Path) -> None:
    other = QUAD * 0.5 + 30
    surfaces = [Surface(quad=QUAD), Surface(quad=truth(30) + 2, start=Moment(frame=30)), Surface(quad=other)]
    events: list[Progress] = []
    with Session(clip, events.append, lambda: Scripted(world)) as session:
        tracks = [s.track for s in session.track(surfaces, AS_MEASURED) if s.track is not None]
    assert [t.counts["tracked"] for t in tracks] == [FRAMES] * 3
    assert [t.reference_frame for t in tracks] == [0, 30, 0]
    assert off(tracks[0]).max() < 1e-4
    assert [event.stage for event in events].count("track") == FRAMES
    assert [event.stage for event in events].count("track back") == 31


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([keyframe(0, QUAD)], "quad itself"),
        ([keyframe(90, QUAD)], "beyond the end"),
        ([keyframe(9, QUAD), Keyframe.parse("0.3s:20,20,80,22,78,70,22,68")], "two keyframes"),
        ([keyframe(9, QUAD[::-1])], "another order"),
        ([keyframe(9, QUAD[[0, 2, 1, 3]])], "another order"),
    ],
)
def test_refuses_keyframes_that_cannot_be(world: World, clip: Path, given: list[Keyframe], message: str) -> None:
    with pytest.raises(InputError, match=message):
        track(clip, Surface(quad=QUAD, keyframes=tuple(given)), world)
    known = track(clip, Surface(quad=QUAD), world)
    with pytest.raises(InputError, match=message):
        track(clip, Surface(track=known, keyframes=tuple(given)), world)


def test_every_tracker_is_told_where_to_look_and_the_track_remembers(world: World, clip: Path) -> None:
    region = np.array([[5.0, 5], [100, 5], [60, 90]])
    surface = Surface(quad=QUAD, region=region, exclude=(QUAD[:3],))
    found = track(clip, surface, world)
    again = track(clip, Surface(track=found, keyframes=(keyframe(40, truth(40) + 1),)), world)
    assert len(world.regions) == 2
    for told in (*world.regions, found.region, again.region):
        np.testing.assert_array_equal(told.include, region)
        np.testing.assert_array_equal(told.exclude, [QUAD[:3]])


@pytest.mark.parametrize("start", [None, 20, 35])
def test_a_span_alone_is_tracked(world: World, clip: Path, start: int | None) -> None:
    world.hidden = set(range(24, 30))
    at = 15 if start is None else start
    moment = {} if start is None else {"start": Moment(frame=start)}
    options = TrackingOptions(smooth=0, time=Span.parse("0.5s..40"))
    found = ar_demo.track(
        clip,
        Surface(quad=truth(at), **moment),
        options,
        make_tracker=lambda: Scripted(world),  # type: ignore[arg-type]
    )
    assert set(world.seen) == set(range(15, 41))
    assert (found.span, len(found), found.reference_frame) == ((15, 40), 41, at)
    assert found.counts == {"tracked": 20, "held": 6, "lost": 0}
    assert off(found)[15:].max() < 0.5
    assert not found.known[:15].any()
    assert found.warnings == []  # what is not looked at is nothing to warn of


@pytest.mark.parametrize(
    ("surface", "time", "message"),
    [
        ({"start": Moment(frame=3)}, "10..20", "start .frame 3. is before the time"),
        ({"start": Moment(frame=30)}, "10..20", "beyond the end"),
        ({"keyframes": (keyframe(5, QUAD),)}, "10..", "keyframe .frame 5. is before the time"),
        ({}, "9s..", "time .9 s. is beyond the end"),
        ({}, "20..10", "beyond the end"),
    ],
)
def test_what_is_named_lies_in_the_span(
    world: World, clip: Path, surface: dict[str, object], time: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        ar_demo.track(
            clip,
            Surface(quad=QUAD, **surface),  # type: ignore[arg-type]
            TrackingOptions(time=Span.parse(time)),
            make_tracker=lambda: Scripted(world),
        )
    assert world.seen == []


def test_a_keyframe_corrects_a_track_of_a_span(world: World, clip: Path) -> None:
    world.bias = lambda i: 15.0 if 15 <= i < 25 else 0.0
    options = TrackingOptions(smooth=0, time=Span.parse("10..40"))
    surface = Surface(quad=truth(30), start=Moment(frame=30))
    old = ar_demo.track(clip, surface, options, make_tracker=lambda: Scripted(world))
    world.seen.clear()
    new = track(clip, Surface(track=old, keyframes=(keyframe(20, truth(20)),)), world)
    assert min(world.seen) == 10
    assert (new.span, off(new)[10:].max() < 1) == ((10, 40), True)
