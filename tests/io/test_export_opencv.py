"""Calibration files of OpenCV: what others wrote, and what cannot be read. Round trips are in test_export.py."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from strategies import cameras
from synthetic import visible_field_points

from fieldcalib.geometry.camera import Camera
from fieldcalib.io.exports.opencv import format_opencv, parse_opencv, read_opencv
from fieldcalib.io.files import BrokenFileError

K = np.array([[1500.0, 0.0, 480.0], [0.0, 1490.0, 270.0], [0.0, 0.0, 1.0]])
DIST = [0.1, -0.02, 0.001, 0.002, 0.03]
CAMERA = Camera.from_angles(0.2, 1.3, 0.01, 1500.0, (2.0, 60.0, -15.0), (960, 540), k=(0.1, -0.02))


def written(path, **values):
    """A file as OpenCV's calibration sample writes it; the ending says whether it is YAML, XML or JSON."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in values.items():
        storage.write(key, value)
    storage.release()
    return path


@pytest.mark.parametrize("ending", ["yml", "yaml", "xml", "json"])
def test_files_of_the_calibration_sample(tmp_path, ending):
    path = written(
        tmp_path / f"out_camera_data.{ending}",
        calibration_time="Sun Nov 22 2026",
        image_width=960,
        image_height=540,
        fisheye_model=0,
        camera_matrix=K,
        distortion_coefficients=np.array(DIST)[:, None],
        avg_reprojection_error=0.3,
    )
    found = read_opencv(path)
    np.testing.assert_array_equal(found.camera_matrix, K)
    np.testing.assert_array_equal(found.dist_coeffs, DIST)
    assert found.image_size == (960, 540)
    assert found.rvec is None
    assert found.tvec is None
    with pytest.raises(ValueError, match="the file has intrinsics only"):
        _ = found.camera


def test_intrinsics_alone(tmp_path):
    found = read_opencv(written(tmp_path / "cam.yml", camera_matrix=K.astype(np.float32)))
    np.testing.assert_array_equal(found.camera_matrix, K)
    assert not found.dist_coeffs.any()
    assert found.image_size is None


@given(camera=cameras())
def test_a_camera_comes_back(camera):
    X = visible_field_points(camera)
    np.testing.assert_allclose(parse_opencv(format_opencv(camera)).camera.project(X), camera.project(X), atol=1e-8)


FISHEYE = Camera.from_angles(
    0.2, 1.3, 0.01, 400.0, (2.0, 60.0, -15.0), (960, 540), k=(0.1, -0.02, 0, 0.01), fisheye=True
)


@pytest.mark.parametrize(
    "said", [{"fisheye_model": 1}, {"distortion_model": "equidistant"}, {"distortion_model": "fisheye"}], ids=str
)
def test_files_of_a_fisheye_lens(tmp_path, said):
    path = written(tmp_path / "cam.yml", camera_matrix=FISHEYE.K, distortion_coefficients=FISHEYE.dist.T, **said)
    found = read_opencv(path)
    assert found.fisheye
    np.testing.assert_array_equal(found.dist_coeffs, FISHEYE.dist[0])


def test_a_fisheye_camera_comes_back():
    X = visible_field_points(CAMERA)
    back = parse_opencv(format_opencv(FISHEYE)).camera
    assert back.fisheye
    np.testing.assert_allclose(back.project(X), FISHEYE.project(X), atol=1e-8)


def test_opencv_4_reads_the_header():
    assert format_opencv(CAMERA).startswith("%YAML:1.0\n")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"K": K}, 'has no key "camera_matrix", only K'),
        ({"camera_matrix": K[:2]}, r"camera_matrix must be a finite \(3, 3\)"),
        ({"camera_matrix": -K}, "with focal lengths above 0"),
        ({"camera_matrix": "none"}, "camera_matrix is no matrix"),
        ({"camera_matrix": K, "distortion_coefficients": np.zeros((1, 3))}, "distortion_coefficients must be"),
        ({"camera_matrix": K, "distortion_coefficients": np.ones((1, 14))}, "a tilted sensor"),
        (
            {"camera_matrix": K, "distortion_coefficients": np.zeros((1, 5)), "fisheye_model": 1},
            "of a fisheye lens must be",
        ),
        ({"camera_matrix": K, "image_width": 0, "image_height": 540}, "image_size must be"),
        ({"camera_matrix": K, "rvec": np.zeros((3, 3))}, "rvec must be 3 finite numbers"),
    ],
)
def test_what_is_no_camera_is_said(tmp_path, values, message):
    path = written(tmp_path / "cam.yml", **values)
    with pytest.raises(BrokenFileError, match=rf"^{path}: .*{message}"):
        read_opencv(path)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"garbage", b"%YAML:1.0\n---\na: [1", b"<xml>", b"[1, 2]"])
def test_what_is_no_file_of_opencv_is_said(tmp_path, content):
    path = tmp_path / "cam.yml"
    path.write_bytes(content)
    with pytest.raises(BrokenFileError, match="is no YAML, XML or JSON of"):
        read_opencv(path)


def test_a_missing_file_is_said(tmp_path):
    with pytest.raises(BrokenFileError, match="cannot be read"):
        read_opencv(tmp_path / "none.yml")
