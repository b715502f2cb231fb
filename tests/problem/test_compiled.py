"""What Numba compiles against NumPy's way: the same closest points, derivatives, solutions and calibrations."""

import os
import subprocess
import sys

import numba  # noqa: F401 (skipped where it is not installed)
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import cameras, examples, generators
from synthetic import observe, random_frames

from fieldcalib.fields.ground import Ground
from fieldcalib.fields.segments import PointCloud
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.lens import BrownConradyLens, Pinhole, RadialLens
from fieldcalib.problem import compilation
from fieldcalib.problem.evaluation import Problem, evaluate, with_segment_ends
from fieldcalib.problem.layout import CENTER, Bounds, GaussianPrior, Layout, Role, SizeBlock, ZoomLaw
from fieldcalib.problem.levenberg_marquardt import compiled_cost, levenberg_marquardt
from fieldcalib.problem.losses import LossName, RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.from_segments import calibrate_from_segments

FIELD = soccer()
SIZE = (960, 540)
RHO = float(np.hypot(*SIZE) / 2.0)
GROUNDS = st.sampled_from([None, Ground(crown=0.4), Ground(crown=0.2, fall=0.3)])
SPREAD = np.array(
    [0.01, 0.01, 0.01, 0.02, 1.0, 1.0, 1.0, 5.0, 5.0, 0.005, 0.02, 0.002]
)  # of cameras around the true one


@pytest.fixture
def by_numpy(monkeypatch):
    """Calls something as if Numba were not installed."""

    def call(function, *arguments, **options):
        with monkeypatch.context() as context:
            context.setattr(compilation, "compiled_module", lambda: None)
            return function(*arguments, **options)

    return call


def problem_of(camera, rng, lens=RadialLens, loss="cauchy", prior=True, ground=None):
    """A frame, some of its pixels past the ends of their segments, and cameras around the true one."""
    layout = Layout.of(SIZE, lens(RHO))
    true = Layout.of(SIZE).theta(camera)[: layout.size]
    theta = true + SPREAD[: layout.size] * rng.normal(size=(3, layout.size))
    if lens is RadialLens:
        theta[:, -1] = np.abs(theta[:, -1])
    frame = observe(FIELD, camera, rng, noise=2.0)
    assume(frame)
    problem = Problem(
        pack(FIELD.with_ground(ground), 3 * [frame], SIZE),
        layout,
        RobustLoss(loss, 6.0),
        prior=GaussianPrior(np.tile(true, (3, 1)), np.tile(5.0 * SPREAD[: layout.size], (3, 1))) if prior else None,
    )
    return with_segment_ends(evaluate(problem, theta), 50.0)


@examples(30)
@given(
    camera=cameras(lens=True, image_sizes=(SIZE,)),
    rng=generators(),
    lens=st.sampled_from([RadialLens, Pinhole]),
    ground=GROUNDS,
)
def test_closest_points_and_their_derivatives(camera, rng, lens, ground):
    start = problem_of(camera, rng, lens, ground=ground)
    compiled = evaluate(start.problem, start.theta)
    with pytest.MonkeyPatch.context() as context:
        context.setattr(compilation, "compiled_module", lambda: None)
        numpy = evaluate(start.problem, start.theta)
        JT, cost = numpy.JT, numpy.cost
    seen = start.problem.observations.label >= 0
    near = seen & (np.abs(numpy.r) < 200.0)  # far from a circle the closest of its points may be another one
    np.testing.assert_allclose(compiled.r[near], numpy.r[near], atol=1e-7)
    np.testing.assert_allclose(compiled.points.normal[:, near], numpy.points.normal[:, near], atol=1e-8)
    moved = SPREAD[: JT.shape[1], None] * near[:, None]  # px for a step of that size
    np.testing.assert_allclose(compiled.JT * moved, JT * moved, rtol=1e-7, atol=1e-7)
    if np.array_equal(near, seen):
        np.testing.assert_allclose(compiled.cost, cost, rtol=1e-9)


