"""The whole flow: from labelled pixels to a camera."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from objects import relative_error
from one_camera import CAMERA, FIELD, FRAME, MARKINGS, SIZE, F
from strategies import angle, examples, generators, labelled_frames, numbers, vectors
from synthetic import gaussian_prior, observe, random_frames

from fieldcalib import Arc, Calibration, Camera, Line, Point, PointCloud, calibrate_batch, calibrate_from_segments
from fieldcalib.assess import Finding, Verdict
from fieldcalib.assess.findings import What
from fieldcalib.assess.probability import largest_move
from fieldcalib.fields import CameraDistribution
from fieldcalib.fields.traits import MAIN_CENTER
from fieldcalib.io.soccernet import parse_annotation
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import POSE_AND_ZOOM, GaussianPrior, gaussian_priors
from fieldcalib.problem.observations import pack
from fieldcalib.solve.request import Task
from fieldcalib.solve.search import _best, _without_lens
from fieldcalib.solve.solver_options import DEFAULT_FLAGS, PINHOLE_FLAGS


@pytest.mark.slow
def test_frames_without_noise_give_back_their_cameras():
    """Five or more segments, from every distribution, no prior in the final solve: 99 % to 1e-6."""
    frames, cameras = random_frames(50, seed=11)
    errors = []
    for frame, truth in zip(frames, cameras, strict=True):
        camera = calibrate_from_segments(FIELD, frame, SIZE, prior=None).camera
        errors.append(relative_error(camera, truth))
    assert np.mean(np.array(errors) < 1e-6) >= 0.99, sorted(errors)[-3:]


@pytest.mark.slow
def test_a_batch_of_them_too():
    frames, cameras = random_frames(400, seed=12)
    found = calibrate_batch(FIELD, frames, SIZE, prior=None)
    errors = [relative_error(c.camera, truth) for c, truth in zip(found, cameras, strict=True)]
    assert np.mean(np.array(errors) < 1e-6) >= 0.99, sorted(errors)[-8:]


@pytest.mark.parametrize("loss", ["cauchy", "linear", pytest.param("huber", marks=pytest.mark.slow)])
def test_one_frame_and_a_batch_agree(loss):
    """SciPy's `least_squares` and the batched solver have the same minimum, and stop there alike."""
    frames, _ = random_frames(8, seed=13, noise=1.0, stands=("main center", "main left"))
    for together, frame in zip(calibrate_batch(FIELD, frames, SIZE, loss=loss), frames, strict=True):
        alone = calibrate_from_segments(FIELD, frame, SIZE, loss=loss)
        assert alone.status is together.status
        assert alone.rms == pytest.approx(together.rms, rel=1e-6)
        assert relative_error(alone.camera, together.camera) < 1e-6
        assert alone.loss_ndc == pytest.approx(together.loss_ndc, rel=1e-6)
        np.testing.assert_allclose(alone.covariance, together.covariance, rtol=1e-5, atol=1e-9)
        assert list(alone.per_segment_errors) == list(frame)


@given(
    pan=angle(np.pi),
    tilt=numbers(0.0, 50.0),
    roll=angle(0.05),
    fov=numbers(40.0, 85.0),
    at=vectors((-10.0, -8.0), (10.0, 8.0)),
    rng=generators(),
)
@example(pan=1.5, tilt=0.0, roll=0.0, fov=40.0, at=np.array([-6.25, -5.0]), rng=np.random.default_rng(0))
@examples(40)
def test_views_from_above_are_good_by_their_ground(pan, tilt, roll, fov, at, rng):
    """Where height and focal length are open against one another, a finding says so, and the camera is a likely one."""
    f = 480.0 / np.tan(np.radians(fov) / 2.0)
    up, tilt = f * FIELD.length / SIZE[0], np.radians(tilt)  # about the whole field is in view
    back = up * np.tan(tilt)
    C = (at[0] - back * np.sin(pan), at[1] + back * np.cos(pan), -up)
    truth = Camera.from_angles(pan, tilt, roll, f, C, SIZE)
    found = calibrate_from_segments(FIELD, observe(MARKINGS, truth, rng, noise=0.5), SIZE)
    assert found.verdict is Verdict.GOOD
    assert largest_move(truth, found.camera, FIELD) < FIELD.tolerance
    off = abs(np.log(found.camera.focal_length / f))
    assert off < 0.3 or found.has_finding(What.GROUND_ONLY)
    assert -200.0 < found.camera.C[2] < -20.0


