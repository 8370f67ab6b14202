"""One video from opening to output: stopping, progress, trackers of one's own, tracks of other videos."""

import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from ar_demo import Keyframe, Moment, OutputOptions, Progress, Session, Stopped, Surface, TrackingOptions
from ar_demo.errors import InputError
from ar_demo.media.planes import samples
from ar_demo.media.reader import IndexDropped, VideoReader
from ar_demo.media.writer import VideoWriter
from ar_demo.tracking.passes import Passes
from hdn import Estimate, Observation
from hdn.evidence import Evidence
from hdn.imaging.arrays import Array
from hdn.imaging.homography import transform
from hdn.imaging.regions import EVERYWHERE, Region

from .clips import BT601, make_clip
from .scenes import Scene, error, path, texture

FRAMES = 16
OPENCV = OutputOptions(backend="opencv")


class Still:
    """A tracker that takes the surface for one that does not move."""

    def init(self, frame: Observation, quad: Array, region: Region = EVERYWHERE) -> None:
        self.quad = self.corners = quad

    def place(self, homography: Array) -> None:
        self.corners = transform(homography, self.quad)

    def lose(self) -> None: ...

    def track(self, frame: Observation) -> Estimate:
        return Estimate(np.eye(3), self.corners, "tracked", 1.0, 0.1, np.ones((8, 8), np.float32), Evidence())


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = Scene()
    images = [scene.draw(corners) for corners in path(scene.quad, FRAMES)]
    return make_clip(tmp_path_factory.mktemp("clip") / "a.mp4", images, rate=25)


@pytest.fixture(scope="module")
def ad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("ad") / "ad.png"
    cv2.imwrite(str(file), texture(2, 80, 60))
    return file


def test_a_tracker_of_ones_own(clip: Path, ad: Path, tmp_path: Path) -> None:
    with Session(clip, make_tracker=Still) as session:
        [surface] = session.track([Surface(ad, Scene().quad)])
        result = session.render([surface], tmp_path / "o.mp4", OPENCV)
    assert surface.track is not None
    np.testing.assert_allclose(surface.track.corners, np.repeat(Scene().quad[None], FRAMES, 0), atol=1e-6)
    assert (result.frames, result.states) == (FRAMES, {"tracked": FRAMES, "held": 0, "lost": 0})


def test_progress_tells_stage_states_and_frame(clip: Path, ad: Path, tmp_path: Path) -> None:
    seen: list[tuple[str, int, int | None, str | None, int | None]] = []
    shapes = set()

    def listen(event: Progress) -> None:
        assert event.preview is not None
        shapes.add(event.preview.shape)
        seen.append((event.stage, event.done, event.total, event.state, event.surface))

    with Session(clip, listen, Still) as session:
        surfaces = session.track([Surface(ad, Scene().quad), Surface(ad, Scene().quad + 2)])
        session.render(surfaces, tmp_path / "o.mp4", OPENCV)
    assert seen == [(s, i, FRAMES, "tracked", 0) for s in ("track", "render") for i in range(1, FRAMES + 1)]
    assert shapes == {(240, 320, 3)}


@pytest.mark.parametrize("stage", ["track", "render"])
def test_stops_from_another_thread_and_leaves_nothing(clip: Path, ad: Path, tmp_path: Path, stage: str) -> None:
    seen: list[str] = []
    before = set(threading.enumerate())

    def listen(event: Progress) -> None:
        seen.append(event.stage)
        if event.stage == stage and event.done == 3:
            thread = threading.Thread(target=session.stop)
            thread.start()
            thread.join()

    with Session(clip, listen, Still) as session:

        def work() -> None:
            session.render(session.track([Surface(ad, Scene().quad)]), tmp_path / "o.mp4", OPENCV)

        with pytest.raises(Stopped, match="stopped"):
            work()
        assert seen.count(stage) == 3
        assert list(tmp_path.iterdir()) == []
        session.listen = lambda event: None
        work()  # what was stopped may be begun again
    assert [p.name for p in tmp_path.iterdir()] == ["o.mp4"]
    assert set(threading.enumerate()) <= before


@dataclass
class Counting:
    """A listener that stops a session after so many frames of a stage, and counts all."""

    session: Session | None = None
    stage: str = ""
    frames: int = 0
    seen: list[str] = field(default_factory=list)

    def __call__(self, event: Progress) -> None:
        self.seen.append(event.stage)
        if event.stage == self.stage and self.seen.count(self.stage) == self.frames and self.session is not None:
            self.session.stop()


