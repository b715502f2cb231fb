"""Key points of other models: which are left out, what they weigh, and where they lie."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from fieldcalib import Camera, calibrate_from_points, calibrate_from_segments, soccer
from fieldcalib.io import key_points
from fieldcalib.io.keypoint_models import MODELS, ROBOFLOW, point_field

SIZE = (1280, 720)
CAMERA = Camera.from_angles(-0.3, 1.35, 0.0, 1900.0, (0.0, 68.0, -17.0), SIZE)
XY = CAMERA.project([point_field("roboflow-32")[name].X for name in ROBOFLOW])
SEEN = np.all((XY >= 0.0) & (XY < SIZE), axis=1)
CONFIDENCE = np.where(SEEN, np.linspace(0.6, 0.9, 32), 0.1)
NAMES = tuple(name for name, seen in zip(ROBOFLOW, SEEN, strict=True) if seen)


class Tensor:
    """On another device: no array before `cpu()`."""

    def __init__(self, values):
        self.values = values

    def cpu(self):
        return self.values

    def __array__(self, *_):
        raise TypeError("can't convert a tensor of another device")


def of_ultralytics(xy, confidence):
    keypoints = SimpleNamespace(xy=Tensor(xy), conf=None if confidence is None else Tensor(confidence))
    return SimpleNamespace(keypoints=keypoints, boxes=None)


def of_supervision(xy, confidence):
    return SimpleNamespace(xy=xy, keypoint_confidence=confidence, visible=None)


def of_older_supervision(xy, confidence):
    return SimpleNamespace(xy=xy, confidence=confidence)


RESULTS = [of_ultralytics, of_supervision, of_older_supervision]


@pytest.mark.parametrize("result", RESULTS)
def test_results_are_read_by_their_attributes(result):
    found = key_points(result(XY[None], CONFIDENCE[None]), "roboflow-32")
    assert found.names == NAMES
    np.testing.assert_array_equal(found.image_points, XY[SEEN])
    np.testing.assert_allclose(found.weights, CONFIDENCE[SEEN] ** 2)
    np.testing.assert_array_equal(found.object_points, [found.field[name].X for name in NAMES])


@pytest.mark.parametrize("result", RESULTS)
def test_of_several_pitches_the_surest_is_taken(result):
    both = result(np.stack([XY + 50.0, XY]), np.stack([0.8 * CONFIDENCE, CONFIDENCE]))
    np.testing.assert_array_equal(key_points(both).image_points, XY[SEEN])


@pytest.mark.parametrize("result", RESULTS)
def test_no_pitch_is_no_points(result):
    found = key_points(result(np.empty((0, 32, 2)), None))
    assert found.names == ()
    assert found.object_points.shape == (0, 3)
    assert calibrate_from_points(found.object_points, found.image_points, SIZE).camera is None


def test_arrays_and_what_was_not_found():
    """At (0, 0), where ultralytics puts what it did not find, not finite, not visible, or doubtful."""
    xy = XY.copy()
    gone = np.flatnonzero(SEEN)
    xy[gone[0]], xy[gone[1]] = 0.0, np.nan
    assert key_points(np.where(SEEN[:, None], xy, 0.0)).names == NAMES[2:]
    assert key_points(np.column_stack([XY, CONFIDENCE])).names == NAMES
    assert key_points(np.column_stack([XY, CONFIDENCE]), least_confidence=0.0).names == ROBOFLOW
    visible = np.ones((1, 32), bool)
    visible[0, gone[-1]] = False
    hidden = SimpleNamespace(xy=XY[None], keypoint_confidence=CONFIDENCE[None], visible=visible)
    assert key_points(hidden).names == NAMES[:-1]


def test_cameras_come_back_by_points_and_by_segments():
    found = key_points(np.column_stack([XY, CONFIDENCE]))
    of_points = calibrate_from_points(found.object_points, found.image_points, SIZE, weights=found.weights)
    of_segments = calibrate_from_segments(found.field, found.image_segments, SIZE, weights=found.segment_weights)
    for calibration in (of_points, of_segments):
        assert calibration.accepted
        assert calibration.camera.focal_length == pytest.approx(CAMERA.focal_length, rel=0.01)
    assert tuple(of_segments.per_segment_errors) == NAMES


def test_points_lie_on_the_markings_of_any_field():
    """Not where roboflow's code draws them, on a pitch of 120 x 70 m."""
    field = point_field("roboflow-32", soccer(100.0, 64.0))
    X = np.array([field[name].X for name in ROBOFLOW])
    assert X[0].tolist() == [-50.0, -32.0, 0.0]
    assert X[29].tolist() == [50.0, 32.0, 0.0]
    assert X[9].tolist() == [-33.5, -20.16, 0.0]
    assert X[13:17].tolist() == [[0.0, -32.0, 0.0], [0.0, -9.15, 0.0], [0.0, 9.15, 0.0], [0.0, 32.0, 0.0]]
    assert X[30:].tolist() == [[-9.15, 0.0, 0.0], [9.15, 0.0, 0.0]]
    np.testing.assert_allclose(X[10], (-33.5, -7.3125, 0.0), atol=1e-4)


