"""The segment reprojection residual and its Jacobian."""

import numpy as np
import pytest
from hypothesis import assume, given
from numdiff import central_differences, column_errors
from strategies import angle, cameras, numbers, vectors
from synthetic import displaced, observe, random_camera, random_distorted

from fieldcalib.fields.segments import Arc, Line, PointCloud
from fieldcalib.fields.soccer import soccer
from fieldcalib.fields.stands import DISTRIBUTIONS
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.observations import pack
from fieldcalib.problem.parameters import (
    CENTER,
    LENS,
    LOG_ASPECT,
    LOG_F,
    PARAMETERS,
    PRINCIPAL_POINT,
    camera_from_theta,
    theta_from_camera,
)
from fieldcalib.problem.residuals import foot_points, segment_residuals, segment_residuals_with_jacobian

FIELD = soccer()
CIRCLE = FIELD["Circle central"]
ALL_KINDS = {
    **FIELD,
    # gently curved: the parts between its samples join up to 1e-9 px, which the differences do not feel
    "large circle": PointCloud(Arc((6.0, 3.0, 0.0), 18.0).sample(0.05), ordered=True),
    "balls": PointCloud([(-30.0, -10.0, -0.1), (-10.0, 5.0, -0.1), (0.0, 0.0, -0.1), (20.0, -5.0, -0.1)]),
    "tilted hoop": Arc((-20.0, 5.0, -2.0), 3.0, u=(1.0, 0.0, 0.0), v=(0.0, 0.6, -0.8)),
}
EVERYTHING = np.ones(len(PARAMETERS), dtype=bool)

# Steps of the differences: about 3e-3 px, little against the sharpest ellipse and much against rounding.
STEPS = np.array([3e-6] * 4 + [3e-4] * 3 + [3e-6] * 2 + [1e-3] * 2 + [3e-6])


def numeric_jacobian(theta, observations, free=EVERYTHING):
    """Derivatives of the residuals by the free parameters, through theta itself; rows of padding are zero."""

    def residuals(values):
        moved = theta.copy()
        moved[:, free] = values
        return segment_residuals(moved, observations) * (observations.weight > 0.0)

    return central_differences(residuals, theta[:, free], STEPS[free])


def jacobian_errors(jacobian, theta, observations, free=EVERYTHING):
    """Relative error of each column against central differences, (B, P)."""
    seen = observations.weight[..., None] > 0.0
    return column_errors(jacobian * seen, numeric_jacobian(theta, observations, free), floor=1e-2)


def beside_the_segments(object_segments, camera, distance, direction=0.0):
    """What the camera sees, pixels moved by up to `distance`; by less where a curve comes near to itself.

    Where two points of a curve are equally near, the distance to it has a kink and no derivative.
    """
    frame = {}
    for label, xy in observe(object_segments, camera, per_line=2, per_curve=9).items():
        segment = object_segments[label]
        limit = np.full(len(xy), distance)
        if isinstance(segment, Arc):
            room = _room(xy, camera.project(Arc(segment.center, segment.radius, u=segment.u, v=segment.v).sample(0.01)))
            if room.min() < 2.0:  # px: seen from its edge, with two sides that are one
                continue
            limit = np.minimum(0.3 * room, distance)
        elif isinstance(segment, PointCloud):
            limit = (
                np.minimum(0.3 * _room(xy, camera.project(segment.X)), distance) if segment.ordered else limit / 10.0
            )
        frame |= displaced({label: xy}, limit[:, None], direction)
    return frame


