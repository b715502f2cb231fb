"""What is drawn lies where the markings are, to fractions of a pixel, and nothing lies elsewhere."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree
from views import BROADCAST, CAMERAS, SIZE, any_camera, camera, inside

from fieldcalib.assess.findings import Status
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.minimap import draw_minimap
from fieldcalib.draw.overlays import PALETTE, draw_calibration, draw_field, draw_segments, label_colour
from fieldcalib.draw.scene import text_size
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, Point, PointCloud
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.solve.from_homography import calibrate_from_homography

FIELD = soccer()
RED = (0, 0, 255)
FAINT = 25  # of 255: what smooth edges may reach


def black():
    return np.zeros((SIZE[1], SIZE[0], 3), np.uint8)


def true_pixels(camera, X):
    """Pixels in the image of world points in front of the camera: the textbook's projection, step by step."""
    Xc = (X - camera.C) @ camera.R.T
    Xc = Xc[Xc[:, 2] > 0.01]
    x = Xc[:, :2] / Xc[:, 2:]
    r2 = np.sum(x**2, axis=1, keepdims=True)
    x = np.where(r2 < 4.0, x * (1.0 + camera.k[0] * r2 + camera.k[1] * r2**2), np.inf)
    xy = x * camera.focal_length + camera.principal_point
    return xy[np.all((xy > -3.0) & (xy < np.array(SIZE) + 2.0), axis=1)]


def farthest(mask, xy):
    """Largest distance of the pixels of a mask from the nearest of the points xy."""
    rows, columns = np.nonzero(mask)
    return cKDTree(xy).query(np.column_stack([columns, rows]))[0].max(initial=0.0)


# draw_field


@any_camera
@pytest.mark.parametrize(("thickness", "reach"), [(1, 1.5), (2, 2.8)])  # OpenCV's smooth lines are wide
def test_markings_are_drawn_where_they_are_and_nowhere_else(camera, thickness, reach):
    drawn = draw_field(black(), camera, FIELD, colour=RED, thickness=thickness)[..., 2]
    truth = true_pixels(camera, np.concatenate([s.sample(0.004) for s in FIELD.markings.values()]))
    assert drawn.max() > 200
    assert farthest(drawn > FAINT, truth) < reach
    assert farthest(drawn > 0, truth) < reach + 0.6
    pixel = np.rint(truth[inside(truth)]).astype(int)
    assert np.all(drawn[pixel[:, 1], pixel[:, 0]] > 0)


def test_the_check_of_drawings_would_notice_a_shift():
    drawn = draw_field(black(), BROADCAST, FIELD, colour=RED, thickness=1)[..., 2]
    truth = true_pixels(BROADCAST, np.concatenate([s.sample(0.004) for s in FIELD.markings.values()]))
    assert farthest(drawn > FAINT, truth + np.array([0.0, 1.0])) > 1.8


def test_a_line_that_passes_below_the_camera_is_cut_off_behind_it():
    # half of the line is behind the camera, where projecting without care would mirror it into the upper image
    low = camera(0, 85, 600, (0.5, 0.0, -1.5))
    drawn = draw_field(black(), low, {"Middle line": FIELD["Middle line"]}, colour=RED, thickness=1)[..., 2]
    rows, columns = np.nonzero(drawn)
    start, end = np.array(FIELD["Middle line"].start), np.array(FIELD["Middle line"].end)
    P = low.K @ low.R @ np.column_stack([np.eye(3), -low.C])
    line = np.cross(P @ [*start, 1.0], P @ [*end, 1.0])
    distance = np.abs(np.column_stack([columns, rows, np.ones(len(rows))]) @ line) / np.hypot(*line[:2])
    top = low.project(start)[1]
    assert distance.max() < 1.5
    assert rows.min() >= top - 2.0
    assert rows.max() == SIZE[1] - 1  # down to the border
    assert len(np.unique(rows)) == SIZE[1] - rows.min()  # without a gap


def test_lines_are_drawn_at_fractions_of_a_pixel():
    overhead = camera(0, 0, 1000, (0, 0, -100))  # 10 px a metre
    for y in np.linspace(-3.0, -2.9, 7):
        drawn = draw_field(black(), overhead, {"line": Line((-30, y, 0), (30, y, 0))}, colour=RED, thickness=1)
        column = drawn[:, 480, 2].astype(float)
        assert column @ np.arange(SIZE[1]) / column.sum() == pytest.approx(overhead.project([0, y, 0])[1], abs=0.15)


