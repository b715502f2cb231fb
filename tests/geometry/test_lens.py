"""The lenses: what every member keeps to, then the radial one, its inverse and the radius up to which it has one."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numdiff import central_differences
from strategies import angle, vectors

from fieldcalib import Calibration, CalibrationFlags, Camera, calibrate_from_segments, soccer
from fieldcalib.geometry.lens import LENSES, BrownConradyLens, Lens, Pinhole, RadialLens, lens_of
from fieldcalib.geometry.lens.brown_conrady import brown_conrady
from fieldcalib.geometry.lens.model import FOLD, POWERS, opencv_vector

RHO = 550.0  # half the diagonal of 960 x 540
FAR = 3.0  # in units of RHO: as far outside the image as anything here looks

in_unit_square = vectors((-1.0, -1.0), (1.0, 1.0), count=5)


RADIAL = RadialLens(RHO)


# --- what every lens keeps to ---

MEMBERS = (Pinhole(RHO), RadialLens(RHO), BrownConradyLens(RHO))
# At the corner: up to 30 % of radial and 4 % of tangential or prism displacement, each.
STRONG = {
    "Pinhole": np.empty(0),
    "RadialLens": np.array([0.3, 0.3]),
    "BrownConradyLens": np.array([0.3, 0.3, 0.02, 0.02, 0.2, 0.05, 0.05, 0.05, 0.04, 0.04, 0.04, 0.04]),
}
FOCAL_LENGTHS = st.floats(300.0, 9000.0)

members = pytest.mark.parametrize("lens", MEMBERS, ids=lambda lens: type(lens).__name__)


@st.composite
def drawn(draw, lens, strength=1.0):
    """Coefficients of a lens, any of them 0."""
    unit = st.floats(-1.0, 1.0, allow_subnormal=False)
    values = draw(st.lists(unit, min_size=len(lens.names), max_size=len(lens.names)))
    return strength * STRONG[type(lens).__name__] * np.array(values)


@st.composite
def offsets(draw, largest=1.2):
    """An ideal offset: near zero, in the image or at its corner and a little beyond."""
    radius = draw(st.sampled_from((0.0, 1e-9, 1e-3, 1.0)) | st.floats(0.0, largest))
    direction = draw(angle(np.pi))
    return along(direction, radius)


def by_coefficients(function, b, h):
    """Derivatives by the coefficients of a lens, of which there may be none."""
    return central_differences(function, b, h) if len(b) else np.empty((*np.shape(function(b)), 0))


def numeric_jacobian(lens, s, b):
    return central_differences(lambda s: lens.distort(s, b), s, RHO * 1e-3)


@members
@given(data=st.data(), s=offsets(), turn=angle(np.pi))
def test_push_and_pull_are_the_derivative_and_its_transpose(lens, data, s, turn):
    b = data.draw(drawn(lens))
    steps = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    J = numeric_jacobian(lens, s, b)
    d, *images = lens.push(s, b, *steps)
    np.testing.assert_array_equal(d, lens.distort(s, b))
    np.testing.assert_allclose(images, steps @ J.T, rtol=0.0, atol=1e-8)
    for n in steps:
        np.testing.assert_allclose(lens.pull(s, b, n), n @ J, rtol=0.0, atol=1e-8)


@members
@given(data=st.data(), s=offsets(), turn=angle(np.pi))
def test_follow_has_the_derivatives_along_a_curve(lens, data, s, turn):
    b, ds = data.draw(drawn(lens)), np.array([np.cos(turn), np.sin(turn)])
    dds = np.array([-0.01, 0.02])
    d, T, dT = lens.follow(s, b, ds, dds)
    np.testing.assert_allclose([d, T], lens.push(s, b, ds), rtol=1e-14, atol=1e-12)
    bend = central_differences(lambda t: lens.push(s + t * ds, b, ds)[1], np.zeros(1), RHO * 1e-3)[:, 0]
    expected = bend + lens.push(s, b, dds)[1]
    np.testing.assert_allclose(dT, expected, rtol=0.0, atol=1e-10)  # of up to 1e-2 / px


@members
@given(data=st.data(), s=offsets(), direction=angle(np.pi))
def test_pull_coefficients_is_the_derivative(lens, data, s, direction):
    b = data.draw(drawn(lens))
    # a1 has a kink in its second derivative at 0: the difference must not straddle it
    b[:1] = np.where(np.abs(b[:1]) < 1e-3, 1e-3, b[:1])
    n = np.array([np.cos(direction), np.sin(direction)])
    J = by_coefficients(lambda b: lens.distort(s, b), b, 2e-4)
    found = lens.pull_coefficients(s, b, n)
    assert found.shape == (len(lens.names),)
    for name, own, numeric in zip(lens.names, found, n @ J, strict=True):
        np.testing.assert_allclose(own, numeric, rtol=0.0, atol=1e-7 * RHO, err_msg=name)


@members
def test_every_wrong_coefficient_would_be_noticed_in_the_derivatives(lens):
    s, b = along(0.6, 0.9), 0.3 * STRONG[type(lens).__name__]
    for step in 1e-3 * np.eye(len(lens.names)):
        error = lens.push(s, b + step, np.array([0.6, 0.8]))[1] - numeric_jacobian(lens, s, b) @ [0.6, 0.8]
        assert np.max(np.abs(error)) > 1e-6
        assert np.max(np.abs(lens.distort(s, b + step) - lens.distort(s, b))) > 1e-4 * RHO


@members
@given(data=st.data(), s=offsets(largest=2.0))
def test_undistort_is_the_inverse_where_the_lens_is_monotone(lens, data, s):
    b = data.draw(drawn(lens))
    assume(lens.is_monotone(s, b))
    least = np.linalg.svd(numeric_jacobian(lens, s, b), compute_uv=False)[-1]
    assume(least > 0.1)
    np.testing.assert_allclose(lens.undistort(lens.distort(s, b), b), s, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("radius", np.linspace(0.0, 1.57, 8))
def test_undistort_up_to_the_pole_of_a_rational_lens(radius):
    """Newton's steps outwards lead beyond the pole at radius 1.58, where the gain changes its sign."""
    lens, b = BrownConradyLens(RHO), np.zeros(12)
    b[6:8] = -0.05, -0.04375
    s = along(0.3, radius)
    np.testing.assert_allclose(lens.undistort(lens.distort(s, b), b), s, rtol=0.0, atol=1e-9)


