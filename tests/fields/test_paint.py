"""What is painted on fields: lines, dashes, rows of marks and borders, in their colours, from above and on maps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic import observe

from fieldcalib import Camera, calibrate_from_segments
from fieldcalib.draw import draw_field, draw_minimap, overhead_camera, render_field
from fieldcalib.draw.ground import Ground, bgr, painted, rays
from fieldcalib.fields import FIELDS, american_football, field_named, ice_hockey, rugby_union
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, Point
from fieldcalib.fields.traits import WHITE, Paint
from fieldcalib.images import refine_on_image
from fieldcalib.images.paint.line_profiles import Markings, find_lines, pixels_of_lines, profiles_along

PIXEL = 0.02  # m


def from_above(field, middle=(0.0, 0.0), size=(201, 201), pixel=PIXEL, **options):
    """Shares of the pixels that paint covers, by colour, of the ground around a place."""
    C = (*middle, -100.0)
    camera = Camera.from_angles(0.0, 0.0, 0.0, 100.0 / pixel, C, size, (np.array(size) - 1.0) / 2.0)
    return painted(Ground.of_rays(camera, rays(camera)), field, **options)


def stripe(field, y, x=0.0, **options):
    """The share along a row of pixels at y, whose middle is at x."""
    (share,) = from_above(field, (x, y), (401, 3), **options).values()
    return share[1]


@given(st.floats(0.05, 0.5), st.floats(0.05, 0.5), st.floats(0.02, 0.3))
def test_dashes_cover_their_share_however_large_pixels_are(dash, gap, pixel):
    line = Line((-300.0, 0.0, 0.0), (300.0, 0.0, 0.0))
    field = Field(600.0, 40.0, {"line": line}, paint={"line": Paint(2.0, dashes=(dash, gap))})
    share = stripe(field, 0.0, pixel=pixel)
    whole = int((dash + gap) / pixel * int(400 * pixel / (dash + gap)))  # pixels of whole periods
    assert np.mean(share[:whole]) == pytest.approx(dash / (dash + gap), abs=0.03 + 0.5 / 400)
    middle = share[200]  # a dash has its middle there
    assert middle == pytest.approx(min(dash / pixel, 1.0), abs=0.02) or pixel > dash + gap


def test_dashes_of_an_arc_are_as_long_as_those_of_a_line():
    arc = Arc((0.0, 0.0, 0.0), 2.0, 0.0, np.pi)
    field = Field(10.0, 10.0, {"arc": arc}, paint={"arc": Paint(0.1, dashes=(0.3, 0.2))})
    (share,) = from_above(field, size=(301, 301)).values()
    phi = np.linspace(0.0, np.pi, 2000)[1:-1]
    x, y = 150 + np.rint(2.0 * np.array([np.cos(phi), np.sin(phi)]) / PIXEL).astype(int)
    distance = np.abs(2.0 * (phi - 0.5 * np.pi)) % 0.5  # from the middle of a dash
    is_paint = np.minimum(distance, 0.5 - distance) < 0.15
    assert np.mean((share[y, x] > 0.5) == is_paint) > 0.95
    assert share[:140].max() == 0.0  # the other half of the circle


def test_marks_of_american_football_are_painted_and_their_rows_are_not():
    field = american_football("nfl")
    y = field["Hash row bottom inner"].start[1]
    marks = stripe(field, y + 0.3, x=2.3)  # between two yard lines
    x = 2.3 + PIXEL * (np.arange(401) - 200)
    on_mark = np.abs(x / 0.9144 - np.rint(x / 0.9144)) * 0.9144 < 0.04
    between = np.abs(x / 0.9144 - np.rint(x / 0.9144)) * 0.9144 > 0.07
    assert marks[on_mark].min() > 0.99
    assert marks[between].max() < 0.01
    for inside in (y - 0.1, y + 0.7, field["Number row bottom inner"].start[1], -y + 0.1):
        assert stripe(field, inside, x=2.3, pixel=0.005).max() < 0.01  # 1.3 to 3.3 m: no yard line


def test_borders_lie_outside_and_close_their_corners():
    field = american_football("nfl")
    (share,) = from_above(field, (0.5 * field.length, -0.5 * field.width), (301, 301)).values()
    outside_x, outside_y = (PIXEL * (np.arange(301) - 150) for _ in range(2))
    border = np.maximum(outside_x[None], -outside_y[:, None])
    assert share[(border > 0.02) & (border < 1.8)].min() > 0.99
    assert share[(border < -0.02) | (border > 1.85)].max() < 0.01


def test_lines_of_a_rink_have_their_colours_and_widths():
    field = ice_hockey("nhl")
    red, blue = (field.paint[label].colour for label in ("Goal line left", "Blue line left"))
    for label, colour, width in (("Blue line left", blue, 0.3048), ("Goal line right", red, 0.0508)):
        shares = from_above(field, (field[label].start[0], 9.0), (101, 3))
        assert shares[colour][1].sum() * PIXEL == pytest.approx(width, abs=1e-3)
        assert sum(share[1].sum() for name, share in shares.items() if name != colour) == 0.0
    picture = render_field(overhead_camera(field, 0.1), field)
    x, y = np.rint(overhead_camera(field, 0.1).project([[7.7724, 9.0, 0.0], [3.0, 9.0, 0.0]])).astype(int).T
    line, ice = picture[y, x].astype(int)
    assert line[0] > line[2] + 60
    assert ice.min() > 180


def test_spots_are_points_with_paint_and_other_points_are_none():
    field = Field(4.0, 4.0, {"spot": Point((0.5, 0, 0)), "corner": Point((0, 0, 0))}, paint={"spot": Paint(0.4)})
    (share,) = from_above(field).values()
    assert share.sum() * PIXEL**2 == pytest.approx(np.pi * 0.04, rel=0.02)
    assert share[:, :100].max() == 0.0


def test_nothing_is_painted_of_what_stands_and_of_width_0():
    segments = {"post": Line((0, 0, 0), (0, 0, -2)), "row": Line((-1, 0, 0), (1, 0, 0))}
    assert from_above(Field(4.0, 4.0, segments, paint={"row": Paint(0.0)})) == {}


def test_what_is_thin_is_drawn_wide_enough_to_be_seen():
    field = Field(40.0, 40.0, {"line": Line((0, -9, 0), (0, 9, 0))}, paint={"line": Paint(0.05)})
    assert stripe(field, 0.0).sum() * PIXEL == pytest.approx(0.05, abs=1e-4)
    assert stripe(field, 0.0, least=0.4).sum() * PIXEL == pytest.approx(0.4, abs=1e-4)
    assert stripe(field, 0.0, line_width=0.3).sum() * PIXEL == pytest.approx(0.05, abs=1e-4)  # it has its own width


@pytest.mark.parametrize("name", FIELDS)
def test_maps_of_every_field_show_all_of_it_and_its_players(name):
    field = field_named(name)
    size = (336, 228)
    empty = draw_minimap(None, field, size=size)
    camera = Camera.from_angles(0.1, 1.0, 0.0, 500.0, (0.0, field.width, -0.5 * field.width), (640, 360))
    assert not np.array_equal(draw_minimap(camera, field, size=size), empty)

    off = np.array([[np.nan, np.nan, 0.0], [0.0, np.nan, 0.0], [40.0 * field.length, 0.0, 0.0], [1e30, 0.0, 0.0]])
    trail = np.array([[np.nan, np.nan], [0.0, 0.0], [np.nan, 0.0]])
    for nothing in (np.empty((0, 2)), np.empty((0, 3)), off):
        same = draw_minimap(None, field, size=size, points=nothing, trails=[trail, np.empty((0, 2)), off[:, :2]])
        np.testing.assert_array_equal(same, empty)

    x, y = 0.5 * field.length, 0.5 * field.width
    corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    drawn = draw_minimap(None, field, size=size, points=corners, colours=[(0, 0, 255), (255, 0, 0)] * 2)
    rows, columns = np.nonzero(np.any(drawn != empty, axis=-1))
    assert rows.min() > 2
    assert rows.max() < size[1] - 3
    assert columns.min() > 2
    assert columns.max() < size[0] - 3
    with_trail = draw_minimap(None, field, size=size, trails=[corners[[0, 2]]], colours=(0, 0, 255))
    assert np.any(with_trail[113:116, 167:170] != empty[113:116, 167:170])  # it goes through the middle


def test_fields_reach_as_far_as_their_markings():
    assert rugby_union(in_goal=22.0).half_extent[0] > 72.0
    assert Field(20.0, 10.0, {}).half_extent.tolist() == [10.0, 5.0]


def test_overlays_draw_rows_of_marks_darker_than_lines():
    field = american_football("nfl")
    overhead = overhead_camera(field, 0.1)
    black = np.zeros((*overhead.image_size[::-1], 3), np.uint8)
    picture = draw_field(black, overhead, field, colour=(0, 200, 0))
    row, line = (field[label].sample(50.0) for label in ("Number row bottom inner", "Side line bottom"))
    for X, brightness in ((row + (1.0, 0.0, 0.0), 100), (line, 200)):
        x, y = np.rint(overhead.project(X[len(X) // 2])).astype(int)
        assert picture[y, x, 1] == pytest.approx(brightness, abs=5)
    plain = draw_field(black, overhead, dict(field), colour=(0, 200, 0))
    x, y = np.rint(overhead.project(row[len(row) // 2] + (1.0, 0.0, 0.0))).astype(int)
    assert plain[y, x, 1] == pytest.approx(200, abs=5)


def test_colours_are_those_of_html():
    assert bgr(WHITE) == (242, 248, 244)


# In images


SIZE = (960, 540)


def seen(name):
    """A camera at the side of a field, and its picture."""
    field = field_named(name)
    f = 900.0 * (0.5 * field.width + 20.0) / field.scale / 1.5
    camera = Camera.from_angles(0.3, 1.25, 0.0, f, (2.0, 0.5 * field.width + 20.0, -12.0), SIZE)
    return field, camera, render_field(camera, field)


@pytest.mark.parametrize("name", ["american-football-nfl", "basketball-nba", "ice-hockey-nhl", "rugby-union"])
def test_a_camera_is_refined_on_the_paint(name):
    field, camera, picture = seen(name)
    shifted = {label: xy + (3.0, 2.0) for label, xy in observe(field.markings, camera).items()}
    start = calibrate_from_segments(field, shifted, SIZE)
    X = np.concatenate([one.sample(1.0) for one in field.markings.values()])
    xy = camera.project(X)
    inside = np.all((xy >= 0.0) & (xy < SIZE), axis=1)
    before, after = (
        np.median(np.linalg.norm(one.camera.project(X) - xy, axis=1)[inside])
        for one in (start, refine_on_image(field, picture, start))
    )
    assert before > 2.0
    assert after < 0.5


def test_a_border_is_found_at_its_inner_edge_and_what_is_not_painted_nowhere():
    field, camera, picture = seen("american-football-nfl")
    markings = Markings.of(field)
    assert not {"Hash row bottom inner", "Number row top outer"} & set(markings.labels)
    profiles = profiles_along(camera, markings)
    found = pixels_of_lines(markings, profiles, find_lines(picture, profiles, 8.0))
    X = camera.image_to_field(found.by_label(0)["Side line top"])
    np.testing.assert_allclose(X[:, 1], -0.5 * field.width, atol=0.15)
    assert not any("edge" in label for label in Markings.of(ice_hockey("nhl")).labels)
