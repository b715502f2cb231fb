"""Detections of PnLCalib's networks: what is read, what is left out, where the keypoints are."""

import json

import numpy as np
import pytest

from fieldcalib.fields.segments import Point
from fieldcalib.fields.sports.soccer import CIRCLE_RADIUS, soccer
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.pnlcalib import KEYPOINTS, LINES, keypoint_field, keypoint_name, parse_detections
from fieldcalib.problem.labelled_pixels import check_segments, check_weights

SIZE = (1280, 720)
POINT = {"x": 0.25, "y": 0.5, "p": 0.6}
ENDS = {"x_1": 0.0, "y_1": 0.5, "p_1": 0.7, "x_2": 1.0, "y_2": 0.25, "p_2": 0.8}


def content(kp=None, lines=None):
    return json.dumps({"kp": kp or {}, "lines": lines or {}})


def test_points_and_lines_become_pixels_and_points_weigh_the_square_of_their_confidence():
    found = parse_detections(content({"51": POINT, "38": POINT | {"p": 0.5}}, {"8": ENDS}).encode(), SIZE)
    assert list(found.image_segments) == ["CENTER_MARK", "keypoint 38", "Goal left post left"]
    np.testing.assert_array_equal(found.image_segments["CENTER_MARK"], [(320.0, 360.0)])
    np.testing.assert_array_equal(found.image_segments["Goal left post left"], [(0.0, 360.0), (1280.0, 180.0)])
    assert found.weights == pytest.approx({"CENTER_MARK": 0.36, "keypoint 38": 0.25})


def test_points_that_were_not_detected_are_left_out():
    found = parse_detections(content({"51": POINT | {"p": 1.0}, "60": POINT | {"p": 1.0}, "61": POINT}), SIZE)
    assert found.image_segments == found.weights == {}


@pytest.mark.parametrize("size", [(105.0, 68.0), (100.0, 64.0)])
def test_keypoints_lie_where_their_names_and_tangents_say(size):
    field = keypoint_field(soccer(*size))
    assert all(isinstance(field[keypoint_name(id)], Point) for id in range(1, KEYPOINTS + 1))
    x_goal, y_side = size[0] / 2.0, size[1] / 2.0

    def X(id):
        return np.array(field[keypoint_name(id)].X)

    for ids, centre, seen_from in (
        ((37, 41), X(45), (X(5), X(25))),
        ((40, 44), X(57), (X(6), X(26))),
        ((38, 42), X(51), (X(2), X(29))),
        ((39, 43), X(51), (X(2), X(29))),
    ):
        for id, corner in zip(ids, seen_from, strict=True):
            radius = X(id) - centre
            assert np.linalg.norm(radius) == pytest.approx(CIRCLE_RADIUS)
            assert radius @ (X(id) - corner) == pytest.approx(0.0, abs=1e-9)
    assert X(1).tolist() == [-x_goal, -y_side, 0.0]
    assert X(47)[0] == pytest.approx(-x_goal + 11.0 + CIRCLE_RADIUS)
    assert X(56).tolist() == [x_goal - 16.5, 0.0, 0.0]


def test_ids_are_those_of_the_networks(shared_data):
    legend = json.loads((shared_data / "wc14-detections" / "legend.json").read_text())
    field = keypoint_field(soccer())
    for id, X in legend["keypoints_xyz_m"].items():
        if int(id) <= KEYPOINTS:
            np.testing.assert_allclose(field[keypoint_name(int(id))].X, X, atol=0.0101, err_msg=id)  # theirs in cm
    assert {int(id): label.strip() for id, label in legend["line_labels"].items()} == LINES
    assert keypoint_field(soccer()).length == 105.0


def test_every_frame_can_be_given_to_the_calibration(shared_data):
    field = keypoint_field(soccer())
    paths = [path for path in (shared_data / "wc14-detections").glob("*.json") if path.stem != "legend"]
    assert len(paths) == 93
    for path in paths:
        found = parse_detections(path.read_bytes(), SIZE)
        pixels, shares = check_weights(field, check_segments(field, found.image_segments, SIZE), found.weights)
        assert set(pixels) == set(shares) == set(found.image_segments)
        assert all(np.max(share) < 0.9**2 for label, share in shares.items() if len(pixels[label]) == 1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "expected a JSON object of keypoints and lines, got list"),
        ("{}", "expected an object 'kp' of detections by id, got None"),
        ('{"kp": {}}', "expected an object 'lines' of detections by id, got None"),
        (content({"0": POINT}), "'kp': expected ids from 1 to 73, got '0'"),
        (content({"74": POINT}), "'kp': expected ids from 1 to 73, got '74'"),
        (content({"a": POINT}), "'kp': expected ids from 1 to 73, got 'a'"),
        (content(lines={"24": ENDS}), "'lines': expected ids from 1 to 23, got '24'"),
        (content({"1": {"x": 0.5, "y": 0.5}}), "keypoint 1: expected numbers x, y, p, got"),
        (content({"1": 0.5}), "keypoint 1: expected numbers x, y, p, got 0.5"),
        (content(lines={"1": ENDS | {"x_2": "a"}}), "line 1: expected numbers x_2, y_2, p_2, got"),
        (content({"1": POINT | {"x": 320}}), r"keypoint 1: coordinates 320, 0.5 are not normalised to 0\.\.1"),
        (content({"1": POINT | {"y": float("nan")}}), r"keypoint 1: coordinates 0.25, nan are not normalised"),
        (content({"1": POINT | {"p": 1.5}}), r"keypoint 1: a confidence must lie in 0\.\.1, got 1\.5"),
        (content({"1": POINT | {"p": float("nan")}}), r"keypoint 1: a confidence must lie in 0\.\.1, got nan"),
    ],
)
def test_broken_files_are_refused(text, message):
    with pytest.raises(BrokenFileError, match=message):
        parse_detections(text, SIZE)
