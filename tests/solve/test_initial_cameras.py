"""Starting cameras."""

import tracemalloc

import numpy as np
import pytest
from synthetic import gaussian_prior, observe, random_frames, whole_circle_markings

from fieldcalib.fields.segments import Line, PointCloud
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import DISTRIBUTIONS, MAIN_CENTER, MAIN_LEFT
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import dehomogenize, homogenize
from fieldcalib.problem.layout import (
    ANGLES,
    CENTER,
    LOG_ASPECT,
    LOG_F,
    PRINCIPAL_POINT,
    Layout,
    camera_from_theta,
    gaussian_priors,
    theta_from_camera,
)
from fieldcalib.problem.observations import pack
from fieldcalib.solve.initial_cameras import (
    camera_from_lines,
    ground_homographies,
    initial_cameras,
    pointed_camera,
)

FIELD, SIZE = soccer(), (960, 540)
LAYOUT = Layout.of(SIZE)
GROUND = {
    label: segment
    for label, segment in FIELD.items()
    if isinstance(segment, Line) and segment.start[2] == segment.end[2] == 0.0
}


def nothing_known():
    known = np.full(LAYOUT.size, np.nan)
    known[PRINCIPAL_POINT] = np.array(SIZE) / 2.0
    known[LAYOUT.lens_block] = known[LOG_ASPECT] = 0.0
    return known


def determines_the_homography(frame):
    """Whether two lines of the ground or more are labelled along the field, and two across it."""
    lines = [GROUND[label] for label in frame if label in GROUND]
    along = {line.start[1] for line in lines if line.start[1] == line.end[1]}
    across = {line.start[0] for line in lines if line.start[0] == line.end[0]}
    return min(len(along), len(across)) >= 2


def test_dlt_lines_recover_the_camera_without_noise():
    frames, truth = random_frames(60, seed=0, least_segments=8)
    theta, found = camera_from_lines(pack(FIELD, frames, SIZE), nothing_known())
    determined = [t for t, frame in enumerate(frames) if determines_the_homography(frame)]
    assert len(determined) > 50
    assert found[determined].all()
    for t in determined:
        camera = camera_from_theta(theta[t], SIZE)
        assert camera.focal_length == pytest.approx(truth[t].focal_length, rel=1e-8)
        np.testing.assert_allclose(camera.C, truth[t].C, atol=1e-6)
        np.testing.assert_allclose(camera.R, truth[t].R, atol=1e-8)


def test_dlt_needs_four_lines_on_the_ground():
    camera = Camera.from_angles(-0.4, 1.35, 0.0, 1200.0, (0.0, 65.0, -15.0), SIZE)
    seen = observe(GROUND, camera)
    assert len(seen) >= 5
    four, three = ({label: seen[label] for label in list(seen)[:count]} for count in (4, 3))
    posts = observe({label: s for label, s in FIELD.markings.items() if label not in GROUND}, camera)
    _, found = camera_from_lines(pack(FIELD, [seen, four, {**three, **posts}], SIZE), nothing_known())
    assert found.tolist() == [True, True, False]


