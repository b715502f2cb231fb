"""The width of paint in a picture tells a smaller field with the same markings from the one that was declared."""

from dataclasses import asdict, replace
from functools import cache

import cv2
import numpy as np
import pytest

from data_tools.smaller_pitches import SIZE, frames
from data_tools.synthetic.film import clip_frames
from fieldcalib import Camera, Tracker, calibrate_from_segments, calibrate_video, soccer
from fieldcalib.assess.advice import SMALLER
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.paint_in_view import TOO_WIDE, MarkingInView, paint_findings, paint_width
from fieldcalib.draw.scene import render_field
from fieldcalib.images import refine_on_image
from fieldcalib.images.paint.line_profiles import Markings, profiles_along
from fieldcalib.images.paint.paint_evidence import paint_evidence, paint_widths, widths_by_marking, with_extents

CAMERA = Camera.from_angles(0.3, 1.36, 0.0, 3200.0, (0.0, 66.0, -16.0), (1920, 1080))
MARKINGS = Markings.of(soccer())


@cache
def picture(share):
    """What a camera sees of a pitch of a share of the usual size: the same, but for lines that look wider."""
    field = soccer()
    image = render_field(CAMERA, replace(field, lines=replace(field.lines, width=field.lines.width / share)))
    image.flags.writeable = False
    return image


def seen(image, camera=CAMERA):
    profiles = profiles_along(camera, MARKINGS)
    return with_extents(
        paint_evidence(image, profiles, MARKINGS).markings, widths_by_marking(image, profiles, MARKINGS)
    )


@pytest.mark.parametrize("share", [1.0, *(pytest.param(share, marks=pytest.mark.slow) for share in (0.8, 0.6, 0.5))])
def test_the_width_is_that_of_the_paint(share):
    assert paint_width(seen(picture(share))) == pytest.approx(1.0 / share, rel=0.1)
    assert (paint_width(seen(picture(share))) > TOO_WIDE) == (share < 0.7)


@pytest.mark.parametrize("times", [1.6, 2.4])
def test_a_moving_camera_widens_no_paint(times):
    """Lines that are blurred across to a multiple of their width have edges as long as they are wide."""
    width = np.median([one.width for one in seen(picture(1.0)) if one.widths])
    profiles = profiles_along(CAMERA, MARKINGS)
    upright = np.abs(profiles.normal[:, 0]) > 0.7
    length = round(times * width * float(np.median(profiles.width[upright])))
    moved = cv2.blur(picture(1.0), (length, 1))
    assert not (paint_width(seen(moved)) > TOO_WIDE)
    across = profiles.take(np.flatnonzero(upright & (profiles.width > 3.0) & (profiles.width < length / 1.4)))
    assert len(across) > 5
    assert np.all(np.isnan(paint_widths(moved, across)))


def test_soft_pictures_tell_nothing():
    soft = cv2.GaussianBlur(picture(1.0), (0, 0), 4.0)
    assert not any(one.widths for one in seen(soft))


def test_lines_that_are_too_wide_are_a_doubt():
    labels = ("Side line top", "Side line right", "Big rect. right main", "Circle right")
    pixels = {label: CAMERA.project(soccer()[label].sample(9.0)) for label in labels}
    start = calibrate_from_segments(soccer(), pixels, CAMERA.image_size)
    right, small = (refine_on_image(soccer(), picture(share), start) for share in (1.0, 0.6))
    assert right.verdict is Verdict.GOOD
    assert small.verdict is Verdict.CHECK
    assert small.reason.startswith("the lines are 1.7 times as wide as the field's")
    assert small.remedy == SMALLER.text


def test_a_few_places_are_no_evidence():
    wide = MarkingInView("Middle line", 300.0, 25, 1.0, 0.0, width=1.7, widths=5)
    assert paint_findings([wide]) == ()
    assert len(paint_findings([wide, replace(wide, label="Side line top", widths=1)])) == 1
    right = replace(wide, label="Side line top", width=1.0, widths=6)
    assert paint_findings([wide, right]) == ()


@pytest.mark.slow
def test_a_rendered_smaller_pitch_has_wider_lines():
    camera = clip_frames(2, 1, image_size=SIZE)[0].camera
    usual, small = (paint_width(seen(frames(2, share, 1)[0], camera)) for share in (1.0, 0.6))
    assert small / usual == pytest.approx(1.0 / 0.6, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("share", [1.0, 0.6])
def test_clips_of_smaller_pitches_are_doubted(share):
    images = frames(2, share, 10)
    together = calibrate_video(soccer(), images)
    with Tracker(soccer(), wait=True) as tracker:
        one_by_one = [tracker.update(image) for image in images]
    for found in (list(together), [one for one in one_by_one if one.camera is not None]):
        assert len(found) > 5
        assert all((paint_width(one.markings) > TOO_WIDE) == (share < 1.0) for one in found)
        assert share == 1.0 or not any(one.verdict is Verdict.GOOD for one in found)


@pytest.mark.parametrize("value", [None, "x", [], -1, np.nan, 10**400, {}])
@pytest.mark.parametrize(
    "name", ["label", "length", "places", "share", "offset", "is_expected", "is_bent", "width", "widths"]
)
def test_evidence_of_wrong_types_is_told(name, value):
    """It may come from a file, in which a number of places may be anything."""
    record = asdict(MarkingInView("Middle line", 300.0, 25, share=0.9, offset=0.0))
    if (name, value) != ("label", "x"):
        with pytest.raises(ValueError, match=f"{name}|expected"):
            MarkingInView(**record | {name: value})