def test_undistort_comes_back_from_far_beyond_the_fold():
    """Newton's method starts at the distorted point, where both eigenvalues of the derivative are negative."""
    lens, b = BrownConradyLens(RHO), np.zeros(12)
    b[1], b[4] = 0.3, -0.05
    s = along(0.0, 2.0)
    np.testing.assert_allclose(lens.undistort(lens.distort(s, b), b), s, rtol=0.0, atol=1e-9)


@members
@given(data=st.data(), d=offsets(largest=5.0))
def test_undistort_is_a_preimage_before_the_fold_or_nan(lens, data, d):
    b = data.draw(drawn(lens, 3.0))
    s = lens.undistort(d, b)
    if np.all(np.isnan(s)):
        return
    np.testing.assert_allclose(lens.distort(s, b), d, rtol=0.0, atol=2e-6)
    assert lens.is_monotone(s, b)


@members
@given(data=st.data(), s=offsets(largest=3.0))
def test_is_monotone_is_a_positive_determinant_all_the_way(lens, data, s):
    b = data.draw(drawn(lens))
    way = s[:, None] * np.linspace(0.0, 1.0, 1999)
    one, two = lens.push(way, b[:, None], *(np.broadcast_to(axis[:, None], way.shape) for axis in np.eye(2)))[1:]
    determinant = one[0] * two[1] - one[1] * two[0]
    if len(b) == 12:
        q = np.sum(np.square(way), axis=0) / RHO**2
        determinant = np.where(1.0 + q * (b[5] + q * (b[6] + q * b[7])) > 0.0, determinant, -np.inf)  # the pole
    assume(abs(np.min(determinant)) > 0.02)  # between the steps of either walk
    assert lens.is_monotone(s, b) == (np.min(determinant) > 0.0)


