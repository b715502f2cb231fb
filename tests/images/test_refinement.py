"""Cameras refined on rendered pictures: brought back from where they were moved to, or left alone."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from pictures import picture
from synthetic import observe, whole_circle_markings
from views import SIZE, camera

from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.scene import render_field
from fieldcalib.fields.segments import Line, Point, PointCloud
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.paint.detected_lines import calibrate_on_lines
from fieldcalib.images.paint.line_profiles import Markings, Strips, find_lines, profiles_along
from fieldcalib.images.refinement import (
    ToRefine,
    line_support,
    on_field_as_seen,
    refine_all,
    refine_homography_on_image,
    refine_on_image,
)
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.layout import CENTER, LOG_F, camera_from_theta, theta_from_camera
from fieldcalib.solve.from_homography import calibrate_from_homography
from fieldcalib.solve.from_segments import calibrate_from_segments
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import DEFAULT_FLAGS

FIELD = soccer()
MARKINGS = Markings.of(FIELD)
VIEWS = {
    "penalty area": camera(24, 78, 1400, (0, 68, -17), k=(0.06, 0.0)),
    "midfield": camera(3, 75, 1000, (-2, 66, -16), roll=0.5, k=(0.03, 0.0)),
    "barrel": camera(-22, 76, 850, (0, 66, -16), k=(-0.15, 0.02)),
    "close": camera(33, 81, 3000, (2, 70, -18)),
}
any_view = pytest.mark.parametrize("truth", VIEWS.values(), ids=VIEWS)


def calibrated(truth):
    """A calibration from exact pixels."""
    return calibrate_from_segments(FIELD, observe(whole_circle_markings(FIELD), truth), truth.image_size)


def moved(truth, px, seed=0):
    """A camera that takes points of the ground in view `px` pixels away from where they are, root mean square."""
    rng = np.random.default_rng(seed)
    theta = theta_from_camera(truth)
    step = np.zeros(len(theta))
    step[:3] = rng.normal(scale=(1.0, 1.0, 1.0), size=3) / truth.focal_length
    step[LOG_F] = rng.normal() / truth.image_size[0]
    step[CENTER] = 0.05 * rng.normal(size=3)
    size = 1.0
    for _ in range(20):  # secants
        other = camera_from_theta(theta + size * step, truth.image_size)
        size *= px / distance(other, truth)
    return other


def distance(estimated, truth):
    """Root mean square distance in pixels between the images of the field's visible ground points."""
    x, y = np.meshgrid(np.linspace(-52.5, 52.5, 106), np.linspace(-34.0, 34.0, 69))
    X = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    xy = truth.project(X)
    visible = np.all((xy >= 0.0) & (xy <= np.subtract(truth.image_size, 1.0)), axis=1)
    return np.sqrt(np.nanmean(np.sum(np.square(estimated.project(X[visible]) - xy[visible]), axis=1)))


# --- refine_on_image ---


@any_view
@pytest.mark.parametrize("px", [8.0, pytest.param(5.0, marks=pytest.mark.slow)])
def test_a_moved_camera_is_brought_back(truth, px):
    start = replace(calibrated(truth), camera=moved(truth, px, seed=1))
    refined = refine_on_image(FIELD, picture(truth), start)
    assert distance(start.camera, truth) == pytest.approx(px, rel=0.05)
    assert refined.accepted
    assert distance(refined.camera, truth) < 0.7


@pytest.mark.slow
def test_in_full_hd_twice_as_many_pixels():
    truth = VIEWS["penalty area"].scaled((1920, 1080))
    start = replace(calibrated(truth), camera=moved(truth, 15.0, seed=2))
    assert distance(refine_on_image(FIELD, picture(truth), start).camera, truth) < 0.7


@any_view
def test_a_right_camera_stays_right(truth):
    refined = refine_on_image(FIELD, picture(truth), replace(calibrated(truth), camera=truth))
    assert distance(refined.camera, truth) < 0.5


@any_view
def test_the_first_pass_may_be_left_out_near_the_lines(truth):
    image, start = picture(truth), calibrated(truth)
    near, far = (replace(start, camera=moved(truth, px)) for px in (1.0, 8.0))
    quick, full = (refine_on_image(FIELD, image, near, quick=quick).camera for quick in (True, False))
    assert quick != full
    assert distance(quick, full) < 0.3
    assert distance(quick, truth) < 0.5
    quick, full = (refine_on_image(FIELD, image, far, quick=quick).camera for quick in (True, False))
    assert quick == full  # the first pass was needed


