"""Accuracy of reprojected segments: equal to SoccerNet's evaluation on every frame, and what always holds."""

import json
import zipfile
from unittest import mock

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import cameras, examples, labelled_frames, numbers, vectors
from synthetic import displaced, observe, random_frames, whole_circle_markings

from fieldcalib import calibrate_batch, soccer
from fieldcalib.fields import Ground
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.rotation import rotation_from_angles
from fieldcalib.io.soccernet import (
    UNKNOWN_LABELS,
    camera_from_record,
    camera_to_record,
    format_annotation,
    parse_annotation,
)
from fieldcalib.metrics import THRESHOLDS, Confusion, accuracy, evaluate_segments
from fieldcalib.metrics.accuracy import sample_segments

SIZE = (960, 540)
FIELD = soccer()
MARKINGS = whole_circle_markings(FIELD)
# Of distances, px. SoccerNet keeps distorted points in single precision; since NumPy 2 all that follows is single too,
# and so it is here. With NumPy 1 its pixels are double: they differ by a rounding, 3e-5 px, and by more off the image.
PIXELS = 1e-6 if int(np.__version__.split(".")[0]) >= 2 else 1e-2


# --- SoccerNet's evaluation ---


def remembered(distance):
    """SoccerNet's distance of a point to a polyline, computed once: it does not depend on the threshold."""
    known = {}

    def remembering(point, polyline):
        key = (point["x"], point["y"], id(polyline))
        if key not in known:
            known[key] = distance(point, polyline)
        return known[key]

    return remembering


def referee(record, annotation, planar=False):
    """SoccerNet's verdict on a frame at each threshold: AC, TP FP FN, the same in points and distances by label."""
    from SoccerNet.Evaluation import utils_calibration as soccernet

    verdicts = []
    once = mock.patch.object(soccernet, "distance_to_polyline", remembered(soccernet.distance_to_polyline))
    with np.errstate(all="ignore"), once:
        projected = soccernet.get_polylines(record, *SIZE, sampling_factor=0.9)
        annotated = soccernet.scale_points(annotation, *SIZE)
        if planar:
            projected, annotated = ({k: v for k, v in d.items() if "Goal" not in k} for d in (projected, annotated))
        for threshold in THRESHOLDS:
            sides = [
                soccernet.evaluate_camera_prediction(projected, labels, threshold)
                for labels in (annotated, soccernet.mirror_labels(annotated))
            ]
            ac = [float(side[0][0, 0] / max(side[0].sum(), 1.0)) for side in sides]
            confusion, points, distances = sides[0] if ac[0] > ac[1] else sides[1]
            verdicts.append(
                (
                    max(ac),
                    tp_fp_fn(confusion),
                    {label.strip(): tp_fp_fn(matrix) for label, matrix in points.items()},
                    {label.strip(): np.array(values) for label, values in distances.items()},
                )
            )
    return verdicts


def tp_fp_fn(matrix):
    return [int(matrix[0, 0]), int(matrix[0, 1]), int(matrix[1, 0])]


def assert_equals_referee(records, annotations, planar=False):
    """Every number of every frame; returns the evaluation."""
    evaluation = evaluate_segments(
        [camera_from_record(record, SIZE, checked=False) for record in records],
        [parse_annotation(json.dumps(annotation), SIZE, unknown=True) for annotation in annotations],
        SIZE,
        planar=planar,
    )
    for f, (record, annotation) in enumerate(zip(records, annotations, strict=True)):
        for t, (ac, segments, points, distances) in enumerate(referee(record, annotation, planar)):
            assert evaluation.frame_accuracy[f, t] == pytest.approx(ac, abs=1e-6), (f, t)
            assert evaluation.segments[f, t].sum(axis=0).tolist() == segments, (f, t)
            rows = zip(evaluation.labels, evaluation.points[f, t].tolist(), strict=True)
            assert {label: row for label, row in rows if any(row)} == points, (f, t)
            ours = evaluation.errors[f][int(evaluation.turned[f, t])]
            assert set(ours) == set(distances), (f, t)
            for label, expected in distances.items():
                np.testing.assert_allclose(ours[label], expected, rtol=0, atol=PIXELS, err_msg=f"{f} {label}")
    return evaluation


