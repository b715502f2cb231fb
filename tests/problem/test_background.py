"""Static points that tie frames of one tripod to each other."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numdiff import central_differences, column_errors
from strategies import bounded, examples, vectors
from synthetic import observe

from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.frame_ties import BackgroundPairs, BackgroundTerm
from fieldcalib.problem.layout import LOG_F, Layout, Role, ZoomLaw
from fieldcalib.problem.levenberg_marquardt import Groups, block_arrow_steps, levenberg_marquardt
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack

FIELD, SIZE = soccer(), (960, 540)
LOSS = RobustLoss("cauchy", 3.0)
LAYOUT = Layout.of(SIZE, zoom_law=ZoomLaw(np.log(1500.0))).with_roles(
    Role.SHARED, "centre", "principal point", "k1", "zoom law"
)
LAYOUT = LAYOUT.fixed("k2", "aspect")
WALLS = np.array([62.5, 44.0])


def tripod(rng, count, offset=0.4):
    """Cameras (T, n) that turn and zoom on one tripod, with a lens and a zoom law."""
    theta = np.zeros((count, LAYOUT.size))
    theta[:, 0] = np.cumsum(rng.uniform(0.02, 0.06, count)) - 0.2
    theta[:, 1:3] = (1.36, 0.01) + rng.normal(scale=(0.01, 0.003), size=(count, 2))
    theta[:, LOG_F] = np.log(1500.0) + np.cumsum(rng.normal(scale=0.03, size=count))
    theta[:, 4:7], theta[:, 7:9] = (1.0, 65.0, -17.0), (485.0, 268.0)
    theta[:, LAYOUT.lens_block.start] = 0.03
    theta[:, LAYOUT.zoom_law_block] = 4.0, -3.0, 0.01, 0.02, offset
    return theta


def seen_by_both(theta, first, second, rng, p=None, walls=WALLS, noise=0.0):
    """Pixels of the background where frames that are `first` and `second` see it: at p (K, N, 2), or anywhere."""
    if p is None:
        p = rng.uniform((60.0, 40.0), (900.0, 500.0), size=(len(first), 20, 2))
    pairs = BackgroundPairs(first, second, p, p, np.ones(p.shape[:2]), LOSS, walls)
    r = BackgroundTerm(pairs, LAYOUT, theta).r
    q = p - np.moveaxis(r, 0, -1)
    inside = np.all((q > 0.0) & (q < SIZE), axis=-1)
    return replace(pairs, q=q + rng.normal(scale=noise or 1e-300, size=q.shape), weight=1.0 * inside)


def neighbours(count, *apart):
    first = np.concatenate([np.arange(count - d) for d in apart])
    return first, np.concatenate([np.arange(d, count) for d in apart])


@examples(15)
@given(
    p=vectors((60.0, 40.0), (900.0, 500.0), count=6),
    way=bounded(3, -3.0, 3.0),
    turn=bounded(4, -1.0, 1.0),
    walls=st.sampled_from([None, WALLS]),
)
def test_derivatives_are_those_of_the_residuals(p, way, turn, walls):
    rng = np.random.default_rng(0)
    theta = tripod(rng, 2)
    theta[1, 4:7] += way
    theta[1, :4] += turn * (0.03, 0.01, 0.003, 0.03)
    pairs = seen_by_both(theta, np.array([0]), np.array([1]), rng, p[None], walls)
    by_first, by_second = BackgroundTerm(pairs, LAYOUT, theta).jacobians(LAYOUT.free)
    free = np.flatnonzero(LAYOUT.free)

    def residuals(change, frame):
        moved = np.repeat(theta[None], len(change), axis=0)
        moved[:, frame, free] += change
        return np.array([np.concatenate(BackgroundTerm(pairs, LAYOUT, one).r[:, 0]) for one in moved])

    for frame, by in ((0, by_first), (1, by_second)):
        numeric, half = (
            central_differences(lambda x, f=frame: residuals(x, f), np.zeros((1, len(free))), step)[0]
            for step in (1e-5, 5e-6)
        )
        # the depth of a ray has a kink where wall and ground meet: differences across it depend on their step
        assume(np.max(column_errors(half, numeric, floor=1.0)) < 2e-6)
        assert np.max(column_errors(by[0].T, numeric, floor=1.0)) < 1e-5


def test_a_point_of_the_ground_is_seen_where_it_is():
    """With the pupil ahead of the axes, only the right depth maps a mark of the pitch to itself."""
    theta = tripod(np.random.default_rng(1), 2, offset=0.8)
    one, two = (LAYOUT.camera(t) for t in theta)
    marks = np.array([[0.0, 0.0, 0.0], [5.0, -20.0, 0.0], [-8.0, 9.15, 0.0]])
    for walls, largest in ((WALLS, 1e-6), (None, np.inf)):
        pairs = BackgroundPairs(
            np.array([0]),
            np.array([1]),
            one.project(marks)[None],
            two.project(marks)[None],
            np.ones((1, 3)),
            LOSS,
            walls,
        )
        error = np.linalg.norm(BackgroundTerm(pairs, LAYOUT, theta).r, axis=0)
        assert np.max(error) < largest
    assert np.min(error) > 0.02  # at infinity


def whole_system(evaluation):
    """Gradient and Hessian by the unknowns of all frames, the shared ones once, at the end."""
    shared, T = LAYOUT.shared, len(evaluation.theta)
    own = int(np.sum(~shared))
    size = T * own + int(np.sum(shared))
    index = np.empty((T, len(shared)), dtype=int)
    index[:, ~shared], index[:, shared] = np.arange(T * own).reshape(T, own), np.arange(T * own, size)
    gradient, hessian = np.zeros(size), np.zeros((size, size))
    for t in range(T):
        gradient[index[t]] += evaluation.gradient[t]
        hessian[np.ix_(index[t], index[t])] += evaluation.hessian[t]
    for i, j, block in zip(*evaluation.coupling, strict=True):
        rows, columns = index[i][~shared], index[j][~shared]
        hessian[np.ix_(rows, columns)] += block
        hessian[np.ix_(columns, rows)] += block.T
    return gradient, hessian, index


def a_problem(seed, count=5, noise=0.0, labelled=(0, 4)):
    rng = np.random.default_rng(seed)
    truth = tripod(rng, count)
    frames = [observe(FIELD, LAYOUT.camera(t)) if k in labelled else {} for k, t in enumerate(truth)]
    pairs = seen_by_both(truth, *neighbours(count, 1, 2), rng, noise=noise)
    observations = pack(FIELD, frames, SIZE)
    problem = Problem(observations, LAYOUT, LOSS, group=np.zeros(count, dtype=np.intp), background=pairs)
    return problem, truth, rng


def test_the_normal_equations_are_those_of_all_residuals():
    problem, truth, rng = a_problem(3)
    start = truth.copy()
    start[:, :4] += rng.normal(scale=1e-3, size=(5, 4))
    evaluation = evaluate(replace(problem, background=replace(problem.background, walls=None)), start)
    gradient, hessian, index = whole_system(evaluation)
    free = np.flatnonzero(LAYOUT.free)

    def cost(x):
        costs = []
        for change in x:
            theta = start.copy()
            theta[:, free] += change[index]
            costs.append(np.sum(evaluate(evaluation.problem, theta).cost))
        return np.array(costs)[:, None]

    numeric = central_differences(cost, np.zeros((1, len(gradient))), 1e-5)[0, 0]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-4, atol=1e-3 * np.max(np.abs(gradient)))
    # and the steps of the solver are those of the dense system
    damped = hessian + 1e-3 * np.diag(np.diagonal(hessian)) + 1e-15 * np.eye(len(hessian))
    dense = np.linalg.solve(damped, -gradient)[index]
    held = np.zeros_like(evaluation.gradient, dtype=bool)
    step = block_arrow_steps(
        evaluation.hessian,
        evaluation.gradient,
        np.full(5, 1e-3),
        held,
        LAYOUT.shared,
        Groups.of(problem),
        evaluation.coupling,
    )
    np.testing.assert_allclose(step, dense, rtol=1e-5, atol=1e-9)


def test_frames_without_labels_follow_from_those_that_have_some():
    problem, truth, rng = a_problem(4)
    start = truth.copy()
    start[:, :4] += rng.normal(scale=3e-3, size=(5, 4))
    start[:, 4:7] += (0.5, -0.4, 0.2)
    found = levenberg_marquardt(evaluate(problem, start), max_iterations=200, tolerance=1e-12)
    assert found.converged.all()
    marks = [LAYOUT.camera(t).project(np.array([[0.0, 0.0, 0.0], [10.0, 5.0, 0.0]])) for t in truth]
    again = [LAYOUT.camera(t).project(np.array([[0.0, 0.0, 0.0], [10.0, 5.0, 0.0]])) for t in found.theta]
    np.testing.assert_allclose(again, marks, atol=1e-3)


def test_frames_tied_to_known_cameras_are_solved_each_by_itself():
    problem, truth, rng = a_problem(5, labelled=())
    keys = truth[problem.background.first]
    layout = Layout.of(SIZE, zoom_law=LAYOUT.zoom_law).fixed("centre", "principal point", "lens", "aspect", "zoom law")
    known = replace(problem, layout=layout, group=None, background=replace(problem.background, known=keys))
    start = truth.copy()
    start[1:, :4] += rng.normal(scale=5e-3, size=(4, 4))
    found = levenberg_marquardt(evaluate(known, start), max_iterations=100, tolerance=1e-14)
    np.testing.assert_allclose(found.theta[1:], truth[1:], atol=1e-7)
    some = np.array([3, 1])
    part = levenberg_marquardt(evaluate(known.take(some), start[some]), max_iterations=100, tolerance=1e-14)
    np.testing.assert_allclose(part.theta, truth[some], atol=1e-7)
    with pytest.raises(ValueError, match="cannot be taken apart"):
        problem.take(some)
