"""The page in Chromium: numbers where the pointer is, by keyboard as well, nothing loaded, nothing refused."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ar_demo import Report

from .test_report import clip as _clip
from .test_report import tracked

clip = _clip


@pytest.fixture
def page(browser: Any, clip: Path, tmp_path: Path) -> Iterator[Any]:
    """The report on the clip, opened from its file; nothing may be asked for but it, and nothing complained of."""
    Report.of(tracked(str(clip)), clip).save(tmp_path / "r.html")
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    told: list[str] = []
    page.on("console", lambda message: told.append(message.text))
    page.on("pageerror", lambda error: told.append(str(error)))
    page.on("request", lambda request: told.append(request.url[:80]) if request.url[:5] != "data:" else None)
    page.goto((tmp_path / "r.html").as_uri())
    yield page
    page.close()
    assert told == [(tmp_path / "r.html").as_uri()]


def test_a_pointer_on_a_plot_tells_the_numbers_of_the_frame(page: Any) -> None:
    values = page.locator(".value")
    ranges = values.all_inner_texts()
    box = page.locator("svg.line").first.bounding_box()
    page.mouse.move(box["x"] + box["width"] * (14 + 0.5) / 16, box["y"] + 9)
    assert page.locator("output").inner_text() == "frame 14, 0.56 s, held"
    assert values.all_inner_texts()[:2] == ["3.00 px", "0.35"]
    page.mouse.move(box["x"] + box["width"] * (12 + 0.5) / 16, box["y"] + 9)
    assert values.all_inner_texts()[:2] == ["–", "–"]
    page.mouse.move(2, 2)
    assert values.all_inner_texts() == ranges


def test_the_keyboard_does_as_well(page: Any) -> None:
    page.get_by_role("slider", name="Frame").focus()
    page.keyboard.press("End")
    page.keyboard.press("ArrowLeft")
    assert page.locator("output").inner_text() == "frame 14, 0.56 s, held"
    assert page.get_by_role("slider", name="Frame").get_attribute("aria-valuetext") == "frame 14, 0.56 s, held"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_can_be_read_in_the_dark_and_in_the_light(page: Any, scheme: str) -> None:
    """WCAG 2.2, AA: a contrast of 4.5 between a text and what is behind it."""
    page.emulate_media(color_scheme=scheme)
    colours = page.evaluate(
        """() => ["h1", ".soft", "strong", ".note", "figcaption", "th", "td", ".axis text"].map((which) => {
          const e = document.querySelector(which), style = getComputedStyle(e);
          const ground = getComputedStyle(which === "strong" ? e.parentNode : document.body).backgroundColor;
          return [e.ownerSVGElement ? style.fill : style.color, ground];
        })"""
    )
    for text, ground in colours:
        light, dark = sorted((_luminance(text), _luminance(ground)), reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= 4.5, (text, ground)


@pytest.mark.parametrize("width", [360, 1366])
def test_no_page_is_wider_than_its_window(page: Any, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 768})
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def _luminance(colour: str) -> float:
    """Relative luminance (WCAG 2.2) of 'rgb(r, g, b)'."""
    levels = [int(level) / 255 for level in colour[colour.index("(") + 1 : -1].split(",")[:3]]
    r, g, b = (level / 12.92 if level <= 0.04045 else ((level + 0.055) / 1.055) ** 2.4 for level in levels)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b
