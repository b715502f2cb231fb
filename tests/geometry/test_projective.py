"""Homogeneous points and lines; total least squares lines; homographies and projections by the DLT."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from strategies import angle, bounded, moved, numbers

from fieldcalib.geometry.homography import (
    dehomogenize,
    finite_homography,
    fit_lines,
    homogenize,
    homography_from_lines,
    homography_from_points,
    normalizing_transform,
    projection_from_points,
)


def same_side(lines, reference):
    """Lines with the sign of their reference: l and -l are one line."""
    return lines * np.sign(np.sum(lines * reference, axis=-1, keepdims=True))


def unit(turn):
    return np.array([np.cos(turn), np.sin(turn)])


@st.composite
def scattered_lines(draw):
    """12 points along a line, 10 px long and up to 1 px thick."""
    turn = draw(angle(np.pi))
    along, across = draw(moved(np.linspace(-5.0, 5.0, 12), 0.4)), draw(bounded(12, -0.5, 0.5))
    return along[:, None] * unit(turn) + across[:, None] * unit(turn + np.pi / 2.0) + draw(bounded(2, -100.0, 100.0))


def some_weights(*shape):
    return bounded(shape, 0.1, 1.0)


def squared_distances(line, xy, weights):
    return np.sum(weights * (homogenize(xy) @ line) ** 2)


@given(bounded((3, 4, 2), -3.0, 3.0))
def test_dehomogenize_undoes_homogenize_whatever_the_scale(x):
    assert homogenize(x).shape == (3, 4, 3)
    np.testing.assert_allclose(dehomogenize(-7.0 * homogenize(x)), x, rtol=1e-14)


@pytest.mark.parametrize("batch", [False, True])
@pytest.mark.parametrize(
    ("H", "message"),
    [
        (np.eye(4), r"three rows of three numbers: shape .*, got \(4, 4\)"),
        (np.ones(9), r"got \(9,\)"),
        (3.0, r"got \(\)"),
        ([], r"got \(0,\)"),
        ([[1, 0, 0], [0, 1], [0, 0, 1]], "three rows of three numbers"),
        ("homography", "three rows of three numbers"),
        (np.diag([1.0, np.nan, 1.0]), "not finite"),
        ([[1, 0, None], [0, 1, 0], [0, 0, 1]], "not finite"),
        (np.full((3, 3), np.inf), "not finite"),
    ],
)
def test_what_is_no_homography(H, message, batch):
    with pytest.raises(ValueError, match=message):
        finite_homography(H, batch=batch)


def test_a_batch_of_homographies_is_one_only_where_it_is_asked_for():
    H = np.ones((2, 5, 3, 3), dtype=int)
    assert finite_homography(H, batch=True).dtype == float
    assert finite_homography(H, batch=True).shape == H.shape
    with pytest.raises(ValueError, match=r"shape \(3, 3\), got \(2, 5, 3, 3\)"):
        finite_homography(H)


@given(scattered_lines(), some_weights(12), angle(np.pi), bounded(2, -50.0, 50.0))
def test_fitted_line_turns_and_moves_with_its_points(xy, weights, turn, shift):
    R = np.column_stack([unit(turn), unit(turn + np.pi / 2.0)])
    before, after = fit_lines(xy, weights), fit_lines(xy @ R.T + shift, weights)
    normal = R @ before[:2]
    expected = np.array([*normal, before[2] - normal @ shift])
    np.testing.assert_allclose(same_side(after, expected), expected, atol=1e-9)


@given(scattered_lines(), some_weights(12))
def test_fitted_line_has_a_unit_normal_and_no_line_beside_it_is_better(xy, weights):
    line = fit_lines(xy, weights)
    assert np.linalg.norm(line[:2]) == pytest.approx(1.0, abs=1e-14)
    best = squared_distances(line, xy, weights)
    mean = np.average(xy, axis=0, weights=weights)
    for step in (-1e-3, 1e-3):
        beside = line + np.array([0.0, 0.0, step])
        normal = unit(np.arctan2(line[1], line[0]) + step)
        turned = np.array([*normal, -normal @ mean])
        assert squared_distances(beside, xy, weights) > best
        assert squared_distances(turned, xy, weights) > best


@given(angle(np.pi), numbers(-500.0, 500.0), moved(np.linspace(-200.0, 200.0, 5), 100.0))
def test_points_on_a_line_have_distance_zero_whatever_its_direction(turn, offset, along):
    xy = offset * unit(turn) + along[:, None] * unit(turn + np.pi / 2.0)
    np.testing.assert_allclose(homogenize(xy) @ fit_lines(xy, np.ones(5)), 0.0, atol=1e-10)


@given(scattered_lines(), some_weights(12), bounded((3, 2), -1e3, 1e3))
def test_weight_zero_leaves_a_point_out(xy, weights, others):
    expected = fit_lines(xy, weights)
    found = fit_lines(np.concatenate([xy, others]), np.concatenate([weights, np.zeros(3)]))
    np.testing.assert_allclose(same_side(found, expected), expected, atol=1e-11)


@given(scattered_lines())
def test_weight_two_counts_a_point_twice(xy):
    expected = fit_lines(np.concatenate([xy, xy[:3]]), np.ones(15))
    found = fit_lines(xy, np.array([2.0] * 3 + [1.0] * 9))
    np.testing.assert_allclose(same_side(found, expected), expected, atol=1e-11)


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_fitted_lines_of_a_batch_equal_one_by_one(shape):
    rng = np.random.default_rng(0)
    xy, weights = rng.normal(size=(*shape, 6, 2)), rng.uniform(0.0, 1.0, size=(*shape, 6))
    lines = fit_lines(xy, weights)
    assert lines.shape == (*shape, 3)
    for i in np.ndindex(shape):
        np.testing.assert_allclose(lines[i], fit_lines(xy[i], weights[i]), atol=1e-14)


def test_line_of_nothing_is_finite():
    assert np.all(np.isfinite(fit_lines(np.zeros((0, 2)), np.zeros(0))))
    assert np.all(np.isfinite(fit_lines(np.full((3, 2), 7.0), np.zeros(3))))


# The sides of a square and two slanted lines; any four of those used below are in general position.
SIX_LINES = np.array([[1.0, 0, -1], [1, 0, 1], [0, 1, -1], [0, 1, 1], [1, 1, 0.3], [1, -1, 0.2]])


def homographies(*shape):
    """Well-conditioned homographies of the unit square, up to 0.25 from the identity in every entry."""
    return moved(np.broadcast_to(np.eye(3), (*shape, 3, 3)), 0.25)


def six_lines(*shape):
    """Lines near SIX_LINES."""
    return moved(np.broadcast_to(SIX_LINES, (*shape, 6, 3)), 0.2)


def up_to_scale(H):
    H = H / np.linalg.norm(H, axis=(-2, -1), keepdims=True)
    return H * np.sign(np.linalg.det(H))[..., None, None]


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
@given(data=st.data())
def test_homography_from_exact_lines_is_exact_in_batches(shape, data):
    H, lines = data.draw(homographies(*shape)), data.draw(six_lines(*shape))
    sign = data.draw(arrays(float, (*shape, 6, 1), elements=st.sampled_from([1.0, -1.0])))
    scale = sign * data.draw(bounded(sign.shape, 0.1, 10.0))
    lines_image = scale * (lines @ np.linalg.inv(H))  # l' = H^-T l, in rows; a line has no scale and no sign
    found = homography_from_lines(lines, lines_image, np.ones((*shape, 6)))
    assert found.shape == (*shape, 3, 3)
    np.testing.assert_allclose(up_to_scale(found), up_to_scale(H), atol=1e-8)


@given(
    homographies(4),
    six_lines(4),
    bounded((4, 6), 0.5, 2.0),
    st.lists(st.sampled_from([[4, 5], [0, 4], [2, 5]]), min_size=4, max_size=4),
    bounded((4, 2, 3), 0.5, 3.0),
)
def test_lines_of_weight_zero_are_left_out_in_batches(H, lines, weights, wrong, outliers):
    """A pair of outliers in every frame; four good lines stay."""
    lines_image = lines @ np.linalg.inv(H)
    frame, weights = np.arange(4)[:, None], weights.copy()
    lines_image[frame, wrong] = outliers
    weights[frame, wrong] = 0.0
    found = homography_from_lines(lines, lines_image, weights)
    np.testing.assert_allclose(up_to_scale(found), up_to_scale(H), atol=1e-6)


def test_a_wrong_line_of_positive_weight_does_count():
    lines = np.array([[1.0, 0, -1], [1, 0, 1], [0, 1, -1], [0, 1, 1], [1, 1, 0.3]])
    lines_image = lines.copy()
    lines_image[4] = [1.0, 1.0, 0.6]
    found = up_to_scale(homography_from_lines(lines, lines_image, np.ones(5)))
    assert np.max(np.abs(found - up_to_scale(np.eye(3)))) > 1e-3


@given(homographies(), six_lines())
def test_normalised_lines_give_the_homography_of_the_planes_as_they_are(H, six):
    """A field in metres and an image in pixels: without normalisation the focal terms drown."""
    field, image = np.diag([40.0, 40.0, 1.0]), np.array([[500.0, 0.0, 480.0], [0.0, 500.0, 270.0], [0.0, 0.0, 1.0]])
    expected = image @ H @ np.linalg.inv(field)
    lines, lines_image = six @ np.linalg.inv(field), six @ np.linalg.inv(image @ H)
    found = homography_from_lines(lines, lines_image, np.ones(6), np.linalg.inv(field), np.linalg.inv(image))
    np.testing.assert_allclose(up_to_scale(found), up_to_scale(expected), atol=1e-9)


# Points in general position: no three of the first four and no four of the nine in space are near a line or a plane.
PLANE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, 0], [0.6, -0.3], [-0.4, 0.5], [0.2, 0.8], [-0.7, -0.2]])
SPACE = np.column_stack([PLANE, [0.9, -0.8, 0.7, -1.0, 0.1, -0.5, -0.6, 0.8, 0.4]])


@pytest.mark.parametrize("points", [PLANE, SPACE], ids=["plane", "space"])
@given(data=st.data(), exponent=numbers(-3.0, 5.0), shift=numbers(-1e3, 1e3), weights=some_weights(4, 9))
def test_normalised_points_are_centred_and_of_unit_size(points, data, exponent, shift, weights):
    dimensions = points.shape[1]
    x = data.draw(moved(np.tile(points, (4, 1, 1)), 0.3)) * 10.0**exponent + shift
    weights = weights * (np.arange(9) >= 3)
    T = normalizing_transform(x, weights)
    normalised = dehomogenize(homogenize(x) @ np.swapaxes(T, -1, -2))
    np.testing.assert_allclose(np.einsum("tn,tnd->td", weights, normalised), 0.0, atol=1e-6)
    size = np.sum(weights * np.linalg.norm(normalised, axis=-1), axis=-1) / np.sum(weights, axis=-1)
    np.testing.assert_allclose(size, np.sqrt(dimensions), rtol=1e-6)
    similarity = T[:, :dimensions, :dimensions]
    np.testing.assert_array_equal(similarity, similarity[:, :1, :1] * np.eye(dimensions))  # no shear, no turn


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_coinciding_points_are_normalised_without_dividing_by_zero(weight):
    assert np.all(np.isfinite(normalizing_transform(np.full((3, 2), 7.0), np.full(3, weight))))


FIELD_TO_PIXELS = np.array([[16.0, -4.0, 480.0], [1.0, 6.0, 250.0], [0.002, -0.008, 1.0]])


def mapped(H, x):
    """The images of points under homographies or projections."""
    return dehomogenize(homogenize(x) @ np.swapaxes(H, -1, -2))


@st.composite
def fields_and_pixels(draw, *shape):
    """Nine points of a field in metres, and their pixels under homographies near FIELD_TO_PIXELS."""
    H = FIELD_TO_PIXELS * draw(moved(np.ones((*shape, 3, 3)), 0.1))
    x = draw(moved(np.broadcast_to(PLANE, (*shape, 9, 2)), 0.15)) * (45.0, 30.0)
    return x, mapped(H, x)


def farthest(H, x, x_image):
    """The largest distance between the images of points and where they should be."""
    return np.max(np.linalg.norm(mapped(H, x) - x_image, axis=-1))


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
@given(data=st.data())
def test_homography_from_exact_points_is_exact_in_batches(shape, data):
    x, pixels = data.draw(fields_and_pixels(*shape))
    found = homography_from_points(x, pixels, np.ones((*shape, 9)))
    assert found.shape == (*shape, 3, 3)
    assert farthest(found, x, pixels) < 1e-5


@given(moved(40.0 * PLANE[:4], 10.0))
def test_four_points_are_enough(corners):
    found = homography_from_points(corners, mapped(FIELD_TO_PIXELS, corners), np.ones(4))
    np.testing.assert_allclose(found / found[2, 2], FIELD_TO_PIXELS, rtol=1e-5, atol=1e-6)


@given(fields_and_pixels(4), st.lists(st.permutations(range(9)), min_size=4, max_size=4))
def test_points_of_weight_zero_are_left_out(field, order):
    x, pixels = field
    wrong = np.array(order) < 3  # other outliers in every frame
    off = pixels + 300.0 * wrong[..., None]
    assert farthest(homography_from_points(x, off, 1.0 - wrong), x, pixels) < 1e-4
    assert farthest(homography_from_points(x, off, np.ones((4, 9))), x, pixels) > 10.0


@given(fields_and_pixels(), bounded((9, 2), -2.0, 2.0), numbers(-3.0, 3.0), bounded(2, -1e4, 1e4))
def test_homography_does_not_depend_on_the_units(field, noise, exponent, mean):
    """What the normalisation is for: with noise the plain DLT in other units is another homography."""
    (x, pixels), scale = field, 10.0**exponent
    there = np.array([[scale, 0.0, mean[0]], [0.0, scale, mean[1]], [0.0, 0.0, 1.0]])
    found, other = (homography_from_points(y, pixels + noise, np.ones(9)) for y in (x, mapped(there, x)))
    np.testing.assert_allclose(mapped(other @ there, x), mapped(found, x), atol=1e-4)


@pytest.mark.parametrize("shape", [(), (2, 3)])
@given(data=st.data())
def test_projection_from_exact_points_is_exact_in_batches(shape, data):
    P = np.array([[1000.0, 50, 480, 3e4], [-20, 1000, 270, -5e3], [0.05, -0.02, 1.0, 60.0]])
    P = P * data.draw(moved(np.ones((*shape, 3, 4)), 0.1))
    X = 20.0 * data.draw(moved(np.broadcast_to(SPACE, (*shape, 9, 3)), 0.15)) + (100.0, -300.0, 0.0)
    pixels = mapped(P, X)
    found = projection_from_points(X, pixels, np.ones((*shape, 9)))
    assert found.shape == (*shape, 3, 4)
    assert farthest(found, X, pixels) < 1e-4 * np.ptp(pixels)