# --- whose cameras: each takes a good camera's record and makes another of it ---


def slightly_off(record, rng):
    pan, fx, fy = rng.normal(scale=(0.2, 0.01, 0.01)).tolist()
    moved = {"pan_degrees": record["pan_degrees"] + pan}
    return moved | {f"{a}_focal_length": record[f"{a}_focal_length"] * (1 + s) for a, s in (("x", fx), ("y", fy))}


def wildly_off(record, rng):
    angles = {f"{name}_degrees": float(rng.uniform(-180, 180)) for name in ("pan", "tilt", "roll")}
    return angles | {"position_meters": rng.normal(scale=30.0, size=3).tolist()}


def with_a_lens(record, rng):
    """All twelve coefficients; pixels move by some percent."""
    reach = (rng.normal(scale=0.03, size=12) * (record["x_focal_length"] / 500.0) ** 2).tolist()
    return {"radial_distortion": reach[:6], "tangential_distortion": [v / 20 for v in reach[6:8]]} | {
        "thin_prism_distortion": [v / 20 for v in reach[8:]]
    }


def with_an_absurd_lens(record, rng):
    k = rng.normal(size=12).tolist()
    return {"radial_distortion": k[:6], "tangential_distortion": k[6:8], "thin_prism_distortion": k[8:]}


def inside_the_field(record, rng):
    """At the height of a child, so that segments pass beside it and behind it."""
    return wide(rng) | {"position_meters": [*rng.uniform((-50.0, -30.0), (50.0, 30.0)).tolist(), -1.0]}


def below_the_ground(record, rng):
    return wide(rng) | {"position_meters": [*rng.uniform((-50.0, -30.0), (50.0, 60.0)).tolist(), 5.0]}


def before_a_post(distance):
    """So many metres before its top: SoccerNet sees from one millimetre on."""

    def changed(record, rng):
        forward = rotation_from_angles(np.radians([record[f"{name}_degrees"] for name in ("pan", "tilt", "roll")]))[2]
        return {"position_meters": ((-52.5, 3.66, -2.44) - distance * forward).tolist()}

    return changed


def wide(rng):
    f = float(rng.uniform(150.0, 600.0))
    tilt = {"pan_degrees": float(rng.uniform(-180, 180)), "tilt_degrees": float(rng.uniform(70, 95))}
    return tilt | {"x_focal_length": f, "y_focal_length": f}


def focal_lengths(*values):
    def changed(record, rng):
        f = float(rng.choice(values))
        return {"x_focal_length": f, "y_focal_length": f}

    return changed


def looking_from_behind(record, rng):
    """A camera that shows the field turned by 180 degrees: its labels are those of the other side."""
    x, y, z = record["position_meters"]
    return {"pan_degrees": record["pan_degrees"] + 180.0, "position_meters": [-x, -y, z]}


KINDS = {
    "good": lambda record, rng: {},
    "slightly off": slightly_off,
    "wildly off": wildly_off,
    "with a lens": with_a_lens,
    "with an absurd lens": with_an_absurd_lens,
    "inside the field": inside_the_field,
    "below the ground": below_the_ground,
    "half a millimetre before a post": before_a_post(5e-4),
    "two millimetres before a post": before_a_post(2e-3),
    "looking away": lambda record, rng: {"pan_degrees": record["pan_degrees"] + 180.0},
    "on the other side": looking_from_behind,
    "negative focal length": lambda record, rng: {"x_focal_length": -record["x_focal_length"]},
    "both focal lengths negative": focal_lengths(-500.0, -2000.0),
    "tiny focal length": focal_lengths(1e-3, 1.0, 20.0),
    "huge focal length": focal_lengths(1e6, 1e9, 1e30),
}
REAL = 4 * len(KINDS)  # of the annotated frames: the referee takes 0.1 s for each and each threshold


