"""Calibration from the homography of the ground, and the verdict on a camera that was not solved here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib.assess.label_errors import rms_by_label, rms_of_labels
from fieldcalib.assess.ndc import ndc_losses
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.verdict import disagreement, implausibilities
from fieldcalib.assess.words import Status
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
