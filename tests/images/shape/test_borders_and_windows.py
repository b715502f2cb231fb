"""Frames in windows of pictures and clips: found, calibrated there, and to be checked where there are several."""

from functools import partial

import cv2
import numpy as np
import pytest
from pictures import picture

from data_tools.pictures_in_pictures import WAYS, View, arranged, counts
from data_tools.simulated import observe
from fieldcalib import calibrate_from_segments, soccer
from fieldcalib.assess.findings import IN_WINDOW, SEVERAL_VIEWS, Status, Verdict, What
from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.clip.clip_shape import ShapeEstimator
from fieldcalib.images.from_images import How
from fieldcalib.images.shape.borders_and_windows import windows_of
from fieldcalib.images.shape.shape_of_picture import without_borders
from fieldcalib.io.image_files import size_of
from fieldcalib.solve.request import Task

FIELD, SIZE = soccer(size_known=True), (960, 540)
CAMERA = Camera.from_angles(0.3, 1.35, 0.0, 1300.0, (0.0, 62.0, -15.0), SIZE)
OTHER = Camera.from_angles(-0.4, 1.36, 0.0, 1700.0, (5.0, 70.0, -18.0), SIZE)
VIEWS = [View(picture(camera), camera, FIELD) for camera in (CAMERA, OTHER)]
HIDDEN = [name for name in WAYS if name.startswith(("split", "side", "0."))]
NOT_HIDDEN = [name for name in WAYS if name.startswith(("as", "inset", "zoom"))]


def shown(way, quality=85):
    made = arranged(VIEWS, WAYS[way], np.random.default_rng(0))
    image = cv2.imdecode(cv2.imencode(".jpg", made.image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)
    return image, made


def calibrated(truths, images):
    """Calibrations from labels of the true cameras, by the sizes of images; none of other sizes."""
    found = []
    for image in images:
        truth = truths.pop(size_of(image), None)
        if truth is None:
            found.append(Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "not asked for"))
            continue
        pixels = observe(truth, FIELD, np.random.default_rng(0), 0.3, (9, 9))
        found.append(calibrate_from_segments(FIELD, pixels, truth.image_size))
    return found


@pytest.mark.parametrize("way", HIDDEN)
def test_windows_are_found_to_a_few_pixels(way):
    image, made = shown(way)
    expected = sorted((x, y, x + w, y + h) for (x, y, w, h), _, _ in made.windows)
    found = windows_of(image)
    assert len(found) == len(expected)
    np.testing.assert_allclose(found, expected, atol=5)


@pytest.mark.parametrize("way", NOT_HIDDEN)
def test_a_frame_that_fills_the_picture_is_no_window(way):
    assert windows_of(shown(way)[0]) == []


def test_a_shrunken_frame_has_its_camera_in_pixels_of_the_whole_picture():
    image, made = shown("0.8 upper left, studio")
    ((_, truth, _),) = made.windows
    (window,) = windows_of(image)
    of_window = truth.cropped(window[:2], (window.right - window.left, window.bottom - window.top))
    (found,) = without_borders(partial(calibrated, {of_window.image_size: of_window}), [image])
    assert found.verdict is Verdict.GOOD
    assert found.camera.image_size == SIZE
    assert f"the picture is in {of_window.image_size[0]} x {of_window.image_size[1]}" in found.message
    np.testing.assert_allclose(found.camera.C, truth.C, atol=0.5)
    assert counts([found], [made])["good and wrong"] == 0


def test_of_a_split_screen_the_camera_is_of_one_view_and_to_be_checked():
    image, made = shown("split, two thirds")
    left, right = windows_of(image)
    truth = made.windows[0][1].cropped(left[:2], (left.right - left.left, left.bottom - left.top))
    (found,) = without_borders(partial(calibrated, {truth.image_size: truth}), [image])
    assert found.accepted
    assert SEVERAL_VIEWS in found.findings
    assert found.verdict is Verdict.CHECK
    assert found.has_finding(What.SEVERAL_VIEWS)
    counted = {"count": 1, "accepted": 1, "good": 0, "good and wrong": 0, "good and 1 m off": 0, "complain": 1}
    assert counts([found], [made]) == counted
    assert right.left > left.left


def test_a_camera_of_a_whole_picture_with_a_window_is_to_be_checked():
    image, _ = shown("0.8 upper left, studio")
    (found,) = without_borders(partial(calibrated, {SIZE: CAMERA}), [image])
    assert found.accepted
    assert found.verdict is Verdict.CHECK
    assert IN_WINDOW in found.findings
    (without,) = without_borders(partial(calibrated, {}), [image])
    assert without.verdict is Verdict.REJECT
    assert without.has_finding(What.IN_WINDOW)


class NoNetwork:
    """Sees nothing."""

    classes = ("background", "Middle line")

    def __call__(self, images):
        return np.zeros((len(images), 2, 90, 160), np.float32)


@pytest.mark.parametrize(("way", "views"), [("0.8 upper left, studio", 1), ("split, two thirds", 2)])
def test_a_clip_is_seen_in_its_window(way, views):
    image, made = shown(way)
    estimator = ShapeEstimator(How(Task(FIELD), NoNetwork(), estimate_aspect=False))
    shape = estimator.shape([image] * 24)
    x, y, w, h = made.windows[-1][0]
    np.testing.assert_allclose(shape.placement.corner, (-x, -y), atol=5)
    np.testing.assert_allclose(shape.placement.frame_size, (w, h), atol=8)
    assert shape.findings == (SEVERAL_VIEWS,) * (views - 1)
    assert estimator.shape([VIEWS[0].image] * 24) is None
