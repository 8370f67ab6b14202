"""The page: it has what it should, it loads nothing, and nothing in it is taken for markup."""

import json
import re
from base64 import b64encode
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from hashlib import sha256
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ar_demo import InputError, Progress, Report, Session, Stopped, Track
from ar_demo.media.pictures import write_picture
from ar_demo.media.reader import IndexDropped
from ar_demo.progress import Timings
from ar_demo.report import looking
from ar_demo.report import report as report_module
from ar_demo.report.facts import settings
from ar_demo.report.report import check_page
from ar_demo.surface import Keyframe, Moment, Surface

from ..clips import make_clip
from ..export.tracks import make
from ..scenes import Scene, path

FRAMES = 16
LOST = (12, 13)
VOID = {"meta", "img", "input"}


class Page(HTMLParser):
    """Reads a page, and sees to it that what is opened is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"script", "style"} & {*self.open}:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.words).split())

    def having(self, tag: str) -> Iterator[dict[str, str | None]]:
        return (attrs for name, attrs in self.tags if name == tag)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A poster that moves; from frame 8 on half as bright."""
    scene = Scene()
    images = [scene.draw(corners) for corners in path(scene.quad, FRAMES)]
    images[8:] = [np.asarray(image // 2, np.uint8) for image in images[8:]]
    return make_clip(tmp_path_factory.mktemp("clip") / "street <b>&.mp4", images)


def tracked(source: str = "street.mp4") -> Track:
    """The clip's true corners, lost in two frames, held in the last two, whose corners are badly known."""
    corners = np.stack(path(Scene().quad, FRAMES))
    corners[list(LOST)] = np.nan
    track = make(corners)
    track.source = replace(track.source, path=source)
    track.states[14:] = ["held"] * 2
    track.deviation[14:], track.confidence[14:] = (3.0, 2.5), 0.35
    return timed(track)


def timed(track: Track) -> Track:
    """With the times of clips that are made here."""
    track.times = [Fraction(i, 25) for i in range(len(track))]
    return track


def test_a_report_with_all_there_is(clip: Path, tmp_path: Path) -> None:
    track = tracked(str(clip))
    report = Report.of(
        track, clip, composite=clip, names=["ad <script>.png"], settings={"fit": "cover"}, timings={"tracking": "3 s"},
        warnings=["a warning"],
    )  # fmt: skip
    report.save(tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert len(text) < 1_000_000
    page = Page(text)
    for words in (
        "street <b>&.mp4", "check", "lost in 2 of 16 frames", "corners are uncertain by 3.0 px at worst",
        "12 of 16 frames are tracked, 2 held and 2 lost", "Frames 12 to 15", "two thirds hidden", "ad <script>.png",
        "Deviation", "Confidence", "Jitter", "Size", "Blur", "Light", "Middle row", "standing still",
        "The worst frames", "frame 14", "before", "after", "a warning", "cover", "3 s", "OpenVINO".lower(), "Python",
    ):  # fmt: skip
        assert words in page.text, words
    assert report.verdict.status == "check"
    light = report.looks[0].light
    np.testing.assert_allclose(light[1:8], 1, atol=0.05)
    np.testing.assert_allclose(light[8:12], 0.5, atol=0.07)
    assert [still.index for still in report.looks[0].worst[:2]] == [13, 14]
    assert all(attrs["alt"] for attrs in page.having("img"))
    assert sum(1 for _ in page.having("polygon")) == 2 * sum(still.index not in LOST for still in report.looks[0].worst)


def test_a_page_loads_nothing_and_its_policy_allows_just_what_it_has(clip: Path) -> None:
    text = Report.of(tracked(str(clip)), clip).html()
    assert "http" not in text.replace("http-equiv", "")
    page = Page(text)
    assert all(str(attrs["src"]).startswith("data:image/jpeg;base64,") for attrs in page.having("img"))
    [policy] = [
        attrs["content"] for attrs in page.having("meta") if attrs.get("http-equiv") == "Content-Security-Policy"
    ]
    assert policy is not None
    assert policy.startswith("default-src 'none'; img-src data:;")
    for tag, kind in (("style", "style-src"), ("script", "script-src")):
        [content] = re.findall(rf"<{tag}>(.*?)</{tag}>", text, re.DOTALL)
        digest = b64encode(sha256(content.encode()).digest()).decode()
        assert f"{kind} 'sha256-{digest}'" in policy
    assert not [attrs for _, attrs in page.tags if any(name == "style" or name.startswith("on") for name in attrs)]


def test_without_a_video_there_are_plots_and_no_pictures() -> None:
    page = Page(Report.of(tracked()).html())
    assert not list(page.having("img"))
    assert "Deviation" in page.text
    assert "Blur" not in page.text


def test_several_surfaces(clip: Path) -> None:
    good = timed(make(np.stack(path(Scene().quad, FRAMES))))
    report = Report.of([good, tracked()], clip, names=["a.png", None])
    page = Page(report.html())
    assert "Surface 1: a.png" in page.text
    assert "surface 2: lost" in page.text
    ids = [attrs["id"] for attrs in page.having("input")]
    assert len({*ids}) == 2


def test_text_of_others_is_text(clip: Path) -> None:
    track = tracked("</title></script><script>alert(1)</script>.mp4")
    track.warnings = ["<img src=x onerror=alert(1)>"]
    page = Page(Report.of(track, settings={"<i>": "</table>"}).html())
    assert len([attrs for attrs in page.having("script") if "type" not in attrs]) == 1
    assert not list(page.having("img"))
    assert "<img src=x onerror=alert(1)>" in page.text


def test_pictures_take_no_more_bytes_than_they_may(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Of noise, which JPEG holds worst, they are squeezed into what there is for them."""
    monkeypatch.setattr(looking, "MODEL", replace(looking.MODEL, page_bytes=150_000))
    image = np.random.default_rng(0).integers(0, 256, (180, 240, 3), np.uint8)
    clip = make_clip(tmp_path / "noise.mkv", [image] * 12, codec="ffv1", pix_fmt="bgr0")
    quad = np.array([[40.0, 40], [200, 40], [200, 140], [40, 140]])
    report = Report.of([timed(make(np.repeat(quad[None], 12, 0), 240, 180))] * 2, clip, composite=clip)
    assert [len(each.strip) for each in report.looks] == [12, 12]
    assert len(report.pairs) == 3
    pictures = sum(len(str(attrs["src"])) for attrs in Page(report.html()).having("img"))
    assert 50_000 < pictures < 4 / 3 * 150_000 + 5_000


def test_in_a_long_track_several_frames_share_a_point() -> None:
    rng = np.random.default_rng(0)
    track = make(Scene().quad + rng.normal(0, 1, (20_000, 4, 2)))
    track.deviation[15_555] = 5.0
    text = Report.of(track).html()
    assert len(text) < 400_000
    assert "frames 15554 to 15567" in text
    [data] = re.findall(r"<script type='application/json'>(.*?)</script>", text)
    assert json.loads(data)["values"][0].count(5.0) == 1
    short = make(track.corners[:2000])
    assert len(Report.of([short] * 12).html()) < 8 * len(Report.of([short]).html())


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("missing.mp4", "missing.mp4"),
        ("out.%03d.png", "15 pictures, and the track 16 frames"),
        ("o.exr", "linear light"),
    ],
)
def test_what_cannot_be_looked_at_is_a_warning(clip: Path, tmp_path: Path, name: str, why: str) -> None:
    for number in range(FRAMES - 1):
        write_picture(tmp_path / f"out.{number:03d}.png", Scene().draw(None))
    (tmp_path / "o.exr").write_bytes(b"")
    report = Report.of(tracked(str(clip)), clip, composite=tmp_path / name)
    assert report.pairs == []
    assert why in report.warnings[-1]
    write_picture(tmp_path / f"out.{FRAMES - 1:03d}.png", Scene().draw(None))
    assert len(Report.of(tracked(str(clip)), clip, composite=tmp_path / "out.%03d.png").pairs) == 3


def test_starts_over_where_frames_were_numbered_wrongly(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried, look = [], report_module.look

    def once_wrong(*arguments: Any) -> Any:
        tried.append(arguments)
        if len(tried) == 1:
            raise IndexDropped("frames were counted wrongly")
        return look(*arguments)

    monkeypatch.setattr(report_module, "look", once_wrong)
    assert len(Report.of(tracked(str(clip)), clip).looks) == 1
    assert len(tried) == 2


def test_a_track_of_another_video_is_refused(clip: Path) -> None:
    track = tracked()
    track.source = replace(track.source, width=100)
    with pytest.raises(InputError, match="100x240"):
        Report.of(track, clip)


def test_a_page_has_the_ending_of_one() -> None:
    assert check_page("a.HTML") == Path("a.HTML")
    with pytest.raises(InputError, match=r"must end in \.html"):
        check_page("t.json")


def test_notebooks_show_them(clip: Path) -> None:
    track = tracked("a<b>.mp4")
    track.warnings = ["<i>"]
    shown = Page(track._repr_html_())
    assert "a<b>.mp4" in shown.text
    assert "12 tracked, 2 held, 2 lost" in shown.text
    [frame] = Page(f"<div>{Report.of(track)._repr_html_()}</div>").having("iframe")
    assert "a&lt;b&gt;.mp4" in str(frame["srcdoc"])


def test_settings_are_those_that_are_not_as_usual() -> None:
    quad = np.array([[1.0, 2], [3, 2], [3, 4], [1, 4.5]])
    surface = Surface("a.png", quad, fit="cover", keyframes=(Keyframe(Moment(frame=3), quad),))
    assert settings({"input": "v.mp4"}, surface, Surface("b.png", quad)) == {
        "input": "v.mp4",
        "ad": "a.png; b.png",
        "quad": "1,2 3,2 3,4 1,4.5; 1,2 3,2 3,4 1,4.5",
        "keyframes": "frame 3: 1,2 3,2 3,4 1,4.5",
        "fit": "cover",
    }


def test_a_report_is_stopped_with_its_session(clip: Path) -> None:
    with Session(clip) as session:

        def listen(event: Progress) -> None:
            if event.done == 3:
                session.stop()

        with pytest.raises(Stopped):
            Report.of(tracked(str(clip)), clip, listen=listen, stop=session.stopping)


def test_timings_tell_each_stage() -> None:
    seen: list[Progress] = []
    timings = Timings(seen.append)
    timings.take("opening")
    for stage in ("track", "track back", "track"):
        timings(Progress(stage, 1))
    timings.take("joint solution")
    assert [*timings.told] == ["opening", "track", "track back", "joint solution", "in all"]
    assert len(seen) == 3
