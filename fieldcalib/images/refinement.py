"""Refinement of a camera on its image: it is fitted to lines that are detected near the projected markings.

Lines are located with sub-pixel accuracy, including lines that neither a network nor an annotator has labelled. Where
size or ground of fields vary (soccer), `on_field_as_seen` refines the camera on the field that the image shows.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, expect, truth
from fieldcalib.assess.label_errors import rms_by_label
from fieldcalib.assess.paint_in_view import UNSEEN, paint_share
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import YARD
from fieldcalib.images.paint.detected_lines import (
    SEARCH_RANGES,
    calibrate_on_lines,
    detected_lines,
    with_replaced,
    with_traced,
)
from fieldcalib.images.paint.line_profiles import Markings, Profiles, Strips, pixels_of_lines, profiles_along
from fieldcalib.images.paint.paint_evidence import (
    PaintEvidence,
    Ridges,
    evidence_of,
    missing_net,
    paint_evidence,
    paint_past_ends,
    wide_strips,
    widths_by_marking,
    with_extents,
    with_lines,
)
from fieldcalib.io.image_files import Image, checked_image, size_of
from fieldcalib.problem.evaluation import evaluate_cameras
from fieldcalib.problem.labelled_pixels import NO_PIXELS, ImageSegments, PixelTable, Weights
from fieldcalib.solve.field_size import with_field_from_labels
from fieldcalib.solve.from_homography import calibrate_from_homography
from fieldcalib.solve.from_segments import checked_labels
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import ALL, DEFAULT_FLAGS, CalibrationFlags, Prior, pixel_unit

# Lengths are in pixels of a 960 x 540 image and grow with the image.
STRAY = 8.0  # px from a camera that fits the lines: 6 to 12 give the same AC@10 and AC@20 on images of WC14
SAME_LINES = 0.95  # share of the lines of the wide search that the narrow one must find too, to leave the wide one out

NOISE_OF_SHARE = 0.01  # of the share of markings on paint, from one look to the next
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
    quick: bool = False,
) -> Calibration:
    """Refine a calibration on its image, or return it unchanged.

    In each of two passes, lines are searched for across the projected markings, and the camera is fitted to them. The
    result is returned if it is accepted and has enough line support (`line_support`), no less than `calibration`.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object.
    image : (height, width, 3) uint8 array
        Blue, green, red.
    calibration : Calibration
        Its markings must be within about 12 px of the lines in an image of 960x540, within 24 px in one of 1920x1080.
    image_segments : mapping of str to (N, 2) array_like, optional
        Labelled pixels; used for segments whose line is not found in the image. Lines of these segments that are too
        faint for single profiles are located by the contrast along the whole marking (`images.paint.detected_lines`).
    weights : mapping of str to float or (N,) array_like, optional
        Weights of the labelled pixels.
    flags, prior
        As in `calibrate_from_segments`.
    quick : bool
        Skip the first pass if nearly all lines that it would use are near enough for the second one. This takes a third
        less time; the camera differs by about a tenth of a pixel and is as accurate.

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
    expect(calibration, Calibration, "calibrate_from_segments gives it")
    if calibration.camera is None:
        return calibration
    size = calibration.camera.image_size
    quick, given = truth(quick, "quick"), {} if image_segments is None else image_segments
    pixels, pixel_weights = checked_labels(object_segments, given, weights, size)
    labels = PixelTable.of(object_segments, [pixels], [pixel_weights])
    one = ToRefine(checked_image(image, size), calibration, labels)
    task = Task(object_segments, flags=flags, prior=prior)
    (refined,) = refine_all(task, Markings.of(object_segments), [one], quick=quick)
    return calibration if refined.calibration is calibration else refined.judged


