"""A whole shot, from the first picture to the file."""

import json
from pathlib import Path

import numpy as np

from ar_demo import Track
from ar_demo.media.reader import VideoReader

from ...scenes import path
from .npm import installed

QUAD = np.array([[220.0, 90], [430, 97], [424, 250], [226, 240]])
FRAMES = 40


def test_a_shot_from_the_first_picture_to_the_file(visit, folder, tmp_path):
    person = visit()
    page = person.page

    # Any frame, exactly.
    for key, frame in [("End", 39), ("ArrowLeft", 38), ("Shift+ArrowLeft", 28), ("Home", 0), ("ArrowRight", 1)]:
        person.press(key)
        person.wait_for_frame(frame)
        assert person.number_seen() == frame
    box = page.locator(".timeline").bounding_box()
    page.mouse.click(box["x"] + box["width"] * 17.5 / FRAMES, box["y"] + 20)
    person.wait_for_frame(17)
    assert person.number_seen() == 17
    person.press("Home")
    person.wait_for_frame(0)

    # The corners, roughly by hand, then by the edges; the loupe shows where.
    rough = QUAD + np.array([[2, 1], [-2, 2], [-1, -2], [2, -1]])
    page.mouse.move(*person.on_stage(*rough[0]))
    page.locator(".loupe").wait_for(state="visible")
    person.mark(rough)
    person.wait_for("Marked in frame 0")
    page.wait_for_function("() => document.querySelector('.ad:not([hidden])')?.style.transform.startsWith('matrix3d')")
    page.wait_for_function("() => !document.querySelector('.loupe:not([hidden])')")
    person.until(lambda: np.abs(person.corners() - QUAD).max() < 1.2)

    person.click("Track the surface")
    person.wait_for("Tracked in 40 of 40 frames", 60)
    truth = path(QUAD, FRAMES)
    assert _worst(_track(folder), truth) < 2

    for width, height in [(820, 1180), (1024, 768), (1180, 820), (1366, 768)]:
        page.set_viewport_size({"width": width, "height": height})
        assert person.overlaps() == []

    # A corner that is dragged is a keyframe, and only what is next to it is tracked again.
    page.locator("#frame").fill("20")
    person.press("Enter")
    person.wait_for_frame(20)
    person.drag(2, 3, 3)
    person.wait_for("Keyframes")
    person.until(lambda: [*_track(folder).keyframes] == [20], 60)
    page.get_by_role("button", name="Next: look at it").wait_for()
    person.wait_for_frame(20)

    # Before on the left, after on the right; with options as they are chosen.
    before = person.colour_at(*truth[20].mean(0))
    person.click("Next: look at it")
    page.wait_for_selector('canvas.picture[data-view="wipe"][data-frame="20"]')
    person.click("Result", exact=True)
    page.wait_for_selector('canvas.picture[data-view="composite"][data-frame="20"]')
    person.until(lambda: np.abs(person.colour_at(*truth[20].mean(0)) - before).max() > 30)
    page.get_by_label("Opacity").fill("0")
    person.until(lambda: np.abs(person.colour_at(*truth[20].mean(0)) - before).max() < 12)
    person.press("Control+z")
    person.click("Steady")
    page.wait_for_selector('canvas.picture[data-view="steady"]')
    if installed():
        assert person.violations() == []

    person.click("Next: finish")
    assert "ar-replace" in page.locator(".command").inner_text()
    page.locator("#output-name").fill("street.mp4")
    page.get_by_role("button", name="Render", exact=True).click()
    person.wait_for("give another name")
    assert [complaint[:4] for complaint in person.complaints] == ["422 "]
    page.locator("#output-name").fill("done.mp4")
    page.get_by_role("button", name="Render", exact=True).click()
    with page.expect_download(timeout=90_000) as download:
        page.get_by_role("link", name="Download").click(timeout=90_000)
    file = tmp_path / "downloaded.mp4"
    download.value.save_as(file)
    _check(file, folder, truth)
    assert download.value.suggested_filename == "done.mp4"
    assert len(person.complaints) == 1


def _track(folder: Path) -> Track:
    job = json.loads((folder / "street.job.json").read_text())
    return Track.load(folder / job["surfaces"][0]["track"])


def _worst(track: Track, truth: list) -> float:
    return max(float(np.abs(track.corners[i] - corners).max()) for i, corners in enumerate(truth))


def _check(file: Path, folder: Path, truth: list) -> None:
    """The file has all frames in order, with the ad on the poster and all else as it was."""
    with VideoReader(file) as made, VideoReader(folder / "street.mp4") as source:
        pairs = list(zip(made.frames(), source.frames(), strict=True))
    assert len(pairs) == FRAMES
    for (after, before), corners in zip(pairs, truth, strict=True):
        difference = np.abs(after.image.astype(float) - before.image).max(-1)
        x, y = corners.mean(0).round().astype(int)
        assert difference[y - 20 : y + 20, x - 20 : x + 20].mean() > 10
        assert difference[-24:].mean() < 4
