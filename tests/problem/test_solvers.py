"""The two solvers of the robust problem."""

from dataclasses import replace

import numpy as np
import pytest
from numdiff import central_differences, column_errors
from synthetic import gaussian_prior, observe, random_frames, whole_circle_markings

from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import DISTRIBUTIONS, MAIN_TRIBUNE
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import LOG_F_RANGE, Problem, evaluate
from fieldcalib.problem.layout import (
    ANGLES,
    LOG_F,
    GaussianPrior,
    Layout,
    Role,
    SizeBlock,
    camera_from_theta,
    theta_from_camera,
)
from fieldcalib.problem.levenberg_marquardt import Groups, block_arrow_steps, least_squares, levenberg_marquardt
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack

FIELD, SIZE = soccer(), (960, 540)
RADIAL = Layout.of(SIZE)
PINHOLE = RADIAL.fixed("lens", "principal point", "aspect")
MAIN = ("main center", "main left", "main right", "main tribune")


def cost(problem, theta):
    return evaluate(problem, theta).cost


def prior_for(count, names=MAIN):
    priors = [gaussian_prior(DISTRIBUTIONS[names[t % len(names)]], RADIAL) for t in range(count)]
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
@pytest.mark.parametrize(
    "name", ["cauchy", "linear", *(pytest.param(name, marks=pytest.mark.slow) for name in ("soft_l1", "huber"))]
)
def test_both_solvers_find_the_same_optimum_on_many_frames(name, prior):
    count = 15
    outlier = 30.0 if name == "cauchy" else 3.0  # the others follow gross errors into kinks
    problem, starts = random_problem(count, RobustLoss(name, 6.0), seed=7, prior=prior, outlier=outlier)
    wide = replace(problem, loss=RobustLoss("cauchy", 20.0))  # into the basin: a robust loss has several
    starts = levenberg_marquardt(evaluate(wide, starts), max_iterations=40, tolerance=1e-3).theta
    batch = levenberg_marquardt(evaluate(problem, starts), max_iterations=2000, tolerance=1e-12)
    assert batch.converged.all()
    # without a prior a frame may run away to infinite focal length, and then has no optimum
    kept = np.flatnonzero(batch.theta[:, LOG_F] - np.log(SIZE[0]) < LOG_F_RANGE[1] - 0.1)
    assert len(kept) == count if prior else len(kept) >= 0.99 * count
    for t in kept:
        one = least_squares(
            evaluate(problem.take(np.array([t])), starts[t : t + 1]), max_iterations=2000, tolerance=1e-12
        )
        assert one.converged[0]
        assert one.cost[0] == pytest.approx(batch.cost[t], rel=1e-6)


def test_reported_cost_is_the_cost_of_the_reported_camera():
    problem, starts = random_problem(10, RobustLoss("cauchy", 6.0), seed=1)
    solution = levenberg_marquardt(evaluate(problem, starts), max_iterations=50, tolerance=1e-9)
    np.testing.assert_allclose(solution.cost, cost(problem, solution.theta), rtol=1e-12)
    one = least_squares(evaluate(problem.take(np.array([3])), starts[3:4]), max_iterations=50, tolerance=1e-9)
    np.testing.assert_allclose(one.cost, cost(problem.take(np.array([3])), one.theta), rtol=1e-12)


def test_cost_falls_and_the_gradient_vanishes():
    problem, starts = random_problem(20, RobustLoss("cauchy", 6.0), seed=2)
    before = evaluate(problem, starts)
    solution = levenberg_marquardt(evaluate(problem, starts), max_iterations=200, tolerance=1e-14)
    after = solution.evaluation
    assert np.all(after.cost < before.cost)
    # in units in which the Hessian's diagonal is one
    scale = np.sqrt(np.einsum("bii->bi", after.hessian))
    assert np.max(np.abs(after.gradient / scale)) < 1e-4
    assert np.max(np.abs(before.gradient / scale)) > 1.0


