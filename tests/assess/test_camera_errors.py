"""Errors of cameras whose principal point, lens and centre follow the zoom."""

import json
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numdiff import central_differences
from strategies import bounded, moved
from tripods import SIZE, operated

from fieldcalib.assess.camera_errors import KnownErrors
from fieldcalib.assess.probability import ground_in_view
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.lens import Pinhole
from fieldcalib.problem.layout import LOG_F, Layout, Role, SizeBlock, ZoomLaw

LAW = ZoomLaw(np.log(1400.0))
SIZE_BLOCK = SizeBlock(np.array([105.0, 68.0]), np.array([3.0, 3.0]), np.array([[90.0, 45.0], [120.0, 90.0]]))
LAYOUT = Layout.of(SIZE, zoom_law=LAW)
WITH_SIZE = Layout.of(SIZE, field_size=SIZE_BLOCK, zoom_law=LAW)
CROWNED = Layout.of(SIZE, field_size=SIZE_BLOCK._replace(crown=soccer().crown), zoom_law=LAW)
FIELD = soccer()
# pan, tilt, roll, log f, centre, principal point, log aspect, a1, b2, zoom law, size
STEPS = np.array([1e-6] * 3 + [1e-6] + [1e-4] * 3 + [1e-3] * 2 + [1e-6] * 3 + [1e-3] * 2 + [1e-5] * 2 + [1e-4])


def theta_at(share=0.7, layout=LAYOUT):
    """Parameters somewhere in their ranges: `share`, from -1 to 1, of angles, log f, lens and zoom law (11,)."""
    share = np.broadcast_to(share, 11)
    theta = operated(np.random.default_rng(0), 1, layout)[0]
    theta[:3] += share[:3] * (0.3, 0.1, 0.06)
    theta[LOG_F] = LAW.reference + 0.6 * share[3]
    theta[layout.lens_block] = 0.02 + 0.06 * share[4:6]
    theta[layout.zoom_law_block] = share[6:] * (20.0, 20.0, 0.05, 0.05, 1.0)
    return theta


shares = bounded(11, -1.0, 1.0)


def covariance_of(root, layout):
    """Covariance of correlated parameters, each with the standard deviations of real cameras, from a root (n, n)."""
    root = root / np.sqrt(layout.size)
    scale = np.full(layout.size, 1e-3)
    scale[4:7], scale[7:9] = 0.1, 2.0
    if layout.zoom_law is not None:
        scale[layout.zoom_law_block] = 3.0, 3.0, 0.01, 0.01, 0.2
    return scale[:, None] * (root @ root.T) * scale


@given(shares)
def test_the_zoom_jacobian_is_the_derivative_of_the_zoom_law(share):
    theta = theta_at(share)
    numeric = central_differences(LAYOUT.at_zoom, theta, STEPS)
    np.testing.assert_allclose(LAYOUT.zoom_jacobian(theta), numeric, rtol=1e-6, atol=1e-7)


def test_the_zoom_jacobian_has_the_size_of_the_field():
    theta = theta_at(layout=WITH_SIZE)
    steps = np.concatenate([STEPS, [1e-3, 1e-3]])
    numeric = central_differences(WITH_SIZE.at_zoom, theta, steps)
    np.testing.assert_allclose(WITH_SIZE.zoom_jacobian(theta), numeric, rtol=1e-6, atol=1e-7)


def test_without_a_zoom_law_nothing_follows_the_zoom():
    layout = Layout.of(SIZE)
    theta = theta_at()[: layout.size]
    np.testing.assert_array_equal(layout.zoom_jacobian(theta), np.eye(layout.size))
    assert layout.at_zoom(theta) is theta


def test_without_a_lens_the_law_bends_none():
    layout = Layout.of(SIZE, lens=Pinhole(1.0), zoom_law=LAW)
    theta = np.concatenate([theta_at()[:10], [5.0, -4.0, 0.0, 0.0, 0.6]])
    steps = np.concatenate([STEPS[:10], STEPS[12:]])
    numeric = central_differences(layout.at_zoom, theta, steps)
    np.testing.assert_allclose(layout.zoom_jacobian(theta), numeric, rtol=1e-6, atol=1e-7)


@given(shares, moved(np.eye(LAYOUT.size), 1.0))
def test_standard_deviations_follow_the_zoom_law(share, root):
    theta, covariance = theta_at(share), covariance_of(root, LAYOUT)

    def opencv(theta):
        rvec, tvec, K, dist = LAYOUT.camera(theta).to_opencv()
        return np.concatenate([K[[0, 1, 0, 1], [0, 1, 2, 2]], dist[0, :2], rvec[:, 0], tvec[:, 0]])

    J = central_differences(opencv, theta, STEPS)
    expected = np.sqrt(np.diag(J @ covariance @ J.T))
    errors = KnownErrors(LAYOUT, theta, covariance)
    found = np.concatenate([errors.std_deviations_intrinsics[:6, 0], errors.std_deviations_extrinsics[:, 0]])
    np.testing.assert_allclose(found, expected, rtol=2e-5)


