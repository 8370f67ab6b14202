"""`ar-bench`: that it measures what it says. Times themselves depend on the machine and are not tested."""

import threading
import time
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ar_demo.errors import RunError
from ar_demo.evaluation import speed
from ar_demo.evaluation.drawn_clips import Kind, corners_in, draw_clip
from ar_demo.evaluation.stages import OTHER, TASKS, Sampler
from ar_demo.evaluation.transcode import transcode
from ar_demo.media.reader import VideoReader
from hdn.commandline import BAD_INPUT
from hdn.imaging.quads import area


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drawn") / "clip.mp4"
    draw_clip(path, Kind(160, 96, 0.25, 12))
    return path


def test_surfaces_have_the_share_of_the_frame_that_is_asked_for() -> None:
    [one] = Kind(1280, 720, 0.25, 1).quads
    assert area(one) / (1280 * 720) == pytest.approx(0.25, rel=0.02)
    many = Kind(1280, 720, 1.0, 1, 10).quads
    assert len(many) == 10
    assert 0.5 < sum(map(area, many)) / (1280 * 720) < 1
    corners = np.array(many)
    assert corners.min() >= 0
    assert (corners.max((0, 1)) <= [1279, 719]).all()
    rights, lefts = corners[:, 1, 0], corners[:, 0, 0]
    assert (lefts[1:4] > rights[:3]).all()  # beside each other


def test_drawn_surfaces_move(drawn: Path) -> None:
    kind = Kind(160, 96, 0.25, 12)
    [first], [later] = corners_in(0, kind), corners_in(11, kind)
    np.testing.assert_allclose(first, kind.quads[0])
    assert np.linalg.norm(later - first, axis=1).max() > 1
    with VideoReader(drawn) as reader:
        assert len(list(reader.frames())) == 12


def test_a_transcode_has_the_same_frames_at_the_same_times(drawn: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    assert transcode(drawn, out) == 12
    with VideoReader(drawn) as source, VideoReader(out) as copy:
        for a, b in zip(source.frames(), copy.frames(), strict=True):
            assert a.time == b.time == Fraction(a.index, 30)
            assert np.abs(a.image.astype(int) - b.image).mean() < 3


def test_a_process_is_accounted_for() -> None:
    burn = "import time\nb = bytearray(100 << 20)\nprint('first', flush=True)\nwhile time.process_time() < 0.6: pass"
    cost = speed.cost_of(["-c", burn])
    assert 0.5 < cost.processor < 3
    assert cost.memory > 100
    assert cost.first is not None
    assert cost.first < cost.seconds
    with pytest.raises(RunError, match="no such thing"):
        speed.cost_of(["-c", "raise SystemExit('no such thing')"])


def test_each_threads_time_counts_for_what_it_does() -> None:
    if not TASKS.is_dir():
        pytest.skip("no thread's processor time is seen by another here")
    work = compile(
        "def work(until):\n    while time.thread_time() < until: pass\n", "/x/ar_demo/scene/grain.py", "exec"
    )
    space: dict[str, object] = {"time": time}
    exec(work, space)
    burn = space["work"]
    assert callable(burn)
    sampler = Sampler()
    sampler.start()
    thread = threading.Thread(target=burn, args=(0.3,))
    thread.start()
    thread.join()
    sampler.stop()
    assert 0.2 < sampler.seconds["grain"] < 0.5
    assert sampler.seconds[OTHER] < 0.2


def test_jobs_say_the_surfaces_as_a_user_does(tmp_path: Path) -> None:
    clip, ad = tmp_path / "clip.mp4", tmp_path / "ad.mp4"
    one, two = "1,1 9,1 9,9 1,9", "11,1 19,1 19,9 11,9"
    single = speed.Bench(speed.Subject("one", clip, 10, [one], ad), tmp_path)
    assert single.command("track")[:6] == [str(clip), "--quad", *one.split()]
    assert single.command("whole")[:3] == [str(clip), str(ad), "--quad"]
    assert "--track" in single.command("render")
    several = speed.Bench(speed.Subject("two", clip, 10, [one, two], ad), tmp_path)
    assert several.command("whole").count("--surface") == 2


def test_a_report_has_the_ratios_of_each_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    costs = iter(
        [speed.Cost(wall, cpu, 100 + mib, 0.5) for wall, cpu, mib in ((2, 1, 0), (4, 3, 7), (8, 5, 9), (6, 2, 8))]
    )
    monkeypatch.setattr(speed, "cost_of", lambda arguments: next(costs))
    subject = speed.Subject("clip", tmp_path / "clip.mp4", 10, ["1,1 9,1 9,9 1,9"], tmp_path / "ad.mp4")
    report = speed.measure(subject, 1, False)
    assert report["to_transcode"]["track"] == {"seconds": 2, "processor": 3, "memory": 7, "ms_a_frame": 200}
    assert "| clip | whole | 200.0 | 100.0 | 2.00 | 3.00 | 108 | 8 | 0.50 |" in speed.describe([report], 1)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["clip.mp4"], "give a clip, an ad and --quad"),
        (["--quad", "1,1", "9,1", "9,9", "1,9"], "--quad is for a clip that is given"),
        (
            ["clip.mp4", "ad.mp4", "--quad", "1,1", "9,1", "9,9", "1,9", "--share", "5"],
            "--share is for clips that are drawn",
        ),
        (["--size", "big"], "is not like 1280x720"),
        (["--plot", "x.png"], "--plot draws what --stages measures"),
    ],
)
def test_what_does_not_go_together_is_refused(given: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        speed.main(given)
    assert end.value.code == BAD_INPUT
    assert said in capsys.readouterr().err
