from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from ar_demo.options import OutputOptions, TrackingOptions
from ar_demo.surface import Keyframe, Moment, Span, Surface, parse_quad
from hdn.errors import InputError


@pytest.mark.parametrize(
    ("text", "frame", "time"),
    [
        ("120", 120, None),
        ("0", 0, None),
        ("4.5s", None, Fraction(9, 2)),
        ("2s", None, Fraction(2)),
        ("0:04.5", None, Fraction(9, 2)),
        ("1:02:03", None, Fraction(3723)),
    ],
)
def test_moments(text: str, frame: int | None, time: Fraction | None) -> None:
    assert Moment.parse(text) == Moment(frame, time)


@pytest.mark.parametrize("text", ["-1", "soon", "1:2:3:4", "", "1e3"])
def test_refuses_other_moments(text: str) -> None:
    with pytest.raises(InputError, match="neither"):
        Moment.parse(text)


@pytest.mark.parametrize(
    "given",
    [
        "1,2 30,2 30,40 1,40",
        "1, 2, 30, 2, 30, 40, 1, 40",
        "1 2 30 2\n30 40 1 40",
        "(1,2) (30,2) (30,40) (1,40)",
        "[[1, 2], [30, 2], [30, 40], [1, 40]]",
        ["1,2", "30,2", "30,40", "1,40"],
        [[1, 2], [30, 2], [30, 40], [1, 40]],
    ],
)
def test_quads(given: Any) -> None:
    np.testing.assert_array_equal(parse_quad(given), [[1, 2], [30, 2], [30, 40], [1, 40]])


@pytest.mark.parametrize(
    "given",
    [
        "",
        "1,2 3,4 5,6",
        "1 2 3 4",
        "1,2 3,4 5,6 7,8 9",
        "a,b c,d e,f g,h",
        ["1,2", "3,4", "5,nan", "6,7"],
        ["1,2,3"] * 4,
    ],
)
def test_refuses_other_quads(given: Any) -> None:
    with pytest.raises(InputError, match="four corners"):
        parse_quad(given)


@pytest.mark.parametrize(
    ("text", "at"), [("40", Moment(40)), ("4.5s", Moment.parse("4.5s")), ("0:04", Moment.parse("4s"))]
)
def test_keyframes(text: str, at: Moment) -> None:
    keyframe = Keyframe.parse(f"{text}:1,2,30,2,30,40,1,-4.5")
    assert keyframe.at == at
    np.testing.assert_array_equal(keyframe.corners, [[1, 2], [30, 2], [30, 40], [1, -4.5]])


@pytest.mark.parametrize(
    "text", ["", "40", "1,2,30,2,30,40,1,4", "40:1,2,30,2,30,40,1", "soon:1,2,3,4,5,6,7,8", "4:1,2,3,4,5,6,7,x"]
)
def test_refuses_other_keyframes(text: str) -> None:
    with pytest.raises(InputError):
        Keyframe.parse(text)


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        (Surface, {"fit": "squeeze"}),
        (Surface, {"blend": "burn"}),
        (Surface, {"opacity": 1.5}),
        (Surface, {"feather": -1}),
        (Surface, {"flat": "yes"}),
        (Surface, {"snap": 2}),
        (TrackingOptions, {"smooth": float("nan")}),
        (TrackingOptions, {"device": "tpu"}),
        (OutputOptions, {"crf": 99}),
        (OutputOptions, {"backend": "metal"}),
    ],
)
def test_refuses_values_out_of_range(kind: type, wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        kind(**wrong)


@pytest.mark.parametrize("given", [{"ad": "a.mp4"}, {"fit": "cover"}, {"playback": "once"}, {"flat": True}])
def test_an_effect_refuses_what_it_has_no_use_for(given: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(given))} does nothing with effect blur"):
        Surface(effect="blur", **given)


@pytest.mark.parametrize(
    ("text", "begin", "end"),
    [
        ("10s..20s", Moment(time=Fraction(10)), Moment(time=Fraction(20))),
        ("250..0:20.5", Moment(frame=250), Moment(time=Fraction(41, 2))),
        ("10..", Moment(frame=10), None),
        ("..10", None, Moment(frame=10)),
    ],
)
def test_a_span(text: str, begin: Moment | None, end: Moment | None) -> None:
    assert Span.parse(text) == Span(begin, end)


@pytest.mark.parametrize("text", ["10s", "..", "10-20", "a..b", "1..2..3"])
def test_what_is_no_span(text: str) -> None:
    with pytest.raises(InputError, match=r"span|neither a frame"):
        Span.parse(text)


def test_a_span_has_its_own_end() -> None:
    with pytest.raises(InputError, match="time and end"):
        TrackingOptions(end=Moment(frame=3), time=Span.parse("1.."))
