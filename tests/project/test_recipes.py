"""Recipes of the docs for other packages: with these where they are installed, else with what recipes use of them."""

import re
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, SimpleNamespace

import cv2
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


def needs(*packages):
    """Skip a test where packages are missing that no extra brings."""
    missing = [package for package in packages if find_spec(package) is None]
    return pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}")


STAND_INS = {
    "trackers": ("trackers.motion.transformation", "CoordinatesTransformation", object),
    "tracklab": ("tracklab.pipeline", "ImageLevelModule", ModuleOfTracklab),
}


def recipe(package, monkeypatch):
    """The names that a recipe defines."""
    if find_spec(package) is None:
        path, name, stand_in = STAND_INS[package]
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


@needs("supervision", "trackers")
def test_boxes_of_a_detector_become_places(monkeypatch, tmp_path, pictures):
    """As the first recipe has it; ultralytics is replaced by what supervision reads of it."""
    from supervision import Detections

    feet = iter([camera.project(X) + 0.5 for camera in CAMERAS] * 2)

    def found(frame, **options):
        xy = next(feet)
        boxes = SimpleNamespace(xyxy=np.column_stack([xy - (5.0, 30.0), xy + (5.0, 0.0)]), conf=np.ones(len(xy)))
        boxes.cls, boxes.id = np.zeros(len(xy)), None
        return [SimpleNamespace(boxes=boxes, masks=None, names={0: "person"})]

    monkeypatch.setitem(sys.modules, "ultralytics", SimpleNamespace(YOLO=lambda weights: found))
    results = fieldcalib.calibrate(pictures, progress=False)
    monkeypatch.setattr(fieldcalib, "calibrate", lambda path: results)
    monkeypatch.chdir(tmp_path)
    video = cv2.VideoWriter("clip.mp4", cv2.VideoWriter.fourcc(*"mp4v"), 25.0, SIZE)
    for picture in pictures:
        video.write(picture)
    video.release()
    rows = recipe("supervision", monkeypatch)["rows"]
    assert [number for number, _, _, _ in rows] == [0, 0, 1, 1]
    np.testing.assert_allclose([xy for _, _, xy, _ in rows], np.concatenate([X, X])[:, :2], atol=0.5)
    boxes = Detections.from_ultralytics(found(None)[0])
    np.testing.assert_array_equal(results.to_field(boxes, 0).X, results.to_field(boxes.xyxy, 0).X)


@needs("trackers")
def test_traces_of_trackers_are_drawn_on_the_ground(monkeypatch, pictures):
    from supervision import Detections, Position
    from trackers import MotionAwareTraceAnnotator

    motion = recipe("trackers", monkeypatch)["FieldMotion"](fieldcalib.calibrate(pictures, progress=False))
    annotator = MotionAwareTraceAnnotator(position=Position.BOTTOM_CENTER)
    for camera, picture in zip(CAMERAS, pictures, strict=True):
        feet = camera.project(X[:1])
        player = Detections(np.column_stack([feet - (5.0, 30.0), feet + (5.0, 0.0)]), tracker_id=np.array([1]))
        drawn = annotator.annotate(picture.copy(), player, coord_transform=motion.update(picture))
    (row, column), *_ = np.argwhere(np.any(drawn != pictures[-1], axis=2))
    assert np.hypot(column - feet[0, 0], row - feet[0, 1]) < 6.0  # of a player who stands, although the camera turns


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


@needs("tracklab")
@pytest.mark.skipif(pd.__version__ >= "3", reason="tracklab 1.3 puts objects into columns of numbers: pandas below 3")
@pytest.mark.filterwarnings("ignore")  # those of tracklab and what it imports
def test_tracklab_runs_the_module(monkeypatch, tmp_path, pictures):
    """As its engine does: from files through its loader, and the answers into its tables."""
    from tracklab.engine.offline import OfflineTrackingEngine
    from tracklab.pipeline import Pipeline

    module = recipe("tracklab", monkeypatch)["FieldCalibration"](batch_size=2)
    paths = {id: str(tmp_path / f"{id}.png") for id in "ab"}
    for path, picture in zip(paths.values(), pictures, strict=True):
        cv2.imwrite(path, picture)
    feet = [camera.project(place) + 0.5 for camera, place in zip(CAMERAS, X, strict=True)]
    boxes = pd.DataFrame(
        {"image_id": ["a", "b"], "bbox_ltwh": [np.array([x - 5.0, y - 30.0, 10.0, 30.0]) for x, y in feet]}, [7, 9]
    )
    images = pd.DataFrame({"file_path": paths}, list(paths))
    Pipeline([module]).validate({"image": set(), "detection": set(boxes.columns)})
    module.datapipe.update(paths, images, boxes)
    engine = SimpleNamespace(models={module.name: module}, callback=lambda *_, **__: None, num_workers=0)
    for batch in module.dataloader(engine):
        boxes, images = OfflineTrackingEngine.default_step(engine, batch, module.name, boxes, images)
    found = [(one["x_bottom_middle"], one["y_bottom_middle"]) for one in boxes.loc[[7, 9], "bbox_pitch"]]
    np.testing.assert_allclose(found, X[:, :2], atol=0.5)
    np.testing.assert_allclose(images.loc["b", "parameters"]["position_meters"], CAMERAS[1].C, atol=2.0)


def of_polars(results):
    import polars

    table = polars.from_arrow(results.to_arrow()).filter(polars.col("verdict") != "reject")
    return table.select("id", "x_m", "reason").rows()


def of_duckdb(results):
    import duckdb

    table = duckdb.from_arrow(results.to_arrow()).filter("verdict <> 'reject'")
    return table.select("id", "x_m", "reason").fetchall()


@pytest.mark.parametrize("package", ["polars", "duckdb"])
def test_a_table_of_arrow_is_read_by_other_packages(package, pictures):
    if any(find_spec(one) is None for one in (package, "pyarrow")):
        pytest.skip(f"not installed: {package}")
    results = fieldcalib.calibrate(pictures, progress=False)
    rows = {"polars": of_polars, "duckdb": of_duckdb}[package](results)
    expected = [(id, camera.C[0], results[id].reason) for id, camera in results.cameras.items()]
    assert [(id, reason or "") for id, _, reason in rows] == [(id, reason) for id, _, reason in expected]
    np.testing.assert_allclose([x for _, x, _ in rows], [x for _, x, _ in expected])
