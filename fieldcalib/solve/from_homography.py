"""Calibration from the homography of the ground, and the verdict on a camera that was not solved here.

Decomposition of the homography of the ground into a camera, refined on field points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, expect, is_number, real_array
from fieldcalib.assess.findings import Finding, Status, What
from fieldcalib.assess.label_errors import rms_by_label, rms_of_labels
from fieldcalib.assess.ndc import ndc_losses
from fieldcalib.assess.result import Calibration, with_findings
from fieldcalib.assess.verdict import disagreement, implausibilities
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.fields.ground_homography import pixels_of_ground
from fieldcalib.fields.segments import Point
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.geometry.homography import decompose_homography, dehomogenize, finite_homography, homogenize
from fieldcalib.problem.evaluation import evaluate_camera
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.solve.misreadings import WIDTHS
from fieldcalib.solve.origin_and_unit import UNITS, may_be_from_a_corner, reading_of_camera
from fieldcalib.solve.solver_options import WIDE_SCALE, pixel_unit

GROUND_POINTS: Mapping[str, Point] = MappingProxyType(
    {name: point for name, point in soccer().points.items() if point.X[2] == 0.0}
)
LEAST_POINTS = 3  # smallest number for cv2.solvePnPRefineLM
NO_FOCAL_LENGTH = "no real focal length fits the homography: it is no camera's"
INVERSE = "its inverse is a camera's: H seems to map pixels to metres, give np.linalg.inv(H)"

RANK = Finding(What.RANK)
SINGULAR = 1e-9  # ratio of singular values, rows and columns having like lengths; that of cameras is above 1e-4
APART, EXACT = 0.02, 1e-4  # differences of the focal lengths of a homography: of other pictures, and of its own

NAN = float("nan")
TO_CORNER = "[[1, 0, length / 2], [0, 1, width / 2], [0, 0, 1]]"
FROM_A_CORNER = (
    f"it stands beside a corner and sees little of the field: if the origin of H is the far left corner, give "
    f"H @ {TO_CORNER}"
)


@dataclass(frozen=True)
class Decomposition:
    """The camera of a homography, or the reason why there is none."""

    camera: Camera | None
    """The refined camera; None if the paper's rule rejects the homography."""
    initial: Camera | None
    """The closed form, steps 1 to 3; None if the homography has no real focal length."""
    points: Mapping[str, Point]
    """Field points that the refinement uses."""
    pixels: dict[str, Array]
    """Images of these points under the homography, (1, 2) each."""
    message: str
    """Number of points of the refinement, or the reason why there is no camera."""


