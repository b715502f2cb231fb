"""Pictures of the page for the docs, in the folder that FIELDCALIB_SCREENSHOTS names; one at 4K is only taken.

That of a clip is taken in test_page_clips.py, which solves one.

    FIELDCALIB_SCREENSHOTS=docs/images pytest -m browser tests/browser/test_page_screenshots.py
"""

import cv2
import numpy as np

from browser.driving import FIELD, along
from fieldcalib.draw.scene import render_field
from fieldcalib.geometry.camera import Camera


def test_a_picture_that_is_labelled(serve, window, picture, shoot):
    one = window(serve(picture))
    one.label_by_clicks()
    one.mark("Small rect. left main", along("Big rect. left main", count=4)[1:3] + (180.0, 90.0))
    shoot(one, "page-label")


def test_measurements_and_the_error_map(serve, window, picture, shoot):
    one = window(serve(picture))
    one.label_by_clicks()
    one.press("Shift+E", "2")
    one.click((1050.0, 700.0))
    one.press("3")
    one.drag((700.0, 850.0), (1250.0, 900.0))
    one.press("4")
    one.click((800.0, 560.0))
    one.page.locator(".measure-row", has_text="Offside").get_by_text("from the goal line").wait_for()
    shoot(one, "page-measure")


def test_the_keys(serve, window, picture, shoot):
    one = window(serve(picture))
    one.press("?")
    shoot(one, "page-keys")


def test_a_folder_of_pictures_and_a_4k_screen(serve, window, tmp_path, shoot):
    stand = (1.5, 66.0, -16.0)
    (folder := tmp_path / "pictures of a match").mkdir()
    for number, (pan, f) in enumerate([(-20, 1300), (-12, 1250), (0, 1100), (11, 1200), (19, 1350)]):
        camera = Camera.from_angles(*np.radians([pan, 77, 0.2]), f, stand, (960, 540))
        cv2.imwrite(str(folder / f"match-{number}.png"), render_field(camera, FIELD, rng=np.random.default_rng(number)))
    cv2.imwrite(str(folder / "match-5.png"), np.full((540, 960, 3), (60, 140, 60), np.uint8))
    server = serve(folder)
    one = window(server)
    one.wait("() => document.querySelectorAll('.frame-row .verdict-none').length === 0")
    one.press("ArrowRight")
    one.wait_for_frame(1)
    shoot(one, "page-folder")
    large = window(server, size=(3840, 2160))
    large.press("ArrowRight")
    large.wait_for_frame(1)
    shoot(large, "page-4k")
