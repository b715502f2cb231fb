"""Frames of one tripod calibrated together."""

import json

import numpy as np
import pytest
from synthetic import whole_circle_markings

from data_tools.simulated import observe
from data_tools.synthetic.clips import labelled
from data_tools.synthetic.paths import camera_path
from fieldcalib import CalibrationFlags, Camera, SequenceCalibration, calibrate_batch, soccer
from fieldcalib.fields import badminton
from fieldcalib.fields.field import Field
from fieldcalib.fields.traits import CameraDistribution
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.layout import CENTER
from fieldcalib.solve.request import Task
from fieldcalib.solve.sequence.joint_solution import LARGEST_SIZE_SIGMA, Start, solved_with_known_sizes
from fieldcalib.solve.sequence.sequence_problem import SHARED, SequenceProblem
from fieldcalib.solve.sequence.sequence_solver import _with_more_labels, calibrate_sequence
from fieldcalib.solve.sequence.tripod_position import voted_centres

FIELD = soccer()
SIZE = (1920, 1080)


def clip(seed, count=12, **kwargs):
    """Cameras of a synthetic clip, and their frames with 1 px noise."""
    rng = np.random.default_rng(seed)
    cameras = camera_path(rng, 300)[:: 300 // count][:count]
    return cameras, labelled(cameras, FIELD, rng, 1.0, **kwargs)


def pixels(frames):
    return [frame.pixels for frame in frames]


def centre(found):
    return found.values[:3]


@pytest.mark.slow
def test_the_tripod_is_where_it_is_and_single_frames_are_worse():
    errors = []
    for seed in range(3):
        cameras, frames = clip(seed)
        together = calibrate_sequence(FIELD, pixels(frames), SIZE)
        alone = calibrate_batch(soccer(size_known=True), pixels(frames), SIZE)
        assert all(frame.accepted for frame in together)
        single = np.median([np.linalg.norm(c.camera.C - cameras[0].C) for c in alone])
        errors.append((np.linalg.norm(centre(together) - cameras[0].C), single))
        f = [abs(c.camera.focal_length / truth.focal_length - 1.0) for c, truth in zip(together, cameras, strict=True)]
        assert np.median(f) < 0.01
        off = np.abs([together.shared["length"][0] - 105.0, together.shared["width"][0] - 68.0])
        assert np.all(off < 1.0)
    both = np.array(errors)
    assert both[:, 0].max() < 0.7
    assert np.median(both[:, 0]) < 0.5 * np.median(both[:, 1])


def test_all_frames_have_what_they_share():
    _, frames = clip(3)
    found = calibrate_sequence(FIELD, pixels(frames), SIZE)
    shared = {name: value for name, (value, _) in found.shared.items()}
    assert found.names[:3] == ("x", "y", "z")
    assert found.covariance.shape == 2 * (len(found.names),)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0
    for frame in found:
        expected = centre(found) + shared["axis offset"] * frame.camera.R[2]
        np.testing.assert_allclose(frame.camera.C, expected, atol=1e-9)
    assert list(found[2:4]) == [found[2], found[3]]
    assert found[2:4].shared == found.shared
    assert len(found.cameras) == len(frames)
    assert (found.field.length, found.field.width) == (shared["length"], shared["width"])


def test_what_is_shared_is_in_the_uncertainty_of_every_frame():
    _, frames = clip(4)
    found = calibrate_sequence(FIELD, pixels(frames), SIZE)
    for frame in found:
        np.testing.assert_allclose(frame.covariance[CENTER, CENTER], found.covariance[:3, :3], rtol=1e-6)
        assert frame.uncertainty.at_image([960.0, 800.0]).rms > 0.0
        assert frame.probability() > 0.0
        back = json.loads(json.dumps(frame.to_dict()))
        np.testing.assert_allclose(type(frame).from_dict(back).covariance, frame.covariance, rtol=1e-4, atol=1e-9)


def test_a_sequence_survives_json():
    _, frames = clip(11, count=4)
    found = calibrate_sequence(FIELD, [*pixels(frames), {}], SIZE)
    back = SequenceCalibration.from_dict(json.loads(json.dumps(found.to_dict())))
    assert back == found
    assert list(back) == list(found)
    assert (back.names, back.together, back.field) == (found.names, found.together, found.field)
    np.testing.assert_array_equal(back.values, found.values)
    np.testing.assert_array_equal(back.covariance, found.covariance)
    empty = SequenceCalibration.from_dict(json.loads(json.dumps(calibrate_sequence(FIELD, [], SIZE).to_dict())))
    assert (len(empty), empty.values.shape, empty.covariance.shape) == (0, (0,), (0, 0))
    with pytest.raises(ValueError, match="expected a calibration of a sequence of version 3, got 7: another"):
        SequenceCalibration.from_dict({"version": 7})


@pytest.mark.slow
def test_more_frames_tell_more_until_paint_is_left():
    cameras, frames = clip(5, count=60)
    few = calibrate_sequence(FIELD, pixels(frames[::10]), SIZE)
    many = calibrate_sequence(FIELD, pixels(frames), SIZE)
    exact = calibrate_sequence(FIELD, pixels(frames), SIZE, paint=0.0)
    sigma = [np.sqrt(np.trace(found.covariance[:3, :3])) for found in (few, many, exact)]
    assert sigma[0] > sigma[1] > sigma[2]
    assert np.linalg.norm(centre(many) - cameras[0].C) < 3.0 * sigma[1]


@pytest.mark.slow
def test_wrong_labels_and_empty_frames_do_not_move_the_tripod():
    _, right = clip(6, count=20)
    cameras, frames = clip(6, count=20, wrong_share=0.3, empty_share=0.2)
    first, found = (calibrate_sequence(FIELD, pixels(some), SIZE) for some in (right, frames))
    assert np.linalg.norm(centre(found) - centre(first)) < 0.4
    assert np.linalg.norm(centre(found) - cameras[0].C) < 0.7
    empty = [not frame.pixels for frame in frames]
    assert any(empty)
    assert [camera is None for camera in found.cameras] == empty


def test_frames_of_another_camera_do_not_take_part():
    cameras, frames = clip(7, count=20)
    other = Camera.from_angles(0.0, 1.3, 0.0, 2600.0, (0.0, -75.0, -18.0), SIZE)
    others = labelled([other] * 4, FIELD, np.random.default_rng(0), 1.0)
    found = calibrate_sequence(FIELD, pixels(frames + others), SIZE)
    assert np.linalg.norm(centre(found) - cameras[0].C) < 0.7
    assert not any(frame.accepted for frame in found[20:])


def test_what_is_fixed_or_not_shared():
    _, frames = clip(8)
    plain = calibrate_sequence(FIELD, pixels(frames), SIZE, shared=["centre", "lens"])
    assert plain.names == ("x", "y", "z", "a1", "b2")
    assert plain.field.length == FIELD.length
    known = calibrate_sequence(soccer(size_known=True), pixels(frames), SIZE)
    assert "length" not in known.names
    flags = CalibrationFlags.CALIB_FIX_K1 | CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT
    fixed = calibrate_sequence(
        soccer(size_known=True), pixels(frames), SIZE, flags=flags | CalibrationFlags(_default_fixed())
    )
    assert fixed.names == ("x", "y", "z", "axis offset")


def _default_fixed():
    from fieldcalib import DEFAULT_FLAGS

    return int(DEFAULT_FLAGS)


def test_nothing_to_calibrate_from():
    nothing = calibrate_sequence(FIELD, [{}, {}], SIZE)
    assert nothing.cameras == [None, None]
    assert nothing.names == ()
    assert len(calibrate_sequence(FIELD, [], SIZE)) == 0
    assert voted_centres([], 1) == []


def test_one_frame_is_a_sequence():
    cameras, frames = clip(9, count=1)
    (found,) = calibrate_sequence(FIELD, pixels(frames), SIZE)
    assert found.accepted
    assert np.linalg.norm(found.camera.C - cameras[0].C) < 5.0


def test_what_cannot_be_shared_is_named():
    with pytest.raises(ValueError, match=r"frames cannot share \['zoom'\]: expected some of centre, principal point"):
        calibrate_sequence(FIELD, [], SIZE, shared=["zoom"])
    with pytest.raises(ValueError, match="frame 1: unknown label"):
        calibrate_sequence(FIELD, [{}, {"no such line": [(1.0, 2.0)]}], SIZE)
    with pytest.raises(ValueError, match=r"got the name 'lens': did you mean \('lens',\)\?"):
        calibrate_sequence(FIELD, [], SIZE, shared="lens")


def test_a_court_that_knows_its_stand():
    near = CameraDistribution("side", (-50, 50), (50, 85), (-5, 5), (15, 70), (-8, 8), (15, 30), (-9, -2))
    court = Field(105.0, 68.0, whole_circle_markings(FIELD), stands=(near,))
    truths = [
        Camera.from_angles(pan, 1.2, 0.0, 1500.0, (0.0, 45.0, -14.0), SIZE) for pan in (-0.5, -0.25, 0.0, 0.25, 0.5)
    ]
    frames = labelled(truths, court, np.random.default_rng(0), 1.0)
    wide = CameraDistribution("tower", (-60, 60), (40, 85), (-5, 5), (15, 70), (-20, 20), (30, 70), (-25, -5))
    found = calibrate_sequence(court, pixels(frames), SIZE, prior=wide)
    assert np.linalg.norm(centre(found) - (0.0, 45.0, -14.0)) < 0.5
    assert "length" not in found.names


def test_frames_that_no_camera_fits_share_nothing():
    rng = np.random.default_rng(0)
    labels = ["Side line top", "Middle line", "Big rect. left main", "Circle left", "Goal right crossbar"]
    noise = [{label: rng.uniform((0.0, 0.0), SIZE, (4, 2)) for label in labels} for _ in range(5)]
    found = calibrate_sequence(FIELD, noise, SIZE)
    assert len(found) == 5
    assert sum(frame.accepted for frame in found) <= 1


def test_a_size_that_the_frames_do_not_tell_is_kept_and_uncertain():
    labels = ("Side line top", "Middle line", "Circle central")
    _, frames = clip(10)
    middle = [{label: xy for label, xy in frame.pixels.items() if label in labels} for frame in frames]
    middle = [frame for frame in middle if len(frame) == 3]
    assert len(middle) >= 3
    nominal, known = (calibrate_sequence(field, middle, SIZE) for field in (FIELD, soccer(size_known=True)))
    assert "length" not in nominal.names
    assert (nominal.field.length, known.field.length) == (105.0, 105.0)
    assert (nominal.field.size_known, known.field.size_known) == (False, True)
    mark = (0.0, -34.0, 0.0)
    assert "width" not in nominal.names
    assert nominal[0].uncertainty.at_field(mark).rms > known[0].uncertainty.at_field(mark).rms


def shorter_pitch(pans, noise, length=98.0):
    """Labels of a shorter pitch in some frames of one tripod."""
    cameras = [Camera.from_angles(pan, 1.3, 0.0, 4000.0, (0.0, 60.0, -14.0), SIZE) for pan in pans]
    return pixels(labelled(cameras, soccer(length), np.random.default_rng(0), noise))


def test_a_size_that_the_frames_contradict_is_not_kept_however_uncertain_the_other_one_is():
    few = [{label: xy[::4] for label, xy in one.items()} for one in shorter_pitch((0.25, 0.35), 4.0)]
    found = calibrate_sequence(FIELD, few, SIZE)
    length, sigma = found.shared["length"]
    assert LARGEST_SIZE_SIGMA < sigma < 1.0
    assert not found.field.size_known  # it is estimated: nobody has said so
    assert abs(length - 98.0) < 3.0 * sigma


def test_further_frames_determine_a_size_that_the_first_ones_do_not():
    frames = shorter_pitch((-0.06, -0.02, 0.02, 0.06, 0.3, 0.32, 0.34, 0.36, 0.38, 0.4, 0.42, 0.44), 0.5)
    table = PixelTable.of(tuple(FIELD), frames)
    problem = SequenceProblem.of(Task(FIELD).options(SIZE), table, SHARED)
    middle = problem.calibrate_alone(np.arange(4), problem.options)
    first = solved_with_known_sizes(problem, Start.of(middle))
    assert "length" in first.fixed_sizes
    found = _with_more_labels(problem, first)
    assert found.labelled > first.labelled
    assert found.shared_parameters(problem).object_segments.length == pytest.approx(98.0, abs=0.5)


def test_a_size_that_the_frames_do_not_tell_is_as_given_from_cameras_on_another_one():
    """These are moved with it, along what the labels leave open."""
    frames = shorter_pitch((0.42, 0.45, 0.48, 0.51), 0.5, length=105.0)
    table, found = PixelTable.of(tuple(FIELD), frames), []
    problem = SequenceProblem.of(Task(FIELD).options(SIZE), table, SHARED)
    for field in (FIELD, soccer(101.0)):
        options = Task(field).options(SIZE)
        alone = SequenceProblem.of(options, table, SHARED).calibrate_alone(np.arange(len(frames)), options)
        found.append(solved_with_known_sizes(problem, Start.of(alone)))
    assert all("length" in one.fixed_sizes for one in found)
    given, moved = (one.evaluation.theta for one in found)
    assert np.all(moved[:, found[1].layout.names.index("length")] == 105.0)
    np.testing.assert_allclose(moved[:, CENTER], given[:, CENTER], atol=0.01)


def test_a_court_is_to_be_known_to_a_share_of_its_size():
    """What is little on a soccer pitch is much on a court of badminton: 15 cm are more than half of its tolerance."""
    field, rng = badminton(), np.random.default_rng(0)
    cameras = [Camera.from_angles(pan, 1.3, 0.0, 1400.0, (0.0, 14.0, -5.0), (960, 540)) for pan in (-0.02, 0.0, 0.02)]
    few = [{label: xy[::6] for label, xy in observe(camera, field, rng, noise=6.0).items()} for camera in cameras]
    found = calibrate_sequence(field, few, (960, 540))
    assert np.all((found.frames.ground_error > 0.5 * field.tolerance) & (found.frames.ground_error < 0.5))
    assert all("the field in view is known to 0.1" in one.reason for one in found)
    assert all(one.verdict != "good" for one in found)
