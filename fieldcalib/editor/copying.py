"""Marks of one frame moved to another one of the same camera, as the static background moves."""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array
from fieldcalib.editor.edit import Marks
from fieldcalib.editor.frame import FrameEditor
from fieldcalib.geometry.projective import dehomogenize, homogenize
from fieldcalib.images.background.matches import Matches, match_background, match_far
from fieldcalib.io.image import Image, size_of

NEAREST = 12  # matches around a mark: they tell what the homography, which has no lens, leaves


def moved_marks(marks: Marks, image: Image, to: FrameEditor) -> Marks:
    """Marks of an image moved to another frame, and snapped to the paint that it shows; those out of view are left out.

    Raises
    ------
    ValueError
        If the two frames show no background in common, or nothing of the marks is in view.
    """
    if size_of(image) != size_of(to.image):
        raise ValueError("expected frames of one size")
    matches = match_background(image, to.image) or match_far(image, to.image)
    if matches is None:
        raise ValueError("the frames show no background in common: copy from a frame nearer by")
    labels = [one.label for one in marks.all]
    there = _moved(matches, np.array([(one.x, one.y) for one in marks.all]))
    moved = Marks()
    for label, xy in zip(labels, there, strict=True):
        if np.all((xy >= 0.0) & (xy < size_of(to.image))):
            moved = moved.added(label, [to.place(label, xy)])
    if not len(moved):
        raise ValueError("none of the marks is in view in this frame")
    return moved


def _moved(matches: Matches, xy: Array) -> Array:
    """Places (N, 2) of static points in the second frame."""
    rest = matches.second - _mapped(matches.homography, matches.first)
    apart = np.linalg.norm(xy[:, None] - matches.first, axis=2)
    near = np.argsort(apart, axis=1)[:, :NEAREST]
    return _mapped(matches.homography, xy) + np.median(rest[near], axis=1)


def _mapped(H: Array, xy: Array) -> Array:
    return np.asarray(dehomogenize(homogenize(xy) @ H.T))
