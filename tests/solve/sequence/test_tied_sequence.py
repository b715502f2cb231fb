"""Frames of one tripod that matches of the background tie, with and without labels of their own."""

from dataclasses import replace

import numpy as np
import pytest
from tripods import CENTRE, SIZE, chain, far_off, matched, panned

from data_tools.synthetic.clips import labelled
from fieldcalib import calibrate_sequence, soccer
from fieldcalib.assess.findings import Status
from fieldcalib.assess.frame_table import STATUSES, Basis
from fieldcalib.problem.layout import LOG_F

FIELD = soccer(size_known=True)
COUNT = 11
CAMERAS = panned(COUNT, -0.45, 0.45)
PAIRS = [(key, t) for key in range(0, COUNT, 2) for t in (key + 1, key + 2, key + 4) if t < COUNT]


def frames_of(cameras, *with_labels, seed=0):
    frames = labelled(cameras, FIELD, np.random.default_rng(seed), 0.5)
    return [frame.pixels if t in with_labels else {} for t, frame in enumerate(frames)]


def largest(found, cameras=CAMERAS):
    """Of each frame's median error over the picture, pixels."""
    return max(np.median(far_off(frame.camera, truth)) for frame, truth in zip(found, cameras, strict=True))


def marks(found, xy=((200.0, 300.0), (480.0, 400.0), (800.0, 350.0))):
    """Where the ground at these pixels of the true cameras is, pixels, (T, 3, 2)."""
    return np.array(
        [frame.camera.project(truth.image_to_field(xy)) for frame, truth in zip(found, CAMERAS, strict=True)]
    )


@pytest.fixture(scope="module")
def matches():
    return matched(CAMERAS, PAIRS, np.random.default_rng(1))


@pytest.fixture(scope="module")
def frames():
    return frames_of(CAMERAS, 0, 4, 8, 10)


@pytest.fixture(scope="module")
def found(frames, matches):
    return calibrate_sequence(FIELD, frames, SIZE, matches=matches)


def test_frames_without_labels_have_cameras(found, frames):
    assert found.accepted.all()
    assert found.basis == [Basis.BOTH if frame else Basis.MATCHES for frame in frames]
    assert largest(found) < 1.0
    assert np.linalg.norm(found.values[:3] - CENTRE) < 1.0
    for t, frame in enumerate(found):
        assert np.isfinite(frame.covariance).all()
        assert ("by matches, the field in view to" in frame.message) == (not frames[t])
        assert not frames[t] or f"over {len(frames[t])} segments" in frame.message


def test_a_frame_that_is_known_too_little_says_the_limit(found):
    t = found.basis.index(Basis.MATCHES)
    known = found.frames.ground_error.copy()
    known[t] = 1.32
    refused = replace(found.frames, ground_error=known, status=np.full(len(known), STATUSES.index(Status.IMPROBABLE)))
    one = replace(found, frames=refused)[t]
    assert one.reason.endswith("by matches, the field in view to 1.32 m, and at most 1 m are accepted")
    assert "at most" not in found[t].reason


def test_ties_tell_more_than_labels_alone(found, frames):
    alone = calibrate_sequence(FIELD, frames, SIZE)
    assert [camera is None for camera in alone.cameras] == [not frame for frame in frames]
    solved = [0, 4, 8]  # together, with ties to each other
    assert [alone.basis[t] for t in solved] == [Basis.LINES] * 3
    for t in solved:
        tied, untied = (
            abs(f / CAMERAS[t].focal_length - 1.0) for f in (found[t].camera.focal_length, alone[t].camera.focal_length)
        )
        assert tied < untied
        assert found[t].covariance[LOG_F, LOG_F] < alone[t].covariance[LOG_F, LOG_F]


