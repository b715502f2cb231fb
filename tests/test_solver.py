"""The two solvers of the robust problem."""

from dataclasses import replace

import numpy as np
import pytest
from numdiff import central_differences, column_errors
from synthetic import observe, random_frames, whole_circle_markings

from fieldcalib.fields.soccer import soccer
from fieldcalib.fields.stands import DISTRIBUTIONS, MAIN_TRIBUNE
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.problem.parameters import (
    ANGLES,
    CENTER,
    LENS,
    LOG_F,
    PARAMETERS,
    GaussianPrior,
    camera_from_theta,
    gaussian_prior,
    theta_from_camera,
)
from fieldcalib.problem.solver import LOG_F_RANGE, Problem, solve_batch, solve_one

FIELD, SIZE = soccer(), (960, 540)
PINHOLE = np.arange(len(PARAMETERS)) < CENTER.stop
MAIN = ("main center", "main left", "main right", "main tribune")


def cost(problem, theta):
    return problem.linearized(theta)[0]


def prior_for(count, names=MAIN):
    priors = [gaussian_prior(DISTRIBUTIONS[names[t % len(names)]], SIZE) for t in range(count)]
    return GaussianPrior(np.stack([p.mean for p in priors]), np.stack([p.sigma for p in priors]))


def random_problem(count, loss, seed, noise=1.5, prior=True, outlier=30.0):
    """Noisy frames with a gross error in one segment each, and starts a little off the truth."""
    frames, cameras = random_frames(count, seed, noise, stands=MAIN)
    rng = np.random.default_rng(seed)
    for frame in frames:
        # a line: far inside a circle the distance has kinks, where a minimum need not be stationary
        label = rng.choice([label for label in frame if "Circle" not in label])
        frame[label] = frame[label] + rng.normal(scale=outlier, size=frame[label].shape)
    problem = Problem(pack(FIELD, frames, SIZE), PINHOLE, loss, 1.0, prior_for(count) if prior else None)
    starts = np.array([theta_from_camera(camera) for camera in cameras])
    starts[:, :7] += rng.normal(size=(count, 7)) * ([0.01] * 3 + [0.05] + [1.0] * 3)
    return problem, starts


@pytest.mark.parametrize("prior", [True, False], ids=["prior", "no prior"])
@pytest.mark.parametrize("name", ["cauchy", "soft_l1", "huber", "linear"])
def test_both_solvers_find_the_same_optimum(name, prior):
    count = 100 if name == "cauchy" else 25
    outlier = 30.0 if name == "cauchy" else 3.0  # the others follow gross errors into kinks
    problem, starts = random_problem(count, RobustLoss(name, 6.0), seed=7, prior=prior, outlier=outlier)
    wide = replace(problem, loss=RobustLoss("cauchy", 20.0))  # into the basin: a robust loss has several
    starts = solve_batch(wide, starts, max_iterations=40, tolerance=1e-3).theta
    batch = solve_batch(problem, starts, max_iterations=2000, tolerance=1e-12)
    assert batch.converged.all()
    # without a prior a frame may run away to infinite focal length, and then has no optimum
    kept = np.flatnonzero(batch.theta[:, LOG_F] - np.log(SIZE[0]) < LOG_F_RANGE[1] - 0.1)
    assert len(kept) == count if prior else len(kept) >= 0.99 * count
    for t in kept:
        one = solve_one(problem.take(np.array([t])), starts[t : t + 1], max_iterations=2000, tolerance=1e-12)
        assert one.converged[0]
        assert one.cost[0] == pytest.approx(batch.cost[t], rel=1e-6)


def test_reported_cost_is_the_cost_of_the_reported_camera():
    problem, starts = random_problem(10, RobustLoss("cauchy", 6.0), seed=1)
    solution = solve_batch(problem, starts, max_iterations=50, tolerance=1e-9)
    np.testing.assert_allclose(solution.cost, cost(problem, solution.theta), rtol=1e-12)
    one = solve_one(problem.take(np.array([3])), starts[3:4], max_iterations=50, tolerance=1e-9)
    np.testing.assert_allclose(one.cost, cost(problem.take(np.array([3])), one.theta), rtol=1e-12)