def test_gradient_is_the_derivative_of_the_cost():
    problem, starts = random_problem(10, RobustLoss("cauchy", 6.0), seed=3)
    gradient = evaluate(problem, starts).gradient
    fixed = starts[:, ~PINHOLE.free]
    steps = np.array([1e-5] * 4 + [1e-3] * 3)
    numeric = central_differences(
        lambda free: cost(problem, np.concatenate([free, fixed], axis=1)), starts[:, PINHOLE.free], steps
    )
    assert column_errors(gradient[:, None], numeric[:, None], floor=1.0).max() < 1e-4


def test_a_frame_ends_the_same_in_any_company():
    problem, starts = random_problem(12, RobustLoss("cauchy", 6.0), seed=4)
    together = levenberg_marquardt(evaluate(problem, starts), max_iterations=100, tolerance=1e-10)
    order = np.arange(12)[::-1]
    reverse = levenberg_marquardt(evaluate(problem.take(order), starts[order]), max_iterations=100, tolerance=1e-10)
    np.testing.assert_allclose(reverse.theta[order], together.theta, rtol=1e-7, atol=1e-9)
    alone = levenberg_marquardt(
        evaluate(problem.take(order[:1]), starts[order[:1]]), max_iterations=100, tolerance=1e-10
    )
    np.testing.assert_allclose(alone.theta[0], together.theta[-1], rtol=1e-7, atol=1e-9)


def test_starts_are_left_as_they_were():
    problem, starts = random_problem(3, RobustLoss("cauchy", 6.0), seed=5)
    kept = starts.copy()
    levenberg_marquardt(evaluate(problem, starts), max_iterations=20, tolerance=1e-9)
    least_squares(evaluate(problem.take(np.array([0])), starts[:1]), max_iterations=20, tolerance=1e-9)
    np.testing.assert_array_equal(starts, kept)


@pytest.mark.parametrize("solve", [levenberg_marquardt, least_squares])
def test_fixed_parameters_stay(solve):
    problem, starts = random_problem(1, RobustLoss("cauchy", 6.0), seed=6)
    problem = replace(problem, layout=PINHOLE.fixed("roll", "focal length"))
    free = problem.free
    np.testing.assert_array_equal(np.flatnonzero(free), [0, 1, 4, 5, 6])
    solution = solve(evaluate(problem, starts), max_iterations=50, tolerance=1e-9)
    np.testing.assert_array_equal(solution.theta[:, ~free], starts[:, ~free])
    assert np.all(solution.theta[:, free] != starts[:, free])


@pytest.mark.parametrize("solve", [levenberg_marquardt, least_squares])
def test_iterations_that_are_used_up_are_said_so(solve):
    problem, starts = random_problem(1, RobustLoss("cauchy", 6.0), seed=8)
    solution = solve(evaluate(problem, starts), max_iterations=2, tolerance=1e-12)
    assert not solution.converged[0]
    assert solution.iterations[0] <= 2


@pytest.mark.parametrize("solve", [levenberg_marquardt, least_squares])
def test_a_strong_prior_wins_and_pan_has_no_seam(solve):
    problem, _ = random_problem(1, RobustLoss("cauchy", 6.0), seed=9)
    mean, sigma = gaussian_prior(MAIN_TRIBUNE, RADIAL).mean, np.full(RADIAL.size, 1e-6)
    mean[ANGLES] = (np.pi - 0.01, 1.3, 0.0)
    problem = Problem(problem.observations, PINHOLE, problem.loss, 1.0, GaussianPrior(mean[None], sigma[None]))
    start = mean[None] + 0.02 * np.eye(RADIAL.size)[0]  # beyond half a turn
    start[0, 0] -= 2.0 * np.pi
    solution = solve(evaluate(problem, start), max_iterations=100, tolerance=1e-12)
    assert np.cos(solution.theta[0, 0] - mean[0]) == pytest.approx(1.0, abs=1e-9)
    assert abs(solution.theta[0, 0] - start[0, 0]) < 0.1
    np.testing.assert_allclose(solution.theta[0, 1:7], mean[1:7], atol=1e-3)


