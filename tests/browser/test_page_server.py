"""The page and its server: nothing is lost when it is killed, two windows, time from a click to the new overlay."""

import os
import signal
import time

import numpy as np

from browser.driving import LABELS, along

CLICKS = 30
# Machines that test are busy, and the overlay comes two to four times as late there: the goal is measured by hand. The
# processor time of the server for an edit is nearly the same whatever else runs.
MOST_MEDIAN, MOST_WORK = 600.0, 160.0  # ms
TEN = (*LABELS, "Side line bottom", "Small rect. left top", "Small rect. left main", "Circle central")
# the time from a press in the picture until the overlay with its answer is painted
WATCH = """() => {
    window.times = [];
    const canvas = document.querySelector(".picture-lines");
    let pressed = null, before = null;
    canvas.addEventListener("pointerup", () => {
        pressed = performance.now();
        before = Number(canvas.dataset.revision);
    }, true);
    new MutationObserver(() => {
        if (pressed === null || Number(canvas.dataset.revision) <= before) return;
        const since = pressed;
        pressed = null;
        requestAnimationFrame(() => setTimeout(() => window.times.push(performance.now() - since)));
    }).observe(canvas, { attributes: true, attributeFilter: ["data-revision"] });
}"""


def test_labels_are_there_again_after_the_server_was_killed(serve, window, picture):
    server = serve(picture)
    one = window(server)
    one.clear()
    one.mark("Side line top", along("Side line top", count=4))
    marks = one.state()["marks"]

    server.kill()
    one.click(along("Side line top", count=3)[1] + (0.0, 200.0))
    one.page.get_by_text("The server does not answer.").wait_for()
    assert "not stored yet" in one.text(".banner:not(.refusal)")
    assert len(one.page.locator(".mark-row").all()) == 1  # and what was labelled stays on the screen

    server.start()
    again = window(server)
    assert again.state()["marks"] == marks
    revision = again.revision
    again.press("Control+z")
    again.wait_for_revision(revision + 1)
    assert len(again.state()["marks"]) == 3


def test_an_edit_waits_while_the_server_sleeps(serve, window, picture):
    server = serve(picture)
    one = window(server)
    one.clear()
    one.choose("Side line top")
    os.kill(server.process.pid, signal.SIGSTOP)
    places = along("Side line top", count=5)
    for xy in places:
        one.click(xy)
    assert one.canvas.get_attribute("data-pending") == "5"  # drawn already
    os.kill(server.process.pid, signal.SIGCONT)
    one.wait_for_revision(6)
    assert len(one.state()["marks"]) == 5


def test_an_edit_of_a_frame_that_another_window_changed_is_refused(serve, window, picture):
    server = serve(picture)
    first = window(server)
    second = window(server, context=first.page.context)
    project = second.get("api/project")
    second.page.route("**/api/project", lambda route: route.fulfill(json=project))  # it does not know yet

    first.clear()
    first.mark("Side line top", along("Side line top"))
    second.choose("Middle line")
    second.click(along("Middle line")[0])

    second.page.get_by_text("This frame was changed in another window.").wait_for()
    second.wait_for_revision(first.revision)
    assert second.page.locator(".mark-row").all_inner_texts()[0].startswith("Side line top")
    assert {mark["label"] for mark in second.state()["marks"]} == {"Side line top"}

    second.click(along("Middle line")[0])  # and now it counts
    second.wait_for_revision(first.revision + 1)
    first.wait_for_revision(second.revision)  # the other one hears of it
    first.page.locator(".mark-row", has_text="Middle line").wait_for()


def test_what_is_saved_is_said(serve, window, picture):
    server = serve(picture)
    one = window(server)
    assert one.text("#top-save button") == "Save"  # nothing has been saved yet
    one.press("Control+s")
    one.page.get_by_text("Nothing was changed by hand. Saved what was found by itself in 1 frame").wait_for()
    one.press("Control+s")
    one.page.get_by_text("Nothing to save").wait_for()
    one.label_by_clicks(LABELS[:4])
    one.page.get_by_role("button", name="Save 1 frame").wait_for()
    assert one.page.title().startswith("• ")
    one.press("Control+s")
    one.page.get_by_text("Saved 1 frame in").wait_for()
    one.page.get_by_role("button", name="Saved", exact=True).wait_for()
    assert (server.out / "cameras.jsonl").is_file()

    one.page.get_by_label("Write labels as a file").select_option("soccernet")
    one.page.get_by_text("Labels written:").wait_for()


def test_a_second_server_on_a_folder_says_so_at_once(serve, window, picture):
    first = window(serve(picture))
    first.mark("Middle line", along("Middle line")[:1])
    second = window(serve(picture))
    second.page.get_by_text("Changes here are refused:").wait_for()
    first.server.kill()
    second.page.get_by_text("Changes here are refused:").wait_for(state="hidden")
    second.clear()


def test_the_page_has_names_and_a_strict_policy(serve, window, picture):
    """No control without a name, no inline script or style in the document, and all of it from one address."""
    one = window(serve(picture))
    policy = one.page.evaluate("fetch(location.href).then(answer => answer.headers.get('content-security-policy'))")
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    unnamed = """[...document.querySelectorAll("button, a, select, input, canvas[tabindex], svg[role], [role=tab]")]
        .filter((one) => !(one.getAttribute("aria-label") || one.textContent.trim())).map((one) => one.outerHTML)"""
    assert one.page.evaluate(unnamed) == []
    assert len(one.requests) > 20


def measured(one):
    one.wait(f"() => window.times.length >= {CLICKS}")
    return np.array(one.page.evaluate("window.times"))


def test_the_overlay_follows_a_click_at_once(serve, window, picture, rng, record_property):
    """1080p, ten labels: the goal is 100 ms in the median and 200 ms for 95 % on two cores that are free."""
    server = serve(picture)
    one = window(server, size=(1920, 1080))
    one.label_by_clicks(TEN)
    one.page.evaluate(WATCH)
    before = server.processor_seconds
    for number in range(CLICKS):
        xy = along(TEN[number % 10], count=3)[1] + rng.normal(scale=2.0, size=2)
        one.mark(TEN[number % 10], [xy])
        revision = one.revision
        one.press("Escape", "Control+z")
        one.wait_for_revision(revision + 1)
    work = 1e3 * (server.processor_seconds - before) / (2 * CLICKS)  # each click is undone
    times = measured(one)
    median, most = np.percentile(times, (50, 95))
    record_property("median_ms", round(float(median)))
    record_property("most_ms", round(float(most)))
    record_property("work_ms", round(work))
    print(f"click to overlay: median {median:.0f} ms, 95 % {most:.0f} ms of {len(times)}; {work:.0f} ms of work each")
    assert median < MOST_MEDIAN
    assert not work > MOST_WORK


def test_the_first_overlay_is_painted_soon(serve, window, picture, record_property):
    """From `fieldcalib open` to the overlay; the goal is 3 s with the browser running."""
    start = time.monotonic()
    one = window(serve(picture))
    seconds = time.monotonic() - start
    record_property("seconds", round(seconds, 2))
    print(f"from the command to the overlay: {seconds:.1f} s")
    assert one.state()["camera"] is not None
    assert seconds < 30.0
