"""Segmentation masks of the markings: which class every pixel has."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from fieldcalib.draw.scene import SHIFT, fixed_point, image_curves
from fieldcalib.fields.field import Field
from fieldcalib.fields.soccer import soccer
from fieldcalib.geometry.camera import Camera

CLASSES = tuple(sorted(label for label in soccer().markings if label not in soccer().half_labels))
"""The 26 segments that SoccerNet annotates, in its order; a mask holds 0 for the background and 1 + index."""
THICKNESS = 3.0 / 512.0  # of the image's width, for all: a network sees far lines that are thinner than a pixel

Mask = NDArray[np.uint8]


def markings_mask(camera: Camera, field: Field) -> Mask:
    """Every marking in view, (height, width), as a curve of constant thickness; of two that cross, either.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 500.0, C=(0, 56, -15), image_size=(512, 288))
    >>> mask = markings_mask(camera, soccer())
    >>> CLASSES[mask[160, 256] - 1]
    'Middle line'
    """
    width, height = camera.image_size
    mask = np.zeros((height, width), np.uint8)
    for value, label in enumerate(CLASSES, start=1):
        curves = [fixed_point(curve) for curve in image_curves(camera, field[label])]
        cv2.polylines(mask, curves, False, value, 1, cv2.LINE_8, SHIFT)
    side = max(1, round(THICKNESS * width))  # OpenCV's own thick lines are wider than they are said to be
    return np.asarray(cv2.dilate(mask, np.ones((side, side), np.uint8)), np.uint8)


def mirrored_values(*, behind_goal: bool) -> Mask:
    """What every value of a mask, (27,), becomes when the image is mirrored left to right.

    A mirrored image is that of the mirrored field, whose left is right. Behind the left goal, though, the camera stays
    there, see `data_tools.synthetic.cameras`: far and near swap, and the posts of each goal.

    Examples
    --------
    >>> value = 1 + CLASSES.index("Big rect. left top")
    >>> CLASSES[mirrored_values(behind_goal=False)[value] - 1], CLASSES[mirrored_values(behind_goal=True)[value] - 1]
    ('Big rect. right top', 'Big rect. left bottom')
    """
    field, mirror = soccer(), (1.0, -1.0, 1.0) if behind_goal else (-1.0, 1.0, 1.0)

    def box(label: str, signs: tuple[float, float, float]) -> tuple[float, ...]:
        X = field[label].sample(spacing=0.05) * signs
        return tuple(np.concatenate([X.min(axis=0), X.max(axis=0)]).round(1) + 0.0)  # + 0.0: no negative zeros

    values = {box(label, (1.0, 1.0, 1.0)): value for value, label in enumerate(CLASSES, start=1)}
    return np.array([0, *(values[box(label, mirror)] for label in CLASSES)], np.uint8)