def _room(xy, curve):
    """Radius of the smallest circle that touches the curve at each of its points xy and meets it elsewhere."""
    nearest = np.nanargmin(np.linalg.norm(xy[:, None] - curve, axis=2), axis=1)
    tangent = curve[(nearest + 1) % len(curve)] - curve[nearest - 1]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) / (
        np.linalg.norm(tangent, axis=1, keepdims=True) + 1e-12
    )
    chord = curve - curve[nearest][:, None]
    across = np.abs(np.einsum("nk,nmk->nm", normal, chord))
    radius = np.sum(np.square(chord), axis=2) / (2.0 * across + 1e-12)
    away = np.linalg.norm(chord, axis=2) > 1e-9
    return np.nanmin(np.where(away, radius, np.nan), axis=1)


def random_problem(stand, lens, count, distance=20.0, seed=0):
    rng, seen, frames = np.random.default_rng(seed), [], []
    while len(frames) < count:
        camera = random_camera(stand, rng)
        if lens:
            camera = random_distorted(camera, rng)
        frame = beside_the_segments(ALL_KINDS, camera, distance, rng.uniform(-np.pi, np.pi))
        if len(frame) > 3:
            seen.append(camera)
            frames.append(frame)
    return np.array([theta_from_camera(camera) for camera in seen]), pack(ALL_KINDS, frames, seen[0].image_size)


@pytest.mark.parametrize("lens", [False, True], ids=["pinhole", "lens"])
@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_jacobian_equals_central_differences_column_by_column(name, lens):
    theta, observations = random_problem(name, lens, 12)
    _, J = segment_residuals_with_jacobian(theta, observations, EVERYTHING)
    errors = jacobian_errors(J, theta, observations)
    worst = dict(zip(PARAMETERS, errors.max(axis=0), strict=True))
    assert max(worst.values()) < 1e-6, worst


@pytest.mark.parametrize("distance", [0.0, 50.0])
def test_jacobian_holds_on_the_curve_and_far_from_it(distance):
    theta, observations = random_problem("main center", True, 12, distance, seed=1)
    _, J = segment_residuals_with_jacobian(theta, observations, EVERYTHING)
    assert jacobian_errors(J, theta, observations).max() < 1e-6


def test_the_checker_finds_a_wrong_jacobian():
    theta, observations = random_problem("main center", True, 3)
    _, J = segment_residuals_with_jacobian(theta, observations, EVERYTHING)
    numeric = numeric_jacobian(theta, observations)
    for column in range(J.shape[2]):
        wrong = J * (observations.weight[..., None] > 0.0)
        wrong[:, :, column] *= 1.0 + 1e-5
        errors = column_errors(wrong, numeric, floor=1e-2)
        assert errors[:, column].min() > 5e-6
        assert np.delete(errors, column, axis=1).max() < 1e-6


@pytest.mark.parametrize("free", [[LOG_F], [0, 2], [5], [8], [10, 11], [1, 3, 6, 7, 9]])
def test_jacobian_of_some_parameters_is_a_part_of_the_whole(free):
    theta, observations = random_problem("main left", True, 3)
    mask = np.isin(np.arange(len(PARAMETERS)), free)
    r, part = segment_residuals_with_jacobian(theta, observations, mask)
    _, whole = segment_residuals_with_jacobian(theta, observations, EVERYTHING)
    np.testing.assert_allclose(part, whole[:, :, free], rtol=1e-12, atol=1e-11)
    np.testing.assert_array_equal(r, segment_residuals(theta, observations))


@given(camera=cameras(lens=True))
def test_pixels_on_their_segments_have_no_residual(camera):
    frame = observe(ALL_KINDS, camera)
    assume(frame)
    observations = pack(ALL_KINDS, [frame], camera.image_size)
    r = segment_residuals(theta_from_camera(camera)[None], observations)[0]
    np.testing.assert_allclose(r, 0.0, atol=1e-6)


def points_along(segment, share):
    """Points of the whole line or circle; 0 and 1 are the ends of the line, a full turn of the circle."""
    if isinstance(segment, Line):
        return np.array(segment.start) + share[:, None] * np.subtract(segment.end, segment.start)
    phi = 2.0 * np.pi * share[:, None]
    return segment.center + segment.radius * (np.cos(phi) * np.array(segment.u) + np.sin(phi) * np.array(segment.v))