def test_segments_that_nobody_labelled_are_used():
    truth = VIEWS["penalty area"]
    labels = ("Side line top", "Big rect. right main", "Big rect. right top", "Circle right")
    rng = np.random.default_rng(0)
    pixels = {label: xy for label, xy in observe(FIELD, truth, rng, noise=1.5).items() if label in labels}
    start = calibrate_from_segments(FIELD, pixels, SIZE)
    refined = refine_on_image(FIELD, picture(truth), start)
    assert {"Small rect. right main", "Side line right"} <= set(refined.per_segment_errors)
    assert distance(refined.camera, truth) < 0.5 * distance(start.camera, truth)


def test_labelled_pixels_serve_where_there_is_no_line():
    truth = VIEWS["penalty area"]
    lines = {label: s for label, s in FIELD.items() if label != "Side line right"}
    image = render_field(truth, replace(FIELD, segments=lines), rng=np.random.default_rng(0))
    pixels = observe(whole_circle_markings(FIELD), truth)
    pixels = {"Side line right ": pixels["Side line right"], "Circle right": pixels["Circle right"] + 40.0}
    refined = refine_on_image(FIELD, image, calibrated(truth), pixels, weights={"Side line right ": [1.0, 1.0, 0.5]})
    assert "Side line right" in refined.per_segment_errors
    assert refined.per_segment_errors["Circle right"] < 1.0  # the line in the image counts, not the label


def test_a_grey_picture_will_do():
    truth = VIEWS["penalty area"]
    grey = np.repeat(picture(truth).mean(axis=2, keepdims=True).astype(np.uint8), 3, axis=2)
    start = replace(calibrated(truth), camera=moved(truth, 6.0, seed=3))
    assert distance(refine_on_image(FIELD, grey, start).camera, truth) < 0.7


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((540, 960, 3), np.uint8),
        np.full((540, 960, 3), 255, np.uint8),
        np.random.default_rng(0).integers(0, 255, (540, 960, 3), np.uint8),
    ],
    ids=["black", "white", "noise"],
)
def test_pictures_without_lines_leave_the_camera_alone(image):
    start = calibrated(VIEWS["penalty area"])
    assert refine_on_image(FIELD, image, start) is start


def test_a_camera_that_is_elsewhere_is_left_alone():
    truth = VIEWS["penalty area"]
    start = replace(calibrated(truth), camera=VIEWS["midfield"])
    assert refine_on_image(FIELD, picture(truth), start) is start


def test_without_a_camera_there_is_nothing_to_refine():
    start = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "nothing")
    assert refine_on_image(FIELD, np.zeros((540, 960, 3), np.uint8), start) is start


def test_an_object_without_markings():
    truth = VIEWS["penalty area"]
    points = {name: point for name, point in FIELD.items() if isinstance(point, Point)}
    start = calibrated(truth)
    assert refine_on_image(points, picture(truth), start, prior=None) is start


def test_the_same_picture_gives_the_same_camera():
    truth = VIEWS["penalty area"]
    start, image = replace(calibrated(truth), camera=moved(truth, 6.0)), picture(truth)
    assert refine_on_image(FIELD, image, start).camera == refine_on_image(FIELD, image, start).camera


def test_images_are_checked():
    start = calibrated(VIEWS["penalty area"])
    with pytest.raises(ValueError, match="image must have the camera's size, 960 x 540, got 640 x 360"):
        refine_on_image(FIELD, np.zeros((360, 640, 3), np.uint8), start)
    with pytest.raises(ValueError, match="image must be uint8, got float64"):
        refine_on_image(FIELD, np.zeros((540, 960, 3)), start)


def test_line_support():
    truth = VIEWS["penalty area"]
    image = picture(truth)
    assert line_support(image, truth, MARKINGS) > 0.75
    assert line_support(image, moved(truth, 8.0), MARKINGS) < 0.3
    looking_up = Camera.from_angles(0.0, 2.5, 0.0, 1000.0, (0.0, 60.0, -15.0), SIZE)
    assert line_support(image, looking_up, MARKINGS) == 0.0


# --- profiles ---


def test_markings_hold_each_circle_once_and_no_points():
    assert set(MARKINGS.labels) == set(whole_circle_markings(FIELD))


