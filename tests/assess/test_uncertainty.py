"""Uncertainty: derivatives, coverage of the truth, what is open, and the words for it."""

from dataclasses import replace

import numpy as np
import pytest
from numdiff import central_differences
from synthetic import gaussian_prior, observe, random_frames, whole_circle_markings

from fieldcalib.assess.estimate import GroundError, region_radius
from fieldcalib.assess.observability import OPEN_DIRECTION
from fieldcalib.assess.uncertainty import uncertainties
from fieldcalib.fields.ground import Ground
from fieldcalib.fields.segments import Line
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import DISTRIBUTIONS
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import (
    ANGLES,
    GaussianPrior,
    Layout,
    Role,
    SizeBlock,
    camera_from_theta,
    theta_from_camera,
)
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.solve.from_segments import calibrate_from_segments

FIELD, SIZE = soccer(), (960, 540)
EVERYTHING = Layout.of(SIZE)
PINHOLE = EVERYTHING.fixed("lens", "principal point", "aspect")
A1 = EVERYTHING.lens_block.start
CAUCHY = RobustLoss("cauchy", 6.0)
STEPS = np.array([1e-6] * 4 + [1e-4] * 3 + [1e-3] * 2 + [1e-6] * 3)
THETA = np.array([-0.3, 1.35, 0.02, np.log(1300.0), 3.0, 66.0, -17.0, 475.0, 281.0, 0.01, 0.04, 0.01])
BARREL = np.where(np.arange(12) == A1, -0.1, THETA)
FRAME = observe(whole_circle_markings(FIELD), camera_from_theta(THETA, SIZE))


def prior_for(names):
    priors = [gaussian_prior(DISTRIBUTIONS[name], EVERYTHING) for name in names]
    return GaussianPrior(np.stack([p.mean for p in priors]), np.stack([p.sigma for p in priors]))


def uncertainty_of(frame, theta=THETA, layout=EVERYTHING, prior=True, field=FIELD, loss=CAUCHY):
    stand = prior_for(["main center"])
    problem = Problem(pack(field, [frame], SIZE), layout, loss, 1.0, stand if prior else None)
    (found,) = uncertainties(evaluate(problem, theta[None]), stand.sigma)
    return found


def thetas_of(cameras):
    return np.array([theta_from_camera(camera) for camera in cameras])


def minimised(problem, theta):
    return levenberg_marquardt(evaluate(problem, theta), max_iterations=200, tolerance=1e-13).evaluation


def solved(frames, truth, layout, prior, loss=CAUCHY):
    """Solutions near the true cameras, with their uncertainties."""
    evaluation = minimised(Problem(pack(FIELD, frames, SIZE), layout, loss, 1.0, prior), thetas_of(truth))
    return evaluation.theta, uncertainties(evaluation, prior.sigma)


# propagation


@pytest.mark.parametrize("theta", [THETA, BARREL], ids=["cushion", "barrel"])
def test_standard_deviations_are_opencvs(theta):
    def opencv(theta):
        rvec, tvec, K, dist = camera_from_theta(theta, SIZE).to_opencv()
        return np.concatenate([K[[0, 1, 0, 1], [0, 1, 2, 2]], dist[0, :2], rvec[:, 0], tvec[:, 0]])

    found = uncertainty_of(FRAME, theta)
    J = central_differences(opencv, theta, STEPS)
    expected = np.sqrt(np.diag(J @ found.covariance @ J.T))
    intrinsics, extrinsics = found.std_deviations_intrinsics, found.std_deviations_extrinsics
    assert intrinsics.shape == (18, 1)
    assert extrinsics.shape == (6, 1)
    np.testing.assert_allclose(np.concatenate([intrinsics[:6, 0], extrinsics[:, 0]]), expected, rtol=1e-5)
    np.testing.assert_array_equal(intrinsics[6:], 0.0)


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.4, -0.9, 1.1]), np.array([np.pi, 0.0, 0.0])])
def test_rotation_vectors_of_any_length(turn):
    """Without rotation, far from it, and half a turn away."""
    theta = THETA.copy()
    camera = Camera.from_opencv(turn, (0.0, 0.0, 50.0), np.diag([1000.0, 1000.0, 1.0]), None, SIZE)
    theta[ANGLES] = camera.angles + 1e-3  # straight down pan and roll are one
    found = uncertainty_of(FRAME, theta)
    rvec = found.camera.to_opencv()[0][:, 0]

    def near(moved):
        other = camera_from_theta(moved, SIZE).to_opencv()[0][:, 0]
        length = np.linalg.norm(other)
        return min((other, other - 2.0 * np.pi * other / max(length, 1e-9)), key=lambda v: np.linalg.norm(v - rvec))

    J = central_differences(near, theta, STEPS)
    expected = np.sqrt(np.diag(J @ found.covariance @ J.T))
    np.testing.assert_allclose(found.std_deviations_extrinsics[:3, 0], expected, rtol=1e-4)