def refine_homography_on_image(
    object_segments: ObjectSegments, image: Image, H: ArrayLike, *, flags: int = DEFAULT_FLAGS, prior: Prior = ALL
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
        image; `ALIGNMENTS` converts homographies with other field coordinates.
    flags, prior
        As in `calibrate_from_segments`.

    Returns
    -------
    Calibration
        The refined calibration. If the image does not support it, the calibration of the homography, with a message
        that it is not refined: the markings must be within about 12 px of the lines in an image of 960x540. The message
        also says if the image supports the homography when its units are yards.

    Raises
    ------
    ValueError
        As `calibrate_from_homography` and `refine_on_image`.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> from fieldcalib.draw.scene import render_field
    >>> truth = Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540), k=(0.1, 0.0))
    >>> H = np.array([[1.0, 0, 4], [0, 1, -3], [0, 0, 1]]) @ truth.pinhole_homography  # off by 5 px, no lens
    >>> refined = refine_homography_on_image(soccer(), render_field(truth, soccer()), H)
    >>> mark = (41.5, 0.0, 0.0)
    >>> bool(np.linalg.norm(refined.camera.project(mark) - truth.project(mark)) < 0.5)
    True
    """
    image = checked_image(image)
    start = calibrate_from_homography(H, size_of(image))
    if start.camera is None:
        return start
    refined = refine_on_image(object_segments, image, start, flags=flags, prior=prior)
    if refined is not start:
        return refined
    complaint = "not refined: the image shows too few lines at its markings"
    in_yards = calibrate_from_homography(np.asarray(H) @ np.diag([1.0 / YARD, 1.0 / YARD, 1.0]), size_of(image))
    if refine_on_image(object_segments, image, in_yards, flags=flags, prior=prior) is not in_yards:
        complaint += f"; it shows them if H maps yards: then give H @ np.diag([{1 / YARD:.6g}, {1 / YARD:.6g}, 1])"
    return replace(start, message=f"{start.message}; {complaint}")


@dataclass(frozen=True, eq=False)
class ToRefine:
    """A calibration, with the image and the labels that it is refined on."""

    image: Image
    calibration: Calibration
    labels: PixelTable = NO_PIXELS
    """Labelled pixels, used for segments whose line is not found in the image."""
    are_detected: bool = False
    """Whether a network labelled the pixels; its labels far from a camera that fits the lines are left out."""


@dataclass(frozen=True)
class Refined:
    """A calibration, refined or unchanged, and its line support."""

    calibration: Calibration
    support: float
    """Line support of the camera (`line_support`); NaN without a camera."""
    paint: PaintEvidence | None = None
    """Paint of the markings in view; None without a camera, or if paint was not looked for."""

    @property
    def judged(self) -> Calibration:
        """The calibration with the evidence of paint in its image."""
        return self.calibration if self.paint is None else self.calibration.seen_in_image(self.paint.markings)

    @property
    def paint_share(self) -> float:
        """Share of the markings in view that lies on paint (`assess.paint_in_view.paint_share`), 0 without any."""
        return 0.0 if self.paint is None else paint_share(self.paint.markings)


def refine_all(
    task: Task,
    markings: Markings,
    given: Sequence[ToRefine],
    search_ranges: Sequence[float] = SEARCH_RANGES,
    *,
    quick: bool = False,
) -> list[Refined]:
    """Refine the calibrations of several images of one size together; see `refine_on_image`.

    Where markings lie beside their paint, cameras fitted to that paint are refined too. For cameras that already fit
    the lines, the last of the `search_ranges` is enough.
    """
    if not given:
        return []
    refined = _in_passes(task, markings, given, search_ranges, quick=quick)
    off = [t for t, one in enumerate(refined) if one.calibration.accepted and one.paint and len(one.paint.beside.xy)]
    if off:
        moved = _moved_to_paint(task, markings, [refined[t] for t in off], [given[t] for t in off])
        for t, one in zip(off, moved, strict=True):
            refined[t] = one
    return refined


def refined_under(task: Task, image: Image, calibration: Calibration, *, quick: bool = False) -> Calibration | None:
    """Refine a calibration on its image under another task, on its own field; None where that is not better."""
    assert calibration.solved is not None
    task = replace(task, object_segments=calibration.field or task.object_segments)  # of another size, perhaps
    given = ToRefine(image, calibration, calibration.solved.pixels, are_detected=True)
    (refined,) = refine_all(task, Markings.of(task.object_segments), [given], quick=quick)
    return None if refined.calibration is calibration else refined.judged


def _moved_to_paint(
    task: Task, markings: Markings, refined: Sequence[Refined], given: Sequence[ToRefine]
) -> list[Refined]:
    """Fit cameras to the paint beside their markings and refine them again; keep those with more markings on paint."""
    cameras = [one.calibration.required_camera for one in refined]
    lines = [
        with_replaced(detected_lines(image.image, profiles_along(camera, markings), markings), one.paint.beside)
        for one, image, camera in zip(refined, given, cameras, strict=True)
        if one.paint is not None
    ]
    fixed = task.with_flags(CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT)
    starts = calibrate_on_lines(fixed, lines, size_of(given[0].image), cameras, max(SEARCH_RANGES))
    again = [replace(image, calibration=start) for image, start in zip(given, starts, strict=True)]
    return [
        new if new.calibration.accepted and new.paint_share > old.paint_share else old
        for old, new in zip(refined, _in_passes(task, markings, again), strict=True)
    ]


def _in_passes(
    task: Task,
    markings: Markings,
    given: Sequence[ToRefine],
    search_ranges: Sequence[float] = SEARCH_RANGES,
    *,
    quick: bool = False,
) -> list[Refined]:
    """Fit cameras to the lines near their markings, one pass per search range, and look for the paint of markings.

    A camera is kept as it is unless its line support is enough and does not fall.
    """
    images, size = [one.image for one in given], size_of(given[0].image)
    labelled = {t: {} if one.are_detected else one.labels.by_label(0) for t, one in enumerate(given)}
    labels = {t: one.labels for t, one in enumerate(given)}
    detected = [t for t, one in enumerate(given) if one.are_detected]
    found = {t: one.calibration for t, one in enumerate(given)}
    cameras = {t: one.camera for t, one in found.items() if one.camera is not None}
    strips = _strips(images, cameras, markings)
    if quick and all(_is_settled(one, markings, labelled[t]) for t, one in strips.items()):
        search_ranges = search_ranges[-1:]
    best = {
        t: Refined(one, _support(strips[t], _lines(strips[t], markings, labelled[t])) if t in strips else np.nan)
        for t, one in found.items()
    }
    profiles = {t: one.profiles for t, one in strips.items()}  # of the cameras in `best`
    for search_range in search_ranges:
        in_this_pass = task
        if search_range > SEARCH_RANGES[-1]:
            # distant lines may belong to other markings, and a free principal point would absorb them
            in_this_pass = task.with_flags(CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT)
        else:
            labels |= _without_stray(task.object_segments, cameras, {t: labels[t] for t in detected if t in cameras})
        lines = [
            with_replaced(
                labels[t], pixels_of_lines(markings, one.profiles, _lines(one, markings, labelled[t], search_range))
            )
            for t, one in strips.items()
        ]
        again = calibrate_on_lines(in_this_pass, lines, size, list(cameras.values()))
        found = {t: calibration for t, calibration in zip(strips, again, strict=True) if calibration.accepted}
        cameras = {t: one.required_camera for t, one in found.items()}
        strips = _strips(images, cameras, markings, are_wide=search_range == search_ranges[-1])
    for t, one in strips.items():
        narrow = one.part(np.arange(len(one.profiles)), max(SEARCH_RANGES))
        offset = _lines(narrow, markings, labelled[t])
        support = _support(narrow, offset)
        if support >= max(LEAST_SUPPORT_REFINED, best[t].support):
            evidence = evidence_of(Ridges.across(one), markings)
            best[t] = Refined(found[t], support, with_lines(evidence, markings, narrow, offset, labelled[t]))
            profiles[t] = one.profiles
    return [looked_at(one, images[t], profiles.get(t), markings) for t, one in best.items()]


def looked_at(refined: Refined, image: Image, profiles: Profiles | None, markings: Markings) -> Refined:
    """Add the paint of the markings, if it was not looked for yet, its width, and whether a net is missing."""
    camera, paint = refined.calibration.camera, refined.paint
    if camera is None or profiles is None:
        return refined
    paint = paint_evidence(image, profiles, markings) if paint is None else paint
    past = paint_past_ends(Ridges.past_ends(image, camera, markings), markings)
    seen = with_extents(paint.markings, widths_by_marking(image, profiles, markings), past)
    missing = missing_net(image, camera, markings, seen) if markings.net else []
    return replace(refined, paint=replace(paint, markings=(*seen, *missing)))


def _strips(
    images: Sequence[Image], cameras: Mapping[int, Camera], markings: Markings, *, are_wide: bool = False
) -> dict[int, Strips]:
    sampled = wide_strips if are_wide else partial(Strips.of, search_range=max(SEARCH_RANGES))
    return {t: sampled(images[t], profiles_along(camera, markings)) for t, camera in cameras.items()}


def _is_settled(strips: Strips, markings: Markings, labelled: Mapping[str, Array]) -> bool:
    """Whether the narrow search suffices: it reaches nearly all lines of the wide one, and half of each marking's."""
    first = _lines(strips, markings, labelled, SEARCH_RANGES[0])
    member, count = strips.profiles.member, len(markings.labels)
    found = np.bincount(member, np.isfinite(first), count)
    near = np.bincount(member, np.abs(first) <= SEARCH_RANGES[-1] * strips.unit, count)  # false for NaN
    return bool(np.sum(near) >= SAME_LINES * np.sum(found) and np.all(2.0 * near >= found))