def camera_from_homography(
    H: ArrayLike,
    image_size: tuple[int, int],
    *,
    points: Mapping[str, Point] = GROUND_POINTS,
    zeta: float = 100.0,
    tolerance: float = 0.1,
    principal_point: ArrayLike | None = None,
) -> Decomposition:
    """Camera from a homography in the paper's five steps.

    Steps (1) to (3) are `closed_form`. (4) From correspondences ``X, H X`` `cv2.solvePnPRefineLM` refines R and t and
    keeps K. They are the field points for which H X lies in the image, enlarged on each side, and near to the
    projection by the camera of the closed form. With fewer than three of them the homography is rejected: no camera is
    near enough to it. (5) The angles, with the smaller roll, are `Camera.angles`.

    Parameters
    ----------
    H : (3, 3) array_like
        Maps field points (x, y, 1) in metres to pixels; scale and sign do not matter.
    image_size : (int, int)
        Width and height in pixels.
    points : mapping of str to Point
        Points on the ground; by default those of `soccer()`.
    zeta : float
        Distance in pixels between a point's image under H and its projection from which on it is not used.
    tolerance : float
        Largest distance of points outside the image, in widths and heights.
    principal_point : (2,) array_like, optional
        In pixels; by default the image's centre.

    Returns
    -------
    Decomposition
        If H has no camera but its inverse has one, the message says that H seems to map pixels to the field.

    Raises
    ------
    ValueError
        If H is not a finite 3 x 3 matrix, there are no points or one is off the ground, zeta is not positive, tolerance
        is negative, or the principal point is invalid.

    References
    ----------
    Theiner, Ewerth: TVCalib, WACV 2023, appendix "Homography Decomposition: From Homography to Camera Parameters".

    Examples
    --------
    >>> truth = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540))
    >>> camera_from_homography(truth.homography, (960, 540)).camera
    Camera(f=1800.0 px, pan=17.19°, tilt=74.48°, roll=0.57°, C=(2.00, 70.00, -18.00) m, k=(0, 0), image_size=960x540)
    """
    if not (is_number(zeta) and is_number(tolerance) and zeta > 0.0 and tolerance >= 0.0):
        raise ValueError(f"zeta must be positive and tolerance at least 0, got {zeta} and {tolerance}")
    H = finite_homography(H)
    found = _in_five_steps(H, image_size, points, zeta, tolerance, principal_point)
    if found.camera is not None:
        return found
    # not inverted silently: a video would change its convention with the frames that happen to fail
    adjugate = np.cross(H[:, [1, 2, 0]], H[:, [2, 0, 1]], axis=0).T  # the inverse up to scale, also of a singular H
    other = _in_five_steps(adjugate, image_size, points, zeta, tolerance, principal_point)
    return found if other.camera is None else replace(found, message=f"{found.message}; {INVERSE}")


def _in_five_steps(
    H: Array,
    image_size: tuple[int, int],
    points: Mapping[str, Point],
    zeta: float,
    tolerance: float,
    principal_point: ArrayLike | None,
) -> Decomposition:
    """`camera_from_homography` of H, without trying its inverse."""
    X = _ground_points(points)
    initial = closed_form(H, image_size, principal_point=principal_point)
    if initial is None:
        return Decomposition(None, None, {}, {}, NO_FOCAL_LENGTH)
    size = np.array(initial.image_size)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        xy = dehomogenize(homogenize(X[:, :2]) @ H.T)
        in_image = np.all(np.abs(xy / size - 0.5) <= 0.5 + tolerance, axis=1)
        near = np.linalg.norm(initial.project(X) - xy, axis=1) < zeta  # false behind the camera
    used = np.flatnonzero(in_image & near)
    names = [list(points)[index] for index in used]
    refined = _refined_pose(initial, X[used], xy[used]) if len(used) >= LEAST_POINTS else None
    if refined is not None:
        message = f"refined with {len(used)} points"
    elif len(used) >= LEAST_POINTS:
        message = "the refinement diverged"
    else:
        message = (
            f"of {in_image.sum()} field points in the image the camera of the homography has {len(used)} within "
            f"{zeta:g} px, {LEAST_POINTS} are needed; H must map metres on the field to pixels"
        )
    pixels = {name: xy[[index]] for name, index in zip(names, used, strict=True)}
    return Decomposition(refined, initial, {name: points[name] for name in names}, pixels, message)


def closed_form(
    H: ArrayLike, image_size: tuple[int, int], *, principal_point: ArrayLike | None = None
) -> Camera | None:
    """Steps (1) to (3) of `camera_from_homography`: the camera above the ground, or None.

    H and -H belong to two cameras mirrored at the ground. The one above the ground is right, which determines the sign,
    even if half of the field is behind the camera.

    Parameters
    ----------
    H, image_size, principal_point
        As in `camera_from_homography`.

    Returns
    -------
    Camera or None
        None if the homography has no real focal length.

    Examples
    --------
    >>> truth = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540))
    >>> closed_form(-truth.homography, (960, 540)).C.round(6)
    array([  2.,  70., -18.])
    """
    H = finite_homography(H)
    H = H / (np.abs(H).max() or 1.0)  # its entries are squared twice
    image_size = checked_image_size(image_size)
    centre = real_array(np.divide(image_size, 2.0) if principal_point is None else principal_point)
    if centre.shape != (2,) or not np.all(np.isfinite(centre)):
        raise ValueError(f"principal_point must be two finite numbers, x and y in pixels, got {principal_point!r}")
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    off_focal_plane = corners[np.argmax(np.abs(homogenize(corners) @ H[2]))]  # on either side
    f, R, C = decompose_homography(H, centre, off_focal_plane)
    if not np.isfinite(f):
        return None
    if C[2] > 0.0:
        R, C = R * (-1.0, -1.0, 1.0), C * (1.0, 1.0, -1.0)
    return Camera([[f, 0.0, centre[0]], [0.0, f, centre[1]], [0.0, 0.0, 1.0]], R, C, image_size)


