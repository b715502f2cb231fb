"""The size and the ground of a field that single frames tell, and what the rules allow."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from commands import lines_of, run, summary_of
from hypothesis import given
from hypothesis import strategies as st
from strategies import examples, generators, numbers
from synthetic import observe
from tripods import SIZE, panned

from data_tools.crown import crowned, on_crown
from fieldcalib import Calibration, Camera, SegmentationNetwork, calibrate_from_images, calibrate_sequence, soccer
from fieldcalib.assess.findings import Verdict, What
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.assess.size_evidence import SizeEvidence
from fieldcalib.draw import render_field
from fieldcalib.fields import american_football
from fieldcalib.fields.ground import LEVEL
from fieldcalib.run_folder.record import calibration_line
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.field_size import doubted_for_size, shared_size, with_field_from_labels

FIELD, RIGHT_SIZE = soccer(), soccer(105.0, 63.0, size_known=True)
WIDE = Camera.from_angles(0.0, 1.2, 0.0, 560.0, (0.0, 80.0, -40.0), SIZE)  # sees all of a pitch
LOW = Camera.from_angles(0.0, 1.33, 0.0, 640.0, (0.0, 66.0, -15.0), SIZE)  # sees most of a pitch, flat
SIDE = Camera.from_angles(0.7, 1.25, 0.0, 1000.0, (0.0, 66.0, -25.0), SIZE)  # both touchlines and one end
POSSIBLE, LIMITS = FIELD.size_model.possibilities, FIELD.size_model.limits
ROOM = LIMITS - np.array([105.0, 68.0])


def with_field(pitch, camera, rng, noise=0.5, field=FIELD, markings=()):
    """A frame of a pitch, calibrated on a field, and then on a field of the size and ground from its labels."""
    frame = observe(pitch, camera, rng, noise, per_line=9, per_curve=12)
    found = replace(calibrate_batch(field, [frame], SIZE)[0], markings=markings)

    def again(field, start):
        (one,) = calibrate_batch(field, [frame], SIZE, cameras=[start])
        return one

    return found, with_field_from_labels(found, again)


@examples(8)
@given(generators(), numbers(97.0, 112.0), numbers(62.0, 74.0))
def test_a_frame_of_the_whole_pitch_tells_its_size(rng, length, width):
    given, found = with_field(soccer(length, width), WIDE, rng)
    assert found.accepted
    off = np.array([found.field.length - length, found.field.width - width])
    assert np.all(np.abs(off) < 1.5) or found is given  # the given size, where that is likely
    if found is not given:
        sigma = np.sqrt(np.diagonal(found.covariance))[found.uncertainty.layout.field_size_block]
        assert np.all(np.abs(off) < 5.0 * sigma)
        assert np.all(sigma < 0.5)
        X = np.array([[40.0, 20.0, 0.0], [-40.0, -20.0, 0.0], [10.0, 30.0, 0.0]])
        error = (found.camera.image_to_field(WIDE.project(X)) - X)[:, :2]
        of_ground = found.uncertainty.at_field(X, relative_to="centre mark")
        assert np.all(np.linalg.norm(error, axis=1) < 5.0 * of_ground.rms)


def test_the_usual_size_is_left_alone():
    rng = np.random.default_rng(0)
    for _ in range(5):
        given, found = with_field(FIELD, WIDE, rng)
        assert found is given
        assert found.field.ground is None
    given, found = with_field(soccer(100.0, 64.0), WIDE, rng, field=soccer(size_known=True))
    assert found is given


def test_what_a_frame_does_not_tell_stays_as_it_is_given():
    given, found = with_field(soccer(101.0, 62.0), SIDE, np.random.default_rng(1))
    assert found.field.length == 105.0
    assert abs(found.field.width - 62.0) < 1.0
    assert found.rms < given.rms
    assert found.remedy.startswith("the length is not visible: positions are relative to the right end")


@examples(8)
@given(generators(), numbers(0.25, 0.5), st.booleans())
def test_a_frame_of_the_whole_pitch_tells_its_crown(rng, height, roof):
    given, found = with_field(crowned(FIELD, height, roof=roof), LOW, rng)
    assert given.field.ground is None
    assert abs(found.field.ground.crown - height) < 0.25 * height  # parabolas and roofs are other profiles
    assert (found.field.length, found.field.width) == (105.0, 68.0)
    assert found.rms < given.rms
    X = np.array([[40.0, 20.0, 0.0], [-40.0, -20.0, 0.0], [10.0, 0.0, 0.0]])
    on_ground = LOW.project(on_crown(X, FIELD, height, roof=roof))
    off, off_level = (
        np.linalg.norm((one.camera.image_to_field(on_ground, terrain=one.field.terrain) - X)[:, :2], axis=1)
        for one in (found, given)
    )
    assert np.max(off) < np.max(off_level)
    assert found.probability() > given.probability()


def test_a_frame_tells_size_and_crown_together():
    pitch = crowned(soccer(101.0, 64.0), 0.4, roof=True)
    _, found = with_field(pitch, LOW, np.random.default_rng(5))
    assert abs(found.field.length - 101.0) < 1.0
    assert abs(found.field.width - 64.0) < 1.0
    assert abs(found.field.ground.crown - 0.4) < 0.1
    line = calibration_line("000000", found, None)
    assert abs(line["field_width"] - 64.0) < 1.0
    assert line["field_crown_m"]["value"] == found.field.ground.crown
    assert 0.0 < line["field_crown_m"]["standard_deviation"] < 0.15
    assert found.has_finding(What.RAISED)
    assert f"by {found.field.ground.crown:.2f} m" in found.reason


def test_errors_on_an_estimated_field_are_those_of_a_minimum():
    """No step of the camera lowers the cost: evidence for another size would count it as one."""
    _, found = with_field(crowned(soccer(101.0, 64.0), 0.4, roof=True), LOW, np.random.default_rng(5))
    evaluation, layout = found.solved.evaluation, found.uncertainty.layout
    hessian = evaluation.information[0] + np.diag(evaluation.prior.effective_sigma[0] ** -2.0)
    step = np.linalg.solve(hessian, evaluation.gradient[0])
    assert np.any(evaluation.problem.observations.ends.weight > 0.0)
    assert np.all(np.abs(step) < 0.05 * np.sqrt(np.diagonal(found.covariance))[layout.free])


def test_a_marking_beside_its_paint_asks_for_other_ground_sooner():
    pitch, beside = crowned(FIELD, 0.2), MarkingInView("Side line top", 400.0, 30, share=0.4, offset=9.0)
    given, found = with_field(pitch, LOW, np.random.default_rng(3), noise=2.0)
    assert found is given
    _, asked = with_field(pitch, LOW, np.random.default_rng(3), noise=2.0, markings=(beside,))
    assert abs(asked.field.ground.crown - 0.2) < 0.1
    _, level = with_field(FIELD, LOW, np.random.default_rng(3), noise=2.0, markings=(beside,))
    assert abs(level.field.terrain.crown) < 0.05


@pytest.mark.parametrize("known", [soccer(size_known=True), american_football()])
def test_the_crown_alone_of_a_field_whose_size_is_known(known):
    _, found = with_field(crowned(known, 0.4, roof=True), LOW, np.random.default_rng(2), field=known)
    assert abs(found.field.ground.crown - 0.4) < 0.1
    assert (found.field.length, found.field.width) == (known.length, known.width)
    assert "field_width" not in calibration_line("000000", found, None)


def test_ground_that_is_given_is_kept():
    labels = crowned(FIELD, 0.4, roof=True)
    _, found = with_field(labels, LOW, np.random.default_rng(2), field=FIELD.with_ground(LEVEL))
    assert found.field.ground == LEVEL


def test_calibrations_with_a_size_of_their_own_survive_json():
    _, found = with_field(soccer(100.0, 64.0), WIDE, np.random.default_rng(2))
    assert found.field.length < 102.0
    back = Calibration.from_dict(json.loads(json.dumps(found.to_dict())))
    np.testing.assert_allclose(back.covariance, found.covariance, rtol=1e-6, atol=1e-12)
    assert back.field == found.field
    assert back.probability() == pytest.approx(found.probability(), rel=1e-6)


@given(
    st.floats(-45.0, 45.0), st.floats(-45.0, 45.0), st.floats(0.05, 40.0), st.floats(0.05, 40.0), st.floats(-0.9, 0.9)
)
def test_no_size_is_proposed_that_the_rules_forbid(dl, dw, sl, sw, correlation):
    V = np.array([[sl**2, correlation * sl * sw], [correlation * sl * sw, sw**2]])
    information = np.linalg.inv(V)
    found = SizeEvidence.of(information, -information @ (dl, dw), information, POSSIBLE, ROOM)
    assert found.weights.sum() == pytest.approx(1.0)
    assert 0.0 <= found.as_given <= 1.0
    assert np.isfinite(found.mean).all()
    assert np.all(np.linalg.eigvalsh(found.moment) > -1e-6)
    if found.as_given < 0.1:  # as `surprises` says
        size = np.array([105.0, 68.0]) + found.mean
        assert np.all((size > LIMITS[0] - 2.0) & (size < LIMITS[1] + 2.0))


def test_a_pitch_of_thirty_metres_is_none():
    information = np.diag([1.0 / 17.0**2, 1.0])
    absurd, small = (
        SizeEvidence.of(information, -information @ (0.0, dw), information, POSSIBLE, ROOM) for dw in (-38.0, -6.0)
    )
    assert absurd.as_given > 0.6
    assert small.as_given < 0.1
    assert -6.0 < small.mean[1] < -5.0


@given(st.floats(-6.0, 6.0), st.floats(0.1, 2.0), st.floats(-5.0, 5.0), st.booleans())
def test_evidence_is_the_same_from_whichever_field_it_is_taken(dw, sigma, shift, are_lines):
    """The labels tell the same size, and errors are counted from the field on which they were solved."""
    information, shift = np.diag([1.0 / 17.0**2, 1.0 / sigma**2]), np.array([0.0, shift])
    near, far = (
        SizeEvidence.of(
            information, information @ (start - (0.0, dw)), information, POSSIBLE, ROOM, start, are_lines=are_lines
        )
        for start in (np.zeros(2), shift)
    )
    np.testing.assert_allclose(far.weights, near.weights, atol=1e-5)
    np.testing.assert_allclose(far.offset, near.offset, atol=1e-3)
    assert far.as_given == pytest.approx(near.as_given, abs=1e-5)
    given, wide = POSSIBLE[1][0], far.moments[0]  # the given size is exact, but the frame was solved on another one
    assert not np.any(given)
    np.testing.assert_allclose(wide, np.outer(shift, shift), atol=1e-9)


def test_lines_of_a_picture_may_be_edges_beside_the_paint():
    information, tell = np.diag([1.0 / 17.0**2, 1.0 / 0.3**2]), []
    for are_lines in (False, True):
        found = SizeEvidence.of(
            information, -information @ (0.0, -3.0), information, POSSIBLE, ROOM, are_lines=are_lines
        )
        tell.append((found.as_given, float(np.sqrt(found.moment[1, 1]))))
    (labels, _), (lines, _) = tell
    assert labels < 0.01 < lines < 0.3


def test_a_size_from_labels_may_be_that_of_mistakes():
    """The probability on the estimated field is less than if that field were known."""
    _, found = with_field(soccer(101.0, 62.0), SIDE, np.random.default_rng(1))
    solved = found.uncertainty
    weights, moments = solved.possibilities
    assert len(weights) == len(moments) > 1
    assert found.probability(0.2) < found.probability(0.2, size_known=True)
    assert solved.size.as_given < 0.1
    assert not found.has_finding(What.OTHER_SIZE, What.NOT_LEVEL)


@examples(8)
@given(generators(), numbers(98.0, 110.0), numbers(-6.0, 6.0))
def test_a_size_that_a_person_told_is_doubted_where_labels_tell_another(rng, length, off):
    frame = observe(soccer(length, 68.0), WIDE, rng, 0.5, per_line=9, per_curve=12)
    (right,) = calibrate_batch(soccer(length, 68.0, size_known=True), [frame], SIZE)
    assert not doubted_for_size(right).has_finding(What.OTHER_SIZE)
    (wrong,) = calibrate_batch(soccer(length + off, 68.0, size_known=True), [frame], SIZE)
    doubted = doubted_for_size(wrong)
    if abs(off) > 2.0 and wrong.accepted:
        (finding,) = (one for one in doubted.findings if one.what is What.OTHER_SIZE)
        assert abs(finding.numbers[0] - length) < 1.5
    nothing_told = calibrate_batch(soccer(length + off, 68.0), [frame], SIZE)[0]
    assert doubted_for_size(nothing_told) is nothing_told


@pytest.fixture(scope="module")
def network():
    return SegmentationNetwork.load()


@pytest.fixture(scope="module")
def pictures():
    cameras = [Camera.from_angles(pan, 1.3, 0.0, 850.0, (0.0, 66.0, -25.0), SIZE) for pan in (-0.25, 0.0, 0.25)]
    return [render_field(camera, soccer(105.0, 63.0)) for camera in cameras]


@pytest.mark.slow
def test_pictures_tell_the_width_of_their_pitch(network, pictures):
    found = calibrate_from_images(FIELD, pictures, network)
    nominal = calibrate_from_images(FIELD, pictures, network, estimate_size=False)
    known = calibrate_from_images(soccer(size_known=True), pictures, network)
    assert all(one.accepted for one in found)
    assert np.all(np.abs([one.field.width - 63.0 for one in found]) < 0.7)
    assert [one.field.width for one in (*nominal, *known)] == 6 * [68.0]
    assert np.median([one.rms for one in found]) < np.median([one.rms for one in nominal])
    told = [one for one in known if one.has_finding(What.OTHER_SIZE)]
    assert len(told) >= 2
    assert all(one.verdict is Verdict.CHECK for one in told)
    assert not any(one.has_finding(What.OTHER_SIZE) for one in calibrate_from_images(RIGHT_SIZE, pictures, network))


@pytest.mark.slow
def test_run_estimates_unless_it_is_told_not_to(tmp_path, pictures, capsys):
    for index, picture in enumerate(pictures):
        cv2.imwrite(str(tmp_path / f"{index}.png"), picture)
    inputs = sorted(tmp_path.glob("*.png"))
    widths = {}
    for name, options in (("own", []), ("nominal", ["--field-size", "nominal"]), ("one", ["--same-field"])):
        assert run("run", *inputs, "--out", tmp_path / name, *options) == 0
        widths[name] = [line["field"]["width"] for line in lines_of(tmp_path / name)]
    assert np.all(np.abs(np.array(widths["own"]) - 63.0) < 0.7)
    assert widths["nominal"] == 3 * [68.0]
    assert len(set(widths["one"])) == 1
    assert abs(widths["one"][0] - 63.0) < 0.4
    (said,) = (line for line in capsys.readouterr().err.splitlines() if "the images show a field of 105." in line)
    assert summary_of(tmp_path / "one")["notes"][-1] in said
    assert len(lines_of(tmp_path / "own")[0]["field_standard_deviations"]) == 2
    assert run("run", *inputs, "--out", tmp_path / "no", "--same-field", "--field-size", "known") == 2


def test_a_field_that_no_frame_tells_keeps_its_size():
    nothing = calibrate_batch(soccer(size_known=True), [{}], SIZE)
    assert shared_size(FIELD, nothing).field is FIELD
    assert not shared_size(FIELD, nothing).is_told


@pytest.mark.slow
def test_a_size_that_is_not_shared_is_nominal():
    """Not estimated, and not known: it is in the errors from the centre mark."""
    rng, tripod = np.random.default_rng(0), panned(8, first=-0.5, last=0.5)
    frames = [observe(soccer(101.0, 68.0), camera, rng, 0.3) for camera in tripod]
    shared = ("centre", "principal point", "lens", "zoom law")
    free, nominal = (calibrate_sequence(FIELD, frames, SIZE, **how) for how in ({}, {"shared": shared}))
    assert abs(free.field.length - 101.0) < 0.5
    assert (nominal.field.length, nominal.field.width) == (105.0, 68.0)
    assert "length" not in nominal.shared
    block = nominal.layout.field_size_block
    deviations = np.sqrt(np.diagonal(nominal[0].covariance))[block]
    assert np.all(deviations > 2.0)