def near_labels(
    object_segments: ObjectSegments, cameras: Sequence[Camera], frames: Sequence[PixelTable], distance: float
) -> BoolArray:
    """Whether the rms distance of each label's pixels from its projected segment is below `distance`, (B, L).

    The images are of one size; `distance` is in pixels of an image of 960x540.
    """
    if not frames:
        return np.zeros((0, len(object_segments)), dtype=bool)
    pixels = PixelTable.joined(object_segments, frames)
    rms = rms_by_label(evaluate_cameras(cameras, object_segments, pixels))
    return np.asarray(rms < distance * pixel_unit(cameras[0].image_size))


def _without_stray(
    object_segments: ObjectSegments, cameras: Mapping[int, Camera], labels: Mapping[int, PixelTable]
) -> dict[int, PixelTable]:
    """Drop the labels of a network that are far from where a camera that fits the lines projects their segments."""
    near = near_labels(object_segments, [cameras[t] for t in labels], list(labels.values()), STRAY)
    return {t: one.take(is_near[one.label]) for (t, one), is_near in zip(labels.items(), near, strict=True)}


def _lines(
    strips: Strips, markings: Markings, labelled: Mapping[str, Array], search_range: float = SEARCH_RANGES[-1]
) -> Array:
    """Signed distances (n,) of lines from the markings, NaN for none; faint lines that a person labelled are traced."""
    return with_traced(strips, strips.lines(search_range), markings, labelled)