def test_only_the_ground_is_known_from_straight_above():
    above = Camera.from_angles(0.1, 0.0, 0.0, 800.0, (2.0, 1.0, -90.0), SIZE)
    frame = observe({label: s for label, s in MARKINGS.items() if "Goal" not in label}, above)
    found = calibrate_from_segments(FIELD, frame, SIZE)
    assert found.verdict is Verdict.GOOD
    assert str(Finding(What.GROUND_ONLY)) in found.reason
    assert found.field_uncertainty([480, 270]).rms < 0.2
    assert 10.0 < found.std_deviations[1][5, 0] < 60.0  # m, of the distance along the optical axis
    assert Finding(What.GROUND_ONLY) in Calibration.from_dict(found.to_dict()).findings
    assert calibrate_from_segments(FIELD, frame, SIZE, prior="main center").verdict is Verdict.REJECT


def test_twice_is_the_same():
    frames, _ = random_frames(5, seed=14, noise=1.0)
    first, second = (calibrate_batch(FIELD, frames, SIZE) for _ in range(2))
    assert [c.camera for c in first] == [c.camera for c in second]
    assert calibrate_from_segments(FIELD, frames[0], SIZE) == calibrate_from_segments(FIELD, frames[0], SIZE)


# Frames as annotators leave them: most of what the camera sees, some pixels off.
frames_of_the_camera = labelled_frames(FRAME, numbers(0.0, 3.0), least=6)


@examples(15)
@given(data=st.data(), frame=frames_of_the_camera)
def test_the_order_of_labels_and_pixels_does_not_matter(data, frame):
    labels = data.draw(st.permutations(list(frame)))
    shuffled = {label: np.array(data.draw(st.permutations(frame[label].tolist()))) for label in labels}
    one, other = calibrate_batch(FIELD, [frame, shuffled], SIZE)
    assert relative_error(one.camera, other.camera) < 3e-5


@examples(15)
@given(frame=frames_of_the_camera, factor=st.sampled_from([2, 3]))
def test_an_enlarged_frame_has_the_same_camera(frame, factor):
    enlarged = {label: factor * xy for label, xy in frame.items()}
    size = (factor * SIZE[0], factor * SIZE[1])
    small, large = (calibrate_from_segments(FIELD, f, s) for f, s in ((frame, SIZE), (enlarged, size)))
    assert relative_error(large.camera, small.camera.scaled(size)) < 3e-5
    assert large.rms == pytest.approx(factor * small.rms, rel=1e-4)


@examples(15)
@given(frame=frames_of_the_camera)
def test_a_mirrored_frame_has_the_mirrored_camera(frame):
    """Left and right exchanged, in the image and in the labels."""
    swap = str.maketrans({"<": "right", ">": "left"})
    mirrored = {}
    for label, xy in frame.items():
        name = label.replace("left", "<").replace("right", ">").translate(swap)
        mirrored[name] = (SIZE[0] - xy[:, 0])[:, None] * (1.0, 0.0) + xy * (0.0, 1.0)
    one, other = calibrate_batch(FIELD, [frame, mirrored], SIZE)
    assert other.camera.focal_length == pytest.approx(one.camera.focal_length, rel=1e-4)
    np.testing.assert_allclose(other.camera.C, one.camera.C * (-1.0, 1.0, 1.0), atol=0.01)


def test_noise_moves_the_camera_little():
    frames = [observe(MARKINGS, CAMERA, np.random.default_rng(seed), noise=1.0) for seed in range(20)]
    found = calibrate_batch(FIELD, frames, SIZE, flags=PINHOLE_FLAGS)
    errors = [one.camera.focal_length / CAMERA.focal_length - 1.0 for one in found]
    assert np.median(np.abs(errors)) < 0.01


