"""Lenses that labels determine: a fisheye, by name and where no other lens explains the labels."""

import json

import numpy as np
import pytest
from hypothesis import given
from strategies import examples, generators, numbers, vectors
from synthetic import random_frames

import fieldcalib
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import FisheyeLens
from fieldcalib.problem import compilation
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.from_points import calibrate_from_points
from fieldcalib.solve.from_segments import calibrate_from_segments
from fieldcalib.solve.solver_options import LENS_FLAGS, CalibrationFlags

SIZE = (1280, 720)
FIELD = soccer(size_known=True)
FISHEYE, AUTO = LENS_FLAGS["fisheye"], LENS_FLAGS["auto"]
K = (0.03, -0.01, 0.002, 0.001)


def wide_camera(degrees=140.0, x=-5.0, height=9.0, k=K, distance=42.0):
    """A camera beside the middle of the pitch that sees most of it."""
    f = SIZE[0] / np.radians(degrees)
    return Camera.from_angles(-0.5 * x / distance, 1.25, 0.02, f, (x, distance, -height), SIZE, k=k, fisheye=True)


def seen(camera, rng=None, noise=0.0):
    """Pixels of the markings that a camera sees, a metre apart."""
    found = {}
    for label, segment in FIELD.items():
        xy = camera.project(segment.sample(1.0))
        xy = xy[np.all(np.isfinite(xy) & (xy >= 0.0) & (xy <= np.subtract(camera.image_size, 1.0)), axis=1)]
        if len(xy) > 2:
            found[label] = xy + (rng.normal(0.0, noise, xy.shape) if noise else 0.0)
    return found


def off(camera, truth):
    """Distances in metres between where two cameras see the pixels of the pitch."""
    grid = np.stack(np.meshgrid(np.linspace(0.0, 1279.0, 20), np.linspace(0.0, 719.0, 12)), axis=-1).reshape(-1, 2)
    X = truth.image_to_field(grid)
    on_pitch = np.all(np.abs(X[:, :2]) <= (52.5, 34.0), axis=1)
    return np.linalg.norm(camera.image_to_field(grid[on_pitch]) - X[on_pitch], axis=1)


