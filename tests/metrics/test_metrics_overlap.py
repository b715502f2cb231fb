"""Overlap on the field and errors in metres, against exact areas and distances."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import cameras, examples, vectors

from fieldcalib import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import dehomogenize, homogenize
from fieldcalib.metrics import iou_part, iou_whole, projection_error

SIZE = (960, 540)
FIELD = [(-52.5, -34.0), (52.5, -34.0), (52.5, 34.0), (-52.5, 34.0)]
BORDER = np.array([(0.0, 0.0), (959.0, 0.0), (959.0, 539.0), (0.0, 539.0)])
RASTER = 0.01  # what the rasters may be off


def unchecked(camera):
    return Camera(camera.K, camera.R, camera.C, camera.image_size, camera.dist, checked=False)


def from_above(scale, x=0.0, y=0.0):
    """The homography of a straight view down: `scale` pixels a metre, (x, y) in the middle of the image."""
    return np.array([[scale, 0.0, 479.5 - scale * x], [0.0, scale, 269.5 - scale * y], [0.0, 0.0, 1.0]])


def test_the_cells_of_iou_part_may_be_of_another_size():
    views = from_above(9.0), from_above(9.0, x=0.4)  # 106.6 m wide: the left end of one is not in view
    fine, yards = (iou_part(*views, SIZE, cell=cell) for cell in (0.25, 0.9144))
    assert fine == iou_part(*views, SIZE)
    assert yards == pytest.approx(fine, abs=0.02)
    for cell in (0.0, 100.0, np.nan):
        with pytest.raises(ValueError, match="cell must be metres"):
            iou_part(*views, SIZE, cell=cell)


# --- exact areas ---


def area(polygon):
    x, y = np.array(polygon, dtype=float).reshape(-1, 2).T
    return 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def clipped(polygon, convex):
    """The part of a polygon inside a convex one, by cutting along each side of it (Sutherland & Hodgman)."""
    convex = np.array(convex, dtype=float)
    middle = convex.mean(axis=0)
    points = [np.array(p, dtype=float) for p in polygon]
    for a, b in zip(convex, np.roll(convex, -1, axis=0), strict=True):
        normal = np.array([a[1] - b[1], b[0] - a[0]])
        normal *= np.sign(normal @ (middle - a))
        found = []
        for p, q in zip(points, points[1:] + points[:1], strict=True):
            dp, dq = normal @ (p - a), normal @ (q - a)
            if dp >= 0.0:
                found.append(p)
            if dp * dq < 0.0:
                found.append(p + (q - p) * dp / (dp - dq))
        points = found
    return points


def exact_iou(a, b):
    """Of two convex polygons."""
    common = area(clipped(a, b))
    return common / (area(a) + area(b) - common)


def view(camera):
    """What a pinhole camera sees of the ground, a convex quadrilateral; None where its horizon is in the image."""
    corners = camera.image_to_field(BORDER)[:, :2]
    return corners if np.all(np.isfinite(corners)) and np.max(np.abs(corners)) < 1e3 else None


@st.composite
def pairs(draw, change):
    """Two cameras that differ a little: (prediction, truth)."""
    truth = draw(cameras(lens=False, image_sizes=(SIZE,)))
    angles = truth.angles + draw(vectors([-2.0 * change] * 3, [2.0 * change] * 3))
    return Camera.from_angles(*angles, truth.K[0, 0] * (1 + change), truth.C + 20 * change, SIZE), truth


def test_the_exact_areas_are_exact():
    assert area(FIELD) == 105.0 * 68.0
    assert area(clipped(FIELD, np.array(FIELD) + (5.0, 8.0))) == pytest.approx(100.0 * 60.0)
    assert clipped(FIELD, np.array(FIELD) + 200.0) == []
    diamond = [(0, 1), (1, 0), (0, -1), (-1, 0)]
    assert area(clipped(diamond, [(-0.5, -2), (0.5, -2), (0.5, 2), (-0.5, 2)])) == pytest.approx(1.5)


# --- IoU_part ---


@pytest.mark.parametrize("shift", [(0.0, 0.0), (5.0, 0.0), (0.0, -8.0), (10.0, 5.0), (12.0, 20.0)])
def test_iou_part_of_shifted_views(shift):
    """The image shows 47.95 m x 26.95 m."""
    dx, dy = np.abs(shift)
    common = (47.95 - dx) * (26.95 - dy)
    expected = common / (2 * 47.95 * 26.95 - common)
    assert iou_part(from_above(20.0, *shift), from_above(20.0), SIZE) == pytest.approx(expected, abs=RASTER)


def test_iou_part_counts_the_field_alone():
    # 4.5 m of the shifted view are right of the field: x up to 33.0 + 23.975 = 56.975
    common, other = 47.95 - 33.0, 33.0 + 23.975 - 52.5
    expected = common / (2 * 47.95 - common - other)
    assert iou_part(from_above(20.0, 33.0), from_above(20.0), SIZE) == pytest.approx(expected, abs=RASTER)
    # both show the whole field, however differently; on a longer field they do not
    near, far = from_above(7.8), from_above(2.0, 5.0, 5.0)
    assert iou_part(near, far, SIZE) == 1.0
    assert iou_part(near, far, SIZE, field=soccer(150.0, 68.0)) == pytest.approx(959 / 7.8 / 150.0, abs=RASTER)


def test_iou_part_other_overlap():
    assert iou_part(from_above(30.0, -30.0), from_above(30.0, 30.0), SIZE) == 0.0
    away = Camera.from_angles(np.pi, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)
    assert iou_part(away, from_above(20.0), SIZE) == iou_part(away, away, SIZE) == 0.0


def depth_in(polygon, points):
    """Distances of points (N, 2) to the nearest of the lines of a convex polygon's sides, (N,); negative outside."""
    a = np.array(polygon, dtype=float)
    along = np.roll(a, -1, axis=0) - a
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    normal *= np.sign(np.sum(normal * (a.mean(axis=0) - a), axis=1, keepdims=True))  # inwards
    return np.min(points @ normal.T - np.sum(normal * a, axis=1), axis=1)