@pytest.mark.parametrize("a1", [-0.38, -0.2])
def test_closest_points_through_lenses_far_stronger_than_those_of_broadcasts(a1, by_numpy):
    frames, cameras = random_frames(6, seed=0)
    layout = Layout.of(SIZE)
    theta = np.array([layout.theta(camera) for camera in cameras])
    theta[:, layout.lens_block.start] = a1
    frames = [observe(FIELD, layout.camera(one)) for one in theta]
    problem = Problem(pack(FIELD, frames, SIZE), layout, RobustLoss("linear", 1.0))
    theta[:, :3] += 0.01  # radians: some 10 px
    compiled, numpy = evaluate(problem, theta), by_numpy(evaluate, problem, theta)
    seen = problem.observations.label >= 0
    assert np.median(np.abs(numpy.r[seen])) > 5.0
    np.testing.assert_allclose(compiled.r[seen], numpy.r[seen], atol=1e-7)


@examples(30)
@given(
    camera=cameras(lens=True, image_sizes=(SIZE,)),
    rng=generators(),
    lens=st.sampled_from([RadialLens, Pinhole]),
    loss=st.sampled_from(LossName.__args__),
    prior=st.booleans(),
    ground=GROUNDS,
)
def test_cost_gradient_and_hessian_term_by_term(camera, rng, lens, loss, prior, ground):
    start = problem_of(camera, rng, lens, loss, prior, ground)
    seen = start.problem.observations.label >= 0
    assume(np.all(np.abs(start.r[seen]) < 200.0))  # far from a circle the closest of its points may be another one
    module, theta = compilation.compiled_module(), start.theta.copy()
    terms = compiled_cost(module, start.problem, theta, start.problem.terrain(theta))
    with pytest.MonkeyPatch.context() as context:
        context.setattr(compilation, "compiled_module", lambda: None)
        numpy = evaluate(start.problem, start.theta)
        expected = numpy.cost, numpy.gradient, numpy.hessian
    P = numpy.gradient.shape[1]
    scale = SPREAD[np.flatnonzero(start.problem.free)]
    for b, (cost, gradient, hessian) in enumerate(zip(*expected, strict=True)):
        g, H = np.empty(P), np.empty((P, P))
        assert module.normal_equations(*terms, b, theta[b], np.empty(theta.shape[1]), g, H) == pytest.approx(cost, 1e-9)
        np.testing.assert_allclose(g * scale, gradient * scale, rtol=1e-6, atol=1e-7 * max(cost, 1.0))
        H, hessian = (one * np.outer(scale, scale) for one in (H, hessian))
        np.testing.assert_allclose(H, hessian, rtol=1e-6, atol=1e-7 * np.max(hessian))


@pytest.mark.parametrize("loss", LossName.__args__)
@pytest.mark.parametrize("prior", [True, False])
@pytest.mark.parametrize("lens", [RadialLens, Pinhole])
def test_levenberg_marquardt(loss, prior, lens, by_numpy):
    frames, true = random_frames(3, seed=3, noise=1.0, stands=("main center",))
    layout = Layout.of(SIZE, lens(RHO)).fixed("aspect")
    rng = np.random.default_rng(0)
    theta = np.array([Layout.of(SIZE).theta(camera)[: layout.size] for camera in true])
    sigma = np.tile(5.0 * SPREAD[: layout.size], (3, 1))
    problem = Problem(
        pack(FIELD, frames, SIZE),
        layout,
        RobustLoss(loss, 6.0),
        prior=GaussianPrior(theta.copy(), sigma) if prior else None,
    )
    theta[:, :7] += SPREAD[:7] * rng.normal(size=(3, 7))
    how = {"max_iterations": 30, "tolerance": 1e-10}
    compiled = levenberg_marquardt(evaluate(problem, theta), **how)
    numpy = by_numpy(lambda: levenberg_marquardt(evaluate(problem, theta), **how))
    np.testing.assert_array_equal(compiled.converged, numpy.converged)
    np.testing.assert_allclose(compiled.cost, numpy.cost, rtol=1e-9)
    np.testing.assert_allclose(compiled.theta / SPREAD[: layout.size], numpy.theta / SPREAD[: layout.size], atol=1e-6)