@pytest.mark.parametrize("thickness", [1, 2, 3])
def test_lines_follow_a_slow_pan_without_jumps(thickness):
    """By 0.03 px a frame; a line that is drawn at whole pixels would stand still and then jump by one."""
    middle_line = {"Middle line": FIELD["Middle line"]}
    off = []
    for step in range(40):
        slow = camera(5 + 0.001 * step, 78, 1800, (0, 70, -18))
        drawn = draw_field(black(), slow, middle_line, colour=RED, thickness=thickness)[250:400, :, 2].astype(float)
        rows = np.arange(250, 400)
        columns = drawn @ np.arange(SIZE[0]) / drawn.sum(axis=1)
        line = slow.project(FIELD["Middle line"].sample(0.05))
        order = np.argsort(line[:, 1])
        off.append(columns - np.interp(rows, line[order, 1], line[order, 0]))
    assert np.abs(np.median(off, axis=1)).max() < 0.05
    assert np.abs(np.diff(off, axis=0)).max() < 0.2


def test_the_border_cuts_markings_without_bending_them():
    large = Camera.from_angles(
        *BROADCAST.angles, BROADCAST.focal_length, BROADCAST.C, (1160, 740), BROADCAST.principal_point + 100.0
    )
    whole = draw_field(np.zeros((740, 1160, 3), np.uint8), large, FIELD, colour=RED)[100:640, 100:1060, 2]
    cut = draw_field(black(), BROADCAST, FIELD, colour=RED)[..., 2]
    difference = np.abs(whole.astype(int) - cut)
    assert cut[:, [0, -1]].max() == 255
    assert difference.max() < 128  # of 255: a third of a pixel, from OpenCV's own clipping
    assert difference.mean() < 0.05


def test_points_are_left_out():
    assert not draw_field(black(), BROADCAST, FIELD.points).any()


def test_unordered_clouds_are_dots():
    X = np.array([[-30.0, 0, 0], [-25, 5, 0], [-20, -4, -1]])
    drawn = draw_field(black(), BROADCAST, {"cloud": PointCloud(X)}, colour=RED, thickness=3)[..., 2]
    assert farthest(drawn > FAINT, BROADCAST.project(X)) < 4.5
    assert np.all(drawn[tuple(np.rint(BROADCAST.project(X)).astype(int).T[::-1])] == 255)


def test_ordered_clouds_are_smooth_curves():
    circle = Arc((-30, 0, 0), 9.15)
    cloud = PointCloud(circle.sample(2.0), ordered=True)
    drawn = draw_field(black(), BROADCAST, {"curve": cloud}, colour=RED, thickness=1)[..., 2]
    truth = true_pixels(BROADCAST, circle.sample(0.004))
    assert farthest(drawn > FAINT, truth) < 1.5
    pixel = np.rint(truth[inside(truth)]).astype(int)
    assert np.mean(drawn[pixel[:, 1], pixel[:, 0]] > 0) > 0.98


def test_nothing_in_view_draws_nothing():
    away = camera(180, 78, 1800, (0, 70, -18))
    assert not draw_field(black(), away, FIELD).any()


# draw_segments


def test_dots_have_the_colour_of_their_label():
    pixels = {"Middle line": [(100.0, 50.0), (120.0, 400.0)], "Circle left": [(500.0, 300.0)]}
    picture = draw_segments(black(), pixels, names=False)
    for label, xy in pixels.items():
        for x, y in np.array(xy, int):
            assert tuple(picture[y, x]) == label_colour(label)
    assert farthest(picture.any(axis=-1), [(100, 50), (120, 400), (500, 300)]) < 6.5


def test_a_colour_does_not_depend_on_other_labels():
    alone = draw_segments(black(), {"Circle left": [(500, 300)]}, names=False)
    together = draw_segments(black(), {"A": [(10, 10)], "Circle left": [(500, 300)], "B": [(90, 9)]}, names=False)
    assert np.array_equal(alone[290:310, 490:510], together[290:310, 490:510])
    assert label_colour("Goal left post left ") == label_colour("Goal left post left")


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    "labels",
    [
        ("Goal {} crossbar", "Goal {} post left", "Goal {} post right", "Side line {}"),
        ("Big rect. {} top", "Big rect. {} bottom", "Big rect. {} main", "Circle {}"),
        ("Small rect. {} top", "Small rect. {} bottom", "Small rect. {} main", "Side line {}"),
    ],
)
def test_neighbours_have_different_colours(labels, side):
    assert len({label_colour(label.format(side)) for label in labels}) == len(labels)


def test_colours_stand_out_from_grass_and_lines():
    for colour in PALETTE:
        assert np.linalg.norm(np.subtract(colour, (55, 130, 72))) > 100
        assert np.linalg.norm(np.subtract(colour, (242, 248, 244))) > 50