@given(pair=pairs(0.02))
def test_iou_part_of_cameras_counts_the_cells_in_exact_polygons(pair):
    """A cell counts where its centre is in view. The areas themselves say less: where both views have 60 square metres,
    and so 1000 cells, their ratio differs by 0.01."""
    polygons = [view(camera) for camera in pair]
    assume(all(polygon is not None for polygon in polygons))
    x, y = np.meshgrid(np.arange(420) * 0.25 - 52.375, np.arange(272) * 0.25 - 33.875)
    a, b = (depth_in(polygon, np.column_stack([x.ravel(), y.ravel()])) for polygon in polygons)
    on_a_side = np.minimum(np.abs(a), np.abs(b)) < 1e-6  # there rounding decides
    both, either = (np.count_nonzero(part & ~on_a_side) for part in ((a > 0) & (b > 0), (a > 0) | (b > 0)))
    unsure = np.count_nonzero(on_a_side)
    assume(either > 0)
    assert both / (either + unsure) <= iou_part(*pair, SIZE) <= (both + unsure) / either


@examples(10)
@given(pair=pairs(0.02), scale=st.sampled_from([-1.0, 1e-4, -50.0]))
def test_iou_part_is_symmetric_and_takes_homographies(pair, scale):
    a, b = pair
    corners = np.array([(x, y, 0.0) for x, y in FIELD])
    assume(all(np.all((corners - camera.C) @ camera.R[2] > 0.1) for camera in pair))
    expected = iou_part(a, b, SIZE)
    assert iou_part(b, a, SIZE) == expected
    assert iou_part(scale * a.pinhole_homography, b, SIZE) == pytest.approx(expected, abs=1e-3)
    assert iou_part(scale * b.pinhole_homography, b.pinhole_homography, SIZE) == 1.0