def of_kind(kind, records, annotations):
    """The share of the frames that gets cameras of this kind: (records, annotations)."""
    first = list(KINDS).index(kind)
    rng = np.random.default_rng(first)
    taken = slice(first, None, len(KINDS))
    return [record | KINDS[kind](record, rng) for record in records[taken]], annotations[taken]


@pytest.fixture(scope="module")
def real(shared_data):
    """Records of good cameras and annotations, spread over the real frames."""
    files = sorted(f for f in (shared_data / "sncalib-test-center").glob("*.json") if f.stem.isdigit())
    files = [files[i] for i in np.linspace(0, len(files) - 1, REAL).round().astype(int)]
    calibrations = calibrate_batch(FIELD, [parse_annotation(f.read_text(), SIZE) for f in files], SIZE)
    assert all(calibration.camera is not None for calibration in calibrations)
    return [camera_to_record(c.camera) for c in calibrations], [json.loads(f.read_text()) for f in files]


@pytest.fixture(scope="module")
def synthetic():
    """The same of random broadcasts, with labels of the wrong side and labels that say nothing."""
    frames, cameras = random_frames(3 * len(KINDS), seed=1, noise=2.0)
    rng = np.random.default_rng(2)
    annotations = []
    for i, frame in enumerate(frames):
        if i % 3 == 1:
            frame = {FIELD.symmetric[label]: xy for label, xy in frame.items()}
        if i % 3 == 2:
            frame = frame | {label: rng.uniform(0, SIZE, size=(3, 2)) for label in UNKNOWN_LABELS}
        annotations.append(json.loads(format_annotation(frame, SIZE)))
    return [camera_to_record(camera) for camera in cameras], annotations


@pytest.mark.parametrize("kind", KINDS)
def test_equals_soccernets_evaluation_on_real_frames(real, kind):
    records, annotations = of_kind(kind, *real)
    evaluation = assert_equals_referee(records, annotations)
    accuracies = dict(zip(THRESHOLDS, evaluation.accuracy, strict=True))
    if kind in ("good", "on the other side"):
        assert accuracies[20.0] > 0.8
        assert np.all(evaluation.turned[:, 2]) == (kind == "on the other side")
    if kind == "with a lens":
        assert accuracies[20.0] > 0.0
    if kind == "inside the field":
        assert evaluation.segments[..., 1].sum() > 3 * len(records)  # it does see segments


# of the other kinds the real frames tell by default; labels of the wrong side and of nothing are in each of them
@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=() if kind in ("good", "wildly off") else pytest.mark.slow) for kind in KINDS]
)
def test_equals_soccernets_evaluation_on_synthetic_frames(synthetic, kind):
    evaluation = assert_equals_referee(*of_kind(kind, *synthetic))
    unknown = [evaluation.labels.index(label) for label in sorted(UNKNOWN_LABELS)]
    missed = evaluation.segments[:, 0, unknown, 2].sum(axis=1)
    assert missed.tolist() == [2 * ((i % 3) == 2) for i in range(3 * len(KINDS))][list(KINDS).index(kind) :: len(KINDS)]


@pytest.mark.parametrize(
    "kind",
    [
        "inside the field",
        *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("good", "slightly off", "with a lens")),
    ],
)
def test_planar_equals_soccernets_evaluation_without_goals(synthetic, kind):
    records, annotations = of_kind(kind, *synthetic)
    evaluation = assert_equals_referee(records, annotations, planar=True)
    assert not any("Goal" in label for label in evaluation.labels)
    assert "Line unknown" in evaluation.labels


def test_planar_equals_soccernets_evaluation_without_goals_on_real_frames(real):
    records, annotations = (values[5 :: len(KINDS)] for values in real)
    assert any("Goal" in label for annotation in annotations for label in annotation)
    assert_equals_referee(records, annotations, planar=True)


