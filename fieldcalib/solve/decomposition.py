"""Decomposition of the homography of the ground into a camera, refined on field points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._checks import expect, is_number, real_array
from fieldcalib._types import Array
from fieldcalib.fields.segments import Point
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.geometry.homography import decompose_homography
from fieldcalib.geometry.projective import dehomogenize, finite_homography, homogenize

GROUND_POINTS: Mapping[str, Point] = MappingProxyType(
    {name: point for name, point in soccer().points.items() if point.X[2] == 0.0}
)
LEAST_POINTS = 3  # smallest number for cv2.solvePnPRefineLM
NO_FOCAL_LENGTH = "no real focal length fits the homography: it is no camera's"
INVERSE = "its inverse is a camera's: H seems to map pixels to metres, give np.linalg.inv(H)"


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


def _refined_pose(camera: Camera, X: Array, xy: Array) -> Camera | None:
    """The camera with R and t refined by OpenCV; None if that diverges."""
    import cv2  # a slow import

    rvec, tvec, K, dist = camera.to_opencv()  # OpenCV changes the pose in place: these are copies
    new_rvec, new_tvec = cv2.solvePnPRefineLM(X, xy, K, dist, rvec, tvec)
    if not (np.all(np.isfinite(new_rvec)) and np.all(np.isfinite(new_tvec))):
        return None
    return Camera.from_opencv(new_rvec, new_tvec, K, dist, camera.image_size)