@examples(10)
@given(camera=cameras(lens=True))
def test_iou_part_of_equal_cameras_is_1(camera):
    assert iou_part(camera, camera, camera.image_size) == 1.0
    assert iou_part(unchecked(camera), camera, camera.image_size) == pytest.approx(1.0, abs=RASTER)


@examples(10)
@given(x=st.floats(-50, 50), y=st.floats(-30, 30), pan=st.floats(-3.1, 3.1), tilt=st.floats(0.6, 1.5))
def test_a_homography_does_not_see_what_is_behind_its_camera(x, y, pan, tilt):
    """From above the field, half of it lies behind: the sign of the homography is settled by the camera's height."""
    camera = Camera.from_angles(pan, tilt, 0.0, 500.0, (x, y, -12.0), SIZE)
    assume(iou_part(camera, camera, SIZE) == 1.0)  # something of the field is in view
    for sign in (-1.0, 1.0):
        assert iou_part(sign * camera.pinhole_homography, camera, SIZE) == pytest.approx(1.0, abs=1e-3)
        error = projection_error(sign * camera.pinhole_homography, camera, SIZE)
        assert error.unseen == 0.0 or np.isnan(error.unseen)


def test_cameras_for_images_of_another_size_are_refused():
    camera = Camera.from_angles(0.1, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (1920, 1080))
    for function in (iou_part, iou_whole, projection_error):
        with pytest.raises(
            ValueError, match=r"for images of 1920x1080, but the evaluated images have 960x540: .*scaled"
        ):
            function(camera, camera, SIZE)


@pytest.mark.parametrize("k1", [-0.25, 0.25])
def test_iou_part_sees_the_lens(k1):
    """Against the exact outline of what a camera with a lens sees; the other lens would change it by 0.1."""
    lens, other = (Camera.from_angles(0.1, 0.6, 0.0, 900.0, (0, 24, -40), SIZE, k=(k, 0.0)) for k in (k1, -k1))
    steps = np.linspace(0.0, 1.0, 100, endpoint=False)[:, None]
    outline = np.concatenate([a + steps * (b - a) for a, b in zip(BORDER, np.roll(BORDER, -1, axis=0), strict=True)])
    seen = clipped(lens.image_to_field(outline)[:, :2], FIELD)
    truth = from_above(20.0, 1.0, -2.0)
    rectangle = dehomogenize(homogenize(BORDER) @ np.linalg.inv(truth).T)
    common = area(clipped(seen, rectangle))
    expected = common / (area(seen) + area(rectangle) - common)
    assert iou_part(lens, truth, SIZE) == pytest.approx(expected, abs=RASTER)
    assert iou_part(unchecked(lens), truth, SIZE) == pytest.approx(expected, abs=RASTER)
    assert abs(iou_part(other, truth, SIZE) - expected) > 3 * RASTER


# --- IoU_whole ---


@pytest.mark.parametrize("shift", [0.0, 10.0, 40.0, 100.0, 110.0])
def test_iou_whole_of_shifted_views_by_hand(shift):
    """Eight pixels a metre: the field is 105 m long, the image 120 m."""
    template = max(105.0 - shift, 0.0) / (105.0 + min(shift, 105.0))
    image = max(120.0 - shift, 0.0) / (120.0 + shift)
    shifted, truth = from_above(8.0, shift), from_above(8.0)
    assert iou_whole(shifted, truth, SIZE) == pytest.approx(template, abs=RASTER)
    assert iou_whole(shifted, truth, SIZE, kind="image") == pytest.approx(image, abs=RASTER)


def test_iou_whole_of_scaled_views_by_hand():
    """A quarter of the area; and nothing is counted beyond four times the size: 1 / 16 instead of 1 / 64."""
    small, truth = np.diag([0.5, 0.5, 1.0]) @ from_above(8.0), from_above(8.0)
    for kind in ("template", "image"):
        for pair in ((from_above(4.0), from_above(8.0)), (from_above(8.0), from_above(4.0))):
            assert iou_whole(*pair, SIZE, kind=kind) == pytest.approx(0.25, abs=RASTER)
    assert iou_whole(small, truth, SIZE, kind="image") == pytest.approx(0.25, abs=1e-3)
    assert iou_whole(from_above(1.0), from_above(8.0), SIZE) == pytest.approx(1 / 16, abs=1e-3)


