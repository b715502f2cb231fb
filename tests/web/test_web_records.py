"""What the page and the report show of fields and calibrations."""

import json

import numpy as np
import pytest
from cv2 import pointPolygonTest

from fieldcalib import Camera, calibrate_from_segments, soccer
from fieldcalib.assess.findings import Status
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.catalogue import FIELDS
from fieldcalib.fields.catalogue import field as field_by_name
from fieldcalib.web.records import (
    calibration_record,
    curves_of,
    field_record,
    horizon_of,
    short_keys,
    view_of,
)

SIZE = (960, 540)
LABELS = (
    "Side line top",
    "Side line right",
    "Big rect. right main",
    "Big rect. right top",
    "Big rect. right bottom",
    "Small rect. right main",
    "Goal right post left",
    "Circle right",
)
LENS = (0.05, 0.0, 0.0, 0.0, 0.0)


def a_camera(tilt: float = 78.0, dist: tuple[float, ...] = LENS) -> Camera:
    camera = Camera.from_angles(0.3, np.radians(tilt), 0.01, 1300.0, (2.0, 66.0, -16.0), SIZE)
    return Camera(camera.K, camera.R, camera.C, SIZE, np.array(dist))


def calibrated() -> Calibration:
    truth = a_camera()
    pixels = {}
    for label in LABELS:
        xy = truth.project(soccer()[label].sample(2.0))
        pixels[label] = xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)]
    return calibrate_from_segments(soccer(size_known=True), pixels, SIZE)


@pytest.mark.parametrize("name", list(FIELDS))
def test_every_field_has_one_key_of_one_or_two_letters_for_each_segment(name):
    record = field_record(field_by_name(name))
    keys = [one["key"] for one in record["segments"]]
    assert len(set(keys)) == len(keys) == len(field_by_name(name))
    assert max(map(len, keys)) <= 2
    assert all(len(one["points"]) == 1 for one in record["segments"] if one["kind"] == "point")
    json.dumps(record, allow_nan=False)


def test_labels_alike_and_without_letters_have_keys():
    keys = short_keys(["12 + 3", "line", "line 2", "<script>", *(f"line {n}" for n in range(3, 90))])
    assert len(set(keys.values())) == len(keys)


def test_the_view_is_the_ground_that_the_camera_sees():
    camera, field = a_camera(), soccer()
    polygon = np.array(view_of(camera, field), dtype=np.float32)
    x, y = np.meshgrid(np.linspace(-60.0, 60.0, 40), np.linspace(-40.0, 40.0, 30))
    X = np.stack([x, y, 0.0 * x], axis=-1).reshape(-1, 3)
    xy = camera.project(X)
    margin = 3.0  # px: the polygon has corners, the border of the image has none
    inside = np.all((xy > margin) & (xy < np.array(SIZE) - 1.0 - margin), axis=1)
    outside = ~np.all((xy > -margin) & (xy < np.array(SIZE) + margin), axis=1)
    seen = np.array([pointPolygonTest(polygon, (float(a), float(b)), False) >= 0 for a, b, _ in X])
    assert inside.sum() > 100
    assert seen[inside].all()
    assert not seen[outside].any()


def test_a_view_with_the_horizon_ends_two_diagonals_away():
    camera = a_camera(tilt=88.0)
    away = np.linalg.norm(np.array(view_of(camera, soccer())) - camera.C[:2], axis=1)
    assert away.max() == pytest.approx(2.0 * np.hypot(105.0, 68.0), abs=0.1)


def test_a_camera_that_looks_up_or_stands_below_the_ground_sees_none():
    below = Camera.from_angles(0.0, 1.3, 0.0, 1300.0, (2.0, 66.0, 3.0), SIZE)
    assert view_of(a_camera(tilt=120.0), soccer()) == view_of(below, soccer()) == []