@pytest.mark.slow
def test_memory_does_not_grow_with_the_square_of_the_number_of_lines(monkeypatch):
    rng = np.random.default_rng(0)
    lines = {f"{k}": Line((*rng.uniform(-40, 40, 2), 0.0), (*rng.uniform(-40, 40, 2), 0.0)) for k in range(1000)}
    observations = pack(lines, [{label: rng.uniform(0.0, 500.0, (4, 2)) for label in lines}], SIZE)
    tracemalloc.start()
    H, _ = ground_homographies(observations, np.array(SIZE) / 2.0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 100e6  # 196 MB with all lines at a time
    monkeypatch.setattr("fieldcalib.solve.initial_cameras.MOST_MEMBERS", 10**9)
    assert np.array_equal(ground_homographies(observations, np.array(SIZE) / 2.0)[0], H)


def test_ground_homographies_map_metres_to_pixels():
    camera = Camera.from_angles(-0.4, 1.35, 0.0, 1200.0, (0.0, 65.0, -15.0), SIZE)
    seen = observe(GROUND, camera)
    few = {label: seen[label] for label in list(seen)[:3]}
    posts = observe({label: s for label, s in FIELD.markings.items() if label not in GROUND}, camera)
    H, found = ground_homographies(pack(FIELD, [seen, few, {**seen, **posts}], SIZE), np.array([470.0, 280.0]))
    assert found.tolist() == [True, False, True]
    assert np.all(np.isnan(H[1]))
    X = camera.image_to_field([(100.0, 500.0), (480.0, 270.0), (900.0, 400.0)])
    for t in (0, 2):
        np.testing.assert_allclose(dehomogenize(homogenize(X[:, :2]) @ H[t].T), camera.project(X), atol=1e-4)


CAMERA = Camera.from_angles(-0.4, 1.35, 0.0, 1200.0, (0.0, 65.0, -15.0), SIZE)


def test_a_short_line_counts_little():
    """Its direction is noise; weighing as much as a long one it would spoil the homography."""
    frame = observe(GROUND, CAMERA)
    rng, label, errors = np.random.default_rng(0), "Small rect. left main", []
    start, end = frame[label][0], frame[label][-1]
    X = CAMERA.image_to_field([(100.0, 500.0), (480.0, 270.0), (900.0, 400.0)])
    for _ in range(20):
        short = start + np.outer([0.4, 0.5, 0.6], end - start) / np.linalg.norm(end - start) * 12.0
        noisy = {**frame, label: short + rng.normal(size=short.shape)}
        H, _ = ground_homographies(pack(FIELD, [noisy], SIZE), np.array(SIZE) / 2.0)
        errors.append(np.abs(dehomogenize(homogenize(X[:, :2]) @ H[0].T) - CAMERA.project(X)).max())
    assert np.median(errors) < 0.2  # pixels


@pytest.mark.parametrize("shift", [(150.0, 0.0), (0.0, 90.0), (-80.0, 60.0)])
def test_the_image_is_normalised_around_the_principal_point(shift):
    """Moved together, pixels and principal point have the same homography, moved too."""
    frame = observe(GROUND, CAMERA, np.random.default_rng(0), noise=2.0)
    moved = {label: xy + shift for label, xy in frame.items()}
    centre = np.array(SIZE) / 2.0
    H, _ = ground_homographies(pack(FIELD, [frame], SIZE), centre)
    H_moved, _ = ground_homographies(pack(FIELD, [moved], SIZE), centre + shift)
    X = CAMERA.image_to_field([(100.0, 500.0), (480.0, 270.0), (900.0, 400.0)])[:, :2]
    expected = dehomogenize(homogenize(X) @ H[0].T) + shift
    np.testing.assert_allclose(dehomogenize(homogenize(X) @ H_moved[0].T), expected, rtol=0, atol=1e-5)


def test_no_ground_lines_no_homographies():
    H, found = ground_homographies(pack(FIELD, [{"Circle central": np.array([[480.0, 270.0]])}], SIZE), np.zeros(2))
    assert H.shape == (1, 3, 3)
    assert not found.any()


def middle_of(segment):
    return np.add(segment.start, segment.end) / 2.0 if isinstance(segment, Line) else np.array(segment.center)


def length_of(segment):
    return (
        np.linalg.norm(np.subtract(segment.end, segment.start)) if isinstance(segment, Line) else 2.0 * segment.radius
    )


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_a_pointed_camera_looks_at_what_is_labelled(name):
    distribution = DISTRIBUTIONS[name]
    frames, _ = random_frames(20, seed=1, stands=(name,))
    observations = pack(FIELD, frames, SIZE)
    prior = gaussian_prior(distribution, LAYOUT)
    theta = pointed_camera(observations, prior, nothing_known())
    np.testing.assert_array_equal(theta[:, CENTER], np.tile(prior.mean[CENTER], (20, 1)))
    for t, frame in enumerate(frames):
        camera = camera_from_theta(theta[t], SIZE)
        weights = [1.0 / (length_of(FIELD[label]) + 5.0) ** 2 for label in frame]
        X = np.average([middle_of(FIELD[label]) for label in frame], axis=0, weights=weights)
        xy = np.average([pixels.mean(axis=0) for pixels in frame.values()], axis=0, weights=weights)
        assert np.linalg.norm(camera.project(X) - xy) < 50.0  # the angles to it are small, but not nothing
        fov = np.degrees(camera.field_of_view)
        assert 8.2 - 1e-6 <= fov <= 90.0 + 1e-6


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_a_pointed_camera_knows_only_its_own_frame(name):
    frames, _ = random_frames(5, seed=1, stands=(name,))
    prior = gaussian_prior(DISTRIBUTIONS[name], Layout.of(SIZE))
    together = pointed_camera(pack(FIELD, frames, SIZE), prior, nothing_known())
    alone = [pointed_camera(pack(FIELD, [frame], SIZE), prior, nothing_known())[0] for frame in frames]
    np.testing.assert_allclose(together, alone, rtol=1e-12, atol=1e-12)
    assert np.ptp(together[:, LOG_F]) > 0.1  # and zooms as far as it needs


@pytest.mark.parametrize("factor", [2, 3])
def test_an_enlarged_frame_has_the_same_starts(factor):
    """Else the searches of the two sizes end in cameras that differ, and so does what is chosen there."""
    frames, _ = random_frames(20, seed=5, noise=1.0)
    size = (factor * SIZE[0], factor * SIZE[1])
    enlarged = [{label: factor * xy for label, xy in frame.items()} for frame in frames]
    known = nothing_known()
    small = initial_cameras(pack(FIELD, frames, SIZE), gaussian_priors([MAIN_CENTER], Layout.of(SIZE)), known)
    known[PRINCIPAL_POINT] *= factor
    large = initial_cameras(pack(FIELD, enlarged, size), gaussian_priors([MAIN_CENTER], Layout.of(size)), known)
    of_small = small.theta.copy()
    of_small[:, LOG_F] += np.log(factor)
    of_small[:, PRINCIPAL_POINT] *= factor
    np.testing.assert_allclose(large.theta, of_small, rtol=1e-6, atol=1e-6)


def test_starts_are_sorted_by_frame_and_belong_to_a_distribution():
    frames, _ = random_frames(7, seed=2)
    starts = initial_cameras(
        pack(FIELD, frames, SIZE), gaussian_priors([MAIN_CENTER, MAIN_LEFT], LAYOUT), nothing_known()
    )
    assert np.all(np.diff(starts.frame) >= 0)
    assert set(starts.frame.tolist()) == set(range(7))
    assert np.all(np.bincount(starts.frame) >= 2)
    x_means = {gaussian_prior(MAIN_CENTER, LAYOUT).mean[4], gaussian_prior(MAIN_LEFT, LAYOUT).mean[4]}
    assert set(starts.prior.mean[:, 4].tolist()) == x_means
    assert starts.theta.shape == starts.prior.mean.shape == starts.prior.sigma.shape
    assert np.all(np.isfinite(starts.theta))


def test_what_is_known_is_kept():
    frames, _ = random_frames(5, seed=3)
    known = nothing_known()
    known[LOG_F], known[PRINCIPAL_POINT], known[2] = np.log(1234.0), (470.0, 280.0), 0.02
    starts = initial_cameras(pack(FIELD, frames, SIZE), gaussian_priors([MAIN_CENTER], LAYOUT), known)
    given = ~np.isnan(known)
    np.testing.assert_array_equal(starts.theta[:, given], np.tile(known[given], (len(starts.theta), 1)))


def test_a_known_pose_makes_one_start_of_the_nearest_distribution():
    frames, cameras = random_frames(1, seed=4, stands=("main left",))
    known, truth = nothing_known(), theta_from_camera(cameras[0])
    known[ANGLES], known[CENTER] = truth[ANGLES], truth[CENTER]
    starts = initial_cameras(pack(FIELD, frames, SIZE), gaussian_priors([MAIN_CENTER, MAIN_LEFT], LAYOUT), known)
    assert len(starts.theta) == 1
    np.testing.assert_array_equal(starts.theta[0, [0, 1, 2, 4, 5, 6]], truth[[0, 1, 2, 4, 5, 6]])
    assert starts.prior.mean[0, 4] == gaussian_prior(MAIN_LEFT, LAYOUT).mean[4]


def test_objects_without_lines_have_starts_too():
    markings = whole_circle_markings(FIELD)
    cloud = {"circle": PointCloud(markings["Circle central"].sample(1.0))}
    camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)
    starts = initial_cameras(
        pack(cloud, [observe(cloud, camera)], SIZE), gaussian_priors([MAIN_CENTER], LAYOUT), nothing_known()
    )
    assert len(starts.theta) == 1
    assert abs(starts.theta[0, 0]) < 0.05
