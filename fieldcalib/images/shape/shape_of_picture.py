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

Reasons why a picture gives no camera (`said_plainly`): it is too small, shows nothing, or shows perhaps another sport.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fieldcalib.assess.advice import NOT_SOCCER
from fieldcalib.assess.camera_errors import principal_point_of, score_above
from fieldcalib.assess.findings import ENLARGED, IN_WINDOW, SEVERAL_VIEWS, Finding, Status, Verdict, What
from fieldcalib.assess.result import Calibration, in_picture, with_findings
from fieldcalib.assess.verdict import STEEPLY
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.fields.field import ObjectSegments
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.images.paint.detected_lines import calibrate_on_lines
from fieldcalib.images.paint.line_profiles import Markings
from fieldcalib.images.refinement import ToRefine, refine_all, refined_under
from fieldcalib.images.shape.borders_and_windows import parts_of
from fieldcalib.images.shape.enlarged import LARGEST_SOFTNESS, softness
from fieldcalib.io.image_files import Image, size_of
from fieldcalib.problem.picture_shape import (
    ENLARGED_SHARE,
    SURE_ANYWHERE,
    Crop,
    Declared,
    Placement,
    frame_around,
    is_whole_shape,
    may_be_squashed,
    wants_neither_shape,
)
from fieldcalib.solve.likelier_shape import evidence_of, likelier
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import checked_prior

SCORE_OF_SOFTNESS = 5.0  # score of a softness of 1, in the units of `fieldcalib.problem.picture_shape.score_of_part`
LIKELIER_WHOLE = 1.0  # log evidence for a whole picture against a declared part; of true ones it is -4 to -1
SURE_OF_PART = 0.8  # least probability of a good camera of a part of a frame
LEAST_SCORE = 1.0  # score of softness and labels together above which a picture may be an enlarged part

Method = Callable[[Sequence[Image]], list[Calibration]]
Step = Callable[[Method, Sequence[Image]], list[Calibration]]  # a method that calls another one
LEAST_SIDE = 32  # px: a line of 12 cm is a twentieth of a pixel wide there
SMALL_SIDE = 200  # px: of 24 broadcast frames none got a camera when reduced to 320 x 180, 20 did at 400 x 225
# px, of the longer side: of nine frames of courts reduced to 360 columns seven are right as they are and nine enlarged,
# of those of 480 all either way
SMALLEST = 480
FLAT = 16  # levels of brightness between the darkest and the brightest pixel, from compression and noise
DRAWN = 0.8  # share of pixels like their left neighbour from which on a picture is drawn: of 60 photos 0.72 at most
LOOKED_AT = 128  # approximate number of rows and columns whose brightness is compared
ASK_SPORT = Finding(What.MAY_BE_OTHER_SPORT)
DOUBTED = frozenset([Status.TOO_FEW_SEGMENTS, Status.IMPLAUSIBLE])


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