def test_pnlcalib_by_id_and_by_number():
    names = MODELS["pnlcalib-57"]
    field = point_field("pnlcalib-57")
    xy = CAMERA.project([field[name].X for name in names])
    kp = {id + 1: {"x": x / SIZE[0], "y": y / SIZE[1], "p": 0.7} for id, (x, y) in enumerate(xy) if 0 <= x < SIZE[0]}
    by_id = key_points({**kp, 60: {"x": 0.5, "y": 0.5, "p": 1.0}}, "pnlcalib-57", image_size=SIZE)
    by_number = key_points(np.column_stack([xy, [0.7 * (id + 1 in kp) for id in range(57)]]), "pnlcalib-57")
    assert by_id.names == by_number.names
    np.testing.assert_allclose(by_id.image_points, by_number.image_points)
    np.testing.assert_allclose(by_id.weights, by_number.weights)
    with pytest.raises(ValueError, match=r"normalised: image_size=\(width, height\) is needed"):
        key_points(kp, "pnlcalib-57")
    with pytest.raises(ValueError, match="a dict by id is of 'pnlcalib-57'"):
        key_points(kp, "roboflow-32", image_size=SIZE)


def test_a_model_of_ones_own():
    field = soccer().with_segments({"corner flag": soccer().points["TL_PITCH_CORNER"]})
    found = key_points([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], ["CENTER_MARK", None, "corner flag"], field=field)
    assert found.image_segments.keys() == {"CENTER_MARK", "corner flag"}
    assert found.image_points.tolist() == [[1.0, 2.0], [5.0, 6.0]]


@pytest.mark.parametrize(
    ("result", "model", "message"),
    [
        (XY, "yolo", "model must be one of roboflow-32, pnlcalib-57, or the names of its points, got 'yolo'"),
        (XY, ["CENTRE"] * 32, "the field has no point 'CENTRE'"),
        (XY, ["Middle line"] * 32, "'Middle line' is no point of the field"),
        (XY[:17], "roboflow-32", "expected 32 points, those of roboflow-32, got 17: is it the result of"),
        ([of_ultralytics(XY[None], None)], "roboflow-32", "the result of one image, got a list of 1"),
        (SimpleNamespace(keypoints=None), "roboflow-32", "the result has no keypoints: expected one of a pose model"),
        (SimpleNamespace(xy=XY[None, None]), "roboflow-32", r"of shape \(n, K, 2\), got \(1, 1, 32, 2\)"),
        ("points", "roboflow-32", r"or an array of shape \(K, 2\) or \(K, 3\), got str"),
        (np.ones((2, 32, 3)), "roboflow-32", r"got ndarray of shape \(2, 32, 3\): give the points of one pitch in one"),
        ([[1.0, 2.0, 3.0, 4.0]], "roboflow-32", r"\(K, 3\), got list of shape \(1, 4\)$"),
        (3, "roboflow-32", r"or an array of shape \(K, 2\) or \(K, 3\), got int"),
    ],
)  # fmt: skip
def test_mistakes_raise(result, model, message):
    with pytest.raises(ValueError, match=message):
        key_points(result, model)


def annotated(path):
    """Labelled points of a real frame, x, y and 1 where they are visible."""
    points = np.array(path.read_text().split(), dtype=float)[5:].reshape(-1, 3)
    return np.column_stack([points[:, :2] * SIZE, points[:, 2] == 2])


def test_numbers_are_those_of_the_annotations(shared_data):
    """Real annotations have their points on 105 x 68 m where the table has them."""
    places = json.loads((shared_data / "pitch-keypoints" / "keypoints_105x68.json").read_text())
    X = [point_field("roboflow-32")[name].X for name in ROBOFLOW]
    np.testing.assert_allclose(
        [x[:2] for x in X], [np.subtract(places[str(i)], (52.5, 34)) for i in range(32)], atol=0.01
    )


@pytest.mark.parametrize("split", ["valid", pytest.param("train", marks=pytest.mark.slow)])
def test_real_frames(shared_data, split):
    """Frames are calibrated, and points that were left out lie where the camera has them."""
    rng, frames, accepted, off = np.random.default_rng(0), 0, 0, []
    for path in sorted((shared_data / "pitch-keypoints" / split).glob("*.txt"))[::3]:
        found = key_points(annotated(path))
        if len(found.names) < 6:
            continue
        frames += 1
        left_out = found.names[rng.integers(len(found.names))]
        pixels = {name: xy for name, xy in found.image_segments.items() if name != left_out}
        calibration = calibrate_from_segments(found.field, pixels, SIZE)
        accepted += calibration.accepted
        if calibration.camera is not None:
            xy = calibration.camera.project(found.field[left_out].X)
            off.append(np.linalg.norm(xy - found.image_segments[left_out]))
    assert frames >= 15
    assert accepted >= 0.98 * frames
    assert np.median(off) < 5.0
