"""Calibration from the homography of the ground, and the verdict on a camera that comes from elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib.assess.label_errors import rms_by_label, rms_of_labels
from fieldcalib.assess.ndc import ndc_losses
from fieldcalib.assess.result import Calibration, Status
from fieldcalib.assess.verdict import disagreement, implausibilities
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import evaluate_camera
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.solve.decomposition import Decomposition, camera_from_homography
from fieldcalib.solve.options import WIDE_SCALE, pixel_unit
from fieldcalib.solve.origin_and_unit import UNITS, may_be_from_a_corner, reading_of_camera

NAN = float("nan")
TO_CORNER = "[[1, 0, length / 2], [0, 1, width / 2], [0, 0, 1]]"
FROM_A_CORNER = (
    f"it stands beside a corner and sees little of the field: if the origin of H is the far left corner, give "
    f"H @ {TO_CORNER}"
)


def calibrate_from_homography(
    H: ArrayLike,
    image_size: tuple[int, int],
    *,
    zeta: float = 100.0,
    tolerance: float = 0.1,
    principal_point: ArrayLike | None = None,
) -> Calibration:
    """Calibrate a camera from the homography of the ground, by decomposition (`camera_from_homography`).

    Square pixels, no lens. The camera is the closed form with R and t refined to the field points that the homography
    puts into the image. A homography has eight degrees of freedom and such a camera seven: `rms` and
    `per_segment_errors` say how far the two are apart, in pixels at those points.

    Parameters
    ----------
    H : (3, 3) array_like
        Maps field points (x, y, 1) in metres, origin at the centre mark, y towards the main camera, to pixels. Scale
        and sign do not matter. `ALIGNMENTS` translates the homographies of others.
    image_size : (int, int)
        Width and height in pixels.
    zeta : float
        Pixels between a point's image under H and its projection, from which on it is not used.
    tolerance : float
        How far outside the image a point may lie, in widths and heights.
    principal_point : (2,) array_like, optional
        In pixels; by default the image's centre.

    Returns
    -------
    Calibration
        "implausible" without a camera where the homography has no real focal length, and with the unrefined one where
        fewer than three points are near enough: the paper rejects those. The message says so where H seems to map
        pixels to the field, its origin a corner of the field, or its unit feet, centimetres or millimetres. Yards are
        not told from metres: the camera of either could be; `refine_homography_on_image` has the image to tell.

    Raises
    ------
    ValueError
        If H is no finite 3 x 3 matrix, zeta is not positive, tolerance is negative, or the principal point is none.

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
    found = camera_from_homography(H, image_size, zeta=zeta, tolerance=tolerance, principal_point=principal_point)
    return judged_decomposition(found)


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
    """A hint that a homography maps other coordinates than metres from the centre mark; empty if it seems not to."""
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
    """Errors and verdict of a camera that no solver of this package has found.

    Parameters
    ----------
    camera : Camera
        From a closed form, say.
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
        Accepted, or implausible: it is physically impossible, or most of the labels disagree with it.
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
    complaint = disagreement(labels, missed, unknowns=0)  # the camera comes from elsewhere
    if reasons:
        complaint = f"no camera that could be: {'; '.join(reasons)}"
    status = Status.IMPLAUSIBLE if complaint else Status.ACCEPTED
    rms, loss = float(rms_of_labels(evaluation)[0]), float(ndc_losses(evaluation, object_segments)[0])
    return Calibration(camera, status, complaint or message, rms, loss, errors)
