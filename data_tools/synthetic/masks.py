"""Segmentation masks of the markings: the class of every pixel."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from fieldcalib.draw.scene import SHIFT, fixed_point, image_curves
from fieldcalib.fields.field import ALIKE, Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera

MOST_CLASSES = 255  # of a mask, beside the background
THICKNESS = 3.0 / 512.0  # of the image's width, near and far: networks can see lines that are thinner than a pixel

Mask = NDArray[np.uint8]


def classes_of(field: Field, left_out: Collection[str] = ()) -> tuple[str, ...]:
    """Sorted labels of the markings that masks tell apart; halves of a circle that has its own label are left out.

    Raises
    ------
    ValueError
        If the field has no such markings, or more than a mask can hold.
    """
    classes = tuple(sorted(set(field.markings) - field.half_labels - set(left_out)))
    if not 0 < len(classes) <= MOST_CLASSES:
        raise ValueError(f"masks hold 1 to {MOST_CLASSES} lines, arcs and curves of a field, it has {len(classes)}")
    return classes


CLASSES = classes_of(soccer())
"""The 26 segments that SoccerNet annotates, in its order; a mask holds 0 for the background and 1 + index."""


def markings_mask(camera: Camera, field: Field, classes: Sequence[str] = CLASSES) -> Mask:
    """Mask (height, width) of every marking in view as a curve of constant thickness; where two cross, either counts.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 500.0, C=(0, 56, -15), image_size=(512, 288))
    >>> mask = markings_mask(camera, soccer())
    >>> CLASSES[mask[160, 256] - 1]
    'Middle line'
    """
    width, height = camera.image_size
    mask = np.zeros((height, width), np.uint8)
    for value, label in enumerate(classes, start=1):
        curves = [fixed_point(curve) for curve in image_curves(camera, field[label])]
        cv2.polylines(mask, curves, False, value, 1, cv2.LINE_8, SHIFT)
    side = max(1, round(THICKNESS * width))  # OpenCV draws thick lines wider than asked for
    return np.asarray(cv2.dilate(mask, np.ones((side, side), np.uint8)), np.uint8)


def mirrored_values(*, behind_goal: bool, field: Field | None = None, classes: Sequence[str] = CLASSES) -> Mask | None:
    """New value of each value of a mask, (classes + 1,), when the image is mirrored left to right.

    A mirrored image shows the mirrored field: left and right are swapped. A camera behind the left goal stays behind it
    (`data_tools.synthetic.cameras`): instead, far and near are swapped, and the posts of each goal.

    Parameters
    ----------
    behind_goal : bool
    field : Field, optional
        By default a soccer field.
    classes : sequence of str
        Classes of its masks.

    Returns
    -------
    (classes + 1,) array, or None
        None for a field that is not its own mirror image.

    Examples
    --------
    >>> value = 1 + CLASSES.index("Big rect. left top")
    >>> CLASSES[mirrored_values(behind_goal=False)[value] - 1], CLASSES[mirrored_values(behind_goal=True)[value] - 1]
    ('Big rect. right top', 'Big rect. left bottom')
    """
    field, mirror = field or soccer(), np.array((1.0, -1.0, 1.0) if behind_goal else (-1.0, 1.0, 1.0))
    samples = [field[label].sample(spacing=0.05) for label in classes]
    here, there = (
        np.array([[X.min(axis=0), X.max(axis=0)] for X in (signs * X for X in samples)]) for signs in (1.0, mirror)
    )
    alike = np.max(np.abs(there[:, None] - here), axis=(2, 3)) < ALIKE
    if not np.all(np.any(alike, axis=1)):
        return None
    return np.array([0, *(1 + np.argmax(alike, axis=1))], np.uint8)
