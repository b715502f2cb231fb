"""The shape of a single picture: calibrated by each hypothesis (`fieldcalib.problem.picture_shape`), the best is kept.

Black borders are taken off. If a picture shows a frame in a window, or several views, the windows are calibrated, and
the camera that is most probably right is taken; with several windows, the user is told to check which view it is. A
picture of another shape than 16:9 is calibrated as it is and as it would be shown if it had been squashed, and the one
is kept that the lines in it make more likely. Pictures of courts that are searched for are taken as they are; the lines
that were found tell whether it matters.

An enlarged part of a frame has the shape of a frame, but its principal point may lie anywhere, and the labels often
hardly determine it. It also lacks detail (`fieldcalib.images.shape.enlarged`). As whole frames may be as soft, detail
counts only together with the labels: a camera is doubted if it would be wrong with the principal point elsewhere, and
the softer the picture, the sooner; a part that was cut out, as sharp as ever, is doubted for its labels alone. Both are
then fitted once more with a principal point that may lie anywhere, and that camera is taken if its errors, which
include those of the principal point, are small.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fieldcalib.assess.cropping_evidence import principal_point_of, score
from fieldcalib.assess.findings import ENLARGED, IN_WINDOW, SEVERAL_VIEWS, Verdict, What
from fieldcalib.assess.result import Calibration, in_picture, with_findings
from fieldcalib.assess.verdict import STEEPLY
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.images.paint.detected_lines import calibrate_on_lines
from fieldcalib.images.paint.field_markings import Markings
from fieldcalib.images.refinement import ToRefine, refine_all
from fieldcalib.images.shape.borders_and_windows import parts_of
from fieldcalib.images.shape.enlarged import LARGEST_SOFTNESS, softness
from fieldcalib.io.image import Image, size_of
from fieldcalib.problem.picture_shape import (
    ENLARGED_SHARE,
    SURE_ANYWHERE,
    Declared,
    Placement,
    is_whole_shape,
    may_be_squashed,
    wants_neither_shape,
)
from fieldcalib.solve.likelier_shape import evidence_of, likelier
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import Prior, checked_prior

SCORE_OF_SOFTNESS = 5.0  # score of a softness of 1, in the units of `fieldcalib.problem.picture_shape.score_of_part`
LEAST_SCORE = 1.0  # score of softness and labels together above which a picture may be an enlarged part

Method = Callable[[Sequence[Image]], list[Calibration]]
Step = Callable[[Method, Sequence[Image]], list[Calibration]]  # a method that calls another one


def without_borders(calibrate: Method, images: Sequence[Image]) -> list[Calibration]:
    """Calibrate the parts of pictures between black borders or in windows; cameras are in pixels of whole pictures."""
    parts = [parts_of([image]) for image in images]
    shown = [one.image_in_frame(image) for some, image in zip(parts, images, strict=True) for one in some]
    of_parts = iter(calibrate(shown))
    found = []
    for whole, *windows in parts:
        between_borders = in_picture(next(of_parts), whole)
        several = (SEVERAL_VIEWS,) if len(windows) > 1 else ()
        in_windows = [in_picture(next(of_parts), window, *several) for window in windows]
        found.append(_best_window(between_borders, in_windows) if windows else between_borders)
    return found


def _best_window(whole: Calibration, others: Sequence[Calibration]) -> Calibration:
    """Choose the window's camera that is most likely right; if none is accepted, the whole picture's, with doubts.

    A camera that looks down on a field sees its areas as such rectangles: a good one of the whole picture is kept.
    """
    if whole.verdict is Verdict.GOOD and whole.required_camera.angles[1] < STEEPLY:
        return whole
    accepted = [one for one in others if one.accepted]
    if accepted:
        return max(accepted, key=lambda one: one.probability(size_known=True) if one.has_probability else 0.0)
    message = whole.message if whole.accepted else "; ".join(filter(None, (whole.message, str(IN_WINDOW))))
    return with_findings(replace(whole, message=message), IN_WINDOW)


def with_aspect_estimated(calibrate: Method, images: Sequence[Image], *, task: Task) -> list[Calibration]:
    """Calibrate pictures; those of another shape than 16:9 both as they are and unsquashed, the likelier is kept."""
    found = calibrate(images)
    odd = [i for i, image in enumerate(images) if found[i].camera is not None and may_be_squashed(size_of(image))]
    unsquashed = [Placement.whole(size_of(images[index])).squashed.image_in_frame(images[index]) for index in odd]
    for index, shown in zip(odd, calibrate(unsquashed) if odd else (), strict=True):
        log_ratio = log_ratio_of_squash(task, found[index], shown)
        found[index] = likelier(found[index], shown, log_ratio, size_of(images[index]))
    return found


def with_shape_compared(calibrate: Method, images: Sequence[Image], *, task: Task) -> list[Calibration]:
    """Calibrate pictures by search; their shape stays open only where it matters.

    They are not searched again as squashed ones: the lines that were found tell what another shape would change.
    """
    found = calibrate(images)
    for index, one in enumerate(found):
        if one.accepted and one.solved is not None and may_be_squashed(one.required_camera.image_size):
            size = one.required_camera.image_size
            if wants_neither_shape(size, one.solved.uncertainty.offsets.get("log aspect", (0.0, 1.0))):
                continue
            as_it_is, shown = (
                calibrate_on_lines(task, [one.solved.pixels.scaled(np.divide(shape, size))], shape)[0]
                for shape in (size, Placement.whole(size).squashed.frame_size)
            )
            compared = likelier(one, shown, evidence_of(shown) - evidence_of(as_it_is), size)
            found[index] = compared if compared.declared is Declared.COMPARED else one
    return found


def log_ratio_of_squash(
    task: Task, as_it_is: Calibration, shown: Calibration, task_of_shown: Task | None = None
) -> float:
    """Log evidence that a picture was squashed, from the lines that were found in it as it is and as shown.

    Each of the two cameras has its own lines, found near its markings. To both sets of lines, cameras of both shapes
    are fitted. `task_of_shown` is the task for the picture as shown, if what is known of the camera differs there (a
    focal length in pixels, say).
    """
    if as_it_is.camera is None or shown.camera is None or as_it_is.solved is None or shown.solved is None:
        return 0.0
    tasks = (task, as_it_is.camera.image_size), (task_of_shown or task, shown.camera.image_size)
    ratios = []
    for own in (as_it_is, shown):
        if not own.accepted or own.camera is None or own.solved is None:
            continue
        lines, own_size = own.solved.pixels, own.camera.image_size
        evidence, evidence_shown = (
            evidence_of(calibrate_on_lines(one, [lines.scaled(np.divide(size, own_size))], size)[0])
            for one, size in tasks
        )
        ratios.append(evidence_shown - evidence)
    return float(np.mean(ratios)) if ratios else 0.0


def with_enlarged_parts(calibrate: Method, images: Sequence[Image], *, task: Task) -> list[Calibration]:
    """Calibrate pictures; if one may be a part of a frame, its principal point is freed or a doubt added."""
    markings = Markings.of(task.object_segments)
    return [
        _as_enlarged(task, markings, image, one) if may_be_enlarged(image, one) else one
        for image, one in zip(images, calibrate(images), strict=True)
    ]


def may_be_enlarged(image: Image, calibration: Calibration) -> bool:
    """Whether a picture may be a part of a frame, by its labels or by its lack of detail, and its camera wrong then."""
    if calibration.has_finding(What.PART):
        return True
    camera, solved = calibration.camera, calibration.solved
    if camera is None or solved is None or calibration.verdict is not Verdict.GOOD:
        return False
    if not (calibration.has_probability and is_whole_shape(camera.image_size)):
        return False
    uncertainty = solved.on(calibration.field)
    found = principal_point_of(uncertainty)
    if found is None or uncertainty.layout.image_size != camera.image_size:
        return False
    missing = LEAST_SCORE - score(uncertainty, found, calibration.probability(size_known=True))
    return missing < SCORE_OF_SOFTNESS * LARGEST_SOFTNESS and SCORE_OF_SOFTNESS * softness(image) > missing


def _as_enlarged(task: Task, markings: Markings, image: Image, calibration: Calibration) -> Calibration:
    """Take the camera with a free principal point if it is sure, else add a doubt to the calibration."""
    freed = _freed(task, markings, image, calibration)
    if freed is not None and freed.verdict is Verdict.GOOD and freed.probability(level=True) >= SURE_ANYWHERE:
        x, y = freed.required_camera.principal_point
        found = f"the picture may be a part of a frame: its principal point was found at ({x:.0f}, {y:.0f})"
        return replace(freed, message=f"{found}; {freed.message}")
    return calibration if calibration.has_finding(What.PART) else with_findings(calibration, ENLARGED)


def _freed(task: Task, markings: Markings, image: Image, calibration: Calibration) -> Calibration | None:
    """Refine a calibration with a principal point that may lie anywhere; None if that gives no camera."""
    camera, solved = calibration.required_camera, calibration.solved
    assert solved is not None
    if calibration.field is not None and calibration.field is not task.field:  # of another size
        task = replace(task, object_segments=calibration.field)
        markings = Markings.of(calibration.field)
    task = replace(task, prior=window_prior(task.prior, task.object_segments, camera.image_size))
    given = ToRefine(image, calibration, solved.pixels, are_detected=True)
    (refined,) = refine_all(task, markings, [given], quick=True)
    return None if refined.calibration is calibration else refined.judged


def window_prior(prior: Prior, object_segments: ObjectSegments, image_size: tuple[int, int]) -> Prior:
    """Widen the prior of the principal point for pictures that are parts, moving or still, of larger ones.

    A window with the shape of a whole frame was cut out and enlarged, so its principal point may lie far off. For
    narrower pictures the prior allows for that already (`principal_point_sigma`).

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> window_prior("main center", soccer(), (960, 540))[0].principal_point
    0.15
    """
    if prior is None or not is_whole_shape(image_size):
        return prior
    stands = checked_prior(prior, object_segments if isinstance(object_segments, Field) else None)
    return tuple(replace(one, principal_point=max(one.principal_point, ENLARGED_SHARE)) for one in stands)