@pytest.mark.parametrize("crown", [None, 0.0, 0.3])
@pytest.mark.parametrize("told", [(True, True), (False, True), (False, False)])
def test_levenberg_marquardt_with_size_and_crown_of_the_field(told, crown, by_numpy):
    """Of level fields, of those whose crown is estimated, from level ground and from a crown, and of their sizes."""
    frames, true = random_frames(3, seed=3, noise=1.0, stands=("main center",))
    limits, traits = np.array([[90.0, 45.0], [120.0, 90.0]]), None if crown is None else FIELD.crown
    layout = Layout.of(SIZE, field_size=SizeBlock(np.array([105.0, 68.0]), np.ones(2), limits, crown=traits)).fixed(
        "aspect"
    )
    known = np.zeros(layout.size, dtype=bool)
    known[layout.field_size_block] = ~np.array(told)
    layout = layout.with_roles_of(known, Role.CONSIDERED)
    if crown is not None:
        layout = layout.with_roles(Role.FRAME, "crown")
    spread = np.concatenate([SPREAD, [2.0, 2.0], [] if crown is None else [0.1]])
    mean = np.array([layout.theta(camera) for camera in true])
    mean[:, layout.field_size_block] = 105.0, 68.0
    theta = mean + spread * np.random.default_rng(0).normal(size=mean.shape)
    theta[:, known], theta[:, layout.is_crown] = mean[:, known], crown
    theta[:, 11] = np.abs(theta[:, 11])
    problem = Problem(
        pack(FIELD, frames, SIZE, motion=FIELD.motion),
        layout,
        RobustLoss("cauchy", 6.0),
        prior=GaussianPrior(mean, np.tile(5.0 * spread, (3, 1))),
    )

    def both():
        start = with_segment_ends(evaluate(problem, theta), 50.0)
        return start, start.JT, levenberg_marquardt(start, max_iterations=60, tolerance=1e-10)

    (start, JT, compiled), (numpy_start, numpy_JT, numpy) = both(), by_numpy(both)
    seen = start.problem.observations.label >= 0
    np.testing.assert_allclose(start.r[seen], numpy_start.r[seen], atol=1e-7)
    step = spread[layout.free, None] * seen[:, None]
    np.testing.assert_allclose(JT * step, numpy_JT * step, rtol=1e-7, atol=1e-7)
    np.testing.assert_array_equal(compiled.converged, numpy.converged)
    np.testing.assert_allclose(compiled.cost, numpy.cost, rtol=1e-9)
    np.testing.assert_allclose(compiled.theta / spread, numpy.theta / spread, atol=1e-5)
    of_field = layout.free & (np.arange(layout.size) >= layout.field_size_block.start)
    assert np.all(np.ptp(compiled.theta[:, of_field], axis=0) > 0.0)
    assert np.all(compiled.theta[:, known] == mean[:, known])