def test_the_horizon_is_where_distant_ground_is():
    camera = a_camera(tilt=86.0)
    horizon = np.array(horizon_of(camera))
    far = camera.project(np.array([[5e4 * np.sin(0.3 + turn), -5e4 * np.cos(0.3 + turn), 0.0] for turn in (-0.2, 0.2)]))
    y = np.interp(far[:, 0], horizon[:, 0], horizon[:, 1])
    assert y == pytest.approx(far[:, 1], abs=0.7)
    assert horizon_of(a_camera(tilt=60.0)) is None


def test_curves_say_where_paint_lies():
    marks = [
        MarkingInView("Side line right", 400.0, 30, 0.9, 0.0),
        MarkingInView("Side line top", 400.0, 30, 0.1, 9.0),
        MarkingInView("Big rect. right top", 400.0, 30, 0.0, 0.0),
    ]
    states = {one["label"]: one["state"] for one in curves_of(a_camera(), soccer(), marks)}
    assert states["Side line right"] == "paint"
    assert states["Side line top"] == "beside"
    assert states["Big rect. right top"] == "unseen"
    assert states["Big rect. right main"] == "plain"
    assert "Side line left" not in states  # out of view


@pytest.mark.parametrize(("share", "off", "state"), [(0.9, 0.0, "paint"), (0.1, 9.0, "beside"), (0.0, 0.0, "unseen")])
def test_the_halves_of_the_centre_circle_are_coloured_as_the_circle(share, off, state):
    middle = Camera.from_angles(0.0, 1.3, 0.0, 1300.0, (0.0, 66.0, -16.0), SIZE)
    marks = [MarkingInView("Circle central", 400.0, 30, share, off)]
    states = {one["label"]: one["state"] for one in curves_of(middle, soccer(), marks)}
    circles = ("Circle central", "Circle central left", "Circle central right")
    assert {label: states[label] for label in circles} == dict.fromkeys(circles, state)
    assert states["Middle line"] == "plain"


def test_the_record_of_a_calibration_is_json_and_has_its_camera():
    found = calibrated()
    record = json.loads(json.dumps(calibration_record(found, soccer()), allow_nan=False))
    assert found.camera is not None
    assert record["camera"]["focal_length"] == pytest.approx(found.camera.focal_length)
    assert record["camera"]["pan"] == pytest.approx(np.degrees(found.camera.angles[0]))
    assert record["camera"]["sd"]["focal_length"] > 0.0
    assert record["verdict"] == str(found.verdict)
    assert record["probability"]["metres"] == 1.0
    assert len(record["view"]) > 20


def test_a_frame_without_a_camera_has_its_reason():
    found = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")
    record = calibration_record(found, soccer())
    assert record["camera"] is record["horizon"] is None
    assert (record["curves"], record["view"]) == ([], [])
    assert record["reason"] == "no labelled pixels"
    assert "choose a marking on the map" in record["here"]
    assert "--" not in record["here"] + record["remedy"]
    assert "labelled by hand" in record["remedy"]


def labelled(*labels, camera=None):
    seen = {label: (camera or a_camera()).project(soccer()[label].sample(4.0)) for label in labels}
    return {label: xy[((xy >= 0.0) & (xy < SIZE)).all(axis=1)] for label, xy in seen.items()}


@pytest.mark.parametrize(("count", "more"), [(1, 3), (2, 2), (3, 1), (4, None)])
def test_how_many_markings_are_missing_while_labelling_begins(count, more):
    """A line gives two equations, and seven numbers are estimated."""
    found = calibrate_from_segments(soccer(), labelled(*LABELS[:count]), SIZE)
    assert calibration_record(found, soccer())["more"] == more


def test_a_wrong_label_is_told_once_with_one_number():
    pixels = labelled(*LABELS) | {"Middle line": [(480.0, 100.0), (470.0, 500.0)]}
    found = calibrate_from_segments(soccer(), pixels, SIZE)
    (wrong,) = found.suspect_labels
    reason = calibration_record(found, soccer())["reason"]
    assert reason.count("Middle line") == 1
    assert f"'Middle line' lies {wrong.error_px:.0f} px off" in reason
    assert "labels lie" not in reason
