"""The priors of a camera, and the camera distributions that they come from."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import generators
from synthetic import gaussian_prior

from data_tools.random_frames import sample_theta
from fieldcalib.fields.traits import DISTRIBUTIONS, focal_length_from_fov
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import BrownConradyLens, Pinhole, RadialLens
from fieldcalib.problem.layout import LOG_ASPECT, LOG_F, PRINCIPAL_POINT, Layout, SizeBlock, gaussian_priors

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
LAYOUT = Layout.of(SIZE)
NAMES, LENS = LAYOUT.names, LAYOUT.lens_block

every_distribution = pytest.mark.parametrize("distribution", DISTRIBUTIONS.values(), ids=list(DISTRIBUTIONS))


def named_ranges(distribution):
    """(low, high) of the seven parameters of a distribution as they stand in theta."""
    values = TABLE[distribution.name]
    angles = {name: np.radians(values[name]) for name in ("pan", "tilt", "roll")}
    fov = np.radians(values["fov"])
    log_f = np.log(0.5 * SIZE[0] / np.tan(fov[::-1] / 2.0))  # the widest view has the shortest focal length
    return {**angles, "log f": log_f, **{name: np.array(values[name]) for name in "xyz"}}


@given(st.floats(0.05, 3.0), st.integers(100, 4000))
def test_focal_length_of_a_field_of_view(fov, width):
    f = focal_length_from_fov(fov, width)
    assert f * np.tan(fov / 2.0) == pytest.approx(width / 2.0)
    assert Camera.from_angles(0, 1.4, 0, float(f), (0, 56, -15), (width, 90)).field_of_view == pytest.approx(fov)


@given(generators(), st.integers(-300, 900), st.integers(-200, 500), st.integers(50, 800), st.integers(50, 600))
def test_a_part_of_a_frame_has_the_prior_of_the_frame(rng, x, y, width, height):
    """The scores of its camera under the prior of a part are those of the whole frame's."""
    whole, part = (Layout.of(size, RadialLens(np.hypot(*size) / 2.0)) for size in (SIZE, (width, height)))
    stand = replace(rng.choice([*DISTRIBUTIONS.values()]), principal_point=rng.uniform(0.01, 0.2))
    of_whole = gaussian_priors([stand], whole)
    theta = of_whole.mean + rng.normal(size=of_whole.mean.shape) * of_whole.sigma
    theta[:, whole.lens_block] = rng.uniform(0.0, 0.03), 0.0
    camera = whole.camera(theta[0])
    its = part.theta(camera.cropped((x, y), (width, height)))
    of_part = gaussian_priors([replace(stand, frame=(SIZE, (x, y)))], part)
    np.testing.assert_allclose(of_part.z_scores(its[None])[:, :-1], of_whole.z_scores(theta)[:, :-1], atol=1e-7)


@pytest.mark.parametrize("frame", [(1920, 1080), ((0, 1080), (0, 0)), ((1920, 1080), (0,)), "1920x1080+0+0"])
def test_a_frame_is_a_size_and_a_pixel(frame):
    with pytest.raises(ValueError, match=r"frame must be \(\(width, height\), \(x, y\)\) in pixels, got"):
        replace(DISTRIBUTIONS["main center"], frame=frame)


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
    prior = gaussian_prior(distribution, LAYOUT)
    for name, (low, high) in named_ranges(distribution).items():
        i = NAMES.index(name)
        assert low < high
        assert prior.mean[i] == pytest.approx((low + high) / 2.0, abs=1e-12)
        # z of a value is (value - mean) / sigma: -1.96 and 1.96 at the ends of the range
        np.testing.assert_allclose((np.array([low, high]) - prior.mean[i]) / prior.sigma[i], [-1.96, 1.96], rtol=1e-12)


@every_distribution
def test_prior_of_what_the_distributions_do_not_say(distribution):
    prior = gaussian_prior(distribution, LAYOUT)
    assert prior.mean.shape == prior.sigma.shape == (len(NAMES),)
    np.testing.assert_array_equal(prior.mean[PRINCIPAL_POINT], [640.0, 360.0])
    np.testing.assert_array_equal(prior.mean[LENS], (0.025, 0.0))
    assert prior.mean[LOG_ASPECT] == 0.0
    assert np.all(prior.sigma > 0.0)
    # measured broadcast cameras: 67 px off at 1920 wide, 5.5 % at the corner; neither may lie beyond two sigma
    wide = gaussian_prior(distribution, Layout.of((1920, 1080)))
    assert np.all(67.0 / wide.sigma[PRINCIPAL_POINT] < 2.0)
    assert abs(0.055 - wide.mean[LENS][0]) / wide.sigma[LENS][0] < 2.0