@pytest.mark.slow
@pytest.mark.parametrize(("t", "threshold"), [(0, 5.0), (2, 20.0)])
def test_equals_what_soccernets_evaluation_reports(synthetic, tmp_path, t, threshold):
    """Means over the frames and the table of classes, of its own program on zips."""
    from SoccerNet.Evaluation import CameraCalibration as program

    records, annotations = (values[:5] for values in synthetic)
    rng = np.random.default_rng(0)
    kinds = ("good", "slightly off", "inside the field", "looking away")
    records = [r | KINDS[kind](r, rng) for r, kind in zip(records, kinds, strict=False)] + [None]
    with zipfile.ZipFile(tmp_path / "truth.zip", "w") as truth, zipfile.ZipFile(tmp_path / "pred.zip", "w") as pred:
        for i, (record, annotation) in enumerate(zip(records, annotations, strict=True)):
            truth.writestr(f"test/{i:05d}.json", json.dumps(annotation))
            if record is not None:
                pred.writestr(f"camera_{i:05d}.json", json.dumps(record))
    evaluation = evaluate_segments(
        [None if record is None else camera_from_record(record, SIZE, checked=False) for record in records],
        [parse_annotation(json.dumps(annotation), SIZE, unknown=True) for annotation in annotations],
        SIZE,
    )
    with np.errstate(all="ignore"):
        expected = program.evaluate(tmp_path / "truth.zip", tmp_path / "pred.zip", threshold, *SIZE)
    ours = {
        "completeness": evaluation.completeness,
        "meanAccuracies": evaluation.accuracy[t],
        "meanPrecision": evaluation.precision[t],
        "meanRecall": evaluation.recall[t],
    }
    for label, confusion in evaluation.per_label_points(threshold).items():
        name = "Goal left post left " if label == "Goal left post left" else label
        ours[f"{name}Accuracy"] = confusion.accuracy
        ours[f"{name}Precision"] = confusion.precision
        ours[f"{name}Recall"] = confusion.recall
    assert set(ours) == set(expected)
    for name, value in expected.items():
        assert ours[name] == pytest.approx(float(value), abs=1e-6, nan_ok=True), name
    assert evaluation.completeness == 4 / 5


# --- by hand: ten pixels a metre, looked at from above ---

FROM_ABOVE = np.array([[10.0, 0.0, 480.0], [0.0, 10.0, 270.0], [0.0, 0.0, 1.0]])
# The image shows x from -48 to 48 m, y from -27 to 27 m: the middle line at x = 480, of each penalty area the main line
# at x = 120 and x = 840 and the two others at y = 68.4 and y = 471.6, and a metre of the goal areas.
SEEN = {"Middle line", "Circle central", "Circle left", "Circle right"} | {
    f"{area} rect. {side} {part}"
    for area in ("Big", "Small")
    for side in ("left", "right")
    for part in ("main", "top", "bottom")
}


def from_above(frame, **options):
    return evaluate_segments([FROM_ABOVE], [frame], SIZE, planar=True, **options)


