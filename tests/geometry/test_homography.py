"""A camera from the homography of its ground plane, and the homographies of others."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from objects import points_in_view, without_focal_length
from strategies import angle, bounded, cameras, moved, numbers, vectors
from synthetic import visible_field_points

from fieldcalib.fields.segments import Line, Point
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import (
    ALIGNMENTS,
    decompose_homography,
    dehomogenize,
    homogenize,
    pose_from_homography,
)
from fieldcalib.io.soccernet import parse_annotation
from fieldcalib.solve.from_homography import GROUND_POINTS, camera_from_homography, closed_form

signed_scales = st.builds(
    lambda exponent, sign: sign * 10.0**exponent, st.floats(-6.0, 6.0), st.sampled_from([-1.0, 1.0])
)


def a_point_in_view(camera):
    return visible_field_points(camera, count=1)[0, :2]


@st.composite
def decentred(draw):
    """Cameras without lens whose principal point lies anywhere in the middle of the image."""
    camera = draw(cameras(lens=False))
    K = camera.K.copy()
    K[:2, 2] += draw(vectors((-0.1, -0.1), (0.1, 0.1))) * camera.image_size
    return Camera(K, camera.R, camera.C, camera.image_size)


def assert_same_camera(f, R, C, camera):
    assert f == pytest.approx(camera.focal_length, rel=1e-7)
    np.testing.assert_allclose(R, camera.R, atol=1e-8)
    np.testing.assert_allclose(C, camera.C, rtol=1e-7, atol=1e-6)


@given(camera=decentred(), scale=signed_scales)
def test_a_camera_comes_back_from_its_homography(camera, scale):
    reference = a_point_in_view(camera)
    f, R, C = decompose_homography(scale * camera.homography, camera.principal_point, reference)
    assert_same_camera(f, R, C, camera)


@given(drawn=st.lists(st.tuples(cameras(lens=False), signed_scales), min_size=6, max_size=6))
def test_a_batch_is_every_homography_on_its_own(drawn):
    principal_point = np.array([500.0, 300.0])
    H = np.array([scale * camera.homography for camera, scale in drawn]).reshape(2, 3, 3, 3)
    reference = np.array([a_point_in_view(camera) for camera, _ in drawn]).reshape(2, 3, 2)
    f, R, C = decompose_homography(H, principal_point, reference)
    assert f.shape == (2, 3)
    assert R.shape == (2, 3, 3, 3)
    assert C.shape == (2, 3, 3)
    for index in np.ndindex(2, 3):
        alone = decompose_homography(H[index], principal_point, reference[index])
        for together, single in zip((f, R, C), alone, strict=True):
            np.testing.assert_allclose(together[index], single, rtol=1e-9, atol=1e-9)


@given(camera=cameras(lens=False))
def test_the_reference_point_is_in_front(camera):
    """A point behind the camera turns the scene around: the homography is the same up to its sign."""
    reference = a_point_in_view(camera)
    behind = 2.0 * camera.C[:2] - reference
    assume(camera.depth([*behind, 0.0]) < -1.0)
    for point in (reference, behind):
        _, R, C = decompose_homography(camera.homography, camera.principal_point, point)
        assert R[2] @ (np.array([*point, 0.0]) - C) > 0.0


@given(camera=cameras(lens=False), noise=bounded((3, 3), -0.6, 0.6))
def test_with_noise_the_rotation_is_one_still(camera, noise):
    reference = a_point_in_view(camera)
    H = camera.homography * (1.0 + noise)
    _, R, _ = decompose_homography(H, camera.principal_point, reference)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def straight_down():
    """From straight above every focal length fits, each at its height."""
    return Camera.from_angles(0.3, 0.0, 0.0, 900.0, (0.0, 0.0, -60.0), (960, 540), (0.0, 0.0)).homography


@pytest.mark.parametrize(
    "H", [without_focal_length(), -3.0 * without_focal_length(), straight_down(), np.zeros((3, 3))]
)
def test_no_real_focal_length(H):
    f, _, _ = decompose_homography(H, np.zeros(2), np.zeros(2))
    assert np.isnan(f)


def test_homographies_without_focal_length_do_not_spoil_the_others():
    camera = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540), (0.0, 0.0))
    H = np.array([without_focal_length(), camera.homography, np.full((3, 3), np.nan), np.zeros((3, 3))])
    f, R, C = decompose_homography(H, np.zeros(2), np.zeros((4, 2)))
    np.testing.assert_array_equal(np.isnan(f), [True, False, True, True])
    assert_same_camera(f[1], R[1], C[1], camera)


def test_the_homography_is_not_changed():
    H = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540)).homography
    H.flags.writeable = False
    before = H.copy()
    decompose_homography(H, np.array([480.0, 270.0]), np.zeros(2))
    np.testing.assert_array_equal(H, before)


@given(camera=cameras(lens=False), scale=signed_scales)
def test_known_intrinsics_need_no_square_pixels(camera, scale):
    K = camera.K * [[1.3], [1.0], [1.0]]
    camera = Camera(K, camera.R, camera.C, camera.image_size)
    reference = a_point_in_view(camera)
    R, C = pose_from_homography(scale * np.linalg.inv(K) @ camera.homography, reference)
    np.testing.assert_allclose(R, camera.R, atol=1e-8)
    np.testing.assert_allclose(C, camera.C, rtol=1e-7, atol=1e-6)


@given(camera=cameras(lens=False), noise=bounded((3, 3), -0.6, 0.6))
def test_the_scale_is_that_of_both_axes(camera, noise):
    """The written formula, where the columns are not equally long: ``C = -R^T m3 / sqrt(|m1| |m2|)``."""
    M = np.linalg.inv(camera.K) @ camera.homography * (1.0 + noise)
    m1, m2, m3 = M.T
    reference = a_point_in_view(camera)
    front = np.sign(M[2] @ (*reference, 1.0))
    R, C = pose_from_homography(M, reference)
    lengths = np.linalg.norm(m1) * np.linalg.norm(m2)
    np.testing.assert_allclose(C, -R.T @ (front * m3) / np.sqrt(lengths), rtol=1e-9, atol=1e-9)


# the paper's five steps

SIZE = (960, 540)
BROADCAST = Camera.from_angles(-0.35, 1.36, 0.01, 1700.0, (1.5, 68.0, -17.0), SIZE)


@given(camera=decentred(), scale=signed_scales)
def test_the_five_steps_give_a_camera_back(camera, scale):
    assume(len(points_in_view(camera, 0.1)) >= 3)
    found = camera_from_homography(scale * camera.homography, camera.image_size, principal_point=camera.principal_point)
    assert set(found.points) == points_in_view(camera, 0.1)
    for decomposed in (found.initial, found.camera):
        assert decomposed.image_size == camera.image_size
        np.testing.assert_array_equal(decomposed.principal_point, camera.principal_point)
        assert decomposed.focal_length == pytest.approx(camera.focal_length, rel=1e-6)
        np.testing.assert_allclose(decomposed.R, camera.R, atol=1e-6)
        np.testing.assert_allclose(decomposed.C, camera.C, rtol=1e-5, atol=1e-4)


@given(
    pan=angle(3.1),
    tilt=numbers(0.15, 1.4),  # from straight above or along the ground the focal length cannot be told
    roll=angle(0.5),
    f=numbers(300.0, 2000.0),
    C=vectors((-52.5, -34.0, -60.0), (52.5, 34.0, -5.0)),
    scale=signed_scales,
)
def test_cameras_anywhere_above_the_field_come_back(pan, tilt, roll, f, C, scale):
    """A point of the field near the image's centre, as H maps it, may lie behind such a camera."""
    camera = Camera.from_angles(pan, tilt, roll, f, C, SIZE)
    found = closed_form(scale * camera.homography, SIZE)
    assert_same_camera(found.focal_length, found.R, found.C, camera)
    initial = camera_from_homography(scale * camera.homography, SIZE).initial
    np.testing.assert_array_equal(initial.C, found.C)


