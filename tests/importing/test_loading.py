"""Corners of other programs become tracks with the times of the video that they are used on."""

import json
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo import Session, Surface
from ar_demo.cli import entry
from ar_demo.errors import InputError
from ar_demo.export.exporting import ExportOptions, export_track
from ar_demo.importing.loading import load_track
from ar_demo.media.sequences import ImageSequence
from ar_demo.tracks import Track

from .. import clips
from ..conftest import Run
from ..export.tracks import FRAMES, LOST, QUAD, TRACKS

FILES = {"nuke": "t.nk", "ae": "t.txt", "ae-power-pin": "t.txt", "csv": "t.csv"}


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As many frames as the tracks have, at uneven times."""
    times = [Fraction(index * index + 20 * index, 600) for index in range(FRAMES)]
    images = clips.numbered(FRAMES, 320, 240)
    return clips.make_clip(tmp_path_factory.mktemp("video") / "v.mp4", images, times=times, time_base=Fraction(1, 600))


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Upright 240x320, stored on its side."""
    images = [np.ascontiguousarray(np.rot90(image)) for image in clips.numbered(FRAMES, 240, 320)]
    return clips.make_clip(tmp_path_factory.mktemp("video") / "t.mp4", images, rate=30, rotation=270)


def exported(folder: Path, kind: str, name: str, **options: object) -> Path:
    file = folder / FILES[name]
    export_track(TRACKS[kind](), [file], [name], ExportOptions(**options))  # type: ignore[arg-type]
    return file


@pytest.mark.parametrize("kind", ["moving", "turned", "cut"])
@pytest.mark.parametrize("name", FILES)
def test_what_is_exported_comes_back(tmp_path: Path, video: Path, turned: Path, name: str, kind: str) -> None:
    used = turned if kind == "turned" else video
    found = load_track(exported(tmp_path, kind, name), used)
    assert np.abs(found.corners - TRACKS[kind]().corners).max() < 0.01
    assert found.states == ["tracked"] * FRAMES
    with Session(used) as session:
        assert found.times == session.reader.times
        assert session.track([Surface(track=found)])[0].track is found
    assert found.warnings == []


@pytest.mark.parametrize("name", ["nuke", "csv"])
def test_files_of_ours_say_what_their_first_frame_is(tmp_path: Path, video: Path, name: str) -> None:
    found = load_track(exported(tmp_path, "moving", name, first_frame=1001), video)
    assert np.abs(found.corners - TRACKS["moving"]().corners).max() < 0.01


def test_another_first_frame_is_said(tmp_path: Path, video: Path) -> None:
    file = exported(tmp_path, "moving", "ae", first_frame=1001)
    with pytest.raises(InputError, match=r"keys from frame 1001 to 1009, and .* 0 to 8: .*--first-frame"):
        load_track(file, video)
    assert len(load_track(file, video, 1001)) == FRAMES
    shifted = load_track(file, video, 1003)
    assert "2 frames that v.mp4 does not have" in shifted.warnings[0]
    assert shifted.states[-2:] == ["lost", "lost"]


def test_a_layer_of_another_size_lies_in_the_middle(tmp_path: Path, video: Path) -> None:
    found = load_track(exported(tmp_path, "moving", "ae", size=(100, 60)), video)
    assert np.abs(found.corners - TRACKS["moving"]().corners).max() < 0.01


@pytest.mark.parametrize("lost_keys", ["hold", "omit"])
def test_a_table_keeps_what_is_lost(tmp_path: Path, video: Path, lost_keys: str) -> None:
    found = load_track(exported(tmp_path, "lost", "csv", lost_keys=lost_keys), video)
    assert [index for index, state in enumerate(found.states) if state == "lost"] == list(LOST)
    assert np.isnan(found.corners[list(LOST)]).all()


@pytest.mark.parametrize("name", ["nuke", "ae"])
def test_frames_without_a_key_are_on_a_line_and_told(tmp_path: Path, video: Path, name: str) -> None:
    found = load_track(exported(tmp_path, "lost", name, lost_keys="omit"), video)
    assert found.states == [*["tracked"] * 3, "held", "held", *["tracked"] * 3, "lost"]
    np.testing.assert_allclose(found.corners[3], (2 * found.corners[2] + found.corners[5]) / 3, atol=1e-3)
    assert "no key at 2 frames" in found.warnings[0]