def test_a_wrong_label_among_many_hardly_moves_the_camera():
    frame = observe(MARKINGS, CAMERA, np.random.default_rng(0), noise=0.5)
    wrong = {**frame, "Small rect. left top": frame["Big rect. left top"]}
    found = calibrate_from_segments(FIELD, wrong, SIZE)
    assert relative_error(found.camera, CAMERA) < 0.03
    assert max(found.per_segment_errors, key=found.per_segment_errors.get) == "Small rect. left top"


def frame_seen(camera, labels):
    """Every second metre in view of some markings."""
    seen = {label: camera.project(FIELD[label].sample(2.0)) for label in labels}
    return {label: xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)] for label, xy in seen.items()}


def test_trusted_labels_that_no_camera_explains_are_tried_from_other_heights():
    camera = Camera.from_angles(-0.08, 1.13, -0.01, 1360.0, (-46.0, 44.0, -35.0), SIZE)
    labels = ("Side line top", "Side line left", "Small rect. left top", "Goal left post right", "Circle left")
    found = calibrate_from_segments(FIELD, frame_seen(camera, labels), SIZE, trust_labels=True)
    assert found.verdict is Verdict.GOOD
    assert found.rms < 0.3


@given(x=numbers(-12.0, 12.0))
@examples(10)
def test_a_camera_has_the_prior_of_the_nearest_stand(x):
    camera = Camera.from_angles(0.25 - 0.01 * x, 1.45, 0.0, 1500.0, (x, 69.0, -9.0), SIZE)
    labels = ("Side line top", "Side line bottom", "Side line right", "Big rect. right top", "Circle central")
    found = calibrate_from_segments(FIELD, frame_seen(camera, labels), SIZE).solved.evaluation
    of_stands = gaussian_priors(FIELD.stands, found.problem.layout)

    def distance(prior):
        return np.sum(prior.z_scores(found.theta)[:, POSE_AND_ZOOM] ** 2, axis=1)

    assert distance(found.problem.prior) < np.min(distance(of_stands)) + 0.5


def test_a_camera_below_the_ground_does_not_win():
    """Seen from below, a plane without posts looks the same: the start below must lose although it fits as well."""
    flat = {label: xy for label, xy in FRAME.items() if "Goal" not in label}
    found = calibrate_from_segments(FIELD, flat, SIZE, prior=None)
    assert found.accepted
    assert found.camera.C[2] < 0.0


def test_a_plausible_start_goes_before_a_cheaper_one_below_the_ground():
    """Lines on a plane have the same image for the camera mirrored in it, which would look at them from behind."""
    options = Task(FIELD, criteria=(3, 50, 1e-9)).options(SIZE)
    theta = options.layout.theta(CAMERA)
    below = Camera(CAMERA.K, CAMERA.R @ np.diag([-1.0, -1.0, 1.0]), CAMERA.C * (1.0, 1.0, -1.0), SIZE)
    flat = {label: xy for label, xy in FRAME.items() if "Goal" not in label and "Circle" not in label}
    observations = pack(FIELD, [flat], SIZE)
    pair = np.array([theta, options.layout.theta(below)])
    sigma = np.tile(gaussian_prior(MAIN_CENTER, options.layout).sigma, (2, 1))
    prior = GaussianPrior(pair - np.array([[0.5], [0.0]]) * sigma, sigma)  # the one below is cheaper by its prior
    frame = np.array([0, 0])
    wide = Problem(observations.take(frame), _without_lens(options), options.wide_loss, options.noise, prior)
    evaluation = evaluate(wide, pair)
    above, cheaper = evaluation.cost
    assert cheaper < above
    (best,) = _best(evaluation, frame, 1, options)
    np.testing.assert_array_equal(evaluation.theta[best], pair[0])


def test_densely_labelled_frames_are_solved_a_few_at_a_time():
    from fieldcalib.problem.labelled_pixels import PixelTable
    from fieldcalib.solve.batch import CHUNK, CHUNK_PIXELS, _chunks

    frames = [{"Middle line": np.zeros((count, 2))} for count in [0, 3, 100, 5000, 20000, *[30] * 200]]
    chunks = list(_chunks(FIELD, PixelTable.of(FIELD, frames)))
    assert sorted(np.concatenate(chunks).tolist()) == list(range(1, len(frames)))
    for chunk in chunks:
        assert len(chunk) <= CHUNK
        largest = max(len(frames[t]["Middle line"]) for t in chunk)
        assert len(chunk) == 1 or len(chunk) * largest <= CHUNK_PIXELS