def test_names_are_written_beside_dots_not_on_them():
    pixels = {"Middle line": [(300, 200)], "Side line top": [(310, 205)], "Circle central": [(470, 200)]}
    with_names, without = draw_segments(black(), pixels), draw_segments(black(), pixels, names=False)
    assert np.any(with_names != without)
    for x, y in ((300, 200), (310, 205), (470, 200)):
        assert np.array_equal(with_names[y - 2 : y + 3, x - 2 : x + 3], without[y - 2 : y + 3, x - 2 : x + 3])


@pytest.mark.parametrize("xy", [[], [(-1e9, 3.0)], [(np.nan, 3.0)], [(2000.0, 50.0)], np.empty((0, 2))])
def test_pixels_outside_the_image_are_not_drawn(xy):
    assert not draw_segments(black(), {"Middle line": xy}).any()


def test_wrong_shape_of_pixels():
    with pytest.raises(ValueError, match=r"'Middle line': expected pixels of shape \(N, 2\), got \(2, 3\)"):
        draw_segments(black(), {"Middle line": np.zeros((2, 3))})


# all that draw on an image


def draw_both(image):
    return draw_field(image, BROADCAST, FIELD), draw_segments(image, {"Middle line": [(100, 50)]})


def test_the_input_image_is_not_changed():
    image = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    for picture in draw_both(image):
        assert picture.dtype == np.uint8
        assert picture.shape == image.shape
        assert not np.shares_memory(picture, image)
        assert np.any(picture != 90)
    assert np.all(image == 90)


def test_views_and_read_only_images_are_fine():
    image = np.random.default_rng(0).integers(0, 255, (SIZE[1], SIZE[0], 3)).astype(np.uint8)
    view = image[:, :, ::-1]
    view.flags.writeable = False
    for from_view, from_copy in zip(draw_both(view), draw_both(view.copy()), strict=True):
        assert np.array_equal(from_view, from_copy)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((540, 960, 3)), r"must be uint8, got float64; for values in 0\.\.1 pass \(255 \* image\)"),
        (np.zeros((540, 960), np.uint8), r"\(height, width, 3\).*got shape \(540, 960\); cv2\.cvtColor"),
        (np.zeros((540, 960, 4), np.uint8), r"got shape \(540, 960, 4\)"),
    ],
)
def test_wrong_images(image, message):
    with pytest.raises(ValueError, match=message):
        draw_field(image, BROADCAST, FIELD)
    with pytest.raises(ValueError, match=message):
        draw_segments(image, {})


def test_an_image_of_another_size_than_the_camera():
    with pytest.raises(ValueError, match=r"960 x 540, got 480 x 270; pass camera\.scaled\(\(480, 270\)\)"):
        draw_field(np.zeros((270, 480, 3), np.uint8), BROADCAST, FIELD)


# draw_minimap


def map_pixel(x, y, size):
    """Where draw_minimap of a 105 x 68 m field puts a ground point: centred, 7 m around the field."""
    scale = min(size[0] / 119.0, size[1] / 82.0)
    return round((size[1] - 1) / 2 + scale * y), round((size[0] - 1) / 2 + scale * x)


@pytest.mark.parametrize("size", [(336, 228), (200, 200)])
@pytest.mark.parametrize("name", ["broadcast", "wide, rolled", "barrel lens", "on the field"])
def test_the_map_lights_what_the_camera_sees(name, size):
    seen, unseen = CAMERAS[name], camera(180, 78, 1800, (0, 70, -18))
    lit = draw_minimap(seen, FIELD, size=size).sum(axis=-1) > draw_minimap(unseen, FIELD, size=size).sum(axis=-1)
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform((-45, -28), (45, 26), (2000, 2)), np.zeros(2000)])
    X = X[np.linalg.norm(X - seen.C * (1, 1, 0), axis=1) > 6.0]  # not under the camera's own mark
    around = 1.5 * np.array([(0, 0, 0), (1, 1, 0), (-1, 1, 0), (1, -1, 0), (-1, -1, 0)])
    visible = inside(np.nan_to_num(seen.project(X[:, None] + around).reshape(-1, 2), nan=1e9)).reshape(-1, 5)
    clearly_in, clearly_out = visible.all(axis=1), ~visible.any(axis=1)
    assert clearly_in.sum() > 20
    assert clearly_out.sum() > 20
    found = np.array([lit[map_pixel(x, y, size)] for x, y, _ in X])
    assert np.all(found[clearly_in])
    assert not np.any(found[clearly_out])