def _ground_points(points: Mapping[str, Point]) -> Array:
    """World coordinates of points that must lie on the ground, (N, 3)."""
    if not expect(points, Mapping, "soccer().points"):
        raise ValueError("points must be a mapping of names to points on the ground, got none")
    for name, point in points.items():
        if expect(point, Point, "Point((0.0, 0.0, 0.0))").X[2] != 0.0:
            raise ValueError(f"points must lie on the ground, z = 0, got {name!r} at {point.X}: leave it out")
    return np.array([point.X for point in points.values()])


def on_level_ground(camera: Camera, field: Field | None) -> Camera:
    """The camera, with another pose, that sees a level field as nearly as possible as this one sees it on its ground.

    It is for programs that take every field to be level. The distances in pixels are least over the part of the field
    in view; focal length and lens are kept. A camera of level ground, or of an unknown field, is returned as it is, and
    so is one with a fisheye lens, which such programs cannot read.

    Examples
    --------
    >>> from fieldcalib.fields import Ground
    >>> camera = Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
    >>> raised = soccer().with_ground(Ground(crown=0.3))
    >>> X = raised["Circle right"].sample(2.0)
    >>> seen = camera.project(raised.terrain.raised(X))
    >>> level = on_level_ground(camera, raised)
    >>> [round(float(np.max(np.linalg.norm(one.project(X) - seen, axis=1))), 1) for one in (camera, level)]
    [5.2, 1.6]
    """
    if field is None or field.terrain.is_level or camera.fisheye:
        return camera
    xy, X = pixels_of_ground(camera, field)
    X = np.insert(X, 2, 0.0, axis=1)
    level = (_refined_pose(camera, X, xy) if len(X) > LEAST_POINTS else None) or camera
    now, before = (np.sum(np.square(one.project(X) - xy)) for one in (level, camera))
    return level if now < before else camera  # false for NaN: the refinement may diverge, as of very flat views


def _refined_pose(camera: Camera, X: Array, xy: Array) -> Camera | None:
    """The camera with R and t refined by OpenCV; None if that diverges."""
    import cv2  # a slow import

    rvec, tvec, K, dist = camera.to_opencv()  # OpenCV changes the pose in place: these are copies
    new_rvec, new_tvec = cv2.solvePnPRefineLM(X, xy, K, dist, rvec, tvec)
    if not (np.all(np.isfinite(new_rvec)) and np.all(np.isfinite(new_tvec))):
        return None
    return Camera.from_opencv(new_rvec, new_tvec, K, dist, camera.image_size)