@members
@given(data=st.data(), f=FOCAL_LENGTHS)
def test_to_and_from_opencv_round_trip(lens, data, f):
    b = data.draw(drawn(lens))
    dist = lens.to_opencv(b, f)
    assert dist.shape in ((5,), (8,), (12,))
    np.testing.assert_allclose(lens.from_opencv(dist, f), b, rtol=1e-12, atol=1e-15)


@members
@given(data=st.data(), f=FOCAL_LENGTHS, s=offsets())
def test_the_warp_is_opencvs_at_every_focal_length(lens, data, f, s):
    """The same coefficients displace the same pixels: a lens does not change with the zoom."""
    b = data.draw(drawn(lens))
    X = np.array([[*(s / f), 1.0]])
    theirs, _ = cv2.projectPoints(X, np.zeros(3), np.zeros(3), np.diag([f, f, 1.0]), lens.to_opencv(b, f))
    np.testing.assert_allclose(theirs[0, 0], lens.distort(s, b), rtol=0.0, atol=1e-9)


@members
@given(data=st.data(), f=FOCAL_LENGTHS)
def test_opencv_jacobian_is_the_derivative(lens, data, f):
    b = data.draw(drawn(lens))
    b[:1] = np.where(np.abs(b[:1]) < 1e-3, 1e-3, b[:1])
    by_b, by_log_f = lens.opencv_jacobian(b, f)
    assert by_b.shape == (12, len(b))

    def dist(b, log_f):
        return opencv_vector(lens.to_opencv(b, np.exp(log_f)))

    scale = np.maximum((f / RHO) ** POWERS, 1.0)  # of the coefficients, from 1 to 1e7
    if len(b):
        numeric = central_differences(lambda b: dist(b, np.log(f)), b, 2e-4)
        np.testing.assert_allclose(by_b / scale[:, None], numeric / scale[:, None], rtol=0.0, atol=1e-9)
    (numeric,) = central_differences(lambda log_f: dist(b, log_f[0]), np.array([np.log(f)]), 1e-3).T
    np.testing.assert_allclose(by_log_f / scale, numeric / scale, rtol=0.0, atol=1e-7)


@members
@given(data=st.data(), direction=angle(np.pi), radius=st.floats(0.0, 3.0))
def test_lenses_within_their_bounds_and_three_sigma_do_not_fold_where_anything_looks(lens, data, direction, radius):
    z = np.array(data.draw(st.lists(st.floats(-3.0, 3.0), min_size=lens.estimable, max_size=lens.estimable)))
    b = np.zeros(len(lens.names))
    n = lens.estimable
    b[:n] = np.maximum(lens.mean[:n] + z * lens.sigma[:n], lens.least[:n])
    assert lens.is_monotone(along(direction, radius), b)


@members
def test_tables_have_one_entry_a_coefficient(lens):
    shape = (len(lens.names),)
    assert lens.least.shape == lens.mean.shape == lens.sigma.shape == shape
    assert lens.estimable <= len(lens.names)
    assert np.all(lens.sigma > 0.0)
    assert np.all(lens.mean >= lens.least)
    with pytest.raises(ValueError, match="read-only"):
        lens.mean[...] = 1.0


