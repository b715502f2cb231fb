"""The paper's baselines from homographies: DLT lines, and homography decomposition."""

import numpy as np
import pytest
from objects import without_focal_length
from synthetic import observe, whole_circle_markings

from baselines import dlt_lines, hdecomp
from fieldcalib import Camera, Line, Status, soccer
from fieldcalib.geometry import ALIGNMENTS
from fieldcalib.geometry.homography import dehomogenize, homogenize
from fieldcalib.io.soccernet import parse_annotation
from fieldcalib.problem.labelled_pixels import check_segments

FIELD, SIZE = soccer(), (960, 540)
CAMERA = Camera.from_angles(-0.4, 1.35, 0.01, 1200.0, (0.0, 65.0, -15.0), SIZE)
FRAME = observe(whole_circle_markings(FIELD), CAMERA)
CIRCLES = {label: xy for label, xy in FRAME.items() if label.startswith("Circle")}


def test_dlt_lines_without_noise_is_the_cameras_homography():
    H = dlt_lines.homographies(FIELD, [FRAME, CIRCLES, FRAME], SIZE)
    assert H[1] is None
    X = CAMERA.image_to_field([(100.0, 500.0), (480.0, 270.0), (900.0, 400.0)])
    for t in (0, 2):
        np.testing.assert_allclose(dehomogenize(homogenize(X[:, :2]) @ H[t].T), CAMERA.project(X), atol=1e-4)


def test_only_lines_on_the_ground_count():
    spoilt = {label: xy + (100.0 if "Circle" in label or "Goal" in label else 0.0) for label, xy in FRAME.items()}
    assert any("Goal" in label for label in spoilt)
    H = dlt_lines.homographies(FIELD, [FRAME, spoilt], SIZE)
    np.testing.assert_allclose(H[1], H[0], rtol=1e-6)


def test_lines_of_which_all_but_one_meet_in_a_point_leave_the_homography_open():
    """With noise the three do not meet in the image, and only a map of the plane to a line fits."""
    ends = [(30.0, 0.0), (20.0, 20.0), (-20.0, 20.0)]
    lines = {f"through the centre {i}": Line((-x, -y, 0.0), (x, y, 0.0)) for i, (x, y) in enumerate(ends)}
    lines["beside"] = Line((-30.0, -15.0, 0.0), (30.0, -15.0, 0.0))
    more = {**lines, "beside too": Line((-15.0, -15.0, 0.0), (-15.0, 30.0, 0.0))}
    rng = np.random.default_rng(0)
    for segments in (lines, more):
        frames = [observe(segments, CAMERA, rng, noise=5.0) for _ in range(100)]
        assert {len(frame) for frame in frames} == {len(segments)}
        found = [H is not None for H in dlt_lines.homographies(more, frames, SIZE)]
        assert np.mean(found) < 0.3 if segments is lines else all(found)  # rounding hides some


def closed_forms(frames):
    return dlt_lines.calibrate(dlt_lines.homographies(FIELD, frames, SIZE), FIELD, frames, SIZE)


def test_no_frames():
    assert dlt_lines.homographies(FIELD, [], SIZE) == closed_forms([]) == hdecomp.calibrate([], SIZE) == []


def test_closed_form_cameras():
    found, none = closed_forms([FRAME, CIRCLES])
    assert found.accepted
    assert found.camera.focal_length == pytest.approx(1200.0, rel=1e-4)
    np.testing.assert_allclose(found.camera.C, CAMERA.C, atol=0.01)
    assert list(found.per_segment_errors) == list(FRAME)
    assert found.rms < 0.05
    assert (none.camera, none.status) == (None, Status.TOO_FEW_SEGMENTS)


def test_closed_form_cameras_are_those_of_a_stadium():
    rolled = Camera.from_angles(-0.4, 1.35, np.radians(60.0), 1200.0, CAMERA.C, SIZE)
    (found,) = closed_forms([observe(whole_circle_markings(FIELD), rolled)])
    assert found.status is Status.IMPLAUSIBLE
    assert "rolled by more than 45 degrees" in found.message


def test_errors_are_those_of_the_labels():
    shifted = {**FRAME, "Circle left": FRAME["Circle left"] + (0.0, 40.0)}
    (found,) = closed_forms([shifted])
    errors = found.per_segment_errors
    assert 10.0 < errors["Circle left"] <= 40.0
    assert max(error for label, error in errors.items() if label != "Circle left") < 0.05
    share = len(shifted["Circle left"]) / sum(len(xy) for xy in shifted.values())
    assert found.rms == pytest.approx(errors["Circle left"] * np.sqrt(share), rel=1e-3)


def test_a_homography_of_no_camera_has_no_closed_form():
    T = np.array([[1.0, 0, 480], [0, 1, 270], [0, 0, 1]])
    (found,) = dlt_lines.calibrate([T @ without_focal_length()], FIELD, [FRAME], SIZE)
    assert (found.camera, found.status) == (None, Status.IMPLAUSIBLE)
    assert "no real focal length" in found.message


def test_hdecomp_withholds_what_the_paper_rejects():
    nowhere = Camera.from_angles(0.2, 1.36, 0.0, 12000.0, (1.5, 68.0, -17.0), SIZE).homography
    T = np.array([[1.0, 0, 480], [0, 1, 270], [0, 0, 1]])
    calibrations = hdecomp.calibrate([CAMERA.homography, None, nowhere, T @ without_focal_length()], SIZE)
    assert [calibration.camera is None for calibration in calibrations] == [False, True, True, True]
    assert [calibration.status for calibration in calibrations] == [
        Status.ACCEPTED,
        Status.TOO_FEW_SEGMENTS,
        Status.IMPLAUSIBLE,
        Status.IMPLAUSIBLE,
    ]
    np.testing.assert_allclose(calibrations[0].camera.C, CAMERA.C, atol=1e-4)


def test_zeta_and_tolerance_reach_the_decomposition():
    H = CAMERA.homography * (1.0 + 0.01 * np.random.default_rng(3).normal(size=(3, 3)))
    counts = [
        len(hdecomp.calibrate([H], SIZE, **options)[0].per_segment_errors)
        for options in ({}, {"tolerance": 0.0}, {"zeta": 0.01})
    ]
    assert counts[0] > counts[1] > counts[2]


def test_wc14(shared_data):
    """Refinement makes good for most of what the closed form is off; annotated homographies all have a camera."""
    size, paths = (1280, 720), sorted((shared_data / "wc14-test").glob("*.homographyMatrix"))[:40]
    frames = [
        check_segments(FIELD, parse_annotation(path.with_suffix(".json").read_bytes(), size), size) for path in paths
    ]
    annotated = hdecomp.calibrate([ALIGNMENTS["wc14"].to_fieldcalib(np.loadtxt(path)) for path in paths], size)
    assert all(calibration.camera is not None for calibration in annotated)
    assert np.median([calibration.rms for calibration in annotated]) < 10.0
    refined = hdecomp.calibrate(dlt_lines.homographies(FIELD, frames, size), size)
    assert np.mean([calibration.camera is not None for calibration in refined]) > 0.7
