"""TVCalib's per_sample_output.json."""

import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import cameras, unchecked_cameras
from synthetic import visible_field_points

from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import dehomogenize, homogenize
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.soccernet import camera_to_record
from fieldcalib.io.tvcalib import TVCalibRecord, format_per_sample_output, parse_per_sample_output

NUMBERS = ("loss_ndc_total", "loss_ndc_lines", "loss_ndc_circles", "time_s")
CAMERA = Camera.from_angles(0.2, 1.3, 0.01, 1500.0, (2.0, 60.0, -15.0), (960, 540), k=(0.1, -0.02))

numbers = st.none() | st.floats(0.0, 1e6, allow_subnormal=False)
ids = st.lists(st.sampled_from("0123456789abc_-. é"), min_size=1).map("".join).filter(lambda id: id not in (".", ".."))
records = st.builds(TVCalibRecord, ids, st.none() | unchecked_cameras() | cameras(), st.none(), *[numbers] * 4)


@given(written=st.lists(records, max_size=5))
def test_records_come_back(written):
    found = parse_per_sample_output(format_per_sample_output(written))
    assert len(found) == len(written)
    for record, expected in zip(found, written, strict=True):
        assert record.id == expected.id
        assert [getattr(record, name) for name in NUMBERS] == [getattr(expected, name) for name in NUMBERS]
        assert (record.camera is None) == (expected.camera is None)
        if expected.camera is not None:
            assert not record.camera.checked
            assert record.camera.image_size == expected.camera.image_size
            for name in ("K", "C", "dist"):
                np.testing.assert_array_equal(getattr(record.camera, name), getattr(expected.camera, name))
            np.testing.assert_allclose(record.camera.R, expected.camera.R, atol=1e-12)


@given(camera=cameras(lens=False))
def test_homographies_come_back(camera):
    (found,) = parse_per_sample_output(
        format_per_sample_output([TVCalibRecord("1", homography=camera.pinhole_homography)])
    )
    X = visible_field_points(camera)
    xy = dehomogenize(homogenize(X[:, :2]) @ found.homography.T)
    np.testing.assert_allclose(xy, camera.project(X), rtol=0, atol=1e-6)
    assert found.camera is None


def test_a_homography_that_is_not_finite_is_none():
    (found,) = parse_per_sample_output(line(homography=[[1, 2, None], [2, 4, 6], [0, 0, 1]]))
    assert found.homography is None
    assert found.camera is not None


@pytest.mark.parametrize("camera", [None, Camera.from_angles(0.2, 1.3, 0.0, 900.0, (0.0, 60.0, -15.0), (640, 360))])
def test_the_size_of_the_image_comes_back(camera):
    (found,) = parse_per_sample_output(format_per_sample_output([TVCalibRecord("1", camera, image_size=(640, 360))]))
    assert found.image_size == (640, 360)


def test_broken_lines_can_be_collected():
    broken = []
    found = parse_per_sample_output(f"{line()}\n7\n\n{line()}\n[]\n", broken=broken)
    assert len(found) == 2
    assert [message.split(":")[0] for message in broken] == ["line 2", "line 5"]


def line(**changes):
    (text,) = format_per_sample_output(
        [TVCalibRecord("00001", CAMERA, CAMERA.pinhole_homography, 0.012, 0.01, 0.002, 0.3)]
    ).splitlines()
    return json.dumps({**json.loads(text), **changes})


def test_what_a_line_holds():
    found = json.loads(line())
    assert found["image_ids"] == "00001.jpg"
    assert found["aov_radian"] == pytest.approx(CAMERA.field_of_view)
    assert found["aov_degrees"] == pytest.approx(np.degrees(CAMERA.field_of_view))
    assert {key: found[key] for key in camera_to_record(CAMERA)} == camera_to_record(CAMERA)
    assert (found["image_width"], found["image_height"]) == (960, 540)
    # image -> field
    pinhole = Camera(CAMERA.K, CAMERA.R, CAMERA.C, CAMERA.image_size)
    X, Y, W = found["homography"] @ np.array([*pinhole.project((10.0, 5.0, 0.0)), 1.0])
    np.testing.assert_allclose((X / W, Y / W), (10.0, 5.0))


@given(camera=unchecked_cameras())
def test_the_angle_of_view_gives_the_focal_length(camera):
    found = json.loads(format_per_sample_output([TVCalibRecord("1", camera)]))
    assert 0.5 * camera.image_size[0] / np.tan(0.5 * found["aov_radian"]) == pytest.approx(camera.K[0, 0])
    assert 0.0 < found["aov_radian"] < 2.0 * np.pi


def test_no_focal_length_is_half_a_turn():
    camera = Camera(np.diag([0.0, 0.0, 1.0]), np.eye(3), np.zeros(3), (960, 540), checked=False)
    assert json.loads(format_per_sample_output([TVCalibRecord("1", camera)]))["aov_degrees"] == 180.0