def _support(strips: Strips, lines: Array, search_range: float = SEARCH_RANGES[-1]) -> float:
    """Line support (see `line_support`) from the signed distances `lines` (n,) between lines and projected markings."""
    offset = lines[~strips.is_blind]
    share = np.maximum(1.0 - np.abs(offset) / (0.5 * search_range * strips.unit), 0.0)
    return float(np.mean(np.nan_to_num(share))) if len(share) else 0.0


def unrefined(markings: Markings, given: ToRefine) -> Refined:
    """Wrap a calibration without refining it, with its line support."""
    camera = given.calibration.camera
    return Refined(given.calibration, np.nan if camera is None else line_support(given.image, camera, markings))


def line_support(image: Image, camera: Camera, markings: Markings, search_range: float = SEARCH_RANGES[-1]) -> float:
    """Support of a camera by the lines in an image, from 0 to 1.

    The mean over profiles across the projected markings of ``max(1 - 2 |offset| / search_range, 0)``, where the offset
    is the distance of the line from the marking; a profile without a line counts 0. Profiles where paint cannot be
    seen (`Strips.is_blind`) do not count.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    camera : Camera
    markings : Markings
    search_range : float
        Pixels of a 960 x 540 image.
    """
    strips = Strips.of(image, profiles_along(camera, markings), search_range)
    return _support(strips, strips.lines(search_range), search_range)


