"""Robust losses: values as SciPy has them, slopes that are their derivatives."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from fieldcalib.losses import RobustLoss

NAMES = ("linear", "soft_l1", "huber", "cauchy")
every_loss = pytest.mark.parametrize("name", NAMES)

scales = st.floats(0.05, 500.0)  # px
ratios = st.one_of(st.just(0.0), st.floats(-4.0, 3.0).map(lambda exponent: 10.0**exponent))  # |r| / scale


def central_difference(function, x, step):
    """Fourth order: its error is of the order of (step / x)^4."""
    return (8.0 * (function(x + step) - function(x - step)) - function(x + 2 * step) + function(x - 2 * step)) / (
        12.0 * step
    )


@every_loss
@given(ratio=ratios, scale=scales)
def test_slopes_are_the_derivatives_by_the_squared_residual(name, ratio, scale):
    loss, squared = RobustLoss(name, scale), np.array([(ratio * scale) ** 2])
    step = 1e-3 * (squared + scale**2)
    # where huber bends its second derivative jumps
    assume(name != "huber" or np.all(np.abs(squared - scale**2) > 2.1 * step))
    _, first, second = loss.evaluate(squared)
    numeric_first = central_difference(lambda s: loss.evaluate(s)[0], squared, step)
    numeric_second = central_difference(lambda s: loss.evaluate(s)[1], squared, step)
    np.testing.assert_allclose(first, numeric_first, rtol=1e-8)
    np.testing.assert_allclose(second, numeric_second, rtol=1e-8, atol=1e-12 / scale**2)


@every_loss
@given(r=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=20), scale=scales)
def test_half_the_sum_is_scipys_cost(name, r, scale):
    r = np.array(r)
    expected = least_squares(lambda x: r + x, [0.0], loss=name, f_scale=scale, max_nfev=1).cost
    value, _, _ = RobustLoss(name, scale).evaluate(np.square(r))
    assert 0.5 * np.sum(value) == pytest.approx(expected, rel=1e-10, abs=1e-280)


@every_loss
def test_small_residuals_count_squared(name):
    squared = np.array([[0.0, 1e-10], [1e-8, 1e-6]])
    value, first, second = RobustLoss(name, 5.0).evaluate(squared)
    np.testing.assert_allclose(value, squared, rtol=1e-7, atol=1e-14)  # rounding, at a scale of 5
    np.testing.assert_allclose(first, 1.0, rtol=1e-7)
    assert second.shape == squared.shape


@pytest.mark.parametrize(("name", "growth"), [("linear", 100.0), ("soft_l1", 10.0), ("huber", 10.0)])
def test_how_losses_grow_far_out(name, growth):
    """Ten times the residual: a hundred times the squared loss, ten times those that are linear in |r|."""
    value, first, _ = RobustLoss(name, 2.0).evaluate(np.square([1e5, 1e6]))
    assert value[1] / value[0] == pytest.approx(growth, rel=1e-4)
    assert first[1] / first[0] == pytest.approx(growth / 100.0, rel=1e-4)


def test_cauchy_grows_by_a_constant_with_every_factor_of_ten():
    value, _, _ = RobustLoss("cauchy", 2.0).evaluate(np.square([1e5, 1e6, 1e7]))
    np.testing.assert_allclose(np.diff(value), 2.0**2 * np.log(100.0), rtol=1e-6)


@pytest.mark.parametrize("name", ["tukey", "", "Cauchy", "arctan", None, 1])
def test_unknown_names(name):
    with pytest.raises(ValueError, match=f"loss must be one of linear, soft_l1, huber, cauchy, got {name!r}"):
        RobustLoss(name, 3.0)


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf])
def test_scales_that_are_no_length(scale):
    with pytest.raises(ValueError, match=f"must be a positive number of pixels, got {scale}"):
        RobustLoss("cauchy", scale)
