"""What is computed once is handed on: searches of the closest points, and what a result keeps of its batch."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from synthetic import observe, random_frames, whole_circle_markings

from fieldcalib.assess.findings import Verdict
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem import compilation
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import Layout, theta_from_camera
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import Observations, pack
from fieldcalib.processes.jobs import Processes
from fieldcalib.solve.batch import PackedCalibrations, calibrate_batch
from fieldcalib.solve.from_segments import calibrate_from_segments

FIELD, SIZE = soccer(), (960, 540)
CAMERA = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), SIZE)
LABELS = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")


@pytest.fixture
def searches(monkeypatch):
    """The searches of the closest points so far, of NumPy's way: of how many frames each was."""
    monkeypatch.setattr(compilation, "compiled_module", lambda: None)
    found, search = [], Observations.closest_points

    def counted(observations, projection):
        found.append(len(observations))
        return search(observations, projection)

    monkeypatch.setattr(Observations, "closest_points", counted)
    return found


def test_everything_that_follows_from_one_search_is_computed_from_it(searches):
    observations = pack(FIELD, [observe(whole_circle_markings(FIELD), CAMERA)], SIZE)
    problem = Problem(observations, Layout.of(SIZE), RobustLoss("cauchy", 6.0))
    found = evaluate(problem, theta_from_camera(CAMERA)[None])
    assert searches == [1]
    for name in ("r", "JT", "cost", "costs", "gradient", "hessian", "information", "world_points", "trimmed"):
        getattr(found, name)
    found.of(problem)
    found.take(np.array([0, 0]))
    found.replaced(np.array([0]), found.theta, found.points)
    assert searches == [1]
    assert found.JT is found.JT


def test_a_frame_of_five_segments_needs_few_searches(searches):
    frame = {label: CAMERA.project(FIELD[label].sample(7.0)) for label in LABELS}
    calibration = calibrate_from_segments(FIELD, frame, SIZE)
    assert calibration.accepted
    assert np.isfinite(calibration.uncertainty.covariance).all()
    assert len(searches) <= 20


def test_in_the_median_frames_need_fewer(searches):
    frames, _ = random_frames(10, seed=0, noise=1.0)
    counts = []
    for frame in frames:
        searches.clear()
        assert calibrate_from_segments(FIELD, frame, SIZE).uncertainty.covariance.any()
        counts.append(len(searches))
    assert np.median(counts) <= 12, counts


def test_uncertainty_verdict_and_errors_search_nothing_anew(searches):
    frame = observe(whole_circle_markings(FIELD), CAMERA, np.random.default_rng(0), 1.0)
    calibration = calibrate_from_segments(FIELD, frame, SIZE)
    searches.clear()
    assert np.all(np.diagonal(calibration.uncertainty.covariance)[calibration.uncertainty.layout.free] > 0.0)
    assert calibration.verdict is Verdict.GOOD
    assert calibration.probability() > 0.0
    assert calibration.field_uncertainty([480.0, 300.0]).rms > 0.0
    assert searches == []


@pytest.fixture(scope="module")
def batch():
    frames, _ = random_frames(20, seed=3, noise=1.0)
    return calibrate_batch(FIELD, frames, SIZE)


def test_a_pickled_result_of_a_batch_is_small(batch):
    assert np.median([len(pickle.dumps(one)) for one in batch]) <= 8000


def test_a_pickled_result_of_a_batch_is_the_same(batch):
    for one in batch[:5]:
        back = pickle.loads(pickle.dumps(one))
        assert back == one
        np.testing.assert_array_equal(back.uncertainty.theta, one.uncertainty.theta)
        # closest points are found anew, to 1e-8 px
        sigma = np.sqrt(np.diagonal(one.covariance))
        assert np.all(np.abs(back.covariance - one.covariance) <= 1e-5 * np.outer(sigma, sigma))
        assert back.probability() == pytest.approx(one.probability(), rel=1e-6)
        assert dict(back.field) == dict(one.field)


@pytest.mark.parametrize("executor", [pytest.param(Processes, marks=pytest.mark.slow), ThreadPoolExecutor])
def test_frames_come_back_from_an_executor_as_they_are(executor, monkeypatch):
    monkeypatch.setattr("fieldcalib.solve.batch.CHUNK", 4)
    frames, _ = random_frames(10, seed=7, noise=1.0)
    frames[3] = {}
    alone = calibrate_batch(FIELD, frames, SIZE)
    with executor(2) as workers:
        found = calibrate_batch(FIELD, frames, SIZE, executor=workers)
    for one, other in zip(alone, found, strict=True):
        assert one == other
        assert other.field is one.field
        if one.camera is not None:
            np.testing.assert_array_equal(one.camera.K, other.camera.K)
            assert one.probability() == other.probability()
    shared = [one.solved.evaluation for one in found if one.solved is not None]
    assert len({id(evaluation) for evaluation in shared}) == 3, "what was solved together comes back together"


def test_frames_of_several_problems_are_handed_over_in_any_order():
    """As with CALIB_AUTO_LENS, where some frames of a batch are solved with another lens."""
    frames, _ = random_frames(4, seed=8, noise=1.0)
    some, others = (calibrate_batch(FIELD, frames[part], SIZE) for part in (slice(0, 2), slice(2, 4)))
    nothing = calibrate_batch(FIELD, [{}], SIZE)
    mixed = [*nothing, some[0], others[0], *nothing, some[1], others[1]]
    assert pickle.loads(pickle.dumps(PackedCalibrations.of(mixed))).unpacked(FIELD) == mixed