@pytest.mark.parametrize("theta", [THETA, BARREL], ids=["cushion", "barrel"])
def test_ground_errors_are_the_derivative_of_the_back_projection(theta):
    found = uncertainty_of(FRAME, theta)
    xy = np.array([[100.0, 500.0], [480.0, 270.0], [900.0, 200.0]])
    J = central_differences(lambda moved: camera_from_theta(moved, SIZE).image_to_field(xy)[:, :2], theta, STEPS)
    expected = J @ found.covariance @ np.swapaxes(J, 1, 2)
    at_image = found.at_image(xy)
    np.testing.assert_allclose(at_image.covariance, expected, rtol=1e-5)
    np.testing.assert_allclose(at_image.rms, np.sqrt(expected[:, 0, 0] + expected[:, 1, 1]), rtol=1e-5)
    at_field = found.at_field(found.camera.image_to_field(xy))
    np.testing.assert_allclose(at_field.covariance, at_image.covariance, rtol=1e-6)


def test_where_there_is_no_ground_there_is_no_error():
    level = THETA.copy()
    level[1] = np.pi / 2.0
    found = uncertainty_of(FRAME, level)
    sky = found.at_image([[480.0, 10.0], [480.0, 500.0]])
    assert np.isnan(sky.rms[0])
    assert np.isfinite(sky.rms[1])
    half_axes, angle = sky.ellipse()
    assert np.isnan(half_axes[0]).all()
    assert np.isnan(angle[0])
    assert np.isfinite(half_axes[1]).all()
    assert np.isnan(found.at_field((0.0, 200.0, 0.0)).rms)  # behind the camera
    assert found.at_field(np.zeros((0, 3))).rms.shape == (0,)
    one = found.at_image([480.0, 500.0])
    assert all(isinstance(number, float) for number in (one.rms, one.ellipse()[1], found.camera.depth(np.zeros(3))))


def test_what_is_no_ground_point_is_refused():
    found = uncertainty_of(FRAME)
    with pytest.raises(ValueError, match=r"shape \(\.\.\., 3\) with z = 0"):
        found.at_field((0.0, 0.0, -2.44))
    with pytest.raises(ValueError, match="append a zero"):
        found.at_field((0.0, 0.0))


def test_ellipse():
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    half_axes, angle = GroundError(turn @ np.diag([9.0, 4.0]) @ turn.T, dof=1e9).ellipse(0.95)
    np.testing.assert_allclose(half_axes, np.array([3.0, 2.0]) * 2.4477, rtol=1e-4)  # chi-square with 2: 5.9915
    assert np.tan(angle) == pytest.approx(np.tan(0.3))


def test_radius_is_students_and_fishers():
    assert region_radius(1, 5.0, 0.95) == pytest.approx(2.5706, abs=1e-4)
    assert region_radius(7, 12.0, 0.95) == pytest.approx(np.sqrt(7 * 2.9134), abs=1e-4)
    with pytest.raises(ValueError, match="between 0 and 1"):
        region_radius(1, 5.0, 95.0)


