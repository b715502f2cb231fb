"""A camera or homography compared with the true one: IoU_part, IoU_whole, projection error, difference of parameters.

IoU_part and IoU_whole are the intersection over union of the field areas in view of both. They compare a prediction
with a true camera or homography on a raster. IoU saturates: annotated homographies, which serve as truth, have errors
of more than 5 px in half of their segments.

The projection error is the distance on the field, in metres, between the points that both assign to a pixel.

What can be compared are cameras with any lens, and homographies of the ground (`Prediction`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from fieldcalib._types import FIELD, Array, BoolArray, expect, number, one_of, real_array
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.geometry.homography import SINGULAR, dehomogenize, homogenize
from fieldcalib.geometry.lens.brown_conrady import brown_conrady

Prediction: TypeAlias = Camera | Array
"""A camera, or the (3, 3) homography that maps field points (x, y, 1) in metres to pixels."""

NEAREST = 1e-3  # m: SoccerNet's evaluation ignores points that are nearer
IouWhole: TypeAlias = Literal["template", "image"]
CELL = 0.25  # m: cell size of the raster of IoU_part, 0.02 % of a typical area
ZOOM_OUT = 4  # size of the raster of IoU_whole in true rectangles, as in the code of Jiang et al. and TVCalib
MOST_CELLS = 5_000_000  # 1 GB
CELLS = (210, 136)  # of the true rectangle: half a metre each on a soccer field
PIXELS_ACROSS = 64  # of the grid of compared pixels


def checked_prediction(prediction: object, image_size: tuple[int, int]) -> Prediction:
    """A camera unchanged, a homography as a float array, or a ValueError.

    A camera must be for images of this size; that of a camera that is not `checked` may be a guess.
    """
    if isinstance(prediction, Camera) and prediction.checked and prediction.image_size != image_size:
        (w, h), (width, height) = prediction.image_size, image_size
        raise ValueError(
            f"the camera is for images of {w}x{h}, but the evaluated images have {width}x{height}: "
            f"use Camera.scaled, or read the annotations at the size of the camera"
        )
    if isinstance(prediction, Camera):
        return prediction
    try:
        H = real_array(prediction)
    except ValueError:
        H = np.zeros(0)
    if H.shape != (3, 3) or not np.all(np.isfinite(H)):
        came = f"an array of shape {H.shape}" if isinstance(prediction, np.ndarray) else type(prediction).__name__
        raise ValueError(
            f"expected a Camera or a homography as a finite array of shape (3, 3), got {came}; "
            f"for a Calibration give its `camera`"
        )
    return H


def is_homography(prediction: Prediction) -> bool:
    """Whether a prediction is a homography."""
    return not isinstance(prediction, Camera)


def project(prediction: Prediction, X: Array) -> Array:
    """Pixels (..., 2) of world points (..., 3); NaN for points without an image.

    A homography maps the ground and ignores the height of the points. Its sign follows from a camera above the ground,
    ``det K R [e1 e2 -C] = -fx fy z > 0``, and determines which points are beyond its horizon.
    """
    if isinstance(prediction, Camera):
        return prediction.project(X)
    with np.errstate(all="ignore"):
        return _in_front(homogenize(X[..., :2]) @ (_sign(prediction) * prediction).T)


def image_to_field(prediction: Prediction, xy: Array) -> Array:
    """Field points (..., 2) in metres of pixels (..., 2); NaN above the horizon."""
    if isinstance(prediction, Camera):
        return prediction.image_to_field(xy)[..., :2]
    with np.errstate(all="ignore"):
        # for a positive determinant, the adjugate has the sign of the inverse
        return _in_front(homogenize(xy) @ inverse_up_to_scale(_sign(prediction) * prediction).T)


def _sign(H: Array) -> float:
    """The sign, 1 or -1, that makes a homography that of a camera above the ground."""
    return float(np.sign(np.linalg.det(H)))


def _in_front(x: Array) -> Array:
    """Plane points of homogeneous ones; NaN where the last coordinate is not positive."""
    return np.where(x[..., 2:] > 0.0, dehomogenize(x), np.nan)


def homography_of(prediction: Prediction) -> Array:
    """The (3, 3) homography from the field to the image; the distortion of a camera is ignored."""
    return prediction.pinhole_homography if isinstance(prediction, Camera) else prediction


def inverse_up_to_scale(H: Array) -> Array:
    """The adjugate ``det(H) H^-1``, which also exists for singular homographies."""
    return np.asarray(np.cross(H[[1, 2, 0]], H[[2, 0, 1]]).T)


def project_as_soccernet(predictions: Sequence[Prediction], X: Array) -> tuple[Array, BoolArray]:
    """Pixels of world points as SoccerNet's evaluation computes them, for many predictions at once.

    For a camera, points more than a millimetre in front of it are visible, whether or not its lens is monotone there,
    and distorted normalised coordinates are rounded to single precision. For a homography every point is visible.

    Parameters
    ----------
    predictions : sequence of F predictions
    X : (M, 3) array
        World points; on the ground if a prediction is a homography.

    Returns
    -------
    xy : (F, M, 2) array
        Arbitrary where not visible.
    visible : (F, M) bool array
    """
    xy, visible = np.zeros((len(predictions), len(X), 2)), np.ones((len(predictions), len(X)), dtype=bool)
    maps = [f for f, prediction in enumerate(predictions) if is_homography(prediction)]
    with np.errstate(all="ignore"):  # implausible cameras overflow
        if maps:
            H = np.stack([homography_of(predictions[f]) for f in maps])
            xy[maps] = dehomogenize(homogenize(X[:, :2]) @ np.swapaxes(H, 1, 2))
        cameras = [p for p in predictions if isinstance(p, Camera)]
        if cameras:
            index = [f for f in range(len(predictions)) if f not in maps]
            xy[index], visible[index] = _project_cameras(cameras, X)
    return xy, visible


def _project_cameras(cameras: list[Camera], X: Array) -> tuple[Array, BoolArray]:
    K, R = np.stack([camera.K for camera in cameras]), np.stack([camera.R for camera in cameras])
    C, dist = (
        np.stack([camera.C for camera in cameras]),
        np.stack([np.zeros(12) if camera.fisheye else camera.opencv_coefficients for camera in cameras], axis=1),
    )
    Xc = np.moveaxis((X - C[:, None]) @ np.swapaxes(R, 1, 2), -1, 0)
    visible = Xc[2] > NEAREST
    depth = np.where(visible, Xc[2], 1.0)
    x = np.array([Xc[0] / depth, Xc[1] / depth])
    if np.any(dist):
        x = brown_conrady(x, dist[:, :, None])
    for one, camera in enumerate(cameras):
        if camera.fisheye:
            s = camera.focal_length * x[:, one]
            x[:, one] = camera.lens.distort(s, camera.lens_coefficients[:, None]) / camera.focal_length
    f, c = K[:, [0, 1], [0, 1]].astype(np.float32), K[:, :2, 2].astype(np.float32)
    single = np.moveaxis(x, 0, -1).astype(np.float32)
    return np.asarray(single * f[:, None] + c[:, None], dtype=float), np.asarray(visible)


def iou_part(
    prediction: Prediction,
    truth: Prediction,
    image_size: tuple[int, int],
    *,
    field: Field | None = None,
    cell: float = CELL,
) -> float:
    """IoU of the parts of the field in view of two cameras (paper, section "Metrics").

    Parameters
    ----------
    prediction, truth : Camera or (3, 3) array
        Cameras, with distortion, or homographies from the field to the image.
    image_size : (int, int)
        Width and height in pixels.
    field : Field, optional
        By default a soccer field of 105 x 68 m.
    cell : float
        Metres: size of the raster's cells. Others count cells of a yard. The result differs from that of exact areas by
        up to 0.005 where views have more than 100 square metres, and by up to 0.01 where they have 50.

    Returns
    -------
    float
        0..1; 0 if the field is in view of neither.

    Raises
    ------
    ValueError
        If one of the two is neither a camera of this size nor a homography, `image_size` is not valid, or `cell` is no
        part of the field's sides.

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> left, right = (Camera.from_angles(pan, 1.3, 0.0, 1500.0, (0, 60, -15), (960, 540)) for pan in (-0.02, 0.02))
    >>> iou_part(left, left, (960, 540)), round(iou_part(left, right, (960, 540)), 2)
    (1.0, 0.87)
    """
    field = soccer() if field is None else expect(field, Field, FIELD)
    if not 0.0 < number(cell, "cell") <= min(field.length, field.width):
        raise ValueError(f"cell must be metres, at most the field's width, got {cell}")
    if field.length / cell * field.width / cell > MOST_CELLS:
        raise ValueError(f"cell must be metres, at most {MOST_CELLS} of them in the field, got {cell}")
    x, y = (
        (np.arange(round(side / cell)) + 0.5) * (side / round(side / cell)) - side / 2.0
        for side in (field.length, field.width)
    )
    X = np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1).reshape(-1, 3)
    size = checked_image_size(image_size)
    return _iou(*(_sees(checked_prediction(view, size), X, size) for view in (prediction, truth)))


def iou_whole(
    prediction: Prediction,
    truth: Prediction,
    image_size: tuple[int, int],
    *,
    field: Field | None = None,
    kind: IouWhole = "template",
) -> float:
    """IoU of a rectangle and its image under one homography and the inverse of the other.

    Two definitions are in use. "template" is that of Jiang et al. and of the paper's code: the field's rectangle is
    mapped to the image by the truth and back by the prediction, ``H_pred^-1 H_true``. "image" is that of KpSFR and
    PnLCalib: the image's rectangle is mapped to the field by the truth and back by the prediction,
    ``H_pred H_true^-1``. Their values differ: 87.0 and 91.0 % for the same cameras. Distortion is ignored, since most
    of the field lies outside the image.

    Parameters
    ----------
    prediction, truth : Camera or (3, 3) array
    image_size : (int, int)
        Width and height in pixels.
    field : Field, optional
        By default a soccer field of 105 x 68 m.
    kind : {"template", "image"}
        Which definition.

    Returns
    -------
    float
        0..1, without areas beyond four times the rectangle's size; 0 if one of the two homographies is singular.

    Raises
    ------
    ValueError
        If one of the two is neither a camera of this size nor a homography, or `kind` or `image_size` is not valid.

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> left, right = (Camera.from_angles(pan, 1.3, 0.0, 1500.0, (0, 60, -15), (960, 540)) for pan in (-0.01, 0.01))
    >>> round(iou_whole(left, right, (960, 540)), 2), round(iou_whole(left, right, (960, 540), kind="image"), 2)
    (0.96, 0.93)
    """
    one_of(kind, get_args(IouWhole), "kind")
    field = soccer() if field is None else expect(field, Field, FIELD)
    width, height = checked_image_size(image_size)
    H_true, H_pred = (homography_of(checked_prediction(view, (width, height))) for view in (truth, prediction))
    with np.errstate(all="ignore"):  # implausible cameras overflow
        if kind == "template":
            back, unit = inverse_up_to_scale(H_true) @ H_pred, np.diag([field.length, field.width, 1.0])
        else:
            back = H_true @ inverse_up_to_scale(H_pred)
            unit = np.array([[width, 0.0, width / 2.0], [0.0, height, height / 2.0], [0.0, 0.0, 1.0]])
        back = np.asarray(np.linalg.solve(unit, back @ unit))
    if not (np.all(np.isfinite(back)) and np.linalg.cond(back) < SINGULAR):
        return 0.0
    x, y = ((np.arange(ZOOM_OUT * n) + 0.5) / n - ZOOM_OUT / 2.0 for n in CELLS)
    u, v, w = (row[0] * x + (row[1] * y + row[2])[:, None] for row in back)
    half = 0.5 * np.abs(w)
    warped = (np.abs(u) <= half) & (np.abs(v) <= half)
    return _iou(warped, (np.abs(x) <= 0.5) & (np.abs(y) <= 0.5)[:, None])


def _sees(view: Prediction, X: Array, image_size: tuple[int, int]) -> BoolArray:
    """Whether each of the points (M, 3) on the ground is in the image, (M,)."""
    xy = project(view, X)
    inside = np.asarray(np.all((xy >= 0.0) & (xy <= np.subtract(image_size, 1.0)), axis=-1))  # false for NaN
    if isinstance(view, Camera) and not view.checked and not view.is_pinhole:
        # where the lens is not monotone, two points have the same pixel: keep the one that the pixel is mapped back to
        back = image_to_field(view, xy[inside])
        inside[inside] = np.all(np.abs(back - X[inside, :2]) < CELL, axis=-1)
    return inside


def _iou(a: BoolArray, b: BoolArray) -> float:
    union = int(np.count_nonzero(a | b))
    return int(np.count_nonzero(a & b)) / union if union else 0.0


@dataclass(frozen=True)
class ProjectionError:
    """Distances on the field, in metres, over the pixels that show the field under the true camera."""

    mean: float
    median: float
    largest: float
    unseen: float
    """Share of these pixels that the prediction does not map to the ground; the distances are of the others."""


def projection_error(
    prediction: Prediction, truth: Prediction, image_size: tuple[int, int], *, field: Field | None = None
) -> ProjectionError:
    """Compare the field points that two cameras assign to the same pixels.

    A regular grid of pixels, 64 across the image, is mapped to the field by both; pixels whose true point is on the
    field count. (The published "projection error in metres" of KpSFR and PnLCalib scales the field to 100 x 60 m and
    under-reports by 10 to 17 %; these are metres.)

    Parameters
    ----------
    prediction, truth : Camera or (3, 3) array
        Cameras, with distortion, or homographies from the field to the image.
    image_size : (int, int)
        Width and height in pixels.
    field : Field, optional
        By default a soccer field of 105 x 68 m.

    Returns
    -------
    ProjectionError
        NaN where no pixel counts.

    Raises
    ------
    ValueError
        If one of the two is neither a camera of this size nor a homography, or `image_size` is not valid.

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> camera, moved = (Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (x, 60.0, -15.0), (960, 540)) for x in (0.0, 0.5))
    >>> round(projection_error(moved, camera, (960, 540)).mean, 6)
    0.5
    """
    field = soccer() if field is None else expect(field, Field, FIELD)
    width, height = checked_image_size(image_size)
    step = width / PIXELS_ACROSS
    xy = np.stack(np.meshgrid(np.arange(step / 2, width, step), np.arange(step / 2, height, step)), axis=-1) - 0.5
    X_true, X = (image_to_field(checked_prediction(view, (width, height)), xy) for view in (truth, prediction))
    counted = np.all(np.abs(X_true) <= (field.length / 2.0, field.width / 2.0), axis=-1)  # false for NaN
    with np.errstate(over="ignore"):  # implausible predictions overflow
        distance = np.linalg.norm(X[counted] - X_true[counted], axis=-1)
    seen = distance[np.isfinite(distance)]
    if not len(seen):
        return ProjectionError(np.nan, np.nan, np.nan, 1.0 if len(distance) else np.nan)
    return ProjectionError(
        float(np.mean(seen)), float(np.median(seen)), float(np.max(seen)), 1.0 - len(seen) / len(distance)
    )


@dataclass(frozen=True)
class CameraDifference:
    """Differences between an estimated camera and the true one; NaN where there is no camera."""

    focal_length: float
    """Percent."""
    position: float
    """Metres."""
    pan: float
    """Degrees, as tilt and roll."""
    tilt: float
    roll: float
    reprojection: float
    """Largest distance in pixels between the images of a point of the ground, over the visible field."""


def camera_difference(camera: Camera | None, truth: Camera, field: Field) -> CameraDifference:
    """Compare an estimated camera with the true one.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> truth = Camera.from_angles(0.0, 1.3, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
    >>> moved = Camera(truth.K, truth.R, truth.C + [0.0, 0.0, -0.5], truth.image_size)
    >>> errors = camera_difference(moved, truth, soccer())
    >>> errors.position, errors.pan, errors.reprojection > 5.0
    (0.5, 0.0, True)
    """
    if camera is None:
        return CameraDifference(*[np.nan] * 6)
    half = np.array([field.length, field.width]) / 2.0
    x, y = np.meshgrid(np.linspace(-half[0], half[0], 106), np.linspace(-half[1], half[1], 69))  # 1 m apart
    X = field.terrain.raised(np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3))
    xy = truth.project(X)
    visible = np.all((xy >= 0.0) & (xy <= np.array(truth.image_size) - 1.0), axis=-1)
    distance = np.linalg.norm(camera.project(X[visible]) - xy[visible], axis=-1)
    pan, tilt, roll = np.abs(np.degrees((camera.angles - truth.angles + np.pi) % (2.0 * np.pi) - np.pi)).tolist()
    return CameraDifference(
        100.0 * abs(camera.focal_length / truth.focal_length - 1.0),
        float(np.linalg.norm(camera.C - truth.C)),
        pan,
        tilt,
        roll,
        float(np.max(np.nan_to_num(distance, nan=np.inf))),
    )
