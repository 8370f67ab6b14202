"""Marking by mouse, keys and fingers; undo; reloads and second tabs."""

import json

import numpy as np

QUAD = np.array([[220.0, 90], [430, 97], [424, 250], [226, 240]])


def job(folder):
    return json.loads((folder / "street.job.json").read_text())


def marked(person):
    """A surface in the middle, without snapping."""
    person.page.get_by_label("Snap to edges").uncheck()
    person.mark(QUAD)
    person.wait_for("Marked in frame 0")
    person.saved()
    return person


def test_corners_move_by_a_tenth_of_a_pixel_and_back(visit, folder):
    person = marked(visit())
    before = person.corners()
    person.page.locator(".corner").nth(1).focus()
    person.page.locator(".loupe").wait_for(state="visible")
    person.press("ArrowRight", "ArrowRight", "ArrowUp", "Shift+ArrowDown")
    moved = before + np.array([[0, 0], [0.2, 0.9], [0, 0], [0, 0]])
    person.until(lambda: np.allclose(person.corners(), moved, atol=0.051))
    person.saved()
    person.press("Control+z")
    person.until(lambda: np.allclose(person.corners(), before))
    person.saved()
    person.press("Control+Shift+z")
    person.until(lambda: np.allclose(person.corners(), moved, atol=0.051))
    person.saved()
    assert np.allclose(job(folder)["surfaces"][0]["quad"], person.corners(), atol=0.06)


def test_plays_forward_and_backward_and_shows_the_frames_that_it_names(visit):
    person = visit()
    person.press("l")
    person.until(lambda: person.frame() > 4)
    person.press("k")
    person.page.wait_for_timeout(300)
    stopped = person.frame()
    assert person.number_seen() == stopped
    person.page.wait_for_timeout(300)
    assert person.frame() == stopped
    person.press("j")
    person.until(lambda: person.frame() < stopped)
    person.press("Space")
    person.page.wait_for_timeout(300)
    assert person.number_seen() == person.frame()
    person.page.keyboard.press("Home")
    person.wait_for_frame(0)
    person.press("+")
    person.page.get_by_role("button", name="Whole picture").click()
    assert person.number_seen() == 0


def test_a_likely_rectangle_is_taken_by_its_number(visit):
    person = visit()
    person.page.get_by_role("button", name="Take likely rectangle 1").click()
    person.wait_for("Marked in frame 0")
    person.until(lambda: np.abs(person.corners() - QUAD).max() < 2)
    person.press("Control+z")
    person.wait_for("Where is the surface?")


def test_a_reload_and_a_second_tab_lose_nothing(visit, folder):
    person = marked(visit())
    before = person.corners()
    person.page.reload()
    person.wait_for("Marked in frame 0")
    assert np.allclose(person.corners(), before)
    other = person.page.context.new_page()
    other.goto(person.page.url)
    other.get_by_text("Marked in frame 0").wait_for()
    other.get_by_label("top left, x", exact=True).fill("200")
    other.keyboard.press("Tab")
    person.page.bring_to_front()
    person.wait_for("changed in another tab")
    person.until(lambda: person.corners()[0, 0] == 200)


def test_a_second_surface_with_what_is_left_out_and_an_effect(visit, folder):
    person = marked(visit())
    person.click("Another surface")
    person.mark([(20, 20), (120, 22), (118, 80), (22, 84)])
    person.wait_for("Marked in frame 0")
    person.page.locator("summary", has_text="What is tracked").click()
    person.click("Leave something out")
    for x, y in [(40, 30), (80, 30), (60, 60)]:
        person.page.mouse.click(*person.on_stage(x, y))
    person.press("Enter")
    person.wait_for("Left out: 3 corners")
    move(person, person.page.get_by_label("Corner 3 of 3"), (60, 65))
    move(person, person.page.get_by_label("Another corner after 1"), (62, 24))
    person.wait_for("Left out: 4 corners")
    person.press("Delete")
    person.wait_for("Left out: 3 corners")
    person.press("Control+z")
    person.wait_for("Left out: 4 corners")
    person.page.get_by_label("Corner 2 of 4").focus()
    person.press("Shift+ArrowLeft", "Shift+ArrowLeft")
    person.click("Done")
    person.page.locator(".corner").first.wait_for(state="visible")
    person.page.get_by_role("button", name="Look", exact=True).click()
    person.page.get_by_label("Kind").select_option("mosaic")
    person.saved()
    first, second = job(folder)["surfaces"]
    assert first["ad"].endswith("ad.png")
    assert second["effect"] == "mosaic"
    assert "ad" not in second
    assert np.allclose(second["exclude"], [[(40, 30), (60, 24), (80, 30), (60, 65)]], atol=1)
    person.click("Remove surface 2")
    person.press("Control+z")
    person.saved()
    assert len(job(folder)["surfaces"]) == 2