# covariance


def test_linear_estimates_scatter_as_the_covariance_says():
    """Many noises on one frame: the scatter of the estimates is the sandwich, not the inverse Hessian."""
    truth = np.concatenate([THETA[:9], np.zeros(3)])
    clean = observe(whole_circle_markings(FIELD), camera_from_theta(truth, SIZE))
    clean = {label: xy for label, xy in clean.items() if "Goal" not in label}
    rng, count, noise = np.random.default_rng(3), 400, 0.7
    frames = [{k: xy + rng.normal(scale=noise, size=xy.shape) for k, xy in clean.items()} for _ in range(count)]
    stand = prior_for(["main center"] * count)
    linear = RobustLoss("linear", 1.0)
    observations = pack(FIELD, frames, SIZE)
    problem = Problem(observations, PINHOLE, linear)
    evaluation = minimised(problem, np.tile(truth, (count, 1)))
    found = uncertainties(evaluation, stand.sigma)
    scatter = evaluation.theta.std(axis=0)[:7]
    predicted = np.sqrt(np.median([np.diag(u.covariance)[:7] for u in found], axis=0))
    hessian = np.sqrt(np.diag(np.linalg.inv(evaluation.hessian[0])))
    # what segments share is none here: the prediction is a little wide
    ratio = predicted / scatter
    assert np.all((ratio > 0.95) & (ratio < 1.35))
    assert np.min(np.abs(np.log(hessian / scatter))) > np.log(1.5)
    assert np.median([u.sigma for u in found]) == pytest.approx(noise, rel=0.1)


def test_noise_is_found_through_the_robust_loss_and_gross_errors():
    """Cauchy's loss bends 2 px of noise; a segment with a wrong label must not pass for noise."""
    frames, truth = random_frames(40, 5, noise=2.0, least_segments=9, stands=("main center", "main left"))
    prior = prior_for(["main center", "main left"] * 20)
    _, found = solved(frames, truth, PINHOLE, prior)
    assert np.median([u.sigma for u in found]) == pytest.approx(2.0, rel=0.1)
    assert np.median([u.robust_sigma for u in found]) < 1.8
    for frame in frames:
        label = next(label for label in frame if isinstance(FIELD[label], Line))
        frame[label] = frame[label] + 100.0
    _, found = solved(frames, truth, PINHOLE, prior)
    assert np.median([u.sigma for u in found]) == pytest.approx(2.0, rel=0.2)


def test_weights_are_precisions():
    """Half of the segments three times as noisy, and weighted so: sigma is that of the others."""
    rng = np.random.default_rng(6)
    weights = {label: 1.0 if i % 2 else 1.0 / 9.0 for i, label in enumerate(FRAME)}
    noisy = {k: xy + rng.normal(scale=0.5 / np.sqrt(weights[k]), size=xy.shape) for k, xy in FRAME.items()}
    many = [noisy] * 2
    shares = [{k: np.full(len(xy), weights[k] / len(xy)) for k, xy in noisy.items()}, None]
    prior = prior_for(["main center"] * 2)
    problem = Problem(pack(FIELD, many, SIZE, shares), PINHOLE, CAUCHY, 0.5, prior)
    weighted, alike = uncertainties(minimised(problem, np.tile(THETA, (2, 1))), prior.sigma)
    assert weighted.sigma == pytest.approx(0.5, rel=0.25)
    assert alike.sigma > 0.9
    assert weighted.dof == pytest.approx(alike.dof, rel=0.1)


def test_a_prior_that_pulls_less_leaves_more_open():
    """Far out the lens's prior has heavy tails."""
    labels = ("Big rect. left main", "Big rect. left top", "Side line top")
    frame, far = {label: FRAME[label] for label in labels}, BARREL.copy()
    far[A1] = -0.2
    k1 = EVERYTHING.fixed("k2", "principal point", "aspect")
    near, wide = (uncertainty_of(frame, theta, k1) for theta in (THETA, far))
    assert wide.covariance[A1, A1] > 4.0 * near.covariance[A1, A1]