@every_distribution
def test_prior_scales_with_the_image(distribution):
    twice = Layout.of((2 * SIZE[0], 2 * SIZE[1]))
    small, large = gaussian_prior(distribution, LAYOUT), gaussian_prior(distribution, twice)
    np.testing.assert_allclose(large.mean[LOG_F] - small.mean[LOG_F], np.log(2.0))
    np.testing.assert_allclose(large.mean[PRINCIPAL_POINT], 2.0 * small.mean[PRINCIPAL_POINT])
    np.testing.assert_allclose(large.sigma[PRINCIPAL_POINT], 2.0 * small.sigma[PRINCIPAL_POINT])
    others = [i for i in range(len(NAMES)) if NAMES[i] not in ("log f", "cx", "cy")]
    np.testing.assert_array_equal(large.mean[others], small.mean[others])
    np.testing.assert_array_equal(np.delete(large.sigma, [7, 8]), np.delete(small.sigma, [7, 8]))


@every_distribution
def test_samples_fill_the_ranges_and_never_leave_them(distribution):
    theta = sample_theta(distribution, 2000, np.random.default_rng(0), LAYOUT)
    assert theta.shape == (2000, len(NAMES))
    for name, (low, high) in named_ranges(distribution).items():
        values = theta[:, NAMES.index(name)]
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
    mean = gaussian_prior(distribution, LAYOUT).mean
    camera = LAYOUT.camera(mean)
    assert camera.C[2] < 0.0
    assert camera.depth([0.0, 0.0, 0.0]) > 0.0


def test_samples_depend_on_the_generator_alone():
    draw = partial(sample_theta, DISTRIBUTIONS["main center"])
    np.testing.assert_array_equal(draw(5, np.random.default_rng(1), LAYOUT), draw(5, np.random.default_rng(1), LAYOUT))
    assert not np.array_equal(draw(5, np.random.default_rng(1), LAYOUT), draw(5, np.random.default_rng(2), LAYOUT))


@every_distribution
@given(generators())
def test_sampled_cameras_are_cameras(distribution, rng):
    theta = sample_theta(distribution, 1, rng, LAYOUT)[0]
    camera = LAYOUT.camera(theta)
    assume(abs(np.sin(theta[1])) > 1e-6)
    back = LAYOUT.theta(camera) - theta
    back[0] = np.remainder(back[0] + np.pi, 2.0 * np.pi) - np.pi
    np.testing.assert_allclose(back / np.maximum(1.0, np.abs(theta)), 0.0, atol=1e-11)


@pytest.mark.parametrize("lens", [Pinhole(734.0), BrownConradyLens(734.0)])
def test_prior_of_any_lens_and_of_the_size_of_the_field(lens):
    size = SizeBlock(np.array([100.0, 66.0]), np.array([2.0, 3.0]), np.array([[90.0, 45.0], [120.0, 90.0]]))
    layout = Layout.of(SIZE, lens, size)
    prior = gaussian_prior(DISTRIBUTIONS["main center"], layout)
    assert prior.mean.shape == prior.sigma.shape == (layout.size,)
    common = gaussian_prior(DISTRIBUTIONS["main center"], LAYOUT)
    np.testing.assert_array_equal(prior.mean[:10], common.mean[:10])
    np.testing.assert_array_equal(prior.sigma[:10], common.sigma[:10])
    np.testing.assert_array_equal(prior.mean[layout.lens_block], lens.mean)
    np.testing.assert_array_equal(prior.sigma[layout.lens_block], lens.sigma)
    np.testing.assert_array_equal(prior.mean[layout.field_size_block], [100.0, 66.0])
    np.testing.assert_array_equal(prior.sigma[layout.field_size_block], [2.0, 3.0])


@given(st.floats(-20.0, 20.0), st.floats(-3.0, 3.0))
def test_z_scores_of_angles_have_no_seam(turns, z):
    """Pan and roll are the same a full turn further; tilt and the others are not angles of a circle."""
    prior = gaussian_prior(DISTRIBUTIONS["main center"], LAYOUT)
    theta = prior.mean + z * prior.sigma
    far = theta + 2.0 * np.pi * round(turns) * np.isin(NAMES, ["pan", "roll"])
    np.testing.assert_allclose(prior.z_scores(far), z, atol=1e-9)
