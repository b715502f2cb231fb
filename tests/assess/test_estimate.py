"""What errors on the ground are relative to: the markings in view, or the centre mark."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numdiff import central_differences
from strategies import angle, cameras, examples, numbers, vectors
from synthetic import displaced, observe
from tripods import SIZE, chain, matched, panned

from fieldcalib import Calibration, Status, calibrate_from_segments, calibrate_sequence, locate_on_ground, soccer
from fieldcalib.assess.camera_errors import KnownErrors
from fieldcalib.assess.estimate import CENTRE_MARK, in_words, motion_in_view, relative_to_markings
from fieldcalib.assess.ground import ground_derivatives
from fieldcalib.fields.traits import UNPAINTED
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.layout import Layout, Role, SizeBlock
from fieldcalib.problem.projection import Projection

FIELD = soccer()
BLOCK = SizeBlock(np.array([105.0, 68.0]), np.array([2.55, 2.81]), np.array([[90.0, 45.0], [120.0, 90.0]]))
STEPS = np.array([1e-6] * 4 + [1e-4] * 3 + [1e-3] * 2 + [1e-6] * 3)
RIGHT_END = {"first": 0.5, "last": 0.6, "centre": (0.0, 66.0, -17.0)}  # of `panned`


def seen_by(*some, field=FIELD):
    layout = Layout.of(some[0].image_size, some[0].lens)
    return motion_in_view(Projection(np.array([layout.theta(one) for one in some]), layout), field)


def at_the_right_end():
    """A camera that sees a penalty area."""
    return Camera.from_angles(0.62, 1.31, 0.0, 2600.0, (0.0, 66.0, -17.0), SIZE)


def across_and_moves(camera, field=FIELD):
    """Normals (N, 2) and motions (N, 2, 2) of places in view of the painted markings, equally far apart."""
    longer, wider = (field.resized(field.length + a, field.width + b) for a, b in ((1.0, 0.0), (0.0, 1.0)))
    normals, moves = [], []
    for label, segment in field.markings.items():
        if label in field.half_labels:
            continue
        X = segment.sample(0.05)
        step = np.gradient(X, axis=0)
        xy = camera.project(X)
        inside = np.all((xy >= -0.5) & (xy < np.array(camera.image_size) - 0.5), axis=1)
        moved = np.stack([other[label].sample(0.05)[[0, -1]] - X[[0, -1]] for other in (longer, wider)], axis=-1)
        share = np.linspace(0.0, 1.0, len(X))[:, None, None]
        motion = ((1.0 - share) * moved[0] + share * moved[1])[:, :2]
        for at in np.flatnonzero(inside):
            along = step[at] / np.linalg.norm(step[at])
            for direction in np.eye(2):  # what is left of both directions across, each with its share
                across = direction - along[:2] * (along[:2] @ direction)
                if np.linalg.norm(across) > 1e-9:
                    normals.append(across), moves.append(motion[at])
    return np.array(normals).reshape(-1, 2), np.array(moves).reshape(-1, 2, 2)


@pytest.mark.slow
@examples(10)
@given(cameras())
def test_the_motion_in_view_is_the_translation_that_fits_best_across_the_markings(camera):
    normals, moves = across_and_moves(camera)
    assume(len(normals) > 400)
    # of a line only what is across it is told: P = I - d d^T has the rows P e_k, and P M = P (P M)
    information = normals.T @ normals
    values = np.linalg.eigvalsh(information)
    assume(values[0] > 100.0)
    expected = np.linalg.solve(information, np.einsum("ni,nj,njk->ik", normals, normals, moves))
    np.testing.assert_allclose(seen_by(camera)[0], expected, atol=0.04)


@given(st.lists(numbers(-0.6, 0.6), min_size=2, max_size=9))
def test_the_motion_of_many_cameras_is_that_of_each_to_the_last_bit(pans):
    """What is written of a frame must not depend on those that are computed with it."""
    some = [Camera.from_angles(pan, 1.31, 0.0, 1600.0, (0.0, 66.0, -17.0), SIZE) for pan in pans]
    np.testing.assert_array_equal(seen_by(*some), np.concatenate([seen_by(one) for one in some]))


def test_one_end_moves_with_half_the_length_and_both_not_at_all():
    right, left = at_the_right_end(), Camera.from_angles(-0.62, 1.31, 0.0, 2600.0, (0.0, 66.0, -17.0), SIZE)
    middle = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 66.0, -17.0), SIZE)
    everything = Camera.from_angles(0.0, 1.2, 0.0, 500.0, (0.0, 80.0, -40.0), SIZE)
    found = seen_by(right, left, middle, everything)
    np.testing.assert_allclose(found[:, 0, 0], [0.5, -0.5, 0.0, 0.0], atol=2e-3)
    np.testing.assert_allclose(found[:, [0, 1], [1, 0]], 0.0, atol=1e-9)  # length along x alone, width along y
    assert found[2, 1, 1] < -0.1  # the far touchline is in view, the near one is not


def test_what_no_marking_tells_stays_as_it_is():
    touchline = Camera.from_angles(0.3, 1.41, 0.0, 6000.0, (0.0, 66.0, -17.0), SIZE)
    sky = Camera.from_angles(0.0, 2.2, 0.0, 1500.0, (0.0, 66.0, -17.0), SIZE)
    along, nothing = seen_by(touchline, sky)
    np.testing.assert_allclose(along, [[0.0, 0.0], [0.0, -0.5]], atol=1e-3)
    np.testing.assert_array_equal(nothing, 0.0)


def test_what_is_not_painted_tells_nothing():
    corner = Camera.from_angles(0.46, 1.415, 0.0, 11000.0, (0.0, 66.0, -17.0), SIZE)
    without = replace(FIELD, paint={"Side line right": UNPAINTED})
    assert without.moves_with_size
    np.testing.assert_allclose(seen_by(corner)[0, 0], [0.5, 0.0], atol=1e-3)
    np.testing.assert_allclose(seen_by(corner, field=without)[0, 0], [0.0, 0.0], atol=1e-3)


@given(pan=numbers(-0.3, 0.7), xy=vectors((100.0, 250.0), (860.0, 500.0), count=6))
def test_relative_derivatives_are_those_of_places_less_the_markings(pan, xy):
    """By central differences: the ground point of a pixel, less the mean place of the markings in view."""
    camera = Camera.from_angles(pan, 1.36, 0.003, 1700.0, (0.0, 66.0, -17.0), SIZE)
    layout = Layout.of(SIZE, field_size=BLOCK)
    theta = layout.theta(camera)
    here = seen_by(camera)[0]

    def place(moved):
        by_size = here @ (moved[-2:] - BLOCK.given)
        return layout.camera(moved).image_to_field(xy)[:, :2] - by_size

    numeric = central_differences(place, theta, np.concatenate([STEPS, [1e-3, 1e-3]]))
    projection = Projection(theta[None], layout)
    X = camera.image_to_field(xy)[None]
    every = np.ones(layout.size, dtype=bool)
    J = ground_derivatives(projection, X, np.isfinite(X).all(axis=-1), every)
    found = relative_to_markings(J, projection, FIELD, np.ones(projection.layout.size, dtype=bool))[0]
    np.testing.assert_allclose(found, numeric, rtol=1e-4, atol=1e-6)
    some = layout.with_roles(Role.FIXED, "lens").free
    part = ground_derivatives(projection, X, np.isfinite(X).all(axis=-1), some)
    np.testing.assert_allclose(relative_to_markings(part, projection, FIELD, some)[0], found[..., some])


@given(
    dl=numbers(-4.0, 4.0),
    noise=numbers(0.0, 0.3),
    direction=angle(np.pi),
    places=vectors((2.0, -8.0, 0.0), (18.0, 15.0, 0.0), count=5),
)
def test_one_end_of_a_longer_pitch_is_right_relative_to_its_markings(dl, noise, direction, places):
    """Whatever the length: everything is where the markings say it is, and half the difference from the centre mark."""
    pitch, truth = soccer(105.0 + dl, 68.0), at_the_right_end()
    frame = displaced(observe(pitch, truth, per_line=12, per_curve=12), noise, direction)
    # without the touchlines: a pitch of just 68 m is, as they say, just 105 m long
    frame = {label: xy for label, xy in frame.items() if label not in ("Side line top", "Side line bottom")}
    found = calibrate_from_segments(FIELD, frame, SIZE)
    assert found.accepted, found.message
    X = (52.5 + dl / 2.0, 0.0, 0.0) + places * (-1.0, 1.0, 0.0)  # metres from the goal line
    xy = truth.project(X)
    here, there = (
        locate_on_ground(found, xy, pixel_sd=0.0, relative_to=of) for of in ("markings in view", "centre mark")
    )
    np.testing.assert_array_equal(here.X, there.X)
    off = here.X - X
    np.testing.assert_allclose(off[:, 0], -dl / 2.0, atol=0.15)
    from_markings = off[:, :2] - seen_by(truth, field=pitch)[0] @ (-dl, 0.0)  # assumed less true size
    assert np.all(np.abs(from_markings) < 0.15)
    # and that is what is said: each error within 5 standard deviations, which are small, or those of half the length
    assert np.all(np.abs(from_markings) < 5.0 * here.standard_deviations)
    assert np.all(here.standard_deviations < 0.15)
    assert np.all(np.abs(off[:, :2]) < 5.0 * there.standard_deviations)
    assert np.all(there.standard_deviations[:, 0] > 3.0 * here.standard_deviations[:, 0])
    error = found.field_uncertainty(xy)
    np.testing.assert_allclose(error.covariance, here.covariance, rtol=1e-6, atol=1e-9)
    far = found.field_uncertainty(xy, relative_to=CENTRE_MARK)
    np.testing.assert_allclose(far.covariance, there.covariance, rtol=1e-6, atol=1e-9)
    assert found.probability(1.0) > 0.9


def test_a_known_size_makes_no_difference():
    rng = np.random.default_rng(0)
    found = calibrate_from_segments(soccer(size_known=True), observe(FIELD, at_the_right_end(), rng, 0.3), SIZE)
    X = np.array([[40.0, 3.0, 0.0]])
    here, there = (found.uncertainty.at_field(X, relative_to=of) for of in ("markings in view", "centre mark"))
    np.testing.assert_array_equal(here.covariance, there.covariance)


def test_of_what_is_no_field_errors_are_those_from_its_origin():
    layout = Layout.of(SIZE, field_size=BLOCK).with_roles(Role.CONSIDERED, "field size")
    covariance = np.zeros((layout.size, layout.size))
    x, length = 4, layout.size - 2
    # the camera follows half a length that is known to 2 m
    covariance[np.ix_([x, length], [x, length])] = np.array([[1.0, 2.0], [2.0, 4.0]])
    errors = KnownErrors(layout, layout.theta(at_the_right_end()), covariance)
    X = np.array([[40.0, 3.0, 0.0]])
    np.testing.assert_allclose(errors.at_field(X).rms, 1.0, rtol=1e-6)
    np.testing.assert_allclose(errors.on(FIELD).at_field(X).rms, 0.0, atol=2e-3)
    np.testing.assert_allclose(errors.on(FIELD).at_field(X, relative_to="centre mark").rms, 1.0, rtol=1e-6)
    with pytest.raises(ValueError, match="one of markings in view, centre mark, got 'the centre mark'"):
        errors.at_field(X, relative_to="the centre mark")


def one_end(count=12, dl=-5.0):
    """A clip of one penalty area of a shorter pitch: labels of every third frame, matches of all."""
    rng = np.random.default_rng(3)
    pitch, tripod = soccer(105.0 + dl, 68.0), panned(count, **RIGHT_END)
    frames = [observe(pitch, camera, rng, 0.5) if t % 3 == 0 else {} for t, camera in enumerate(tripod)]
    return tripod, frames, matched(tripod, chain(count, 1, 3), rng)


@pytest.mark.slow
def test_frames_of_one_end_are_accepted():
    _, frames, matches = one_end()
    found = calibrate_sequence(FIELD, frames, SIZE, matches=matches)
    assert [one.status for one in found] == len(frames) * [Status.ACCEPTED]
    assert np.all(found.frames.ground_error < 0.3)
    for one in found:
        there = one.camera.image_to_field([480.0, 300.0]) * (1.0, 1.0, 0.0)
        here, far = (one.uncertainty.at_field(there, relative_to=of).rms for of in ("markings in view", "centre mark"))
        assert here < 0.3 < 1.0 < far
        assert one.probability() > 0.9
        assert str(one.verdict) == "good"
        assert one.remedy.startswith(
            "the length is not visible: positions are relative to the right end; the known length"
        )


def test_who_sees_the_whole_pitch_or_knows_its_size_needs_no_remedy():
    rng = np.random.default_rng(0)
    everything = Camera.from_angles(0.0, 1.2, 0.0, 500.0, (0.0, 80.0, -40.0), SIZE)
    assert calibrate_from_segments(FIELD, observe(FIELD, everything, rng, 0.3, per_line=9), SIZE).remedy == ""
    frame = observe(FIELD, at_the_right_end(), rng, 0.3, per_line=9)
    assert calibrate_from_segments(soccer(size_known=True), frame, SIZE).remedy == ""
    assert Calibration.without_camera(Status.DEGENERATE, "").remedy.startswith("a marking elsewhere")


def test_words_name_what_is_not_visible():
    both = in_words(np.diag([-0.5, -0.5]), np.array([2.5, 2.8]))
    assert both == (
        "the length and width are not visible: positions are relative to the left end and far side; "
        "the known length and width give metres from the centre"
    )
    assert "near side" in in_words(np.diag([0.5, 0.5]), np.array([0.1, 2.0]))
    assert in_words(np.diag([0.5, 0.5]), np.array([0.1, 0.1])) == ""