@given(camera=cameras(lens=True), direction=angle(np.pi), distance=numbers(0.0, 20.0))
def test_residual_is_the_distance_to_the_nearest_point_of_the_image_of_the_segment(camera, direction, distance):
    frame = beside_the_segments(FIELD.markings, camera, distance, direction)
    assume(frame)
    observations = pack(FIELD, [frame], camera.image_size)
    r = segment_residuals(theta_from_camera(camera)[None], observations)[0]
    for index, label in enumerate(observations.labels):
        rows = observations.label[0] == index
        if not rows.any():
            continue
        segment = FIELD[label]
        coarse = np.linspace(-1.0, 2.0, 2001)
        image = camera.project(points_along(segment, coarse))
        for distance, xy in zip(np.abs(r[rows]), frame[label], strict=True):
            nearest = int(np.nanargmin(np.linalg.norm(image - xy, axis=1)))
            if 0 < nearest < len(coarse) - 1:  # else the sampled part ends before the foot point
                fine = camera.project(points_along(segment, np.linspace(*coarse[[nearest - 1, nearest + 1]], 201)))
                gap = np.nanmin(np.linalg.norm(fine - xy, axis=1))
                spacing = np.nanmax(np.linalg.norm(np.diff(fine, axis=0), axis=1))
                assert distance - 1e-6 <= gap <= np.hypot(distance, spacing) + 1e-6  # the foot is between two samples


def behind_the_goal_line():
    """A camera in the penalty area that looks at the goal: both touchlines pass behind it."""
    return Camera.from_angles(np.radians(-80), np.radians(86), 0.02, 700.0, (-38.0, 3.0, -2.0), (960, 540))


def test_end_points_behind_the_camera_do_not_hurt():
    camera = behind_the_goal_line()
    theta = theta_from_camera(camera)[None]
    labels = ("Side line top", "Side line bottom")
    frame = {}
    for label in labels:
        segment = FIELD[label]
        assert camera.depth(segment.start) > 0.0 > camera.depth(segment.end)
        xy = camera.project(segment.sample(0.1))
        frame[label] = xy[np.isfinite(xy).all(axis=1)][[0, 20]]
    observations = pack(FIELD, [frame], camera.image_size)
    np.testing.assert_allclose(segment_residuals(theta, observations), 0.0, atol=1e-7)
    moved = {label: xy + (3.0, -5.0) for label, xy in frame.items()}
    observations = pack(FIELD, [moved], camera.image_size)
    free = EVERYTHING.copy()
    free[LENS] = False  # pixels far outside the image: the lens has nothing to say there
    _, J = segment_residuals_with_jacobian(theta, observations, free)
    assert jacobian_errors(J, theta, observations, free).max() < 1e-6


def test_a_foot_point_at_infinity_has_a_residual_and_a_jacobian():
    camera = Camera.from_angles(0.3, 1.45, 0.0, 1200.0, (0.0, 60.0, -12.0), (960, 540))
    theta = theta_from_camera(camera)[None]
    vanishing = camera.homography @ (1.0, 0.0, 0.0)  # of the touchlines
    normal_step = np.array([0.2, 4.0])
    frame = {"Side line top": np.array([vanishing[:2] / vanishing[2], vanishing[:2] / vanishing[2] + normal_step])}
    observations = pack(FIELD, [frame], camera.image_size)
    feet = foot_points(theta, observations)
    assert abs(feet.inverse_depth[0, 0]) < 1e-12
    assert abs(feet.r[0, 0]) < 1e-9
    free = EVERYTHING.copy()
    free[LENS] = False
    _, J = segment_residuals_with_jacobian(theta, observations, free)
    assert np.all(np.isfinite(J))
    assert jacobian_errors(J, theta, observations, free).max() < 1e-6