def test_an_object_that_is_no_field_needs_to_say_where_its_camera_stands():
    line = {"edge": Line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))}
    with pytest.raises(ValueError, match="the object is not a Field: make it one"):
        calibrate_from_segments(line, {"edge": [(1, 2), (300, 4)]}, SIZE)


# --- objects that are no field ---


def test_a_table_can_be_calibrated_against():
    """A round table 1.2 m wide with a tray, a pole and a scratch: lines, a circle, points, clouds, in metres."""
    s = np.linspace(0.0, 1.0, 40)
    table = {
        "edge": Arc((0.0, 0.0, -0.75), 0.6),
        "tray front": Line((-0.25, 0.15, -0.75), (0.25, 0.15, -0.75)),
        "tray left": Line((-0.25, 0.15, -0.75), (-0.25, -0.2, -0.75)),
        "pole": Line((0.3, -0.1, -0.75), (0.3, -0.1, -1.6)),
        "screw": Point((0.1, -0.05, -0.75)),
        "scratch": PointCloud(np.stack([0.5 * s - 0.3, 0.3 * s**2 - 0.4, 0.0 * s - 0.75], axis=1), ordered=True),
        "crumbs": PointCloud([(-0.1, 0.0, -0.75), (-0.15, 0.05, -0.75), (0.0, 0.3, -0.75)]),
    }
    camera = Camera.from_angles(0.2, 1.15, 0.03, 1200.0, (-0.5, 2.2, -1.9), (1280, 720))
    frame = observe({label: table[label] for label in ("edge", "tray front", "tray left", "pole")}, camera)
    frame |= {label: camera.project(table[label].sample()) for label in ("screw", "scratch", "crumbs")}
    room = CameraDistribution("in the room", (-40, 40), (45, 90), (-10, 10), (30, 90), (-2, 2), (1, 4), (-2.5, -1))
    found = calibrate_from_segments(table, frame, (1280, 720), prior=room)
    assert found.accepted, found.message
    assert relative_error(found.camera, camera) < 1e-2
    rvec, tvec, K, _ = found.camera.to_opencv()
    guess = F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_USE_EXTRINSIC_GUESS
    exact = calibrate_from_segments(
        table, frame, (1280, 720), K, None, rvec, tvec, flags=DEFAULT_FLAGS | guess, prior=None
    )
    assert relative_error(exact.camera, camera) < 1e-6


def test_field_points_can_be_labelled_by_name():
    names = [name for name, xy in ((n, CAMERA.project(p.X)) for n, p in FIELD.points.items()) if 0 < xy[0] < 960]
    points = {name: CAMERA.project(FIELD[name].X)[None] for name in names}
    inside = {name: xy for name, xy in points.items() if 0 < xy[0, 1] < 540}
    assert len(inside) >= 6
    assert relative_error(calibrate_from_segments(FIELD, inside, SIZE, prior=None).camera, CAMERA) < 1e-6


# --- real annotations ---


@pytest.mark.slow
@pytest.mark.parametrize(
    ("folder", "size", "median_rms", "below_tau"),
    [("sncalib-test-center", (960, 540), 1.6, 0.94), ("wc14-test", (1280, 720), 1.9, 0.99)],
)
def test_real_annotations(shared_data, folder, size, median_rms, below_tau):
    files = sorted(f for f in (shared_data / folder).glob("*.json") if f.stem.isdigit())
    frames = [parse_annotation(f.read_text(), size) for f in files]
    found = calibrate_batch(FIELD, frames, size)
    assert all(c.camera is not None for c in found)
    assert np.median([c.rms for c in found]) < median_rms
    assert np.mean([c.loss_ndc < 0.019 for c in found]) > below_tau
    assert np.mean([c.accepted for c in found]) > 0.98
    # the main stand's camera stands above ground near the middle line's extension, wherever it looks
    C = np.array([c.camera.C for c in found])
    assert np.mean((np.abs(C[:, 0]) < 20.0) & (C[:, 1] > 30.0) & (C[:, 2] < -3.0)) > 0.95