@members
def test_identity(lens):
    none = np.zeros(len(lens.names))
    s = along(np.linspace(0.0, 6.0, 9), np.linspace(0.0, 2.0, 9))
    assert lens.is_identity(none)
    assert not any(lens.is_identity(b) for b in 1e-9 * np.eye(len(lens.names)))
    np.testing.assert_allclose(lens.distort(s, none), s, rtol=1e-15)
    np.testing.assert_allclose(lens.undistort(s, none), s, rtol=1e-14)
    assert np.all(lens.is_monotone(s, none))


@members
@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2), (0,)])
def test_batches_equal_one_by_one(lens, shape):
    rng = np.random.default_rng(0)
    s, n = rng.uniform(-300, 300, size=(2, 2, *shape))
    b = rng.uniform(-0.2, 0.2, size=(len(lens.names), *shape)) * STRONG[type(lens).__name__].reshape(
        -1, *len(shape) * [1]
    )
    d, image = lens.push(s, b, n)
    back, pulled, monotone = lens.undistort(d, b), lens.pull(s, b, n), lens.is_monotone(s, b)
    by_b = lens.pull_coefficients(s, b, n)
    assert d.shape == image.shape == back.shape == pulled.shape == (2, *shape)
    assert by_b.shape == (len(lens.names), *shape)
    assert monotone.shape == shape
    np.testing.assert_allclose(back, s, rtol=0.0, atol=1e-9)
    for i in np.ndindex(shape):
        one = (slice(None), *i)
        np.testing.assert_array_equal(d[one], lens.distort(s[one], b[one]))
        np.testing.assert_array_equal(image[one], lens.push(s[one], b[one], n[one])[1])
        np.testing.assert_array_equal(pulled[one], lens.pull(s[one], b[one], n[one]))
        np.testing.assert_array_equal(by_b[one], lens.pull_coefficients(s[one], b[one], n[one]))


@members
def test_one_lens_broadcasts_over_many_pixels(lens):
    s = np.random.default_rng(0).uniform(-500, 500, size=(2, 4, 5))
    b = 0.2 * STRONG[type(lens).__name__]
    many = b[:, None, None]
    d = lens.distort(s, many)
    np.testing.assert_array_equal(d[:, 2, 3], lens.distort(s[:, 2, 3], b))
    np.testing.assert_allclose(lens.undistort(d, many), s, atol=1e-9)
    assert lens.is_monotone(s, many).shape == (4, 5)
    assert lens.pull_coefficients(s, many, s).shape == (len(b), 4, 5)
    assert lens.to_opencv(np.stack([b, b], axis=-1), np.array([900.0, 1800.0])).shape[1:] == (2,)


@members
def test_nan_stays_nan_and_leaves_its_neighbours_alone(lens):
    b = 0.2 * STRONG[type(lens).__name__][:, None]
    s = np.array([[np.nan, 300.0], [3.0, 400.0]])
    found = lens.undistort(lens.distort(s, b), b)
    assert np.isnan(found[0, 0])
    np.testing.assert_allclose(found[:, 1], [300.0, 400.0], atol=1e-9)