@pytest.mark.parametrize("order", ["backwards", "shuffled"])
def test_the_order_of_matches_is_no_matter(found, frames, matches, order):
    keys = list(matches)[::-1] if order == "backwards" else np.random.default_rng(0).permutation(list(matches)).tolist()
    again = calibrate_sequence(FIELD, frames, SIZE, matches={tuple(key): matches[tuple(key)] for key in keys})
    np.testing.assert_allclose(marks(again), marks(found), atol=1e-3)
    np.testing.assert_allclose(again.frames.own, found.frames.own, rtol=1e-3, atol=1e-12)
    assert again.basis == found.basis


def test_the_order_of_points_is_no_matter(found, frames, matches):
    rng = np.random.default_rng(2)
    shuffled = {}
    for pair, (p, q) in matches.items():
        index = rng.permutation(len(p))
        shuffled[pair] = p[index], q[index]
    again = calibrate_sequence(FIELD, frames, SIZE, matches=shuffled)
    np.testing.assert_allclose(marks(again), marks(found), atol=1e-3)


def test_either_frame_of_a_pair_may_come_first(found, frames, matches):
    turned = {
        (j, i) if (i + j) % 3 else (i, j): (q, p) if (i + j) % 3 else (p, q) for (i, j), (p, q) in matches.items()
    }
    again = calibrate_sequence(FIELD, frames, SIZE, matches=turned)
    assert again.accepted.all()
    assert largest(again) < 1.0
    assert np.max(np.abs(marks(again) - marks(found))) < 1.0  # other frames are solved together, other cells averaged


def with_wrong_labels(wrong):
    """Frames one of which has the labels of a view of one penalty area."""
    frames = frames_of(CAMERAS, 0, 2, 4, 5, 8, 10)
    frames[wrong] = frames_of(panned(1, 0.4, 0.4), 0, seed=3)[0]
    return frames


@pytest.mark.parametrize("wrong", [2, *(pytest.param(wrong, marks=pytest.mark.slow) for wrong in (4, 5, 7))])
def test_wrong_labels_that_ties_contradict_are_voted_out(matches, wrong):
    found = calibrate_sequence(FIELD, with_wrong_labels(wrong), SIZE, matches=matches)
    assert found.accepted.all()
    assert largest(found) < 1.0
    assert found.basis[0] == Basis.BOTH


@pytest.mark.parametrize("wrong", [4, 5], ids=["solved together", "following"])
def test_a_camera_does_not_rest_on_labels_that_its_ties_contradict(matches, wrong):
    found = calibrate_sequence(FIELD, with_wrong_labels(wrong), SIZE, matches=matches)
    assert found.basis[wrong] == Basis.MATCHES
    assert not found[wrong].rms > 3.0
    assert "rms" not in found[wrong].message


def test_frames_that_nothing_ties_are_as_they_were(frames):
    """Nor does the frame without labels tell anything of the one that it follows."""
    matches = matched(CAMERAS, [(0, 1)], np.random.default_rng(1))
    found = calibrate_sequence(FIELD, frames, SIZE, matches=matches)
    expected = [Basis.LINES if frame else Basis.NOTHING for frame in frames]
    expected[1] = Basis.MATCHES
    assert found.basis == expected
    assert [camera is None for camera in found.cameras] == [basis == Basis.NOTHING for basis in expected]


def test_matches_without_points_tie_nothing(frames):
    few = np.random.default_rng(0).uniform((0.0, 0.0), SIZE, (3, 2))
    matches = {(0, 1): (few[:0], few[:0]), (4, 5): (few, few)}
    found, without = (calibrate_sequence(FIELD, frames, SIZE, matches=some) for some in (matches, None))
    assert found.basis == without.basis
    np.testing.assert_array_equal(found.frames.theta, without.frames.theta)


def test_frames_tied_to_nothing_but_each_other_have_no_camera(frames, matches):
    apart = {(t, t + 1): matches[pair] for t, pair in ((11, (0, 1)), (12, (2, 3)))}
    found = calibrate_sequence(FIELD, [*frames, {}, {}, {}], SIZE, matches={**matches, **apart})
    assert found.basis[11:] == [Basis.NOTHING] * 3
    assert found.cameras[11:] == [None] * 3
    assert found.accepted[:11].all()


