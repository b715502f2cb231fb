"""The probability that a camera is right, and where it comes from."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic import observe, random_frames, whole_circle_markings

from data_tools.probability import fitted_coefficients, largest_true_error, reliability, risk_coverage_area
from data_tools.random_frames import random_frame
from fieldcalib.assess.findings import Finding, Status, Verdict, What
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.assess.probability import (
    OddsTerms,
    errors_given_paint,
    largest_error,
    odds_terms,
    probability_right,
    surprises,
)
from fieldcalib.fields.catalogue import tennis
from fieldcalib.fields.sports.soccer import PROBABILITY, soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.layout import Layout
from fieldcalib.solve.batch import calibrate_batch, compute_errors
from fieldcalib.solve.from_segments import calibrate_from_segments
from fieldcalib.solve.solver_options import LENS_FLAGS

FIELD, SIZE = soccer(size_known=True), (960, 540)  # of the synthetic frames
MARKINGS = whole_circle_markings(FIELD)
CAMERA = Camera.from_angles(-0.35, 1.36, 0.01, 1700.0, (1.5, 68.0, -17.0), SIZE)


def random_calibrations(count):
    """Calibrations of random frames, and their true largest errors."""
    rng = np.random.default_rng(11)
    frames = [random_frame(FIELD, rng) for _ in range(count)]
    found = calibrate_batch(FIELD, [frame.pixels for frame in frames], SIZE)
    errors = [largest_true_error(c.camera, frame.camera, FIELD) for c, frame in zip(found, frames, strict=True)]
    return found, np.array(errors)


def certain(row):
    """Terms of one possibility."""
    return OddsTerms(np.array([row]), np.ones(1))


@given(st.floats(-5.0, 5.0), st.floats(-2.0, 2.0), st.floats(0.5, 4.0), st.floats(0.0, 4.0), st.floats(0.1, 10.0))
def test_more_error_is_less_probable_and_more_tolerance_more(log_m, log_sigma, log_nu, log_z, metres):
    one, worse = (certain([1.0, log_m + more, log_sigma, log_nu, log_z]) for more in (0.0, 1.0))
    p = probability_right(PROBABILITY, one, metres)
    assert 0.0 <= p <= 1.0
    assert probability_right(PROBABILITY, worse, metres) <= p <= probability_right(PROBABILITY, one, 2.0 * metres)


def test_what_is_open_is_certainly_wrong_and_nothing_in_view_has_no_probability():
    assert probability_right(PROBABILITY, certain([1.0, np.inf, 0.0, 3.0, 0.0]), 1.0) == 0.0
    assert np.isnan(probability_right(PROBABILITY, certain([1.0, np.nan, 0.0, 3.0, 0.0]), 1.0))


@pytest.mark.slow
def test_the_expected_error_is_about_the_true_one():
    rng = np.random.default_rng(0)
    frames = [observe(MARKINGS, CAMERA, rng, noise=1.0) for _ in range(40)]
    found = calibrate_batch(FIELD, frames, SIZE)
    expected = [largest_error(calibration.uncertainty, FIELD) for calibration in found]
    true = [largest_true_error(calibration.camera, CAMERA, FIELD) for calibration in found]
    assert 0.5 < np.sqrt(np.mean(np.square(true)) / np.mean(np.square(expected))) < 2.0


@pytest.mark.slow
def test_it_keeps_its_word_on_frames_that_it_was_not_fitted_to():
    found, errors = random_calibrations(300)
    for metres in (0.5, 1.0):
        p = np.array([c.probability(metres) for c in found])
        known = ~np.isnan(p) & ~np.isnan(errors)
        p, right = p[known], errors[known] < metres
        assert abs(p.mean() - right.mean()) < 0.06
        assert np.mean((p - right) ** 2) < 0.7 * np.var(right)
        sure = p > 0.9
        assert right[sure].mean() > 0.85


@pytest.mark.slow
def test_nonsense_is_not_believed():
    rng = np.random.default_rng(5)
    frames, _ = random_frames(12, seed=4)
    nonsense = [{label: rng.uniform(0.0, SIZE, xy.shape) for label, xy in frame.items()} for frame in frames]
    found = calibrate_batch(FIELD, nonsense, SIZE)
    assert max(c.probability() for c in found) < 0.5
    assert all(c.probability() == 0.0 for c in found if c.status is Status.IMPLAUSIBLE)


def test_frames_that_look_the_same_from_the_other_side_are_half_as_probable():
    camera = Camera.from_angles(0.0, 1.35, 0.0, 900.0, (0.0, 65.0, -16.0), SIZE)
    labels = ("Middle line", "Circle central")
    frame = {label: camera.project(FIELD[label].sample(2.0)) for label in labels}
    calibration = calibrate_from_segments(FIELD, frame, SIZE)
    (other,) = calibration.alternatives
    assert 0.0 < calibration.probability(50.0) <= 0.5
    assert "180 degrees" in calibration.message
    np.testing.assert_allclose(other.C * (-1.0, -1.0, 1.0), calibration.camera.C)
    for label in labels:  # turned by 180 degrees they are themselves
        X = FIELD[label].sample(2.0)
        here, there = calibration.camera.project(X), other.project(X * (-1.0, -1.0, 1.0))
        assert np.isfinite(here).any()
        np.testing.assert_allclose(there, here, rtol=0, atol=1e-6)


def seen_through_lens(a1, spacing, noise, lens, words=("",), f=700.0):
    """A camera with a lens, and its calibration from the labels that contain one of some words."""
    lens_of_truth = Layout.of(SIZE).lens.to_opencv(np.array([a1, 0.0]), f)
    camera = Camera.from_angles(-0.2, 1.3, 0.0, f, (1.5, 60.0, -17.0), SIZE, k=lens_of_truth)
    rng, frame = np.random.default_rng(0), {}
    for label, segment in MARKINGS.items():
        xy = camera.project(segment.sample(spacing))
        xy = xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)]
        if len(xy) > 1 and any(word in label for word in words):
            frame[label] = xy + rng.normal(0.0, noise, xy.shape)
    return calibrate_from_segments(FIELD, frame, SIZE, flags=LENS_FLAGS[lens])


@pytest.mark.parametrize(
    ("a1", "spacing", "noise", "lens", "is_surprise"),
    [
        (-0.07, 1.0, 1.0, "k1", False),
        (-0.07, 1.0, 2.5, "k1", True),  # off their markings
        (-0.07, 30.0, 1.0, "k1", True),  # few
        (-0.15, 1.0, 1.0, "k1", False),
        (-0.15, 1.0, 1.0, "k1k2", False),
    ],
)
def test_a_strong_lens_is_a_surprise_unless_many_labels_lie_on_it(a1, spacing, noise, lens, is_surprise):
    found = seen_through_lens(a1, spacing, noise, lens)
    assert found.camera.corner_distortion[0] == pytest.approx(a1, abs=0.03)
    assert (Finding(What.UNUSUAL, "lens") in found.findings) == is_surprise


@pytest.mark.parametrize("a1", [-0.04, -0.15])
@pytest.mark.parametrize(
    ("f", "lens", "words", "is_open"),
    [
        (400.0, "k1", ("Circle", "Middle", "Big"), True),
        (400.0, "k1k2", ("Circle", "Middle", "Big"), False),  # then its error is in that of the camera
        (400.0, "k1", ("",), False),
        (1700.0, "k1", ("Circle", "Middle", "Big"), False),  # narrow
    ],
)
def test_a_wide_view_with_k1_alone_is_doubted_where_k2_may_move_places_in_view(a1, f, lens, words, is_open):
    found = seen_through_lens(a1, 1.0, 1.0, lens, words, f)
    assert (Finding(What.MORE_LENS) in found.findings) == is_open


def test_few_wide_views_through_a_lens_that_bends_hardly_are_doubted(monkeypatch):
    frames, _ = random_frames(100, seed=4, noise=1.0, stands=("main center",))
    found = calibrate_batch(FIELD, frames, SIZE)
    assert sum(one.has_finding(What.MORE_LENS) for one in found) <= 2
    monkeypatch.setattr("fieldcalib.assess.probability.LEAST_K1", 0.0)
    assert sum(Finding(What.MORE_LENS) in surprises(one.uncertainty) for one in found) >= 8


@pytest.mark.parametrize(("spacing", "noise", "is_surprise"), [(0.2, 1.0, False), (0.2, 2.5, True), (30.0, 1.0, True)])
def test_a_place_far_from_all_stands_is_a_surprise_unless_many_labels_tell_it(spacing, noise, is_surprise):
    """Off the corner of a court, between the stands beside it and behind it."""
    court, camera = tennis(), Camera.from_angles(0.9, 1.36, 0.0, 800.0, (-22.0, 14.0, -4.0), SIZE)
    rng, frame = np.random.default_rng(0), {}
    for label, segment in court.markings.items():
        xy = camera.project(segment.sample(spacing))
        xy = xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)]
        if len(xy) > 1:
            frame[label] = xy + rng.normal(0.0, noise, xy.shape)
    found = calibrate_from_segments(court, frame, SIZE)
    assert np.linalg.norm(found.camera.C - camera.C) < 2.0
    assert (Finding(What.UNUSUAL, "place") in found.findings) == is_surprise


def test_errors():
    frame = observe(MARKINGS, CAMERA, np.random.default_rng(0), noise=1.0)
    calibration = calibrate_from_segments(FIELD, frame, SIZE)
    with pytest.raises(ValueError, match="metres must be a positive number, got 0"):
        calibration.probability(0.0)
    (of_a_mapping,) = calibrate_batch(dict(FIELD), [frame], SIZE, prior="main center")
    with pytest.raises(ValueError, match="expected a calibration of a Field"):
        of_a_mapping.probability()


def test_the_fit_finds_the_coefficients_that_made_the_errors():
    rng = np.random.default_rng(0)
    truth = np.array([0.5, -2.0, -1.0, 0.3, -0.4])
    features = np.concatenate([np.ones((20_000, 1)), rng.normal(size=(20_000, 4))], axis=1)
    # a logistic error whose odds to be below d metres are those of the model
    log_error = (rng.logistic(size=20_000) - features @ truth) / -truth[1]
    np.testing.assert_allclose(fitted_coefficients(features, np.exp(log_error), 1.0), truth, atol=0.1)


@pytest.mark.slow
def test_reliability_counts():
    found, errors = random_calibrations(60)
    known = [i for i, c in enumerate(found) if np.isfinite(c.probability()) and np.isfinite(errors[i])]
    row = reliability(np.array([found[i].probability(1.0) for i in known]), errors[known] < 1.0)
    assert sum(count for count, _, _ in row["frames_probability_right"]) == len(known)
    assert row["brier"] < row["of_constant"]


def test_a_field_asks_for_more_of_a_camera_that_was_found_in_a_picture():
    """Labels by a person, and pictures of other fields, are good from one half on."""
    found = calibrate_from_segments(FIELD, observe(MARKINGS, CAMERA, np.random.default_rng(0), noise=2.0), SIZE)
    on_paint = tuple(MarkingInView(label, 400.0, 30, share=1.0, offset=0.0) for label in found.pixel_counts)
    known = found.probability()
    assert 0.5 < known < 0.999

    def verdict(least, **how):
        model = replace(PROBABILITY, least_in_picture=least)
        return replace(found, field=replace(FIELD, probability=model), are_annotated=False, **how).verdict

    assert verdict(known - 0.001, markings=on_paint) == verdict(1.0) == Verdict.GOOD
    seen = replace(found, field=replace(FIELD, probability=replace(PROBABILITY, least_in_picture=1.0)))
    assert replace(seen, are_annotated=True, markings=on_paint).verdict == Verdict.GOOD
    doubted = replace(seen, are_annotated=False, markings=on_paint)
    assert [one.what for one in doubted.findings] == [What.IMPROBABLE]


def test_an_order_by_risk_has_the_smallest_area():
    risk = np.random.default_rng(0).uniform(size=50)
    best, worst = risk_coverage_area(-risk, risk), risk_coverage_area(risk, risk)
    assert best < risk_coverage_area(np.zeros(50), risk) < worst


def test_possibilities_for_the_size_weigh_as_they_are_probable():
    """Of two rows of evidence, one per possibility, the probability is their mean."""
    sharp, blurred = ([1.0, np.log(m), 0.0, 3.0, 0.0] for m in (0.05, 5.0))
    p, q = (probability_right(PROBABILITY, certain(one), 1.0) for one in (sharp, blurred))
    both = probability_right(PROBABILITY, OddsTerms(np.array([sharp, blurred]), np.array([0.7, 0.3])), 1.0)
    assert q < 0.3 < 0.7 < p
    assert both == pytest.approx(0.7 * p + 0.3 * q)


def test_errors_of_many_calibrations_at_once_are_those_of_each():
    frames, _ = random_frames(12, seed=11, noise=1.0)
    frames[4] = {}
    first, second = (calibrate_batch(FIELD, frames, (960, 540)) for _ in range(2))
    more = calibrate_batch(FIELD, frames[:2], (960, 540), prior=None)
    together = [*second, *more]
    compute_errors(together)
    for one, other in zip([*first, *calibrate_batch(FIELD, frames[:2], (960, 540), prior=None)], together, strict=True):
        assert one.verdict == other.verdict
        assert one.reason == other.reason
        if one.camera is not None:
            assert other.errors.are_computed
            np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-5, atol=1e-12)
            np.testing.assert_allclose(other.probability(0.5), one.probability(0.5), rtol=1e-7)
            assert [d.parameters for d in other.observability] == [d.parameters for d in one.observability]


def test_errors_that_are_known_are_not_computed_again(monkeypatch):
    frames, _ = random_frames(3, seed=12, noise=1.0)
    calibrations = calibrate_batch(FIELD, frames, (960, 540))
    known = calibrations[1].uncertainty
    compute_errors(calibrations)
    assert calibrations[1].uncertainty is known
    monkeypatch.setattr(
        "fieldcalib.assess.camera_errors.uncertainties", lambda *arguments: pytest.fail("computed again")
    )
    compute_errors(calibrations)


@pytest.mark.parametrize("dl", [-4.0, 4.0])
def test_true_errors_are_relative_to_the_markings_in_view(dl):
    """Of one end of a pitch of another length that a camera was fitted to as if it were the usual one."""
    pitch = soccer(105.0 + dl, 68.0)
    truth = Camera.from_angles(0.62, 1.31, 0.0, 2600.0, (0.0, 66.0, -17.0), SIZE)
    (found,) = calibrate_batch(soccer(), [observe(pitch, truth, per_line=12, per_curve=12)], SIZE)
    assert largest_true_error(found.camera, truth, soccer(), pitch) < 0.4
    assert largest_true_error(found.camera, truth, soccer()) > 1.9


@pytest.mark.slow
def test_it_keeps_its_word_of_one_end_of_pitches_of_other_lengths():
    rng, field = np.random.default_rng(5), soccer()
    pitches = [soccer(*size) for size in rng.uniform((95.0, 64.0), (112.0, 72.0), (150, 2))]
    truths = [
        Camera.from_angles(rng.uniform(0.4, 0.7), rng.uniform(1.3, 1.38), 0.0, 2200.0, (0.0, 66.0, -17.0), SIZE)
        for _ in pitches
    ]
    frames = [observe(pitch, truth, rng, 1.0) for pitch, truth in zip(pitches, truths, strict=True)]
    found = calibrate_batch(field, frames, SIZE)
    p = np.array([one.probability() for one in found])
    errors = [
        largest_true_error(one.camera, truth, field, pitch)
        for one, truth, pitch in zip(found, truths, pitches, strict=True)
    ]
    assert abs(p.mean() - np.mean(np.array(errors) < 1.0)) < 0.1


@given(st.floats(0.05, 1.0), st.floats(0.3, 3.0))
def test_errors_grow_with_missing_paint_as_the_probability_falls(share, metres):
    """The larger errors by themselves, with no word of paint, have the probability that the paint leaves."""
    (frame,), _ = random_frames(1, seed=29, noise=1.0)
    found = calibrate_from_segments(FIELD, frame, SIZE)
    seen = found.seen_in_image([MarkingInView("Side line top", 300.0, 200, share, 0.0)])
    terms = OddsTerms(odds_terms([seen.uncertainty], FIELD)[0].rows[:1], np.ones(1))
    assert seen.probability(metres, size_known=True) == pytest.approx(probability_right(PROBABILITY, terms, metres))
    factor = errors_given_paint(PROBABILITY, share)
    assert (factor > 1.0) == (share < 0.9)
    np.testing.assert_allclose(seen.uncertainty.determined, factor**2 * found.uncertainty.determined)