def on_field_as_seen(
    task: Task, image: Image, calibration: Calibration, found: PixelTable = NO_PIXELS
) -> Refined | None:
    """Refine a camera on a field of the size, and on the ground, that its image shows; None if the given are likely.

    Parameters
    ----------
    task : Task
    image : (height, width, 3) uint8 array
        Blue, green, red.
    calibration : Calibration
        Calibration of the image on the given field.
    found : PixelTable
        Pixels that a network labelled.
    """
    sized = _on_field_of_labels(task, image, calibration, found)
    if sized is None or sized.paint is None or calibration.solved is None or task.field is None:
        return sized
    off = _off_paint(sized, task.field.moved_by_width.intersection(calibration.pixel_counts))
    if not off:
        return sized
    # labels of touchlines, some pixels off, drew the width: it comes from the paint beside them, or stays as it is
    beside = sized.paint.beside.of_labels(off)
    lines, found = (with_replaced(one, beside, off) for one in (calibration.solved.pixels, found))
    (start,) = calibrate_on_lines(task, [lines], size_of(image), [calibration.required_camera])
    start = replace(start, field=calibration.field, markings=calibration.markings)
    again = _on_field_of_labels(task, image, start, found) or _on_another_field(task, image, found, start, start)
    is_better = again.calibration.accepted and again.paint_share >= sized.paint_share - NOISE_OF_SHARE
    return again if is_better and not _off_paint(again, beside.by_label(0)) else sized


def _off_paint(seen: Refined, labels: Collection[str]) -> set[str]:
    """Those of some markings whose paint lies beside them, or is not there."""
    return {one.label for one in seen.judged.markings if one.label in labels and (one.is_beside or one.share < UNSEEN)}


def _on_field_of_labels(task: Task, image: Image, calibration: Calibration, found: PixelTable) -> Refined | None:
    """Refine a camera on a field of the size, and on the ground, that the pixels of a calibration determine, if any."""
    seen: list[Refined] = []

    def again(field: Field, camera: Camera) -> Calibration:
        start = replace(calibration, camera=camera, field=field)
        seen.append(_on_another_field(replace(task, object_segments=field), image, found, calibration, start))
        return seen[0].calibration

    sized = with_field_from_labels(calibration, again)
    return None if sized is calibration or sized.field is None else replace(seen[0], calibration=sized)


def _on_another_field(task: Task, image: Image, found: PixelTable, before: Calibration, start: Calibration) -> Refined:
    """Refine the camera of an image on another field, starting from a camera that fits its lines."""
    given = ToRefine(image, start, found, are_detected=True)
    (again,) = refine_all(task, Markings.of(task.object_segments), [given], SEARCH_RANGES[-1:])
    if again.calibration is not start:
        return again
    # the lines found anew do not support a better camera: fit the lines found before
    assert before.solved is not None
    (fitted,) = calibrate_on_lines(task, [before.solved.pixels], size_of(image), [start.required_camera])
    return replace(again, calibration=fitted)