@given(camera=cameras(lens=False), offset=vectors((-9.0, -9.0), (9.0, 9.0)), share=numbers(-2.0, 2.0))
def test_sliding_along_a_line_changes_nothing(camera, offset, share):
    theta, image_size = theta_from_camera(camera), camera.image_size
    lines = {label: segment for label, segment in FIELD.items() if isinstance(segment, Line)}
    frame = observe(lines, camera)
    assume(frame)
    slid = {label: xy + offset + share * (xy[-1] - xy[0]) for label, xy in frame.items()}
    moved = {label: xy + offset for label, xy in frame.items()}
    r, r_slid = (segment_residuals(theta[None], pack(FIELD, [f], image_size)) for f in (moved, slid))
    np.testing.assert_allclose(r_slid, r, atol=1e-6)


@given(camera=cameras(lens=True), direction=angle(np.pi))
def test_enlarging_the_image_enlarges_the_residuals(camera, direction):
    theta, (width, height) = theta_from_camera(camera), camera.image_size
    frame = beside_the_segments(FIELD.markings, camera, 5.0, direction)
    assume(frame)
    r = segment_residuals(theta[None], pack(FIELD, [frame], (width, height)))
    larger = theta.copy()
    larger[LOG_F] += np.log(2.0)
    larger[PRINCIPAL_POINT] *= 2.0
    doubled = {label: 2.0 * xy for label, xy in frame.items()}
    r_larger = segment_residuals(larger[None], pack(FIELD, [doubled], (2 * width, 2 * height)))
    np.testing.assert_allclose(r_larger, 2.0 * r, atol=1e-5)


@given(camera=cameras(lens=False), direction=angle(np.pi))
def test_a_lens_of_zero_is_no_lens(camera, direction):
    theta, image_size = theta_from_camera(camera), camera.image_size
    frame = beside_the_segments(ALL_KINDS, camera, 10.0, direction)
    assume(frame)
    observations = pack(ALL_KINDS, [frame], image_size)
    nearly = theta.copy()
    nearly[LENS.start] = 1e-13  # takes the way through the lens
    r, J = segment_residuals_with_jacobian(theta[None], observations, EVERYTHING)
    r_bent, J_bent = segment_residuals_with_jacobian(nearly[None], observations, EVERYTHING)
    np.testing.assert_allclose(r_bent, r, atol=1e-6)
    np.testing.assert_allclose(J_bent, J, rtol=1e-5, atol=1e-4)


def test_frames_together_or_one_by_one_have_the_same_residuals():
    theta, observations = random_problem("main right", False, 6)
    r = segment_residuals(theta, observations)
    for t in range(len(theta)):
        alone = observations.take(np.array([t]))
        seen = observations.weight[t] > 0.0
        np.testing.assert_allclose(segment_residuals(theta[t : t + 1], alone)[0, seen], r[t, seen], atol=1e-9)


def test_a_point_has_two_residuals_in_pixels():
    camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    xy = camera.project(FIELD["CENTER_MARK"].X) + (3.0, -4.0)
    r = segment_residuals(theta_from_camera(camera)[None], pack(FIELD, [{"CENTER_MARK": xy[None]}], (960, 540)))
    np.testing.assert_allclose(r, [[3.0, -4.0]], atol=1e-9)


def test_an_unordered_cloud_gives_the_offset_to_its_nearest_sample():
    cloud = {"cloud": PointCloud([(-5.0, 0.0, 0.0), (5.0, 0.0, 0.0), (5.0, 5.0, -1.0)])}
    camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    xy = camera.project(cloud["cloud"].X)[[2, 0]] + (1.0, 2.0)
    observations = pack(cloud, [{"cloud": xy}], (960, 540))
    theta = theta_from_camera(camera)[None]
    np.testing.assert_allclose(segment_residuals(theta, observations), [[1.0, 1.0, 2.0, 2.0]], atol=1e-9)
    _, J = segment_residuals_with_jacobian(theta, observations, EVERYTHING)
    assert jacobian_errors(J, theta, observations).max() < 1e-6