# As Nuke 13 saves a node: letters that set the interpolation, frames that count on by themselves, points that stay.
OF_NUKE = """set cut_paste_input [stack 0]
version 13.2 v4
push $cut_paste_input
CornerPin2D {
 inputs 0
 to1 {{curve i x1001 10.5 20.5 30.5} {curve L x1001 9.5}}
 to2 {210.5 {curve K x1001 9.5 x1003 11.5}}
 to3 {210.5 109.5}
 to4 {{curve x1001 10.5 s0 x1002 20.5 t0 x1003 30.5} 109.5}
 to_matrix {{1 0 0 0}}
 invert false
 from1 {0 0}
 name CornerPin2D1
}
Blur { size 3 }
"""


def test_reads_what_nuke_writes(tmp_path: Path, video: Path) -> None:
    (tmp_path / "n.nk").write_text(OF_NUKE)
    found = load_track(tmp_path / "n.nk", video, 1001)
    np.testing.assert_allclose(found.corners[1], [[20, 130], [210, 130], [210, 229], [20, 230]])
    assert found.counts == {"tracked": 3, "held": 0, "lost": FRAMES - 3}


# As Mocha and After Effects write it: other versions, carriage returns, more effects, scientific numbers.
def of_after_effects(line: str = "\n") -> str:
    names = {1: "10.5\t20.5", 2: "110.5\t2.05e1", 3: "10.5\t90.5", 4: "110.5\t90.5"}
    pins = [
        f"Effects\tCorner Pin #2\tADBE Corner Pin-000{n}\n\tFrame\tX pixels\tY pixels\n\t0\t{v}"
        for n, v in names.items()
    ]
    head = "\tUnits Per Second\t25\n\tSource Width\t320\n\tSource Height\t240"
    blur = "Effects\tBlur #1\tBlurriness #2\n\tFrame\tfraction\n\t0\t5"
    parts = [
        "Adobe After Effects 9.0 Keyframe Data",
        head,
        blur,
        *pins,
        "Transform\tPosition\n\t0\t1\t2\t3",
        "End of Keyframe Data",
    ]
    return "\n\n".join(parts).replace("\n", line)


@pytest.mark.parametrize("line", ["\n", "\r\n"])
def test_reads_what_after_effects_writes(tmp_path: Path, video: Path, line: str) -> None:
    (tmp_path / "a.txt").write_bytes(of_after_effects(line).encode("utf-8-sig"))
    found = load_track(tmp_path / "a.txt", video)
    np.testing.assert_allclose(found.corners[0], [[10, 20], [110, 20], [110, 90], [10, 90]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (OF_NUKE.replace("invert false", "invert true"), "inverted"),
        (OF_NUKE.replace(" to3 {210.5 109.5}\n", ""), "no to3"),
        (OF_NUKE.replace("{210.5 109.5}", "{210.5 {parent.Tracker1.y}}"), "bake expressions"),
        (OF_NUKE.replace("{210.5 109.5}", "{{frame*2} 109.5}"), "bake expressions"),
        (OF_NUKE[:200], "not whole"),
        (OF_NUKE.replace("x1003 30.5", "x1e12 30.5"), "no video's"),
        (OF_NUKE.replace("x1003 11.5", "xx 11.5"), "no curve"),
        ("CornerPin2D {\n to1 {0 0}\n to2 {9 0}\n to3 {9 9}\n to4 {0 9}\n}", "does not move"),
        (of_after_effects().replace("-0004", "-0009"), "no Corner Pin"),
        (of_after_effects().replace("2.05e1", "wide"), "'wide' is no number"),
        ("frame,x1,y1,x2,y2,x3,y3,x4,y4\n0,1,2,3,4,5,6,7,eight", "row 1"),
        ("frame,x1,y1,x2,y2,x3,y3,x4,y4\n0,1,2,3,4,5,6,7,", "no row"),
        ("frame,x1,y1,x2,y2,x3,y3,x4,y4\n0,0,0,9,9,9,0,0,9", "cross"),
        (of_after_effects().replace("\t0\t10.5\t20.5", "\tat\t10.5"), "no Corner Pin"),
        (of_after_effects().replace("2.05e1", "inf"), "'inf' is no number"),
        (OF_NUKE.replace("20.5 30.5", "20.5 1e999"), "no curve"),
        ("frame,x1,y1\n0,1,2", "not a track file"),
        ("Tracker4 {\n}", "not a track file"),
        ("", "not a track file"),
    ],
)
def test_refuses_what_it_cannot_read(tmp_path: Path, video: Path, text: str, message: str) -> None:
    (tmp_path / "bad.nk").write_text(text)
    with pytest.raises(InputError, match=message) as error:
        load_track(tmp_path / "bad.nk", video, 1001 if "1001" in text else None)
    assert "bad.nk" in str(error.value)
    assert "\n" not in str(error.value)