def test_the_centre_mark_may_lie_in_the_focal_plane():
    camera = Camera.from_angles(np.pi, np.radians(45.0), 0.0, 900.0, (0.0, 10.0, -10.0), SIZE)
    H = camera.homography
    assert H[2, 2] == pytest.approx(0.0, abs=1e-12)
    H = np.array([*H[:2], [*H[2, :2], 0.0]])
    found = closed_form(H, SIZE)
    assert_same_camera(found.focal_length, found.R, found.C, camera)


@pytest.mark.parametrize("scale", [1e-200, -1e-150, 1e150, -1e200])
def test_the_scale_does_not_matter_however_far_from_one(scale):
    found = camera_from_homography(scale * BROADCAST.homography, SIZE)
    assert_same_camera(found.initial.focal_length, found.initial.R, found.initial.C, BROADCAST)
    assert set(found.points) == points_in_view(BROADCAST, 0.1)


@given(noise=bounded((3, 3), -0.02, 0.02))
def test_refinement_brings_the_camera_nearer_to_the_homography(noise):
    H = BROADCAST.homography * (1.0 + noise)
    found = camera_from_homography(H, SIZE)
    assume(found.camera is not None)
    X = np.array([point.X for point in found.points.values()])
    xy = np.concatenate(list(found.pixels.values()))
    np.testing.assert_allclose(xy, dehomogenize(homogenize(X[:, :2]) @ H.T))
    before, after = (np.sqrt(np.mean((c.project(X) - xy) ** 2)) for c in (found.initial, found.camera))
    assert after <= before + 1e-9  # px
    np.testing.assert_array_equal(found.camera.K, found.initial.K)