def test_a_fit_that_would_collapse_stays_a_camera():
    """One line cannot hold the focal length: without a prior nothing keeps it from running away."""
    frame = {"Middle line": np.array([[480.0, 100.0], [485.0, 250.0], [520.0, 400.0]])}
    problem = Problem(pack(FIELD, [frame], SIZE), PINHOLE, RobustLoss("linear", 1.0))
    start = gaussian_prior(MAIN_TRIBUNE, RADIAL).mean[None]
    for solve in (levenberg_marquardt, least_squares):
        solution = solve(evaluate(problem, start), max_iterations=300, tolerance=1e-12)
        log_f = solution.theta[0, LOG_F] - np.log(SIZE[0])
        assert np.all(np.isfinite(solution.theta))
        assert LOG_F_RANGE[0] < log_f < LOG_F_RANGE[1]


def test_a_start_without_a_cost_is_given_back():
    problem, starts = random_problem(2, RobustLoss("cauchy", 6.0), seed=10)
    starts[0, LOG_F] = 30.0
    solution = levenberg_marquardt(evaluate(problem, starts), max_iterations=50, tolerance=1e-9)
    assert np.isinf(solution.cost[0])
    assert not solution.converged[0]
    np.testing.assert_array_equal(solution.theta[0], starts[0])
    assert solution.converged[1]
    one = least_squares(evaluate(problem.take(np.array([0])), starts[:1]), max_iterations=50, tolerance=1e-9)
    assert np.isinf(one.cost[0])
    assert not one.converged[0]
    np.testing.assert_array_equal(one.theta[0], starts[0])


# --- the bound that keeps a lens from folding ---


@pytest.mark.parametrize("solve", [least_squares, levenberg_marquardt])
@pytest.mark.parametrize("b2", [-0.01, 0.01])
def test_the_second_lens_coefficient_does_not_fall_below_what_folds(solve, b2):
    """Frames whose true lens folds end at the bound, at the least cost there; others at the truth."""
    truth = theta_from_camera(Camera.from_angles(-0.3, 1.35, 0.0, 900.0, (0.0, 68.0, -17.0), (960, 540)))
    truth[RADIAL.lens_block] = (0.03, b2)
    frame = observe(whole_circle_markings(soccer()), camera_from_theta(truth, (960, 540)), per_line=9, per_curve=20)
    observations = pack(soccer(), [frame], (960, 540))
    layout = RADIAL.fixed("principal point", "aspect")
    problem = Problem(observations, layout, RobustLoss("cauchy", 6.0))
    start = truth.copy()
    start[RADIAL.lens_block] = (0.02, 0.005)
    solution = solve(evaluate(problem, start[None]), max_iterations=100, tolerance=1e-12)
    if b2 > 0.0:
        np.testing.assert_allclose(solution.theta[0, RADIAL.lens_block], truth[RADIAL.lens_block], atol=1e-6)
        return
    assert 0.0 <= solution.theta[0, RADIAL.lens_block][1] < 1e-6
    held = replace(problem, layout=layout.fixed("k2"))
    held = levenberg_marquardt(evaluate(held, solution.theta), max_iterations=100, tolerance=1e-12)
    assert solution.cost[0] == pytest.approx(held.cost[0], rel=1e-6)


# --- parameters that frames share ---

TRIPOD = np.array([2.0, 66.0, -17.0])
CAUCHY = RobustLoss("cauchy", 6.0)


def of_one_tripod(count, noise, seed=0):
    """Frames of cameras at one place, each with its angles and zoom, and thetas a little off them."""
    rng, markings = np.random.default_rng(seed), whole_circle_markings(FIELD)
    cameras = [
        Camera.from_angles(pan, 1.36 + 0.01 * i, 0.002 * i, 900.0 + 150.0 * i, TRIPOD, SIZE)
        for i, pan in enumerate(np.linspace(-0.6, 0.6, count))
    ]
    frames = [observe(markings, camera, rng, noise) for camera in cameras]
    truth = np.array([theta_from_camera(camera) for camera in cameras])
    starts = truth.copy()
    starts[:, :4] += rng.normal(scale=0.01, size=(count, 4))
    starts[:, 4:7] += rng.normal(scale=0.5, size=3)
    return frames, truth, starts


