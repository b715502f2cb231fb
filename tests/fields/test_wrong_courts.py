"""Pictures that do not show what they are searched for: refused with a reason, or right; never a wrong camera."""

from dataclasses import replace

import numpy as np
import pytest

from fieldcalib import Camera, calibrate_from_images, soccer
from fieldcalib.draw.scene import render_field
from fieldcalib.fields import tennis
from fieldcalib.fields.segments import Line

COURT = tennis()
VIEW = Camera.from_angles(1.5, 1.3, 0.0, 1100.0, (-32.0, 1.0, -10.0), (960, 540))
GRID = np.array([(x, y, 0.0) for x in np.linspace(-11.0, 11.0, 7) for y in np.linspace(-5.0, 5.0, 5)])
APART = np.array([0.0, 15.0, 0.0])  # metres from a court to the one beside it


def is_right(camera, truth=VIEW, moved=0.0):
    """Whether a camera sees the court within 3 px where it is, turned by 180 degrees or not."""
    seen = truth.project(GRID + moved)
    inside = np.all((seen > 0.0) & (seen < truth.image_size), axis=1)
    off = [np.linalg.norm(camera.project(GRID * turn) - seen, axis=1)[inside] for turn in ((1, 1, 1), (-1, -1, 1))]
    return min(np.max(one) for one in off) < 3.0


def shifted(field, moved):
    return {
        f"{label} beside": Line(tuple(segment.start + moved), tuple(segment.end + moved))
        for label, segment in field.markings.items()
        if isinstance(segment, Line)
    }


def found_in(picture, field=COURT):
    (found,) = calibrate_from_images(field, [picture])
    return found


def refused(found):
    """Whether a calibration is refused, and says why."""
    return not found.accepted and len(found.message) > 20


def test_a_pitch_is_no_court_of_tennis():
    view = Camera.from_angles(0.1, 1.35, 0.0, 1200.0, (0.0, 66.0, -16.0), (960, 540))
    assert refused(found_in(render_field(view, soccer())))


def test_of_two_courts_beside_each_other_one_is_found_or_none():
    both = replace(COURT, segments={**COURT.segments, **shifted(COURT, APART)}, stands=COURT.stands)
    found = found_in(render_field(VIEW, both))
    assert refused(found) or is_right(found.camera) or is_right(found.camera, moved=APART)


@pytest.mark.parametrize(
    "singles",
    [pytest.param(True, id="a court of singles"), pytest.param(False, id="half a court", marks=pytest.mark.slow)],
)
def test_a_court_that_lacks_lines_is_right_or_refused(singles):
    def is_there(label, segment):
        if singles:
            return not label.startswith("Side line")
        return "right" not in label and "Net" not in label

    kept = {label: segment for label, segment in COURT.segments.items() if is_there(label, segment)}
    found = found_in(render_field(VIEW, replace(COURT, segments=kept)))
    assert refused(found) or is_right(found.camera)


def test_a_mirrored_picture_of_a_court_is_one_of_a_mirrored_camera():
    """A court looks the same in a mirror: what is found is right, in a place that mirrors the true one."""
    mirrored = Camera.from_angles(-1.5 + np.pi, 1.3, 0.0, 1100.0, (-32.0, -1.0, -10.0), (960, 540))
    found = found_in(np.ascontiguousarray(render_field(VIEW, COURT)[:, ::-1]))
    assert refused(found) or is_right(found.camera, Camera(mirrored.K, mirror(VIEW.R), mirrored.C, (960, 540)))


def mirror(R):
    """The rotation of a camera whose picture is mirrored, on the other side of the axis of the court."""
    return np.diag([-1.0, 1.0, 1.0]) @ R @ np.diag([1.0, -1.0, 1.0])


def test_at_night_a_court_is_right_or_refused():
    dark = (0.12 * render_field(VIEW, COURT)).astype(np.uint8)
    found = found_in(dark)
    assert refused(found) or is_right(found.camera)