@given(shares, st.data(), st.sampled_from([LAYOUT, WITH_SIZE]))
def test_ground_errors_follow_the_zoom_law(share, data, layout):
    theta, covariance = theta_at(share, layout), covariance_of(data.draw(moved(np.eye(layout.size), 1.0)), layout)
    errors = KnownErrors(layout, theta, covariance)
    xy = np.array([[100.0, 500.0], [480.0, 400.0], [850.0, 330.0]])
    X = errors.camera.image_to_field(xy)
    J = central_differences(
        lambda theta: layout.camera(theta).image_to_field(xy)[:, :2], theta, np.resize(STEPS, layout.size)
    )
    expected = J @ covariance @ np.swapaxes(J, 1, 2)
    np.testing.assert_allclose(errors.at_image(xy).covariance, expected, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(errors.at_field(X).covariance, expected, rtol=1e-4, atol=1e-9)


@given(st.lists(shares, min_size=2, max_size=3), st.data(), st.sampled_from([LAYOUT, CROWNED]))
def test_errors_in_view_are_those_of_each_point_alone(each, data, layout):
    """Computed for all frames at once; the probability follows from the largest one."""
    covariance = covariance_of(data.draw(moved(np.eye(layout.size), 1.0)), layout)
    frames = [KnownErrors(layout, theta_at(share, layout), covariance, field=FIELD) for share in each]
    KnownErrors.compute(frames)
    for one in frames:
        assert one.are_computed
        X = ground_in_view(one.camera, FIELD)
        alone = KnownErrors(layout, one.theta, covariance, field=FIELD)
        np.testing.assert_allclose(one.motion_of_markings, alone.motion_of_markings, atol=1e-9)
        if not len(X):
            assert np.isnan([one.largest_error(FIELD), one.probability(FIELD, 1.0, size_known=False)]).all()
            continue
        largest = np.max(alone.at_field(X).rms)
        np.testing.assert_allclose(one.largest_error(FIELD), largest, rtol=1e-6)
        probability = one.probability(FIELD, largest, size_known=False)
        np.testing.assert_allclose(probability, 1.0 - np.exp(-1.0), rtol=1e-6)
        assert not alone.are_computed


def through_json(errors):
    return KnownErrors.from_dict(json.loads(json.dumps(errors.to_dict())))


def through_pickle(errors):
    return pickle.loads(pickle.dumps(errors))


@pytest.mark.parametrize("copied", [through_json, through_pickle])
@pytest.mark.parametrize("layout", [LAYOUT, WITH_SIZE, Layout.of(SIZE)], ids=["law", "law and size", "plain"])
@pytest.mark.parametrize("dof", [7.5, np.inf])
def test_errors_survive_json_and_pickle(copied, layout, dof):
    theta = theta_at(layout=WITH_SIZE)
    theta = np.concatenate([theta[:12], theta[12 : 17 * (layout.zoom_law is not None)], theta[17:]])[: layout.size]
    covariance = covariance_of(np.random.default_rng(2).normal(size=(layout.size, layout.size)), layout)
    layout = layout.with_roles(Role.CONSIDERED, "centre", "zoom law").fixed("aspect")
    errors = KnownErrors(layout, theta, covariance, dof)
    back = copied(errors)
    assert type(back) is KnownErrors
    np.testing.assert_array_equal(back.theta, errors.theta)
    np.testing.assert_array_equal(back.covariance, errors.covariance)
    np.testing.assert_array_equal(back.layout.roles, layout.roles)
    assert back.layout.names == layout.names
    assert back.layout.zoom_law == layout.zoom_law
    assert (back.dof, back.radius(2)) == (dof, errors.radius(2))
    np.testing.assert_array_equal(back.camera.K, errors.camera.K)
    np.testing.assert_array_equal(back.camera.C, errors.camera.C)
    np.testing.assert_array_equal(back.std_deviations_intrinsics, errors.std_deviations_intrinsics)


def test_errors_that_nothing_determines_survive_json():
    theta, covariance = theta_at(), np.zeros((LAYOUT.size, LAYOUT.size))
    covariance[4], covariance[:, 4], covariance[4, 4] = np.nan, np.nan, np.inf
    record = json.dumps(KnownErrors(LAYOUT, theta, covariance).to_dict(), allow_nan=False)
    np.testing.assert_array_equal(KnownErrors.from_dict(json.loads(record))._covariance, covariance)


def test_regions_of_known_covariances_are_those_of_a_normal_distribution():
    errors = KnownErrors(LAYOUT, theta_at(), np.eye(LAYOUT.size))
    np.testing.assert_allclose(
        [errors.radius(1), errors.radius(2), errors.radius(3)], [1.95996, 2.44775, 2.79548], 1e-5
    )
    half_axes, _ = errors.at_image([480.0, 400.0]).ellipse()
    assert np.isfinite(half_axes).all()


def test_their_covariance_is_the_given_one():
    errors = KnownErrors(LAYOUT, theta_at(), np.eye(LAYOUT.size))
    np.testing.assert_array_equal(errors.covariance, np.eye(LAYOUT.size))
