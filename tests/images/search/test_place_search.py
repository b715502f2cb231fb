"""Views from a known place that see lines or a circle of a field in those of a picture."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_cameras_from_ellipses import RINK, seen_circle
from test_court_search import SIZE, seen_lines

from data_tools.nonsense import nonsense
from fieldcalib import Camera
from fieldcalib.draw.scene import render_field
from fieldcalib.fields import tennis
from fieldcalib.geometry.rotation import angles_from_rotation
from fieldcalib.images.search.cameras_from_curves import LEVEL, circles_of
from fieldcalib.images.search.court_hypotheses import FieldLines
from fieldcalib.images.search.long_lines import Bend, LongLines
from fieldcalib.images.search.place_search import BEYOND, STEP, Place, apart, search_from, views_through
from fieldcalib.solve.request import Task

COURT = tennis()
STAND = np.array([-32.0, 1.0, -9.0])
PLACE = Place(STAND, np.full(3, 0.5), (0.8, 3.0))
SIDE = Place(np.array([2.0, 36.0, -13.0]), np.full(3, 0.5), (0.8, 3.0))
NO_LINES = LongLines(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2, 2)), np.zeros(0))
ACROSS, ALONG = FieldLines.of(COURT).across, FieldLines.of(COURT).along


def camera_at(place, pan, tilt, roll, f, k=(0.0, 0.0)):
    return Camera.from_angles(pan, tilt, roll, f, place.C, SIZE, k=k)


def off(views, truth):
    """How far the nearest of some views moves the picture of the true one, pixels."""
    return np.min(apart(views, truth), initial=np.inf)


@given(st.floats(1.5, 1.65), st.floats(1.2, 1.3), st.floats(-0.1, 0.1), st.floats(1200.0, 3000.0))
def test_two_lines_give_the_view(pan, tilt, roll, f):
    truth = camera_at(PLACE, pan, tilt, roll, f)
    for x, y in ((ACROSS[:2], ()), ((), ALONG[[0, -1]]), (ACROSS[:1], ALONG[:1])):
        assert off(views_through((seen_lines(truth, x, y), ()), PLACE, COURT, SIZE), truth) < 0.1, (x, y)


@given(st.floats(1.5, 1.65), st.floats(1.2, 1.3), st.sampled_from(PLACE.focal_lengths(SIZE[0], STEP)[10:].tolist()))
def test_one_line_gives_the_level_view_of_each_focal_length(pan, tilt, f):
    truth = camera_at(PLACE, pan, tilt, 0.0, f)
    for x, y in ((ACROSS[:1], ()), ((), ALONG[:1])):
        views = views_through((seen_lines(truth, x, y), ()), PLACE, COURT, SIZE)
        assert off(views, truth) < 0.1
        assert np.all(angles_from_rotation(views.R)[:, 2] == 0.0)


@given(st.floats(-0.15, 0.15), st.floats(1.15, 1.25), st.floats(1200.0, 3000.0), st.integers(0, 2))
def test_a_circle_gives_level_views(pan, tilt, f, some):
    truth = camera_at(SIDE, pan, tilt, 0.0, f)
    x, y, radius = circles_of(RINK)[-1 - some]
    views = views_through((NO_LINES, (seen_circle(truth, (x, y), radius),)), SIDE, RINK, SIZE)
    assert off(views, truth) < 2.0 * STEP


def test_there_are_no_views_without_lines():
    assert len(views_through((NO_LINES, ()), PLACE, COURT, SIZE)) == 0
    assert not search_from(Task(COURT), COURT, np.full((360, 640, 3), 90, np.uint8), PLACE).accepted
    assert not search_from(Task(COURT), COURT, nonsense(3), PLACE).accepted


@given(st.floats(1.5, 1.65), st.floats(1.2, 1.3), st.floats(1200.0, 3000.0), st.floats(-0.3, 0.3))
def test_every_view_is_level_and_looks_at_the_field(pan, tilt, f, roll):
    views = views_through((seen_lines(camera_at(PLACE, pan, tilt, roll, f), ACROSS[:2], ()), ()), PLACE, COURT, SIZE)
    cameras = [views.camera(k) for k in range(len(views))]
    assert all(abs(one.angles[2]) < LEVEL for one in cameras)
    assert all(np.all(np.abs(one.image_to_field((640.0, 360.0))[:2]) < BEYOND * COURT.half_extent) for one in cameras)


@given(st.floats(-0.06, 0.3), st.floats(900.0, 3000.0))
def test_the_bend_of_a_camera_is_that_of_its_lens(a, f):
    camera = Bend(a, SIZE).with_lens(camera_at(PLACE, 1.57, 1.3, 0.0, f))
    assert Bend.of(camera).a == pytest.approx(a, abs=0.015)


@pytest.mark.parametrize("k", [-0.25, pytest.param(0.5, marks=pytest.mark.slow)])
def test_a_view_through_a_known_lens_is_found(k):
    truth = Camera.from_angles(1.62, 1.33, 0.01, 1700.0, STAND + (0.2, -0.1, 0.1), SIZE, k=(k, 0.0))
    place = Place(STAND, np.full(3, 0.4), (0.8, 3.0), Bend.of(truth).a)
    found = search_from(Task(COURT), COURT, render_field(truth, COURT), place)
    assert found.accepted
    X = np.array([(x, y, 0.0) for x in ACROSS for y in ALONG])
    assert np.median(np.linalg.norm(found.camera.project(X) - truth.project(X), axis=1)) < 1.0