def sharing(layout, *blocks):
    return layout.with_roles(Role.SHARED, *blocks)


def minimised(problem, theta, iterations=300, tolerance=1e-14):
    return levenberg_marquardt(evaluate(problem, theta), max_iterations=iterations, tolerance=tolerance)


def whole_system(problem, theta):
    """Cost of all frames, and its gradient and Gauss-Newton Hessian, dense, by the unknowns of all of them.

    What is shared stands once, at the end: the sum over the frames of selections of their own parts.
    """
    evaluation, free = evaluate(problem, theta), np.flatnonzero(problem.free)
    shared, T = problem.layout.shared, len(problem)
    own = int(np.sum(~shared))
    size = T * own + int(np.sum(shared))
    gradient, hessian = np.zeros(size), np.zeros((size, size))
    index = np.empty((T, len(free)), dtype=int)
    index[:, ~shared] = np.arange(T * own).reshape(T, own)
    index[:, shared] = np.arange(T * own, size)
    for t in range(T):
        gradient[index[t]] += evaluation.gradient[t]
        hessian[np.ix_(index[t], index[t])] += evaluation.hessian[t]
    return float(np.sum(evaluation.cost)), gradient, hessian, index


def test_groups_that_share_nothing_are_independent_problems():
    """The same steps, of each frame by itself, whether or not the frames are in one group."""
    frames, _, starts = of_one_tripod(5, noise=1.0)
    problem = Problem(pack(FIELD, frames, SIZE), PINHOLE, CAUCHY, 1.0, prior_for(5))
    alone = minimised(problem, starts)
    each = minimised(replace(problem, group=np.arange(5)), starts)
    np.testing.assert_array_equal(each.theta, alone.theta)
    np.testing.assert_array_equal(each.iterations, alone.iterations)
    # with one damping for all of them the path is another one, the minimum is not
    together = minimised(replace(problem, group=np.zeros(5, dtype=np.intp)), starts)
    assert together.converged.all()
    np.testing.assert_allclose(together.theta, alone.theta, rtol=1e-6, atol=1e-6)
    assert np.ptp(together.iterations) == 0


