"""Every step of the page by the rules of WCAG 2.2 AA that a machine can check."""

import pytest

from .npm import installed


@pytest.mark.skipif(not installed(), reason="npm is not here, or cannot install axe-core")
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_can_be_used_by_everybody(visit, scheme):
    person = visit(color_scheme=scheme, reduced_motion="reduce")
    found = {"empty": person.violations()}
    person.click("Begin with a rectangle in the middle")
    person.wait_for("Marked in frame 0")
    person.page.locator("summary").first.click()
    found["marked"] = person.violations()
    for step in ("Track", "Look", "Finish"):
        person.page.get_by_role("button", name=step, exact=True).click()
        person.page.wait_for_timeout(150)
        found[step] = person.violations()
    person.press("?")
    person.page.get_by_role("dialog").wait_for()
    found["help"] = person.violations()
    assert {step: complaints for step, complaints in found.items() if complaints} == {}
