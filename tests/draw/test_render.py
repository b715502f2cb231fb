"""The rendered field: lines, goals and grass lie where the camera sees them, as wide as they are."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from views import CAMERAS, SIZE, any_camera, camera, inside

from fieldcalib.draw.scene import render_field
from fieldcalib.draw.topview import overhead_camera
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, Point, PointCloud
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera

FIELD = soccer()


def whiteness(camera, **options):
    """How far each pixel is from grass (0) to paint (1), in red, where they differ most, without the vignette."""
    width, height = camera.image_size
    v, u = np.mgrid[-1.0 : 1.0 : height * 1j, -1.0 : 1.0 : width * 1j]
    red = render_field(camera, FIELD, **options)[..., 2] / (1.0 - 0.13 * (u**2 + v**2))
    return (red - 73.0) / (244.0 - 73.0)  # grass is 66 or 80


@pytest.mark.parametrize("name", ["broadcast", "wide, rolled", "barrel lens", "cushion lens"])
def test_rendered_lines_lie_where_the_camera_sees_them(name):
    white = whiteness(CAMERAS[name], line_width=1.0)  # wide enough to be white in the distance too
    painted = [s for s in FIELD.markings.values() if not np.any(s.sample()[:, 2])]
    X = np.concatenate([s.sample(0.5) for s in painted])
    xy = CAMERAS[name].project(X)
    xy = np.rint(xy[inside(np.nan_to_num(xy, nan=-1.0))]).astype(int)
    assert len(xy) > 100
    assert np.mean(white[xy[:, 1], xy[:, 0]] > 0.5) > 0.99

    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform((-52, -33), (52, 33), (3000, 2)), np.zeros(3000)])
    samples = np.concatenate([s.sample(0.3) for s in FIELD.markings.values()])
    spots = np.array([point.X for point in FIELD.points.values()])
    distance, _ = cKDTree(np.concatenate([samples, spots])[:, :2]).query(X[:, :2])
    beside = X[(distance > 3.0) & (np.abs(X[:, 0]) < 40.0)]  # the goals stand in front of what is behind them
    xy = CAMERAS[name].project(beside)
    xy = np.rint(xy[inside(np.nan_to_num(xy, nan=-1.0))]).astype(int)
    assert len(xy) > 100
    assert np.mean(white[xy[:, 1], xy[:, 0]] < 0.1) > 0.99


@pytest.mark.parametrize("line_width", [0.05, 0.12, 0.3])
def test_rendered_lines_have_their_width(line_width):
    """Across a line, each pixel is as white as the share of it that is painted, be the line wider than it or not."""
    principal_point = (160.3, 120.0)  # the middle line is not in the middle of a pixel
    overhead = Camera.from_angles(
        0.0, 0.0, 0.0, 800.0, (0.0, 22.0, -80.0), (320, 240), principal_point
    )  # 10 px a metre
    columns = np.arange(140, 182)
    profile = whiteness(overhead, line_width=line_width)[60:180, columns].mean(axis=0)
    grass = np.median(profile)
    edges = 160.3 + np.array([-5.0, 5.0]) * line_width
    covered = np.clip(edges[1], columns - 0.5, columns + 0.5) - np.clip(edges[0], columns - 0.5, columns + 0.5)
    np.testing.assert_allclose((profile - grass) / (0.92 * (1.0 - grass)), covered, atol=0.03)


def test_ground_straight_below_a_row_of_pixels_is_no_stand():
    """Their rays run along the boards behind the goals and never meet those behind the touchlines."""
    court = Field(30.0, 17.5, {"side": Line((-15.0, -8.75, 0.0), (15.0, -8.75, 0.0))})
    drawn = render_field(overhead_camera(court, margin=3.0), court)
    height, width = drawn.shape[:2]
    assert height % 2 == 1
    middle = drawn[height // 2 - 2 : height // 2 + 3, width // 3].astype(int)
    assert np.max(np.abs(middle - drawn[height // 3, width // 3])) < 15


def test_rendered_posts_have_their_width():
    in_front = camera(90, 88, 1000, (30, 0, -1.5))  # 22.5 m from the goal: 44 px a metre
    red = render_field(in_front, FIELD)[..., 2].astype(float)
    for y in (-3.66, 3.66):
        x, row = in_front.project([52.5, y, -1.2])
        profile = red[round(row), round(x) - 20 : round(x) + 21]
        above = profile > 200
        assert above.sum() == pytest.approx(0.12 * 1000 / 22.5, abs=1.5)
        assert np.mean(np.flatnonzero(above)) + round(x) - 20 == pytest.approx(x, abs=0.7)


def test_the_sky_is_no_field():
    up = camera(0, 120, 800, (0, 60, -15))
    picture = render_field(up, FIELD)
    assert picture.max() < 100


@any_camera
def test_rendering_leaves_no_pixel_out(camera):
    plain = render_field(camera, FIELD)
    assert plain.shape == (SIZE[1], SIZE[0], 3)
    assert plain.dtype == np.uint8
    assert np.all(plain.any(axis=-1))


def test_rendering_is_reproducible():
    truth = camera(10, 78, 1100, (0, 62, -17))
    assert np.array_equal(render_field(truth, FIELD), render_field(truth, FIELD))
    grain = [render_field(truth, FIELD, rng=np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert np.array_equal(grain[0], grain[1])
    assert np.any(grain[0] != grain[2])


def test_other_objects_can_be_rendered():
    """A field with a raised bar above the middle, a curve and a backward arc has all that a soccer field has not."""
    curve = PointCloud([(-20, 10, 0), (-10, 12, 0), (0, 10, 0)], ordered=True)
    segments = {
        "bar": Line((-2, 0, -3), (2, 0, -3)),
        "curve": curve,
        "arc": Arc((10, 5, 0), 5.0, np.pi, 0.0),
        "dots": PointCloud([(5, 5, 0)]),
        "spot": Point((0, 0, 0)),
    }
    field = Field(60.0, 40.0, segments)
    view = camera(0, 70, 700, (0, 45, -18))
    red = render_field(view, field, line_width=0.5)[..., 2]
    for X in ((-10, 12, 0), (10, 10, 0), (0, 0, -3)):
        x, y = np.rint(view.project(X)).astype(int)
        assert red[y, x] > 200
    x, y = np.rint(view.project((10, 0, 0))).astype(int)  # the other half of the circle
    assert red[y, x] < 100
