"""Refinement of a camera on its image: it is fitted to lines that are detected near the projected markings.

Lines are located with sub-pixel accuracy, including those that neither a network nor an annotator has labelled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib.assess.label_errors import rms_by_label
from fieldcalib.assess.markings import paint_share
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import YARD
from fieldcalib.images.detected_lines import LOSS_SCALE, PROFILES_PER_SEGMENT, SEARCH_RANGES, calibrate_on_lines
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.line_profiles import Profiles, Strips, lines_near, pixels_of_lines, profiles_along
from fieldcalib.images.paint_evidence import PaintEvidence, Ridges, evidence_of, wide_strips
from fieldcalib.io.image import Image, checked_image
from fieldcalib.problem.evaluation import evaluate_cameras
from fieldcalib.problem.labelled_pixels import ImageSegments, Pixels, Weights, check_segments
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.batch import checked_frames
from fieldcalib.solve.from_homography import calibrate_from_homography
from fieldcalib.solve.options import ALL, DEFAULT_FLAGS, CalibrationFlags, Prior, pixel_unit
from fieldcalib.solve.task import Task

# Lengths are in pixels of a 960 x 540 image and grow with the image.
STRAY = 8.0  # px from a camera that fits the lines: 6 to 12 give the same AC@10 and AC@20 on images of WC14
LEAST_SUPPORT_REFINED = 0.35  # broadcast frames: 0.36 to 0.9 for cameras within 3 px, below 0.38 for 95 % of wrong ones


def refine_on_image(
    object_segments: ObjectSegments,
    image: Image,
    calibration: Calibration,
    image_segments: ImageSegments | None = None,
    *,
    weights: Weights | None = None,
    flags: int = DEFAULT_FLAGS,
    prior: Prior = ALL,
) -> Calibration:
    """Refine a calibration on its image, or return it unchanged.

    In two passes, lines are searched across the projected markings and the camera is calibrated from their places. The
    result is returned if it is accepted, has enough line support (`line_support`) and not less than `calibration`.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object.
    image : (height, width, 3) uint8 array
        Blue, green, red.
    calibration : Calibration
        Its markings must be within about 12 px of the lines in an image of 960x540, within 24 px in one of 1920x1080.
    image_segments : mapping of str to (N, 2) array_like, optional
        Labelled pixels; used for segments whose line is not found in the image.
    weights : mapping of str to float or (N,) array_like, optional
        Weights of these.
    flags, prior
        As in `calibrate_from_segments`.

    Returns
    -------
    Calibration
        The refined calibration, whose errors refer to the lines found in the image, or `calibration` itself.

    Raises
    ------
    ValueError
        If the image is not uint8, has no three channels or is not of the camera's size, or from
        `calibrate_from_segments`.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> from fieldcalib.draw.scene import render_field
    >>> truth = Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Circle right")
    >>> pixels = {label: truth.project(soccer()[label].sample(9.0)) + (5.0, 2.0) for label in labels}
    >>> found = calibrate_from_segments(soccer(), pixels, (960, 540))
    >>> refined = refine_on_image(soccer(), render_field(truth, soccer()), found)
    >>> mark = (41.5, 0.0, 0.0)
    >>> [round(float(np.linalg.norm(c.camera.project(mark) - truth.project(mark)))) for c in (found, refined)]
    [5, 0]
    """
    if calibration.camera is None:
        return calibration
    size = calibration.camera.image_size
    labelled = check_segments(object_segments, image_segments or {}, size)
    one = ToRefine(checked_image(image, size), calibration, labelled, weights or {})
    (refined,) = refine_all(Task(object_segments, flags=flags, prior=prior), Markings.of(object_segments), [one])
    return calibration if refined.calibration is calibration else refined.judged


def refine_homography_on_image(
    object_segments: ObjectSegments,
    image: Image,
    H: ArrayLike,
    *,
    flags: int = DEFAULT_FLAGS,
    prior: Prior = ALL,
) -> Calibration:
    """Calibrate a camera, lens included, from any homography and its image.

    The camera of `calibrate_from_homography`, which has no lens, is refined by `refine_on_image`.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The field, e.g. `soccer()`.
    image : (height, width, 3) uint8 array
        Blue, green, red.
    H : (3, 3) array_like
        Maps field points (x, y, 1) in metres, origin at the centre mark, y towards the main camera, to pixels of the
        image; `ALIGNMENTS` translates the homographies of others.
    flags, prior
        As in `calibrate_from_segments`.

    Returns
    -------
    Calibration
        The refined calibration, or that of the homography with a message that it is not refined, where the image does
        not support it: the markings must be within about 12 px of the lines in an image of 960x540. The message also
        says if the image supports the homography with yards for metres.

    Raises
    ------
    ValueError
        As `calibrate_from_homography` and `refine_on_image`.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> from fieldcalib.draw.scene import render_field
    >>> truth = Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540), k=(0.1, 0.0))
    >>> H = np.array([[1.0, 0, 4], [0, 1, -3], [0, 0, 1]]) @ truth.homography  # off by 5 px, and without its lens
    >>> refined = refine_homography_on_image(soccer(), render_field(truth, soccer()), H)
    >>> mark = (41.5, 0.0, 0.0)
    >>> bool(np.linalg.norm(refined.camera.project(mark) - truth.project(mark)) < 0.5)
    True
    """
    image = checked_image(image)
    height, width = image.shape[:2]
    start = calibrate_from_homography(H, (width, height))
    if start.camera is None:
        return start
    refined = refine_on_image(object_segments, image, start, flags=flags, prior=prior)
    if refined is not start:
        return refined
    complaint = "not refined: the image shows too few lines at its markings"
    in_yards = calibrate_from_homography(np.asarray(H) @ np.diag([1.0 / YARD, 1.0 / YARD, 1.0]), (width, height))
    if refine_on_image(object_segments, image, in_yards, flags=flags, prior=prior) is not in_yards:
        complaint += f"; it shows them if H maps yards: then give H @ np.diag([{1 / YARD:.6g}, {1 / YARD:.6g}, 1])"
    return replace(start, message=f"{start.message}; {complaint}")


@dataclass(frozen=True, eq=False)
class ToRefine:
    """A calibration, with the image and the labels that it is refined on."""

    image: Image
    calibration: Calibration
    labelled: Pixels
    weights: Weights
    are_detected: bool = False
    """Whether a network labelled the pixels; its labels far from a camera that fits the lines are left out."""


@dataclass(frozen=True)
class Refined:
    """A calibration, refined or as it was, and its line support."""

    calibration: Calibration
    support: float
    """NaN where there is no camera."""
    profiles: Profiles | None = None
    """Across its markings; None where there is no camera."""
    wide: Strips | None = None
    """`wide_strips` of its image across these markings, where they are sampled already."""
    paint: PaintEvidence | None = None
    """Paint of the markings in view; None where it was not looked for."""

    @property
    def judged(self) -> Calibration:
        """The calibration with the evidence of paint in its image."""
        return self.calibration if self.paint is None else self.calibration.seen_in_image(self.paint.markings)


def refine_all(
    task: Task,
    markings: Markings,
    given: Sequence[ToRefine],
    search_ranges: Sequence[float] = SEARCH_RANGES,
) -> list[Refined]:
    """`refine_on_image` for images of one size, solved together.

    Where markings lie beside their paint, cameras that begin from that paint are tried too. Cameras that fit the lines
    already need the last of the `search_ranges` only.
    """
    refined = _in_passes(task, markings, given, search_ranges)
    off = [t for t, one in enumerate(refined) if one.calibration.accepted and one.paint and one.paint.beside]
    if off:
        moved = _moved_to_paint(task, markings, [refined[t] for t in off], [given[t] for t in off])
        for t, one in zip(off, moved, strict=True):
            refined[t] = one
    return refined


def _fitted(
    task: Task, given: Sequence[tuple[Calibration, Pixels, ToRefine]], loss_scale: float = LOSS_SCALE
) -> list[Calibration]:
    """Fit cameras to detected lines, and to labelled pixels of segments without a line, from given cameras."""
    cameras = [calibration.camera for calibration, _, _ in given if calibration.camera is not None]
    if not cameras:
        return []
    pixels = [{**one.labelled, **lines} for _, lines, one in given]
    weights = [
        {label.strip(): weight for label, weight in one.weights.items()}
        | {label: len(xy) / PROFILES_PER_SEGMENT for label, xy in lines.items()}
        for _, lines, one in given
    ]
    size = cameras[0].image_size
    table = PixelTable.of(task.object_segments, *checked_frames(task.object_segments, pixels, weights, size))
    return calibrate_on_lines(task, table, size, cameras, loss_scale)


def _with_paint(one: Refined, image: Image, markings: Markings) -> Refined:
    if one.profiles is None:
        return one
    wide = wide_strips(image, one.profiles) if one.wide is None else one.wide
    return replace(one, paint=evidence_of(Ridges.across(wide), markings))


def _moved_to_paint(
    task: Task, markings: Markings, refined: Sequence[Refined], given: Sequence[ToRefine]
) -> list[Refined]:
    """Fit cameras to the paint beside their markings too; keep those that bring more markings onto paint."""
    members = []
    for one, image in zip(refined, given, strict=True):
        assert one.paint is not None
        assert one.calibration.camera is not None
        lines, _ = lines_near(image.image, one.calibration.camera, markings, SEARCH_RANGES[-1])
        members.append((one.calibration, {**lines, **one.paint.beside}, replace(image, labelled={}, weights={})))
    starts = _fitted(task.with_flags(CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT), members, max(SEARCH_RANGES))
    again = [replace(image, calibration=start) for image, start in zip(given, starts, strict=True)]
    return [
        new if new.calibration.accepted and _paint_share(new) > _paint_share(old) else old
        for old, new in zip(refined, _in_passes(task, markings, again), strict=True)
    ]


def _paint_share(one: Refined) -> float:
    return 0.0 if one.paint is None else paint_share(one.paint.markings)


def _in_passes(
    task: Task, markings: Markings, given: Sequence[ToRefine], search_ranges: Sequence[float] = SEARCH_RANGES
) -> list[Refined]:
    """Fit cameras to the lines near their markings, in two passes, or keep them; and look for their paint."""
    images = [one.image for one in given]
    found = {t: one.calibration for t, one in enumerate(given)}
    strips = _strips(given, found, markings)
    best = _with_support(given, strips)
    for search_range in search_ranges:
        in_this_pass = task
        if search_range > SEARCH_RANGES[-1]:
            # distant lines may belong to other markings, and a free principal point would absorb them
            in_this_pass = task.with_flags(CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT)
        else:
            given = _without_stray(task.object_segments, given, found)
        members = [
            (found[t], pixels_of_lines(markings, one.profiles, one.lines(search_range)), given[t])
            for t, one in strips.items()
        ]
        again = _fitted(in_this_pass, members)
        found = {t: calibration for t, calibration in zip(strips, again, strict=True) if calibration.accepted}
        strips = _strips(given, found, markings, are_wide=search_range == search_ranges[-1])
    for t, one in strips.items():
        support = _support(one.part(np.arange(len(one.profiles)), max(SEARCH_RANGES)))
        if support >= max(LEAST_SUPPORT_REFINED, best[t].support):
            best[t] = Refined(found[t], support, one.profiles, one)
    return [_with_paint(one, image, markings) for one, image in zip(best, images, strict=True)]


def near_labels(
    object_segments: ObjectSegments, cameras: Sequence[Camera], frames: Sequence[Pixels], distance: float
) -> list[tuple[str, ...]]:
    """Labels of each frame whose pixels lie near their projected segments, in the root mean square.

    The images are of one size, and the distance is in pixels of one of 960x540.
    """
    if not frames:
        return []
    evaluation = evaluate_cameras(cameras, object_segments, PixelTable.of(object_segments, frames))
    observations, errors = evaluation.problem.observations, rms_by_label(evaluation)
    least = distance * pixel_unit(cameras[0].image_size)
    return [
        tuple(label for label, px in observations.by_name(t, of_frame).items() if px < least)
        for t, of_frame in enumerate(errors)
    ]


def _without_stray(
    object_segments: ObjectSegments, given: Sequence[ToRefine], found: Mapping[int, Calibration]
) -> list[ToRefine]:
    """Leave out segments that a network saw far from where cameras that fit the lines project them."""
    cameras = {t: one.camera for t, one in found.items() if given[t].are_detected and one.camera is not None}
    near = near_labels(object_segments, list(cameras.values()), [given[t].labelled for t in cameras], STRAY)
    left = list(given)
    for t, labels in zip(cameras, near, strict=True):
        weights = {label: weight for label, weight in given[t].weights.items() if label in labels}
        left[t] = replace(given[t], labelled={label: given[t].labelled[label] for label in labels}, weights=weights)
    return left


def _strips(
    given: Sequence[ToRefine], calibrations: Mapping[int, Calibration], markings: Markings, *, are_wide: bool = False
) -> dict[int, Strips]:
    """Strips of the images whose calibrations have a camera."""
    sampled = wide_strips if are_wide else partial(Strips.of, search_range=max(SEARCH_RANGES))
    return {
        t: sampled(given[t].image, profiles_along(calibration.camera, markings))
        for t, calibration in calibrations.items()
        if calibration.camera is not None
    }


def _support(strips: Strips, search_range: float = SEARCH_RANGES[-1]) -> float:
    """`line_support` of the camera whose projected markings the strips cross."""
    offset = strips.lines(search_range)[~strips.is_black]
    share = np.maximum(1.0 - np.abs(offset) / (0.5 * search_range * strips.unit), 0.0)
    return float(np.mean(np.nan_to_num(share))) if len(share) else 0.0


def _with_support(given: Sequence[ToRefine], strips: Mapping[int, Strips]) -> list[Refined]:
    without = [Refined(one.calibration, np.nan) for one in given]
    return [
        replace(one, support=_support(strips[t]), profiles=strips[t].profiles) if t in strips else one
        for t, one in enumerate(without)
    ]


def unrefined(markings: Markings, given: Sequence[ToRefine]) -> list[Refined]:
    """Calibrations as they are, with their line support."""
    return _with_support(given, _strips(given, {t: one.calibration for t, one in enumerate(given)}, markings))


def line_support(image: Image, camera: Camera, markings: Markings, search_range: float = SEARCH_RANGES[-1]) -> float:
    """Support of a camera by the lines in an image, from 0 to 1.

    The mean over profiles across the projected markings of ``max(1 - 2 |offset| / search_range, 0)``, where the offset
    is the distance of the line from the marking; a profile without a line counts 0. Profiles in black borders do not
    count.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    camera : Camera
    markings : Markings
    search_range : float
        Pixels of a 960 x 540 image.
    """
    return _support(Strips.of(image, profiles_along(camera, markings), search_range), search_range)