def calibrate_from_homography(
    H: ArrayLike,
    image_size: tuple[int, int],
    *,
    zeta: float = 100.0,
    tolerance: float = 0.1,
    principal_point: ArrayLike | None = None,
) -> Calibration:
    """Calibrate a camera from the homography of the ground, by decomposition (`camera_from_homography`).

    Pixels are square, and there is no lens. The camera is the closed form with R and t refined on the field points that
    the homography maps into the image. A homography has eight degrees of freedom and such a camera seven: `rms` and
    `per_segment_errors` are the differences between the two, in pixels at these points.

    Parameters
    ----------
    H : (3, 3) array_like
        Maps field points (x, y, 1) in metres, origin at the centre mark, y towards the main camera, to pixels. Scale
        and sign do not matter. `ALIGNMENTS` converts the homographies of published data sets.
    image_size : (int, int)
        Width and height in pixels.
    zeta : float
        Distance in pixels between a point's image under H and its projection from which on it is not used.
    tolerance : float
        Largest distance of points outside the image, in widths and heights.
    principal_point : (2,) array_like, optional
        In pixels; by default the image's centre.

    Returns
    -------
    Calibration
        "implausible" without a camera if the homography has no real focal length, and with the unrefined one if fewer
        than three points are near enough: the paper rejects those. The message warns if H seems to map pixels to the
        field, its origin seems to be a corner of the field, or its unit feet, centimetres or millimetres. Yards are not
        recognised, as the cameras of yards and of metres are both plausible; `refine_homography_on_image` distinguishes
        them by the image.

    Raises
    ------
    ValueError
        If H is not a finite 3 x 3 matrix, zeta is not positive, tolerance is negative, or the principal point is
        invalid.

    References
    ----------
    Theiner, Ewerth: TVCalib, WACV 2023, appendix "Homography Decomposition: From Homography to Camera Parameters".

    Examples
    --------
    >>> truth = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540))
    >>> calibration = calibrate_from_homography(truth.homography, (960, 540))
    >>> str(calibration.status), round(calibration.camera.focal_length, 3)
    ('accepted', 1800.0)
    """
    if has_rank_two(finite_homography(H)):
        return Calibration.without_camera(Status.DEGENERATE, str(RANK), RANK)
    found = camera_from_homography(H, image_size, zeta=zeta, tolerance=tolerance, principal_point=principal_point)
    calibration = judged_decomposition(found)
    size = checked_image_size(image_size)
    other = of_another_picture(finite_homography(H), size) if principal_point is None else None
    if other is None:
        return calibration
    named = with_findings(calibration, other)
    return named if named.accepted else replace(named, message=f"{other}; {named.message}")


def has_rank_two(H: Array) -> bool:
    """Whether a homography (3, 3) from metres on a field to pixels cannot be inverted.

    Examples
    --------
    >>> has_rank_two(np.array([[10.0, 5.0, 480.0], [2.0, 1.0, 270.0], [0.0, 0.0, 1.0]]))
    True
    """
    scaled = H / np.maximum(np.linalg.norm(H, axis=1, keepdims=True), np.finfo(float).tiny)
    scaled = scaled / np.maximum(np.linalg.norm(scaled, axis=0), np.finfo(float).tiny)
    values = np.linalg.svd(scaled, compute_uv=False)
    return bool(values[2] <= SINGULAR * values[0])


def of_another_picture(H: Array, image_size: tuple[int, int]) -> Finding | None:
    """The finding that a homography maps to pixels of another size of the picture; None without evidence.

    The principal point of a camera is in the middle of its own picture. Beside a camera with square pixels a homography
    has one degree of freedom, which the errors of clicks take up: only an exact one tells, such as one that a program
    has written for a copy of the picture.

    Examples
    --------
    >>> H = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540)).homography
    >>> of_another_picture(H, (960, 540)), str(of_another_picture(H, (1920, 1080)))
    (None, 'the pixels are those of a picture of another size, about 960 x 540')
    """
    width, height = image_size
    if not two_focal_lengths(H, image_size) > APART:
        return None
    sizes = [(other, round(other * height / width)) for other in WIDTHS if other != width]
    differences = [two_focal_lengths(H, size) for size in sizes]
    best = int(np.argmin(differences))
    return Finding(What.OTHER_PICTURE, numbers=sizes[best]) if differences[best] < EXACT else None