def test_distances_and_counts_by_hand():
    frame = {
        "Middle line": [(480.0, 100.0), (484.0, 300.0)],
        "Big rect. left main": [(125.0, 200.0), (120.0, 300.0)],  # exactly at the first threshold: not within
        "Big rect. left top": [(60.0, 68.4), (150.0, 68.4)],  # beyond its end at x = 120
        "Big rect. right main": [(841.0, 300.0)],
        "Side line top": [(100.0, 3.0)],  # not in the image
    }
    evaluation = from_above(frame)
    assert not evaluation.turned.any()
    errors = evaluation.errors[0][0]
    assert set(errors) == set(frame) - {"Side line top"}
    np.testing.assert_allclose(errors["Middle line"], [0.0, 4.0], atol=1e-9)
    np.testing.assert_allclose(errors["Big rect. left main"], [5.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(errors["Big rect. left top"], [0.0, 30.0], atol=1e-9)
    # 16 segments are seen, 17 with the side line; 2, 3 and 3 of them right
    np.testing.assert_allclose(evaluation.accuracy, [2 / 17, 3 / 17, 3 / 17])
    np.testing.assert_allclose(evaluation.precision, [2 / 16, 3 / 16, 3 / 16])
    np.testing.assert_allclose(evaluation.recall, [2 / 3, 3 / 4, 3 / 4])
    labels = evaluation.per_label(10.0)
    assert set(labels) == SEEN | {"Side line top"}
    assert labels["Big rect. left main"] == Confusion(1, 0, 0)
    assert labels["Big rect. left top"] == labels["Circle right"] == Confusion(0, 1, 0)
    assert labels["Side line top"] == Confusion(0, 0, 1)
    points = evaluation.per_label_points(5.0)
    assert points["Big rect. left main"] == points["Big rect. left top"] == Confusion(1, 1, 0)
    assert points["Circle right"] == Confusion(0, 9, 0)
    assert points["Big rect. right top"] == Confusion(0, 2, 0)
    assert points["Side line top"] == Confusion(0, 0, 1)
    np.testing.assert_allclose(evaluation.segment_errors(20.0)["Big rect. left top"], [0.0, 30.0], atol=1e-9)


def test_the_side_may_change_with_the_threshold():
    """Right within 10 px with its own labels, never with the others: at 5 px it is a tie, which the others win."""
    evaluation = from_above({"Big rect. left main": [(113.0, 200.0)]})
    assert evaluation.turned.tolist() == [[True, False, False]]
    assert "Big rect. left main" not in evaluation.segment_errors(5.0)
    np.testing.assert_allclose(evaluation.segment_errors(5.0)["Big rect. right main"], 727.0)
    np.testing.assert_allclose(evaluation.segment_errors(10.0)["Big rect. left main"], 7.0)


def test_nothing_to_count():
    away = Camera.from_angles(np.pi, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)
    none = evaluate_segments([], [], SIZE)
    assert np.isnan(none.completeness)
    assert np.all(np.isnan([none.accuracy, none.precision, none.recall]))
    assert none.per_label(5.0) == none.segment_errors(5.0) == {}
    missing = evaluate_segments([None], [{"Middle line": [(1.0, 2.0)]}], SIZE)
    assert missing.completeness == 0.0
    assert np.all(np.isnan([missing.accuracy, missing.precision, missing.recall, missing.frame_accuracy[0]]))
    unseen = evaluate_segments([away], [{"Middle line": [(1.0, 2.0)]}], SIZE)
    assert unseen.accuracy.tolist() == unseen.recall.tolist() == [0.0] * 3
    assert np.all(np.isnan(unseen.precision))
    empty = evaluate_segments([away], [{"Middle line": np.zeros((0, 2)), "Circle left": []}], SIZE)
    assert empty.accuracy.tolist() == [0.0] * 3  # as SoccerNet counts it
    assert np.all(np.isnan([empty.precision, empty.recall]))
    assert np.isnan([Confusion(0, 0, 0).accuracy, Confusion(0, 0, 1).precision, Confusion(0, 1, 0).recall]).all()


# --- what holds whatever the numbers ---


@st.composite
def evaluated(draw):
    """Frames whose cameras are good, off, absent, absurd and those of other frames: (predictions, annotations)."""
    views = draw(st.lists(cameras(lens=False, image_sizes=(SIZE,)), min_size=2, max_size=5))
    seen = [observe(whole_circle_markings(FIELD), camera) for camera in views]
    frames = [draw(labelled_frames(frame, numbers(0.0, 10.0), least=2)) for frame in seen]
    return [draw(predictions(camera) | st.sampled_from([views[0], None])) for camera in views], frames


def predictions(camera):
    def off(turn):
        return Camera.from_angles(*(camera.angles + turn), camera.K[0, 0], camera.C, SIZE)

    def absurd(C, dist):
        return Camera(camera.K * (-1, 1, 1), camera.R, C, SIZE, dist, checked=False)

    turns, anything = vectors([-0.01] * 3, [0.01] * 3), vectors([-3.0] * 12, [3.0] * 12)
    return st.just(camera) | turns.map(off) | st.builds(absurd, vectors([-3.0] * 3, [3.0] * 3), anything)


def assert_same(a, b):
    np.testing.assert_array_equal(a.found, b.found)
    np.testing.assert_array_equal(a.turned, b.turned)
    np.testing.assert_array_equal(a.segments, b.segments)
    np.testing.assert_array_equal(a.points, b.points)
    for frame, other in zip(a.errors, b.errors, strict=True):
        for side, other_side in zip(frame, other, strict=True):
            assert list(side) == list(other_side)
            for label in side:
                np.testing.assert_allclose(side[label], other_side[label], rtol=0, atol=1e-9)


@given(drawn=evaluated())
def test_turned_labels_change_nothing_but_the_side(drawn):
    predictions, frames = drawn
    turned = [{FIELD.symmetric[label]: xy for label, xy in frame.items()} for frame in frames]
    a, b = (evaluate_segments(predictions, annotations, SIZE) for annotations in (frames, turned))
    np.testing.assert_array_equal(a.frame_accuracy, b.frame_accuracy)
    assert np.all((a.turned | b.turned)[a.found])  # ties are both
    assert not np.any(b.turned & ~a.turned & (a.segments[..., 0].sum(axis=-1) == 0))


@given(data=st.data(), drawn=evaluated(), chunk=st.sampled_from([1, 2, 5]))
def test_frames_do_not_know_of_each_other(data, drawn, chunk):
    predictions, frames = drawn
    whole = evaluate_segments(predictions, frames, SIZE)
    with mock.patch.object(accuracy, "CHUNK", chunk):
        assert_same(whole, evaluate_segments(predictions, frames, SIZE))
    order = data.draw(st.permutations(range(len(frames))))
    other = evaluate_segments([predictions[i] for i in order], [frames[i] for i in order], SIZE)
    np.testing.assert_array_equal(whole.frame_accuracy[order], other.frame_accuracy)
    np.testing.assert_array_equal(whole.points[order], other.points)
    np.testing.assert_allclose(whole.accuracy, other.accuracy, rtol=1e-12)


@given(drawn=evaluated())
def test_missing_predictions_change_completeness_alone(drawn):
    predictions, frames = drawn
    all_of_them = evaluate_segments(predictions, frames, SIZE)
    found = [i for i, prediction in enumerate(predictions) if prediction is not None]
    alone = evaluate_segments([predictions[i] for i in found], [frames[i] for i in found], SIZE)
    for name in ("accuracy", "precision", "recall"):
        np.testing.assert_allclose(getattr(all_of_them, name), getattr(alone, name), rtol=1e-12)
    assert all_of_them.per_label(10.0) == alone.per_label(10.0)
    assert all_of_them.per_label_points(10.0) == alone.per_label_points(10.0)
    assert all_of_them.completeness == len(found) / len(frames)
    assert np.array_equal(np.isnan(all_of_them.frame_accuracy[:, 0]), ~all_of_them.found)


@given(drawn=evaluated())
def test_counts_add_up_and_grow_with_the_threshold(drawn):
    predictions, frames = drawn
    limits = (0.5, 2.0, 5.0, 20.0, 1e4)
    evaluation = evaluate_segments(predictions, frames, SIZE, thresholds=limits)
    assert np.all(np.diff(evaluation.frame_accuracy[evaluation.found], axis=1) >= 0.0)
    assert evaluation.segments.sum(axis=-1).max() <= 1
    for f in np.flatnonzero(evaluation.found):
        for t in range(len(limits)):
            mirrored = bool(evaluation.turned[f, t])
            given_labels = {FIELD.symmetric[label] if mirrored else label: len(xy) for label, xy in frames[f].items()}
            for label, segment, point in zip(
                evaluation.labels, evaluation.segments[f, t], evaluation.points[f, t], strict=True
            ):
                tp, fp, fn = segment
                projected = label in evaluation.errors[f][mirrored] or (tp + fp > 0)
                assert tp + fp == projected
                assert fn == (label in given_labels and not projected)
                extra = (9 if "Circle" in label else 2) * projected
                assert point.sum() == given_labels.get(label, extra)
                if label in given_labels and projected:
                    distance = evaluation.errors[f][mirrored][label]
                    assert point[0] == np.count_nonzero(distance < limits[t])
                    assert tp == (point[0] == len(distance))


def everything_in_view(camera, field=FIELD):
    """Pixels of all that SoccerNet would sample in the image."""
    frame = {}
    for label, segment in whole_circle_markings(field).items():
        xy = camera.project(sample_segments({label: segment}, field.terrain).X)
        xy = xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)]
        if len(xy):
            frame[label] = xy
    return frame


