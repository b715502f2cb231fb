"""theta <-> Camera, and the camera distributions."""

from functools import partial

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import anywhere, generators, numbers, thetas, vectors
from synthetic import visible_field_points

from fieldcalib.fields.stands import DISTRIBUTIONS, focal_length_from_fov
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import lens_coefficients
from fieldcalib.problem.layout import (
    ANGLES,
    CENTER,
    LOG_ASPECT,
    LOG_F,
    PRINCIPAL_POINT,
    camera_from_theta,
    theta_from_camera,
    turned_around,
)
from fieldcalib.problem.prior import gaussian_prior, sample_theta

# Ranges in degrees and metres: table 9 in the list of traps of the project's reference results.
MAIN = {"pan": (-45, 45), "tilt": (45, 90), "roll": (-10, 10), "fov": (8.2, 90), "y": (40, 110), "z": (-40, -5)}
BEHIND = {"tilt": (11.25, 90), "roll": (-5.6, 5.6), "fov": (8.2, 90), "y": (-20, 20), "z": (-35, -1)}
TABLE = {
    "main center": {**MAIN, "x": (-16.5, 16.5)},
    "main left": {**MAIN, "x": (-52.5, -19.5)},  # -36 -+ 16.5
    "main right": {**MAIN, "x": (19.5, 52.5)},  # 36 -+ 16.5
    "main tribune": {**MAIN, "x": (-36, 36)},
    "opposite tribune": {**MAIN, "pan": (135, 225), "x": (-36, 36), "y": (-110, -40)},  # ours: the main one turned
    "behind left goal": {**BEHIND, "pan": (45, 135), "x": (-95, -52.5)},
    "behind right goal": {**BEHIND, "pan": (-135, -45), "x": (52.5, 95)},
}
SIZE = (1280, 720)

every_distribution = pytest.mark.parametrize("distribution", DISTRIBUTIONS.values(), ids=list(DISTRIBUTIONS))


def named_ranges(distribution):
    """(low, high) of the seven parameters of a distribution as they stand in theta."""
    values = TABLE[distribution.name]
    angles = {name: np.radians(values[name]) for name in ("pan", "tilt", "roll")}
    fov = np.radians(values["fov"])
    log_f = np.log(0.5 * SIZE[0] / np.tan(fov[::-1] / 2.0))  # the widest view has the shortest focal length
    return {**angles, "log f": log_f, **{name: np.array(values[name]) for name in "xyz"}}


def assert_same_camera(theta, expected):
    """Equal parameters; pan may differ by full turns."""
    difference = theta - expected
    difference[0] = np.remainder(difference[0] + np.pi, 2.0 * np.pi) - np.pi
    np.testing.assert_allclose(difference / np.maximum(1.0, np.abs(expected)), 0.0, atol=1e-11)


# --- theta and Camera ---


@given(thetas(lens=True))
def test_theta_to_camera_to_theta(drawn):
    theta, image_size = drawn
    assert_same_camera(theta_from_camera(camera_from_theta(theta, image_size)), theta)


@given(anywhere(), numbers(0.9, 1.1), vectors((-50.0, -50.0), (50.0, 50.0)))
def test_camera_to_theta_to_camera(camera, aspect, offset):
    K = camera.K * [[1.0], [aspect], [1.0]] + [[0, 0, offset[0]], [0, 0, offset[1]], [0, 0, 0]]
    camera = Camera(K, camera.R, camera.C, camera.image_size, camera.k)
    back = camera_from_theta(theta_from_camera(camera), camera.image_size)
    for name in ("K", "R", "C", "k"):
        np.testing.assert_allclose(getattr(back, name), getattr(camera, name), rtol=1e-11, atol=1e-11, err_msg=name)


@given(thetas(lens=True))
def test_theta_and_camera_project_alike(drawn):
    theta, image_size = drawn
    camera = camera_from_theta(theta, image_size)
    X = visible_field_points(camera)
    x, y, z = ((X - theta[CENTER]) @ camera.R.T).T
    f, rho = np.exp(theta[LOG_F]), np.hypot(*image_size) / 2.0
    q = f**2 * (x**2 + y**2) / z**2 / rho**2  # 1 at the corner
    a1, a2 = lens_coefficients(theta[LENS])
    gain = 1.0 + a1 * q + a2 * q**2
    ideal = f * np.column_stack([x / z, np.exp(theta[LOG_ASPECT]) * y / z])
    np.testing.assert_allclose(camera.project(X), gain[:, None] * ideal + theta[PRINCIPAL_POINT], atol=1e-8)


