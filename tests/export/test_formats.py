"""Every format, read back by a reader of its own, gives the track's corners; and is, to the letter, what it was."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from ar_demo.choices import CHOICES
from ar_demo.errors import InputError
from ar_demo.export import formats
from ar_demo.export.exporting import ExportOptions, export_track
from ar_demo.export.formats import Exporter, choose, exporters
from ar_demo.export.keys import Keys, keys_of
from hdn.imaging.arrays import Array

from . import parsers
from .tracks import FRAMES, LOST, QUAD, TRACKS, make

GOLDEN = Path(__file__).with_name("golden")
Parser = Callable[[str, int, int], dict[int, Array]]
PARSERS: dict[str, Parser] = {
    "nuke": parsers.nuke,
    "nuke-tracker": partial(parsers.nuke, node="Tracker4"),
    "nuke-stabilize": parsers.nuke,
    "ae": parsers.after_effects,
    "ae-power-pin": parsers.after_effects,
    "ae-script": parsers.after_effects_script,
    "fusion": parsers.fusion,
    "blender": parsers.blender,
    "csv": parsers.table,
    "json": parsers.track_file,
    "otio": parsers.timeline,
}
PRECISION = 0.01  # px


def exported(keys: Keys, name: str) -> str:
    if name == "otio":
        pytest.importorskip("opentimelineio")
    return exporters()[name].write(keys)


def test_all_formats_are_tried() -> None:
    assert tuple(PARSERS) == CHOICES["format"]


@pytest.mark.parametrize("lost", ["hold", "omit"])
@pytest.mark.parametrize("kind", TRACKS)
@pytest.mark.parametrize("name", PARSERS)
def test_what_is_read_back_is_the_track(name: str, kind: str, lost: str) -> None:
    track, first = TRACKS[kind](), 0 if name == "json" else 1001
    text = exported(keys_of(track, first, (640, 360), lost), name)  # type: ignore[arg-type]
    found = PARSERS[name](text, track.source.width, track.source.height)
    known = {index for index in range(FRAMES) if track.known[index]}
    held = set(range(FRAMES)) if lost == "hold" and name != "json" else known
    assert set(found) == {first + index for index in held}
    for index in known:
        assert np.abs(found[first + index] - track.corners[index]).max() < PRECISION
    for index in held - known:
        before = max(other for other in known if other < index)
        assert np.abs(found[first + index] - track.corners[before]).max() < PRECISION


@pytest.mark.parametrize("name", sorted(PARSERS.keys() - {"json"}))  # its homographies are not the same to the last bit
def test_it_is_as_the_golden_file_has_it(name: str) -> None:
    if name == "otio":
        pytest.importorskip("opentimelineio")
    assert small(name) == (GOLDEN / f"{name}.txt").read_text()


def small(name: str) -> str:
    """Three frames, the second of which is lost."""
    exporter, corners = exporters()[name], np.stack([QUAD, np.full((4, 2), np.nan), QUAD * 1.25])
    text = exporter.write(keys_of(make(corners, cuts=(2,)), exporter.first_frame, (64, 36)))
    # Blender's clip is named where it is, which is elsewhere on each machine.
    return re.sub(r'^CLIP = ".*/', 'CLIP = "/', text, flags=re.M)


@pytest.mark.parametrize("name", sorted(PARSERS.keys() - {"json", "ae", "ae-power-pin", "otio"}))
def test_lost_frames_are_marked_in_a_comment(name: str) -> None:
    text = exported(keys_of(TRACKS["lost"](), 10), name)
    assert "frames 13 to 14: lost, held at the corners before" in text
    assert f"frame {10 + LOST[-1]}: lost" in text
    assert "frame 15: another shot begins" in exported(keys_of(TRACKS["cut"](), 10), name)


def test_an_image_sequence_says_its_first_number(tmp_path: Path) -> None:
    track = TRACKS["moving"]()
    track.source = replace(track.source, first_number=1001)
    export_track(track, [tmp_path / "a.nk", tmp_path / "a.csv"])
    assert "{curve x1001 " in (tmp_path / "a.nk").read_text()
    assert "from frame 1001 on" in (tmp_path / "a.csv").read_text()
    export_track(track, [tmp_path / "b.nk"], options=ExportOptions(first_frame=1))
    assert "{curve x1 " in (tmp_path / "b.nk").read_text()


def test_a_label_stays_short() -> None:
    track = make(np.repeat(QUAD[None], 60, 0), cuts=tuple(range(1, 51)))
    text = exported(keys_of(track, 1), "nuke")
    assert parsers.nuke_nodes(text)["CornerPin2D"]["label"].count("\\n") == 8
    assert 'another shot begins\\nand 42 more"' in text
    assert text.count("# frame ") == 50


def test_a_timeline_marks_lost_frames() -> None:
    io = pytest.importorskip("opentimelineio")
    made = io.adapters.read_from_string(exported(keys_of(TRACKS["lost"](), 10), "otio"), "otio_json")
    [clip] = made.find_clips()
    assert [(m.name, m.marked_range.start_time.value, m.marked_range.duration.value) for m in clip.markers] == [
        ("lost", 13, 2),
        ("lost", 18, 1),
    ]
    assert clip.source_range.start_time.value == 10
    assert clip.source_range.duration.value == FRAMES


def test_the_insert_has_its_own_size() -> None:
    keys = keys_of(TRACKS["moving"](), 1, (640, 360))
    knobs = parsers.nuke_nodes(exported(keys, "nuke"))["CornerPin2D"]
    assert [knobs[f"from{n}"] for n in range(1, 5)] == [["0", "0"], ["640", "0"], ["640", "360"], ["0", "360"]]
    assert "\tSource Width\t640\n" in exported(keys, "ae")
    usual = parsers.nuke_nodes(exported(keys_of(TRACKS["moving"](), 1), "nuke"))["CornerPin2D"]
    assert usual["from3"] == ["320", "240"]


def test_stabilising_holds_the_reference_frame() -> None:
    knobs = parsers.nuke_nodes(exported(keys_of(TRACKS["moving"](), 1), "nuke-stabilize"))["CornerPin2D"]
    assert knobs["invert"] == "true"
    bottom_left = np.array([float(v) for v in knobs["from1"]])  # type: ignore[attr-defined]
    np.testing.assert_allclose(bottom_left, [QUAD[3, 0] + 0.5, 240 - 0.5 - QUAD[3, 1]], atol=PRECISION)


def test_a_script_lays_the_layer_at_the_origin_and_holds_at_cuts() -> None:
    done = parsers.run_in_node(exported(keys_of(TRACKS["cut"](), 0), "ae-script"), 320, 240)
    assert done["place"] == {
        "ADBE Anchor Point": [0, 0],
        "ADBE Position": [0, 0],
        "ADBE Scale": [100, 100],
        "ADBE Rotate Z": 0,
    }
    assert set(map(tuple, done["holds"].values())) == {(5,)}  # the fifth key is the last before the cut
    assert (done["told"], done["undo"], done["parent"]) == ([], 0, None)


@pytest.mark.parametrize(
    ("width", "layers", "told"), [(320, 0, "Select the layer"), (320, 2, "Select"), (99, 1, "size")]
)
def test_a_script_says_what_it_needs(width: int, layers: int, told: str) -> None:
    done = parsers.run_in_node(exported(keys_of(TRACKS["moving"](), 0), "ae-script"), width, 240, layers)
    assert told in str(done["told"])
    assert done["keys"]["ADBE Corner Pin-0001"] == []


def test_frames_before_the_surface_is_found_take_its_first_corners() -> None:
    corners = np.stack([np.full((4, 2), np.nan), QUAD])
    np.testing.assert_array_equal(keys_of(make(corners), 0).corners, [QUAD, QUAD])
    with pytest.raises(InputError, match="lost in every frame"):
        keys_of(make(corners[:1]), 0)


@pytest.mark.parametrize(
    "video", ["a\nimport os\r.mp4", 'a"}\\.mp4', "%s%(name)s.mp4", "\udcff\u2028.mp4", "плакат 東.mp4"]
)
@pytest.mark.parametrize("name", PARSERS)
def test_names_of_videos_are_names_alone(tmp_path: Path, name: str, video: str) -> None:
    track = TRACKS["moving"]()
    track.source = replace(track.source, path=video)
    if name == "otio":
        pytest.importorskip("opentimelineio")
    file = tmp_path / f"t{exporters()[name].suffixes[0]}"
    export_track(track, [file], [name])
    text = file.read_text(encoding="utf-8")
    assert not any(line.startswith("import os") for line in text.splitlines()[:9] if name != "blender")
    found = PARSERS[name](text, 320, 240)
    assert np.abs(next(iter(found.values())) - track.corners[0]).max() < PRECISION


@pytest.mark.parametrize("lost", ["hold", "omit"])
def test_a_span_has_keys_alone(lost: str) -> None:
    keys = keys_of(TRACKS["lost"]().within(2, 6), 1001, None, lost)  # type: ignore[arg-type]
    assert keys.frames == ([1003, 1004, 1005, 1006, 1007] if lost == "hold" else [1003, 1006, 1007])
    assert keys.lost_runs == [(1004, 1005)]
    assert "frames 1003 to 1007 alone have keys" in keys.notes


@pytest.mark.parametrize(
    ("files", "named", "chosen"),
    [
        (["a.nk", "a.TXT", "a.jsx"], [], ["nuke", "ae", "ae-script"]),
        (["a.nk", "a.txt"], ["nuke-tracker"], ["nuke-tracker", "ae"]),
        (["a.csv", "a.txt", "b.nk"], ["ae-power-pin", "nuke-stabilize"], ["csv", "ae-power-pin", "nuke-stabilize"]),
        (["a.mocha"], ["nuke"], ["nuke"]),
        (["a"], ["csv"], ["csv"]),
    ],
)
def test_formats_are_chosen(files: list[str], named: list[str], chosen: list[str]) -> None:
    assert [exporter.name for exporter in choose([Path(f) for f in files], named)] == chosen


@pytest.mark.parametrize(
    ("files", "named", "message"),
    [
        (["a.xyz"], [], "a.xyz: no format is known by its ending"),
        (["a"], [], "no format"),
        (["a.nk"], ["maya"], "format 'maya' is unknown: choose nuke, "),
        (["a.nk", "b.csv"], ["ae"], "format ae is for .txt, and no file ends so"),
    ],
)
def test_refuses_formats_that_do_not_fit(files: list[str], named: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        choose([Path(f) for f in files], named)


@pytest.mark.parametrize(
    ("file", "options", "message"),
    [
        ("t.json", ExportOptions(first_frame=1), "first_frame makes no difference to format json"),
        ("t.setting", ExportOptions(size=(8, 8)), "size makes no difference to format fusion"),
    ],
)
def test_refuses_options_that_do_nothing(tmp_path: Path, file: str, options: ExportOptions, message: str) -> None:
    with pytest.raises(InputError, match=message):
        export_track(TRACKS["moving"](), [tmp_path / file], options=options)
    assert not list(tmp_path.iterdir())


def test_a_variable_frame_rate_is_told_where_keys_have_no_times(
    tmp_path: Path,
) -> None:
    track = TRACKS["moving"]()
    track.times = [time * (1 + index % 3) for index, time in enumerate(track.times)]
    track.times.sort()
    assert export_track(track, [tmp_path / "a.jsx", tmp_path / "a.csv"]) == []
    [warning] = export_track(track, [tmp_path / "a.csv", tmp_path / "a.nk"])
    assert "frame rate varies, and keys in a.nk" in warning


def test_other_packages_add_formats(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    points = [
        EntryPoint(name, f"{__name__}:{name}", formats.GROUP) for name in ("SHAKE", "ANOTHER_NUKE", "NONE", "GONE")
    ]
    monkeypatch.setattr(formats, "entry_points", lambda group: points)
    exporters.cache_clear()
    try:
        [exporter] = choose([Path("a.shk")])
    finally:
        exporters.cache_clear()
    assert exporter is SHAKE
    assert [text in caplog.text for text in ("called nuke as another", "is no ar_demo.Exporter", "cannot be loaded")]


SHAKE = Exporter("shake", (".shk",), lambda keys: str(keys.frames))
ANOTHER_NUKE = Exporter("nuke", (".nk",), lambda keys: "")
NONE = "no exporter"


if __name__ == "__main__":  # writes the golden files
    for made in PARSERS.keys() - {"json"}:
        (GOLDEN / f"{made}.txt").write_text(small(made))