def test_markings_of_any_object():
    curve = PointCloud([(0.0, 0.0, 0.0), (1.0, 0.1, 0.0), (2.0, 0.4, 0.0)], ordered=True)
    cloud = PointCloud([(0.0, 0.0, 0.0)])
    found = Markings.of({"pole": Line((0, 0, 0), (0, 0, -3)), "curve": curve, "cloud": cloud, "dot": Point((0, 0, 0))})
    assert found.labels == ("pole", "curve")
    np.testing.assert_allclose(found.along[found.member == 0], [(0.0, 0.0, -1.0)] * 13, atol=1e-12)
    assert not found.on_ground[found.member == 0].any()
    assert found.on_ground[found.member == 1].all()


def test_a_line_that_points_at_the_camera_has_no_profiles():
    overhead = Camera.from_angles(0.0, 0.0, 0.0, 300.0, (1.0, 0.0, -10.0), SIZE)
    curve = PointCloud(
        [(1.0, 0.0, 0.0), (1.0, 0.0, -1.0), (1.0, 0.0, -2.0), (3.0, 0.0, -2.0), (6.0, 0.0, -2.0)], ordered=True
    )
    profiles = profiles_along(overhead, Markings.of({"gallows": curve}))
    assert np.all(np.isfinite(profiles.normal))
    assert profiles.xy[:, 0].min() > overhead.principal_point[0]


@any_view
def test_profiles_cross_their_markings_at_the_width_of_the_paint(truth):
    profiles = profiles_along(truth, MARKINGS)
    assert np.all((profiles.xy > 0.0) & (profiles.xy < np.subtract(SIZE, 1.0)))
    np.testing.assert_allclose(np.linalg.norm(profiles.normal, axis=1), 1.0)
    counts = np.bincount(profiles.member)
    assert counts.max() <= 30
    assert counts[counts > 0].min() >= 4
    touchline = profiles.member == MARKINGS.labels.index("Side line top")
    half = 0.5 * profiles.width[touchline, None] * profiles.normal[touchline]
    there = truth.image_to_field(profiles.xy[touchline] + half)
    np.testing.assert_allclose(np.abs(there[:, 1] + 34.0), 0.06, rtol=0.05)


@any_view
def test_lines_are_found_to_a_fraction_of_a_pixel(truth):
    profiles = profiles_along(truth, MARKINGS)
    offset = find_lines(picture(truth, seed=None), profiles, 4.0)
    found = np.isfinite(offset)
    assert np.mean(found) > 0.75
    assert np.sqrt(np.mean(np.square(offset[found]))) < 0.25


def test_a_line_wider_than_the_search_is_found():
    truth = camera(0, 80, 5000, (0, 50, -12))
    profiles = profiles_along(truth, MARKINGS)
    middle = profiles.member == MARKINGS.labels.index("Middle line")
    assert profiles.width[middle].min() > 7.0
    offset = find_lines(picture(truth, seed=None), profiles, 4.0)[middle]
    assert np.mean(np.isfinite(offset)) > 0.7
    assert np.nanmax(np.abs(offset)) < 1.0


def test_a_shifted_line_is_found_where_it_is():
    truth = VIEWS["midfield"]
    image = np.roll(picture(truth, seed=None), 6, axis=1)
    profiles = profiles_along(truth, MARKINGS)
    middle = profiles.member == MARKINGS.labels.index("Middle line")
    offset = find_lines(image, profiles, 12.0)[middle]
    found = np.isfinite(offset)
    assert np.mean(found) > 0.7
    np.testing.assert_allclose(offset[found], 6.0 * profiles.normal[middle, 0][found], atol=0.3)
    assert not np.any(np.isfinite(find_lines(image, profiles, 3.0)[middle]))


@any_view
@pytest.mark.parametrize("search_range", [3.0, 4.0, 12.0])
def test_one_look_serves_all_search_ranges(truth, search_range):
    profiles, image = profiles_along(moved(truth, 2.0), MARKINGS), picture(truth)
    offset = Strips.of(image, profiles, 12.0).lines(search_range)
    assert np.isfinite(offset).any()
    np.testing.assert_array_equal(offset, find_lines(image, profiles, search_range))


def test_room_is_half_the_distance_to_the_nearest_profile_of_another_marking():
    profiles = profiles_along(VIEWS["penalty area"], MARKINGS)
    distance = np.linalg.norm(profiles.xy[:, None] - profiles.xy, axis=-1)
    distance[profiles.member[:, None] == profiles.member] = np.inf
    np.testing.assert_allclose(profiles.room, 0.5 * distance.min(axis=1), atol=1e-3)


