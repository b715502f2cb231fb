"""What ties frames of one tripod: thinned matches, and cameras that follow from them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import bounded, generators, numbers
from tripods import SIZE, chain, far_off, matched, panned

from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.frame_ties import BackgroundTerm
from fieldcalib.problem.layout import Layout
from fieldcalib.solve.request import Task
from fieldcalib.solve.sequence.background_matches import (
    CELLS,
    LEAST_CELLS,
    Ties,
    cell_means,
    disagreeing,
    stepped,
    with_tied,
)

FIELD = soccer()
LAYOUT = Layout.of(SIZE).fixed("centre", "principal point", "aspect", "lens")


def theta_of(cameras):
    return np.array([LAYOUT.theta(camera) for camera in cameras])


def turned(camera, by):
    """One that is panned on by an angle."""
    pan, tilt, roll = camera.angles
    return Camera.from_angles(pan + by, tilt, roll, camera.focal_length, camera.C, SIZE)


def ties_of(cameras, pairs, seed=0, noise=0.3):
    matches = matched(cameras, pairs, np.random.default_rng(seed), noise)
    return Ties.of(FIELD, matches, len(cameras), SIZE)


def some(*frames, of):
    return np.isin(np.arange(of), frames)


# thinned out


@given(st.integers(LEAST_CELLS, 400), numbers(0.0, 5.0), generators())
def test_what_is_thinned_stays_as_it_is(count, noise, rng):
    p = np.random.default_rng(0).uniform((0.0, 0.0), SIZE, (count, 2))
    q = 1.2 * p + (20.0, -9.0) + rng.normal(scale=noise, size=p.shape)
    once = cell_means(p, q, SIZE)
    assert len(once[0]) <= min(count, CELLS[0] * CELLS[1])
    assume(len(once[0]) >= LEAST_CELLS)
    np.testing.assert_allclose(cell_means(*once, SIZE), once, atol=1e-8)


@given(bounded((6, 2), -200.0, 200.0), st.integers(80, 400))
def test_a_map_that_bends_is_kept(bend, count):
    """Means of both sides would be off by up to a pixel where the cells are 96 pixels wide."""
    bend = bend * np.array([[1.0], [5.0], [5.0], [1.0], [1.0], [1.0]])

    def bent(xy):
        x, y = (xy / SIZE[0]).T
        return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1) @ bend

    p = np.random.default_rng(0).uniform((0.0, 0.0), SIZE, (count, 2))
    mean, moved = cell_means(p, bent(p), SIZE)
    np.testing.assert_allclose(moved, bent(mean), atol=1e-6)


def test_cells_are_means_of_what_lies_in_them():
    rng = np.random.default_rng(0)
    corner = rng.uniform((0.0, 0.0), (96.0, 90.0), (30, 2))
    others = np.array([[150.0, 20.0], [500.0, 300.0], [950.0, 530.0], [20.0, 530.0], [480.0, 20.0]])
    p = np.concatenate([corner, others])
    mean, moved = cell_means(p, p + (3.0, 4.0), SIZE)
    assert len(mean) == 6
    at = np.argmin(np.linalg.norm(mean - corner.mean(axis=0), axis=1))
    np.testing.assert_allclose(mean[at], corner.mean(axis=0))
    np.testing.assert_allclose(moved, mean + (3.0, 4.0))


def test_noise_is_averaged():
    rng = np.random.default_rng(1)
    p = rng.uniform((0.0, 0.0), SIZE, (6000, 2))
    _, moved = cell_means(p, p + rng.normal(size=p.shape), SIZE)
    mean, _ = cell_means(p, p, SIZE)
    assert 0.07 < np.std(moved - mean) < 0.13  # of 100 points a cell


def test_too_few_points_are_none():
    few = np.ones((LEAST_CELLS - 1, 2))
    assert [len(part) for part in cell_means(few, few, SIZE)] == [0, 0]


def test_matches_in_a_corner_tie_nothing():
    corner = np.random.default_rng(0).uniform((0.0, 0.0), (180.0, 170.0), (100, 2))  # four cells
    ties = Ties.of(FIELD, {(0, 1): (corner, corner)}, 2, SIZE)
    assert len(ties) == 0
    assert not ties.is_tied.any()
    assert ties.among(np.arange(2)) is None


# pairs of frames


@pytest.mark.parametrize("pair", [(0, 3), (-1, 0), (3, 1), (1, 1)])
def test_frames_that_are_not_there_are_named(pair):
    xy = np.zeros((20, 2))
    with pytest.raises(ValueError, match=f"between two of 3 frames, from 0 on; got those of {pair[0]} and {pair[1]}"):
        Ties.of(FIELD, {pair: (xy, xy)}, 3, SIZE)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (np.zeros((20, 2)), np.zeros((19, 2))),
        (np.zeros((20, 3)), np.zeros((20, 3))),
        (np.zeros(20), np.zeros(20)),
        (np.zeros((20, 2)), np.full((20, 2), np.nan)),
        (np.full((20, 2), np.inf), np.zeros((20, 2))),
    ],
    ids=["lengths", "columns", "flat", "NaN", "infinite"],
)
def test_pixels_that_are_none_are_named(first, second):
    with pytest.raises(ValueError, match=r"matches of frames 2 and 0: expected two arrays of finite pixels"):
        Ties.of(FIELD, {(2, 0): (first, second)}, 3, SIZE)


def test_those_among_some_frames_are_numbered_anew():
    cameras = panned(5)
    ties = ties_of(cameras, [(0, 1), (0, 4), (4, 2), (3, 4)])
    frames = np.array([4, 2, 0])
    pairs = ties.among(frames)
    assert list(zip(pairs.first.tolist(), pairs.second.tolist(), strict=True)) == [(2, 0), (0, 1)]
    np.testing.assert_array_equal(pairs.p, ties.pairs.p[[1, 2]])
    assert not disagreeing(BackgroundTerm(pairs, LAYOUT, theta_of(cameras)[frames])).any()
    assert ties.among(np.array([1, 3])) is None


def test_ties_lead_from_known_frames_to_others_in_both_directions():
    cameras = panned(4)
    ties = ties_of(cameras, [(0, 1), (1, 2), (2, 3), (0, 3)], noise=0.0)
    theta = theta_of(cameras)
    pairs = ties.towards(np.array([3, 1]), theta, some(0, 2, of=4))
    assert sorted(zip(pairs.first.tolist(), pairs.second.tolist(), strict=True)) == [(0, 0), (0, 1), (2, 0), (2, 1)]
    np.testing.assert_array_equal(pairs.known, theta[pairs.first])
    assert not disagreeing(BackgroundTerm(pairs, LAYOUT, theta[[3, 1]])).any()
    back = np.flatnonzero((pairs.first == 2) & (pairs.second == 1))[0]  # matched from 1 to 2
    np.testing.assert_array_equal(pairs.p[back], ties.pairs.q[1])
    np.testing.assert_array_equal(pairs.q[back], ties.pairs.p[1])


@pytest.mark.parametrize("wrong", [False, True])
def test_a_step_from_nearby_leads_to_where_known_cameras_have_the_background(wrong):
    cameras = panned(3)
    ties = ties_of(cameras, [(0, 1), (0, 2), (2, 1)], noise=0.1)
    theta = theta_of(cameras)
    pairs = ties.towards(np.array([1]), theta, some(0, 2, of=3))
    if wrong:
        pairs = replace(pairs, q=pairs.q + (0.0, 80.0) * (-1.0) ** np.arange(pairs.q.shape[1])[:, None])
    near = theta[[1]]
    near[:, :4] += (3e-3, -2e-3, 1e-3, 4e-3)
    moved, contradicts = stepped(pairs, LAYOUT, near)
    assert contradicts.tolist() == [wrong]
    if not wrong:
        np.testing.assert_allclose(moved, theta[[1]], atol=2e-4)
        assert not disagreeing(BackgroundTerm(pairs, LAYOUT, moved)).any()
        far = np.median(far_off(LAYOUT.camera(near[0]), cameras[1]))
        assert np.median(far_off(LAYOUT.camera(moved[0]), cameras[1])) < 0.05 * far


def test_what_is_reached():
    ties = ties_of(panned(5), [(0, 1), (2, 1), (2, 3), (3, 4)])
    none = np.zeros(5, dtype=bool)
    assert ties.reached(some(1, of=5), none).tolist() == [0, 2]
    assert ties.reached(some(1, of=5), some(2, of=5)).tolist() == [0]
    assert ties.reached(none, none).tolist() == []
    assert ties.is_tied.all()


# wrong cameras


@given(st.integers(0, 7), st.sampled_from([-0.05, 0.03, 0.5]))
def test_a_wrong_camera_is_voted_out(wrong, by):
    cameras = panned(8)
    ties = ties_of(cameras, chain(8, 1, 2))
    theta = theta_of(cameras)
    known = np.ones(8, dtype=bool)
    assert ties.agreeing(theta, known, LAYOUT).all()
    theta[wrong] = LAYOUT.theta(turned(cameras[wrong], by))
    assert np.flatnonzero(~ties.agreeing(theta, known, LAYOUT)).tolist() == [wrong]


def test_what_is_not_known_has_no_vote():
    cameras = panned(6)
    ties = ties_of(cameras, chain(6, 1, 2))
    theta = theta_of(cameras)
    theta[[1, 2]] = np.nan
    theta[4] = LAYOUT.theta(turned(cameras[4], 0.1))
    known = ~some(1, 2, of=6)
    assert np.flatnonzero(ties.agreeing(theta, known, LAYOUT)).tolist() == [0, 3, 5]
    nobody = some(0, of=6)
    assert ties.agreeing(theta, nobody, LAYOUT).tolist() == nobody.tolist()


def test_two_wrong_cameras_that_agree_are_outvoted():
    cameras = panned(9)
    ties = ties_of(cameras, chain(9, 1, 2, 4))
    theta = theta_of(cameras)
    theta[[3, 4]] = theta_of([turned(cameras[t], 0.08) for t in (3, 4)])
    assert np.flatnonzero(~ties.agreeing(theta, np.ones(9, dtype=bool), LAYOUT)).tolist() == [3, 4]


# frames that follow


def followed(ties, theta, known, wanted):
    return with_tied(Task(FIELD).options(SIZE), ties, theta, known, wanted, LAYOUT)


@pytest.mark.parametrize("start", [0, 3, 5])
def test_a_chain_is_followed_to_its_ends(start):
    cameras = panned(6, -0.5, 0.5)  # from end to end 57 degrees: nothing of the first frame is in the last one
    ties = ties_of(cameras, chain(6), noise=0.1)
    theta = np.full((6, LAYOUT.size), np.nan)
    theta[start] = LAYOUT.theta(cameras[start])
    found, known = followed(ties, theta, some(start, of=6), np.arange(6))
    assert known.all()
    assert np.isnan(theta[np.arange(6) != start]).all()  # what came in is as it was
    for camera, truth in zip(map(LAYOUT.camera, found), cameras, strict=True):
        assert np.max(far_off(camera, truth)) < 1.0
    np.testing.assert_array_equal(found[start], theta[start])


def test_only_frames_that_are_wanted_are_followed():
    cameras = panned(5)
    ties = ties_of(cameras, chain(5))
    _, known = followed(ties, theta_of(cameras), some(2, of=5), np.array([1, 2, 4]))
    assert known.tolist() == [False, True, True, False, False]  # 4 is tied by 3 only


def test_a_frame_that_its_ties_contradict_is_left_out_with_what_it_alone_leads_to():
    cameras = panned(6)
    rng = np.random.default_rng(0)
    matches = matched(cameras, chain(6), rng)
    p, q = matches[2, 3]
    matches[2, 3] = p, rng.permutation(q)  # no rotation makes that
    ties = Ties.of(FIELD, matches, 6, SIZE)
    _, known = followed(ties, theta_of(cameras), some(0, of=6), np.arange(6))
    assert known.tolist() == [True, True, True, False, False, False]


def test_wrong_matches_among_others_are_no_matter():
    cameras = panned(4)
    rng = np.random.default_rng(1)
    matches = matched(cameras, chain(4, 1, 2, 3), rng)
    p, q = matches[0, 3]
    matches[0, 3] = p, q + (45.0, -20.0)  # what a graphic that moves would do
    ties = Ties.of(FIELD, matches, 4, SIZE)
    theta, known = followed(ties, theta_of(cameras), some(0, 1, 2, of=4), np.arange(4))
    assert known.all()
    assert np.max(far_off(LAYOUT.camera(theta[3]), cameras[3])) < 3.0