@pytest.mark.slow
@examples(5)
@given(
    numbers(100.0, 150.0),
    vectors((-15.0, 5.0, 38.0), (15.0, 14.0, 48.0)),
    vectors((-0.05, -0.02, -0.005, -0.002), (0.1, 0.02, 0.005, 0.002)),
)
def test_labels_without_noise_give_back_every_parameter(degrees, place, k):
    x, height, distance = place
    truth = wide_camera(degrees, x, height, k, distance)
    found = calibrate_from_segments(FIELD, seen(truth), SIZE, flags=FISHEYE, prior=None).camera
    np.testing.assert_allclose(found.K, truth.K, rtol=0.0, atol=1e-2)
    np.testing.assert_allclose(found.C, truth.C, rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(found.R, truth.R, rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(found.dist, truth.dist, rtol=0.0, atol=1e-3)


@examples(5)
@given(numbers(100.0, 150.0), generators())
def test_noisy_labels_locate_the_pitch_and_the_lens_within_its_deviation(degrees, rng):
    truth = wide_camera(degrees)
    found = calibrate_from_segments(FIELD, seen(truth, rng, 1.0), SIZE, flags=FISHEYE)
    assert off(found.camera, truth).max() < 1.0
    assert str(found.verdict) != "reject"
    layout = found.uncertainty.layout
    error = layout.theta(found.camera) - layout.theta(truth)
    deviation = np.sqrt(np.diagonal(found.covariance))
    assert np.all(np.abs(error) < 6.0 * deviation + 1e-12)


def test_points_of_a_known_fisheye_give_the_pose_to_the_last_bit_of_the_lens():
    truth = wide_camera()
    X = np.array([(x, y, 0.0) for x in np.linspace(-40.0, 40.0, 7) for y in (-34.0, -15.0, 0.0, 15.0, 34.0)])
    xy = truth.project(X)
    kept = np.all((xy > 0.0) & (xy < SIZE), axis=1)
    flags = fieldcalib.KNOWN_INTRINSICS_FLAGS | CalibrationFlags.CALIB_FISHEYE
    found = calibrate_from_points(X[kept], xy[kept], SIZE, truth.K, truth.dist, flags=flags).camera
    assert found.fisheye
    np.testing.assert_array_equal(found.dist, truth.dist)
    np.testing.assert_array_equal(found.K, truth.K)
    np.testing.assert_allclose(found.C, truth.C, rtol=0.0, atol=0.01)  # under the prior of its place


@pytest.mark.parametrize("degrees", [90.0, *(pytest.param(one, marks=pytest.mark.slow) for one in (120.0, 150.0))])
def test_auto_takes_a_fisheye_where_it_explains_the_labels_better(degrees):
    truth, rng = wide_camera(degrees), np.random.default_rng(3)
    pixels = seen(truth, rng, 1.0)
    found = calibrate_from_segments(FIELD, pixels, SIZE, flags=AUTO)
    assert found.camera.fisheye
    assert "a fisheye lens estimated too" in found.message
    assert off(found.camera, truth).max() < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [90.0, 120.0, 150.0])
def test_swapped_labels_are_named_through_a_fisheye(degrees):
    truth, rng = wide_camera(degrees), np.random.default_rng(3)
    pixels = seen(truth, rng, 1.0)
    swapped = {**pixels, "Middle line": pixels["Side line top"], "Side line top": pixels["Middle line"]}
    mended = calibrate_from_segments(FIELD, swapped, SIZE, flags=AUTO)
    assert {one.label for one in mended.suspect_labels} == {"Middle line", "Side line top"}
    assert off(mended.camera, truth).max() < 1.0


def test_a_fisheye_lens_may_start_from_cameras_with_another():
    barrel = Camera.from_angles(0.1, 1.25, 0.0, 700.0, (-5.0, 45.0, -12.0), SIZE, k=(-0.1, 0.0))
    pixels = seen(barrel, np.random.default_rng(0), 1.0)
    (found,) = calibrate_batch(FIELD, [pixels], SIZE, flags=FISHEYE, cameras=[barrel])
    assert found.camera.fisheye
    assert off(found.camera, barrel).max() < 1.0


def test_a_batch_may_start_from_cameras_with_and_without_a_fisheye_lens():
    barrel = Camera.from_angles(0.1, 1.25, 0.0, 700.0, (-5.0, 45.0, -12.0), SIZE, k=(-0.1, 0.0))
    cameras, rng = [wide_camera(110.0), barrel, wide_camera(110.0)], np.random.default_rng(0)
    frames = [seen(one, rng, 1.0) for one in cameras]
    found = calibrate_batch(FIELD, frames, SIZE, flags=AUTO, cameras=cameras)
    assert [one.camera.fisheye for one in found] == [True, False, True]
    assert max(off(one.camera, camera).max() for one, camera in zip(found, cameras, strict=True)) < 1.0
    with pytest.raises(ValueError, match="cameras"):
        calibrate_batch(FIELD, frames[:2], SIZE, flags=AUTO, cameras=cameras)


def test_auto_keeps_the_lens_of_broadcast_cameras():
    frames, cameras = random_frames(12, seed=5, noise=1.0)
    broadcast = calibrate_batch(FIELD, frames, cameras[0].image_size, flags=AUTO)
    assert not any(one.camera.fisheye for one in broadcast)


def test_a_strong_radial_lens_is_as_good_by_either_model():
    barrel = Camera.from_angles(0.1, 1.25, 0.0, 700.0, (-5.0, 45.0, -12.0), SIZE, k=(-0.25, 0.06))
    pixels = seen(barrel, np.random.default_rng(0), 1.0)
    for lens in ("k1k2", "auto", "fisheye"):
        found = calibrate_from_segments(FIELD, pixels, SIZE, flags=LENS_FLAGS[lens])
        assert off(found.camera, barrel).max() < 1.0


def test_numpy_solves_what_compiled_code_does_not():
    layout = Layout.of(SIZE, FisheyeLens(float(np.hypot(*SIZE) / 2.0)))
    truth = wide_camera()
    observations = pack(FIELD, [seen(truth)], SIZE)
    assert compilation.kernels(layout, observations) is None
    problem = Problem(observations, layout, RobustLoss("linear", 1.0))
    assert np.abs(evaluate(problem, layout.theta(truth)[None]).r).max() < 1e-7


def test_distances_are_those_from_the_image_of_the_line_and_the_circle():
    truth = wide_camera()
    layout = Layout.of(SIZE, truth.lens)
    for label in ("Side line top", "Side line bottom", "Middle line", "Circle central"):
        xy = seen(truth)[label]
        shifted = np.clip(xy + (3.0, -6.0), 0.0, np.subtract(SIZE, 1.0))
        problem = Problem(pack(FIELD, [{label: shifted}], SIZE), layout, RobustLoss("linear", 1.0))
        r = evaluate(problem, layout.theta(truth)[None]).r[0, : len(xy)]
        segment = FIELD[label]
        if label == "Circle central":
            dense = segment.sample(0.02)
        else:  # pixels are measured against the infinite line
            start, direction = segment.vectors
            dense = start + np.linspace(-3.0, 4.0, 40_000)[:, None] * direction
        curve = truth.project(dense)
        curve = curve[np.isfinite(curve[:, 0])]
        nearest = np.min(np.linalg.norm(shifted[:, None] - curve, axis=2), axis=1)
        np.testing.assert_allclose(np.abs(r), nearest, rtol=0.0, atol=0.05)


def test_results_come_back_from_json():
    truth = wide_camera()
    found = calibrate_from_segments(FIELD, seen(truth, np.random.default_rng(1), 1.0), SIZE, flags=FISHEYE)
    record = json.loads(json.dumps(found.to_dict()))
    assert record["lens"] == "fisheye"
    again = Calibration.from_dict(record)
    assert again.camera == found.camera
    np.testing.assert_allclose(again.covariance, found.covariance, rtol=1e-6, atol=1e-12)
    with pytest.raises(ValueError, match="'lens': expected 'fisheye'"):
        Calibration.from_dict(record | {"lens": "mirror"})


def test_a_lens_cannot_be_named_and_looked_for():
    with pytest.raises(ValueError, match="CALIB_FISHEYE and CALIB_AUTO_LENS contradict"):
        calibrate_from_segments(FIELD, seen(wide_camera()), SIZE, flags=FISHEYE | CalibrationFlags.CALIB_AUTO_LENS)
    flags = fieldcalib.KNOWN_INTRINSICS_FLAGS | CalibrationFlags.CALIB_FISHEYE
    with pytest.raises(ValueError, match="of a fisheye lens must be the four finite coefficients"):
        calibrate_from_segments(FIELD, seen(wide_camera()), SIZE, np.eye(3) * 500.0, np.zeros(5), flags=flags)