def test_images_refined_together_are_refined_as_alone():
    starts = [replace(calibrated(truth), camera=moved(truth, 5.0, seed=1)) for truth in VIEWS.values()]
    given = [ToRefine(picture(truth), start) for truth, start in zip(VIEWS.values(), starts, strict=True)]
    together = refine_all(Task(FIELD, flags=DEFAULT_FLAGS), MARKINGS, given)
    for one, found in zip(given, together, strict=True):
        alone = refine_on_image(FIELD, one.image, one.calibration)
        assert found.support == pytest.approx(line_support(one.image, found.calibration.camera, MARKINGS), abs=1e-7)
        np.testing.assert_allclose(found.calibration.camera.C, alone.camera.C, atol=1e-6)


# --- homographies of anybody ---


@any_view
def test_a_homography_becomes_a_camera_with_a_lens(truth):
    """A homography has no lens and is off by some pixels; the lines of the image say both."""
    image = picture(truth)
    width, height = truth.image_size
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    moved_corners = corners + np.random.default_rng(3).normal(scale=3.0, size=(4, 2)).astype(np.float32)
    H = cv2.getPerspectiveTransform(corners, moved_corners) @ truth.pinhole_homography
    start = calibrate_from_homography(H, truth.image_size)
    refined = refine_homography_on_image(FIELD, image, H)
    assert refined.accepted
    assert distance(refined.camera, truth) < 1.0 < 2.0 < distance(start.camera, truth)
    assert refined.knows_errors
    assert refined.camera.k[0] == pytest.approx(truth.k[0], abs=0.25 * abs(truth.k[0]) + 0.2)


def test_a_homography_of_another_image_stays_as_it_is_and_says_so():
    truth, other = VIEWS["penalty area"], VIEWS["midfield"]
    kept = refine_homography_on_image(FIELD, picture(truth), other.pinhole_homography)
    assert kept.camera == calibrate_from_homography(other.pinhole_homography, other.image_size).camera
    assert kept.message.endswith("not refined: the image shows too few lines at its markings")
    nothing = refine_homography_on_image(FIELD, picture(truth), np.diag([10.0, 1.0, 1.0]))
    assert nothing.camera is None
    with pytest.raises(ValueError, match="image is None"):
        refine_homography_on_image(FIELD, None, other.pinhole_homography)


def test_a_homography_in_yards_is_told_by_the_image():
    truth = VIEWS["close"]
    found = refine_homography_on_image(FIELD, picture(truth), truth.pinhole_homography @ np.diag([0.9144, 0.9144, 1.0]))
    assert found.message.endswith("if H maps yards: then give H @ np.diag([1.09361, 1.09361, 1])")


def test_a_homography_in_yards_is_mended_where_the_paint_is_near():
    truth = VIEWS["penalty area"]
    found = refine_homography_on_image(FIELD, picture(truth), truth.pinhole_homography @ np.diag([0.9144, 0.9144, 1.0]))
    assert distance(found.camera, truth) < 1.0


# --- the field that a picture shows ---


@pytest.mark.parametrize("width", [66.0, 70.0])
@pytest.mark.parametrize("off", [-4.0, 6.0])
def test_a_touchline_without_paint_does_not_tell_the_width(width, off):
    """The near touchline does: the label of the far one is some pixels off, as a network's may be, and rubbed out."""
    pitch, truth, far = soccer(105.0, width), VIEWS["midfield"], "Side line top"
    labels = observe(whole_circle_markings(pitch), truth)
    labels[far] = labels[far] + (0.0, off)
    line = truth.project(pitch[far].sample(1.0))
    rubbed = cv2.polylines(np.zeros(SIZE[::-1], np.uint8), [np.round(line).astype(int)], False, 255, 9)
    image = cv2.inpaint(picture(truth, pitch), rubbed, 3, cv2.INPAINT_TELEA)
    task, pixels = Task(FIELD), PixelTable.of(FIELD, [labels])
    (start,) = calibrate_on_lines(task, [pixels], SIZE, [truth])
    seen = on_field_as_seen(task, image, start, pixels)
    assert seen.calibration.field.width == pytest.approx(width, abs=0.1)  # with that label 61.7 to 73.2 m