def move(person, what, to):
    """Drags something, once it lies still, to a point of the frame, px."""
    what.hover()
    person.page.mouse.down()
    person.page.mouse.move(*person.on_stage(*to), steps=3)
    person.page.mouse.up()


def test_number_keys_go_through_the_steps_and_the_line_between_before_and_after_is_dragged(visit):
    person = marked(visit())
    for key, step in ("2", "Track"), ("4", "Finish"), ("1", "Mark"), ("3", "Look"):
        person.press(key)
        person.page.get_by_role("complementary", name=step).wait_for()
    middle = QUAD.mean(0)
    person.page.wait_for_selector('canvas.picture[data-view="wipe"]')
    line = person.page.get_by_role("slider", name="Before and after")
    move(person, line, (600, 180))
    person.until(lambda: int(line.get_attribute("aria-valuenow")) > 90)
    before = person.colour_at(*middle)
    move(person, line, (40, 180))
    person.until(lambda: int(line.get_attribute("aria-valuenow")) < 10)
    person.until(lambda: np.abs(person.colour_at(*middle) - before).max() > 30)
    line.focus()
    person.press("End" if line.get_attribute("aria-valuenow") == "0" else "ArrowRight")
    person.until(lambda: int(line.get_attribute("aria-valuenow")) > 6)


def test_a_finger_marks_and_drags(visit, folder):
    person = visit(viewport={"width": 820, "height": 1180}, has_touch=True)
    person.page.get_by_label("Snap to edges").uncheck()
    for x, y in QUAD:
        person.page.touchscreen.tap(*person.on_stage(x, y))
    person.wait_for("Marked in frame 0")
    before = person.corners()
    assert np.abs(before - QUAD).max() < 1
    code = """([dx, dy]) => {
        const handle = document.querySelectorAll(".corner")[0], box = handle.getBoundingClientRect();
        const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
        const fire = (type, by) => handle.dispatchEvent(new PointerEvent(type, {bubbles: true, pointerId: 7,
            pointerType: "touch", buttons: 1, clientX: x + by * dx, clientY: y + by * dy}));
        Element.prototype.setPointerCapture = () => undefined; // the pointer is not a real one
        fire("pointerdown", 0); fire("pointermove", 0.5); fire("pointermove", 1); fire("pointerup", 1);
    }"""
    person.page.evaluate(code, [20, -10])
    person.until(lambda: (person.corners() - before)[0, 0] > 5)
    moved = person.corners() - before
    assert moved[0, 1] < -2
    assert np.allclose(moved[1:], 0)

    def width():
        left, right = (person.page.locator(".corner").nth(i).bounding_box() for i in (0, 1))
        return right["x"] - left["x"]

    person.until(lambda: np.allclose(job(folder)["surfaces"][0].get("quad", 0), person.corners(), atol=0.06))
    person.page.reload()  # whose pointers are real ones
    person.page.locator(".corner").nth(1).wait_for(state="visible")
    wide, (x, y) = width(), person.on_stage(*QUAD.mean(0))
    fingers = person.page.context.new_cdp_session(person.page)
    for kind, apart in ("touchStart", 30), ("touchMove", 45), ("touchMove", 60), ("touchEnd", None):
        points = [] if apart is None else [{"x": x + side * apart, "y": y, "id": side} for side in (-1, 1)]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    person.until(lambda: 1.8 < width() / wide < 2.2)
    person.page.get_by_role("button", name="Whole picture").click()
    person.until(lambda: abs(width() - wide) < 1)


def test_errors_are_said_where_they_arise(visit, folder):
    person = visit(ad=False)
    assert person.page.get_by_role("button", name="Track the surface").is_disabled()
    person.wait_for("First mark the corners of the surface.")
    marked(person)
    person.wait_for("First choose an ad for the surface.")
    person.click("Choose an ad…")
    dialog = person.page.get_by_role("dialog")
    dialog.locator("input[type=file]").set_input_files(
        {"name": "ad.png", "mimeType": "image/png", "buffer": b"no picture"}
    )
    alert = dialog.get_by_role("alert")
    alert.wait_for()
    assert alert.inner_text().endswith(".")
    dialog.locator("input[type=file]").set_input_files(folder / "ad.png")
    dialog.wait_for(state="detached")
    person.saved()
    assert person.page.get_by_role("button", name="Track the surface").is_enabled()