def test_every_entry_of_theta_is_where_its_name_says():
    camera = Camera(
        [[1500.0, 0, 950], [0, 1530, 530], [0, 0, 1]],
        Camera.from_angles(0.3, 1.4, 0.02, 1.0, (0, 0, 0), SIZE).R,
        (1.0, 56.0, -15.0),
        SIZE,
        (0.1, 0.02),
    )
    q = (SIZE[0] ** 2 + SIZE[1] ** 2) / 4.0 / 1500.0**2
    expected = {
        "pan": 0.3,
        "tilt": 1.4,
        "roll": 0.02,
        "log f": np.log(1500.0),
        "x": 1.0,
        "y": 56.0,
        "z": -15.0,
        "a1": 0.1 * q,
        "b2": 0.02 * q * q,
        "cx": 950.0,
        "cy": 530.0,
        "log aspect": np.log(1.02),
    }
    assert tuple(expected) == PARAMETERS
    np.testing.assert_allclose(theta_from_camera(camera), list(expected.values()), rtol=1e-12)
    where = {"ANGLES": ANGLES, "CENTER": CENTER, "LENS": LENS, "PRINCIPAL_POINT": PRINCIPAL_POINT}
    assert {name: PARAMETERS[index] for name, index in where.items()} == {
        "ANGLES": ("pan", "tilt", "roll"),
        "CENTER": ("x", "y", "z"),
        "LENS": ("a1", "b2"),
        "PRINCIPAL_POINT": ("cx", "cy"),
    }
    assert (PARAMETERS[LOG_F], PARAMETERS[LOG_ASPECT]) == ("log f", "log aspect")


@given(st.floats(0.05, 3.0), st.integers(100, 4000))
def test_focal_length_of_a_field_of_view(fov, width):
    f = focal_length_from_fov(fov, width)
    assert f * np.tan(fov / 2.0) == pytest.approx(width / 2.0)
    assert Camera.from_angles(0, 1.4, 0, float(f), (0, 56, -15), (width, 90)).field_of_view == pytest.approx(fov)


def test_focal_length_of_a_right_angle_is_half_the_width():
    np.testing.assert_allclose(focal_length_from_fov(np.radians([90.0, 90.0]), 1280), 640.0)


# --- distributions ---


def test_the_distributions_are_those_of_the_table():
    assert set(DISTRIBUTIONS) == set(TABLE)
    for name, ranges in TABLE.items():
        assert DISTRIBUTIONS[name].name == name
        for parameter, low_high in ranges.items():
            assert tuple(getattr(DISTRIBUTIONS[name], parameter)) == low_high, (name, parameter)


@every_distribution
def test_prior_has_the_range_as_its_95_percent_interval(distribution):
    prior = gaussian_prior(distribution, SIZE)
    for name, (low, high) in named_ranges(distribution).items():
        i = PARAMETERS.index(name)
        assert low < high
        assert prior.mean[i] == pytest.approx((low + high) / 2.0, abs=1e-12)
        # z of a value is (value - mean) / sigma: -1.96 and 1.96 at the ends of the range
        np.testing.assert_allclose((np.array([low, high]) - prior.mean[i]) / prior.sigma[i], [-1.96, 1.96], rtol=1e-12)


@every_distribution
def test_prior_of_what_the_distributions_do_not_say(distribution):
    prior = gaussian_prior(distribution, SIZE)
    assert prior.mean.shape == prior.sigma.shape == (len(PARAMETERS),)
    np.testing.assert_array_equal(prior.mean[PRINCIPAL_POINT], [640.0, 360.0])
    np.testing.assert_array_equal(prior.mean[LENS], (0.025, 0.0))
    assert prior.mean[LOG_ASPECT] == 0.0
    assert np.all(prior.sigma > 0.0)
    # measured broadcast cameras: 67 px off at 1920 wide, 5.5 % at the corner; neither may lie beyond two sigma
    wide = gaussian_prior(distribution, (1920, 1080))
    assert np.all(67.0 / wide.sigma[PRINCIPAL_POINT] < 2.0)
    assert abs(0.055 - wide.mean[LENS][0]) / wide.sigma[LENS][0] < 2.0