@pytest.mark.parametrize("stage", ["track", "track back"])
def test_tracking_that_was_stopped_goes_on_where_it_was(clip: Path, ad: Path, stage: str) -> None:
    def poster(**look: Any) -> Surface:
        return Surface(ad, Scene().quad, start=Moment(frame=4), **look)

    with Session(clip) as session:
        [whole] = session.track([poster()])
        before = set(threading.enumerate())
        session.listen = first = Counting(session, stage, 3)
        with pytest.raises(Stopped):
            session.track([poster()])
        session.listen = second = Counting()
        session.preview([poster()]).__exit__()
        [joined] = session.track([poster(opacity=0.5)])
        assert Counter(first.seen) + Counter(second.seen) == {"track": FRAMES - 4, "track back": 5}
        assert whole.track is not None
        assert joined.track is not None
        assert np.array_equal(whole.track.corners, joined.track.corners, equal_nan=True)
        assert joined.opacity == 0.5

        session.listen = Counting(session, stage, 3)
        with pytest.raises(Stopped):
            session.track([poster()])
        session.listen = anew = Counting()
        session.track([Surface(ad, Scene().quad + 1, start=Moment(frame=4))])
        assert anew.seen.count("track") == FRAMES - 4
        assert set(threading.enumerate()) <= before


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda images: [texture(i, 320, 240) for i in range(FRAMES)], "shows something else"),
        (lambda images: images[:-4], "shows something else"),
        (lambda images: [image[:200] for image in images], "320x240"),
    ],
)
def test_refuses_a_track_of_another_video(
    clip: Path, ad: Path, tmp_path: Path, make: Callable[[list[np.ndarray]], list[np.ndarray]], message: str
) -> None:
    scene = Scene()
    images = [scene.draw(corners) for corners in path(scene.quad, FRAMES)]
    other = make_clip(tmp_path / "other.mp4", make(images), rate=25)
    with Session(clip, make_tracker=Still) as session:
        [surface] = session.track([Surface(ad, scene.quad)])
    with Session(other) as session, pytest.raises(InputError, match=message):
        session.render([surface], tmp_path / "o.mp4", OPENCV)
    assert [p.name for p in tmp_path.iterdir()] == ["other.mp4"]