def test_the_map_shows_a_camera_on_it_and_the_way_to_one_beyond():
    on_it = draw_minimap(camera(0, 70, 800, (20, 10, -15)), FIELD)
    assert on_it[map_pixel(20, 10, (336, 228))].min() == 255
    for C, edge in (((0, 200, -15), np.s_[-20:]), ((0, -200, -15), np.s_[:20])):
        beyond = draw_minimap(camera(0, 70, 800, C), FIELD)
        white = np.all(beyond == 255, axis=-1)
        assert white[edge].sum() > 20
        assert white.sum() == white[edge].sum()


def test_the_map_follows_a_slow_pan_without_jumps():
    """What the camera sees moves by up to 0.15 px a frame; without smooth edges pixels would change by 90 at once."""
    maps = [draw_minimap(camera(-20 + 0.02 * step, 78, 1800, (0, 70, -18)), FIELD) for step in range(30)]
    light = np.mean(maps, axis=-1)
    assert np.ptp(light, axis=0).max() > 60.0
    assert np.abs(np.diff(light, axis=0)).max() < 20.0


def test_a_map_is_not_drawn_over_the_one_before():
    first = draw_minimap(BROADCAST, FIELD)
    kept = first.copy()
    draw_minimap(camera(30, 78, 1800, (0, 70, -18)), FIELD)[:] = 0
    assert np.array_equal(first, kept)
    assert np.array_equal(draw_minimap(BROADCAST, FIELD), kept)


def test_wrong_size_of_the_map():
    with pytest.raises(ValueError, match="image_size must be"):
        draw_minimap(BROADCAST, FIELD, size=(100, 0))


def test_markings_of_a_rejected_camera_are_dashed():
    image = black()
    whole, dashed = (draw_field(image, BROADCAST, soccer(), dashed=one).any(axis=2) for one in (False, True))
    assert 0.35 < np.count_nonzero(dashed) / np.count_nonzero(whole) < 0.8
    assert not np.any(dashed & ~cv2.dilate(whole.astype(np.uint8), np.ones((3, 3))).astype(bool))


def test_markings_off_their_paint_have_a_colour_of_their_own():
    image = black()
    found = calibrate_from_homography(BROADCAST.homography, BROADCAST.image_size)
    beside = [MarkingInView("Side line top", 600.0, 30, 0.1, 17.0), MarkingInView("Middle line", 300.0, 25, 1.0, 0.0)]
    beside.append(MarkingInView("Side line left", 900.0, 200, 1.0, 0.0))  # most of the paint is where it should be
    seen = found.seen_in_image(beside)
    shown, plain = (draw_calibration(image, seen, soccer(), show_paint=one) for one in (True, False))
    np.testing.assert_array_equal(draw_calibration(image, replace(seen, field=soccer())), plain)
    changed = np.any(shown != plain, axis=2)
    assert farthest(changed, true_pixels(BROADCAST, FIELD["Side line top"].sample(0.05))) < 2.0
    blue, _, red = np.moveaxis(shown[changed].astype(int), -1, 0)
    assert np.count_nonzero(changed) > 500
    assert np.mean(red - blue) > 100  # magenta has as much of both


@pytest.mark.parametrize("size", [(300, 600), (960, 540), (240, 180)])
def test_the_reason_is_written_within_the_picture(size):
    width, height = size
    nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no marking was found in the image: " + 12 * "more ")
    drawn = draw_calibration(np.zeros((height, width, 3), np.uint8), nothing, soccer())
    rows, columns = (np.flatnonzero(np.any(drawn, axis=(axis, 2))) for axis in (1, 0))
    assert columns.max() < width - 3
    assert 0.7 * width < columns.max() - columns.min()
    assert rows.max() < height - 1
    _, above, below = text_size("no marking", min(height, 1.5 * width) / 900.0)
    assert np.ptp(rows) > 1.5 * (above + below)  # several lines


def test_a_field_of_points_is_drawn_as_points_and_the_map_with_its_border():
    corners = {f"corner {x} {y}": Point((x, y, 0.0)) for x in (-14.0, 14.0) for y in (-7.5, 7.5)}
    seen = Camera.from_angles(0.0, 1.2, 0.0, 700.0, (0.0, 28.0, -11.0), SIZE)
    picture = draw_field(black(), seen, Field(28.0, 15.0, corners), colour=(0, 255, 255))
    for corner in corners.values():
        x, y = seen.project(corner.X).round().astype(int)
        assert picture[y, x].tolist() == [0, 255, 255]
    board = draw_minimap(None, Field(28.0, 15.0, {"middle": Point((0.0, 0.0, 0.0))}), size=(340, 220))
    white = board[..., 0] > 130
    assert white[108:112, 168:172].any()
    assert white.any(axis=0).sum() > 200
    assert white.any(axis=1).sum() > 100