def test_an_ordered_cloud_is_the_curve_that_it_samples():
    circle = {"circle": CIRCLE}
    cloud = {"circle": PointCloud(CIRCLE.sample(0.1), ordered=True)}
    camera = Camera.from_angles(0.1, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    xy = camera.project(CIRCLE.sample(1.0)) + (1.0, -2.0)
    theta = theta_from_camera(camera)[None]
    r, r_cloud = (segment_residuals(theta, pack(o, [{"circle": xy}], (960, 540))) for o in (circle, cloud))
    np.testing.assert_allclose(np.abs(r_cloud), np.abs(r), atol=1e-3)


def test_a_camera_in_the_plane_of_a_circle_stops_nothing():
    camera = Camera.from_angles(0.0, np.pi / 2, 0.0, 900.0, (0.0, 30.0, 0.0), (960, 540))
    frame = {"Circle central": np.array([[480.0, 280.0], [400.0, 300.0]]), "Side line top": np.array([[1.0, 2.0]])}
    r, J = segment_residuals_with_jacobian(
        theta_from_camera(camera)[None], pack(FIELD, [frame], (960, 540)), np.arange(len(PARAMETERS)) < CENTER.stop
    )
    assert np.all(np.isfinite(r))
    assert np.all(np.isfinite(J))


def test_aspect_stretches_the_rows_alone():
    theta, _ = random_problem("main center", False, 2)
    theta[:, LOG_ASPECT] = 0.1
    camera = camera_from_theta(theta[0], (960, 540))
    assert np.isclose(camera.K[1, 1], np.exp(0.1) * camera.K[0, 0])
    frame = observe(FIELD.markings, camera)
    r = segment_residuals(theta[:1], pack(FIELD, [frame], (960, 540)))
    np.testing.assert_allclose(r, 0.0, atol=1e-6)


def test_a_short_ordered_cloud_is_the_same_beside_a_longer_one():
    s = np.linspace(0.0, 1.0, 5)[:, None]
    short = PointCloud(np.concatenate([20.0 * s, 8.0 * s**2, 0.0 * s], axis=1), ordered=True)
    clouds = {"short": short, "long": PointCloud(CIRCLE.sample(0.5), ordered=True)}
    camera = Camera.from_angles(0.1, 1.3, 0.0, 900.0, (0.0, 60.0, -15.0), (960, 540))
    theta = theta_from_camera(camera)[None]
    past_the_end = camera.project([[21.0, 9.0, 0.0], [20.5, 8.1, 0.0], [10.0, 2.5, 0.0]])
    alone = pack(clouds, [{"short": past_the_end}], (960, 540))
    beside = pack(clouds, [{"short": past_the_end, "long": camera.project(CIRCLE.sample(5.0))}], (960, 540))
    r, J = segment_residuals_with_jacobian(theta, alone, EVERYTHING)
    r_beside, J_beside = segment_residuals_with_jacobian(theta, beside, EVERYTHING)
    np.testing.assert_allclose(r_beside[:, :3], r, atol=1e-9)
    np.testing.assert_allclose(J_beside[:, :3], J, atol=1e-6)


def test_the_distance_to_a_circle_does_not_jump_in_its_plane():
    def distances(height):
        camera = Camera.from_angles(0.0, np.pi / 2, 0.0, 900.0, (0.0, 30.0, -height), (960, 540))
        frame = {"Circle central": np.array([[480.0, 280.0], [450.0, 300.0]])}
        return np.abs(segment_residuals(theta_from_camera(camera)[None], pack(FIELD, [frame], (960, 540))))

    np.testing.assert_allclose(distances(0.0), distances(1e-6), atol=0.1)
    assert distances(0.0).min() > 5.0
