"""Mislabelled segments: which labels are suspect, of what, and that no others are."""

from unittest.mock import patch

import numpy as np
import pytest
from synthetic import gaussian_prior, observe, whole_circle_markings

from fieldcalib.assess.findings import SuspectLabel
from fieldcalib.fields.catalogue import handball
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import MAIN_CENTER
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import GaussianPrior
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.observations import pack
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.mislabels import _without, without_mislabels
from fieldcalib.solve.request import Task
from fieldcalib.solve.search import find_cameras
from fieldcalib.solve.solver_options import PINHOLE_FLAGS

FIELD, SIZE = soccer(), (960, 540)
LEFT = Camera.from_angles(-0.65, 1.38, 0.01, 1500.0, (1.0, 66.0, -16.0), SIZE)
MIDDLE = Camera.from_angles(0.05, 1.32, 0.0, 1000.0, (-2.0, 60.0, -14.0), SIZE)
OPTIONS = Task(FIELD, flags=PINHOLE_FLAGS, criteria=(3, 50, 1e-8), prior=MAIN_CENTER).options(SIZE)


def clean(camera, noise=0.5):
    return observe(whole_circle_markings(FIELD), camera, np.random.default_rng(3), noise=noise)


def relabelled(frame, wrong):
    return {wrong.get(label, label): xy for label, xy in frame.items()}


def solved(evaluation):
    return levenberg_marquardt(evaluation, max_iterations=50, tolerance=1e-8).evaluation


def resolved(frames, cameras, *, at_hand=None, weights=None):
    """Frames solved from `at_hand`, by default their cameras, and then without their mislabelled segments.

    Returns what was found, the evaluation that it was found from, and how many frames each search was for.
    """
    distribution = gaussian_prior(MAIN_CENTER, OPTIONS.layout)
    prior = GaussianPrior(np.tile(distribution.mean, (len(frames), 1)), np.tile(distribution.sigma, (len(frames), 1)))
    weights = weights or [None] * len(frames)
    problem = Problem(
        pack(FIELD, frames, SIZE, weights, FIELD.motion), OPTIONS.layout, OPTIONS.loss, OPTIONS.noise, prior
    )
    start = np.stack([OPTIONS.layout.theta(camera) for camera in at_hand or cameras])
    given = solved(evaluate(problem, start))
    with patch("fieldcalib.solve.mislabels.find_cameras", wraps=find_cameras) as search:
        found = without_mislabels(given, prior, OPTIONS)
    return found, given, [len(call.args[0]) for call in search.call_args_list]


def same_view(theta, camera, tolerance):
    X = np.array([(x, y, 0.0) for x in (-45.0, -30.0, -15.0) for y in (-20.0, 0.0, 20.0)])
    return np.abs(OPTIONS.layout.camera(theta).project(X) - camera.project(X)).max() < tolerance


def test_clean_frames_are_left_as_they_are():
    cameras = [LEFT, MIDDLE]
    resolution, given, searched = resolved([clean(camera) for camera in cameras], cameras)
    assert resolution.suspects == [(), ()]
    assert resolution.evaluation is given
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
    assert set(resolution.evaluation.problem.observations.pixels.by_label(0)) == set(frame)
    _, true, _ = resolved([frame], [LEFT])
    np.testing.assert_allclose(solved(resolution.evaluation).theta[0], true.theta[0], rtol=1e-4, atol=1e-4)


def test_the_wrong_camera_is_given_up():
    frame = relabelled(clean(LEFT), {"Side line top": "Side line right"})
    elsewhere = Camera.from_angles(0.4, 1.3, 0.0, 3000.0, (1.0, 66.0, -16.0), SIZE)
    resolution, given, searched = resolved([frame], [LEFT], at_hand=[elsewhere])
    assert not same_view(given.theta[0], LEFT, 20.0)
    assert len(searched) == 2  # without each label in turn, and with the right ones
    assert [suspect.label for suspect in resolution.suspects[0]] == ["Side line right"]
    assert same_view(resolution.evaluation.theta[0], LEFT, 4.0)