def test_matches_without_any_label_tell_no_camera(matches):
    found = calibrate_sequence(FIELD, [{}] * COUNT, SIZE, matches=matches)
    assert found.cameras == [None] * COUNT
    assert found.names == ()


def test_a_chain_that_drifts_says_so():
    """Labels at one end only: each frame is told by the one before it."""
    cameras = panned(8, -0.2, 0.3)
    frames = frames_of(cameras, 0, 1)
    found = calibrate_sequence(FIELD, frames, SIZE, matches=matched(cameras, chain(8), np.random.default_rng(0)))
    sigma = np.sqrt(np.diagonal(found.frames.own, axis1=1, axis2=2)[:, 3])
    assert np.all(np.diff(sigma[2:]) > 0.0)
    error = [np.log(f.camera.focal_length / c.focal_length) for f, c in zip(found, cameras, strict=True)]
    total = np.sqrt([frame.covariance[3, 3] for frame in found])
    assert np.all(np.abs(error) < 3.0 * total)


def test_a_start_leads_to_the_same(frames, matches):
    rest = {"matches": matches, "trust_labels": True}
    first = calibrate_sequence(FIELD, frames, SIZE, **rest)
    again = calibrate_sequence(FIELD, frames, SIZE, **rest, start=first)
    assert again.basis == first.basis
    np.testing.assert_allclose(marks(again), marks(first), atol=1e-3)
    np.testing.assert_allclose(again.frames.ground_error, first.frames.ground_error, rtol=0.01)
    np.testing.assert_allclose(again.covariance, first.covariance, rtol=0.02, atol=1e-4)


def test_a_start_with_more_labels_leads_to_what_all_labels_say(frames, matches):
    rest = {"matches": matches, "trust_labels": True}
    more = frames_of(CAMERAS, *range(COUNT))
    first = calibrate_sequence(FIELD, frames, SIZE, **rest)
    searched, started = (calibrate_sequence(FIELD, more, SIZE, **rest, start=start) for start in (None, first))
    assert searched.basis == started.basis == [Basis.BOTH] * COUNT
    np.testing.assert_allclose(marks(started), marks(searched), atol=0.01)


def test_a_start_that_tells_nothing_is_none(frames, matches):
    rest = {"matches": matches, "trust_labels": True}
    nothing = calibrate_sequence(FIELD, [{}] * COUNT, SIZE)
    found = calibrate_sequence(FIELD, frames, SIZE, **rest, start=nothing)
    np.testing.assert_allclose(marks(found), marks(calibrate_sequence(FIELD, frames, SIZE, **rest)), atol=1e-9)


def test_starts_of_other_frames_are_refused(found, frames, matches):
    with pytest.raises(ValueError, match="a calibration of the same 10 frames, got 11"):
        calibrate_sequence(FIELD, frames[:10], SIZE, trust_labels=True, start=found)
    with pytest.raises(ValueError, match="start needs trust_labels=True"):
        calibrate_sequence(FIELD, frames, SIZE, matches=matches, start=found)


def test_matches_of_frames_that_are_not_there_are_refused(frames, matches):
    with pytest.raises(ValueError, match="between two of 11 frames"):
        calibrate_sequence(FIELD, frames, SIZE, matches={**matches, (3, 11): matches[0, 1]})


def test_a_pair_without_matches_ties_nothing(frames, matches):
    """As `match_background` finds none."""
    without = {pair: both for pair, both in matches.items() if pair[0] != 4}
    with_none = {pair: both if pair in without else None for pair, both in matches.items()}
    found, expected = (calibrate_sequence(FIELD, frames, SIZE, matches=some) for some in (with_none, without))
    assert found == expected
    with pytest.raises(ValueError, match="matches must be a mapping of pairs of frames to pixels, got list"):
        calibrate_sequence(FIELD, frames, SIZE, matches=[(0, 1)])