@given(pair=pairs(0.01), kind=st.sampled_from(["template", "image"]))
def test_iou_whole_against_exact_polygons(pair, kind):
    H_pred, H_true = (camera.pinhole_homography for camera in pair)
    if kind == "template":
        rectangle, back = np.array(FIELD), np.linalg.inv(H_pred) @ H_true
    else:
        rectangle = np.array([(0.0, 0.0), (960.0, 0.0), (960.0, 540.0), (0.0, 540.0)])
        back = H_pred @ np.linalg.inv(H_true)
    warped = homogenize(rectangle) @ back.T
    assume(np.all(warped[:, 2] > 0.0) or np.all(warped[:, 2] < 0.0))  # else it goes through infinity
    corners = dehomogenize(warped)
    low, high = rectangle.min(axis=0), rectangle.max(axis=0)
    assume(np.all(corners > low - 1.4 * (high - low)) and np.all(corners < high + 1.4 * (high - low)))
    expected = exact_iou(corners, rectangle)
    assert iou_whole(*pair, SIZE, kind=kind) == pytest.approx(expected, abs=RASTER)


@given(camera=cameras(), scale=st.sampled_from([1.0, -1.0, 1e-4, -50.0]), kind=st.sampled_from(["template", "image"]))
def test_iou_whole_of_equal_homographies_is_1(camera, scale, kind):
    assert iou_whole(scale * camera.pinhole_homography, camera, camera.image_size, kind=kind) == 1.0


@given(pair=pairs(0.02), scale=st.sampled_from([-1.0, 1e-4, -50.0]), kind=st.sampled_from(["template", "image"]))
def test_iou_whole_knows_neither_scale_nor_sign_nor_lens(pair, scale, kind):
    a, b = pair
    expected = iou_whole(a, b, SIZE, kind=kind)
    assert iou_whole(scale * a.pinhole_homography, b.pinhole_homography, SIZE, kind=kind) == pytest.approx(
        expected, abs=1e-4
    )
    bent = Camera(a.K, a.R, a.C, SIZE, (0.01, 0.0))
    assert iou_whole(bent, b, SIZE, kind=kind) == expected


def test_unknown_kind():
    with pytest.raises(ValueError, match="kind must be one of template, image, got 'whole'"):
        iou_whole(np.eye(3), np.eye(3), SIZE, kind="whole")


# --- metres ---


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.0, 4.0), (-0.6, 0.8)])
@pytest.mark.parametrize("scale", [1.0, -1e-3])
def test_projection_error_of_a_known_shift(shift, scale):
    for prediction, truth in (
        (scale * from_above(10.0, *shift), from_above(10.0)),
        *((moved(k, shift), moved(k)) for k in (0.0, -0.1)),
        (unchecked(moved(-0.1, shift)), moved(-0.1)),
    ):
        error = projection_error(prediction, truth, SIZE)
        distance = np.hypot(*shift)
        np.testing.assert_allclose([error.mean, error.median, error.largest], distance, rtol=0, atol=1e-6)
        assert error.unseen == 0.0


def moved(k1, shift=(0.0, 0.0)):
    return Camera.from_angles(0.2, 1.2, 0.0, 1200.0, (shift[0], 60.0 + shift[1], -18.0), SIZE, k=(k1, 0.0))


def test_projection_error_by_hand():
    """One part in a hundred too large: each point is off by a hundredth of its distance from the centre."""
    step = 960 / 64
    x, y = np.meshgrid(np.arange(step / 2, 960, step) - 480, np.arange(step / 2, 540, step) - 270)
    inside = (np.abs(x) <= 525) & (np.abs(y) <= 340)
    expected = 0.01 * np.hypot(x, y)[inside] / 10.0
    assert inside.all()
    error = projection_error(from_above(10.0 / 1.01), from_above(10.0), SIZE)
    np.testing.assert_allclose(error.mean, expected.mean(), rtol=1e-9)
    np.testing.assert_allclose(error.median, np.median(expected), rtol=1e-9)
    np.testing.assert_allclose(error.largest, expected.max(), rtol=1e-9)


