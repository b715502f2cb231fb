"""The page for people who use no mouse, and for those who do not see it: keys, names and contrasts.

Names and contrasts are looked at by axe-core (`npm install axe-core`), where FIELDCALIB_AXE names its axe.min.js.
"""

import os
from pathlib import Path

import pytest

import fieldcalib
from browser.driving import LABELS, TRUTH, along
from browser.test_page_labels import largest_shift
from fieldcalib.web import write_report

GRAVE = ("serious", "critical")


def test_a_frame_is_labelled_without_a_mouse(serve, window, picture):
    one = window(serve(picture))
    one.press("Control+a", "Delete")
    one.wait_for_revision(1)
    for label in LABELS:
        one.choose(label)
        for number, xy in enumerate(along(label, count=4 if "Circle" in label else 2)):
            before = one.revision
            if label == LABELS[0] and number == 0:
                one.press("Enter")
                one.page.get_by_text("arrow keys move the pointer").wait_for()
            one.point(xy)
            one.press("Enter")
            one.wait_for_revision(before + 1)
    assert one.text("#verdict strong") == "Good"
    assert largest_shift(one.state()["camera"]) < 6.0

    foot = (-20.0, 5.0, 0.0)
    one.press("Escape", "2", "Enter")
    one.point(TRUTH.project(foot))
    one.press("Enter")
    one.page.locator(".measure-row", has_text="Foot").get_by_text("±").wait_for()
    x, y = one.text(".measure-value").split(" m")[0].replace("−", "-").split(", ")
    assert (float(x), float(y)) == pytest.approx(foot[:2], abs=0.3)
    one.press("3", "Enter")  # from there
    one.point(TRUTH.project((-12.0, 11.0, 0.0)))
    one.press("Enter")
    distance = one.page.locator(".measure-row", has_text="Distance").locator(".measure-value")
    distance.get_by_text("±").wait_for()
    assert float(distance.inner_text().split(" m")[0]) == pytest.approx(10.0, abs=0.2)
    one.press("Escape", "Control+s")
    one.page.get_by_role("button", name="Saved", exact=True).wait_for()


@pytest.fixture(scope="module")
def axe():
    path = Path(os.environ.get("FIELDCALIB_AXE", "node_modules/axe-core/axe.min.js"))
    if not path.is_file():
        pytest.skip("needs axe-core: FIELDCALIB_AXE names no axe.min.js, and there is none in node_modules")
    return path.read_text()


def grave_findings(page, axe):
    """What axe finds in a page as it is, that is serious or worse."""
    page.evaluate(axe)
    found = page.evaluate("axe.run(document, { resultTypes: ['violations'] })")["violations"]
    return [(one["id"], [node["target"] for node in one["nodes"]]) for one in found if one["impact"] in GRAVE]


def test_nothing_grave_is_found_in_a_report(chromium, picture, tmp_path, axe):
    write_report(fieldcalib.calibrate(picture, progress=False), tmp_path / "report.html")
    page = chromium.new_page()
    page.goto((tmp_path / "report.html").as_uri())
    page.locator("[role=row] [role=cell]").first.wait_for()
    found = grave_findings(page, axe)
    page.close()
    assert found == []


def test_nothing_grave_is_found_in_the_states_of_the_page(serve, window, picture, axe):
    one = window(serve(picture))
    assert grave_findings(one.page, axe) == []  # found by itself
    one.clear()
    assert grave_findings(one.page, axe) == []  # nothing is labelled
    for label in LABELS:
        one.mark(label, along(label, count=4 if "Circle" in label else 2))
    assert grave_findings(one.page, axe) == []
    one.mark("Small rect. left main", along("Big rect. left main", count=4)[1:3] + (180.0, 90.0))
    assert grave_findings(one.page, axe) == []  # in doubt
    one.press("Escape", "Shift+E", "2")
    one.click((1050.0, 700.0))
    one.page.locator(".measure-row", has_text="Foot").get_by_text("±").wait_for()
    assert grave_findings(one.page, axe) == []
    one.page.get_by_role("tab", name="Camera").click()
    assert grave_findings(one.page, axe) == []
    one.press("?")
    assert grave_findings(one.page, axe) == []