def test_few_equations_lean_on_the_noise_of_other_frames():
    two = {label: FRAME[label][:2] for label in ("Side line top", "Big rect. left main", "Big rect. left top")}
    few = uncertainty_of(two, layout=PINHOLE)
    assert few.dof < 8.0
    assert 0.7 < few.sigma < 1.1  # the pixels fit perfectly
    many = uncertainty_of(FRAME)
    assert many.dof > 20.0
    assert many.sigma < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("lens", [False, True], ids=["pinhole", "k1"])
@pytest.mark.parametrize("noise", [1.0, 2.0])
def test_regions_hold_the_truth(noise, lens):
    names = ("main center", "main left", "main right", "behind left goal", "opposite tribune")
    count = 100
    frames, truth = random_frames(count, 21, noise, stands=names, a1=(0.0, 0.03 if lens else 0.0))
    layout = EVERYTHING.fixed("k2", "principal point", "aspect") if lens else PINHOLE
    free = layout.free
    prior = prior_for([names[t % len(names)] for t in range(count)])
    theta, found = solved(frames, truth, layout, prior)
    points = np.stack(np.meshgrid(np.linspace(-50, 50, 11), np.linspace(-30, 30, 7), [0.0]), axis=-1).reshape(-1, 3)
    intervals, regions, ellipses = [], [], []
    for camera, estimate, u in zip(truth, theta, found, strict=True):
        error = (estimate - theta_from_camera(camera))[free]
        intervals.append(np.abs(error) <= u.radius() * np.sqrt(np.diag(u.covariance)[free]))
        regions.append(u.distance(camera) <= u.radius(int(free.sum())))
        xy = camera.project(points)
        seen = np.all((xy >= 0.0) & (xy < SIZE), axis=1) & np.isfinite(u.camera.image_to_field(xy)).all(axis=1)
        off = (u.camera.image_to_field(xy[seen]) - points[seen])[:, :2, None]
        squared = (np.swapaxes(off, 1, 2) @ np.linalg.solve(u.at_image(xy[seen]).covariance, off))[:, 0, 0]
        ellipses.append(np.mean(squared <= u.radius(2) ** 2) if len(squared) else np.nan)
    assert 0.90 <= np.mean(intervals) <= 0.99
    assert 0.90 <= np.mean(regions) <= 1.0
    assert 0.90 <= np.nanmean(ellipses) <= 0.99


def test_company_changes_nothing():
    frames, cameras = random_frames(6, 8, noise=1.0, stands=("main center",))
    truth = thetas_of(cameras)
    prior = prior_for(["main center"] * 6)
    problem = Problem(pack(FIELD, frames, SIZE), PINHOLE, CAUCHY, 1.0, prior)
    together = uncertainties(evaluate(problem, truth), prior.sigma)[4]
    index = np.array([4])
    (alone,) = uncertainties(evaluate(problem.take(index), truth[index]), prior.sigma[index])
    np.testing.assert_allclose(together.covariance, alone.covariance, rtol=1e-6)
    assert together.dof == pytest.approx(alone.dof)
    assert str(together) == str(alone)


# what is open


