"""pan, tilt, roll <-> rotation matrix."""

import numpy as np
import pytest
from hypothesis import given
from numdiff import central_differences
from scipy.spatial.transform import Rotation
from strategies import angle, any_angles, numbers, operated_angles, vectors

from fieldcalib.geometry.rotation import (
    angles_from_rotation,
    rotation_axes,
    rotation_from_angles,
    rotation_from_vector,
    rotation_vector_jacobian,
)


def soccernet_rotation(pan, tilt, roll):
    """R of SoccerNet's evaluator: the transpose of its pan_tilt_roll_to_orientation."""

    def about_z(angle):
        return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])

    about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    return (about_z(pan) @ about_x @ about_z(roll)).T


def soccernet_angles(R):
    """SoccerNet's rotation_matrix_to_pan_tilt_roll: of the two solutions the one with the smaller |roll|."""
    orientation = R.T
    solutions = []
    for tilt in (np.arccos(orientation[2, 2]), -np.arccos(orientation[2, 2])):
        sign = 1.0 if np.sin(tilt) > 0.0 else -1.0
        pan = np.arctan2(sign * orientation[0, 2], -sign * orientation[1, 2])
        solutions.append((pan, tilt, np.arctan2(sign * orientation[2, 0], sign * orientation[2, 1])))
    return np.array(min(solutions, key=lambda solution: abs(solution[2])))


def wrapped(angles):
    return np.angle(np.exp(1j * np.asarray(angles)))


def assert_same_angles(found, expected, atol):
    np.testing.assert_allclose(wrapped(found - expected), 0.0, atol=atol)


@given(any_angles())
def test_matrix_is_a_rotation(angles):
    R = rotation_from_angles(angles)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) > 0.0


@given(any_angles())
def test_matrix_equals_scipy_zxz_transposed(angles):
    expected = Rotation.from_euler("ZXZ", angles).as_matrix().T
    np.testing.assert_allclose(rotation_from_angles(angles), expected, atol=1e-14)


@given(any_angles())
def test_matrix_equals_soccernet(angles):
    np.testing.assert_allclose(rotation_from_angles(angles), soccernet_rotation(*angles), atol=1e-14)


@given(operated_angles())
def test_angles_equal_soccernet(angles):
    # arccos of SoccerNet loses half the digits near straight down, hence 1e-9
    R = rotation_from_angles(angles)
    assert_same_angles(angles_from_rotation(R), soccernet_angles(R), atol=1e-9)


@given(any_angles())
def test_matrix_to_angles_to_matrix(angles):
    R = rotation_from_angles(angles)
    np.testing.assert_allclose(rotation_from_angles(angles_from_rotation(R)), R, atol=1e-12)


@given(operated_angles())
def test_angles_to_matrix_to_angles(angles):
    # tilt is at least 0.01 away from the gimbal lock, which costs pan and roll two digits
    assert_same_angles(angles_from_rotation(rotation_from_angles(angles)), angles, atol=1e-12)


@given(operated_angles())
def test_negative_tilt_with_small_roll_comes_back_too(angles):
    angles = angles * (1.0, -1.0, 1.0)
    assert_same_angles(angles_from_rotation(rotation_from_angles(angles)), angles, atol=1e-12)


@given(any_angles())
def test_the_other_solution_has_the_larger_roll(angles):
    R = rotation_from_angles(angles)
    found = angles_from_rotation(R)
    other = wrapped(found * (1.0, -1.0, 1.0) + (np.pi, 0.0, np.pi))
    np.testing.assert_allclose(rotation_from_angles(other), R, atol=1e-12)  # it is a solution
    assert abs(found[2]) <= abs(other[2]) + 1e-12


@pytest.mark.parametrize("tilt", [0.0, np.pi])
@given(any_angles())
def test_straight_down_and_up_have_roll_zero(tilt, angles):
    R = rotation_from_angles(np.array([angles[0], tilt, angles[2]]))
    found = angles_from_rotation(R)
    assert found[2] == 0.0
    np.testing.assert_allclose(rotation_from_angles(found), R, atol=1e-12)


