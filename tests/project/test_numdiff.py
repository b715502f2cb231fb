"""The differences themselves, and that a wrong Jacobian does not pass them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numdiff import central_differences, column_errors

X = np.array([0.7, -1.3, 0.4])


def spiral(x):
    """A smooth function of three numbers whose Jacobian has no zeros."""
    a, b, c = np.moveaxis(x, -1, 0)
    return np.stack([np.exp(a) * np.sin(b + c), a * b + np.cos(c) * b, np.sin(a * c) - b**2], axis=-1)


def spiral_jacobian(x):
    a, b, c = x
    return np.array(
        [
            [np.exp(a) * np.sin(b + c), np.exp(a) * np.cos(b + c), np.exp(a) * np.cos(b + c)],
            [b, a + np.cos(c), -np.sin(c) * b],
            [c * np.cos(a * c), -2.0 * b, a * np.cos(a * c)],
        ]
    )


@given(st.lists(st.floats(-3.0, 3.0), min_size=5, max_size=5), st.floats(-2.0, 2.0), st.floats(1e-2, 1.0))
def test_polynomials_of_fourth_degree_are_exact(coefficients, x, step):
    p = np.polynomial.Polynomial(coefficients)
    (found,) = central_differences(lambda x: p(x[0]), np.array([x]), step)
    assert found == pytest.approx(p.deriv()(x), abs=1e-9)


def test_the_error_falls_with_the_fourth_power_of_the_step():
    J = spiral_jacobian(X)
    coarse, fine = (np.max(np.abs(central_differences(spiral, X, step) - J)) for step in (2e-2, 1e-2))
    assert coarse / fine == pytest.approx(16.0, rel=0.05)


def test_every_component_has_its_own_step():
    """Millionths of a radian beside pixels."""
    units = np.array([1e-6, 1.0, 1e6])
    found = central_differences(lambda y: spiral(y / units), X * units, 1e-3 * units)
    np.testing.assert_allclose(found * units, spiral_jacobian(X), atol=1e-10)


def test_a_batch_is_one_by_one():
    batch = X + np.arange(6.0).reshape(2, 3, 1) / 10.0
    found = central_differences(spiral, batch, 1e-3)
    assert found.shape == (2, 3, 3, 3)
    for index in np.ndindex(2, 3):
        np.testing.assert_array_equal(found[index], central_differences(spiral, batch[index], 1e-3))


def test_the_argument_is_left_as_it_was():
    x = X.copy()
    central_differences(spiral, x, 1e-3)
    np.testing.assert_array_equal(x, X)


@pytest.mark.parametrize("column", range(3))
@pytest.mark.parametrize(
    "mistake", [lambda c: -c, lambda c: c[::-1], lambda c: c * (1.0 + 1e-5), lambda c: c + [0.0, 1e-5, 0.0]]
)
def test_a_wrong_column_is_found_and_no_other(column, mistake):
    """A sign, two rows that are exchanged, a part in 100 000."""
    J, numeric = spiral_jacobian(X), central_differences(spiral, X, 1e-3)
    assert column_errors(J, numeric, floor=1e-3).max() < 1e-8
    wrong = J.copy()
    wrong[:, column] = mistake(J[:, column])
    assert np.flatnonzero(column_errors(wrong, numeric, floor=1e-3) > 1e-6).tolist() == [column]


def test_exchanged_columns_are_found():
    J, numeric = spiral_jacobian(X), central_differences(spiral, X, 1e-3)
    assert np.all(column_errors(J[:, [1, 0, 2]], numeric, floor=1e-3)[:2] > 0.1)


def test_columns_of_a_batch_have_an_error_each():
    J = np.ones((5, 4, 3))
    wrong = J.copy()
    wrong[2, 1, 0] += 2.0
    expected = np.zeros((5, 3))
    expected[2, 0] = 2.0 / (2.0 + 1.0)  # a column of four ones is two long
    np.testing.assert_allclose(column_errors(wrong, J, floor=1.0), expected)