def test_bytes_are_refused(tmp_path: Path, video: Path) -> None:
    (tmp_path / "t.nk").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a track file"):
        load_track(tmp_path / "t.nk", video)


def test_quads_that_cross_are_lost(tmp_path: Path, video: Path) -> None:
    rows = ["0,0,0,90,0,90,90,0,90", "1,0,0,90,90,90,0,0,90"]
    (tmp_path / "t.csv").write_text("frame,x1,y1,x2,y2,x3,y3,x4,y4\n" + "\n".join(rows))
    found = load_track(tmp_path / "t.csv", video)
    assert found.states[:2] == ["tracked", "lost"]
    assert "cross or lie on a line at 1 frame" in found.warnings[0]


def test_the_clearest_frame_inside_the_picture_is_the_reference(tmp_path: Path, video: Path) -> None:
    quads = [QUAD * 0.5, QUAD * 1.2, QUAD * 2]
    rows = [",".join(map(str, [index, *quad.ravel()])) for index, quad in enumerate(quads)]
    (tmp_path / "t.csv").write_text("frame,x1,y1,x2,y2,x3,y3,x4,y4\n" + "\n".join(rows))
    assert load_track(tmp_path / "t.csv", video).reference_frame == 1


def test_commands_and_jobs_take_them(run: Run, tmp_path: Path, video: Path) -> None:
    file = exported(tmp_path, "moving", "ae", first_frame=5)
    code, _, err = run(video, "--track", file, "--first-frame", 5, "-o", tmp_path / "t.json", main=entry.track_main)
    assert code == 0, err
    made = Track.load(tmp_path / "t.json")
    assert np.abs(made.corners - TRACKS["moving"]().corners).max() < 0.01
    job = {
        "version": 1,
        "surfaces": [{"effect": "outline", "track": file.name, "first_frame": 5}],
        "rendering": {"backend": "opencv"},
    }
    (tmp_path / "job.json").write_text(json.dumps(job))
    code, out, err = run(video, "--job", tmp_path / "job.json", "-o", tmp_path / "o.mp4", "--json")
    assert code == 0, err
    assert json.loads(out)["states"]["tracked"] == FRAMES
    code, _, err = run(video, "--effect", "blur", "--track", tmp_path / "t.json", "--first-frame", 5)
    assert code == 2
    assert "counts from 0" in err


def test_a_table_may_be_loosely_written(tmp_path: Path, video: Path) -> None:
    text = "\n# mine\n\n frame , x1, y1,x2 ,y2,x3,y3,x4,y4, note\n\n1, 0,0, 90,0, 90,90, 0,90, corner\n\n"
    (tmp_path / "t.csv").write_text(text)
    assert load_track(tmp_path / "t.csv", video).states[:3] == ["lost", "tracked", "lost"]


def test_an_image_sequence_is_numbered_as_its_files(tmp_path: Path) -> None:
    for index, image in enumerate(clips.numbered(FRAMES, 320, 240)):
        cv2.imwrite(str(tmp_path / f"p.{1001 + index}.png"), image)
    pictures = ImageSequence.find(tmp_path / "p.%04d.png", Fraction(24))
    file = tmp_path / "t.txt"
    export_track(TRACKS["moving"](), [file], options=ExportOptions(first_frame=1001))
    found = load_track(file, pictures)
    assert np.abs(found.corners - TRACKS["moving"]().corners).max() < 0.01
    assert found.source.first_number == 1001
    found.save(tmp_path / "t.json")
    assert Track.load(tmp_path / "t.json").source == found.source
