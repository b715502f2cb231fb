"""The smooth path of a camera that moves, against finite differences and against the dense system."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numdiff import central_differences
from strategies import bounded
from synthetic import observe
from tripods import SIZE, panned

from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.frame_ties import TAILS, PathTerm, SmoothPath
from fieldcalib.problem.layout import CENTER, Layout, Role
from fieldcalib.problem.levenberg_marquardt import Groups, block_arrow_steps
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack

LAYOUT = Layout.of(SIZE).with_roles(Role.SHARED, "principal point", "k1").fixed("k2", "aspect")


def times(least, most):
    """Times of `least` to `most` frames, which are 1 to 19 apart."""
    return st.lists(st.integers(1, 19), min_size=least, max_size=most).map(
        lambda steps: np.cumsum(np.array(steps, int))
    )


def theta_at(centres):
    """Parameters of frames whose centres are so far from that of a tripod, (count, 3)."""
    theta = np.tile(LAYOUT.theta(panned(1)[0]), (len(centres), 1))
    theta[:, CENTER] += centres
    return theta


def dense(path, theta):
    """Gradient and reweighted Hessian by all free parameters of all frames, from the accelerations one by one."""
    count, free = len(theta), np.flatnonzero(LAYOUT.free)
    centre = np.flatnonzero(np.isin(free, np.r_[CENTER]))
    gradient, hessian = np.zeros((count, len(free))), np.zeros(2 * (count, len(free)))
    for k in range(count - 2):
        before, after = path.time[k + 1] - path.time[k], path.time[k + 2] - path.time[k + 1]
        velocity = [(theta[k + 1] - theta[k]) / before, (theta[k + 2] - theta[k + 1]) / after]
        z = 2.0 * (velocity[1] - velocity[0])[CENTER] / (before + after) / path.sigma
        c = 2.0 * np.array([1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after]) / (before + after) / path.sigma
        weight = TAILS.evaluate(np.array([z @ z]))[1][0]
        for i in range(3):
            gradient[k + i, centre] += weight * c[i] * z
            for j in range(3):
                hessian[k + i, centre, k + j, centre] += weight * c[i] * c[j]
    return gradient, hessian


@given(times(0, 7), st.data())
def test_gradient_hessian_and_coupling_are_those_of_the_accelerations(time, data):
    count = len(time)
    steps = data.draw(bounded((count, 3), -2.0, 2.0))
    path, theta = SmoothPath(time, 0.3), theta_at(np.cumsum(steps, axis=0))
    free = np.flatnonzero(LAYOUT.free)
    found = PathTerm(path, LAYOUT, theta)
    gradient, hessian = dense(path, theta)
    np.testing.assert_allclose(found.gradient, gradient, rtol=1e-9, atol=1e-9)
    whole = np.zeros_like(hessian)
    whole[np.arange(count), :, np.arange(count)] = found.hessian
    own = np.flatnonzero(~LAYOUT.shared)
    for i, j, block in zip(*found.coupling, strict=True):
        whole[i, own[:, None], j, own] += block
        whole[j, own[:, None], i, own] += block.T
    np.testing.assert_allclose(whole, hessian, rtol=1e-9, atol=1e-9)

    def costs(changes):
        moved = np.repeat(theta[None], len(changes), axis=0)
        moved[:, :, free] += changes.reshape(len(changes), count, len(free))
        return np.array([[PathTerm(path, LAYOUT, one).cost.sum()] for one in moved])

    if count:
        numeric = central_differences(costs, np.zeros((1, count * len(free))), 1e-4)[0, 0]
        np.testing.assert_allclose(found.gradient.ravel(), numeric, atol=1e-5 * (1.0 + np.abs(gradient).max()))


@given(times(3, 9), bounded(3, -2.0, 2.0), bounded(3, -2.0, 2.0))
def test_even_motion_costs_nothing_and_acceleration_what_it_is(time, velocity, acceleration):
    even = time[:, None] * velocity
    path = SmoothPath(time, 0.2)
    assert PathTerm(path, LAYOUT, theta_at(even)).cost.sum() == pytest.approx(0.0, abs=1e-12)
    theta = theta_at(even + 0.5 * np.square(time)[:, None] * acceleration)
    expected = 0.5 * (len(time) - 2) * TAILS.evaluate(np.array([acceleration @ acceleration / 0.2**2]))[0][0]
    assert PathTerm(path, LAYOUT, theta).cost.sum() == pytest.approx(expected, rel=1e-6, abs=1e-12)


def test_steps_of_frames_on_a_path_are_those_of_the_dense_system():
    rng = np.random.default_rng(0)
    cameras = panned(5)
    observations = pack(soccer(), [observe(soccer(), camera, rng, 0.5) for camera in cameras], SIZE)
    path = SmoothPath(np.array([0, 2, 3, 7, 8]), 0.01)
    problem = Problem(observations, LAYOUT, RobustLoss("cauchy", 3.0), group=np.zeros(5, dtype=np.intp), path=path)
    theta = np.array([LAYOUT.theta(camera) for camera in cameras])
    theta[:, CENTER] += rng.normal(scale=0.1, size=(5, 3))
    found = evaluate(problem, theta)
    damping, held = np.full(5, 1e-3), np.zeros_like(found.gradient, dtype=bool)
    step = block_arrow_steps(
        found.hessian, found.gradient, damping, held, LAYOUT.shared, Groups.of(problem), found.coupling
    )
    # the step of the quadratic model is a minimum of it
    own = np.flatnonzero(~LAYOUT.shared)
    slope = found.gradient + np.einsum("bij,bj->bi", found.hessian, step)
    slope += 1e-3 * np.diagonal(found.hessian, axis1=1, axis2=2) * step
    for i, j, block in zip(*found.coupling, strict=True):
        slope[i, own] += block @ step[j, own]
        slope[j, own] += block.T @ step[i, own]
    np.testing.assert_allclose(slope[:, own], 0.0, atol=1e-6 * np.abs(found.gradient).max())
    np.testing.assert_allclose(slope[:, LAYOUT.shared].sum(axis=0), 0.0, atol=1e-6 * np.abs(found.gradient).max())


def test_frames_on_a_path_cannot_be_taken_apart():
    observations = pack(soccer(), [{}] * 3, SIZE)
    problem = Problem(observations, LAYOUT, RobustLoss("linear", 1.0), path=SmoothPath(np.arange(3), 0.1))
    with pytest.raises(ValueError, match="on one path cannot be taken apart"):
        problem.take(np.array([0]))
    assert len(replace(problem, path=None).take(np.array([0]))) == 1
