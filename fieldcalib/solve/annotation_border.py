"""Labels that all end at one column: the border of the annotated picture, which may be smaller than the given size.

Annotators follow a marking to the border of the picture. Labels of a picture of 960 x 540 pixels for which 1280 x 720
is given end at column 959, although their segments continue in the picture.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldcalib.assess.findings import Finding, What
from fieldcalib.assess.result import Calibration, found_of
from fieldcalib.fields.segments import ObjectSegments, Segment
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.labelled_pixels import Pixels

NEAR = 0.004  # of a side: labels whose ends differ by less end at one border,
APART = 0.03  # if they are this far from one another: labels that meet in a corner of the field are nearer
AWAY = 0.02  # of a side: least distance of that border from the picture's own, and least extent of labels towards it
# Usual widths of pictures; in one of a few hundred frames a single label ends by chance within half a pixel of the last
# column of one.
WIDTHS = (480, 512, 640, 720, 854, 960, 1024, 1280, 1366, 1600, 1920, 2560, 3840)
ROUNDED = 0.6  # px
SPACING = 1.0  # m, of points on a segment


def with_border_complaint(object_segments: ObjectSegments, frame: Pixels, calibration: Calibration) -> Calibration:
    """The calibration with the finding of `other_border` replaced; only for labels that were set by hand."""
    others = tuple(one for one in found_of(calibration) if one.what is not What.BORDER)
    if calibration.camera is not None and calibration.are_annotated:
        said = other_border(object_segments, frame, calibration.camera.image_size, calibration.camera)
        others = others if said is None else (*others, said)
    return calibration if others == found_of(calibration) else replace(calibration, _found=others)


def other_border(
    object_segments: ObjectSegments, frame: Pixels, image_size: tuple[int, int], camera: Camera | None
) -> Finding | None:
    """Evidence that the labels of a frame end at a border other than that of its picture; None if they do not.

    There is none for any of 756 annotated frames of SoccerNet and WC14, but for 96 % of them if their given width
    is a third too large or too small. Only labels count whose segments continue in the picture of the `camera` found.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> camera = Camera.from_angles(0.0, 1.35, 0.0, 1400.0, (0.0, 65.0, -16.0), (1280, 720))
    >>> pixels = {label: camera.project(soccer()[label].sample(0.1)) for label in ("Side line top", "Circle central")}
    >>> labels = {label: xy[np.all((xy > 0.0) & (xy < 960.0), axis=1)] for label, xy in pixels.items()}
    >>> str(other_border(soccer(), labels, (1280, 720), camera))
    'the labels end at column 959 of 1280: are they of a picture that is 960 pixels wide?'
    >>> labels = {label: xy[np.all((xy > 0.0) & (xy < (1280.0, 720.0)), axis=1)] for label, xy in pixels.items()}
    >>> other_border(soccer(), labels, (1280, 720), camera) is None
    True
    """
    width, height = image_size
    ends = {
        label: xy[np.argmax(xy[:, 0])]
        for label, xy in frame.items()
        if len(xy) and not object_segments[label].is_point and np.ptp(xy[:, 0]) > AWAY * width  # no posts
    }
    if camera is None or not ends:
        return None
    end = float(max(xy[0] for xy in ends.values()))
    if abs(end + 1.0 - width) <= AWAY * width:
        return None
    last = {label: xy for label, xy in ends.items() if xy[0] > end - NEAR * width}
    rows = np.sort([xy[1] for label, xy in last.items() if _goes_on(object_segments[label], camera, end)])
    if not len(rows):
        return None
    together = np.any(np.diff(rows) > APART * height)
    if not (together or np.min(np.abs(end + 1.0 - np.array(WIDTHS))) < ROUNDED):
        return None
    column = round(end)
    return Finding(What.BORDER, numbers=(column, width, column + 1))


def _goes_on(segment: Segment, camera: Camera, column: float) -> bool:
    """Whether a segment continues to the right of a column, in the picture or beside it."""
    x = camera.project(segment.sample(SPACING))[:, 0]
    return bool(np.any(x > column + APART * camera.image_size[0]))  # false for NaN
