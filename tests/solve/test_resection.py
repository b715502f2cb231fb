"""The start of a calibration from points: the best of many DLTs."""

import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from objects import SIZE, any_object, objects, relative_error
from strategies import bounded, examples, numbers, vectors

from fieldcalib import PINHOLE_FLAGS, Camera, calibrate_from_points
from fieldcalib.geometry.homography import dehomogenize, homogenize
from fieldcalib.problem.evaluation import LOG_F_RANGE
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.solve.from_points import Cameras, Points, _start, resect
from fieldcalib.solve.request import GivenCamera, Task
from fieldcalib.solve.solver_options import CalibrationFlags

F = CalibrationFlags


def started(X, xy, K, dist):
    """What `_start` makes of points, with K given, focal length included, and everything else open."""
    flags = PINHOLE_FLAGS | F.CALIB_FIX_FOCAL_LENGTH
    points = Points(tuple(f"point {i}" for i in range(len(X))), X, xy, np.ones(len(X)))
    return _start(points, Task(points.segments, GivenCamera(K, dist), flags, prior=None).options(SIZE))


@given(
    drawn=objects(planar=False, count=12),
    offset=vectors((-40.0, -40.0), (40.0, 40.0)),
    aspect=numbers(0.8, 1.25),
    k1=numbers(-0.2, 0.2),
)
def test_what_is_known_is_taken_out_before_the_dlt(drawn, offset, aspect, k1):
    """Lens, aspect ratio and principal point: the DLT of what is left is exact."""
    X, camera, distance = drawn
    K = camera.K * [[1.0], [aspect], [1.0]]
    K[:2, 2] += offset
    camera = Camera(K, camera.R, camera.C, SIZE, (k1, 0.0))
    start = started(X, camera.project(X), K, (k1, 0.0))
    np.testing.assert_allclose(start.K, K, rtol=1e-9)
    assert relative_error(start, camera, distance) < 1e-5


def test_a_known_focal_length_decides_the_distance():
    """Seen head-on a plane has a camera at any distance, each with its focal length."""
    X = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0.5, 0, 0]])
    camera = Camera(np.array([[2500.0, 0, 480], [0, 2500.0, 270], [0, 0, 1]]), np.eye(3), (0.1, 0.2, -20.0), SIZE)
    assert relative_error(started(X, camera.project(X), camera.K, None), camera) < 1e-5


@pytest.mark.parametrize("planar", [True, pytest.param(False, marks=pytest.mark.slow)])
@given(
    data=st.data(),
    wrong=st.sets(st.integers(0, 19), min_size=6, max_size=6),
    by=vectors((100.0, 100.0), (300.0, 300.0), count=6),
)
@examples(10)
def test_resection_finds_a_camera_among_gross_errors(planar, data, wrong, by):
    """Its camera costs no more than the true one, and the calibration that starts from it ends there.

    By a wide loss a camera that comes near a few of the wrong points may cost less than the one that meets all others.
    """
    X, camera, distance = data.draw(objects(planar=planar, count=20))
    xy = camera.project(X)
    xy[sorted(wrong)] += by
    u, loss = xy - camera.principal_point, RobustLoss("cauchy", 20.0)
    found = resect(X, u, loss, SIZE[0])
    true = Cameras(np.array([camera.focal_length]), camera.R[None], camera.C[None])
    cost, least = (one.costs(X, u, np.ones(20), loss)[0] for one in (found, true))
    assert cost <= least * (1.0 + 1e-6)
    calibrated = calibrate_from_points(X, xy, SIZE, prior=None).camera
    assert calibrated.focal_length == pytest.approx(camera.focal_length, rel=0.05)
    np.testing.assert_allclose(calibrated.R, camera.R, atol=0.05)
    np.testing.assert_allclose(calibrated.C, camera.C, atol=0.1 * distance)


@pytest.mark.parametrize("planar", [True, False])
@given(data=st.data())
@examples(10)
def test_of_points_that_look_orthographic_the_focal_length_is_possible_still(planar, data):
    """From 1e5 times as far away, with a lens as long."""
    X, camera, _ = data.draw(objects(planar=planar, count=12))
    centroid = X.mean(axis=0)
    K = camera.K * [[1e5, 0.0, 1.0], [0.0, 1e5, 1.0], [0.0, 0.0, 1.0]]
    far = Camera(K, camera.R, centroid + 1e5 * (camera.C - centroid), SIZE)
    found = resect(X, far.project(X) - far.principal_point, RobustLoss("cauchy", 20.0), 960.0)
    low, high = LOG_F_RANGE
    assert low < np.log(found.f[0] / 960.0) < high


@given(share=bounded((20, 2), 0.0, 1.0))
def test_resection_has_most_points_in_front(share):
    """Behind a camera its homography maps points into the image too, but it does not see them."""
    camera = Camera.from_angles(0.0, 1.3, 0.0, 900.0, (0.0, 0.0, -5.0), SIZE)
    scattered = (share + np.random.default_rng(0).random((20, 2))) / 2.0
    x = 2.0 * scattered[:, 0] - 1.0
    y = np.where(np.arange(20) < 6, -80.0 + 40.0 * scattered[:, 1], 5.0 + 5.0 * scattered[:, 1])
    X = np.column_stack([x * np.abs(y) / 2.0, y, np.zeros(20)])
    assert np.sum(camera.depth(X) > 0.0) == 6 < np.sum(camera.depth(X) < 0.0)
    assert camera.depth(X.mean(axis=0)) > 0.0
    u = dehomogenize(homogenize(X[:, :2]) @ camera.homography.T) - camera.principal_point
    found = resect(X, u, RobustLoss("cauchy", 20.0), 960.0)
    assert np.sum((X - found.C[0]) @ found.R[0][2] > 0.0) >= 14


@pytest.mark.parametrize("planar", [True, False])
def test_many_points_cost_little(planar):
    X, camera, distance = any_object(np.random.default_rng(0), planar=planar, count=5000)
    u = camera.project(X) - camera.principal_point
    u[::3] += (200.0, -100.0)
    tracemalloc.start()
    try:
        began = time.perf_counter()
        found = resect(X, u, RobustLoss("cauchy", 20.0), 960.0)
        seconds = time.perf_counter() - began
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert seconds < 1.0
    assert peak < 100 * 2**20
    assert found.f[0] == pytest.approx(camera.focal_length, rel=1e-6)
    np.testing.assert_allclose(found.C[0], camera.C, atol=1e-5 * distance)