def deeper(value):
    """Every value but names and sizes one list deeper, as of a batch with one time step."""
    return {key: v if key.startswith("image_w") or key.startswith("image_h") else [v] for key, v in value.items()}


def test_values_of_one_time_step_may_lie_deeper():
    flat, nested = parse_per_sample_output(line() + "\n" + json.dumps(deeper(json.loads(line()))))
    assert flat.id == nested.id == "00001"
    for name in ("K", "R", "C", "dist"):
        np.testing.assert_array_equal(getattr(nested.camera, name), getattr(flat.camera, name))
    np.testing.assert_array_equal(nested.homography, flat.homography)
    assert [getattr(nested, name) for name in NUMBERS] == [0.012, 0.01, 0.002, 0.3]


def test_the_size_of_the_image():
    without = {key: value for key, value in json.loads(line()).items() if not key.startswith("image_") or "ids" in key}
    assert parse_per_sample_output(json.dumps(without))[0].camera.image_size == (960, 540)
    assert parse_per_sample_output(line(image_width=1920, image_height=1080))[0].camera.image_size == (1920, 1080)


def test_records_of_homographies_alone_and_of_failures():
    only_homography = '{"image_ids": "a/7.jpg", "homography": [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 1]]}'
    failed = (
        '{"image_ids": "8.png", "pan_degrees": null, "homography": null, "loss_ndc_total": NaN, "mask_lines": [[1]]}'
    )
    seven, eight = parse_per_sample_output(f"\n{only_homography}\r\n\n{failed}")
    assert (seven.id, seven.camera, seven.loss_ndc_total) == ("7", None, None)
    np.testing.assert_allclose(seven.homography, np.diag([10.0, 10.0, 1.0]))
    assert (eight.id, eight.camera, eight.homography, eight.loss_ndc_total) == ("8", None, None, None)


def test_absurd_cameras_are_read():
    (found,) = parse_per_sample_output(line(x_focal_length=-2.0, radial_distortion=[-1e6, 0, 0, 0, 0, 0]))
    assert found.camera.K[0, 0] == -2.0


@pytest.mark.parametrize("content", ["", "\n \n", b"", "\ufeff".encode()])
def test_an_empty_file_has_no_records(content):
    assert parse_per_sample_output(content) == []
    assert format_per_sample_output([]) == ""


def without(key):
    return json.dumps({k: v for k, v in json.loads(line()).items() if k != key})


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        ("{", "is no JSON: "),
        ("[" * 100_000, "is no JSON: "),
        ("[1, 2]", "expected a JSON object of a record, got list"),
        (without("image_ids"), 'expected "image_ids": "<id>.jpg", got None'),
        (line(image_ids=["1.jpg", "2.jpg"]), 'expected "image_ids": "<id>.jpg", got [\'1.jpg\''),
        (line(image_ids=""), 'expected "image_ids": "<id>.jpg", got \'\''),
        (line(pan_degrees="left"), "'pan_degrees': expected a number, got 'left'"),
        (line(pan_degrees=[1.0, 2.0]), "'pan_degrees': expected a number of one time step, got shape (2,)"),
        (line(position_meters=3.0), "'position_meters': expected a list of numbers of one time step, got shape ()"),
        (line(position_meters=[[1, 2, 3], [4, 5, 6]]), "'position_meters': expected a list of numbers of one time"),
        (line(position_meters=[1, 2]), "is no camera: C must be"),
        (line(x_focal_length=None), "a camera needs the key 'x_focal_length'"),
        (without("principal_point"), "a camera needs the key 'principal_point'"),
        (line(radial_distortion=[[1, 2], [3]]), "'radial_distortion': expected a list of numbers, got [[1, 2], [3]]"),
        (line(x_focal_length=10**400), "'x_focal_length': expected a number, got 1000"),
        (line(image_width=0), "is no camera: image_size must be"),
        (line(homography=[[1, 2], [3, 4]]), "expected a homography, three rows of three numbers"),
        (line(homography=[1, 2, 3]), "'homography': expected a matrix of one time step, got shape (3,)"),
        (line(homography=[[1, 2, 3], [2, 4, 6], [0, 0, 1]]), "the homography is singular"),
        (line(loss_ndc_total="small"), "'loss_ndc_total': expected a number, got 'small'"),
    ],
)
def test_broken_lines_are_named_by_their_number(broken, message):
    with pytest.raises(BrokenFileError, match=r"^line 3: .*" + re.escape(message)):
        parse_per_sample_output(f"{line()}\n\n{broken}\n{line()}\n")


def test_a_file_that_is_no_text():
    with pytest.raises(BrokenFileError, match="is no text in UTF-8: "):
        parse_per_sample_output(b"\xff\xfe\x00")