def test_refinement_is_worth_it():
    """With a homography that is no camera's, the closed form is pixels off, and the pose alone makes good for some."""
    H = BROADCAST.homography * (1.0 + 0.003 * np.random.default_rng(5).normal(size=(3, 3)))
    found = camera_from_homography(H, SIZE)
    X, xy = np.array([p.X for p in found.points.values()]), np.concatenate(list(found.pixels.values()))
    before, after = (np.sqrt(np.mean((c.project(X) - xy) ** 2)) for c in (found.initial, found.camera))
    assert after < 0.5 * before


@pytest.mark.parametrize("tolerance", [0.0, 0.1, 0.5])
def test_tolerance_enlarges_the_image_on_each_side(tolerance):
    found = camera_from_homography(BROADCAST.homography, SIZE, tolerance=tolerance)
    assert set(found.points) == points_in_view(BROADCAST, tolerance)
    assert (
        len(points_in_view(BROADCAST, 0.0)) < len(points_in_view(BROADCAST, 0.1)) < len(points_in_view(BROADCAST, 0.5))
    )


def test_zeta_leaves_out_what_the_camera_misses():
    H = BROADCAST.homography * (1.0 + 0.01 * np.random.default_rng(3).normal(size=(3, 3)))
    wide = camera_from_homography(H, SIZE, zeta=1e6)
    X, xy = np.array([p.X for p in wide.points.values()]), np.concatenate(list(wide.pixels.values()))
    distance = np.linalg.norm(wide.initial.project(X) - xy, axis=1)
    zeta = float(np.median(distance)) + 1e-6
    narrow = camera_from_homography(H, SIZE, zeta=zeta)
    assert list(narrow.points) == [name for name, d in zip(wide.points, distance, strict=True) if d < zeta]
    assert 3 <= len(narrow.points) < len(wide.points)


