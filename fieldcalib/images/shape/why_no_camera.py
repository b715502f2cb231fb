"""Reasons why a picture gives no camera: it is too small, shows nothing, or shows perhaps another sport."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldcalib.assess.findings import NOT_SOCCER, Finding, Status, What
from fieldcalib.assess.result import Calibration, with_findings
from fieldcalib.assess.verdict import STEEPLY
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.fields.field import ObjectSegments
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.images.shape.shape_of_picture import Method
from fieldcalib.io.image import Image, size_of

LEAST_SIDE = 32  # px: a line of 12 cm is a twentieth of a pixel wide there
SMALL_SIDE = 200  # px: of 24 broadcast frames none got a camera when reduced to 320 x 180, 20 did at 400 x 225
FLAT = 16  # levels of brightness between the darkest and the brightest pixel, from compression and noise
DRAWN = 0.8  # share of pixels like their left neighbour from which on a picture is drawn: of 60 photos 0.72 at most
LOOKED_AT = 128  # approximate number of rows and columns whose brightness is compared
ASK_SPORT = Finding(What.MAY_BE_OTHER_SPORT)
DOUBTED = frozenset([Status.TOO_FEW_SEGMENTS, Status.IMPLAUSIBLE])


def said_plainly(
    calibrate: Method, images: Sequence[Image], *, object_segments: ObjectSegments, by_network: bool
) -> list[Calibration]:
    """Calibrate pictures; those that are too small, or show nothing, get no camera and a message that says why.

    Where a network for soccer has seen next to nothing of a soccer field, the message asks whether it is one.
    """
    large = [min(size_of(image)) >= LEAST_SIDE for image in images]
    some = [image for image, is_large in zip(images, large, strict=True) if is_large]
    found = iter(calibrate(some) if some else ())
    judged = [
        _judged(image, next(found)) if is_large else _too_small(image)
        for image, is_large in zip(images, large, strict=True)
    ]
    is_asked = by_network and _may_be_soccer(object_segments)
    return [
        _asked(one) if is_asked and not is_small(size_of(image)) else one
        for image, one in zip(images, judged, strict=True)
    ]


def is_small(image_size: tuple[int, int]) -> bool:
    """Whether pictures of this size are too small for the lines of a field to be found in most of them."""
    return min(image_size) < SMALL_SIDE


def small_words(image_size: tuple[int, int]) -> str:
    """Message for a picture too small to give a usable camera.

    Examples
    --------
    >>> small_words((160, 90))
    'too small: 160 x 90 pixels show hardly any line of a field, give the picture or the clip in its original size'
    """
    width, height = image_size
    seen = f"{width} x {height} pixels show hardly any line of a field"
    return f"too small: {seen}, give the picture or the clip in its original size"


def has_cameras(found: VideoCalibration) -> bool:
    """Whether any frame of a clip has a usable camera."""
    return any(np.any(tripod.accepted) for tripod in found.tripods)


def notes_without_camera(object_segments: ObjectSegments, image_size: tuple[int, int]) -> tuple[str, ...]:
    """Note for a clip in which a network for soccer has found no usable camera: too small, or maybe not soccer."""
    if is_small(image_size):
        return (f"no frame has a camera that can be used: {small_words(image_size)}",)
    return (f"no frame has a camera that can be used: {ASK_SPORT} {NOT_SOCCER.text.capitalize()}",) * _may_be_soccer(
        object_segments
    )


def _may_be_soccer(object_segments: ObjectSegments) -> bool:
    return object_segments.keys() >= soccer().keys()


def _too_small(image: Image) -> Calibration:
    width, height = size_of(image)
    reason = f"too small: the picture has only {width} x {height} pixels, and no side may have less than {LEAST_SIDE}"
    return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, f"{reason}; give it in its original size")


def _judged(image: Image, calibration: Calibration) -> Calibration:
    """Explain a rejected calibration: a picture without contrast gets no camera, a small one a message that says so.

    A drawing of a field, as a tactics board, looks as if taken from straight above, and is no picture of a camera.
    """
    step = max(min(size_of(image)) // LOOKED_AT, 1)
    if calibration.accepted:
        if calibration.required_camera.angles[1] > STEEPLY or _share_alike(image) < DRAWN:
            return calibration
        drawn = "the picture is a drawing, which no camera has taken"
        return replace(calibration, status=Status.IMPROBABLE, message=f"{drawn}; {calibration.message}")
    if int(np.ptp(image[::step, ::step])) <= FLAT:
        nothing = "the picture shows nothing: all of its pixels are nearly alike"
        return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, nothing)
    if is_small(size_of(image)):
        return replace(calibration, message=f"{small_words(size_of(image))}; {calibration.message}")
    return calibration


def _share_alike(image: Image) -> float:
    """Share of the pixels that are like their left neighbour."""
    return float(np.mean(np.all(image[:, 1:] == image[:, :-1], axis=2)))


def _asked(calibration: Calibration) -> Calibration:
    """Add the question whether it is soccer to a rejected calibration with hardly any detected lines."""
    if calibration.status not in DOUBTED and not calibration.has_finding(What.FEW_LINES):
        return calibration
    if calibration.accepted:
        return calibration
    return with_findings(replace(calibration, message=f"{calibration.message}; {ASK_SPORT}"), ASK_SPORT)