def test_a_group_of_one_frame_may_call_its_parameters_shared():
    frames, _, starts = of_one_tripod(3, noise=1.0)
    problem = Problem(pack(FIELD, frames, SIZE), PINHOLE, CAUCHY, 1.0, prior_for(3))
    alone = minimised(problem, starts)
    shared = minimised(replace(problem, layout=sharing(PINHOLE, "centre", "focal length")), starts)
    np.testing.assert_allclose(shared.theta, alone.theta, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(shared.iterations, alone.iterations, atol=1)  # rounding may call for one more


@pytest.mark.parametrize("blocks", [("centre",), ("centre", "focal length"), ("roll", "centre")])
@pytest.mark.parametrize("prior", [True, False], ids=["prior", "no prior"])
def test_steps_of_the_block_arrow_are_those_of_the_dense_system(blocks, prior):
    frames, _, starts = of_one_tripod(4, noise=1.0)
    starts[:, 3] = starts[0, 3]  # what is shared is the same in all frames
    starts[:, 2] = starts[0, 2]
    layout = sharing(PINHOLE, *blocks)
    problem = Problem(pack(FIELD, frames, SIZE), layout, CAUCHY, 1.0, prior_for(4) if prior else None)
    problem = replace(problem, group=np.zeros(4, dtype=np.intp))
    _, gradient, hessian, index = whole_system(problem, starts)
    for damping in (1e-8, 1e-2, 10.0):
        # as the solver does, the diagonal of the sum of the frames' blocks is raised by a share of itself
        damped = hessian + damping * np.diag(np.diagonal(hessian))
        dense = np.linalg.solve(damped, -gradient)[index]
        evaluation = evaluate(problem, starts)
        held = np.zeros_like(evaluation.gradient, dtype=bool)
        args = evaluation.hessian, evaluation.gradient, np.full(4, damping), held, layout.shared, Groups.of(problem)
        np.testing.assert_allclose(block_arrow_steps(*args), dense, rtol=1e-6, atol=1e-9)


def test_shared_parameters_of_very_different_magnitudes_are_solved():
    """At cameras far off, as on the way from a wrong start, derivatives by some parameters are 1e40 times larger."""
    rng = np.random.default_rng(8)
    unit = 10.0 ** np.array([46, 46.7, 46.5, 3.6, 4.2, 7.1, 31.7, 3.9, 4.3, 6.6, 6.6, 29.6, 12.7, 46.4])
    scaled, hidden = 1e-4 * rng.normal(size=14), rng.normal(size=14)
    hessian, gradient = np.eye(15), np.zeros(15)  # of a parameter of the frame's own, too
    hessian[1:, 1:] = (np.outer(scaled, scaled) + np.eye(14)) * np.outer(unit, unit)
    gradient[1:] = -(hidden + scaled * (scaled @ hidden)) * unit
    groups, shared = Groups(np.zeros(1, dtype=np.intp)), np.arange(15) > 0
    held = np.zeros((1, 15), dtype=bool)
    step = block_arrow_steps(hessian[None], gradient[None], np.zeros(1), held, shared, groups)
    np.testing.assert_allclose(step[0, 1:] * unit, hidden, rtol=1e-6)


def test_a_shared_centre_is_that_of_the_dense_system():
    """Gauss-Newton on the dense normal equations of the whole system, from the same start, ends at the same cameras."""
    frames, _, starts = of_one_tripod(4, noise=1.0)
    layout = sharing(PINHOLE, "centre")
    problem = replace(
        Problem(pack(FIELD, frames, SIZE), layout, CAUCHY, 1.0, prior_for(4)), group=np.zeros(4, dtype=np.intp)
    )
    theta, free = starts.copy(), np.flatnonzero(problem.free)
    for _ in range(100):
        cost, gradient, hessian, index = whole_system(problem, theta)
        step = np.linalg.solve(hessian, -gradient)
        theta[:, free] += step[index]
    assert np.max(np.abs(step)) < 1e-8
    found = minimised(problem, starts)
    assert found.converged.all()
    np.testing.assert_allclose(found.theta, theta, rtol=1e-6, atol=1e-6)
    assert np.sum(found.cost) == pytest.approx(cost, rel=1e-9)
    assert np.ptp(found.theta[:, 4:7], axis=0).max() == 0.0
    alone = minimised(replace(problem, layout=PINHOLE), starts)
    assert np.sum(alone.cost) < np.sum(found.cost)  # each with its own centre they fit better


def test_a_shared_centre_is_that_of_scipy():
    from scipy.optimize import least_squares as scipys

    frames, _, starts = of_one_tripod(4, noise=1.0)
    layout, linear = sharing(PINHOLE, "centre"), RobustLoss("linear", 1.0)
    problem = Problem(pack(FIELD, frames, SIZE), layout, linear, 1.0, prior_for(4))
    problem = replace(problem, group=np.zeros(4, dtype=np.intp))
    *_, index = whole_system(problem, starts)
    free = np.flatnonzero(problem.free)

    def residuals(x):
        theta = starts.copy()
        theta[:, free] = x[index]
        weighted = np.sqrt(problem.observations.weight) * evaluate(problem, theta).r
        return np.concatenate([weighted.ravel(), problem.prior_residuals(theta).ravel()])

    x = np.zeros(index.max() + 1)
    x[index] = starts[:, free]
    theirs = scipys(residuals, x, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    ours = minimised(problem, starts)
    assert np.sum(ours.cost) == pytest.approx(theirs.cost, rel=1e-9)
    np.testing.assert_allclose(ours.theta[:, free], theirs.x[index], rtol=1e-5, atol=1e-5)


def test_groups_side_by_side_do_not_touch_each_other():
    frames, _, starts = of_one_tripod(6, noise=1.0)
    starts[4:, 4:7] += (1.0, 2.0, 0.0)  # shared within a group alone
    problem = Problem(pack(FIELD, frames, SIZE), sharing(PINHOLE, "centre"), CAUCHY, 1.0, prior_for(6))
    together = minimised(replace(problem, group=np.array([0, 0, 0, 1, 2, 2])), starts)
    for members in (np.arange(3), np.array([3]), np.array([4, 5])):
        part = replace(problem.take(members), group=np.zeros(len(members), dtype=np.intp))
        alone = minimised(part, starts[members])
        np.testing.assert_allclose(together.theta[members], alone.theta, rtol=1e-8, atol=1e-8)
        assert np.ptp(together.theta[members, 4:7], axis=0).max() == 0.0


def test_pixels_without_noise_give_back_a_shared_centre():
    frames, truth, starts = of_one_tripod(5, noise=0.0)
    problem = Problem(pack(FIELD, frames, SIZE), sharing(PINHOLE, "centre"), CAUCHY, 1.0)
    found = minimised(replace(problem, group=np.zeros(5, dtype=np.intp)), starts)
    np.testing.assert_allclose(found.theta, truth, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("size", [(101.0, 66.0), (110.0, 72.5)])
def test_pixels_without_noise_give_back_a_shared_field_size(size):
    """Cameras and pitch together, from 105 x 68 m; both are known in scale by what has one size on every pitch."""
    model = soccer().size_model
    given = SizeBlock(np.array([105.0, 68.0]), model.sigma, model.limits)
    layout = Layout.of(SIZE, field_size=given).fixed("lens", "principal point", "aspect")
    layout = sharing(layout, "field size")
    pitch = soccer(*size)
    cameras = [Camera.from_angles(pan, 1.35, 0.01, 900.0, (2.0, 68.0, -17.0), SIZE) for pan in (-0.6, -0.2, 0.2, 0.6)]
    frames = [observe(whole_circle_markings(pitch), camera) for camera in cameras]
    truth = np.array([layout.theta(camera) for camera in cameras])
    problem = Problem(pack(FIELD, frames, SIZE, motion=FIELD.motion), layout, RobustLoss("linear", 1.0))
    found = minimised(replace(problem, group=np.zeros(4, dtype=np.intp)), truth)
    assert found.converged.all()
    np.testing.assert_allclose(found.theta[:, layout.field_size_block], np.tile(size, (4, 1)), atol=1e-6)
    np.testing.assert_allclose(found.theta[:, :12], truth[:, :12], rtol=1e-6, atol=1e-6)
    np.testing.assert_array_less(found.cost, 1e-12)


def test_a_shared_size_stays_within_its_limits():
    model = soccer().size_model
    given = SizeBlock(np.array([105.0, 68.0]), model.sigma, model.limits)
    layout = sharing(Layout.of(SIZE, field_size=given).fixed("lens", "principal point", "aspect"), "field size")
    cameras = [Camera.from_angles(pan, 1.35, 0.01, 900.0, (2.0, 68.0, -17.0), SIZE) for pan in (-0.6, -0.2, 0.2, 0.6)]
    frames = [observe(whole_circle_markings(soccer(86.0, 60.0)), camera) for camera in cameras]
    theta = np.array([layout.theta(camera) for camera in cameras])
    problem = Problem(pack(FIELD, frames, SIZE, motion=FIELD.motion), layout, RobustLoss("linear", 1.0))
    problem = replace(problem, group=np.zeros(4, dtype=np.intp))
    found = minimised(problem, theta)
    assert np.all(found.theta[:, -2] == 90.0)
    # at the least cost there: as if the length had been known to be 90 m
    held = layout.with_roles(Role.FIXED, "field size")
    held = replace(held, roles=np.where(np.arange(held.size) == held.size - 1, Role.SHARED, held.roles))
    there = theta.copy()
    there[:, -2] = 90.0
    known = minimised(replace(problem, layout=held), there)
    assert np.sum(found.cost) == pytest.approx(np.sum(known.cost), rel=1e-6)
