"""The layout of theta: blocks, roles, and cameras there and back for every lens."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import anywhere, cameras, numbers, thetas, vectors
from synthetic import visible_field_points

from fieldcalib.fields.traits import Crown
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import BrownConradyLens, Pinhole, RadialLens
from fieldcalib.problem.layout import (
    ANGLES,
    CENTER,
    LOG_ASPECT,
    LOG_F,
    POSE_AND_ZOOM,
    PRINCIPAL_POINT,
    Layout,
    Role,
    SizeBlock,
    camera_from_theta,
    exp_of,
    theta_from_camera,
    turned_around,
)

SIZE = (1280, 720)
RHO = float(np.hypot(*SIZE) / 2.0)
LENSES = (Pinhole(RHO), RadialLens(RHO), BrownConradyLens(RHO))
FIELD_SIZE = SizeBlock(np.array([100.0, 66.0]), np.array([2.0, 3.0]), np.array([[90.0, 45.0], [120.0, 90.0]]))
every_lens = pytest.mark.parametrize("lens", LENSES, ids=lambda lens: type(lens).__name__)
CROWNED = FIELD_SIZE._replace(crown=Crown(0.5, 0.2))
every_size = pytest.mark.parametrize("field_size", [None, FIELD_SIZE, CROWNED], ids=["known size", "size", "crown"])


def assert_same_camera(theta, expected):
    """Equal parameters; pan may differ by full turns."""
    difference = theta - expected
    difference[0] = np.remainder(difference[0] + np.pi, 2.0 * np.pi) - np.pi
    np.testing.assert_allclose(difference / np.maximum(1.0, np.abs(expected)), 0.0, atol=1e-11)


# --- theta and Camera ---


@given(thetas(lens=True))
def test_theta_to_camera_to_theta(drawn):
    theta, image_size = drawn
    assert_same_camera(theta_from_camera(camera_from_theta(theta, image_size)), theta)


@given(anywhere(), numbers(0.9, 1.1), vectors((-50.0, -50.0), (50.0, 50.0)))
def test_camera_to_theta_to_camera(camera, aspect, offset):
    K = camera.K * [[1.0], [aspect], [1.0]] + [[0, 0, offset[0]], [0, 0, offset[1]], [0, 0, 0]]
    camera = Camera(K, camera.R, camera.C, camera.image_size, camera.k)
    back = camera_from_theta(theta_from_camera(camera), camera.image_size)
    for name in ("K", "R", "C", "k"):
        np.testing.assert_allclose(getattr(back, name), getattr(camera, name), rtol=1e-11, atol=1e-11, err_msg=name)


@given(thetas(lens=True))
def test_theta_and_camera_project_alike(drawn):
    theta, image_size = drawn
    camera = camera_from_theta(theta, image_size)
    X = visible_field_points(camera)
    x, y, z = ((X - theta[CENTER]) @ camera.R.T).T
    f, rho = np.exp(theta[LOG_F]), np.hypot(*image_size) / 2.0
    q = f**2 * (x**2 + y**2) / z**2 / rho**2  # 1 at the corner
    a1, b2 = theta[Layout.of(image_size).lens_block]
    a2 = b2 + 0.46 * min(a1, 0.0) ** 2
    gain = 1.0 + a1 * q + a2 * q**2
    ideal = f * np.column_stack([x / z, np.exp(theta[LOG_ASPECT]) * y / z])
    np.testing.assert_allclose(camera.project(X), gain[:, None] * ideal + theta[PRINCIPAL_POINT], atol=1e-8)


def test_every_entry_of_theta_is_where_its_name_says():
    camera = Camera(
        [[1500.0, 0, 950], [0, 1530, 530], [0, 0, 1]],
        Camera.from_angles(0.3, 1.4, 0.02, 1.0, (0, 0, 0), SIZE).R,
        (1.0, 56.0, -15.0),
        SIZE,
        (0.1, 0.02),
    )
    q = (SIZE[0] ** 2 + SIZE[1] ** 2) / 4.0 / 1500.0**2
    expected = {
        "pan": 0.3,
        "tilt": 1.4,
        "roll": 0.02,
        "log f": np.log(1500.0),
        "x": 1.0,
        "y": 56.0,
        "z": -15.0,
        "cx": 950.0,
        "cy": 530.0,
        "log aspect": np.log(1.02),
        "a1": 0.1 * q,
        "b2": 0.02 * q * q,
    }
    names = Layout.of(SIZE).names
    assert tuple(expected) == names
    np.testing.assert_allclose(theta_from_camera(camera), list(expected.values()), rtol=1e-12)
    where = {"ANGLES": ANGLES, "CENTER": CENTER, "PRINCIPAL_POINT": PRINCIPAL_POINT, "POSE_AND_ZOOM": POSE_AND_ZOOM}
    assert {name: names[index] for name, index in where.items()} == {
        "ANGLES": ("pan", "tilt", "roll"),
        "CENTER": ("x", "y", "z"),
        "PRINCIPAL_POINT": ("cx", "cy"),
        "POSE_AND_ZOOM": ("pan", "tilt", "roll", "log f", "x", "y", "z"),
    }
    assert (names[LOG_F], names[LOG_ASPECT]) == ("log f", "log aspect")


@given(
    camera=cameras(lens=True, image_sizes=(SIZE,)),
    lens=st.sampled_from(LENSES),
    share=vectors([-1.0] * 12, [1.0] * 12),
)
def test_theta_to_camera_to_theta_of_every_lens(camera, lens, share):
    layout = Layout.of(SIZE, lens, FIELD_SIZE)
    theta = np.concatenate([theta_from_camera(camera)[:10], 3.0 * lens.sigma * share[: len(lens.names)], [100.0, 66.0]])
    back = layout.camera(theta)
    assert back.image_size == SIZE
    np.testing.assert_allclose(back.K, camera.K, rtol=1e-12)
    np.testing.assert_allclose(back.C, camera.C, rtol=1e-12)
    assert_same_camera(layout.theta(back), theta)


@given(camera=anywhere(), offset=vectors((-50.0, -50.0), (50.0, 50.0)), dist=vectors([-0.1] * 12, [0.1] * 12))
def test_camera_to_theta_to_camera_of_every_coefficient(camera, offset, dist):
    K = camera.K + [[0, 0, offset[0]], [0, 0, offset[1]], [0, 0, 0]]
    camera = Camera(K, camera.R, camera.C, camera.image_size, dist)
    layout = Layout.of(camera.image_size, BrownConradyLens(camera.half_diagonal))
    back = layout.camera(layout.theta(camera))
    for name in ("K", "R", "C", "dist"):
        np.testing.assert_allclose(getattr(back, name), getattr(camera, name), rtol=1e-10, atol=1e-11, err_msg=name)


def test_a_lens_that_the_layout_does_not_have_is_refused():
    camera = Camera.from_angles(0.3, 1.4, 0.02, 1500.0, (1.0, 56.0, -15.0), SIZE, k=(0.1, 0.02))
    with pytest.raises(ValueError, match="a pinhole lens has no coefficients"):
        Layout.of(SIZE, Pinhole(RHO)).theta(camera)
    tangential = Camera(camera.K, camera.R, camera.C, SIZE, (0.1, 0.02, 0.001, 0.0, 0.0))
    with pytest.raises(ValueError, match="no coefficients but k1, k2"):
        theta_from_camera(tangential)


# --- blocks and roles ---


@every_size
@every_lens
def test_blocks_cover_theta_once(lens, field_size):
    layout = Layout.of(SIZE, lens, field_size)
    sizes = () if field_size is None else ("length", "width")
    crown = ("crown",) if field_size is CROWNED else ()
    assert layout.size == len(layout.names) == 10 + len(lens.names) + len(sizes) + len(crown)
    assert layout.names[layout.lens_block] == lens.names
    assert layout.names[layout.field_size_block] == sizes
    assert layout.names[layout.crown_block] == crown
    parts = ("angles", "focal length", "centre", "principal point", "aspect", "lens", "field size", "crown")
    covered = np.concatenate([np.arange(layout.size)[layout.blocks[name]] for name in parts])
    np.testing.assert_array_equal(covered, np.arange(layout.size))  # in this order, each once
    np.testing.assert_array_equal(np.flatnonzero(layout.is_lens), np.arange(layout.size)[layout.lens_block])


def test_coefficients_are_blocks_by_opencvs_names():
    blocks = Layout.of(SIZE, BrownConradyLens(RHO)).blocks
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")
    assert [blocks[name] for name in names] == [slice(10 + i, 11 + i) for i in range(12)]
    assert blocks["roll"] == slice(2, 3)
    assert "k1" not in Layout.of(SIZE, Pinhole(RHO)).blocks


@every_size
@every_lens
def test_what_can_be_estimated_is_free_at_first(lens, field_size):
    layout = Layout.of(SIZE, lens, field_size)
    fixed = [name for name, free in zip(layout.names, layout.free, strict=True) if not free]
    assert fixed == [*lens.names[lens.estimable :], *(["crown"] if field_size is CROWNED else [])]
    assert not np.any(layout.shared)
    np.testing.assert_array_equal(layout.considered, layout.is_crown)  # that is never estimated


def test_roles():
    layout = Layout.of(SIZE, RadialLens(RHO), FIELD_SIZE)
    moved = layout.with_roles(Role.SHARED, "centre", "k1").with_roles(Role.CONSIDERED, "field size")
    moved = moved.fixed("aspect", "k2")
    assert [name for name, free in zip(moved.names, moved.free, strict=True) if not free] == [
        "log aspect",
        "b2",
        "length",
        "width",
    ]
    free_names = np.array(moved.names)[moved.free]
    assert free_names[moved.shared].tolist() == ["x", "y", "z", "a1"]
    assert np.array(moved.names)[moved.considered].tolist() == ["length", "width"]
    assert np.all(layout.roles == Role.FRAME)  # as it was
    with pytest.raises(KeyError):
        layout.fixed("zoom")


@every_size
@every_lens
def test_bounds_are_those_of_the_lens_and_of_the_legal_sizes(lens, field_size):
    layout = Layout.of(SIZE, lens, field_size)
    bounds = layout.with_roles_of(np.ones(layout.size, dtype=bool), Role.FRAME).bounds(1.0)
    assert np.all(np.isneginf(bounds.least[:10]))
    assert np.all(np.isposinf(bounds.largest[: layout.lens_block.stop]))
    np.testing.assert_array_equal(bounds.least[layout.lens_block], lens.least)
    if field_size is not None:
        np.testing.assert_array_equal(bounds.least[layout.field_size_block], [90.0, 45.0])
        np.testing.assert_array_equal(bounds.largest[layout.field_size_block], [120.0, 90.0])


def test_longest_steps():
    layout = Layout.of(SIZE, BrownConradyLens(RHO), FIELD_SIZE)
    small, large = layout.bounds(1.0).longest, layout.bounds(50.0).longest
    assert np.all(small[POSE_AND_ZOOM] > 0.0)
    assert np.all(np.isfinite(small[POSE_AND_ZOOM]))
    np.testing.assert_array_equal(large[CENTER], 50.0 * small[CENTER])
    np.testing.assert_array_equal(np.delete(large, [4, 5, 6]), np.delete(small, [4, 5, 6]))


# --- the other side ---


@given(thetas(lens=True), vectors((-60.0, -40.0, -3.0), (60.0, 40.0, 0.0), count=5))
def test_turned_around_sees_the_turned_field_alike(drawn, X):
    theta, image_size = drawn
    turned = turned_around(theta)
    here, there = (camera_from_theta(t, image_size) for t in (theta, turned))
    np.testing.assert_allclose(there.project(X * (-1.0, -1.0, 1.0)), here.project(X), rtol=1e-6, atol=1e-6)
    back = camera_from_theta(turned_around(turned), image_size)
    np.testing.assert_allclose(back.project(X), here.project(X), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("count", [1, 2])
def test_exponentials_do_not_depend_on_where_a_result_lies(monkeypatch, count):
    """NumPy 1.26 rounds otherwise for what has gaps in memory, and a single number counts as such by its stride."""
    strides, exp = [], np.exp
    monkeypatch.setattr(np, "exp", lambda x: strides.append(x.strides) or exp(x))
    theta = np.zeros((count, 14))
    exp_of(theta, LOG_F)
    assert strides == [(8,)]
