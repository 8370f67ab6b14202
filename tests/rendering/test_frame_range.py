"""`--frames`: parts of a video that are rendered by themselves, on one machine or on many."""

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo import OutputOptions, Session, Surface
from ar_demo.errors import InputError
from ar_demo.frame_range import FrameRange
from ar_demo.media.claims import Claim
from ar_demo.media.reader import VideoReader
from ar_demo.media.sequences import ImageSequence
from ar_demo.results import Result
from ar_demo.tracks import Source, Track

from ..clips import make_clip, tone
from ..conftest import Run
from ..scenes import Scene, path, texture
from ..videos import sound_codecs

FRAMES, RATE = 30, 25


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip with a tone, its track, the same as pictures, and an ad."""
    folder, scene = tmp_path_factory.mktemp("part"), Scene()
    truth = path(scene.quad, FRAMES)
    images = [scene.draw(corners) for corners in truth]
    make_clip(folder / "in.mp4", images, rate=RATE, sound=tone(FRAMES / RATE))
    (folder / "shot").mkdir()
    for number, image in enumerate(images, 1001):
        cv2.imwrite(str(folder / f"shot/a.{number}.png"), image[..., ::-1])
    cv2.imwrite(str(folder / "ad.png"), texture(2, 80, 60))
    source = Source("in.mp4", scene.width, scene.height, Fraction(RATE), FRAMES)
    times = [Fraction(i, RATE) for i in range(FRAMES)]
    states = ["tracked"] * 20 + ["held"] * 10
    Track(source, 0, truth[0], times, np.array(truth), states, np.ones(FRAMES), np.full(FRAMES, 0.1)).save(  # type: ignore[arg-type]
        folder / "t.json"
    )
    return folder


def render(folder: Path, output: Path, frames: str | None = None, source: object = None, **options: object) -> Result:
    kept = OutputOptions(
        backend="opencv",
        frames=None if frames is None else FrameRange.parse(frames),
        **options,  # type: ignore[arg-type]
    )
    with Session(source or folder / "in.mp4") as session:  # type: ignore[arg-type]
        return session.render([Surface(folder / "ad.png", track=Track.load(folder / "t.json"))], output, kept)


def pictures(folder: Path) -> dict[str, np.ndarray]:
    return {file.name: np.asarray(cv2.imread(str(file))) for file in sorted(folder.iterdir())}


def test_parts_make_the_same_sequence_as_the_whole(folder: Path, tmp_path: Path) -> None:
    for name in ("whole", "parts"):
        (tmp_path / name).mkdir()
    render(folder, tmp_path / "whole/o.%04d.png")
    results = [render(folder, tmp_path / "parts/o.%04d.png", frames) for frames in ("20-29", "0-9", "10-19")]
    assert [result.frames for result in results] == [10, 10, 10]
    assert [result.states["held"] for result in results] == [10, 0, 0]
    whole, parts = pictures(tmp_path / "whole"), pictures(tmp_path / "parts")
    assert list(whole) == list(parts) == [f"o.{n:04d}.png" for n in range(FRAMES)]
    for name, picture in whole.items():  # within the run-up all that is learnt from frame to frame is the same
        np.testing.assert_array_equal(picture, parts[name])


def test_what_is_before_the_run_up_hardly_shows(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ar_demo.rendering.loop.RUN_UP_FRAMES", 8)
    render(folder, tmp_path / "whole.%d.png")
    (tmp_path / "part").mkdir()
    render(folder, tmp_path / "part/whole.%d.png", "20-22")
    for name, picture in pictures(tmp_path / "part").items():
        assert cv2.PSNR(picture, cv2.imread(str(tmp_path / name))) > 50


@pytest.mark.parametrize(
    ("start", "frames", "expected"), [(1, "1-3", [1, 2, 3]), (None, "7", [7]), (1001, "1028-1040", [1028, 1029, 1030])]
)
def test_numbers_are_those_of_the_pictures(
    folder: Path, tmp_path: Path, start: int | None, frames: str, expected: list[int]
) -> None:
    render(folder, tmp_path / "o.%d.png", frames, start_number=start)
    assert sorted(int(file.name.split(".")[1]) for file in tmp_path.iterdir()) == expected


def test_pictures_keep_the_numbers_of_the_input(folder: Path, tmp_path: Path) -> None:
    shot = ImageSequence.find(folder / "shot", Fraction(RATE))
    render(folder, tmp_path / "o.%d.png", "1011-1012", shot)
    with VideoReader(folder / "in.mp4") as reader:
        [tenth] = reader.frames(10, 11)
    assert [file.name for file in sorted(tmp_path.iterdir())] == ["o.1011.png", "o.1012.png"]
    found = cv2.imread(str(tmp_path / "o.1011.png"))[..., ::-1]
    assert np.abs(found[:30].astype(int) - tenth.image[:30]).mean() < 4  # what is above the poster


def test_other_pictures_stay_and_the_same_are_refused(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "o.%d.png"
    render(folder, output, "0-1")
    render(folder, output, "2-3")
    with pytest.raises(InputError, match=r"o\.1\.png exists already"):
        render(folder, output, "1-2")
    render(folder, output, "1-2", overwrite=True)
    assert len(list(tmp_path.iterdir())) == 4


def test_several_machines_write_parts_of_one_sequence_at_the_same_time(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "o.%d.png"
    with Claim(output, share="0-4"):
        render(folder, output, "5-6")
        with pytest.raises(InputError, match="another run"):
            render(folder, output, "0-4")


def test_a_part_as_a_video_is_silent_and_begins_at_zero(folder: Path, tmp_path: Path) -> None:
    result = render(folder, tmp_path / "o.mp4", "10-14")
    assert result.frames == 5
    with VideoReader(tmp_path / "o.mp4") as part, VideoReader(folder / "in.mp4") as whole:
        assert part.times == [Fraction(i, RATE) for i in range(5)]
        for frame, before in zip(part.frames(), whole.frames(10), strict=False):
            assert np.abs(frame.image[:30].astype(int) - before.image[:30]).mean() < 4
    assert not sound_codecs(tmp_path / "o.mp4")


@pytest.mark.parametrize("text", ["", "3-1", "-4", "1..3", "1-", "a"])
def test_what_is_no_range_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="no range of frames"):
        FrameRange.parse(text)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--frames", "30-40"], "in.mp4 has no frame of 30-40: its frames are 0 to 29"),
        (["--frames", "0-4", "--audio", "mix"], "--audio is for sound, which a part of a video gets when it is joined"),
        (["--frames", "0-4", "--end", "3"], "do not go together"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(run: Run, folder: Path, arguments: list[str], message: str) -> None:
    options = ["--track", folder / "t.json", "-o", folder / "o.mp4"]
    code, out, err = run(folder / "in.mp4", folder / "ad.png", *options, *arguments, "--dry-run", "--quiet")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err


def test_a_surface_that_is_not_tracked_is_refused(run: Run, folder: Path) -> None:
    corners = ["--quad", *(f"{x},{y}" for x, y in Scene().quad)]
    code, _, err = run(folder / "in.mp4", folder / "ad.png", *corners, "--frames", "0-4", "--dry-run", "--quiet")
    assert code == 2
    assert "--frames renders from finished tracks" in err
