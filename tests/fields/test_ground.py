"""The ground of a field: heights, slopes, rays, files."""

import json

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numdiff import central_differences
from strategies import numbers

from fieldcalib import field, soccer
from fieldcalib.fields import Ground
from fieldcalib.fields.ground import Terrain
from fieldcalib.fields.records import field_from_record, field_to_record, whole_record
from fieldcalib.io.field_files import read_field

terrains = st.builds(Terrain, numbers(0.0, 0.6), numbers(0.0, 0.6), numbers(90.0, 120.0), numbers(50.0, 90.0))
places = st.tuples(numbers(-70.0, 70.0), numbers(-50.0, 50.0))


def off_the_sides(terrain, x, y):
    """Whether a place is not at a side of the field, where the ground has an edge."""
    return min(abs(abs(x) - terrain.length / 2.0), abs(abs(y) - terrain.width / 2.0)) > 0.1


@given(terrains, places)
def test_slopes_and_derivatives_by_the_size_are_those_of_the_height(terrain, place):
    x, y = place
    assume(off_the_sides(terrain, x, y))

    def height(values):
        x, y, length, width = np.moveaxis(values, -1, 0)
        return terrain._replace(length=length, width=width).height(np.stack([x, y], axis=-1))[..., None]

    at = np.array([[x, y, terrain.length, terrain.width]])
    numeric = central_differences(height, at, np.full(4, 1e-3))[0, 0]
    np.testing.assert_allclose([*terrain.slopes(x, y), *terrain.by_size(x, y)], numeric, atol=1e-9)


@given(terrains, places, st.lists(numbers(-9.0, 9.0), min_size=4, max_size=4))
def test_the_lift_of_a_curve_and_its_derivatives(terrain, place, motion):
    (x, y), (dx, dy, ddx, ddy) = place, motion
    assume(off_the_sides(terrain, x, y))

    def lift(t):
        t = t[..., 0]
        X = np.stack([x + t * dx + t**2 / 2.0 * ddx, y + t * dy + t**2 / 2.0 * ddy], axis=-1)
        return -terrain.height(X)[..., None]

    found = terrain.lift((x, y), (dx, dy), (ddx, ddy))
    step = 1e-3
    before, at, after = (float(lift(np.array([[t]]))[0, 0]) for t in (-step, 0.0, step))
    assert found.z == pytest.approx(at, abs=1e-12)
    assert found.dz == pytest.approx((after - before) / (2.0 * step), abs=1e-6)
    assert found.ddz == pytest.approx((after - 2.0 * at + before) / step**2, abs=1e-6)


@given(terrains, places, numbers(-120.0, 120.0), numbers(50.0, 120.0), numbers(3.0, 40.0), numbers(0.0, 2.5))
def test_rays_meet_the_ground_where_it_is(terrain, place, x, y, up, above):
    C = np.array([x, y, -up - 1.2 - above])
    X = terrain.raised(np.array([*place, -above]))
    found = terrain.met_by_rays(C, X - C, above)
    assert found[2] + terrain.height(found) + above == pytest.approx(0.0, abs=1e-6)
    assert np.linalg.norm(found - C) <= np.linalg.norm(X - C) + 1e-4  # the first one: X may be behind the ridge
    if terrain.is_level or np.hypot(x - place[0], y - place[1]) < 20.0 * up:  # steeper than the ground
        np.testing.assert_allclose(found, X, atol=1e-4)
    assert np.isnan(terrain.met_by_rays(C, np.array([1.0, 0.0, -0.1]))).all()  # above the horizon


@given(terrains, places, numbers(-3.0, 3.0))
def test_lowered_undoes_raised(terrain, place, z):
    X = np.array([[*place, z]])
    np.testing.assert_allclose(terrain.lowered(terrain.raised(X)), X, atol=1e-12)


def test_level_ground_changes_nothing():
    X = np.array([[1.0, 2.0, -3.0]])
    assert soccer().terrain.is_level
    assert soccer().terrain.raised(X) is X
    np.testing.assert_array_equal(
        soccer().terrain.met_by_rays(np.array([0.0, 60.0, -15.0]), np.array([0.0, -4.0, 1.0])), [0.0, 0.0, 0.0]
    )


@pytest.mark.parametrize(("crown", "fall"), [(-0.1, 0.0), (np.nan, 0.0), (0.0, np.inf), ("0.3", 0.0), (30.0, 0.0)])
def test_ground_that_no_field_has_is_refused(crown, fall):
    with pytest.raises(ValueError, match=r"crown|fall"):
        soccer().with_ground(Ground(crown, fall))


def test_a_field_keeps_its_ground():
    raised = soccer(100.0, 64.0, size_known=True).with_ground(Ground(0.3, 0.1))
    assert raised.resized(101.0, 65.0).ground == Ground(0.3, 0.1)
    assert raised.resized(101.0, 65.0).terrain.length == 101.0
    assert raised.is_built
    assert raised.moves_with_size
    assert raised != soccer(100.0, 64.0, size_known=True)
    for record in (field_to_record(raised), whole_record(raised)):
        assert field_from_record(json.loads(json.dumps(record))).ground == Ground(0.3, 0.1)
    assert "ground" not in field_to_record(soccer())


def test_a_file_of_a_field_has_its_ground(tmp_path):
    file = tmp_path / "park.yaml"
    file.write_text("builder: soccer\nlength: 100\nwidth: 64\nground: {crown: 0.25}\n")
    assert read_field(file).ground == Ground(crown=0.25)
    file.write_text("builder: soccer\nlength: 100\nwidth: 64\nground: {crowm: 0.25}\n")
    with pytest.raises(ValueError, match="crowm"):
        read_field(file)


def test_courts_and_halls_are_level():
    assert field("basketball-fiba").terrain.is_level
