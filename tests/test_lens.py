"""The radial lens, its inverse, its derivatives and the radius up to which it has an inverse."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numdiff import central_differences
from strategies import angle, vectors

from fieldcalib.geometry.lens import (
    corner_coefficients,
    distort,
    distort_jacobian,
    is_monotone,
    lens_coefficients,
    lens_parameters,
    opencv_coefficients,
    undistort,
)

RHO = 550.0  # half the diagonal of 960 x 540
FAR = 3.0  # in units of RHO: as far outside the image as anything here looks

in_unit_square = vectors((-1.0, -1.0), (1.0, 1.0), count=5)


def coefficients(limit=0.5):
    """(a1, a2): barrel, pincushion and moustache, far beyond what broadcast lenses show."""
    number = st.floats(-limit, limit, allow_subnormal=False)
    return st.builds(lambda a1, a2: np.array([a1, a2]), number, number)


def barrels():
    """(a1, a2) of lenses that fold: barrels of 5 % to 90 % at the corner."""
    return st.builds(
        lambda a1, a2: np.array([a1, a2]), st.floats(-0.5, -0.05), st.floats(-0.4, 0.0, allow_subnormal=False)
    )


def fold_radius(a):
    """First relative radius at which the lens stops spreading outwards, inf if never: 1 + 3 a1 q + 5 a2 q^2 = 0."""
    b, discriminant = 3.0 * a[0], 9.0 * a[0] ** 2 - 20.0 * a[1]
    if discriminant < 0.0 or np.sqrt(discriminant) - b <= 0.0:
        return np.inf
    return np.sqrt(2.0 / (np.sqrt(discriminant) - b))


def slope(radius, a):
    """d(distorted radius) / d(radius)."""
    return 1.0 + 3.0 * a[0] * radius**2 + 5.0 * a[1] * radius**4


def along(direction, radius):
    """The offset at a relative radius, pixels."""
    return RHO * radius * np.array([np.cos(direction), np.sin(direction)])


@given(coefficients(), angle(np.pi), st.floats(0.0, 0.9))
def test_undistort_inverts_distort_on_the_monotone_part(a, direction, fraction):
    s = along(direction, fraction * min(fold_radius(a), FAR))
    assume(slope(np.linalg.norm(s) / RHO, a) > 0.1)
    np.testing.assert_allclose(undistort(distort(s, a, RHO), a, RHO), s, atol=1e-9)


@given(barrels(), angle(np.pi), st.floats(0.9, 0.999))
def test_undistort_inverts_distort_just_inside_the_fold(a, direction, fraction):
    s = along(direction, fraction * fold_radius(a))
    np.testing.assert_allclose(undistort(distort(s, a, RHO), a, RHO), s, atol=1e-6)  # the slope goes down to 0.002


@given(coefficients(limit=0.1), angle(np.pi), st.floats(0.0, 1.0))
def test_undistort_inverts_distort_in_the_image(a, direction, radius):
    # within the image slopes are at least 0.2: nearly every digit comes back
    assert slope(radius, a) > 0.19
    s = along(direction, radius)
    np.testing.assert_allclose(undistort(distort(s, a, RHO), a, RHO), s, atol=1e-10, rtol=0.0)


def test_undistort_where_the_lens_hardly_spreads_but_never_folds():
    # the slope 1 - 3.6 q + 3.39 q^2 has its minimum, 0.044, at q = 0.53, inside the image
    a = np.array([-1.2, 0.678])
    assert np.isinf(fold_radius(a))
    s = np.linspace(0.0, 2.0 * RHO, 400)[:, None] * [0.6, 0.8]
    np.testing.assert_allclose(undistort(distort(s, a, RHO), a, RHO), s, atol=1e-6)


@given(coefficients(), angle(np.pi), st.floats(1.001, 5.0))
def test_undistort_is_nan_for_what_no_ray_reaches(a, direction, factor):
    fold = fold_radius(a)
    assume(fold < FAR)
    farthest = fold * (1.0 + a[0] * fold**2 + a[1] * fold**4)
    assert np.all(np.isnan(undistort(along(direction, factor * farthest), a, RHO)))


@given(st.floats(-2.0, -0.3), st.floats(0.2, 0.42), angle(np.pi), st.floats(1.001, 20.0))
def test_undistort_does_not_take_the_branch_beyond_the_fold(a1, ratio, direction, factor):
    # this lens folds and spreads again farther out, where it reaches every pixel, but none by a ray that is in view
    a = np.array([a1, ratio * a1**2])
    fold = fold_radius(a)
    farthest = fold * (1.0 + a[0] * fold**2 + a[1] * fold**4)
    assert np.all(np.isnan(undistort(along(direction, factor * farthest), a, RHO)))


@given(barrels(), angle(np.pi), st.floats(1.01, 1.2))
def test_a_point_beyond_the_fold_comes_back_as_the_one_inside_that_shares_its_pixel(a, direction, factor):
    beyond = along(direction, factor * fold_radius(a))
    d = distort(beyond, a, RHO)
    inside = undistort(d, a, RHO)
    np.testing.assert_allclose(distort(inside, a, RHO), d, atol=1e-6)
    assert np.linalg.norm(inside) < RHO * fold_radius(a)


def test_undistort_of_nan_is_nan_and_leaves_its_neighbours_alone():
    found = undistort(np.array([[np.nan, 3.0], [309.0, 412.0]]), np.array([0.03, 0.0]), 500.0)
    assert np.all(np.isnan(found[0]))
    np.testing.assert_allclose(found[1], [300.0, 400.0], atol=1e-10)


@given(coefficients(limit=3.0), in_unit_square)
def test_distort_equals_opencv(k, x):
    X = np.column_stack([x, np.ones(len(x))])
    expected, _ = cv2.projectPoints(X, np.zeros(3), np.zeros(3), np.eye(3), np.array([*k, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(distort(x, k, rho=1.0), expected.reshape(-1, 2), atol=1e-12)


@given(coefficients(limit=3.0), st.floats(300.0, 9000.0), in_unit_square)
def test_corner_coefficients_describe_the_same_lens_in_pixels(k, f, x):
    x = x * RHO / f
    expected = f * distort(x, k, rho=1.0)
    np.testing.assert_allclose(distort(f * x, corner_coefficients(k, f, RHO), RHO), expected, rtol=1e-12, atol=1e-9)


@given(coefficients(limit=0.3), angle(np.pi))
def test_corner_coefficients_add_up_to_the_displacement_of_the_corner(a, direction):
    corner = along(direction, 1.0)
    np.testing.assert_allclose(distort(corner, a, RHO), (1.0 + a.sum()) * corner, atol=1e-10)


@given(coefficients(limit=3.0), st.floats(300.0, 9000.0))
def test_corner_and_opencv_coefficients_round_trip(k, f):
    a = corner_coefficients(k, f, RHO)
    np.testing.assert_allclose(a, k * [(RHO / f) ** 2, (RHO / f) ** 4], rtol=1e-12)
    np.testing.assert_allclose(opencv_coefficients(a, f, RHO), k, rtol=1e-12, atol=1e-300)


def test_coefficients_of_a_batch_of_focal_lengths():
    k, f = np.array([[0.1, 0.02], [0.3, -0.1]]), np.array([1000.0, 4000.0])
    expected = np.array([corner_coefficients(k[0], 1000.0, RHO), corner_coefficients(k[1], 4000.0, RHO)])
    np.testing.assert_array_equal(corner_coefficients(k, f, RHO), expected)


@given(coefficients(), angle(np.pi), st.floats(0.0, 2.0))
def test_derivatives_against_central_differences(a, direction, radius):
    s = along(direction, radius)
    dd_ds, dd_da = distort_jacobian(s, a, RHO)
    # steps: truncation and rounding are both below 1e-9 of what is compared
    numeric_ds = central_differences(lambda s: distort(s, a, RHO), s, 1e-2)
    numeric_da = central_differences(lambda a: distort(s, a, RHO), a, 1e-2)
    for column, name in enumerate("xy"):
        np.testing.assert_allclose(dd_ds[:, column], numeric_ds[:, column], atol=1e-7, err_msg=f"d/d{name}")
    for column, name in enumerate(("a1", "a2")):
        np.testing.assert_allclose(dd_da[:, column], numeric_da[:, column], atol=1e-6, err_msg=f"d/d{name}")


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_batches_equal_one_by_one(shape):
    rng = np.random.default_rng(0)
    s, a = rng.uniform(-500, 500, size=(*shape, 2)), rng.uniform(-0.1, 0.1, size=(*shape, 2))
    d, dd_ds, dd_da = distort(s, a, RHO), *distort_jacobian(s, a, RHO)
    back = undistort(d, a, RHO)
    assert d.shape == back.shape == s.shape
    assert dd_ds.shape == dd_da.shape == (*shape, 2, 2)
    for i in np.ndindex(shape):
        np.testing.assert_array_equal(d[i], distort(s[i], a[i], RHO))
        np.testing.assert_allclose(back[i], s[i], atol=1e-9)
        np.testing.assert_array_equal(dd_ds[i], distort_jacobian(s[i], a[i], RHO)[0])
        np.testing.assert_array_equal(dd_da[i], distort_jacobian(s[i], a[i], RHO)[1])


def test_one_lens_broadcasts_over_many_pixels():
    s, a = np.random.default_rng(0).uniform(-500, 500, size=(4, 5, 2)), np.array([0.04, -0.01])
    np.testing.assert_array_equal(distort(s, a, RHO)[2, 3], distort(s[2, 3], a, RHO))
    np.testing.assert_allclose(undistort(distort(s, a, RHO), a, RHO), s, atol=1e-9)


def scanned_slope(q, a):
    """Smallest slope of the distorted radius on a fine walk from the centre to relative squared radius q."""
    walk = np.linspace(0.0, q, 4001)
    return np.min(1.0 + 3.0 * a[0] * walk + 5.0 * a[1] * walk**2)


@given(coefficients(limit=2.0), st.floats(0.0, 5.0))
def test_is_monotone_agrees_with_a_walk_from_the_centre(a, q):
    least = scanned_slope(q, a)
    assume(abs(least) > 1e-4)  # the walk misses the minimum by at most 5 |a2| (q / 8000)^2 < 1e-5
    assert bool(is_monotone(np.array(q), a)) == (least > 0.0)


@given(st.floats(-2.0, -0.3), st.floats(0.2, 0.6), st.floats(0.2, 3.0))
def test_is_monotone_of_a_lens_whose_slope_recovers(a1, ratio, where):
    """a2 = ratio a1^2 > 0: the slope dips below zero where ratio < 0.45, deepest at q = -0.3 a1 / a2, and recovers."""
    a = np.array([a1, ratio * a1**2])
    q = where * -0.3 * a[0] / a[1]
    least = scanned_slope(q, a)
    assume(abs(least) > 1e-4)
    assert bool(is_monotone(np.array(q), a)) == (least > 0.0)


@pytest.mark.parametrize(
    ("a", "q", "expected"),
    [
        ((0.0, 0.0), 100.0, True),  # no lens
        ((0.2, 0.0), 9.0, True),  # pincushion never folds
        ((-0.2, 0.0), 1.6, True),  # barrel folds at q = 1 / 0.6
        ((-0.2, 0.0), 1.7, False),
        ((0.3, -0.2), 1.0, True),  # 1 + 0.9 - 1.0
        ((0.3, -0.2), 2.0, False),  # 1 + 1.8 - 4.0
        ((-1.0, 0.4), 0.4, True),  # before the dip: 1 - 1.2 + 0.32
        ((-1.0, 0.4), 0.75, False),  # in the dip: 1 - 2.25 + 1.125
        ((-1.0, 0.4), 1.5, False),  # the slope is 1 again, beyond the dip
        ((-1.0, 0.4), 1.1, False),  # 1 - 3.3 + 2.42, just beyond it
        ((-1.0, 0.44), 1.5, False),  # a shallow dip: 1 - 0.45 / 0.44 < 0 at q = 0.68
        ((-1.0, 0.46), 1.5, True),
        ((-1.0, 0.6), 1.0, True),  # dips to 0.25 only
        ((1.0, 0.2), 5.0, True),
    ],
)
def test_is_monotone_by_hand(a, q, expected):
    assert bool(is_monotone(np.array(q), np.array(a))) is expected


def test_is_monotone_of_a_batch():
    q = np.array([0.4, 1.5, 1.5])
    a = np.array([[-1.0, 0.4], [-1.0, 0.4], [-1.0, 0.6]])
    np.testing.assert_array_equal(is_monotone(q, a), [True, False, True])


# --- lenses that do not fold ---


@given(a1=st.floats(-0.6, 0.6), b2=st.floats(0.0, 0.3), q=st.floats(0.0, 1e4))
def test_estimated_lenses_never_fold(a1, b2, q):
    a = lens_coefficients(np.array([a1, b2]))
    assert is_monotone(np.array(q), a)
    np.testing.assert_allclose(lens_parameters(a), (a1, b2), atol=1e-15)


@given(a1=st.floats(-0.6, -0.01))
def test_a_little_less_and_a_barrel_folds(a1):
    a = np.array([a1, 0.44 * a1**2])
    radii = np.linspace(0.0, 3.0 / np.sqrt(-a1), 2000)
    assert not np.all(is_monotone(np.square(radii), a))
    assert lens_parameters(a)[1] < 0.0


def test_the_guard_does_not_move_the_image_of_a_weak_barrel():
    corner = np.array([480.0, 270.0])
    with_guard = distort(corner, lens_coefficients(np.array([-0.01, 0.0])), np.hypot(480, 270))
    np.testing.assert_allclose(with_guard, 0.99 * corner, atol=0.03)
