"""The tool that compares calibrated cameras with measured ones."""

import json

import numpy as np
import pytest

from data_tools import measured_cameras
from data_tools.synthetic.paths import SIZE
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import RadialLens

C = np.array([1.0, 66.0, -16.0])


def broadcast_camera(pan, f):
    k = RadialLens(np.hypot(*SIZE) / 2.0).to_opencv(np.array([0.03, 0.0]), f)
    return Camera.from_angles(pan, 1.35, 0.0, f, C, SIZE, k=k)


@pytest.fixture
def folder(tmp_path):
    """Files whose world has y away from the camera and z up, as the measured ones have."""
    for name, camera in {"a": broadcast_camera(-0.4, 3400.0), "b": broadcast_camera(0.1, 2600.0)}.items():
        y_and_z = np.diag([1.0, -1.0, -1.0])
        R, t = camera.R @ y_and_z, -camera.R @ camera.C
        k = np.append(camera.k, np.zeros(3))
        np.savez(tmp_path / f"{name}.npz", K=camera.K[None], k=k[None], R=R[None], t=t[None])
    return tmp_path


def test_cameras_are_read_in_our_world(folder):
    camera = measured_cameras.read_camera(folder / "a.npz")
    np.testing.assert_allclose(camera.C, C, atol=1e-9)
    np.testing.assert_allclose(camera.angles, broadcast_camera(-0.4, 3400.0).angles, atol=1e-9)


@pytest.mark.slow
def test_a_lens_is_found_and_its_regions_hold(folder, capsys):
    assert measured_cameras.main([str(folder), "--repeats", "10"]) == 0
    rows = {row["model"]: row for row in map(json.loads, capsys.readouterr().out.splitlines())}
    assert list(rows) == list(measured_cameras.MODELS)
    assert rows["k1"]["position_m"][0] < rows["none"]["position_m"][0]
    assert rows["k1"]["focal_length_percent"][1] < 2.0
    assert rows["k1"]["95_percent_regions_hold"]["ground"] > 80.0
    assert rows["none"]["95_percent_regions_hold"]["ground"] < rows["k1"]["95_percent_regions_hold"]["ground"]


def test_errors_are_percent_and_metres():
    truth = broadcast_camera(-0.4, 3400.0)
    ((_, frame),) = measured_cameras.with_simulated_pixels([truth], soccer(), 0.5, repeats=1)
    assert all(len(xy) <= 3 for label, xy in frame.items() if "Circle" not in label)
    (found,) = measured_cameras.calibrate_batch(soccer(), [frame], SIZE)
    f, position = measured_cameras.errors(found, truth)
    assert f == pytest.approx(100.0 * abs(found.camera.K[0, 0] / 3400.0 - 1.0))
    assert position == pytest.approx(np.linalg.norm(found.camera.C - C))


def test_an_empty_folder_is_refused(tmp_path, capsys):
    assert measured_cameras.main([str(tmp_path)]) == 2
    assert "holds no <name>.npz" in capsys.readouterr().err
