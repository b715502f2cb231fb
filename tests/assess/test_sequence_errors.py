"""What frames leave open of their own parameters: against the covariance of the whole system, and against truth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numdiff import central_differences
from strategies import bounded, examples, moved
from synthetic import observe
from tripods import SIZE, chain, matched, operated, panned

from fieldcalib.assess.estimate import motion_in_view
from fieldcalib.assess.ground import Considered
from fieldcalib.assess.label_errors import FOUND_BESIDE, Noise
from fieldcalib.assess.sequence_errors import GRID, OwnErrors, ground_errors, own_errors, whole_covariance
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.frame_ties import BackgroundPairs, BackgroundTerm
from fieldcalib.problem.layout import CENTER, LOG_F, GaussianPrior, Layout, Role, SizeBlock, ZoomLaw
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.problem.projection import Projection
from fieldcalib.solve.sequence.sequence_solver import calibrate_sequence

FIELD = soccer()
LOSS = RobustLoss("cauchy", 3.0)
LAYOUT = Layout.of(SIZE, zoom_law=ZoomLaw(np.log(1400.0))).with_roles(
    Role.CONSIDERED, "centre", "principal point", "k1", "zoom law"
)
LAYOUT = LAYOUT.fixed("k2", "aspect")
OWN, SHARED = np.flatnonzero(LAYOUT.free), np.flatnonzero(LAYOUT.considered)
STEPS = {"cx": 1e-2, "cy": 1e-2, "cx slope": 1e-2, "cy slope": 1e-2, "x": 1e-3, "y": 1e-3, "z": 1e-3}
SIGMA, KAPPA = 0.8, 0.9


def some_pairs(theta, first, second, rng, noise=0.0):
    """Pixels of points at infinity in both frames, of random weights."""
    p = rng.uniform((60.0, 40.0), (900.0, 500.0), (len(first), 15, 2))
    pairs = BackgroundPairs(first, second, p, p, rng.uniform(0.5, 3.0, p.shape[:2]), LOSS)
    r = BackgroundTerm(pairs, LAYOUT, theta).r
    q = p - np.moveaxis(r, 0, -1) + rng.normal(size=p.shape) * noise
    return replace(pairs, q=q)


def a_problem(seed, count=4, labelled=(0, 1, 3), prior=True, pairs=((0, 1), (1, 2), (0, 2), (3, 2))):
    rng = np.random.default_rng(seed)
    theta = operated(rng, count, LAYOUT, 0.0)
    frames = [observe(FIELD, LAYOUT.camera(t), rng, 0.5) if k in labelled else {} for k, t in enumerate(theta)]
    mean = theta + rng.normal(scale=1e-3, size=theta.shape)
    prior = GaussianPrior(mean, np.full(theta.shape, 0.05)) if prior else None
    background = some_pairs(theta, *np.array(pairs).T, rng) if pairs else None
    return Problem(pack(FIELD, frames, SIZE), LAYOUT, LOSS, 1.2, prior, background=background), theta


def steps(index, layout=LAYOUT):
    return np.array([STEPS.get(layout.names[k], 1e-5) for k in index])


def changed(theta, frame, index, change):
    """Parameters of which some are changed by (..., k): of one frame, or of all of them at once."""
    moved = theta.copy()
    moved[np.ix_(range(len(theta)) if frame is None else [frame], index)] += change
    return moved


def by_hand(problem, theta):
    """E of all frames at once, F, and errors by misplaced lines, from residuals and their numerical derivatives."""
    T, o = len(theta), len(OWN)

    def residuals(of):
        """(M, T o + S), from a function of the parameters."""
        columns = [
            central_differences(lambda x, t=t, i=index: of(changed(theta, t, i, x)), np.zeros(len(index)), steps(index))
            for t, index in [*[(t, OWN) for t in range(T)], (None, SHARED)]
        ]
        return np.concatenate(columns, axis=1)

    evaluation = evaluate(problem, theta)
    hessian, between = np.zeros((T * o, T * o)), np.zeros((T * o, T * o))
    border, painted = np.zeros((T * o, len(SHARED))), 0.0
    centre = np.isin(np.arange(LAYOUT.size), np.r_[CENTER])
    by_metre = np.linalg.norm(evaluation.derivatives(centre)[:, :2], axis=1)
    J = residuals(lambda x: evaluate(problem, x).r.ravel()).reshape(T, -1, T * o + len(SHARED))
    noise = Noise(evaluation)
    for t in range(T):
        own, shared, irls_weight = J[t, :, : T * o], J[t, :, T * o :], evaluation.irls_weight[t]
        scale = SIGMA * irls_weight * noise.relative_sigma[t]
        correlation = np.diag(1.0 - noise.shared[t]) + 0.15 * noise.segment[t] @ noise.segment[t].T
        hessian += KAPPA * own.T @ np.diag(irls_weight) @ own
        border += KAPPA * own.T @ np.diag(irls_weight) @ shared
        between += own.T @ np.diag(scale) @ correlation @ np.diag(scale) @ own
        if problem.paint:  # of the same lines in every frame
            off = np.hypot(problem.paint * by_metre[t], FOUND_BESIDE * SIZE[0])
            painted = painted + own.T @ np.diag(irls_weight * off) @ noise.segment[t]
    if problem.prior is not None:
        precision = np.diag(1.0 / np.square(evaluation.prior.effective_sigma.ravel()))
        hessian, between = hessian + precision, between + precision
    if problem.background is not None:
        of_pairs = residuals(lambda x: BackgroundTerm(problem.background, LAYOUT, x).r.ravel())
        weight = np.tile(problem.background.weight.ravel(), 2)
        own, shared = of_pairs[:, : T * o], of_pairs[:, T * o :]
        information = own.T @ (weight[:, None] * own)
        hessian, between = hessian + information, between + information
        border += own.T @ (weight[:, None] * shared)
    if problem.paint:
        between = between + painted @ painted.T
    inverse = np.linalg.inv(hessian)
    return inverse @ between @ inverse, inverse @ border, inverse @ painted if problem.paint else None


@pytest.mark.parametrize("prior", [True, False], ids=["prior", "no prior"])
@pytest.mark.parametrize("paint", [0.03, pytest.param(0.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("pairs", [None, ((0, 1), (1, 2), (0, 2), (3, 2))], ids=["alone", "tied"])
def test_own_errors_are_those_of_the_whole_system(pairs, paint, prior):
    labelled = range(4) if pairs is None else (0, 1, 3)
    problem, theta = a_problem(0, labelled=labelled, prior=prior, pairs=pairs)
    problem = replace(problem, paint=paint)
    found = own_errors(evaluate(problem, theta), SIGMA, KAPPA)
    E, F, _ = by_hand(problem, theta)
    scale = np.sqrt(np.diagonal(E)).reshape(4, 4)
    for t in range(4):
        block = slice(4 * t, 4 * t + 4)
        of_both = scale[t][:, None] * scale[t]
        np.testing.assert_allclose(found.own[t] / of_both, E[block, block] / of_both, atol=1e-4)
        largest = np.abs(F[block]).max(axis=0)
        np.testing.assert_allclose(found.following[t] / largest, F[block] / largest, atol=1e-3)


@pytest.mark.parametrize("pairs", [None, ((0, 1), (1, 2), (0, 2), (3, 2))], ids=["alone", "tied"])
def test_misplaced_lines_move_own_and_shared_parameters_together(pairs):
    problem, theta = a_problem(0, labelled=range(4), pairs=pairs)
    evaluation = evaluate(replace(problem, paint=0.03), theta)
    E, F, A = by_hand(evaluation.problem, theta)
    rng, size = np.random.default_rng(0), len(SHARED)
    unit = np.sqrt(np.diagonal(E).mean()) / np.abs(F).mean(axis=0)  # shared parameters of similar effect
    S = unit[:, None] * rng.standard_normal((size, A.shape[1]))
    V = S @ S.T + np.diag(np.square(unit))
    labels = [evaluation.problem.observations.labels[k] for k in Noise(evaluation).lines]
    shared = Considered(LAYOUT, V, dict(zip(labels, S.T, strict=True)))
    found, together = own_errors(evaluation, SIGMA, KAPPA, shared=shared), E + F @ V @ F.T
    together = together - A @ S.T @ F.T - F @ S @ A.T
    scale = np.sqrt(np.diagonal(together))
    for t in range(4):
        block = slice(4 * t, 4 * t + 4)
        own = found.own[t] + found.following[t] @ V @ found.following[t].T
        np.testing.assert_allclose(
            own / np.outer(scale[block], scale[block]),
            together[block, block] / np.outer(scale[block], scale[block]),
            atol=1e-3,
        )
        with_shared = (F[block] @ V - A[block] @ S.T) / np.outer(scale[block], np.sqrt(np.diagonal(V)))
        np.testing.assert_allclose(
            found.following[t] @ V / np.outer(scale[block], np.sqrt(np.diagonal(V))), with_shared, atol=1e-3
        )


def test_paint_makes_less_certain():
    problem, theta = a_problem(1)
    exact, painted = (own_errors(evaluate(replace(problem, paint=p), theta), SIGMA, KAPPA) for p in (0.0, 0.05))
    assert np.all(np.linalg.eigvalsh(painted.own - exact.own)[:, -1] > 0.0)
    assert np.all(np.diagonal(painted.own, axis1=1, axis2=2) >= np.diagonal(exact.own, axis1=1, axis2=2) - 1e-15)
    np.testing.assert_array_equal(painted.following, exact.following)


def test_a_line_is_painted_elsewhere_and_found_beside_its_paint():
    problem, theta = a_problem(5, labelled=range(4), prior=False, pairs=None)
    evaluation = evaluate(replace(problem, paint=0.03), theta)
    centre = np.zeros(LAYOUT.size, dtype=bool)
    centre[CENTER] = True
    by_metre = np.linalg.norm(evaluation.derivatives(centre)[:, :2], axis=1)  # px
    alone = np.ones((4, 1, by_metre.shape[1]))
    expected = (alone * np.hypot(0.03 * by_metre, 0.1)[:, None]) @ Noise(evaluation).segment
    np.testing.assert_allclose(Noise(evaluation).by_line(alone, np.ones_like(by_metre)), expected)


def test_ties_make_more_certain():
    problem, theta = a_problem(2, labelled=range(4))
    tied, alone = (
        own_errors(evaluate(replace(problem, background=b), theta), SIGMA, KAPPA) for b in (problem.background, None)
    )
    assert np.all(np.linalg.det(tied.own) < 0.5 * np.linalg.det(alone.own))


def test_followers_have_the_errors_of_those_that_they_follow():
    problem, theta = a_problem(3, labelled=(0, 1))
    rng = np.random.default_rng(0)
    firsts, followers = theta[:2], theta[2:]
    root = rng.normal(size=(2, 4, 4)) * 1e-3
    E, F = root @ np.swapaxes(root, 1, 2), rng.normal(size=(2, 4, len(SHARED))) * 1e-3
    first, second = np.array([0, 1, 1]), np.array([0, 0, 1])
    pairs = some_pairs(theta, first, second + 2, rng)
    problem = Problem(
        pack(FIELD, [{}, {}], SIZE), LAYOUT, LOSS, background=replace(pairs, second=second, known=firsts[first])
    )
    found = own_errors(evaluate(problem, followers), SIGMA, KAPPA, OwnErrors(E[first], F[first]))
    for t, of in enumerate(([0, 1], [2])):
        H, between, border = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((4, len(SHARED)))
        for k in of:
            one = replace(pairs, first=np.array([0]), second=np.array([1]), p=pairs.p[[k]], q=pairs.q[[k]])
            one = replace(one, weight=pairs.weight[[k]])
            both = np.stack([firsts[first[k]], followers[t]])

            def r(frame, index, one=one, both=both):
                return central_differences(
                    lambda x: BackgroundTerm(one, LAYOUT, changed(both, frame, index, x)).r.ravel(),
                    np.zeros(len(index)),
                    steps(index),
                )

            W = np.diag(np.tile(one.weight.ravel(), 2))
            of_first, of_second = r(0, OWN), r(1, OWN)
            C = of_second.T @ W @ of_first
            H += of_second.T @ W @ of_second
            between += of_second.T @ W @ of_second + C @ E[first[k]] @ C.T
            border += of_second.T @ W @ r(None, SHARED) - C @ F[first[k]]
        inverse = np.linalg.inv(H)
        expected = inverse @ between @ inverse
        np.testing.assert_allclose(found.own[t], expected, rtol=1e-3, atol=1e-4 * np.max(expected))
        following = inverse @ border
        largest = np.abs(following).max(axis=0)
        np.testing.assert_allclose(found.following[t] / largest, following / largest, atol=1e-3)


def test_followed_or_solved_together_is_the_same_where_a_match_tells_nothing_of_the_first():
    """Of two frames of one view that is so: whatever the first one is, the second one is it too."""
    problem, theta = a_problem(4, count=2, labelled=(0,), prior=False, pairs=())
    theta[1] = theta[0]
    pairs = some_pairs(theta, np.array([0]), np.array([1]), np.random.default_rng(0))
    together = own_errors(evaluate(replace(problem, background=pairs), theta), SIGMA, KAPPA)
    hub = own_errors(evaluate(problem.take(np.array([0])), theta[:1]), SIGMA, KAPPA)
    follower = Problem(
        pack(FIELD, [{}], SIZE), LAYOUT, LOSS, background=replace(pairs, second=np.array([0]), known=theta[:1])
    )
    apart = own_errors(evaluate(follower, theta[1:]), SIGMA, KAPPA, hub)
    for one, two in zip(together, (np.concatenate(both) for both in zip(hub, apart, strict=True)), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-6, atol=1e-8 * np.abs(two).max())


# of all parameters


def whole_by_hand(E, F, V, layout):
    """Covariance (n, n) of theta, whose free parameters are e - F s and whose considered ones are s."""
    by_e, by_s = np.eye(layout.size)[:, layout.free], np.eye(layout.size)[:, layout.considered]
    A = np.concatenate([by_e, by_s - by_e @ F], axis=1)
    o = len(E)
    both = np.zeros(2 * (o + len(V),))
    both[:o, :o], both[o:, o:] = E, V
    return A @ both @ A.T


@st.composite
def errors_of(draw, layout, frames):
    """E (T, o, o), F (T, o, S) and V (S, S), about 1."""
    o, S = int(layout.free.sum()), int(layout.considered.sum())
    root, root_V = draw(moved(np.tile(np.eye(o), (frames, 1, 1)), 1.0)), draw(moved(np.eye(S), 1.0))
    return root @ np.swapaxes(root, 1, 2), draw(bounded((frames, o, S), -2.0, 2.0)), root_V @ root_V.T


@given(errors_of(LAYOUT, 1))
def test_the_whole_covariance_is_that_of_own_errors_and_shared_ones(errors):
    (E,), (F,), V = errors
    found = whole_covariance(E, F, Considered(LAYOUT, V))
    np.testing.assert_allclose(found, whole_by_hand(E, F, V, LAYOUT), atol=1e-10)
    assert not found[[9, LAYOUT.lens_block.stop - 1]].any()  # what is fixed


# of the field in view

SIZE_BLOCK = SizeBlock(np.array([105.0, 68.0]), np.array([3.0, 3.0]), np.array([[90.0, 45.0], [120.0, 90.0]]))
WITH_SIZE = Layout.of(SIZE, field_size=SIZE_BLOCK, zoom_law=LAYOUT.zoom_law).with_roles(
    Role.CONSIDERED, "centre", "principal point", "lens", "zoom law", "field size"
)
PLAIN = Layout.of(SIZE).fixed("aspect", "k2")  # nothing is shared, the centre is the frame's own
FIXED = Layout.of(SIZE).fixed("aspect", "lens", "centre", "principal point")


def rms_by_hand(theta, layout, covariance, field, xy):
    """Errors (N,) of the ground points of the pixels that see the field, relative to the markings in view."""
    half = np.full(2, np.inf) if field is None else (52.5, 34.0)
    X = layout.camera(theta).image_to_field(xy)
    xy = xy[np.isfinite(X).all(axis=1) & np.all(np.abs(X[:, :2]) <= half, axis=1)]
    with_size = layout.field_size is not None and field is not None
    (markings,) = motion_in_view(Projection(theta[None], layout), field) if with_size else (np.zeros((2, 0)),)
    size = slice(layout.size - markings.shape[1], layout.size)

    def places(moved):
        return layout.camera(moved).image_to_field(xy)[:, :2] - markings @ (moved - theta)[size]

    J = central_differences(places, theta, steps(range(layout.size), layout))
    return np.sqrt(np.einsum("nij,jk,nik->n", J, covariance, J))


@examples(10)
@given(
    data=st.data(),
    layout=st.sampled_from([LAYOUT, WITH_SIZE, PLAIN, FIXED]),
    on_field=st.booleans(),
    turn=bounded((3, 4), -1.0, 1.0),
)
def test_ground_errors_are_the_median_over_the_picture(data, layout, on_field, turn):
    field = FIELD if on_field else None
    with_law = layout if layout.zoom_law is not None else WITH_SIZE
    theta = operated(np.random.default_rng(0), 3, with_law)[:, : layout.size]
    theta[:, :4] += (0.0, 0.1, 0.0, 0.0) + turn * (0.2, 0.2, 0.01, 0.1)  # up to the sky
    E, F, V = data.draw(errors_of(layout, 3))
    E, F, V = 1e-6 * E, 1e-2 * F, 1e-4 * V
    found = ground_errors(theta, OwnErrors(E, F), Considered(layout, V), field)
    grid = np.meshgrid(np.linspace(0.0, 959.0, GRID[0]), np.linspace(0.0, 539.0, GRID[1]))
    xy = np.stack(grid, axis=-1).reshape(-1, 2)
    for t in range(3):
        rms = np.sort(rms_by_hand(theta[t], layout, whole_by_hand(E[t], F[t], V, layout), field, xy))
        expected = rms[(len(rms) - 1) // 2] if len(rms) else np.nan
        np.testing.assert_allclose(found[t], expected, rtol=1e-4, atol=1e-12)


def test_who_looks_at_the_sky_sees_no_field():
    theta = operated(np.random.default_rng(0), 2, LAYOUT)
    theta[1, 1] = 2.2
    errors = OwnErrors(np.tile(1e-6 * np.eye(4), (2, 1, 1)), np.zeros((2, 4, len(SHARED))))
    exact = Considered(LAYOUT, np.zeros(2 * (len(SHARED),)))
    found = ground_errors(theta, errors, exact, FIELD)
    assert np.isfinite(found).tolist() == [True, False]
    none = OwnErrors(*(part[:0] for part in errors))
    assert len(ground_errors(theta[:0], none, exact, FIELD)) == 0


# against truth


@pytest.mark.slow
def test_intervals_hold_the_truth():
    """Cells of matches count for less than their noise is, since real ones err alike: intervals are rather too wide."""
    focal, place, tied = [], [], []
    for seed in range(28):
        rng = np.random.default_rng(seed)
        centre = (rng.normal(0.0, 3.0), rng.uniform(60.0, 70.0), rng.uniform(-20.0, -13.0))
        cameras = panned(5, -0.3, 0.3, centre)
        frames = [observe(FIELD, camera, rng, 1.0) if t % 2 == 0 else {} for t, camera in enumerate(cameras)]
        matches = matched(cameras, chain(5, 1, 2), rng, noise=0.5)
        found = calibrate_sequence(soccer(size_known=True), frames, SIZE, matches=matches, paint=0.0, trust_labels=True)
        for t, (frame, truth) in enumerate(zip(found, cameras, strict=True)):
            error = np.log(frame.camera.focal_length / truth.focal_length)
            (tied if t % 2 else focal).append(abs(error) / np.sqrt(frame.covariance[LOG_F, LOG_F]))
        place.extend(np.abs(found.values[:3] - centre) / np.sqrt(np.diagonal(found.covariance)[:3]))
    for off in (focal, tied, place):
        assert 0.88 <= np.mean(np.array(off) < 1.96) <= 1.0
        assert np.sqrt(np.mean(np.square(off))) > 0.35  # and not much too wide
