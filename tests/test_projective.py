"""Homogeneous points and lines; total least squares lines; homographies from lines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import angle, generators

from fieldcalib.projective import dehomogenize, fit_lines, homogenize, homography_from_lines


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