def test_cameras_of_a_crowned_field_are_scored_on_its_ground_where_that_is_asked():
    camera = Camera.from_angles(0.0, 1.35, 0.0, 900.0, (0.0, 66.0, -16.0), SIZE)
    crowned = FIELD.with_ground(Ground(0.5))
    frame = everything_in_view(camera, crowned)
    on_ground = evaluate_segments([camera], [frame], SIZE, thresholds=(1.0,), field=crowned)
    assert on_ground.accuracy.tolist() == [1.0]
    assert evaluate_segments([camera], [frame], SIZE, thresholds=(1.0,)).accuracy[0] < 0.8


@given(camera=cameras(lens=False))
def test_a_perfect_camera_is_perfect(camera):
    camera = camera.scaled(SIZE)
    frame = everything_in_view(camera)
    assume(frame)
    evaluation = evaluate_segments([camera], [frame], SIZE, thresholds=(0.01, 5.0))
    assert evaluation.accuracy.tolist() == evaluation.precision.tolist() == evaluation.recall.tolist() == [1.0, 1.0]
    assert set(evaluation.per_label(5.0)) == set(frame)


def test_a_perfect_camera_with_a_lens_and_another_field():
    field = soccer(100.0, 64.0)
    camera = Camera.from_angles(0.3, 1.35, 0.01, 1200.0, (2.0, 65.0, -18.0), SIZE, k=(-0.2, 0.02))
    frame = everything_in_view(camera, field)
    assert len(frame) > 5
    assert evaluate_segments([camera], [frame], SIZE, field=field).accuracy.tolist() == [1.0, 1.0, 1.0]
    assert evaluate_segments([camera], [frame], SIZE).accuracy[0] < 0.7
    without = Camera.from_angles(0.3, 1.35, 0.01, 1200.0, (2.0, 65.0, -18.0), SIZE)
    assert evaluate_segments([without], [frame], SIZE, field=field).accuracy[0] < 0.7


