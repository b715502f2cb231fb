"""Clips: a frame that is mended holds, and the others follow; play, cuts, the timeline."""

import cv2
import numpy as np
import pytest

from browser.driving import FIELD, SECONDS
from fieldcalib.draw.scene import render_field
from fieldcalib.geometry.camera import Camera

SIZE = (960, 540)
COUNT = 24
CAMERAS = [
    Camera.from_angles(*np.radians([-17.0 + 0.35 * k, 77.0, 0.2]), 1300.0 + 4.0 * k, (1.5, 66.0, -16.0), SIZE)
    for k in range(COUNT)
]
HAND = ("Side line top", "Side line left", "Big rect. left main", "Big rect. left top", "Circle left", "Middle line")


def write(path, images, size=SIZE):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, size)
    for image in images:
        writer.write(image)
    writer.release()
    return path


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A rendered clip: a camera that pans and zooms."""
    images = (render_field(camera, FIELD, rng=np.random.default_rng(0)) for camera in CAMERAS)
    return write(tmp_path_factory.mktemp("clip") / "clip.avi", images)


def worst_shift(curves, truth):
    """Largest distance, px, of the markings as the page draws them from where they are, whatever the field's size."""
    shifts = []
    for curve in curves:
        drawn, true = np.array(curve["points"]), truth.project(FIELD[curve["label"]].sample(0.05))
        shifts.append(np.max(np.min(np.linalg.norm(drawn[:, None] - true, axis=-1), axis=1)))
    return max(shifts)


def test_the_clip_follows_a_frame_that_was_mended(serve, window, clip, shoot):
    one = window(serve(clip))
    one.press(*["ArrowRight"] * 5)
    one.wait_for_frame(5)
    assert one.page.get_by_role("button", name="Solve the clip again").is_disabled()
    one.label_by_clicks(HAND, camera=CAMERAS[5])
    assert one.page.locator(".frame-row[aria-selected=true] .frame-hand").inner_text() == "by hand"

    one.page.get_by_role("button", name="Solve the clip again").click()
    one.page.get_by_role("progressbar", name="Solving the clip").wait_for()
    one.page.get_by_text("Solved again:").wait_for(timeout=8e3 * SECONDS)
    assert "frames would change" in one.text(".clip-words")
    one.page.get_by_role("button", name="Largest change").click()
    one.wait("() => document.querySelector('.picture-lines').dataset.frame !== '5'")
    one.page.locator(".legend-proposed").wait_for()
    shoot(one, "page-solved")
    one.page.get_by_role("button", name="Keep").click()
    one.page.get_by_text("mended by hand holds the clip").wait_for()
    one.page.get_by_role("button", name="Saved", exact=True).wait_for()  # keeping has saved the frame by hand too

    one.wait("() => document.querySelectorAll('.frame-row .verdict-good').length >= 12")
    shoot(one, "page-clip")
    shifts = [worst_shift(one.state(number)["curves"], CAMERAS[number]) for number in range(0, COUNT, 4)]
    assert max(shifts) < 3.0

    one.page.get_by_role("button", name="Undo Keep").click()
    one.page.get_by_text("Solved again:").wait_for()
    one.page.get_by_role("button", name="Save 1 frame").wait_for()
    one.page.get_by_role("button", name="Keep", exact=True).click()
    one.page.get_by_text("mended by hand holds the clip").wait_for()


def test_solving_is_cancelled(serve, window, clip):
    one = window(serve(clip))
    one.label_by_clicks(HAND, camera=CAMERAS[0])
    one.page.get_by_role("button", name="Solve the clip again").click()
    one.page.get_by_role("button", name="Cancel").click()
    one.page.get_by_role("button", name="Solve the clip again").wait_for()


def test_labels_of_the_previous_frame_are_copied(serve, window, clip):
    one = window(serve(clip))
    one.label_by_clicks(HAND, camera=CAMERAS[0])
    before = one.state(0)["marks"]
    one.press("ArrowRight")
    one.wait_for_frame(1)
    one.press("Shift+C")
    one.wait_for_revision(1)
    copied = one.state(1)["marks"]
    assert {mark["label"] for mark in copied} == {mark["label"] for mark in before}
    moved = np.mean([mark["x"] for mark in copied]) - np.mean([mark["x"] for mark in before])
    assert moved < -3.0  # the camera pans to the right, so the field moves to the left


def test_space_plays_and_stops(serve, window, clip):
    one = window(serve(clip))
    one.press("Space")
    one.page.get_by_role("button", name="Pause").wait_for()
    one.wait("() => Number(document.querySelector('.picture-lines').dataset.frame) > 2")
    one.press("Space")
    one.page.get_by_role("button", name="Play").wait_for()
    number = int(one.canvas.get_attribute("data-frame"))
    assert one.page.evaluate("location.hash") == f"#{number}"


def test_the_timeline_seeks_and_cuts_are_added_moved_and_joined(serve, window, clip):
    one = window(serve(clip))
    box = one.page.locator("canvas.timeline").bounding_box()
    left, width = 74.0 * 13.0 / 14.0, box["width"] - 86.0 * 13.0 / 14.0

    def at(number):
        return box["x"] + left + (number + 0.5) / COUNT * width, box["y"] + 60.0

    one.page.mouse.click(*at(10))
    one.wait_for_frame(10)
    one.press("Shift+K")
    one.wait_for_cuts([0, 10])
    assert one.page.get_by_role("button", name="A shot begins here").get_attribute("aria-pressed") == "true"

    one.page.mouse.move(*at(9.5))
    one.page.mouse.down()
    one.page.mouse.move(*at(14), steps=4)
    one.page.mouse.up()
    one.wait_for_cuts([0, 14])
    assert one.get("api/project")["cuts"] == [0, 14]

    one.page.mouse.click(*at(14))
    one.wait_for_frame(14)
    one.press("Shift+K")
    one.wait_for_cuts([0])
    assert one.get("api/project")["cuts"] == [0]