def two_focal_lengths(H: Array, image_size: tuple[int, int]) -> float:
    """Difference between the logarithms of two focal lengths of a homography; infinite where one is not real.

    The columns h1 and h2 of ``K^-1 H`` are perpendicular, and of one length (Zhang, PAMI 2000, equations 3 and 4): each
    gives the focal length of a camera with square pixels and the principal point in the middle.
    """
    centred = H[:2] - np.outer(np.divide(image_size, 2.0), H[2])
    (a, b, _), (c, d, _), (e, f, _) = *centred, H[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.array([-(a * b + c * d) / (e * f), (b**2 + d**2 - a**2 - c**2) / (e**2 - f**2)])
        difference = float(abs(np.subtract(*np.log(squares))) / 2.0)
    return difference if np.isfinite(difference) else np.inf


def judged_decomposition(found: Decomposition) -> Calibration:
    """The calibration of a decomposed homography, see `calibrate_from_homography`."""
    camera = found.camera or found.initial
    if camera is None:
        return Calibration.without_camera(Status.IMPLAUSIBLE, found.message)
    field = soccer()
    calibration = judged_camera(camera, found.points, found.pixels, found.message, field=field)
    if found.camera is None:
        message = f"not refined: {found.message}"
        calibration = replace(calibration, status=Status.IMPLAUSIBLE, message=message)
    hint = _other_coordinates(camera, field)
    return replace(calibration, message=f"{calibration.message}; {hint}") if hint else calibration


def _other_coordinates(camera: Camera, field: Field) -> str:
    """Hint that a homography maps other coordinates than metres from the centre mark; empty without evidence."""
    if may_be_from_a_corner(camera, field):
        return FROM_A_CORNER
    reading = reading_of_camera(camera, field)
    if reading is None:
        return ""
    unit, corner = reading
    per_metre = f"{1.0 / UNITS[unit]:.6g}"
    return (
        f"it stands {np.linalg.norm(camera.C):.0f} m away, and with the main cameras if H maps {unit} from the "
        f"{'far left corner' if corner else 'centre mark'}: then give H @ np.diag([{per_metre}, {per_metre}, 1])"
        + corner
        * f" @ {TO_CORNER}"
    )


def judged_camera(
    camera: Camera, object_segments: ObjectSegments, frame: Pixels, message: str, *, field: Field | None = None
) -> Calibration:
    """Errors and verdict of a camera that was not found by a solver of this package.

    Parameters
    ----------
    camera : Camera
        The camera, for example from a closed form.
    object_segments : mapping of str to segment
        The calibration object.
    frame : dict of str to (N, 2) array
        Pixels by label, as `check_segments` returns them; without any, the errors are NaN.
    message : str
        Message for a plausible camera.
    field : Field, optional
        The field that the object is a part of, see `implausibilities`; by default the object, if it is a field.

    Returns
    -------
    Calibration
        Accepted, or implausible if it is physically impossible or most of the labels disagree with it.
    """
    if not frame:
        return Calibration(camera, Status.ACCEPTED, message, NAN, NAN, {})
    if field is None and isinstance(object_segments, Field):
        field = object_segments
    size = camera.image_size
    evaluation = evaluate_camera(camera, object_segments, frame)
    observations = evaluation.problem.observations
    labels, errors = observations.labels_in(0), observations.by_name(0, rms_by_label(evaluation)[0])
    far = WIDE_SCALE * pixel_unit(size)
    wrong = implausibilities(evaluation, far=far, field=field)
    reasons = [reason for reason, mask in wrong.items() if mask[0]]
    missed = [label for label, error in errors.items() if error > far]
    complaint = disagreement(labels, missed, unknowns=0)  # the camera was not fitted to them
    if reasons:
        complaint = f"the camera is physically implausible: {'; '.join(reasons)}"
    status = Status.IMPLAUSIBLE if complaint else Status.ACCEPTED
    rms, loss = float(rms_of_labels(evaluation)[0]), float(ndc_losses(evaluation, object_segments)[0])
    return Calibration(camera, status, complaint or message, rms, loss, errors)