@pytest.mark.parametrize("tilt", [0.0, np.pi])
@given(numbers(-12.0, -5.0), any_angles(), any_angles(), angle(3.0))
def test_rounding_of_the_matrix_is_not_blown_up_near_straight_down(tilt, log_offset, axis, turn, pan):
    """A matrix that comes from elsewhere is exact to 1e-16, and so should be that of its angles, up to a few digits."""
    near = Rotation.from_rotvec(10.0**log_offset * rotation_from_angles(axis)[2]).as_matrix()
    turn = rotation_from_angles(turn)
    R = turn.T @ (turn @ near @ rotation_from_angles(np.array([pan, tilt, 0.0])))
    np.testing.assert_allclose(rotation_from_angles(angles_from_rotation(R)), R, atol=1e-9)


def skew(axis):
    x, y, z = axis
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


@given(any_angles())
def test_axes_against_central_differences(angles):
    # dXc = dR (X - C) = -axis x Xc for every X, hence dR/dangle = -[axis]x R
    R = rotation_from_angles(angles)
    axes = rotation_axes(angles, R)
    numeric = central_differences(rotation_from_angles, angles, 1e-3)
    for i, name in enumerate(("pan", "tilt", "roll")):
        np.testing.assert_allclose(-skew(axes[i]) @ R, numeric[..., i], atol=1e-11, err_msg=name)


@given(any_angles())
def test_axes_are_unit_vectors(angles):
    axes = rotation_axes(angles, rotation_from_angles(angles))
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1.0, atol=1e-14)


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_batches_equal_one_by_one(shape):
    angles = np.random.default_rng(0).uniform(-3.0, 3.0, size=(*shape, 3))
    R = rotation_from_angles(angles)
    found, axes = angles_from_rotation(R), rotation_axes(angles, R)
    assert R.shape == (*shape, 3, 3)
    assert found.shape == (*shape, 3)
    assert axes.shape == (*shape, 3, 3)
    for index in np.ndindex(shape):
        np.testing.assert_array_equal(R[index], rotation_from_angles(angles[index]))
        np.testing.assert_array_equal(found[index], angles_from_rotation(R[index]))
        np.testing.assert_array_equal(axes[index], rotation_axes(angles[index], R[index]))


def test_angles_do_not_depend_on_where_an_array_lies():
    """Of matrices that are parts of larger ones, at every distance from what comes behind them."""
    rng = np.random.default_rng(0)
    R = rotation_from_angles(rng.uniform(-1.0, 1.0, size=(200, 3)))
    expected = angles_from_rotation(R)
    for gap in range(12):
        memory = np.zeros(200 * 16 + gap + 200)
        parts = memory[: 200 * 16].reshape(200, 4, 4)[:, :3, :3]
        parts[:] = R
        np.testing.assert_array_equal(angles_from_rotation(parts), expected)


@given(vectors([-3.0] * 3, [3.0] * 3, 5), numbers(-12.0, 0.0))
def test_rotations_by_vectors_are_those_of_scipy(v, log_length):
    for some in (v, v[0], 10.0**log_length * v):
        expected = Rotation.from_rotvec(some).as_matrix()
        np.testing.assert_allclose(rotation_from_vector(some), expected, rtol=0.0, atol=1e-14)


@given(vectors([-1.7] * 3, [1.7] * 3), numbers(-6.0, 0.0))
def test_vectors_of_rotations_against_central_differences(v, log_length):
    """Below half a turn, where the vector jumps."""
    v = 10.0**log_length * v

    def followed(turn):
        return Rotation.from_matrix(rotation_from_vector(turn) @ rotation_from_vector(v)).as_rotvec()

    numeric = central_differences(followed, np.zeros(3), 1e-3)
    np.testing.assert_allclose(rotation_vector_jacobian(v), numeric, atol=1e-9)
