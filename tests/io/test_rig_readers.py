"""The cameras of a rig in TOML, read by the tools themselves where they are installed."""

from importlib.util import find_spec

import cv2
import numpy as np
import pytest

from fieldcalib.geometry.camera import Camera
from fieldcalib.io.exports.toml import toml_files

RIG = {
    "left": Camera.from_angles(-0.3, 1.3, 0.02, 1500.0, (-10.0, 56.0, -15.0), (960, 540), k=(0.05, -0.01)),
    "right": Camera.from_angles(0.3, 1.3, 0.0, 1200.0, (20.0, 66.0, -12.0), (1280, 720)),
}
X = np.array([(30.0, -10.0, 0.0), (38.0, 2.0, -1.5), (5.0, 0.0, -2.0)])
Z_UP = X * (1.0, -1.0, -1.0)


def of_anipose(folder):
    from aniposelib.cameras import CameraGroup

    group = CameraGroup.load(str(folder / "calibration.toml"))
    return {camera.get_name(): camera.project(Z_UP).reshape(-1, 2) for camera in group.cameras}


def of_pose2sim(folder):
    from Pose2Sim.common import retrieve_calib_params

    values = retrieve_calib_params(folder / "calibration.toml")
    return dict(zip(RIG, map(projected, *(values[name] for name in ("R", "T", "K", "dist"))), strict=True))


def of_caliscope(folder):
    from caliscope.cameras.camera_array import CameraArray

    found = CameraArray.from_toml(folder / "camera_array.toml").cameras.values()
    every = [projected(one.rotation, one.translation, one.matrix, one.distortions) for one in found]
    return dict(zip(RIG, every, strict=True))


def projected(rotation, translation, matrix, distortions):
    return cv2.projectPoints(Z_UP, rotation, translation, matrix, distortions)[0].reshape(-1, 2)


READERS = {"aniposelib": of_anipose, "Pose2Sim": of_pose2sim, "caliscope": of_caliscope}


@pytest.mark.parametrize("package", READERS)
@pytest.mark.filterwarnings("ignore")  # of the packages and what they import
def test_other_tools_read_the_rig(package, tmp_path):
    if find_spec(package) is None:
        pytest.skip(f"not installed: {package}")
    for name, content in toml_files(RIG).items():
        (tmp_path / name).write_bytes(content)
    found = READERS[package](tmp_path)
    assert list(found) == list(RIG)
    for name, camera in RIG.items():
        np.testing.assert_allclose(found[name], camera.project(X), rtol=0.0, atol=1e-6)
