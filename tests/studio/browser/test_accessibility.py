"""Every step of the page by the rules of WCAG 2.2 AA that a machine can check."""

import pytest

from .npm import installed


@pytest.mark.skipif(not installed(), reason="npm is not here, or cannot install axe-core")
def test_the_page_can_be_used_by_everybody(visit):
    person = visit(color_scheme="light", reduced_motion="reduce")
    found = {}

    def check(step):
        for scheme in ("light", "dark"):
            person.page.emulate_media(color_scheme=scheme)
            person.page.locator(f"html[data-theme={scheme}]").wait_for()
            found[step, scheme] = person.violations()

    check("empty")
    person.click("Begin with a rectangle in the middle")
    person.wait_for("Marked in frame 0")
    person.page.locator("summary").first.click()
    check("marked")
    for step in ("Track", "Look", "Finish"):
        person.page.get_by_role("button", name=step, exact=True).click()
        person.page.get_by_role("complementary", name=step).wait_for()
        check(step)
    person.press("?")
    person.page.get_by_role("dialog").wait_for()
    check("help")
    assert {step: complaints for step, complaints in found.items() if complaints} == {}