@every_distribution
def test_prior_scales_with_the_image(distribution):
    small, large = gaussian_prior(distribution, SIZE), gaussian_prior(distribution, (2 * SIZE[0], 2 * SIZE[1]))
    np.testing.assert_allclose(large.mean[LOG_F] - small.mean[LOG_F], np.log(2.0))
    np.testing.assert_allclose(large.mean[PRINCIPAL_POINT], 2.0 * small.mean[PRINCIPAL_POINT])
    np.testing.assert_allclose(large.sigma[PRINCIPAL_POINT], 2.0 * small.sigma[PRINCIPAL_POINT])
    others = [i for i in range(len(PARAMETERS)) if PARAMETERS[i] not in ("log f", "cx", "cy")]
    np.testing.assert_array_equal(large.mean[others], small.mean[others])
    np.testing.assert_array_equal(np.delete(large.sigma, [9, 10]), np.delete(small.sigma, [9, 10]))


@every_distribution
def test_samples_fill_the_ranges_and_never_leave_them(distribution):
    theta = sample_theta(distribution, 2000, np.random.default_rng(0), SIZE)
    assert theta.shape == (2000, len(PARAMETERS))
    for name, (low, high) in named_ranges(distribution).items():
        values = theta[:, PARAMETERS.index(name)]
        assert np.all((values >= low - 1e-12) & (values <= high + 1e-12)), name
        # 2000 uniform draws leave 1 % of the range empty at one end with probability 0.99^2000 = 2e-9
        assert values.min() < low + 0.01 * (high - low) or name == "log f", name
        assert values.max() > high - 0.01 * (high - low) or name == "log f", name
    fov = 2.0 * np.arctan(0.5 * SIZE[0] / np.exp(theta[:, LOG_F]))
    assert np.degrees(fov.min()) < 8.2 + 0.82
    assert np.degrees(fov.max()) > 90.0 - 0.82
    np.testing.assert_array_equal(theta[:, LENS], 0.0)
    np.testing.assert_array_equal(theta[:, LOG_ASPECT], 0.0)
    np.testing.assert_array_equal(theta[:, PRINCIPAL_POINT], np.tile([640.0, 360.0], (2000, 1)))


@every_distribution
def test_the_mean_camera_looks_towards_the_field_from_above_the_ground(distribution):
    mean = gaussian_prior(distribution, SIZE).mean
    camera = camera_from_theta(mean, SIZE)
    assert camera.C[2] < 0.0
    assert camera.depth([0.0, 0.0, 0.0]) > 0.0


def test_samples_depend_on_the_generator_alone():
    draw = partial(sample_theta, DISTRIBUTIONS["main center"])
    np.testing.assert_array_equal(draw(5, np.random.default_rng(1), SIZE), draw(5, np.random.default_rng(1), SIZE))
    assert not np.array_equal(draw(5, np.random.default_rng(1), SIZE), draw(5, np.random.default_rng(2), SIZE))


@every_distribution
@given(generators())
def test_sampled_cameras_are_cameras(distribution, rng):
    theta = sample_theta(distribution, 1, rng, SIZE)[0]
    camera = camera_from_theta(theta, SIZE)
    assume(abs(np.sin(theta[1])) > 1e-6)
    assert_same_camera(theta_from_camera(camera), theta)


@given(thetas(lens=True), vectors((-60.0, -40.0, -3.0), (60.0, 40.0, 0.0), count=5))
def test_turned_around_sees_the_turned_field_alike(drawn, X):
    theta, image_size = drawn
    turned = turned_around(theta)
    here, there = (camera_from_theta(t, image_size) for t in (theta, turned))
    np.testing.assert_allclose(there.project(X * (-1.0, -1.0, 1.0)), here.project(X), rtol=1e-6, atol=1e-6)
    back = camera_from_theta(turned_around(turned), image_size)
    np.testing.assert_allclose(back.project(X), here.project(X), rtol=1e-6, atol=1e-6)