@given(data=st.data(), s=offsets())
def test_brown_conrady_without_the_rest_is_the_radial_lens(data, s):
    b = data.draw(drawn(RADIAL))
    whole, full = BrownConradyLens(RHO), np.concatenate([b, np.zeros(10)])
    np.testing.assert_allclose(whole.distort(s, full), RADIAL.distort(s, b), rtol=1e-14, atol=1e-12)
    np.testing.assert_allclose(whole.undistort(s, full), RADIAL.undistort(s, b), rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(whole.to_opencv(full, 1500.0), RADIAL.to_opencv(b, 1500.0), rtol=1e-14)
    for own, radial in zip(("mean", "sigma", "least"), ("mean", "sigma", "least"), strict=True):
        np.testing.assert_array_equal(getattr(whole, own)[:2], getattr(RADIAL, radial))


@pytest.mark.parametrize(
    ("dist", "expected"),
    [
        (None, Pinhole(RHO)),
        (np.zeros((1, 14)), Pinhole(RHO)),
        ([0.1], RadialLens(RHO)),
        ([0.0, -0.1, 0.0, 0.0], RadialLens(RHO)),
        ([0.0, 0.0, 1e-9, 0.0], BrownConradyLens(RHO)),
        (12 * [0.0] + [0.0, 0.0], Pinhole(RHO)),
        (11 * [0.0] + [0.1, 0.0, 0.0], BrownConradyLens(RHO)),
    ],
)
def test_lens_of_is_the_smallest(dist, expected):
    lens = lens_of(dist, RHO)
    assert lens == expected
    expected = opencv_vector(dist)
    np.testing.assert_allclose(
        opencv_vector(lens.to_opencv(lens.from_opencv(dist, 900.0), 900.0)), expected, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("lens", "dist", "message"),
    [
        (Pinhole(RHO), [0.1], r"a pinhole lens has no coefficients but \(none\), got dist_coeffs = \[0\.1"),
        (RadialLens(RHO), [0.1, 0.0, 0.0, 0.2], r"a radial lens has no coefficients but k1, k2, got .*0\.2.*undistort"),
        (BrownConradyLens(RHO), 12 * [0.0] + [0.1, 0.0], r"a tilted sensor \(tauX, tauY\) is not modelled, .*0\.1"),
        (BrownConradyLens(RHO), [0.1, 0.2, 0.3], r"1, 2, 4, 5, 8, 12 or 14 coefficients .* got \[0\.1, 0\.2, 0\.3\]"),
        (RadialLens(RHO), [np.nan, 0.0], r"dist_coeffs must be a finite array .*nan"),
        (BrownConradyLens(RHO), [], "dist_coeffs must be a finite array"),
    ],
)
def test_coefficients_that_a_lens_does_not_have(lens, dist, message):
    with pytest.raises(ValueError, match=message):
        lens.from_opencv(dist, 900.0)


@pytest.mark.parametrize(
    ("index", "expected"),
    [(2, (2 * 0.6 * 0.8, 1 + 2 * 0.64)), (3, (1 + 2 * 0.36, 2 * 0.6 * 0.8)), (4, (0.6, 0.8)), (5, (-0.6, -0.8))],
)
def test_displacement_of_the_corner_by_hand(index, expected):
    """p1, p2, a3 and a4 of 0.001 at (0.6, 0.8) rho; a4 is in the denominator."""
    moved = brown_conrady(np.array([0.6, 0.8]), 0.001 * np.eye(12)[index]) - (0.6, 0.8)
    np.testing.assert_allclose(moved, 0.001 * np.array(expected), rtol=0.0, atol=1.1e-6)


# --- a lens of one's own: a class, and a line in the registry ---


class ThreeRadial(Lens):
    name, names, opencv_names = "three radial", ("a1", "b2", "a3"), ("k1", "k2", "k3")
    estimable = 3
    least, mean, sigma = (getattr(BrownConradyLens, table)[[0, 1, 4]] for table in ("least", "mean", "sigma"))

    def whole(self, b):
        found = np.zeros((12, *b.shape[1:]))
        found[[0, 1, 4]] = b
        return BrownConradyLens(self.rho), found

    def distort(self, s, b):
        lens, b = self.whole(b)
        return lens.distort(s, b)

    def push(self, s, b, *steps):
        lens, b = self.whole(b)
        return lens.push(s, b, *steps)

    def pull(self, s, b, n):
        lens, b = self.whole(b)
        return lens.pull(s, b, n)

    def pull_coefficients(self, s, b, n):
        lens, b = self.whole(b)
        return lens.pull_coefficients(s, b, n)[[0, 1, 4]]

    def undistort(self, d, b):
        lens, b = self.whole(b)
        return lens.undistort(d, b)

    def is_monotone(self, s, b):
        lens, b = self.whole(b)
        return lens.is_monotone(s, b)


def test_a_lens_of_ones_own_is_chosen_estimated_and_written(monkeypatch):
    flags = CalibrationFlags.CALIB_FIX_ASPECT_RATIO | CalibrationFlags.CALIB_FIX_TANGENT_DIST
    camera = Camera.from_angles(0.0, 1.4, 0.0, 1200.0, (1.0, 60.0, -20.0), (960, 540), k=(0.1, 0.1, 0.0, 0.0, 0.2))
    field = soccer()
    pixels = {label: camera.project(field[label].sample(1.0)) for label in ("Side line top", "Middle line")}
    pixels["Circle central"] = camera.project(field["Circle central"].sample(1.0))
    pixels = {label: xy[np.all((xy >= 0) & (xy < (960, 540)), axis=1)] for label, xy in pixels.items()}
    usual = calibrate_from_segments(field, pixels, (960, 540), flags=flags)
    monkeypatch.setitem(LENSES, ThreeRadial.name, ThreeRadial)
    found = calibrate_from_segments(field, pixels, (960, 540), flags=flags)
    assert isinstance(usual.uncertainty.layout.lens, BrownConradyLens)
    assert isinstance(found.uncertainty.layout.lens, ThreeRadial)
    assert isinstance(found.camera.lens, ThreeRadial)
    np.testing.assert_allclose(found.camera.dist, usual.camera.dist, atol=1e-6)
    back = Calibration.from_dict(json.loads(json.dumps(found.to_dict())))
    assert isinstance(back.uncertainty.layout.lens, ThreeRadial)


# --- the radial lens by its coefficients (a1, a2), the vector last ---


def lens_parameters(a):
    """(a1, b2) of (a1, a2)."""
    a1, a2 = np.moveaxis(np.asarray(a, dtype=float), -1, 0)
    return np.stack([a1, a2 - FOLD * np.minimum(a1, 0.0) ** 2], axis=-1)


def lens_coefficients(b):
    """(a1, a2) of (a1, b2)."""
    return np.array([b[0], b[1] + FOLD * min(b[0], 0.0) ** 2])


def corner_coefficients(k, f, rho):
    """(a1, a2) of OpenCV's (k1, k2) at a focal length."""
    return lens_coefficients(RadialLens(rho).from_opencv(k, f))


def opencv_coefficients(a, f, rho):
    """OpenCV's (k1, k2) of (a1, a2)."""
    return RadialLens(rho).to_opencv(lens_parameters(a), f)[:2]


def radial(function, points, a):
    """A method of the radial lens at points (..., 2) and coefficients (a1, a2), (..., 2)."""
    b = np.moveaxis(lens_parameters(a), -1, 0)
    return np.moveaxis(
        function(np.moveaxis(points, -1, 0), b.reshape(2, *(points.ndim - a.ndim) * [1], *b.shape[1:])), 0, -1
    )


def distort(s, a, rho):
    return radial(RadialLens(rho).distort, s, a)


def undistort(d, a, rho):
    return radial(RadialLens(rho).undistort, d, a)


def is_monotone(q, a):
    s = np.stack([np.sqrt(q), np.zeros_like(q)])
    return RadialLens(1.0).is_monotone(s, np.moveaxis(lens_parameters(a), -1, 0))


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
    # a2 is stored as its distance to the fold of a barrel: tiny ones round to that
    np.testing.assert_allclose(a, k * [(RHO / f) ** 2, (RHO / f) ** 4], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(opencv_coefficients(a, f, RHO), k, rtol=1e-12, atol=1e-14)


def test_coefficients_of_a_batch_of_focal_lengths():
    a, f = np.array([[0.1, 0.02], [0.3, -0.1]]), np.array([1000.0, 4000.0])
    expected = np.array([opencv_coefficients(a[0], 1000.0, RHO), opencv_coefficients(a[1], 4000.0, RHO)])
    found = RadialLens(RHO).to_opencv(lens_parameters(a).T, f)
    np.testing.assert_array_equal(found[:2].T, expected)


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
