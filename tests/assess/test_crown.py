"""Fields that may be higher in the middle than at their touchlines: derivatives, evidence, errors."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm
from strategies import cameras

from data_tools.crown import crowned
from data_tools.probability import largest_true_error
from data_tools.synthetic.clips import labelled
from data_tools.synthetic.paths import camera_path
from fieldcalib import Camera, calibrate_from_segments, calibrate_sequence, soccer
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.ground import ground_derivatives, ground_of_pixels
from fieldcalib.assess.ground_points import locate_on_ground
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.size_evidence import SizeEvidence
from fieldcalib.fields import Ground, american_football, field_hockey, rugby_union, tennis
from fieldcalib.fields.records import field_from_record, whole_record
from fieldcalib.fields.traits import GRASS
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import Layout, SizeBlock
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.problem.projection import Projection
from fieldcalib.problem.records import layout_from_record, layout_to_record
from fieldcalib.solve.field_size import estimate_field_size

SIZE = (960, 540)
FIELD = soccer()
MODEL = FIELD.size_model
BLOCK = SizeBlock(np.array([105.0, 68.0]), MODEL.sigma, MODEL.limits, MODEL.possibilities, FIELD.crown)
LOW = 1e-4  # m: a crown that is so low acts to first order

high_cameras = cameras(lens=True, stands=("main tribune",)).filter(lambda camera: camera.C[2] < -8.0)


def layout_of(camera):
    return Layout.of(camera.image_size, camera.lens, BLOCK)


@given(high_cameras)
def test_pixels_of_a_crowned_field_lie_off_a_level_one_as_the_derivative_says(camera):
    terrain, frame = FIELD.with_ground(Ground(LOW)).terrain, {}
    for label, segment in FIELD.items():
        xy = camera.project(terrain.raised(segment.sample(3.0)))
        inside = np.all((xy > 0.0) & (xy < np.array(camera.image_size) - 1.0), axis=-1)  # NaN: behind the camera
        if np.any(inside) and label not in FIELD.half_labels:
            frame[label] = xy[inside]
    layout = layout_of(camera)
    observations = pack(FIELD, [frame], camera.image_size, motion=FIELD.motion)
    found = evaluate(Problem(observations, layout, RobustLoss("linear", 1.0)), layout.theta(camera)[None])
    (by_crown,) = found.derivatives(layout.is_crown)[0]
    np.testing.assert_allclose(
        found.r[0], -LOW * by_crown, atol=0.05 * LOW * max(np.max(np.abs(by_crown), initial=0.0), 1.0)
    )


@given(high_cameras, st.floats(-50.0, 50.0), st.floats(-33.0, 33.0))
def test_a_camera_of_a_level_field_takes_points_of_a_crowned_one_for_others(camera, x, y):
    X = np.array([x, y, 0.0])
    xy = camera.project(FIELD.with_ground(Ground(LOW)).terrain.raised(X))
    layout = layout_of(camera)
    projection = Projection(layout.theta(camera)[None], layout)
    taken_for, known = ground_of_pixels(projection, np.reshape(xy, (1, 1, 2)))
    if not known[0, 0]:
        return
    by_crown = ground_derivatives(projection, taken_for, known, layout.is_crown)[0, 0, :, 0]
    off = X[:2] - taken_for[0, 0, :2]
    np.testing.assert_allclose(LOW * by_crown, off, atol=1e-3 * np.linalg.norm(off) + 1e-9)


def test_the_crown_of_a_single_frame_is_considered():
    layout = layout_of(Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE))
    assert layout.names[-3:] == ("length", "width", "crown")
    assert np.array(layout.names)[layout.considered].tolist() == ["crown"]
    assert not np.any(layout.free[layout.crown_block])


def test_layouts_and_fields_keep_their_crown_in_records():
    layout = layout_of(Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE))
    record = json.loads(json.dumps(layout_to_record(layout)))
    back = layout_from_record(record)
    assert back.names == layout.names
    assert back.field_size.crown == FIELD.crown
    del record["field_size"]["crown"], record["roles"][-1]
    assert layout_from_record(record).names == layout.names[:-1]  # files of before: level
    whole = json.loads(json.dumps(whole_record(FIELD)))
    field = field_from_record(whole)
    assert (field.size_model, field.crown) == (MODEL, FIELD.crown)
    crown = list(whole.pop("crown").values())
    assert field_from_record({**whole, "size_model": {**whole["size_model"], "crown": crown}}) == field  # as before
    level = field_from_record({**whole, "size_model": {**whole["size_model"], "crown": None}})
    assert level == replace(field, crown=None)
    with pytest.raises(ValueError, match="Crown"):
        replace(field, crown=0.3)
    for wrong in (0.3, [0.3], [2.0, 0.2]):
        with pytest.raises(ValueError, match=r"^(size_model|crown): "):
            field_from_record({**whole, "size_model": {**whole["size_model"], "crown": wrong}})


def labelled_path(crown, every=25, seed=3, roof=False, field=FIELD):
    """Labels of frames of a panning camera over a pitch that is crowned, and the cameras."""
    rng = np.random.default_rng(seed)
    path = camera_path(rng, 300, pan_range=(-0.6, 0.6), image_size=SIZE)[::every]
    pitch = crowned(field, crown, roof=roof) if crown else field
    return [one.pixels for one in labelled(path, pitch, rng)], path


def clip(crown, field=FIELD, roof=False):
    """Frames of a clip over a pitch that is crowned, calibrated together, and their cameras."""
    pixels, path = labelled_path(crown, roof=roof, field=field)
    return calibrate_sequence(field, pixels, SIZE, trust_labels=True), path


def errors_of(found, path, crown, roof=False):
    """Largest errors of the cameras on that pitch, metres."""
    pairs = zip(found, path, strict=True)
    return [largest_true_error(one.camera, true, one.field, FIELD, crown=crown, roof=roof) for one, true in pairs]


@pytest.mark.parametrize("crown", [0.2, pytest.param(0.4, marks=pytest.mark.slow)])
def test_frames_of_a_tripod_estimate_the_crown_of_their_pitch(crown):
    found, path = clip(crown)
    height, sigma = found.shared["crown"]
    assert height == found.field.ground.crown
    assert abs(height - crown) < 4.0 * sigma < 0.12  # a parabola is another profile
    assert found.crown == pytest.approx(np.hypot(height, sigma), rel=0.2)
    assert {one.verdict for one in found} == {Verdict.GOOD}
    assert np.max(errors_of(found, path, crown)) < 0.6  # 0.51 of the parabola of 0.4 m
    back = type(found).from_dict(json.loads(json.dumps(found.to_dict())))
    assert back.field.ground == found.field.ground
    assert back == found


@pytest.mark.parametrize(
    "field",
    [rugby_union(), *(pytest.param(one, marks=pytest.mark.slow) for one in (american_football(), field_hockey()))],
)
def test_fields_of_other_sports_are_crowned_like_a_pitch(field):
    found, path = clip(0.3, field)
    height, sigma = found.shared["crown"]
    assert abs(height - 0.3) < 4.0 * sigma < 0.12
    assert (found.field.size_model is None) == ("length" not in found.shared)
    pairs = zip(found, path, strict=True)
    assert max(largest_true_error(one.camera, true, one.field, field, crown=0.3) for one, true in pairs) < 0.5


@pytest.mark.slow
def test_frames_of_a_field_of_exact_size_tell_its_crown():
    field = american_football()
    frames = labelled_path(0.4, every=20, seed=5, field=field)[0]
    found = estimate_field_size(field, frames, SIZE)
    assert abs(found.crown.height - 0.4) < 0.03
    assert (found.field.ground.crown, found.length, found.width) == (found.crown.height, field.length, field.width)
    np.testing.assert_array_equal(found.interval, [[field.length, field.width]] * 2)
    assert str(found) == (f"length: {field.length:.2f} m; width: {field.width:.2f} m; crown: 0.38 ± 0.01 m")
    assert estimate_field_size(field, labelled_path(0.0, every=20, seed=5, field=field)[0], SIZE).field == field
    with pytest.raises(ValueError, match="expected a field"):
        estimate_field_size(tennis(), frames, SIZE)


@given(st.floats(0.02, 0.6), st.floats(0.02, 0.3))
def test_a_crown_alone_is_estimated_as_with_a_size_that_is_exact(offset, sigma):
    """The mixture of a level and a crowned field, by the formulas of one dimension."""
    share, height = GRASS.share, GRASS.height
    found = SizeEvidence.of(
        np.array([[sigma**-2]]),
        np.array([-offset * sigma**-2]),
        np.array([[sigma**-2]]),
        (GRASS.possibilities[0], GRASS.possibilities[1][:, None]),
    )
    odds = share / (1.0 - share) * norm.pdf(offset, 0.0, np.hypot(sigma, height)) / norm.pdf(offset, 0.0, sigma)
    assert np.isclose(found.weights[1] / found.weights[0], odds, rtol=1e-3)
    shrunk = height**2 / (sigma**2 + height**2)
    np.testing.assert_allclose(found.mean, shrunk * offset, rtol=1e-3)
    np.testing.assert_allclose(found.moments[1, 0, 0], (shrunk * offset) ** 2 + shrunk * sigma**2, rtol=1e-3)


def test_a_pitch_built_like_a_roof_is_explained_to_decimetres():
    found, path = clip(0.3, roof=True)
    assert abs(found.field.ground.crown - 0.3) < 0.06
    assert np.median(errors_of(found, path, 0.3, roof=True)) < 0.5


def test_a_clip_of_a_level_pitch_comes_back_level():
    found, _ = clip(0.0)
    assert found.field.ground is None
    assert "crown" not in found.shared
    assert found.crown < 0.04


@pytest.mark.slow
def test_the_crown_of_a_pitch_of_known_size_is_estimated():
    found, path = clip(0.3, soccer(size_known=True))
    assert abs(found.field.ground.crown - 0.3) < 0.05
    assert (found.field.length, found.field.width) == (105.0, 68.0)
    assert not {"length", "width"} & found.shared.keys()
    assert np.max(errors_of(found, path, 0.3)) < 0.6


def test_a_camera_that_moves_does_not_estimate_the_crown():
    found = calibrate_sequence(FIELD, labelled_path(0.3)[0], SIZE, shared=("lens", "field size"), trust_labels=True)
    assert found.together
    assert "crown" not in found.shared
    assert found.field.ground is None


def test_a_known_crown_is_not_estimated():
    found, path = clip(0.3, FIELD.with_ground(Ground(0.3)))
    assert "crown" not in found.shared
    assert found.field.ground == Ground(0.3)
    assert np.max(errors_of(found, path, 0.3)) < 0.6


@pytest.mark.slow
def test_stills_of_one_crowned_pitch_share_its_ground():
    found = estimate_field_size(FIELD, labelled_path(0.4, every=6, seed=5)[0], SIZE)
    assert found.crown is not None
    assert abs(found.field.ground.crown - 0.4) < 0.08  # a parabola is another profile
    assert "crown: 0." in str(found)
    level = estimate_field_size(FIELD, labelled_path(0.0, every=6, seed=5)[0], SIZE)
    assert level.crown is None
    assert level.field.ground is None


def test_stills_of_one_end_tell_ground_that_level_cameras_fit_badly():
    terrain, rng, frames = FIELD.with_ground(Ground(0.7)).terrain, np.random.default_rng(1), []
    for pan in np.linspace(0.5, 0.8, 6):
        camera = Camera.from_angles(pan, 1.37, 0.0, 2.0 * SIZE[0], (-5.0, 56.0, -16.0), SIZE)
        seen = {label: camera.project(terrain.raised(segment.sample(2.0))) for label, segment in FIELD.items()}
        inside = {label: xy[np.all((xy > 0.0) & (xy < np.array(SIZE) - 1.0), axis=1)] for label, xy in seen.items()}
        noisy = {label: xy + rng.normal(0.0, 0.5, xy.shape) for label, xy in inside.items() if len(xy) > 1}
        frames.append(noisy)
    found = estimate_field_size(FIELD, frames, SIZE)
    assert found.crown is not None
    assert abs(found.crown.height - 0.7) < 0.1
    assert found.crown.sigma < 0.1


def test_places_on_a_crowned_field_and_their_errors():
    field = soccer(size_known=True).with_ground(Ground(0.4))
    camera = Camera.from_angles(0.2, 1.33, 0.0, 1300.0, (3.0, 62.0, -17.0), SIZE)
    labels = ("Side line top", "Middle line", "Circle central", "Big rect. right main", "Big rect. right top")
    truth = {label: camera.project(field.terrain.raised(field[label].sample(4.0))) for label in labels}
    pixels = {label: xy[np.all((xy > 0) & (xy < np.array(SIZE) - 1), axis=1)] for label, xy in truth.items()}
    found = calibrate_from_segments(field, {k: xy for k, xy in pixels.items() if len(xy)}, SIZE)
    X = np.array([[10.0, 0.0, 0.0], [20.0, -12.0, 0.0]])
    places = locate_on_ground(found, found.project(field.terrain.raised(X)), pixel_sd=0.0)
    np.testing.assert_allclose(places.X, field.terrain.raised(X), atol=1e-3)
    np.testing.assert_allclose(found.uncertainty.at_field(X).covariance, places.covariance, rtol=1e-3)
    with pytest.raises(ValueError, match="z = 0"):
        found.uncertainty.at_field([[0.0, 0.0, -2.0]])


def test_a_picture_of_a_crowned_pitch_is_less_probably_right_in_metres():
    camera = Camera.from_angles(0.3, 1.32, 0.0, 1300.0, (3.0, 62.0, -17.0), SIZE)
    rng = np.random.default_rng(0)
    level, low, raised = (
        calibrate_from_segments(FIELD, labelled([camera], pitch, rng)[0].pixels, SIZE)
        for pitch in (FIELD, crowned(FIELD, 0.1), crowned(FIELD, 0.35))
    )
    assert raised.probability() < low.probability() < level.probability()
    assert low.probability() < low.probability(size_known=True)  # on the field as given, which is level
    back = Calibration.from_dict(json.loads(json.dumps(raised.to_dict())))
    assert back.probability() == pytest.approx(raised.probability(), abs=1e-6)