def test_what_the_labels_leave_open_is_infinite():
    """Lines along x alone: the camera may slide along them."""
    level = THETA.copy()
    level[0] = 0.0
    camera = camera_from_theta(level, SIZE)
    xs = np.linspace(-10.0, 10.0, 4)
    field = {
        f"line {i}": Line((-50.0, y, z), (50.0, y, z)) for i, (y, z) in enumerate([(0, 0), (-20, 0), (10, 0), (0, -3)])
    }
    frame = {name: camera.project([(x, *line.start[1:]) for x in xs]) for name, line in field.items()}
    layout = PINHOLE.fixed("angles", "focal length")
    free = layout.free
    without = uncertainty_of(frame, level, layout, prior=False, field=field)
    covariance = without.covariance
    assert np.isinf(covariance[4, 4])
    assert np.isnan(covariance[4, 5])
    assert np.isfinite(covariance[5:7, 5:7]).all()
    np.testing.assert_array_equal(covariance[~free][:, ~free], 0.0)
    assert str(without).startswith("open: x; from the labels: ")
    assert np.isinf(without.std_deviations_extrinsics[3:, 0]).any()
    error = without.at_image([480.0, 300.0])
    assert np.isinf(error.covariance[0, 0])
    assert np.isfinite(error.covariance[1, 1])

    with_prior = uncertainty_of(frame, level, layout, prior=True, field=field)
    sigma = gaussian_prior(DISTRIBUTIONS["main center"], EVERYTHING).sigma
    assert np.sqrt(with_prior.covariance[4, 4]) == pytest.approx(sigma[4], rel=1e-3)  # all that is known
    assert with_prior.observability[0].parameters == "x"
    assert with_prior.observability[0].information < OPEN_DIRECTION
    assert with_prior.observability[0].share < 0.01
    assert "mostly from the prior: x (0 % from the labels)" in str(with_prior)
    assert "from the labels: " in str(with_prior)


def test_the_prior_narrows_what_the_labels_leave_wide():
    frame = {label: FRAME[label] for label in ("Big rect. left main", "Big rect. left top", "Side line top")}
    found, alone = (uncertainty_of(frame, layout=PINHOLE, prior=prior) for prior in (True, False))
    variance, by_labels = np.diag(found.covariance)[:7], np.diag(alone.covariance)[:7]
    sigma = gaussian_prior(DISTRIBUTIONS["main center"], EVERYTHING).sigma[:7]
    assert np.all(variance < 1.01 * sigma**2)
    wide = by_labels > sigma**2
    assert np.any(wide)
    assert np.all(variance[wide] < 0.9 * by_labels[wide])
    informations = [direction.information for direction in found.observability]
    assert informations == sorted(informations)


def test_distance_of_the_estimate_is_nothing():
    frames, truth = random_frames(1, 4, noise=1.0, stands=("main center",))
    prior = prior_for(["main center"])
    theta, (found,) = solved(frames, truth, PINHOLE, prior)
    assert found.distance(found.camera) < 0.01
    radius = found.radius(7)
    assert found.distance(truth[0]) < radius
    away = theta[0].copy()
    away[0] += 0.05
    assert found.distance(camera_from_theta(away, SIZE)) > radius
    # without a prior too
    (without,) = uncertainties(found.evaluation.of(replace(found.problem, prior=None)), prior.sigma)
    assert without.distance(truth[0]) < radius


def test_near_the_estimate_the_distance_is_mahalanobis():
    frames, truth = random_frames(1, 4, noise=0.3, stands=("main center",))
    prior = prior_for(["main center"])
    theta, (found,) = solved(frames, truth, PINHOLE, prior)
    covariance = found.covariance[:7, :7]
    step = 0.01 * np.linalg.cholesky(covariance) @ np.ones(7)
    near = theta[0].copy()
    near[:7] += step
    mahalanobis = np.sqrt(step @ np.linalg.solve(covariance, step))
    at_estimate = found.distance(camera_from_theta(theta[0], SIZE))
    assert found.distance(camera_from_theta(near, SIZE)) == pytest.approx(mahalanobis, rel=0.05, abs=at_estimate)


