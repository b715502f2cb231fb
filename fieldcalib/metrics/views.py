"""Predictions that can be evaluated: cameras with any lens, and homographies of the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray, real_array
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import dehomogenize, homogenize
from fieldcalib.geometry.lens.brown_conrady import brown_conrady

Prediction: TypeAlias = Camera | Array
"""A camera, or the (3, 3) homography that maps field points (x, y, 1) in metres to pixels."""

NEAREST = 1e-3  # m: SoccerNet's evaluation ignores points that are nearer


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