@examples(30)
@given(
    views=st.lists(cameras(lens=False, stands=("main center",), image_sizes=(SIZE,)), min_size=1, max_size=2),
    distance=numbers(0.0, 8.0),
    scale=st.sampled_from([1.0, -1.0, 1e-3, -40.0]),
)
def test_homographies_are_evaluated_as_the_cameras_they_come_from(views, distance, scale):
    """Where the whole field is in front of the camera: a homography does not know what is behind it."""
    frames = [displaced(observe(whole_circle_markings(FIELD), camera), distance) for camera in views]
    corners = np.array([(x, y, 0.0) for x in (-52.5, 52.5) for y in (-34.0, 34.0)])
    assume(all(np.all((corners - camera.C) @ camera.R[2] > 0.1) for camera in views))
    a = evaluate_segments(views, frames, SIZE, planar=True)
    b = evaluate_segments([scale * camera.pinhole_homography for camera in views], frames, SIZE, planar=True)
    np.testing.assert_array_equal(a.segments, b.segments)
    np.testing.assert_array_equal(a.points, b.points)
    for label, distances in a.segment_errors(5.0).items():
        # single precision of cameras, for points far outside the image too
        np.testing.assert_allclose(distances, b.segment_errors(5.0)[label], rtol=0, atol=0.01)


def test_cameras_and_homographies_side_by_side(synthetic):
    records, annotations = (values[:4] for values in synthetic)
    views = [camera_from_record(record, SIZE, checked=False) for record in records]
    frames = [parse_annotation(json.dumps(annotation), SIZE, unknown=True) for annotation in annotations]
    mixed = [views[0], views[1].pinhole_homography, None, views[3]]
    evaluation = evaluate_segments(mixed, frames, SIZE, planar=True)
    for f in (0, 1, 3):
        alone = evaluate_segments([mixed[f]], [frames[f]], SIZE, planar=True)
        np.testing.assert_array_equal(evaluation.segments[f], alone.segments[0])


