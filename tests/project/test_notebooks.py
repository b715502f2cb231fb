"""What results and fields show in notebooks: a picture, the verdict, and at most ten rows."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

import fieldcalib
from data_tools.simulated import IMAGE_SIZE, observe, pan_over_field
from fieldcalib import Calibration, Camera, SegmentationNetwork, Status, calibrate_sequence, soccer
from fieldcalib.assess.video import Shot, VideoCalibration
from fieldcalib.fields.catalogue import FIELDS
from fieldcalib.solve import FieldSize

FIELD = soccer()
EVIL = '<img src=x onerror="alert(1)">'


@pytest.fixture(scope="module")
def sequence():
    cameras = [camera for camera in pan_over_field(60)[20:34] for _ in range(1)]
    rng = np.random.default_rng(0)
    return calibrate_sequence(FIELD, [observe(camera, FIELD, rng, 0.5) for camera in cameras], IMAGE_SIZE)


def svg_of(html):
    return ElementTree.fromstring(re.search(r"<svg.*?</svg>", html).group())


def points(element):
    return np.array([pair.split(",") for pair in element.get("points").split()], dtype=float)


@pytest.mark.parametrize("name", FIELDS)
def test_fields_show_their_markings(name):
    field = fieldcalib.field(name)
    html = field._repr_html_()
    lines = [points(one) for one in svg_of(html).iter("{http://www.w3.org/2000/svg}polyline")]
    assert len(lines) == sum(segment.is_curve for segment in field.markings.values())
    assert html.count("<tr>") <= 2 + 1 + 10
    assert len(repr(field)) < 80


def test_the_ground_in_view_is_shown():
    camera = Camera.from_angles(0.1, np.radians(70), 0.0, 1500.0, (0, 60, -16), IMAGE_SIZE, k=(0.02, 0.0))
    (view,) = svg_of(FIELD.as_svg([camera])).iter("{http://www.w3.org/2000/svg}polygon")
    corners = camera.image_to_field([(0, 0), (959, 0), (959, 539), (0, 539)])[:, :2]
    for corner in corners:
        assert np.linalg.norm(points(view) - corner, axis=1).min() < 0.01


@pytest.mark.parametrize("tilt", [90.0, 120.0, 170.0])
def test_beyond_the_horizon_nothing_is_drawn(tilt):
    camera = Camera.from_angles(0.0, np.radians(tilt), 0.0, 900.0, (0, 60, -16), IMAGE_SIZE)
    for view in svg_of(FIELD.as_svg([camera])).iter("{http://www.w3.org/2000/svg}polygon"):
        assert np.abs(points(view)).max() < 4.5 * 126


def test_a_calibration_shows_the_field_and_its_verdict(sequence):
    html = sequence[0]._repr_html_()
    svg_of(html)
    assert str(sequence[0].verdict) in html
    assert f"{sequence[0].camera.focal_length:.1f} px" in html


def test_names_are_escaped():
    nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, EVIL)
    results = fieldcalib.calibrate({EVIL: {}}, image_size=IMAGE_SIZE, progress=False)
    field = fieldcalib.Field(20.0, 10.0, {EVIL: fieldcalib.Line((0, 0, 0), (1, 0, 0))})
    for shown in (nothing, results, field):
        assert "<img src=x" not in shown._repr_html_()


def test_sequences_and_videos_show_ten_frames(sequence):
    count = len(sequence)
    video = VideoCalibration((sequence,), (Shot(0, count, 0),), np.zeros(count, int), np.arange(count))
    for shown in (sequence, video):
        html = shown._repr_html_()
        assert len(list(svg_of(html).iter("{http://www.w3.org/2000/svg}polygon"))) == 10
        assert html.count("<tr>") == 1 + 10
        assert f"10 of {count} rows" in html
    assert "rows</p>" not in sequence[:3]._repr_html_()


def test_results_show_ten_frames_and_broken_files(tmp_path):
    rng = np.random.default_rng(0)
    labels = {f"{k:02d}": observe(camera, FIELD, rng, 0.5) for k, camera in enumerate(pan_over_field(12))}
    html = fieldcalib.calibrate(labels, image_size=IMAGE_SIZE, progress=False)._repr_html_()
    assert "10 of 12 rows" in html
    assert "data:image/jpeg" in html


def test_other_results():
    camera = Camera.from_angles(0.1, np.radians(70), 0.0, 1500.0, (0, 60, -16), IMAGE_SIZE, k=(0.2, 0.0))
    assert "1500.0 px" in camera._repr_html_()
    found = fieldcalib.fields.field_homography(camera, FIELD)
    assert f"{found.largest_px:.2f} px" in found._repr_html_()
    size = FieldSize(FIELD, np.diag([0.25, 0.01]), np.array([0.9, 0.2]), ())._repr_html_()
    assert "105.00 ± 0.50 m, 90% from the labels" in size
    svg_of(size)


def test_the_repr_of_a_network_is_short():
    assert repr(SegmentationNetwork.load()) == "SegmentationNetwork(27 classes, 320 x 192 px, the one of the package)"
