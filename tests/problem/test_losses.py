"""Robust losses: values as SciPy has them, slopes that are their derivatives."""

import re

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numdiff import central_differences
from scipy.optimize import least_squares

from fieldcalib.problem.losses import RobustLoss

NAMES = ("linear", "soft_l1", "huber", "cauchy")
every_loss = pytest.mark.parametrize("name", NAMES)

scales = st.floats(0.05, 500.0)  # px
ratios = st.one_of(st.just(0.0), st.floats(-4.0, 3.0).map(lambda exponent: 10.0**exponent))  # |r| / scale


@every_loss
@given(ratio=ratios, scale=scales)
def test_slope_is_the_derivative_by_the_squared_residual(name, ratio, scale):
    loss, squared = RobustLoss(name, scale), np.array([(ratio**2 + 0.003) * scale**2])  # a step below is not negative
    step = 1e-3 * (squared + scale**2)
    # where huber bends its slope has a kink
    assume(name != "huber" or np.all(np.abs(squared - scale**2) > 2.1 * step))
    _, slope = loss.evaluate(squared)
    numeric = central_differences(lambda s: loss.evaluate(s)[0], squared, step)
    np.testing.assert_allclose(slope, numeric[:, 0], rtol=1e-8)


@every_loss
@given(ratio=ratios, other=ratios, scale=scales)
def test_the_weighted_square_lies_above_the_loss(name, ratio, other, scale):
    """What makes reweighted least squares descend: rho is concave in the squared residual."""
    here, there = (ratio * scale) ** 2, (other * scale) ** 2
    loss = RobustLoss(name, scale)
    value, slope = loss.evaluate(np.array([here]))
    at_other, _ = loss.evaluate(np.array([there]))
    rounding = 1e-9 * (here + there) + 1e-15 * scale**2  # a loss rounds to that part of its scale, as SciPy's does
    assert at_other[0] <= (value[0] + slope[0] * (there - here)) * (1.0 + 1e-9) + rounding


@every_loss
@given(r=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=20), scale=scales)
def test_half_the_sum_is_scipys_cost(name, r, scale):
    r = np.array(r)
    expected = least_squares(lambda x: r + x, [0.0], loss=name, f_scale=scale, max_nfev=1).cost
    value, _ = RobustLoss(name, scale).evaluate(np.square(r))
    assert 0.5 * np.sum(value) == pytest.approx(expected, rel=1e-10, abs=1e-280)


@every_loss
def test_small_residuals_count_squared(name):
    squared = np.array([[0.0, 1e-10], [1e-8, 1e-6]])
    value, slope = RobustLoss(name, 5.0).evaluate(squared)
    np.testing.assert_allclose(value, squared, rtol=1e-7, atol=1e-14)  # rounding, at a scale of 5
    np.testing.assert_allclose(slope, 1.0, rtol=1e-7)


@pytest.mark.parametrize(("name", "growth"), [("linear", 100.0), ("soft_l1", 10.0), ("huber", 10.0)])
def test_how_losses_grow_far_out(name, growth):
    """Ten times the residual: a hundred times the squared loss, ten times those that are linear in |r|."""
    value, slope = RobustLoss(name, 2.0).evaluate(np.square([1e5, 1e6]))
    assert value[1] / value[0] == pytest.approx(growth, rel=1e-4)
    assert slope[1] / slope[0] == pytest.approx(growth / 100.0, rel=1e-4)


def test_cauchy_grows_by_a_constant_with_every_factor_of_ten():
    value, _ = RobustLoss("cauchy", 2.0).evaluate(np.square([1e5, 1e6, 1e7]))
    np.testing.assert_allclose(np.diff(value), 2.0**2 * np.log(100.0), rtol=1e-6)


@pytest.mark.parametrize("name", ["tukey", "", "Cauchy", "arctan", None, 1])
def test_unknown_names(name):
    with pytest.raises(ValueError, match=f"loss must be one of linear, soft_l1, huber, cauchy, got {name!r}"):
        RobustLoss(name, 3.0)


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf, 1e-320, 1e200])
def test_scales_that_are_no_length(scale):
    with pytest.raises(ValueError, match=re.escape(f"must be a number of pixels from 1e-06 to 1e+09, got {scale}")):
        RobustLoss("cauchy", scale)