def test_cost_falls_and_the_gradient_vanishes():
    problem, starts = random_problem(20, RobustLoss("cauchy", 6.0), seed=2)
    before = problem.linearized(starts)
    solution = solve_batch(problem, starts, max_iterations=200, tolerance=1e-14)
    after = problem.linearized(solution.theta)
    assert np.all(after[0] < before[0])
    # in units in which the Hessian's diagonal is one
    scale = np.sqrt(np.einsum("bii->bi", after[2]))
    assert np.max(np.abs(after[1] / scale)) < 1e-4
    assert np.max(np.abs(before[1] / scale)) > 1.0


def test_gradient_is_the_derivative_of_the_cost():
    problem, starts = random_problem(10, RobustLoss("cauchy", 6.0), seed=3)
    _, gradient, _ = problem.linearized(starts)
    fixed = starts[:, ~PINHOLE]
    steps = np.array([1e-5] * 4 + [1e-3] * 3)
    numeric = central_differences(
        lambda free: cost(problem, np.concatenate([free, fixed], axis=1)), starts[:, PINHOLE], steps
    )
    assert column_errors(gradient[:, None], numeric[:, None], floor=1.0).max() < 1e-4


def test_a_frame_ends_the_same_in_any_company():
    problem, starts = random_problem(12, RobustLoss("cauchy", 6.0), seed=4)
    together = solve_batch(problem, starts, max_iterations=100, tolerance=1e-10)
    order = np.arange(12)[::-1]
    reverse = solve_batch(problem.take(order), starts[order], max_iterations=100, tolerance=1e-10)
    np.testing.assert_allclose(reverse.theta[order], together.theta, rtol=1e-7, atol=1e-9)
    alone = solve_batch(problem.take(order[:1]), starts[order[:1]], max_iterations=100, tolerance=1e-10)
    np.testing.assert_allclose(alone.theta[0], together.theta[-1], rtol=1e-7, atol=1e-9)


def test_starts_are_left_as_they_were():
    problem, starts = random_problem(3, RobustLoss("cauchy", 6.0), seed=5)
    kept = starts.copy()
    solve_batch(problem, starts, max_iterations=20, tolerance=1e-9)
    solve_one(problem.take(np.array([0])), starts[:1], max_iterations=20, tolerance=1e-9)
    np.testing.assert_array_equal(starts, kept)


@pytest.mark.parametrize("solve", [solve_batch, solve_one])
def test_fixed_parameters_stay(solve):
    problem, starts = random_problem(1, RobustLoss("cauchy", 6.0), seed=6)
    free = PINHOLE.copy()
    free[[2, LOG_F]] = False
    problem = Problem(problem.observations, free, problem.loss, 1.0, problem.prior)
    solution = solve(problem, starts, max_iterations=50, tolerance=1e-9)
    np.testing.assert_array_equal(solution.theta[:, ~free], starts[:, ~free])
    assert np.all(solution.theta[:, free] != starts[:, free])


@pytest.mark.parametrize("solve", [solve_batch, solve_one])
def test_iterations_that_are_used_up_are_said_so(solve):
    problem, starts = random_problem(1, RobustLoss("cauchy", 6.0), seed=8)
    solution = solve(problem, starts, max_iterations=2, tolerance=1e-12)
    assert not solution.converged[0]
    assert solution.iterations[0] <= 2