def test_a_track_is_of_its_video_in_another_container_too(clip: Path, ad: Path, tmp_path: Path) -> None:

    copy = tmp_path / "copy.mkv"
    with av.open(str(clip)) as source, av.open(str(copy), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(source.streams.video[0]):
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
    with Session(clip, make_tracker=Still) as session:
        [surface] = session.track([Surface(ad, Scene().quad)], TrackingOptions(smooth=0))
    with Session(copy) as session:
        assert session.render([surface], tmp_path / "o.mp4", OPENCV).frames == FRAMES


def test_a_surface_without_a_track_is_not_rendered(clip: Path, ad: Path, tmp_path: Path) -> None:
    with Session(clip) as session, pytest.raises(InputError, match="track it first"):
        session.render([Surface(ad, Scene().quad)], tmp_path / "o.mp4", OPENCV)
    assert list(tmp_path.iterdir()) == []


def test_a_source_of_10_bits_stays_so(ad: Path, tmp_path: Path) -> None:
    """A ramp that only 10 bits can show, with an ad in its middle."""
    ramp = np.linspace(4000, 60000, 960).astype(np.uint16)
    image = np.repeat(np.repeat(ramp[None, :, None], 240, 0), 3, 2)
    clip = tmp_path / "deep.mp4"
    with VideoWriter(clip, 960, 240, Fraction(25), codec="libx265", crf=4, depth=10) as writer:
        for index in range(4):
            writer.write(image, Fraction(index, 25))
    quad = np.array([[400.0, 60], [560, 62], [558, 180], [402, 178]])
    levels = {}
    for depth in ("8", "auto"):
        out = tmp_path / f"{depth}.mp4"
        with Session(clip, make_tracker=Still) as session:
            assert session.reader.info.depth == 10
            surfaces = session.track([Surface(ad, quad)])
            session.render(surfaces, out, OutputOptions(backend="opencv", codec="libx265", crf=4, depth=depth))  # type: ignore[arg-type]
        with VideoReader(out, depth=16) as reader:
            assert reader.info.depth == (8 if depth == "8" else 10)
            last = [frame.image for frame in reader.frames()][-1].astype(int)
        levels[depth] = len(np.unique(last[10, :, 1]))
        assert np.abs(last[10, :, 1] - ramp).max() < 900  # outside the ad the picture is the source's
        assert np.abs(last[100:140, 450:510].astype(int) - image[100:140, 450:510]).mean() > 3000
    assert levels["8"] < 260 < 600 < levels["auto"]


@pytest.mark.parametrize("depth", ["auto", "8", "source"])
def test_the_chroma_of_a_source_stays_where_that_is_asked_for(ad: Path, tmp_path: Path, depth: str) -> None:
    clip = tmp_path / "in.mp4"
    with VideoWriter(clip, 320, 240, Fraction(25), pixel_format="yuv422p") as writer:
        for index in range(3):
            writer.write(texture(3, 320, 240), Fraction(index, 25))
    with Session(clip, make_tracker=Still) as session:
        assert session.reader.info.pixel_format == "yuv422p"
        surfaces = session.track([Surface(ad, Scene().quad)])
        session.render(surfaces, tmp_path / "o.mp4", OutputOptions(backend="opencv", depth=depth))  # type: ignore[arg-type]
    with VideoReader(tmp_path / "o.mp4") as reader:
        assert reader.info.pixel_format == ("yuv422p" if depth == "source" else "yuv420p")


@pytest.mark.parametrize("rotation", [0, 90])
def test_what_the_ad_does_not_touch_is_the_sources(ad: Path, tmp_path: Path, rotation: int) -> None:
    clip = make_clip(tmp_path / "in.mp4", [texture(3, 320, 240)] * 2, rotation=rotation, matrix=BT601)
    with Session(clip, make_tracker=Still) as session:
        [surface] = session.track([Surface(ad, np.array([[90, 90], [150, 92], [150, 150], [88, 150]]), flat=True)])
        session.render([surface], tmp_path / "o.mkv", OutputOptions(backend="opencv", codec="ffv1"))
    with av.open(str(clip)) as source, av.open(str(tmp_path / "o.mkv")) as output:
        for before, after in zip(source.decode(video=0), output.decode(video=0), strict=True):
            assert after.colorspace == before.colorspace == 6
            was, is_ = np.rot90(samples(before, 0), rotation // 90), samples(after, 0)
            assert np.array_equal(was[:80], is_[:80])
            assert np.abs(was[100:140, 100:140].astype(int) - is_[100:140, 100:140]).mean() > 10


@pytest.mark.parametrize("method", ["track", "correct"])
def test_starts_over_where_frames_were_numbered_wrongly(
    clip: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    quad, tried, work = Scene().quad, [], getattr(Passes, method)

    def once_wrong(*arguments: object) -> object:
        tried.append(method)
        if len(tried) == 1:
            raise IndexDropped("frames were counted wrongly")
        return work(*arguments)

    with Session(clip, make_tracker=Still) as session:
        surface = Surface(quad=quad)
        if method == "correct":
            [tracked] = session.track([surface])
            surface = replace(tracked, keyframes=(Keyframe(Moment(frame=5), quad + 1),))
        monkeypatch.setattr(Passes, method, once_wrong)
        [found] = session.track([surface])
    assert len(tried) == 2
    assert found.track is not None
    assert found.track.counts["tracked"] == FRAMES


def test_warnings_say_which_of_several_surfaces_they_are_of(clip: Path, ad: Path, tmp_path: Path) -> None:
    with Session(clip, make_tracker=Still) as session:
        surfaces = session.track([Surface(ad, Scene().quad), Surface(ad, Scene().quad + 5)])
        tracks = [surface.track for surface in surfaces if surface.track is not None]
        tracks[0].warnings = ["damaged", "hidden", "blurred"]
        tracks[1].warnings = ["damaged", "hidden", "far off"]
        both = session.render(surfaces, tmp_path / "both.mp4", OPENCV).warnings
        one = session.render(surfaces[1:], tmp_path / "one.mp4", OPENCV).warnings
    assert both == ["damaged", "hidden", "surface 1: blurred", "surface 2: far off"]
    assert one == ["damaged", "hidden", "far off"]


def test_a_snapped_quad_is_that_of_the_track(clip: Path, caplog: pytest.LogCaptureFixture) -> None:
    given = Scene().quad + np.array([[1.5, 1], [-1, 1.5], [-1.5, 1], [1, -1]])
    surface = Surface(effect="blur", quad=given, snap=True)
    with Session(clip, make_tracker=Still) as session, caplog.at_level("INFO"):
        [tracked] = session.track([surface])
    assert tracked.track is not None
    assert error(tracked.track.quad, Scene().quad) < 0.6 < error(given, Scene().quad)
    np.testing.assert_allclose(tracked.track.corners[0], tracked.track.quad, atol=1e-3)
    moved = np.linalg.norm(tracked.track.quad - given, axis=1)
    assert f"--snap moved the corners by {', '.join(f'{px:.1f}' for px in moved)} px" in caplog.messages