def with_small_enlarged(calibrate: Method, images: Sequence[Image]) -> list[Calibration]:
    """Calibrate pictures, small ones at twice their size: reduced pictures are sharper than lines are taken to be."""
    places = [
        Placement((w, h), (2 * w, 2 * h)) if max(w, h) < SMALLEST else Placement.whole((w, h))
        for w, h in map(size_of, images)
    ]
    found = calibrate([place.image_in_frame(image) for place, image in zip(places, images, strict=True)])
    return [in_picture(one, place) for one, place in zip(found, places, strict=True)]


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

    Each of the two cameras has its own lines, found near its markings, on its field. To both sets of lines, cameras of
    both shapes are fitted. `task_of_shown` is the task for the picture as shown, if what is known of the camera differs
    there (a focal length in pixels, say).
    """
    if as_it_is.camera is None or shown.camera is None or as_it_is.solved is None or shown.solved is None:
        return 0.0
    tasks = (task, as_it_is.camera.image_size), (task_of_shown or task, shown.camera.image_size)
    ratios = [_log_ratio(own, *tasks) for own in (as_it_is, shown) if own.accepted]
    return float(np.mean(ratios)) if ratios else 0.0


def _log_ratio(own: Calibration, *tasks: tuple[Task, tuple[int, int]]) -> float:
    """Log evidence for the second of two tasks, each with a size of the picture, from the lines of a calibration."""
    assert own.camera is not None
    assert own.solved is not None
    lines, own_size = own.solved.pixels, own.camera.image_size
    on_field = [(task if own.field is None else replace(task, object_segments=own.field), size) for task, size in tasks]
    first, second = (
        evidence_of(calibrate_on_lines(task, [lines.scaled(np.divide(size, own_size))], size)[0])
        for task, size in on_field
    )
    return second - first


def with_enlarged_parts(calibrate: Method, images: Sequence[Image], *, task: Task) -> list[Calibration]:
    """Calibrate pictures; if one may be a part of a frame, its principal point is freed or a doubt added."""
    return [
        _as_enlarged(task, image, one) if may_be_enlarged(image, one) else one
        for image, one in zip(images, calibrate(images), strict=True)
    ]


def may_be_enlarged(image: Image, calibration: Calibration) -> bool:
    """Whether a picture may be a part of a frame, by its labels or by its lack of detail, and its camera wrong then."""
    if calibration.has_finding(What.PART):
        return True
    camera, solved = calibration.camera, calibration.solved
    if camera is None or solved is None or calibration.verdict is not Verdict.GOOD or not calibration.has_probability:
        return False
    uncertainty, size = solved.on(calibration.field), camera.image_size
    found = principal_point_of(uncertainty) if is_whole_shape(size) else None
    if found is None or uncertainty.layout.image_size != size:
        return False
    least = LEAST_SCORE - SCORE_OF_SOFTNESS * LARGEST_SOFTNESS
    score = score_above(least, uncertainty, found, calibration.probability(size_known=True))
    return score > least and score + SCORE_OF_SOFTNESS * softness(image) > LEAST_SCORE


def _as_enlarged(task: Task, image: Image, calibration: Calibration) -> Calibration:
    """Take the camera with a free principal point if it is sure, else add a doubt to the calibration."""
    own = replace(task, object_segments=calibration.field or task.object_segments)  # of another size, perhaps
    freed = refined_under(as_part(own, size_of(image)), image, calibration, quick=True)
    if freed is not None and freed.verdict is Verdict.GOOD and freed.probability() >= SURE_ANYWHERE:
        x, y = freed.required_camera.principal_point
        found = f"the picture may be a part of a frame: its principal point was found at ({x:.0f}, {y:.0f})"
        return replace(freed, message=f"{found}; {freed.message}")
    return calibration if calibration.has_finding(What.PART) else with_findings(calibration, ENLARGED)


def as_part(task: Task, image_size: tuple[int, int]) -> Task:
    """Widen the prior of a task for pictures that may be parts, moving or still, of larger ones.

    A part with the shape of a whole frame was cut out and enlarged, so its principal point may lie far off. For
    narrower ones the prior allows for that already (`principal_point_sigma`), but not for the focal length of a frame,
    which is long for their width.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> task = Task(soccer(), prior="main center")
    >>> as_part(task, (960, 540)).prior[0].principal_point, as_part(task, (480, 540)).prior[0].fov
    (0.15, (4.1, 90))
    """
    if task.prior is None:
        return task
    share, stands = image_size[0] / frame_around(image_size)[0], checked_prior(task.prior, task.field)
    if is_whole_shape(image_size):
        some = [replace(one, principal_point=max(one.principal_point, ENLARGED_SHARE)) for one in stands]
    else:
        some = [one if one.frame else replace(one, fov=(share * one.fov[0], one.fov[1])) for one in stands]
    return replace(task, prior=tuple(some))


def of_part_of_frames(task: Task, part: Crop) -> Task:
    """The task of pictures that show a part of frames, under the prior of the cameras of these."""
    assert task.prior is not None
    stands = checked_prior(task.prior, task.field)
    return replace(task, prior=tuple(replace(one, frame=(part.frame_size, part.corner)) for one in stands))


def within_frame(
    calibrate: Method, images: Sequence[Image], *, part: Crop | None, tasks: tuple[Task, Task], as_whole: Method
) -> list[Calibration]:
    """Calibrate pictures in their place in frames, which are black elsewhere.

    A picture is looked at by itself: a network knows no black frames, and paint can only be in the picture. Where that
    gives no good camera, the lines of a good one under the prior of whole pictures are tried.

    `tasks` are those of such parts and of whole pictures.
    """
    assert part is not None
    places = [place_of_part(image, part) for image in images]
    shown = [place.image_in_frame(image) for image, place in zip(images, places, strict=True)]
    found = [replace(one, declared=Declared.FRAME) for one in calibrate(shown)]
    unsure = [index for index, one in enumerate(found) if one.verdict is not Verdict.GOOD]
    for index, whole in zip(unsure, as_whole([shown[index] for index in unsure]), strict=True):
        if whole.verdict is Verdict.GOOD:
            one = _as_part(tasks[0], shown[index], whole)
            found[index] = one if one.verdict is Verdict.GOOD else found[index]
    return [  # where the picture lies was said by the user
        replace(in_picture(one, place, *_doubts_of_part(one, place, tasks)), message=one.message)
        for one, place in zip(found, places, strict=True)
    ]


def _as_part(task: Task, image: Image, whole: Calibration) -> Calibration:
    """Solve the camera of a whole picture again, from its lines, as that of a declared part, and refine it."""
    assert whole.solved is not None
    task, lines = replace(task, object_segments=whole.field or task.object_segments), whole.solved.pixels
    (start,) = calibrate_on_lines(task, [lines], size_of(image), [whole.required_camera])
    given = ToRefine(image, start, lines, are_detected=True)
    (refined,) = refine_all(task, Markings.of(task.object_segments), [given])
    return replace(refined.judged, declared=Declared.FRAME)


def place_of_part(frame: Image, part: Crop) -> Placement:
    """Where a frame that is black elsewhere shows a picture of one of its parts."""
    import cv2

    x, y, width, height = cv2.boundingRect(np.any(frame, axis=2).astype(np.uint8))
    right, bottom = (x + width, y + height) if width else size_of(frame)  # of a black picture
    return Placement.around(size_of(frame), *part.corner, right, bottom)


def _doubts_of_part(calibration: Calibration, place: Placement, tasks: tuple[Task, Task]) -> tuple[Finding, ...]:
    """Doubts on an accepted camera: less probable than cameras of parts must be, or of lines that want no such part."""
    if calibration.field is None or not calibration.accepted or calibration.solved is None:
        return ()
    doubts = list[Finding]()
    if calibration.verdict is Verdict.GOOD and calibration.has_probability and not place.is_whole:
        numbers = calibration.field.tolerance, calibration.probability()
        doubts += [Finding(What.IMPROBABLE, numbers=numbers)] if numbers[1] < SURE_OF_PART else []
    size = calibration.required_camera.image_size
    if (log_ratio := _log_ratio(calibration, *((task, size) for task in tasks))) > LIKELIER_WHOLE:
        doubts.append(Finding(What.CONTRADICTED, "part", (log_ratio,)))
    return tuple(doubts)


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
        alike = image[:, 1:] == image[:, :-1]  # left neighbours
        if calibration.required_camera.angles[1] > STEEPLY or np.mean(np.all(alike, axis=2)) < DRAWN:
            return calibration
        drawn = "the picture is a drawing, which no camera has taken"
        return replace(calibration, status=Status.IMPROBABLE, message=f"{drawn}; {calibration.message}")
    if int(np.ptp(image[::step, ::step])) <= FLAT:
        nothing = "the picture shows nothing: all of its pixels are nearly alike"
        return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, nothing)
    if is_small(size_of(image)):
        return replace(calibration, message=f"{small_words(size_of(image))}; {calibration.message}")
    return calibration


def _asked(calibration: Calibration) -> Calibration:
    """Add the question whether it is soccer to a rejected calibration with hardly any detected lines."""
    if calibration.accepted or not (calibration.status in DOUBTED or calibration.has_finding(What.FEW_LINES)):
        return calibration
    return with_findings(replace(calibration, message=f"{calibration.message}; {ASK_SPORT}"), ASK_SPORT)
