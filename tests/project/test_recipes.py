"""Recipes of the docs for other packages: with these where they are installed, else with what recipes use of them."""

import re
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest
from networks import KnownCameras

import fieldcalib
from fieldcalib import Camera, soccer
from fieldcalib.draw.scene import render_field
from fieldcalib.localize.network import SegmentationNetwork

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "detectors.md"
SIZE = (480, 270)
CAMERAS = [Camera.from_angles(pan, 1.32, 0.0, 475.0, (1.0, 66.0, -16.0), SIZE) for pan in (0.2, 0.4)]
X = np.array([(30.0, -10.0, 0.0), (38.0, 2.0, 0.0)])


class ModuleOfTracklab:
    def __init__(self, batch_size):
        self.batch_size = batch_size


STAND_INS = {
    "trackers": ("trackers.motion.transformation", "CoordinatesTransformation", object),
    "tracklab": ("tracklab.pipeline", "ImageLevelModule", ModuleOfTracklab),
}


def recipe(package, monkeypatch):
    """The names that a recipe defines."""
    path, name, stand_in = STAND_INS[package]
    if find_spec(package) is None:
        parts = path.split(".")
        for count in range(1, len(parts) + 1):
            monkeypatch.setitem(sys.modules, ".".join(parts[:count]), ModuleType(parts[count - 1]))
        setattr(sys.modules[path], name, stand_in)
    (code,) = re.findall(rf"<!-- recipe: {package} -->\n```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    names = {}
    exec(compile(code, str(PAGE), "exec"), names)
    return names


@pytest.fixture
def pictures():
    return [render_field(camera, soccer(), rng=np.random.default_rng(0)) for camera in CAMERAS]


@pytest.fixture(autouse=True)
def _network(monkeypatch):
    monkeypatch.setattr(SegmentationNetwork, "load", lambda: KnownCameras(CAMERAS))


def test_trajectories_of_trackers_stay_on_the_ground(monkeypatch, pictures):
    names = recipe("trackers", monkeypatch)
    motion = names["FieldMotion"](fieldcalib.calibrate(pictures, progress=False))
    first, second = (motion.update(picture) for picture in pictures)
    there = second.abs_to_rel(first.rel_to_abs(CAMERAS[0].project(X)))
    assert np.all(np.linalg.norm(there - CAMERAS[1].project(X), axis=1) < 3.0)


def test_a_module_of_tracklab_has_the_columns_of_a_calibration(monkeypatch, pictures):
    module = recipe("tracklab", monkeypatch)["FieldCalibration"]()
    feet = [camera.project(place) + 0.5 for camera, place in zip(CAMERAS, X, strict=True)]
    boxes = pd.DataFrame(
        {"image_id": ["a", "b"], "bbox_ltwh": [np.array([x - 5.0, y - 30.0, 10.0, 30.0]) for x, y in feet]}, [7, 9]
    )
    batch = np.stack([image[..., ::-1] for image in pictures])
    places, images = module.process(batch, boxes, pd.DataFrame(index=["a", "b"]))
    assert list(places.columns) == module.output_columns["detection"]
    assert list(images.columns) == module.output_columns["image"]
    found = np.array([(one["x_bottom_middle"], one["y_bottom_middle"]) for one in places.loc[[7, 9], "bbox_pitch"]])
    np.testing.assert_allclose(found, X[:, :2], atol=0.5)
    parameters = images.loc["b", "parameters"]
    np.testing.assert_allclose(parameters["position_meters"], CAMERAS[1].C, atol=2.0)