def test_projection_error_counts_pixels_on_the_true_field():
    """Everything that the truth sees is beyond the touchline, whatever the prediction says of it."""
    beyond, seen = from_above(20.0, 0.0, 60.0), from_above(20.0)
    error = projection_error(seen, beyond, SIZE)
    assert np.all(np.isnan([error.mean, error.median, error.largest, error.unseen]))
    assert projection_error(beyond, seen, SIZE).mean == pytest.approx(60.0)
    longer = projection_error(seen, beyond, SIZE, field=soccer(105.0, 160.0))
    assert longer.mean == pytest.approx(60.0)


def test_projection_error_where_the_prediction_sees_no_ground():
    truth = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)
    up = Camera.from_angles(0.0, 2.0, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)
    error = projection_error(up, truth, SIZE)
    assert np.all(np.isnan([error.mean, error.median, error.largest]))
    assert error.unseen == 1.0
    assert np.isnan(projection_error(truth, up, SIZE).unseen)
    half = Camera.from_angles(0.0, np.pi / 2, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)  # its horizon at half height
    error = projection_error(half, truth, SIZE)
    assert 0.2 < error.unseen < 0.6
    assert error.mean > 10.0


# --- absurd and wrong input ---

GOOD = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)


def absurd(f=1500.0, C=(0.0, 60.0, -15.0), dist=(0.0,) * 12):
    return Camera(np.array([[f, 0, 480], [0, f, 270], [0, 0, 1.0]]), GOOD.R, C, SIZE, dist, checked=False)


@pytest.mark.parametrize(
    "prediction",
    [
        absurd(f=0.0),
        absurd(f=1e-200),
        absurd(f=1e200),
        absurd(f=-1500.0),
        absurd(C=(0.0, 60.0, 0.0)),
        absurd(C=(1e160, 60.0, -15.0)),
        absurd(C=(1e300, 1e300, 1e300)),
        absurd(dist=np.full(12, 1e200)),
        absurd(dist=np.random.default_rng(0).normal(size=12)),
        np.zeros((3, 3)),
        np.ones((3, 3)),
        np.diag([1.0, 1.0, 0.0]),
        np.full((3, 3), 1e200) + 1e200 * np.eye(3),
    ],
    ids=lambda p: "",
)
def test_absurd_predictions_have_a_score(prediction):
    for pair in ((prediction, GOOD), (GOOD, prediction)):
        scores = [iou_part(*pair, SIZE), *(iou_whole(*pair, SIZE, kind=kind) for kind in ("template", "image"))]
        assert all(0.0 <= score <= 1.0 for score in scores)
        error = projection_error(*pair, SIZE)
        assert error.mean > 1.0 or np.isnan(error.mean)


def test_cameras_that_see_a_line_have_no_overlap():
    for kind in ("template", "image"):
        for prediction in (absurd(f=0.0), absurd(C=(0.0, 60.0, 0.0)), np.ones((3, 3)), np.zeros((3, 3))):
            assert iou_whole(prediction, GOOD, SIZE, kind=kind) == 0.0


@pytest.mark.parametrize("metric", [iou_part, iou_whole, projection_error])
def test_wrong_input(metric):
    for pair in ((np.eye(4), GOOD), (GOOD, "camera"), (np.full((3, 3), np.nan), GOOD), (None, GOOD)):
        with pytest.raises(ValueError, match="expected a Camera or a homography"):
            metric(*pair, SIZE)
    with pytest.raises(ValueError, match="image_size must be"):
        metric(GOOD, GOOD, (960.5, 540))
    nested = GOOD.pinhole_homography.tolist()
    assert metric(nested, GOOD, SIZE) == metric(GOOD.pinhole_homography, GOOD, SIZE)