@pytest.mark.parametrize("solve", [solve_batch, solve_one])
def test_a_strong_prior_wins_and_pan_has_no_seam(solve):
    problem, _ = random_problem(1, RobustLoss("cauchy", 6.0), seed=9)
    mean, sigma = gaussian_prior(MAIN_TRIBUNE, SIZE).mean, np.full(len(PARAMETERS), 1e-6)
    mean[ANGLES] = (np.pi - 0.01, 1.3, 0.0)
    problem = Problem(problem.observations, PINHOLE, problem.loss, 1.0, GaussianPrior(mean[None], sigma[None]))
    start = mean[None] + 0.02 * np.eye(len(PARAMETERS))[0]  # beyond half a turn
    start[0, 0] -= 2.0 * np.pi
    solution = solve(problem, start, max_iterations=100, tolerance=1e-12)
    assert np.cos(solution.theta[0, 0] - mean[0]) == pytest.approx(1.0, abs=1e-9)
    assert abs(solution.theta[0, 0] - start[0, 0]) < 0.1
    np.testing.assert_allclose(solution.theta[0, 1:7], mean[1:7], atol=1e-3)


def test_a_fit_that_would_collapse_stays_a_camera():
    """One line cannot hold the focal length: without a prior nothing keeps it from running away."""
    frame = {"Middle line": np.array([[480.0, 100.0], [485.0, 250.0], [520.0, 400.0]])}
    problem = Problem(pack(FIELD, [frame], SIZE), PINHOLE, RobustLoss("linear", 1.0))
    start = gaussian_prior(MAIN_TRIBUNE, SIZE).mean[None]
    for solve in (solve_batch, solve_one):
        solution = solve(problem, start, max_iterations=300, tolerance=1e-12)
        log_f = solution.theta[0, LOG_F] - np.log(SIZE[0])
        assert np.all(np.isfinite(solution.theta))
        assert LOG_F_RANGE[0] < log_f < LOG_F_RANGE[1]


def test_a_start_without_a_cost_is_given_back():
    problem, starts = random_problem(2, RobustLoss("cauchy", 6.0), seed=10)
    starts[0, LOG_F] = 30.0
    solution = solve_batch(problem, starts, max_iterations=50, tolerance=1e-9)
    assert np.isinf(solution.cost[0])
    assert not solution.converged[0]
    np.testing.assert_array_equal(solution.theta[0], starts[0])
    assert solution.converged[1]
    one = solve_one(problem.take(np.array([0])), starts[:1], max_iterations=50, tolerance=1e-9)
    assert np.isinf(one.cost[0])
    assert not one.converged[0]
    np.testing.assert_array_equal(one.theta[0], starts[0])


# --- the bound that keeps a lens from folding ---


@pytest.mark.parametrize("solve", [solve_one, solve_batch])
@pytest.mark.parametrize("b2", [-0.01, 0.01])
def test_the_second_lens_coefficient_does_not_fall_below_what_folds(solve, b2):
    """Frames whose true lens folds end at the bound, at the least cost there; others at the truth."""
    truth = theta_from_camera(Camera.from_angles(-0.3, 1.35, 0.0, 900.0, (0.0, 68.0, -17.0), (960, 540)))
    truth[LENS] = (0.03, b2)
    frame = observe(whole_circle_markings(soccer()), camera_from_theta(truth, (960, 540)), per_line=9, per_curve=20)
    observations = pack(soccer(), [frame], (960, 540))
    free = np.ones(12, dtype=bool)
    free[9:] = False
    problem = Problem(observations, free, RobustLoss("cauchy", 6.0))
    start = truth.copy()
    start[LENS] = (0.02, 0.005)
    solution = solve(problem, start[None], max_iterations=100, tolerance=1e-12)
    if b2 > 0.0:
        np.testing.assert_allclose(solution.theta[0, LENS], truth[LENS], atol=1e-6)
        return
    assert 0.0 <= solution.theta[0, LENS][1] < 1e-6
    held = solve_batch(
        replace(problem, free=free & (np.arange(12) != 8)), solution.theta, max_iterations=100, tolerance=1e-12
    )
    assert solution.cost[0] == pytest.approx(held.cost[0], rel=1e-6)