def test_points_know_both_axes():
    """A point's two residuals are independent: four of them, eight equations, determine a pinhole; three do not."""
    camera = Camera.from_angles(-0.4, 1.3, 0.0, 1100.0, (0.0, 65.0, -17.0), SIZE)
    corners = [name for name in FIELD.points if name.startswith("L_PENALTY_AREA")]
    X = np.array([FIELD.points[name].X for name in corners])
    frame = dict(zip(corners, camera.project(X)[:, None], strict=True))
    theta = theta_from_camera(camera)
    four, three = (
        uncertainty_of(dict(list(frame.items())[:count]), theta, PINHOLE, prior=False, field=dict(FIELD.points))
        for count in (4, 3)
    )
    assert "open" not in str(four)
    assert "open" in str(three)

    def pixels(free):
        return camera_from_theta(np.concatenate([free, theta[7:]]), SIZE).project(X).ravel()

    J = central_differences(pixels, theta[:7], STEPS[:7])
    expected, covariance = np.linalg.inv(J.T @ J), four.covariance[:7, :7]
    np.testing.assert_allclose(covariance / covariance[0, 0], expected / expected[0, 0], rtol=1e-4)


# what is not known exactly, and not estimated


FOUR = ("Side line top", "Big rect. left main", "Big rect. left top", "Circle left")


@pytest.mark.parametrize("labels", [None, FOUR])
def test_a_field_whose_size_is_not_known_makes_less_certain(labels):
    """The cameras are the same: a single frame is solved at the given size."""
    frame = observe(whole_circle_markings(FIELD), camera_from_theta(THETA, SIZE), np.random.default_rng(2), 1.0)
    frame = frame if labels is None else {label: xy for label, xy in frame.items() if label in labels}
    pitches = (field.with_ground(Ground()) for field in (FIELD, soccer(size_known=True)))
    unknown, known = (calibrate_from_segments(field, frame, SIZE) for field in pitches)
    np.testing.assert_allclose(unknown.camera.K, known.camera.K, rtol=1e-9)
    np.testing.assert_allclose(unknown.camera.C, known.camera.C, rtol=1e-9, atol=1e-9)
    (f, *_), C = (np.subtract(*pair) for pair in zip(unknown.std_deviations, known.std_deviations, strict=True))
    assert f > 0.0
    assert np.all(C[3:] > 0.0)
    wider, narrower = (one.covariance[:12, :12] for one in (unknown, known))
    smallest = np.linalg.eigvalsh((wider - narrower)[:7, :7])
    assert smallest[-1] > 0.0
    assert smallest[0] > -1e-9 * smallest[-1]  # never more certain along any direction
    xy = [[200.0, 300.0], [480.0, 300.0], [800.0, 450.0]]
    assert np.all(unknown.field_uncertainty(xy).rms > known.field_uncertainty(xy).rms)


def test_errors_by_the_size_are_those_of_the_estimate_on_a_pitch_of_that_size():
    """To first order: the same pixels calibrated at a size that is a little off."""
    markings = whole_circle_markings(FIELD)
    frame = observe(markings, camera_from_theta(THETA, SIZE), per_line=5)
    frame = {label: xy[1:-1] for label, xy in frame.items()}  # none past the end of its segment
    model = FIELD.size_model
    layout = Layout.of(SIZE, field_size=SizeBlock(np.array([105.0, 68.0]), model.sigma, model.limits))
    layout = layout.fixed("lens", "aspect", "principal point").with_roles(Role.CONSIDERED, "field size")
    stand = gaussian_prior(DISTRIBUTIONS["main center"], layout)
    prior = GaussianPrior(stand.mean[None], stand.sigma[None])

    def at_size(size):
        pitch = soccer(*size)
        problem = Problem(pack(pitch, [frame], SIZE, motion=pitch.motion), layout, CAUCHY, 1.0, prior)
        return minimised(problem, np.concatenate([THETA, size])[None])

    (found,) = uncertainties(at_size(np.array([105.0, 68.0])), prior.sigma)
    numeric = central_differences(lambda size: at_size(size).theta[0, :7], np.array([105.0, 68.0]), 0.05)
    # by_considered is of what is true less what is given: the other way
    scale = np.abs(numeric).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found.by_considered[:7] / scale, -numeric / scale, atol=0.05)
