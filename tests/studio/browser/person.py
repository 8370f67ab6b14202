"""What a person does on the page, and sees there."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from .npm import WEB

MARGIN = 12  # CSS px that the stage leaves around the picture
CORNERS = ("top left", "top right", "bottom right", "bottom left")


class Person:
    """Somebody with Studio open.

    Attributes:
        complaints: what the browser's console said of errors, and what the server refused.
    """

    def __init__(self, context: Any, address: str, project: str, size: tuple[int, int], strip: int) -> None:
        self._size, self._strip = size, strip
        self.complaints: list[str] = []
        self.page = context.new_page()
        self.page.set_default_timeout(60_000)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("response", lambda r: self.complaints.append(f"{r.status} {r.url}") if r.status >= 400 else None)
        self.page.goto(f"{address}#{project}")
        self.page.wait_for_selector("canvas.picture[data-frame]")

    def press(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)

    def click(self, button: str, exact: bool = False) -> None:
        self.page.get_by_role("button", name=button, exact=exact).first.click()

    def frame(self) -> int:
        """The frame on the stage."""
        return int(self.page.locator("canvas.picture").get_attribute("data-frame"))

    def wait_for_frame(self, number: int) -> None:
        """Until that frame is on the stage."""
        self.page.wait_for_selector(f'canvas.picture[data-frame="{number}"]')

    def wait_for(self, text: str, seconds: float = 60) -> None:
        self.page.get_by_text(text).first.wait_for(timeout=seconds * 1000)

    def until(self, holds: Callable[[], Any], seconds: float = 60) -> None:
        """Until something holds."""
        end = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < end, "it did not come"
            self.page.wait_for_timeout(100)

    def saved(self) -> None:
        """Until the server has all."""
        # What was just changed is not drawn yet, nor said to be unsaved.
        self.page.evaluate("() => new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
        self.page.get_by_text("Saved", exact=True).wait_for()

    def on_stage(self, x: float, y: float) -> tuple[float, float]:
        """Where a point of the frame, px, is in the window, when the whole picture is shown."""
        box = self.page.locator(".stage").bounding_box()
        width, height = self._size
        scale = min((box["width"] - 2 * MARGIN) / width, (box["height"] - 2 * MARGIN) / height)
        return (
            box["x"] + box["width"] / 2 + (x + 0.5 - width / 2) * scale,
            box["y"] + box["height"] / 2 + (y + 0.5 - height / 2) * scale,
        )

    def mark(self, quad: Any) -> None:
        """Clicks the corners, one after the other."""
        for x, y in quad:
            self.page.mouse.click(*self.on_stage(x, y))

    def drag(self, corner: int, dx: float, dy: float, free: bool = True) -> None:
        """Drags a corner by so many CSS px; freely without snapping."""
        box = self.page.locator(".corner").nth(corner).bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        if free:
            self.page.keyboard.down("Alt")
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x + dx / 2, y + dy / 2)
        self.page.mouse.move(x + dx, y + dy)
        self.page.mouse.up()
        if free:
            self.page.keyboard.up("Alt")

    def colour_at(self, x: float, y: float) -> Any:
        """RGB (3,) of the stage's picture at a point of the frame, px."""
        box = self.page.locator(".stage").bounding_box()
        at_x, at_y = self.on_stage(x, y)
        code = """([x, y]) => {
            const canvas = document.querySelector("canvas.picture"), share = devicePixelRatio;
            return [...canvas.getContext("2d").getImageData(x * share, y * share, 1, 1).data].slice(0, 3);
        }"""
        return np.array(self.page.evaluate(code, [at_x - box["x"], at_y - box["y"]]), float)

    def number_seen(self) -> int:
        """The number that the shown picture says in its strip."""
        width, height = self._size
        bars = [self.colour_at((bit + 0.5) * width / 8, height - self._strip / 2)[1] for bit in range(8)]
        return sum(1 << bit for bit, level in enumerate(bars) if level > 127)

    def corners(self) -> Any:
        """(4, 2) px that the table says."""
        values = [
            float(self.page.get_by_label(f"{corner}, {axis}", exact=True).input_value())
            for corner in CORNERS
            for axis in "xy"
        ]
        return np.array(values).reshape(4, 2)

    def overlaps(self) -> list[str]:
        """Parts that lie beyond the window's right edge, or over the panel."""
        code = """() => {
            const box = name => document.querySelector(name).getBoundingClientRect(), panel = box(".panel");
            const over = a => Math.min(a.right, panel.right) - Math.max(a.left, panel.left) > 1
                && Math.min(a.bottom, panel.bottom) - Math.max(a.top, panel.top) > 1;
            const parts = [".top .tools", ".steps", ".views", ".zoom", ".viewport", ".where", ".state", ".timeline"];
            return parts.filter(name => box(name).right > innerWidth + 1 || over(box(name)));
        }"""
        return list(self.page.evaluate(code))

    def violations(self) -> list[str]:
        """What axe-core finds against WCAG 2.2 AA."""
        if not self.page.evaluate("typeof axe === 'object'"):
            # Not as a script element, which the page's policy forbids.
            self.page.evaluate((WEB / "node_modules" / "axe-core" / "axe.min.js").read_text())
        code = """() => axe.run(document, {runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]})
            .then(found => found.violations.flatMap(
                rule => rule.nodes.map(node => `${rule.id}: ${node.target} ${node.failureSummary}`)))"""
        return list(self.page.evaluate(code))
