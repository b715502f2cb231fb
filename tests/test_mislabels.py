"""Labels that lie: who is accused, of what, and that nobody else is."""

import numpy as np
import pytest
from synthetic import observe, whole_circle_markings

from fieldcalib.calibrate.from_segments import calibrate_batch
from fieldcalib.calibrate.mislabels import SuspectLabel, renamed, resolve_labels
from fieldcalib.fields.soccer import soccer
from fieldcalib.fields.stands import MAIN_CENTER
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Problem
from fieldcalib.problem.layout import camera_from_theta, theta_from_camera
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.problem.prior import GaussianPrior, gaussian_prior

FIELD, SIZE = soccer(), (960, 540)
LEFT = Camera.from_angles(-0.65, 1.38, 0.01, 1500.0, (1.0, 66.0, -16.0), SIZE)
MIDDLE = Camera.from_angles(0.05, 1.32, 0.0, 1000.0, (-2.0, 60.0, -14.0), SIZE)
PINHOLE = np.arange(12) < 7


def clean(camera, noise=0.5):
    return observe(whole_circle_markings(FIELD), camera, np.random.default_rng(3), noise=noise)


def relabelled(frame, wrong):
    return {wrong.get(label, label): xy for label, xy in frame.items()}


def resolved(frames, cameras, *, at_hand=None, shares=None):
    """Frames whose cameras a search finds, solved from `at_hand` before."""
    distribution = gaussian_prior(MAIN_CENTER, SIZE)
    truth = np.stack([theta_from_camera(camera) for camera in cameras])
    searched = []

    def priors(count):
        return GaussianPrior(np.tile(distribution.mean, (count, 1)), np.tile(distribution.sigma, (count, 1)))

    def search(observations):
        searched.append(len(observations))
        return np.tile(truth[0], (len(observations), 1)), priors(len(observations))

    def finish(problem, theta):
        return solve_batch(problem, theta, max_iterations=50, tolerance=1e-8)

    shares = shares or [None] * len(frames)
    observations = pack(FIELD, frames, SIZE, shares)
    problem = Problem(observations, PINHOLE, RobustLoss("cauchy", 6.0), prior=priors(len(frames)))
    start = truth if at_hand is None else np.stack([theta_from_camera(camera) for camera in at_hand])
    solution = finish(problem, start)
    args = FIELD, frames, shares, problem, solution, problem.prior, 20.0, search, finish
    return resolve_labels(*args), solution, searched


def same_view(theta, camera, tolerance):
    X = np.array([(x, y, 0.0) for x in (-45.0, -30.0, -15.0) for y in (-20.0, 0.0, 20.0)])
    return np.abs(camera_from_theta(theta, SIZE).project(X) - camera.project(X)).max() < tolerance


def test_clean_frames_are_left_as_they_are():
    cameras = [LEFT, MIDDLE]
    resolution, solution, searched = resolved([clean(camera) for camera in cameras], cameras)
    assert resolution.suspects == [(), ()]
    assert resolution.solution is solution
    assert searched == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"Big rect. left main": "Big rect. right main"},
        {"Side line top": "Side line right"},
        {"Circle left": "Circle right"},
        {"Goal left post left": "Goal left post right", "Goal left post right": "Goal left post left"},
        {"Big rect. left top": "Big rect. right top"},  # on the same infinite line: no residual tells
        {"Small rect. left top": "Big rect. left top", "Big rect. left top": "Small rect. left top"},
    ],
    ids=["mirror", "side line", "circle", "swapped posts", "collinear", "swapped boxes"],
)
def test_wrong_labels_are_found_with_the_label_that_fits(wrong):
    frame = clean(LEFT)
    assert len(relabelled(frame, wrong)) == len(frame)
    resolution, _, _ = resolved([relabelled(frame, wrong), clean(MIDDLE)], [LEFT, MIDDLE])
    assert {suspect.label: suspect.fits for suspect in resolution.suspects[0]} == {b: a for a, b in wrong.items()}
    assert resolution.suspects[1] == ()
    assert set(resolution.frames[0]) == set(frame)
    _, true, _ = resolved([frame], [LEFT])
    np.testing.assert_allclose(resolution.solution.theta[0], true.theta[0], rtol=1e-4, atol=1e-4)


def test_the_wrong_camera_is_given_up():
    frame = relabelled(clean(LEFT), {"Side line top": "Side line right"})
    elsewhere = Camera.from_angles(0.4, 1.3, 0.0, 1500.0, (1.0, 66.0, -16.0), SIZE)
    resolution, solution, searched = resolved([frame], [LEFT], at_hand=[elsewhere])
    assert not same_view(solution.theta[0], LEFT, 20.0)
    assert len(searched) == 2  # without each label in turn, and with the right ones
    assert [suspect.label for suspect in resolution.suspects[0]] == ["Side line right"]
    assert same_view(resolution.solution.theta[0], LEFT, 4.0)


def test_what_no_label_fits_is_left_out():
    frame = {**clean(LEFT), "Middle line": np.array([(100.0, 500.0), (300.0, 530.0), (500.0, 480.0)])}
    resolution, _, _ = resolved([frame], [LEFT])
    ((suspect,),) = resolution.suspects
    assert (suspect.label, suspect.fits) == ("Middle line", None)
    assert suspect.error_px > 20.0
    assert "Middle line" not in resolution.frames[0]
    assert not np.any(resolution.problem.observations.label == list(FIELD).index("Middle line"))


def test_few_labels_accuse_nobody():
    frame = clean(LEFT)
    few = {label: frame[label] for label in ("Side line left", "Big rect. left main", "Big rect. left top")}
    few["Small rect. right bottom"] = frame["Side line top"]
    resolution, _, _ = resolved([few], [LEFT])
    assert resolution.suspects == [()]
    assert np.all(np.isfinite(resolution.solution.theta))


def test_weights_follow_their_pixels():
    frame = relabelled(clean(LEFT), {"Circle left": "Circle right"})
    shares = {label: np.full(len(xy), 0.5 / len(xy)) for label, xy in frame.items()}
    resolution, _, _ = resolved([frame], [LEFT], shares=[shares])
    observations = resolution.problem.observations
    assert [suspect.fits for suspect in resolution.suspects[0]] == ["Circle left"]
    on_circle = observations.label == list(FIELD).index("Circle left")
    assert np.sum(observations.weight[on_circle]) == pytest.approx(0.5)


def test_renamed_joins_what_belongs_to_one_segment():
    frame = {"Side line top": np.zeros((2, 2)), "Side line left": np.ones((3, 2)), "Middle line": np.ones((1, 2))}
    lying = [SuspectLabel("Side line left", "Side line top", 50.0), SuspectLabel("Middle line", None, 99.0)]
    assert {label: len(xy) for label, xy in renamed(frame, lying).items()} == {"Side line top": 5}


def test_suspects_in_words():
    assert str(SuspectLabel("Circle left", None, 31.4)) == "'Circle left' lies 31 px off: no other label fits"


def test_trusted_labels_are_not_doubted():
    frame = relabelled(clean(LEFT), {"Goal left post left": "Goal right post left"})
    doubted, trusted = (calibrate_batch(FIELD, [frame], SIZE, trust_labels=trust)[0] for trust in (False, True))
    assert [suspect.label for suspect in doubted.suspect_labels] == ["Goal right post left"]
    assert trusted.suspect_labels == ()
