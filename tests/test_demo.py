"""The demonstration finds its true cameras, and writes files that the rest of the package reads."""

import contextlib
import io
import json
from dataclasses import astuple

import cv2
import numpy as np
import pytest

from fieldcalib.cli import demo
from fieldcalib.cli.demo import run_demo
from fieldcalib.fields.segments import Arc
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.io import files
from fieldcalib.io.images import write_image
from fieldcalib.io.soccernet import camera_from_record, parse_annotation
from fieldcalib.problem.simulated import IMAGE_SIZE, CameraDifference, camera_difference, observe, pan_over_field
from fieldcalib.solve.batch import calibrate_batch

FIELD = soccer()
COUNT = 5


def run(out, **options):
    """Errors, and what was printed."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        errors = run_demo(out, **options)
    return errors, printed.getvalue()


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo") / "new" / "folder"
    return (out, *run(out, count=COUNT))


def read_image(path):
    return cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_COLOR)


# the files


def test_what_is_written(result):
    out, _, _ = result
    names = [f"{index:02d}" for index in range(COUNT)]
    expected = {f"frame_{name}.png" for name in names} | {f"annotations/{name}.json" for name in names}
    expected |= {"overview.png", "true_cameras.json"}
    assert {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()} == expected


def test_pictures(result):
    out, _, _ = result
    for path in out.glob("frame_*.png"):
        picture = read_image(path)
        assert picture.shape == (540, 960, 3)
        blue, green, red = np.moveaxis(picture, -1, 0)
        assert np.sum((blue > 150) & (green < 80) & (red > 150)) > 100  # the markings as calibrated, in magenta
    overview = read_image(out / "overview.png")
    assert overview.shape[0] > 2 * 270
    assert overview.shape[1] > 3 * 480
    assert len(np.unique(overview[-40:, :480].reshape(-1, 3), axis=0)) > 1  # the last row of tiles is there


def test_annotations_are_soccernets_and_calibrate_to_the_same_cameras(result):
    out, errors, _ = result
    contents = [path.read_bytes() for path in sorted((out / "annotations").glob("*.json"))]
    assert "Goal left post left " in json.loads(contents[0])  # with SoccerNet's blank
    assert "Goal right post left" in json.loads(contents[-1])
    for points in (points for content in contents for points in json.loads(content).values()):
        assert all(0.0 <= value <= 1.0 for point in points for value in (point["x"], point["y"]))
    frames = [parse_annotation(content, IMAGE_SIZE) for content in contents]
    found = calibrate_batch(FIELD, frames, IMAGE_SIZE)
    for calibration, truth, error in zip(found, pan_over_field(COUNT), errors, strict=True):
        np.testing.assert_allclose(
            astuple(camera_difference(calibration.camera, truth, FIELD)), astuple(error), rtol=1e-3
        )


def test_true_cameras_can_be_read_back(result):
    records = json.loads((result[0] / "true_cameras.json").read_text())
    assert list(records) == ["00", "01", "02", "03", "04"]
    for record, truth in zip(records.values(), pan_over_field(COUNT), strict=True):
        camera = camera_from_record(record)
        assert camera.image_size == IMAGE_SIZE
        np.testing.assert_allclose(camera.project([5.0, -20.0, -1.0]), truth.project([5.0, -20.0, -1.0]), atol=1e-6)


def test_a_picture_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    def fail(*paths):
        raise OSError("disk full")

    monkeypatch.setattr(files.os, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        write_image(tmp_path / "a.png", np.zeros((4, 4, 3), np.uint8))
    assert list(tmp_path.iterdir()) == []


# the errors


def test_errors_are_small(result):
    _, errors, _ = result
    median = CameraDifference(*np.median([astuple(error) for error in errors], axis=0))
    assert median.focal_length < 1.5
    assert median.position < 1.0
    assert max(median.pan, median.tilt, median.roll) < 0.3
    assert median.reprojection < 6.0


def test_without_noise_the_cameras_are_exact(tmp_path):
    errors, _ = run(tmp_path, count=2, noise=0.0)
    for error in errors:
        assert error.focal_length < 0.1
        assert error.reprojection < 0.8  # the prior pulls a little, at the principal point too


def test_the_table(result):
    _, errors, printed = result
    lines = printed.splitlines()
    title = next(index for index, line in enumerate(lines) if line.split()[:1] == ["frame"])
    rows = [line.split() for line in lines[title + 1 : title + 2 + COUNT]]
    assert [row[0] for row in rows] == ["00", "01", "02", "03", "04", "median"]
    for row, error in zip(rows, errors, strict=False):
        np.testing.assert_allclose([float(cell) for cell in row[1:7]], astuple(error), atol=6e-4)
        assert row[8] == "accepted"
    medians = np.median([astuple(error) for error in errors], axis=0)
    np.testing.assert_allclose([float(cell) for cell in rows[-1][1:7]], medians, atol=6e-4)
    assert len({line.index("accepted") for line in lines[title + 1 : title + 1 + COUNT]}) == 1  # aligned


def test_a_frame_without_camera_does_not_spoil_the_rest(tmp_path, monkeypatch):
    seen = iter([{}, observe(pan_over_field(2)[1], FIELD, np.random.default_rng(0), 1.0)])
    monkeypatch.setattr(demo, "observe", lambda *arguments: next(seen))
    errors, printed = run(tmp_path, count=2)
    assert np.all(np.isnan(astuple(errors[0])))
    assert errors[1].reprojection < 20.0
    lines = printed.splitlines()
    assert next(line for line in lines if line.split()[:1] == ["00"]).endswith("too few segments")
    medians = next(line for line in lines if line.split()[:1] == ["median"]).split()[1:7]
    np.testing.assert_allclose([float(cell) for cell in medians], astuple(errors[1]), atol=6e-4)
    assert (tmp_path / "frame_00.png").exists()


def test_the_same_seed_gives_the_same_demo(tmp_path):
    first, again, other = (run(tmp_path, count=1, seed=seed)[0] for seed in (3, 3, 4))
    assert first == again
    assert first != other


def test_errors_of_the_true_camera_are_zero():
    truth = pan_over_field(3)[1]
    np.testing.assert_allclose(astuple(camera_difference(truth, truth, FIELD)), 0.0, atol=1e-9)


def test_errors_of_known_displacements():
    truth = Camera.from_angles(np.radians(179.9), np.radians(75), 0.0, 1000.0, (0, -60, -15), IMAGE_SIZE)
    other = Camera.from_angles(np.radians(-179.9), np.radians(76), 0.01, 1010.0, (3, -56, -15), IMAGE_SIZE)
    errors = camera_difference(other, truth, FIELD)
    expected = (1.0, 5.0, 0.2, 1.0, np.degrees(0.01))
    np.testing.assert_allclose(astuple(errors)[:5], expected, atol=1e-9)
    shifted = Camera(truth.K + np.array([[0, 0, 3], [0, 0, 4], [0, 0, 0]]), truth.R, truth.C, IMAGE_SIZE)
    assert camera_difference(shifted, truth, FIELD).reprojection == pytest.approx(5.0)
    behind = Camera.from_angles(0.0, np.radians(75), 0.0, 1000.0, (0, -60, -15), IMAGE_SIZE)
    assert camera_difference(behind, truth, FIELD).reprojection == np.inf


# what is labelled


def test_every_frame_of_the_pan_has_enough_labels_and_goals_are_seen():
    labels = [set(observe(camera, FIELD, np.random.default_rng(0), 1.0)) for camera in pan_over_field(12)]
    assert min(len(frame) for frame in labels) >= 6
    goals = [any(label.startswith("Goal") for label in frame) for frame in labels]
    assert goals[0]
    assert goals[-1]
    assert "Circle central" in labels[5]
    for frame in labels:
        assert frame <= set(FIELD)
        assert not {"Circle central left", "Circle central right"} & frame


@pytest.mark.parametrize("camera", pan_over_field(5))
def test_labels_without_noise_lie_on_the_markings(camera):
    for label, xy in observe(camera, FIELD, np.random.default_rng(0), 0.0).items():
        curve = camera.project(FIELD[label].sample(0.005))
        distance = np.linalg.norm(xy[:, None] - curve[None], axis=-1).min(axis=1)
        assert distance.max() < 0.1
        assert len(xy) == 9 if isinstance(FIELD[label], Arc) else len(xy) in (2, 3)
        assert len(np.unique(xy.round(3), axis=0)) == len(xy)


@pytest.mark.slow
def test_the_noise_is_as_asked_for():
    camera, offsets = pan_over_field(3)[0], []
    curve = camera.project(FIELD["Circle left"].sample(0.005))
    rng = np.random.default_rng(0)
    for _ in range(200):
        xy = observe(camera, FIELD, rng, 2.0)["Circle left"]
        nearest = np.linalg.norm(xy[:, None] - curve[None], axis=-1).argmin(axis=1)
        offsets.append(xy - curve[nearest])  # across the curve, so one of the two dimensions
    assert np.sqrt(np.mean(np.sum(np.square(offsets), axis=-1))) == pytest.approx(2.0, rel=0.1)


def test_labels_are_inside_the_image():
    rng = np.random.default_rng(0)
    for camera in pan_over_field(4):
        for _ in range(20):
            xy = np.concatenate(list(observe(camera, FIELD, rng, 4.0).values()))
            assert np.all((xy >= 0.0) & (xy <= np.array(IMAGE_SIZE) - 1.0))
