"""Homogeneous points and lines; total least squares lines; homographies and projections by the DLT."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import angle, generators

from fieldcalib.geometry.projective import (
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


def scattered_line(rng, count=12):
    """Points along a random line, 10 px long and 1 px thick."""
    turn = rng.uniform(-np.pi, np.pi)
    direction = np.array([np.cos(turn), np.sin(turn)])
    along, across = rng.uniform(-5.0, 5.0, size=count), rng.uniform(-0.5, 0.5, size=count)
    return along[:, None] * direction + across[:, None] * [-direction[1], direction[0]] + rng.uniform(-100, 100, size=2)


def squared_distances(line, xy, weights):
    return np.sum(weights * (homogenize(xy) @ line) ** 2)


@given(generators())
def test_dehomogenize_undoes_homogenize_whatever_the_scale(rng):
    x = rng.normal(size=(3, 4, 2))
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


@given(angle(np.pi), generators())
def test_fitted_line_turns_and_moves_with_its_points(turn, rng):
    xy, weights, shift = scattered_line(rng), rng.uniform(0.1, 1.0, size=12), rng.uniform(-50.0, 50.0, size=2)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    before, after = fit_lines(xy, weights), fit_lines(xy @ R.T + shift, weights)
    normal = R @ before[:2]
    expected = np.array([*normal, before[2] - normal @ shift])
    np.testing.assert_allclose(same_side(after, expected), expected, atol=1e-9)


@given(generators())
def test_fitted_line_has_a_unit_normal_and_no_line_beside_it_is_better(rng):
    xy, weights = scattered_line(rng), rng.uniform(0.1, 1.0, size=12)
    line = fit_lines(xy, weights)
    assert np.linalg.norm(line[:2]) == pytest.approx(1.0, abs=1e-14)
    best = squared_distances(line, xy, weights)
    mean = np.average(xy, axis=0, weights=weights)
    for step in (-1e-3, 1e-3):
        moved = line + np.array([0.0, 0.0, step])
        turn = np.arctan2(line[1], line[0]) + step
        turned = np.array([np.cos(turn), np.sin(turn), -np.cos(turn) * mean[0] - np.sin(turn) * mean[1]])
        assert squared_distances(moved, xy, weights) > best
        assert squared_distances(turned, xy, weights) > best


@given(angle(np.pi), st.floats(-500.0, 500.0), generators())
def test_points_on_a_line_have_distance_zero_whatever_its_direction(turn, offset, rng):
    normal = np.array([np.cos(turn), np.sin(turn)])
    xy = offset * normal + rng.uniform(-300.0, 300.0, size=(5, 1)) * [-normal[1], normal[0]]
    np.testing.assert_allclose(homogenize(xy) @ fit_lines(xy, np.ones(5)), 0.0, atol=1e-10)


@given(generators())
def test_weight_zero_leaves_a_point_out(rng):
    xy, weights = scattered_line(rng), rng.uniform(0.1, 1.0, size=12)
    expected = fit_lines(xy, weights)
    found = fit_lines(np.concatenate([xy, rng.uniform(-1e3, 1e3, size=(3, 2))]), np.concatenate([weights, np.zeros(3)]))
    np.testing.assert_allclose(same_side(found, expected), expected, atol=1e-11)


@given(generators())
def test_weight_two_counts_a_point_twice(rng):
    xy = scattered_line(rng)
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


def homographies(rng, shape):
    """Well-conditioned homographies of the unit square, up to 0.3 from the identity in every entry."""
    return np.eye(3) + rng.uniform(-0.3, 0.3, size=(*shape, 3, 3))


def up_to_scale(H):
    H = H / np.linalg.norm(H, axis=(-2, -1), keepdims=True)
    return H * np.sign(np.linalg.det(H))[..., None, None]


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
@given(generators())
def test_homography_from_exact_lines_is_exact_in_batches(shape, rng):
    H = homographies(rng, shape)
    lines = np.broadcast_to(SIX_LINES, (*shape, 6, 3)) + rng.uniform(-0.2, 0.2, size=(*shape, 6, 3))
    scale = rng.uniform(0.1, 10.0, size=(*shape, 6, 1)) * rng.choice([-1.0, 1.0], size=(*shape, 6, 1))
    lines_image = scale * (lines @ np.linalg.inv(H))  # l' = H^-T l, in rows; a line has no scale and no sign
    found = homography_from_lines(lines, lines_image, np.ones((*shape, 6)))
    assert found.shape == (*shape, 3, 3)
    np.testing.assert_allclose(up_to_scale(found), up_to_scale(H), atol=1e-8)


@given(generators())
def test_lines_of_weight_zero_are_left_out_in_batches(rng):
    H = homographies(rng, (4,))
    lines = np.broadcast_to(SIX_LINES, (4, 6, 3)) + rng.uniform(-0.2, 0.2, size=(4, 6, 3))
    lines_image = lines @ np.linalg.inv(H)
    weights = rng.uniform(0.5, 2.0, size=(4, 6))
    for frame in range(4):  # another pair of outliers in every frame; four good lines stay
        wrong = rng.choice([[4, 5], [0, 4], [2, 5]])
        lines_image[frame, wrong] = rng.normal(size=(2, 3))
        weights[frame, wrong] = 0.0
    found = homography_from_lines(lines, lines_image, weights)
    np.testing.assert_allclose(up_to_scale(found), up_to_scale(H), atol=1e-6)


def test_a_wrong_line_of_positive_weight_does_count():
    lines = np.array([[1.0, 0, -1], [1, 0, 1], [0, 1, -1], [0, 1, 1], [1, 1, 0.3]])
    lines_image = lines.copy()
    lines_image[4] = [1.0, 1.0, 0.6]
    found = up_to_scale(homography_from_lines(lines, lines_image, np.ones(5)))
    assert np.max(np.abs(found - up_to_scale(np.eye(3)))) > 1e-3


@given(generators())
def test_normalised_lines_give_the_homography_of_the_planes_as_they_are(rng):
    """A field in metres and an image in pixels: without normalisation the focal terms drown."""
    H, six = homographies(rng, ()), SIX_LINES + rng.uniform(-0.2, 0.2, size=(6, 3))
    field, image = np.diag([40.0, 40.0, 1.0]), np.array([[500.0, 0.0, 480.0], [0.0, 500.0, 270.0], [0.0, 0.0, 1.0]])
    expected = image @ H @ np.linalg.inv(field)
    lines, lines_image = six @ np.linalg.inv(field), six @ np.linalg.inv(image @ H)
    found = homography_from_lines(lines, lines_image, np.ones(6), np.linalg.inv(field), np.linalg.inv(image))
    np.testing.assert_allclose(up_to_scale(found), up_to_scale(expected), atol=1e-9)


@pytest.mark.parametrize("dimensions", [2, 3])
@given(generators())
def test_normalised_points_are_centred_and_of_unit_size(dimensions, rng):
    x = rng.uniform(-3.0, 3.0, size=(4, 9, dimensions)) * 10.0 ** rng.uniform(-3, 5) + rng.uniform(-1e3, 1e3)
    weights = rng.uniform(0.1, 1.0, size=(4, 9))
    weights[:, :3] = 0.0
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


def field_and_pixels(rng, shape, count):
    """Random points of a field in metres, and their pixels under homographies near FIELD_TO_PIXELS."""
    H = FIELD_TO_PIXELS * (1.0 + rng.uniform(-0.1, 0.1, size=(*shape, 3, 3)))
    x = rng.uniform((-50.0, -34.0), (50.0, 34.0), size=(*shape, count, 2))
    return H, x, dehomogenize(homogenize(x) @ np.swapaxes(H, -1, -2))


def farthest(H, x, x_image):
    """The largest distance between the images of points and where they should be."""
    return np.max(np.linalg.norm(dehomogenize(homogenize(x) @ np.swapaxes(H, -1, -2)) - x_image, axis=-1))


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
@given(generators())
def test_homography_from_exact_points_is_exact_in_batches(shape, rng):
    _, x, pixels = field_and_pixels(rng, shape, 12)
    found = homography_from_points(x, pixels, np.ones((*shape, 12)))
    assert found.shape == (*shape, 3, 3)
    assert farthest(found, x, pixels) < 1e-5


@given(generators())
def test_four_points_are_enough(rng):
    corners = np.array([[-50.0, -30.0], [50.0, -30.0], [50.0, 30.0], [-50.0, 30.0]]) + rng.uniform(-10, 10, size=(4, 2))
    pixels = dehomogenize(homogenize(corners) @ FIELD_TO_PIXELS.T)
    found = homography_from_points(corners, pixels, np.ones(4))
    np.testing.assert_allclose(found / found[2, 2], FIELD_TO_PIXELS, rtol=1e-5, atol=1e-6)


@given(generators())
def test_points_of_weight_zero_are_left_out(rng):
    _, x, pixels = field_and_pixels(rng, (4,), 12)
    moved, weights = pixels.copy(), np.ones((4, 12))
    for frame in range(4):  # other outliers in every frame
        wrong = rng.choice(12, 3, replace=False)
        moved[frame, wrong] += 300.0
        weights[frame, wrong] = 0.0
    assert farthest(homography_from_points(x, moved, weights), x, pixels) < 1e-4
    assert farthest(homography_from_points(x, moved, np.ones((4, 12))), x, pixels) > 10.0


@given(generators())
def test_homography_does_not_depend_on_the_units(rng):
    """What the normalisation is for: with noise the plain DLT in other units is another homography."""
    _, x, pixels = field_and_pixels(rng, (), 12)
    pixels += rng.normal(size=pixels.shape)
    mean, scale = rng.uniform(-1e4, 1e4, size=2), 10.0 ** rng.uniform(-3, 3)
    found, moved = (homography_from_points(y, pixels, np.ones(12)) for y in (x, scale * x + mean))
    there = np.array([[scale, 0.0, mean[0]], [0.0, scale, mean[1]], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(
        dehomogenize(homogenize(x) @ (moved @ there).T), dehomogenize(homogenize(x) @ found.T), atol=1e-4
    )


@pytest.mark.parametrize("shape", [(), (2, 3)])
@given(generators())
def test_projection_from_exact_points_is_exact_in_batches(shape, rng):
    P = np.array([[1000.0, 50, 480, 3e4], [-20, 1000, 270, -5e3], [0.05, -0.02, 1.0, 60.0]])
    X = rng.uniform(-20.0, 20.0, size=(*shape, 9, 3)) + (100.0, -300.0, 0.0)
    P = P * (1.0 + rng.uniform(-0.1, 0.1, size=(*shape, 3, 4)))
    pixels = dehomogenize(homogenize(X) @ np.swapaxes(P, -1, -2))
    found = projection_from_points(X, pixels, np.ones((*shape, 9)))
    assert found.shape == (*shape, 3, 4)
    assert farthest(found, X, pixels) < 1e-4 * np.ptp(pixels)