def test_what_no_label_fits_is_left_out():
    frame = {**clean(LEFT), "Middle line": np.array([(100.0, 500.0), (300.0, 530.0), (500.0, 480.0)])}
    resolution, _, _ = resolved([frame], [LEFT])
    ((suspect,),) = resolution.suspects
    assert (suspect.label, suspect.fits) == ("Middle line", None)
    assert suspect.error_px > 20.0
    assert "Middle line" not in resolution.evaluation.problem.observations.pixels.by_label(0)
    assert not np.any(resolution.evaluation.problem.observations.label == list(FIELD).index("Middle line"))


def test_few_labels_accuse_nobody():
    frame = clean(LEFT)
    few = {label: frame[label] for label in ("Side line left", "Big rect. left main", "Big rect. left top")}
    few["Small rect. right bottom"] = frame["Side line top"]
    resolution, _, _ = resolved([few], [LEFT])
    assert resolution.suspects == [()]
    assert np.all(np.isfinite(resolution.evaluation.theta))


def test_weights_follow_their_pixels():
    frame = relabelled(clean(LEFT), {"Circle left": "Circle right"})
    weights = {label: np.full(len(xy), 0.5 / len(xy)) for label, xy in frame.items()}
    resolution, _, _ = resolved([frame], [LEFT], weights=[weights])
    observations = resolution.evaluation.problem.observations
    assert [suspect.fits for suspect in resolution.suspects[0]] == ["Circle left"]
    on_circle = observations.label == list(FIELD).index("Circle left")
    assert np.sum(observations.weight[on_circle]) == pytest.approx(0.5)


def test_renaming_joins_what_belongs_to_one_segment():
    frame = {"Side line top": np.zeros((2, 2)), "Side line left": np.ones((3, 2)), "Middle line": np.ones((1, 2))}
    lying = [SuspectLabel("Side line left", "Side line top", 50.0), SuspectLabel("Middle line", None, 99.0)]
    table = _without(pack(FIELD, [frame], SIZE), [lying]).pixels
    assert {label: len(xy) for label, xy in table.by_label(0).items()} == {"Side line top": 5}
    np.testing.assert_allclose(table.weight, 0.2)


def test_suspects_in_words():
    assert str(SuspectLabel("Circle left", None, 31.4)) == "'Circle left' lies 31 px off: no other label fits"
    assert "lies more than 100000 px off" in str(SuspectLabel("Circle left", None, 3e13))


def test_trusted_labels_are_not_doubted():
    frame = relabelled(clean(LEFT), {"Goal left post left": "Goal right post left"})
    doubted, trusted = (calibrate_batch(FIELD, [frame], SIZE, trust_labels=trust)[0] for trust in (False, True))
    assert [suspect.label for suspect in doubted.suspect_labels] == ["Goal right post left"]
    assert trusted.suspect_labels == ()


def test_a_wrong_label_that_an_absurd_lens_sends_to_infinity():
    """The camera that explains the other labels has no image of that one; its cost is infinite, and nobody warns."""
    frame = {
        "Side line top": [(955.7, 345.7), (453.9, 311.6), (81.1, 291.9)],
        "Goal line left": [(275.1, 282.3), (302.1, 279.4), (331.3, 278.5)],  # of the right goal
        "Goal area right line": [(443.3, 291.5), (469.2, 290.4), (492.3, 287.4)],
        "Goal area right arc bottom": [(422.3, 274.9), (484.4, 278.5), (509.3, 282.2), (490.8, 288.0)],
        "Goal area right arc top": [(145.4, 289.1), (251.4, 293.4), (364.2, 294.6), (443.1, 286.8)],
        "Free-throw right arc bottom": [(528.5, 274.6), (572.8, 279.3), (599.8, 282.4), (605.0, 287.1), (581.0, 290.1)],
        "Seven-metre line right": [(489.7, 291.5), (494.9, 290.7), (499.8, 290.7), (507.1, 289.1)],
        "Goal right crossbar": [(276.0, 214.8), (293.9, 215.4), (314.6, 214.8), (330.8, 216.0)],
    }
    (found,) = calibrate_batch(handball(), [frame], (960, 540), prior=None)
    assert [suspect.label for suspect in found.suspect_labels] == ["Goal line left"]
    assert found.rms < 2.0