def test_points_behind_the_camera_are_no_correspondences():
    """From low above the centre mark half of the field is behind, and H maps some of it into the image."""
    camera = Camera.from_angles(0.0, np.radians(80.0), 0.0, 300.0, (0.0, 5.0, -8.0), SIZE)
    behind = [name for name, point in GROUND_POINTS.items() if camera.depth(point.X) < 0.0]
    assert behind
    found = camera_from_homography(camera.homography, SIZE, tolerance=2.0, zeta=1e6)
    assert not set(behind) & set(found.points)
    np.testing.assert_allclose(found.camera.C, camera.C, atol=1e-4)


def test_fewer_than_three_points_are_rejected():
    """A long lens on the middle of the right half: the homography is perfect, but no point is in view."""
    camera = Camera.from_angles(0.2, 1.36, 0.0, 12000.0, (1.5, 68.0, -17.0), SIZE)
    assert len(points_in_view(camera, 0.1)) < 3
    found = camera_from_homography(camera.homography, SIZE)
    assert found.camera is None
    assert found.initial.focal_length == pytest.approx(12000.0)
    assert "3 are needed" in found.message


def test_without_a_real_focal_length_there_is_no_camera():
    found = camera_from_homography(without_focal_length(), SIZE, principal_point=(0.0, 0.0))
    assert found.camera is None
    assert found.initial is None
    assert "no real focal length" in found.message


@pytest.mark.parametrize("H", [np.eye(4), np.full((3, 3), np.nan), np.ones(9), np.ones((2, 3, 3))])
def test_what_is_no_homography(H):
    for decompose in (camera_from_homography, closed_form):
        with pytest.raises(ValueError, match=r"expected a homography, three rows|not finite"):
            decompose(H, SIZE)


def test_no_homography_of_zeros_is_a_cameras():
    assert camera_from_homography(np.zeros((3, 3)), SIZE).initial is None


@pytest.mark.parametrize("principal_point", [480.0, (480.0,), (480.0, 270.0, 1.0), (np.nan, 270.0), (480.0, np.inf)])
def test_principal_points_that_cannot_be(principal_point):
    with pytest.raises(ValueError, match="principal_point must be two finite numbers"):
        camera_from_homography(BROADCAST.homography, SIZE, principal_point=principal_point)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ({}, "points on the ground, got none"),
        ({**GROUND_POINTS, "top": Point((1.0, 2.0, -2.44))}, r"got 'top' at \(1.0, 2.0, -2.44\): leave it out"),
    ],
)
def test_points_that_cannot_be(points, message):
    with pytest.raises(ValueError, match=message):
        camera_from_homography(BROADCAST.homography, SIZE, points=points)


@pytest.mark.parametrize("options", [{"zeta": 0.0}, {"zeta": -1.0}, {"tolerance": -0.1}])
def test_options_that_cannot_be(options):
    with pytest.raises(ValueError, match="zeta must be positive and tolerance at least 0"):
        camera_from_homography(BROADCAST.homography, SIZE, **options)


# the homographies of others

YARD = 0.9144
# where they put the corners, the centre mark and the penalty spots, far left corner first, then clockwise as the main
# camera sees the field; and the length and width of their field in metres
LANDMARKS = {
    "wc14": (
        [(0, 0), (115, 0), (115, 74), (0, 74), (57.5, 37), (11 / YARD, 37), (115 - 11 / YARD, 37)],
        (115 * YARD, 74 * YARD),
    ),
    "chen": ([(0, 68), (105, 68), (105, 0), (0, 0), (52.5, 34), (11, 34), (94, 34)], (105.0, 68.0)),
    "jiang": (
        [
            (-0.5, -0.5),
            (0.5, -0.5),
            (0.5, 0.5),
            (-0.5, 0.5),
            (0, 0),
            (11 / 115 / YARD - 0.5, 0),
            (0.5 - 11 / 115 / YARD, 0),
        ],
        (115 * YARD, 74 * YARD),
    ),
}
NAMES = (
    "TL_PITCH_CORNER",
    "TR_PITCH_CORNER",
    "BR_PITCH_CORNER",
    "BL_PITCH_CORNER",
    "CENTER_MARK",
    "L_PENALTY_MARK",
    "R_PENALTY_MARK",
)
any_alignment = pytest.mark.parametrize("name", ALIGNMENTS)