def test_a_start_outside_the_bounds_and_one_without_a_cost(by_numpy):
    frames, true = random_frames(2, seed=4, noise=1.0, stands=("main center",))
    theta = np.array([Layout.of(SIZE).theta(camera) for camera in true])
    theta[0, -1] = -0.1  # b2 is not negative
    theta[1, 3] = 100.0  # no focal length
    problem = Problem(pack(FIELD, frames, SIZE), Layout.of(SIZE), RobustLoss("cauchy", 6.0))
    compiled = levenberg_marquardt(evaluate(problem, theta), max_iterations=100, tolerance=1e-8)
    numpy = by_numpy(lambda: levenberg_marquardt(evaluate(problem, theta), max_iterations=100, tolerance=1e-8))
    assert compiled.converged.tolist() == numpy.converged.tolist() == [True, False]
    np.testing.assert_allclose(compiled.theta[0], numpy.theta[0], rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(compiled.theta[1], theta[1])
    assert compiled.iterations.tolist() == numpy.iterations.tolist()


@pytest.mark.parametrize(
    "hessian", [np.zeros((3, 3)), np.ones((3, 3)), np.full((3, 3), np.inf), np.full((3, 3), np.nan)]
)
def test_equations_without_a_solution_raise_no_error(hessian):
    """It would end the other frames too."""
    module, free, wide = compilation.compiled_module(), np.arange(3), np.full(3, 1e9)
    model, step = module.Quadratic(np.ones(3), hessian, 1e-20, 0.0), np.empty(3)
    bounds = Bounds(free, -wide, wide, wide)
    assert not np.isfinite(module.damped_step(np.zeros(3), free, model, bounds, np.empty((3, 3)), step))


def test_few_pixels_from_a_camera_in_the_centre_mark():
    """Such starts make the equations of some frames singular, and of others infinite."""
    frames, true = random_frames(50, seed=1, noise=1.0)
    frames = [{label: xy[:3] for label, xy in list(frame.items())[: 1 + t % 3]} for t, frame in enumerate(frames)]
    layout = Layout.of(SIZE).fixed("aspect")
    theta = np.array([layout.theta(camera) for camera in true])
    theta[:, CENTER] = 0.0
    problem = Problem(pack(FIELD, frames, SIZE), layout, RobustLoss("linear", 6.0))
    solved = levenberg_marquardt(evaluate(problem, theta), max_iterations=40, tolerance=1e-8)
    assert np.count_nonzero(np.isfinite(solved.cost)) > 25


def difference(one, other):
    """Between the cameras of calibrations, relative to their focal lengths and to 10 m."""
    f = [c.camera.focal_length for c in (one, other)]
    return max(abs(f[0] / f[1] - 1.0), np.abs(one.camera.C - other.camera.C).max() / 10.0)


def test_calibrations_are_the_same(by_numpy):
    frames, _ = random_frames(40, seed=5, noise=1.0)
    frames[0] = {**frames[0], "Goal left crossbar": np.array([(100.0, 500.0), (300.0, 510.0)])}  # somewhere else
    compiled, numpy = calibrate_batch(FIELD, frames, SIZE), by_numpy(calibrate_batch, FIELD, frames, SIZE)
    assert [c.message for c in compiled] == [c.message for c in numpy]
    assert [c.verdict for c in compiled] == [c.verdict for c in numpy]
    assert max(map(difference, compiled, numpy)) < 1e-9
    one = calibrate_from_segments(FIELD, frames[1], SIZE)
    assert difference(one, by_numpy(calibrate_from_segments, FIELD, frames[1], SIZE)) < 1e-9


@pytest.mark.slow
def test_annotated_frames_are_the_same(shared_data, by_numpy):
    from fieldcalib.io.soccernet import parse_annotation

    files = sorted(f for f in (shared_data / "sncalib-test-center").glob("*.json") if f.stem.isdigit())[::5]
    frames = [parse_annotation(f.read_text(), SIZE) for f in files]
    compiled, numpy = calibrate_batch(FIELD, frames, SIZE), by_numpy(calibrate_batch, FIELD, frames, SIZE)
    assert [c.message for c in compiled] == [c.message for c in numpy]
    assert max(map(difference, compiled, numpy)) < 1e-9


def test_what_is_left_to_numpy():
    nothing = pack(FIELD, [{}], SIZE)
    assert compilation.kernels(Layout.of(SIZE, BrownConradyLens(RHO)), nothing) is None
    assert compilation.kernels(Layout.of(SIZE, zoom_law=ZoomLaw(7.0)), nothing) is None
    assert compilation.kernels(Layout.of(SIZE), nothing) is not None
    cloud = {"balls": PointCloud([(0.0, 0.0, 0.0)])}
    observed = pack(cloud, [{"balls": np.array([(10.0, 20.0)])}], SIZE)
    assert compilation.kernels(Layout.of(SIZE), observed) is None


def test_frames_that_share_their_centre_are_left_to_numpy():
    frames, true = random_frames(2, seed=6, noise=1.0, stands=("main center",))
    layout = Layout.of(SIZE).with_roles(Role.SHARED, "centre")
    theta = np.array([layout.theta(camera) for camera in true])
    theta[:, CENTER] = theta[0, CENTER]
    problem = Problem(pack(FIELD, frames, SIZE), layout, RobustLoss("cauchy", 6.0), group=np.zeros(2, dtype=np.intp))
    solved = levenberg_marquardt(evaluate(problem, theta), max_iterations=10, tolerance=1e-6)
    np.testing.assert_array_equal(*solved.theta[:, CENTER])


def test_numba_is_loaded_when_a_frame_is_solved_and_not_before():
    code = "import sys, fieldcalib; fieldcalib.calibrate_from_segments; assert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_the_command_line_says_that_it_compiles(tmp_path):
    """Once, where something is not in the cache. A small function stands in."""
    code = (
        "from fieldcalib.console.program import log_on_stderr\n"
        "from fieldcalib.problem.compilation import compiled_module\n"
        "with log_on_stderr():\n"
        "    module = compiled_module()\n"
        "    for one in (float, int):\n"  # compiled for each
        "        module._unit(one(3), one(4), module.Limits())\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    for times in (1, 0):
        done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, env=environment)
        assert done.stderr.count(b"fieldcalib: compiling the solver with Numba, which may take half a minute") == times
