"""The command lines end to end: what they make, what they refuse, what they leave behind."""

import json
import signal
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from ar_demo import Moment, OutputOptions, Surface, TrackingOptions, replace
from ar_demo.cli import commands, entry
from ar_demo.media.reader import VideoReader
from ar_demo.tracks import Track

from ..clips import SOUND_RATE, frame_times, make_clip, make_sound, read_sound, sound_packets, tone, truncated
from ..conftest import Run
from ..scenes import Scene, error, path

FRAMES = 24
LOST = range(10, 14)
START = 8


pytestmark = pytest.mark.usefixtures("shared_networks")


@pytest.fixture(scope="module")
def truth() -> list[np.ndarray]:
    return path(Scene().quad, FRAMES)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, truth: list[np.ndarray]) -> Path:
    """A poster on a wall, with a tone."""
    scene = Scene()
    images = [scene.draw(corners) for corners in truth]
    return make_clip(tmp_path_factory.mktemp("clip") / "street.mp4", images, rate=30, sound=tone(FRAMES / 30))


@pytest.fixture(scope="module")
def ad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plain red picture."""
    file = tmp_path_factory.mktemp("ad") / "ad.png"
    cv2.imwrite(str(file), np.full((60, 80, 3), (0, 0, 255), np.uint8))
    return file


def quad_arguments(quad: np.ndarray) -> list[str]:
    return ["--quad", *(f"{x},{y}" for x, y in quad)]


def redness(image: np.ndarray, corners: np.ndarray) -> float:
    """How red the middle of a quad is."""
    x, y = corners.mean(0).round().astype(int)
    patch = image[y - 4 : y + 5, x - 4 : x + 5].reshape(-1, 3).mean(0)
    return float(patch[0] - patch[1:].max())


def test_replaces_the_poster_in_every_frame(
    run: Run, clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path
) -> None:
    out = tmp_path / "out.mp4"
    code, printed, err = run(clip, ad, *quad_arguments(truth[0]), "-o", out, "--backend", "opencv", "--json")
    assert code == 0, err
    summary = json.loads(printed)
    assert summary["frames"] == FRAMES
    assert summary["states"] == {"tracked": FRAMES, "held": 0, "lost": 0}
    assert summary["fps"] > 0
    with VideoReader(out) as reader, VideoReader(clip) as original:
        assert reader.info.rate == 30
        for frame, before, corners in zip(reader.frames(), original.frames(), truth, strict=True):
            assert redness(frame.image, corners) > 150
            assert frame.time == before.time
            # What lies outside the poster is the wall as it was.
            assert np.abs(frame.image[:40].astype(int) - before.image[:40]).mean() < 4
    assert [p for _, p in sound_packets(out)] == [p for _, p in sound_packets(clip)]
    assert list(tmp_path.iterdir()) == [out]


def test_tracks_both_ways_from_the_reference_frame(
    run: Run, clip: Path, truth: list[np.ndarray], tmp_path: Path
) -> None:
    out = tmp_path / "track.json"
    code, _, err = run(
        clip, *quad_arguments(truth[START]), "--start", START, "--end", 20, "-o", out, main=entry.track_main
    )
    assert code == 0, err
    track = Track.load(out)
    assert (len(track), track.reference_frame) == (21, START)
    assert max(error(c, t) for c, t in zip(track.corners, truth, strict=False)) < 1
    assert json.loads(out.read_text())["source"]["fps"] == "30"


def test_renders_a_saved_track(run: Run, clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path) -> None:
    saved = tmp_path / "track.json"
    assert run(clip, *quad_arguments(truth[0]), "--start", "0s", "-o", saved, main=entry.track_main)[0] == 0
    content = json.loads(saved.read_text())
    for i in range(FRAMES):
        frame = content["frames"][i]
        frame["state"] = "lost" if i in LOST else "tracked"
        frame["corners"] = None if i in LOST else truth[i].tolist()
    saved.write_text(json.dumps(content))
    out = tmp_path / "out.mp4"
    code, _, err = run(clip, ad, "--track", saved, "-o", out, "--lost", "hide", "--backend", "opencv")
    assert code == 0, err
    with VideoReader(out) as reader:
        shown = [redness(f.image, truth[f.index]) > 120 for f in reader.frames()]
    assert [i for i, s in enumerate(shown) if not s] == list(LOST)


def test_variable_frame_times_and_sound_survive(run: Run, ad: Path, truth: list[np.ndarray], tmp_path: Path) -> None:
    scene, base = Scene(), Fraction(1, 600)
    ticks = np.cumsum([0, *np.random.default_rng(0).integers(10, 50, FRAMES - 1)])
    times = [int(t) * base for t in ticks]
    images = [scene.draw(corners) for corners in truth]
    sound = tone(float(times[-1]) + 0.05)
    clip = make_clip(tmp_path / "phone.mp4", images, times=times, time_base=base, sound=sound)
    out = tmp_path / "out.mp4"
    code, _, err = run(clip, ad, *quad_arguments(truth[0]), "-o", out, "--backend", "opencv", "--quiet")
    assert code == 0, err
    assert frame_times(out) == frame_times(clip) == times
    assert [t for t, _ in sound_packets(out)] == [t for t, _ in sound_packets(clip)]


@pytest.mark.parametrize("effect", ["mosaic", "blur", "outline"])
def test_effects_need_no_ad(run: Run, clip: Path, truth: list[np.ndarray], tmp_path: Path, effect: str) -> None:
    out = tmp_path / "out.mp4"
    code, _, err = run(
        clip,
        *quad_arguments(truth[0]),
        "--effect",
        effect,
        "--end",
        3,
        "-o",
        out,
        "--backend",
        "opencv",
        "--audio",
        "none",
    )
    assert code == 0, err
    with VideoReader(out) as reader, VideoReader(clip) as original:
        before, after = next(iter(original.frames())), next(iter(reader.frames()))
        assert not reader.info.has_audio
    x0, y0, x1, y1 = 112, 84, 204, 150
    inside = np.abs(after.image[y0:y1, x0:x1].astype(int) - before.image[y0:y1, x0:x1]).mean()
    detail = [cv2.Laplacian(i[y0 + 8 : y1 - 8, x0 + 8 : x1 - 8], cv2.CV_32F).std() for i in (before.image, after.image)]
    if effect == "blur":
        assert detail[1] < 0.3 * detail[0]
    elif effect == "mosaic":
        assert inside > 10
    else:
        assert inside < 8  # re-encoding; only the outline is drawn
        assert np.abs(after.image[68:76, 130:190].astype(int) - before.image[68:76, 130:190]).mean() > 20


@pytest.mark.parametrize("saved", [False, True])
def test_a_span_is_drawn_on_and_the_rest_copied(
    run: Run, clip: Path, truth: list[np.ndarray], tmp_path: Path, saved: bool
) -> None:
    """With the ad, a film of two colours, and its sound beginning with the span; what is outside stays as it is."""
    colours = [np.full((60, 80, 3), colour, np.uint8) for colour in ((255, 0, 0), (0, 0, 255))]
    ad = make_clip(tmp_path / "ad.mp4", [colours[i >= 4] for i in range(40)], rate=30, sound=tone(1.3, 880))
    out, file = tmp_path / "out.mp4", tmp_path / "t.json"
    span, given = (
        range(8, 18),
        [clip, ad, "--time", "8..17", "-o", out, "--backend", "opencv", "--audio", "ad", "--flat"],
    )
    if saved:
        assert run(clip, *quad_arguments(truth[0]), "-o", file, main=entry.track_main)[0] == 0
        code, printed, err = run(*given, "--track", file, "--json", "--strict")
    else:
        code, printed, err = run(*given, *quad_arguments(truth[8]), "--save-track", file, "--json", "--strict")
    assert code == 0, err
    assert json.loads(printed)["states"] == {"tracked": 10, "held": 0, "lost": 0}
    with VideoReader(out) as reader, VideoReader(clip) as original:
        frames = [
            (f.image.astype(int), o.image.astype(int)) for f, o in zip(reader.frames(), original.frames(), strict=True)
        ]
    for index, (frame, before) in enumerate(frames):
        x, y = truth[index].mean(0).round().astype(int)
        if index in span:
            assert frame[y, x].argmax() == (0 if index < 12 else 2)
        else:
            assert np.abs(frame - before).mean() < 4
    sound = np.abs(read_sound(out)[0])
    seconds = np.arange(len(sound)) / SOUND_RATE
    inside = (seconds > 8 / 30 + 0.05) & (seconds < 18 / 30 - 0.05)
    outside = (seconds < 8 / 30 - 0.05) | (seconds > 18 / 30 + 0.05)
    assert sound[inside].mean() > 20 * sound[outside].mean()


BAD = {
    "missing video": (["none.mp4", "{ad}"], "none.mp4"),
    "not a video": (["{text}", "{ad}"], "text.mp4"),
    "sound only": (["{sound}", "{ad}"], "sound.mp4"),
    "missing ad": (["{clip}", "none.png"], "none.png"),
    "no ad": (["{clip}"], "no ad"),
    "three corners": (["{clip}", "{ad}", "--quad", "1,2", "3,4", "5,6"], "quad"),
    "no quad": (["{clip}", "{ad}"], "--quad"),
    "words as corners": (["{clip}", "{ad}", "--quad", "a,b", "c,d", "e,f", "g,h"], "four corners"),
    "self-crossing": (["{clip}", "{ad}", "--quad", "100,70", "216,166", "220,74", "102,160"], "crosses"),
    "flat": (["{clip}", "{ad}", "--quad", "10,70", "50,70", "90,70", "130,70"], "flat"),
    "outside": (["{clip}", "{ad}", "--quad", "-50,70", "220,74", "216,166", "-50,160"], "outside"),
    "tiny": (["{clip}", "{ad}", "--quad", "10,10", "20,10", "20,20", "10,20"], "16 px"),
    "start beyond the end": (["{clip}", "{ad}", "{quad}", "--start", "900"], "beyond the end"),
    "start is no moment": (["{clip}", "{ad}", "{quad}", "--start", "soon"], "soon"),
    "unknown codec": (["{clip}", "{ad}", "{quad}", "--codec", "h999"], "h999"),
    "unknown container": (["{clip}", "{ad}", "{quad}", "-o", "{tmp}/out.xyz"], "out.xyz"),
    "no output folder": (["{clip}", "{ad}", "{quad}", "-o", "{tmp}/none/out.mp4"], "folder"),
    "output exists": (["{clip}", "{ad}", "{quad}", "-o", "{existing}"], "--overwrite"),
    "output is the input": (["{clip}", "{ad}", "{quad}", "-o", "{clip}", "--overwrite"], "input"),
    "missing weights": (["{clip}", "{ad}", "{quad}", "--weights", "none.safetensors"], "none.safetensors"),
    "other weights": (["{clip}", "{ad}", "{quad}", "--weights", "{text}"], "safetensors"),
    "missing track": (["{clip}", "{ad}", "--track", "none.json"], "none.json"),
    "track is no track": (["{clip}", "{ad}", "--track", "{text}"], "not a track file"),
    "track of another video": (["{clip}", "{ad}", "--track", "{other}"], "640x480"),
    "unknown option": (["{clip}", "{ad}", "--sparkle"], "--sparkle"),
    "unknown fit": (["{clip}", "{ad}", "{quad}", "--fit", "squeeze"], "squeeze"),
    "opacity": (["{clip}", "{ad}", "{quad}", "--opacity", "7"], "opacity"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_exit_2(
    run: Run, clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path, name: str
) -> None:
    arguments, message = BAD[name]
    text = tmp_path / "text.mp4"
    text.write_text("no video at all")
    existing = tmp_path / "existing.mp4"
    existing.write_bytes(b"precious")
    other = tmp_path / "other.json"
    other.write_text(
        '{"version": 1, "source": {"path": "o.mp4", "width": 640, "height": 480, "fps": "25", "frames": 1}, '
        '"reference_frame": 0, "quad": [[1, 1], [99, 1], [99, 99], [1, 99]], "frames": [{"index": 0, "time": 0, '
        '"corners": null, "homography": null, "state": "lost", "confidence": 0}]}'
    )
    sound = make_sound(tmp_path / "sound.mp4", tone(0.5)) if name == "sound only" else tmp_path
    names = {
        "clip": clip,
        "ad": ad,
        "text": text,
        "sound": sound,
        "existing": existing,
        "tmp": tmp_path,
        "other": other,
    }
    before = set(tmp_path.rglob("*")) | set(clip.parent.iterdir())
    filled: list[str] = []
    for argument in arguments:
        filled += quad_arguments(truth[0]) if argument == "{quad}" else [argument.format(**names)]
    if "--quad" not in filled and "--track" not in filled and name not in ("no quad", "unknown option"):
        filled += quad_arguments(truth[0])
    if "-o" not in filled:
        filled += ["-o", str(tmp_path / "out.mp4")]
    code, out, err = run(*filled, *([] if "--track" in filled else ["--end", "2"]), "--quiet")
    assert code == 2
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert message in err
    assert "Traceback" not in err
    assert existing.read_bytes() == b"precious"
    assert set(tmp_path.rglob("*")) | set(clip.parent.iterdir()) == before


@pytest.mark.parametrize(("strict", "expected"), [((), 0), (("--strict",), 1)])
def test_a_truncated_video_is_rendered_as_far_as_it_goes(
    run: Run, ad: Path, truth: list[np.ndarray], tmp_path: Path, strict: tuple[str, ...], expected: int
) -> None:
    scene = Scene()
    images = [scene.draw(corners) for corners in truth]
    clip = truncated(make_clip(tmp_path / "cut.mkv", images, rate=10), 0.35)
    out = tmp_path / "out.mp4"
    code, printed, err = run(clip, ad, *quad_arguments(truth[0]), "-o", out, "--json", "--backend", "opencv", *strict)
    assert code == expected
    summary = json.loads(printed)
    assert 0 < summary["frames"] < FRAMES
    assert [err.count(warning) for warning in summary["warnings"]] == [1] * len(summary["warnings"]) != []
    with VideoReader(out) as reader:
        assert sum(1 for _ in reader.frames()) == summary["frames"]


def test_a_full_disk_leaves_the_track_alone(
    run: Run, clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*args: object, **kwargs: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("ar_demo.media.writer.VideoWriter.write", full)
    code, _, err = run(
        clip, ad, *quad_arguments(truth[0]), "-o", tmp_path / "o.mp4", "--end", 2, "--backend", "opencv", "--quiet"
    )
    assert code == 1
    assert "space" in err
    assert err.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["o.track.json"]
    assert str(tmp_path / "o.track.json") in err


def test_ctrl_c_leaves_no_broken_file(
    run: Run, clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("ar_demo.compositing.opencv.CvCompositor.draw", interrupted)
    code, _, err = run(
        clip, ad, *quad_arguments(truth[0]), "-o", tmp_path / "o.mp4", "--end", 2, "--backend", "opencv", "--quiet"
    )
    assert code == 130
    assert "interrupted" in err
    assert list(tmp_path.iterdir()) == []


def test_what_nobody_foresaw_is_one_line_too(run: Run, clip: Path, ad: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*args: object, **others: object) -> None:
        raise ZeroDivisionError("somewhere deep")

    monkeypatch.setattr(commands, "replace", broken)
    code, _, err = run(clip, ad, *quad_arguments(Scene().quad))
    assert code == 1
    assert err.startswith("error: ZeroDivisionError: somewhere deep")
    assert err.count("\n") == 1


def test_python_function_is_what_the_command_calls(
    clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path
) -> None:
    seen: list[str] = []
    result = replace(
        clip,
        Surface(ad, truth[0]),
        tmp_path / "o.mp4",
        TrackingOptions(end=Moment(frame=2)),
        OutputOptions(backend="opencv"),
        lambda event: seen.append(event.stage),
    )
    assert result.output.exists()
    assert result.frames == 3
    assert {"track", "render"} <= set(seen)


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_the_installed_command_stops_cleanly_on_sigint(clip: Path, ad: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from ar_demo.cli.entry import replace_main; replace_main()"]
    process = subprocess.Popen(
        [*command, clip, ad, *quad_arguments(Scene().quad), "-o", tmp_path / "o.mp4"], stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    assert "networks run on" in process.stderr.readline()  # at work, that is
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=600)
    assert process.returncode in (0, 130)  # 0 where the machine let it be done before the signal came
    assert "Traceback" not in err
    assert [p.name for p in tmp_path.iterdir()] in ([], ["o.mp4"])


def test_a_picture_that_moves_has_no_sound_and_that_is_said(
    run: Run, clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path
) -> None:
    out = tmp_path / "out.gif"
    code, _, err = run(clip, ad, *quad_arguments(truth[0]), "--end", 3, "-o", out, "--backend", "opencv")
    assert code == 0, err
    assert ".gif holds no sound: it is left out" in err
    assert out.read_bytes().startswith(b"GIF89a")
    assert list(tmp_path.iterdir()) == [out]


def test_a_layer_and_pictures_in_one_pass(
    run: Run, clip: Path, ad: Path, truth: list[np.ndarray], tmp_path: Path
) -> None:
    outputs = ["-o", tmp_path / "o.%03d.png", "--layer", tmp_path / "l.mov", "--save-matte", tmp_path / "m.mp4"]
    usual = [clip, ad, *quad_arguments(truth[0]), "--end", 3, *outputs, "--backend", "opencv", "--json"]
    code, printed, err = run(*usual)
    assert code == 0, err
    assert ".png holds no sound: it is left out" in err
    summary = json.loads(printed)
    assert [summary[name] for name in ("output", "layer", "matte", "frames")] == [*map(str, outputs[1::2]), 4]
    names = ["l.mov", "m.mp4", *(f"o.{number:03d}.png" for number in range(4))]
    assert sorted(file.name for file in tmp_path.iterdir()) == names
    picture = cv2.cvtColor(cv2.imread(str(tmp_path / "o.003.png")), cv2.COLOR_BGR2RGB)
    assert redness(picture, truth[3]) > 150
    code, _, err = run(*usual)
    assert code == 2
    assert "o.000.png exists already" in err
    code, _, err = run(*usual, "--overwrite", "--end", 1)
    assert code == 0, err
    assert len(list(tmp_path.iterdir())) == 4