@any_alignment
@given(camera=cameras(lens=False))
def test_landmarks(name, camera):
    """Their homography of a camera takes its pixels to where they have the landmarks, and ours takes them from ours."""
    alignment, (theirs, template) = ALIGNMENTS[name], LANDMARKS[name]
    assert alignment.template == pytest.approx(template)
    assert alignment.image_size == (1280, 720)
    camera = camera.scaled((1280, 720))
    ours = np.array([soccer(*template)[landmark].X[:2] for landmark in NAMES])
    pixels = homogenize(ours) @ camera.homography.T
    image = pixels if name != "jiang" else pixels @ np.array([[1 / 1280, 0, 0], [0, 1 / 720, 0], [-0.5, -0.5, 1.0]])
    found = image @ alignment.from_fieldcalib(camera.homography).T
    np.testing.assert_allclose(dehomogenize(found), theirs, atol=1e-6)
    back = alignment.to_fieldcalib(alignment.from_fieldcalib(camera.homography))
    np.testing.assert_allclose(dehomogenize(homogenize(ours) @ back.T), dehomogenize(pixels), rtol=1e-6, atol=1e-5)


@any_alignment
@given(H=moved(np.tile(np.eye(3), (2, 4, 1, 1)), 0.25))
def test_alignments_come_back_in_batches(name, H):
    alignment = ALIGNMENTS[name]
    there = alignment.from_fieldcalib(H)
    assert there.shape == H.shape
    np.testing.assert_allclose(there[1, 2], alignment.from_fieldcalib(H[1, 2]), rtol=1e-9)
    back = alignment.to_fieldcalib(there)
    np.testing.assert_allclose(back, H, rtol=1e-7, atol=1e-8)


def test_jiang_is_wc14_in_other_units():
    """The paper's way: the template in yards on the left, the inverse of the image's normalisation on the right."""
    H = np.eye(3) + np.random.default_rng(0).uniform(-0.3, 0.3, size=(3, 3))
    template = np.array([[115.0, 0, 57.5], [0, 74.0, 37.0], [0, 0, 1]])
    image = np.array([[1280.0, 0, 640.0], [0, 720.0, 360.0], [0, 0, 1]])
    as_wc14 = ALIGNMENTS["wc14"].to_fieldcalib(template @ H @ np.linalg.inv(image))
    np.testing.assert_allclose(ALIGNMENTS["jiang"].to_fieldcalib(H), as_wc14, rtol=1e-9)


def test_alignments_want_matrices():
    with pytest.raises(ValueError, match=r"expected a homography, .* shape \(..., 3, 3\), got \(3,\)"):
        ALIGNMENTS["wc14"].to_fieldcalib(np.ones(3))
    with pytest.raises(ValueError, match="not finite"):
        ALIGNMENTS["wc14"].from_fieldcalib(np.full((2, 3, 3), np.nan))


def test_annotated_lines_of_wc14_lie_where_the_homographies_put_them(shared_data):
    """A wrong direction, unit or origin would be metres off."""
    field, size, distances = soccer(), (1280, 720), []
    for path in sorted((shared_data / "wc14-test").glob("*.homographyMatrix"))[:30]:
        H = ALIGNMENTS["wc14"].to_fieldcalib(np.loadtxt(path))
        for label, xy in parse_annotation(path.with_suffix(".json").read_bytes(), size).items():
            segment = field[label]
            if isinstance(segment, Line) and segment.start[2] == segment.end[2] == 0.0:
                on_field = dehomogenize(homogenize(xy) @ np.linalg.inv(H).T)
                start, end = np.array(segment.start[:2]), np.array(segment.end[:2])
                normal = np.array([-(end - start)[1], (end - start)[0]]) / np.linalg.norm(end - start)
                distances.extend(np.abs((on_field - start) @ normal))
    assert len(distances) > 300
    assert np.median(distances) < 0.3  # metres
