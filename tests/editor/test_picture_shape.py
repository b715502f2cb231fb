"""Pictures whose pixels may not be square: the camera that follows from marks, as they are and as shown."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from fieldcalib import Camera, soccer
from fieldcalib.assess.findings import SHAPE, Verdict
from fieldcalib.draw.scene import render_field
from fieldcalib.editor.edit import Edit, Known
from fieldcalib.editor.fitting import mark_errors, pixels_in_picture
from fieldcalib.editor.frame import FrameEditor
from fieldcalib.editor.journal import edit_from_record, edit_to_record
from fieldcalib.problem.picture_shape import Crop, Placement
from fieldcalib.web.records import shown_aspect

FIELD, SHOWN = soccer(), (1280, 720)
TRUTH = Camera.from_angles(-0.32, 1.35, 0.0, 1750.0, (0.0, 66.0, -16.0), SHOWN, k=(-0.03, 0.0))
LABELS = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left", "Middle line")
SIZES = ((640, 640), (640, 480))


@pytest.fixture(scope="module")
def image():
    return render_field(TRUTH, FIELD, rng=np.random.default_rng(0))


def inside(xy, size):
    """Those of N pixels that lie in an image."""
    return xy[np.all((xy >= 0.0) & (xy <= np.subtract(size, 1.0)), axis=1)]


def squashed(image, size, labels=LABELS):
    """A picture squashed to a size, and pixels labelled in it by clicks of 1 px."""
    rng, camera = np.random.default_rng(1), TRUTH.scaled(size)
    pixels = {}
    for label in labels:
        xy = inside(camera.project(FIELD[label].sample(0.5)), size)
        border = min(5, len(xy) // 4)
        xy = xy[np.linspace(border, len(xy) - 1 - border, 4 if FIELD[label].is_arc else 3).round().astype(int)]
        pixels[label] = xy + rng.normal(0.0, 1.0, xy.shape)
    # not cv2.resize, which maps corners of pixels
    M = np.column_stack([np.diag(np.divide(size, SHOWN)), (0.0, 0.0)])
    blurred = cv2.GaussianBlur(image, (0, 0), 0.6)
    return cv2.warpAffine(blurred, M, size, flags=cv2.INTER_AREA), pixels


def error(calibration, size):
    """Largest distance on the ground in view, metres."""
    X = FIELD["Circle left"].sample(1.0)
    seen = TRUTH.scaled(size).project(X)
    return float(np.max(np.linalg.norm(calibration.required_camera.image_to_field(seen) - X, axis=1)))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("known", [Known(), Known(aspect=16 / 9), Known(aspect=16 / 9, focal_length=1750.0 / 2)])
def test_a_squashed_picture_becomes_good_by_its_labels(image, size, known):
    picture, pixels = squashed(image, size)
    found = FrameEditor.of(picture, FIELD, pixels, known).calibration
    assert (found.verdict, found.required_camera.image_size) == (Verdict.GOOD, size)
    assert shown_aspect(found.required_camera) == pytest.approx(16 / 9, rel=2e-3)
    assert error(found, size) < 0.15


def test_few_labels_leave_the_shape_open_until_it_is_said(image):
    size = (640, 480)
    picture, pixels = squashed(image, size, LABELS[:4])
    picture = np.full_like(picture, 90)  # no lines to be found
    open_, said = (FrameEditor.of(picture, FIELD, pixels, Known(aspect=one)).calibration for one in (None, 16 / 9))
    assert SHAPE in open_.findings
    assert SHAPE not in said.findings


@pytest.mark.parametrize("aspect", [pytest.param(None, marks=pytest.mark.slow), 16 / 9])
@pytest.mark.parametrize("labels", [("Side line left", "Big rect. left main"), ("Side line top", "Big rect. left top")])
def test_wrong_labels_do_not_become_good_by_the_shape(image, aspect, labels):
    picture, pixels = squashed(image, SIZES[0])
    first, second = labels
    pixels |= {first: pixels[second], second: pixels[first]}
    found = FrameEditor.of(picture, FIELD, pixels, Known(aspect=aspect)).calibration
    assert found.verdict != Verdict.GOOD or error(found, SIZES[0]) < 0.15


def test_a_wrong_shape_is_good_only_if_the_ground_is_right(image):
    picture, pixels = squashed(image, SIZES[0])
    found = FrameEditor.of(picture, FIELD, pixels, Known(aspect=1.0)).calibration
    assert shown_aspect(found.required_camera) == pytest.approx(1.0)
    assert found.verdict != Verdict.GOOD or error(found, SIZES[0]) < 0.3


def test_a_whole_frame_is_fitted_as_before(image):
    pixels = {label: inside(TRUTH.project(FIELD[label].sample(8.0)), SHOWN) for label in LABELS}
    editor = FrameEditor.of(image, FIELD, pixels)
    said = editor.know(aspect=16 / 9)
    assert editor.calibration.camera == said.calibration.camera
    assert editor.calibration.verdict == said.calibration.verdict == Verdict.GOOD


def test_the_next_mark_lies_on_its_marking_in_the_picture(image):
    picture, pixels = squashed(image, SIZES[0])
    editor = FrameEditor.of(picture, FIELD, pixels)
    found = editor.next_mark
    marked = replace(editor, history=editor.history.then(Edit())).mark(found.label, [found.xy], snap=False)
    assert np.all(mark_errors(FIELD, marked.marks, [editor.calibration.required_camera]) < 0.5)


def test_labels_of_a_squashed_frame_join_its_clip_in_its_pixels(image):
    picture, pixels = squashed(image, SIZES[0])
    found = FrameEditor.of(np.full_like(picture, 90), FIELD, pixels, Known(aspect=16 / 9)).calibration
    by_label = pixels_in_picture(found).by_label(0)
    assert {label: xy.round(6).tolist() for label, xy in by_label.items()} == {
        label: xy.round(6).tolist() for label, xy in pixels.items()
    }


def test_pixels_of_a_part_in_its_frame():
    part = TRUTH.cropped((200.0, 40.0), (800, 600)).scaled((400, 600))
    placement = Placement.of_cameras(part, TRUTH)
    assert placement == Placement((400, 600), (800, 600), Crop(SHOWN, (200, 40)))
    np.testing.assert_allclose(placement.to_frame((10.0, 20.0)), (220.0, 60.0), atol=1e-9)
    np.testing.assert_allclose(placement.to_picture(placement.to_frame((10.0, 20.0))), (10.0, 20.0), atol=1e-9)


@pytest.mark.parametrize("aspect", [0.0, -1.0, 9.0, float("nan"), "16:9", True, (16, 9)])
def test_what_is_no_aspect(aspect):
    with pytest.raises(ValueError, match="aspect must be the width / height"):
        Known(aspect=aspect)


def test_the_shape_is_in_the_journal():
    edit = Edit(known=Known(aspect=16 / 9))
    assert edit_from_record(edit_to_record(edit)) == edit
    older = edit_to_record(Edit())
    del older["known"]["aspect"]
    assert edit_from_record(older) == Edit()
