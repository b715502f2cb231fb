"""Ellipses in pictures, and the cameras that see circles of a field in them."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_court_search import SIZE, nearest, seen_lines, turned

from data_tools.score_courts import Truth
from fieldcalib import Arc, Camera, Field, Line
from fieldcalib.draw.scene import render_field
from fieldcalib.fields import ice_hockey, soccer, tennis
from fieldcalib.images.search.cameras_from_curves import circle_hypotheses, circles_of, focal_lengths
from fieldcalib.images.search.court_search import find_courts
from fieldcalib.images.search.ellipses import Ellipse, find_ellipses
from fieldcalib.images.search.long_lines import long_lines
from fieldcalib.images.search.stripes import find_stripes

RINK = ice_hockey("nhl")
END = Camera.from_angles(np.radians(32), np.radians(74), 0.0, 1700.0, (2.0, 36.0, -13.0), SIZE)  # of the rink


def shown(*ellipses, width=3):
    """Ellipses (centre, axes, degrees, start, stop) drawn on grey."""
    image = np.full((*SIZE[::-1], 3), 90, np.uint8)
    for centre, axes, degrees, start, stop in ellipses:
        cv2.ellipse(image, centre, axes, degrees, start, stop, (200,) * 3, width, cv2.LINE_AA)
    return image


def seen_circle(camera, centre, radius):
    """The ellipse in which a camera without a lens sees a circle on the ground."""
    H = camera.K @ np.column_stack([camera.R[:, :2], -camera.R @ camera.C])
    x, y = centre
    circle = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [-x, -y, x * x + y * y - radius * radius]])
    inverse = np.linalg.inv(H)
    Q = inverse.T @ circle @ inverse
    middle = -np.linalg.solve(Q[:2, :2], Q[:2, 2])
    value, vector = np.linalg.eigh(Q[:2, :2] / -(Q[2, 2] + Q[2, :2] @ middle))
    return Ellipse(tuple(middle), tuple(1.0 / np.sqrt(value)), float(np.arctan2(*vector[::-1, 0])))


# Ellipses


@given(st.floats(-200, 200), st.floats(-200, 200), st.floats(20, 90), st.floats(20, 90), st.floats(0, np.pi))
def test_a_conic_is_zero_on_its_ellipse_alone(x, y, a, b, turn):
    ellipse = Ellipse((x, y), (a, b), turn)
    phi = np.linspace(0.0, 6.0, 7)
    local = np.column_stack([a * np.cos(phi), b * np.sin(phi)])
    xy = local @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]] + (x, y)
    origin, unit = np.array([30.0, -10.0]), 200.0
    for scale, sign in ((1.0, 0.0), (0.9, -1.0), (1.1, 1.0)):
        p = np.column_stack([((xy - (x, y)) * scale + (x, y) - origin) / unit, np.ones(7)])
        value = np.einsum("ni,ij,nj->n", p, ellipse.conic(origin, unit), p)
        np.testing.assert_allclose(value, scale**2 - 1.0, atol=1e-9)
        assert np.all(np.abs(np.sign(np.round(value, 9)) - sign) < 0.5)


@pytest.mark.parametrize(("start", "stop"), [(0, 360), (200, 420), (30, 160)], ids=["whole", "cut", "arc"])
def test_an_ellipse_is_found_where_it_is_drawn(start, stop):
    found = find_ellipses(find_stripes(shown(((600, 380), (260, 110), 12, start, stop))), 3)
    assert len(found) == 1
    np.testing.assert_allclose(found[0].centre, (600, 380), atol=4)
    np.testing.assert_allclose(np.sort(found[0].axes), (110, 260), atol=4)
    phi = np.radians(np.linspace(start, stop, 400))
    drawn = np.sum(np.hypot(*np.diff([260 * np.cos(phi), 110 * np.sin(phi)])))
    assert 0.8 * drawn < found[0].length < 1.4 * drawn  # squares are more than pixels, where it is aslant


def test_two_pieces_of_an_ellipse_are_joined_and_a_larger_one_comes_first():
    image = shown(
        ((900, 200), (120, 60), 0, 0, 360), ((500, 450), (380, 150), 0, 190, 240), ((500, 450), (380, 150), 0, 300, 420)
    )
    larger, smaller = find_ellipses(find_stripes(image), 5)
    np.testing.assert_allclose(np.sort(larger.axes), (150, 380), atol=8)
    np.testing.assert_allclose(np.sort(smaller.axes), (60, 120), atol=4)
    assert len(find_ellipses(find_stripes(image), 1)) == 1


def test_straight_lines_are_no_ellipses():
    image = shown()
    for start, end in (((100, 100), (1100, 300)), ((200, 650), (900, 120)), ((100, 400), (1200, 400))):
        cv2.line(image, start, end, (200,) * 3, 4, cv2.LINE_AA)
    assert find_ellipses(find_stripes(image), 5) == ()
    assert find_ellipses(find_stripes(np.full((200, 300, 3), 90, np.uint8)), 5) == ()


# Cameras


def test_the_circles_of_fields():
    assert len(circles_of(tennis())) == 0
    assert sorted(circles_of(soccer())[:, 0].tolist()) == [-41.5, 0.0, 41.5]
    assert np.sum(np.abs(circles_of(RINK)[:, :2]).sum(axis=1) == 0.0) == 1  # the centre circle
    upright = Field(20.0, 10.0, {"hoop": Arc((8.0, 0.0, -3.0), 2.0, u=(0.0, 1.0, 0.0), v=(0.0, 0.0, 1.0))})
    assert len(circles_of(upright)) == 0


@given(
    st.floats(-4.0, 4.0),
    st.floats(30.0, 45.0),
    st.floats(10.0, 16.0),
    st.floats(-0.4, 0.4),
    st.integers(6, 14),
    st.integers(0, 3),
    st.booleans(),
)
def test_a_circle_and_a_line_give_the_camera(x, y, height, pan, index, number, is_across):
    circle = circles_of(RINK)[number]
    f = float(focal_lengths(RINK)[index]) * SIZE[0]
    towards = np.arctan2(circle[0] - x, y - circle[1]) + 0.1 * pan
    camera = Camera.from_angles(towards, np.arctan2(y, height) + 0.02, 0.01, f, (x, y, -height), SIZE)
    line = seen_lines(camera, (7.62,), ()) if is_across else seen_lines(camera, (), (12.95,))
    found = circle_hypotheses([seen_circle(camera, circle[:2], circle[2])], line, RINK, SIZE)
    assert nearest(found, camera) < 1e-6


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["near side", "far side"])
def test_a_field_that_tells_its_ends_apart_is_seen_from_both_sides(side):
    markings = {"circle": Arc((5.0, 2.0, 0.0), 4.0), "line": Line((-10.0, -6.0, 0.0), (10.0, -6.0, 0.0))}
    field = Field(20.0, 12.0, markings, stands=tennis().stands, farthest_camera=80.0)
    f = float(focal_lengths(field)[4]) * SIZE[0]
    camera = Camera.from_angles(0.2, 1.2, 0.0, f, (-3.0, 25.0, -8.0), SIZE)
    camera = camera if side > 0.0 else turned(camera)
    found = circle_hypotheses([seen_circle(camera, (5.0, 2.0), 4.0)], seen_lines(camera, (), (-6.0,)), field, SIZE)
    assert np.min(np.linalg.norm(found.C - camera.C, axis=1)) < 1e-6


def test_without_ellipses_circles_or_lines_there_are_no_cameras():
    ellipse, lines = Ellipse((600.0, 400.0), (200.0, 90.0), 0.0), seen_lines(END, (7.62,), ())
    assert len(circle_hypotheses([ellipse], lines, tennis(), SIZE)) == 0
    assert len(circle_hypotheses([], lines, RINK, SIZE)) == 0
    assert len(circle_hypotheses([ellipse], long_lines(find_stripes(shown()), 1), RINK, SIZE)) == 0


@pytest.mark.slow
def test_a_rink_is_found_of_which_no_two_lines_across_show():
    """One end: the goal line and two face-off circles."""
    found = find_courts(render_field(END, RINK), RINK)
    assert found
    assert Truth(END, RINK).distance(found[0].calibration.required_camera) < 1.0