def test_labels_with_their_trailing_blank(synthetic):
    camera = Camera.from_angles(-0.6, 1.35, 0.0, 900.0, (0.0, 60.0, -15.0), SIZE)
    frame = observe(MARKINGS, camera)
    assert "Goal left post left" in frame
    blank = {label + " " if label == "Goal left post left" else label: xy for label, xy in frame.items()}
    assert_same(evaluate_segments([camera], [frame], SIZE), evaluate_segments([camera], [blank], SIZE))


# --- wrong input ---

CAMERA = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)
FRAME = {"Middle line": [(480.0, 200.0), (480.0, 300.0)]}


@pytest.mark.parametrize(
    ("predictions", "annotations", "options", "message"),
    [
        ([CAMERA], [], {}, "as many predictions as annotations, got 1 and 0: give None"),
        ([FROM_ABOVE], [FRAME], {}, "evaluate them with planar=True"),
        ([CAMERA], [{"Midle line": [(1, 2)]}], {}, "frame 0: 'Midle line' is not an evaluated segment"),
        (
            [None, CAMERA],
            [FRAME, {"Circle central left": [(1, 2)]}],
            {},
            "frame 1: 'Circle central left' is not an evaluated segment",
        ),
        ([CAMERA], [{"CENTER_MARK": [(1, 2)]}], {}, "'CENTER_MARK' is not an evaluated segment"),
        ([CAMERA], [{"Middle line": [1.0, 2.0]}], {}, r"'Middle line': expected finite pixels of shape \(n, 2\)"),
        ([CAMERA], [{"Middle line": [(1, 2, 3), (3, 4, 5)]}], {}, "expected finite pixels"),
        ([CAMERA], [{"Middle line": [(1, 2), (3,)]}], {}, "expected finite pixels"),
        ([CAMERA], [{"Middle line": [(1, np.nan)]}], {}, "expected finite pixels"),
        ([CAMERA], [{"Middle line": "x"}], {}, "expected finite pixels"),
        ([CAMERA], [{"Middle line": [(1, 2)], " Middle line": [(1, 2)]}], {}, "'Middle line' is given twice"),
        ([CAMERA], ["Middle line"], {}, "frame 0: expected a mapping of labels"),
        ([np.eye(4)], [FRAME], {"planar": True}, r"expected a Camera or .* got an array of shape \(4, 4\)"),
        ([np.full((3, 3), np.inf)], [FRAME], {"planar": True}, "expected a Camera or .* as a finite array"),
        (["camera"], [FRAME], {}, "expected a Camera or .* got str"),
        ([CAMERA], [FRAME], {"thresholds": ()}, "thresholds must be a sequence of positive pixels"),
        ([CAMERA], [FRAME], {"thresholds": (5.0, -1.0)}, "thresholds must be a sequence of positive"),
        ([CAMERA], [FRAME], {"thresholds": (np.nan,)}, "thresholds must be a sequence of positive"),
    ],
)
def test_wrong_input(predictions, annotations, options, message):
    with pytest.raises(ValueError, match=message):
        evaluate_segments(predictions, annotations, SIZE, **options)


def test_a_calibration_is_no_camera():
    (calibration,) = calibrate_batch(FIELD, [observe(MARKINGS, CAMERA)], SIZE)
    with pytest.raises(ValueError, match="for a Calibration give its `camera`"):
        evaluate_segments([calibration], [FRAME], SIZE)


def test_wrong_image_size_and_threshold():
    with pytest.raises(ValueError, match="image_size must be"):
        evaluate_segments([CAMERA], [FRAME], (960, 540, 3))
    evaluation = evaluate_segments([CAMERA], [FRAME], SIZE)
    for table in (evaluation.per_label, evaluation.per_label_points, evaluation.segment_errors):
        with pytest.raises(ValueError, match=r"threshold must be one of \(5.0, 10.0, 20.0\), got 7"):
            table(7.0)
