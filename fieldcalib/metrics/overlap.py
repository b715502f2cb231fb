"""Intersection over union of the field areas in view of two cameras: IoU_part and IoU_whole.

Both compare a prediction with a true camera or homography on a raster. IoU saturates: annotated homographies, which
serve as truth, have errors of more than 5 px in half of their segments.
"""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import numpy as np

from fieldcalib._types import FIELD, Array, BoolArray, expect, number
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.geometry.projective import SINGULAR
from fieldcalib.metrics.views import (
    Prediction,
    checked_prediction,
    homography_of,
    image_to_field,
    inverse_up_to_scale,
    project,
)

IouWhole: TypeAlias = Literal["template", "image"]

CELL = 0.25  # m: cell size of the raster of IoU_part, 0.02 % of a typical area
ZOOM_OUT = 4  # size of the raster of IoU_whole in true rectangles, as in the code of Jiang et al. and TVCalib
MOST_CELLS = 5_000_000  # 1 GB
CELLS = (210, 136)  # of the true rectangle: half a metre each on a soccer field


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
    if not isinstance(kind, str) or kind not in get_args(IouWhole):
        raise ValueError(f"kind must be one of {', '.join(get_args(IouWhole))}, got {kind!r}")
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
