"""Flags, criteria, priors and what they do not allow."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from fieldcalib.fields import american_football
from fieldcalib.fields.catalogue import tennis
from fieldcalib.fields.ground import Ground
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import ALL_STANDS, MAIN_LEFT, CameraDistribution
from fieldcalib.problem.layout import LOG_ASPECT, LOG_F, PRINCIPAL_POINT
from fieldcalib.solve.request import GivenCamera, Task
from fieldcalib.solve.solver_options import (
    DEFAULT_FLAGS,
    PINHOLE_FLAGS,
    CalibrationFlags,
    checked_prior,
    pixel_unit,
)

F = CalibrationFlags
K = np.array([[1500.0, 0.0, 470.0], [0.0, 1530.0, 280.0], [0.0, 0.0, 1.0]])
RVEC, TVEC = np.array([1.3, 0.1, 0.0]), np.array([1.0, -2.0, 60.0])


def options(**changes):
    size = changes.pop("image_size", (960, 540))
    given = GivenCamera(*(changes.pop(name, None) for name in GivenCamera._fields))
    field = changes.pop("field", soccer())
    return Task({} if field is None else field, given, **({"flags": DEFAULT_FLAGS} | changes)).options(size)


def test_flags_have_the_values_of_opencv_where_opencv_has_them():
    shared = [flag for flag in F if hasattr(cv2, flag.name)]
    assert {flag.name: flag.value for flag in shared} == {flag.name: getattr(cv2, flag.name) for flag in shared}
    assert len(shared) == len(F) - 5


def test_our_own_flags_use_bits_that_opencv_does_not():
    taken = [value for name, value in vars(cv2).items() if name.startswith("CALIB_") and isinstance(value, int)]
    for flag in (F.CALIB_FIX_POSITION, F.CALIB_FIX_ROTATION, F.CALIB_FIX_ROLL, F.CALIB_AUTO_LENS):
        assert not any(flag & value for value in taken)
        assert flag < 2**31


def test_by_default_square_pixels_and_one_lens_coefficient_are_free():
    def free(**changes):
        layout = options(**changes).layout
        return tuple(name for name, is_free in zip(layout.names, layout.free, strict=True) if is_free)

    pose_and_zoom = ("pan", "tilt", "roll", "log f", "x", "y", "z")
    assert free(flags=PINHOLE_FLAGS) == pose_and_zoom
    assert free(flags=None) == free() == (*pose_and_zoom, "cx", "cy", "a1")
    # without a prior the principal point is not free by default, as nothing would hold it; with flags it is
    assert free(flags=None, prior=None) == (*pose_and_zoom, "a1")
    more = DEFAULT_FLAGS | F.CALIB_FIX_ROLL
    assert free(prior=None, flags=more) == ("pan", "tilt", "log f", "x", "y", "z", "cx", "cy", "a1")


@pytest.mark.parametrize(
    ("dist_coeffs", "flags", "lens"),
    [
        (None, DEFAULT_FLAGS, "RadialLens"),
        ([0.1, 0.0, 0.0, 0.0, 0.0], DEFAULT_FLAGS, "RadialLens"),
        ([0.1, 0.0, 0.001, 0.0, 0.0], DEFAULT_FLAGS, "BrownConradyLens"),
        (None, DEFAULT_FLAGS & ~F.CALIB_FIX_K3, "BrownConradyLens"),
        (None, DEFAULT_FLAGS & ~F.CALIB_FIX_TANGENT_DIST, "BrownConradyLens"),
    ],
)
def test_the_lens_is_the_smallest_that_will_do(dist_coeffs, flags, lens):
    known = {} if dist_coeffs is None else {"camera_matrix": K, "dist_coeffs": dist_coeffs}
    flags |= F.CALIB_USE_INTRINSIC_GUESS if known else 0
    assert type(options(flags=flags, **known).layout.lens).__name__ == lens


def test_the_size_of_a_field_is_considered_unless_it_is_known():
    known = soccer(size_known=True)
    assert not np.any(options(field=known.with_ground(Ground())).layout.considered)
    for field in (known, american_football(), replace(american_football(), size_known=False)):
        layout = options(field=field).layout
        assert np.array(layout.names)[layout.considered].tolist() == ["crown"]
        assert layout.field_size.is_known
        assert not layout.is_sized
    assert not np.any(options(prior=None).layout.considered)
    assert options(field=known.with_ground(Ground())).layout.field_size is None
    assert options(field=tennis()).layout.field_size is None
    layout = options(field=soccer(100.0, 66.0)).layout
    assert np.array(layout.names)[layout.considered].tolist() == ["length", "width", "crown"]
    np.testing.assert_array_equal(layout.field_size.given, (100.0, 66.0))
    np.testing.assert_array_equal(layout.field_size.sigma, soccer().size_model.sigma)
    np.testing.assert_array_equal(options(field=soccer(100.0, 66.0)).known[-3:], (100.0, 66.0, 0.0))


@pytest.mark.parametrize(
    ("left_out", "freed"),
    [
        (F.CALIB_FIX_ASPECT_RATIO, ["log aspect"]),
        (F.CALIB_FIX_PRINCIPAL_POINT, ["cx", "cy"]),
        (F.CALIB_FIX_K1, ["a1"]),
        (F.CALIB_FIX_K2, ["b2"]),
        (F.CALIB_FIX_K3, ["a3"]),
        (F.CALIB_FIX_TANGENT_DIST, ["p1", "p2"]),
        (F.CALIB_FIX_K3 | F.CALIB_FIX_TANGENT_DIST, ["p1", "p2", "a3"]),
    ],
)
def test_a_flag_left_out_frees_its_parameter(left_out, freed):
    layout = options(flags=PINHOLE_FLAGS & ~left_out).layout
    free = [name for name, is_free in zip(layout.names, layout.free, strict=True) if is_free]
    assert free == [name for name in layout.names if name in freed or name in layout.names[:7]]


def test_a_camera_matrix_gives_what_it_knows():
    found = options(
        camera_matrix=K, dist_coeffs=[0.1, 0.0, 0.0, 0.0], flags=DEFAULT_FLAGS | F.CALIB_USE_INTRINSIC_GUESS
    )
    assert found.known[LOG_F] == pytest.approx(np.log(1500.0))
    np.testing.assert_allclose(found.known[PRINCIPAL_POINT], (470.0, 280.0))
    assert found.known[LOG_ASPECT] == pytest.approx(np.log(1.02))
    corner = np.hypot(960, 540) / 2.0 / 1500.0
    np.testing.assert_allclose(found.known[found.layout.lens_block], (0.1 * corner**2, 0.0))
    assert found.layout.free[LOG_F]
    assert not options(camera_matrix=K, flags=DEFAULT_FLAGS | F.CALIB_FIX_FOCAL_LENGTH).layout.free[LOG_F]


def test_a_pose_gives_angles_and_centre():
    import fieldcalib

    found = options(rvec=RVEC, tvec=TVEC, flags=DEFAULT_FLAGS | F.CALIB_USE_EXTRINSIC_GUESS)
    camera = fieldcalib.Camera.from_opencv(RVEC, TVEC, K, None, (960, 540))
    np.testing.assert_allclose(found.known[[0, 1, 2, 4, 5, 6]], [*camera.angles, *camera.C])
    assert np.isnan(found.known[LOG_F])


def test_without_a_guess_only_what_has_a_default_is_known():
    known = options().known
    assert np.isnan(known[:7]).all()
    np.testing.assert_allclose(known[7:12], (480.0, 270.0, 0.0, 0.0, 0.0))
    assert options(flags=DEFAULT_FLAGS | F.CALIB_FIX_ROLL).known[2] == 0.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"camera_matrix": K}, "camera_matrix would be ignored"),
        ({"flags": F.CALIB_FIX_FOCAL_LENGTH}, "camera_matrix is missing"),
        ({"dist_coeffs": [0.1, 0.0]}, "give camera_matrix with them"),
        ({"rvec": RVEC, "tvec": TVEC}, "without a flag they would be ignored"),
        ({"rvec": RVEC, "flags": F.CALIB_USE_EXTRINSIC_GUESS}, "give both rvec and tvec"),
        ({"flags": F.CALIB_FIX_POSITION}, "rvec and tvec are missing"),
        ({"flags": cv2.CALIB_RATIONAL_MODEL}, "not supported: expected a combination of CALIB_USE_INTRINSIC_GUESS"),
        (
            {"camera_matrix": K, "dist_coeffs": [0.0] * 12 + [0.1, 0.0], "flags": F.CALIB_USE_INTRINSIC_GUESS},
            "a tilted sensor",
        ),
        ({"camera_matrix": np.eye(2), "flags": F.CALIB_USE_INTRINSIC_GUESS}, "K must be a finite array"),
        ({"criteria": (3, 0, 1e-9)}, "max_count >= 1"),
        ({"criteria": (0, 10, 1e-9)}, "criteria must be"),
        ({"criteria": 30}, "criteria must be cv2's"),
        ({"prior": "main centre"}, "unknown camera distribution 'main centre': expected 'all', 'main center'"),
        ({"prior": []}, "names no camera distribution"),
        ({"loss": "tukey"}, "loss must be one of linear, soft_l1, huber, cauchy"),
        ({"tau": 0.0}, "tau must be a positive loss"),
        ({"tau": "0.019"}, "tau must be a positive loss"),
        ({"image_size": (960,)}, "image_size must be"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        options(**changes)


def test_criteria_as_in_opencv():
    assert (options(criteria=(1, 7, 0.0)).max_iterations, options(criteria=(2, 0, 1e-4)).tolerance) == (7, 1e-4)
    both = cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS
    assert options(criteria=(both, 30, 1e-6)).max_iterations == 30


def test_priors_by_name_by_themselves_and_several():
    mine = CameraDistribution("mine", (0, 1), (80, 85), (-1, 1), (10, 20), (0, 1), (60, 61), (-12, -11))
    assert checked_prior("main left") == (MAIN_LEFT,)
    assert checked_prior(mine) == (mine,)
    assert checked_prior(["main left", mine]) == (MAIN_LEFT, mine)
    assert checked_prior("all", soccer()) == ALL_STANDS
    assert options(prior=None).distributions == ALL_STANDS
    assert not options(prior=None).use_prior


def test_scales_in_pixels_grow_with_the_image():
    assert pixel_unit((960, 540)) == 1.0
    assert pixel_unit((1920, 1080)) == 2.0
    assert options(image_size=(1920, 1080)).loss.scale == 2.0 * options().loss.scale
    assert options(image_size=(1920, 1080)).wide_loss.scale == 2.0 * options().wide_loss.scale
    assert options(image_size=(1920, 1080)).noise == 2.0 * options().noise


def test_a_camera_matrix_is_scaled_to_images_of_another_size():
    given = GivenCamera(K, (-0.1, 0.0, 0.0, 0.0, 0.0), image_size=(1920, 1080))
    half = given.of_size((960, 540))
    np.testing.assert_allclose(np.diagonal(half.camera_matrix)[:2], np.diagonal(K)[:2] / 2.0)
    assert given.of_size((1920, 1080)) is given
    task = Task(soccer(), given, F.CALIB_FIX_FOCAL_LENGTH | F.CALIB_FIX_K1)
    assert np.exp(task.options((960, 540)).known[LOG_F]) == pytest.approx(K[0, 0] / 2.0)
    assert np.exp(task.options((1920, 1080)).known[LOG_F]) == pytest.approx(K[0, 0])
