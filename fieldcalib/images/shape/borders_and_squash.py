"""Calibration of pictures that may have black borders, show frames in windows, or may have been squashed.

Black borders (letterboxes and pillarboxes) are taken off. They are black, even, and equal on opposite sides, whereas
night skies and dark stands are on one side only, or have structure. Borders are compressed with the picture, so black
is not quite zero, and their last rows show a little of the picture.

If a picture shows a frame in a window, or several views (`fieldcalib.images.shape.picture_in_picture`), the windows are
calibrated, and the best of their cameras is taken; with several windows, the user is told to check which view it is.

A picture of another shape than 16:9 is calibrated as it is and as it would be shown if it had been squashed, and the
calibration that the lines in it make more likely is returned (`fieldcalib.solve.picture_shape`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fieldcalib.assess.cropping_evidence import IN_WINDOW, SEVERAL_VIEWS
from fieldcalib.assess.placement import Crop, Placement, Shape
from fieldcalib.assess.result import Calibration, with_findings
from fieldcalib.images.paint.detected_lines import calibrate_on_lines
from fieldcalib.images.shape.picture_in_picture import Window, windows_of
from fieldcalib.io.image import Image, size_of
from fieldcalib.solve.picture_shape import likelier, log_evidence, may_be_squashed, shown_size
from fieldcalib.solve.request import Task

Method = Callable[[Sequence[Image]], list[Calibration]]
Step = Callable[[Method, Sequence[Image]], list[Calibration]]  # a method that calls another one
BLACK = 30  # brightest channel; black of video is 16
FEW = 0.02  # share of brighter pixels that a black row may have: noise, a logo
EVEN = 4.0  # largest standard deviation of the brightness of a border; dark stands have more
SMALLEST, LARGEST = 0.01, 0.35  # shares of the picture's height or width that one border takes
STEP = 3  # one pixel in three of each row is used


def without_borders(calibrate: Method, images: Sequence[Image]) -> list[Calibration]:
    """Calibrate the parts of pictures between black borders or in windows; cameras are in pixels of whole pictures."""
    shapes = [shape_within(shown_part(image)) for image in images]
    found = _in_windows(
        calibrate, [shape.placement.image_in_frame(image) for shape, image in zip(shapes, images, strict=True)]
    )
    return [
        one if shape.placement.is_whole else shape.in_picture(one) for shape, one in zip(shapes, found, strict=True)
    ]


def _in_windows(calibrate: Method, images: Sequence[Image]) -> list[Calibration]:
    """Calibrate pictures, each by the window whose camera is most likely right, or as a whole if no window has one."""
    ways = [[Shape(within_borders(size_of(image), (0, 0))), *window_shapes(image)] for image in images]
    parts = [way.placement.image_in_frame(image) for some, image in zip(ways, images, strict=True) for way in some]
    of_parts = iter(calibrate(parts))
    found = []
    for some in ways:
        whole, *others = [way.in_picture(next(of_parts)) for way in some]
        found.append(_best_window(whole, others) if others else whole)
    return found


def window_shapes(image: Image) -> list[Shape]:
    """Shapes of the windows of a picture; if there are several, each has a finding that says so."""
    windows = windows_of(image)
    findings = (SEVERAL_VIEWS,) if len(windows) > 1 else ()
    return [replace(shape_within(placement_of(one, size_of(image))), findings=findings) for one in windows]


def placement_of(window: Window, image_size: tuple[int, int]) -> Placement:
    """The placement of frames in a window.

    Examples
    --------
    >>> placement_of(Window(200, 100, 920, 505), (960, 540)).crop
    Crop(frame_size=(720, 405), corner=(-200, -100))
    """
    left, top, right, bottom = window
    return Placement(image_size, image_size, Crop((right - left, bottom - top), (-left, -top)))


def _best_window(whole: Calibration, others: Sequence[Calibration]) -> Calibration:
    """Choose the window's camera that is most likely right; if none is accepted, the whole picture's, with doubts."""
    accepted = [one for one in others if one.accepted]
    if accepted:
        return max(accepted, key=lambda one: one.probability(size_known=True) if one.has_probability else 0.0)
    if whole.accepted:
        return with_findings(whole, IN_WINDOW)
    return with_findings(replace(whole, message="; ".join(filter(None, (whole.message, str(IN_WINDOW))))), IN_WINDOW)


def with_aspect_estimated(calibrate: Method, images: Sequence[Image], *, task: Task) -> list[Calibration]:
    """Calibrate pictures; those of another shape than 16:9 both as they are and unsquashed, the likelier is kept."""
    found = calibrate(images)
    odd = [i for i, image in enumerate(images) if found[i].camera is not None and may_be_squashed(size_of(image))]
    if not odd:
        return found
    others = calibrate([as_shown(images[index]) for index in odd])
    for index, shown in zip(odd, others, strict=True):
        log_ratio = log_ratio_of_squash(task, found[index], shown)
        found[index] = likelier(found[index], shown, log_ratio, size_of(images[index]))
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
            log_evidence(calibrate_on_lines(one, [lines.scaled(np.divide(size, own_size))], size)[0])
            for one, size in tasks
        )
        ratios.append(evidence_shown - evidence)
    return float(np.mean(ratios)) if ratios else 0.0


def as_shown(image: Image) -> Image:
    """Stretch a picture to the shape in which it would be shown if it had been squashed."""
    import cv2

    size = shown_size(size_of(image))
    # not cv2.resize, which maps corners of pixels: (0, 0) is the middle of the first one
    M = np.column_stack([np.diag(np.divide(size, size_of(image))), (0.0, 0.0)])
    return np.asarray(cv2.warpAffine(image, M, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def shown_part(image: Image) -> Placement:
    """Find the part of a picture between black borders: above and below, left and right, or both.

    Examples
    --------
    >>> picture = np.zeros((720, 960, 3), np.uint8)
    >>> picture[90:630] = 100
    >>> shown_part(picture).crop
    Crop(frame_size=(960, 540), corner=(0, -90))
    >>> shown_part(picture[:400]).is_whole
    True
    """
    height, width = image.shape[:2]
    rows = _border(image[:, ::STEP])
    columns = _border(np.swapaxes(image[rows : height - rows : STEP], 0, 1))
    return within_borders((width, height), (columns, rows))


def within_borders(image_size: tuple[int, int], border: tuple[int, int]) -> Placement:
    """Placement of frames between borders: `border` has the columns left and right, and the rows above and below.

    Examples
    --------
    >>> within_borders((960, 720), (0, 90)).frame_size
    (960, 540)
    """
    (width, height), (x, y) = image_size, border
    crop = Crop((width - 2 * x, height - 2 * y), (-x, -y)) if x or y else None
    return Placement(image_size, image_size, crop)


def shape_within(placement: Placement) -> Shape:
    """Shape of frames between borders; its message gives the part between them, and is empty without borders."""
    if placement.is_whole:
        return Shape(placement)
    (width, height), (x, y) = placement.frame_size, placement.corner
    return Shape(placement, f"without borders: {width} x {height} at {-x}, {-y}")


def _border(pixels: Image) -> int:
    """Height in rows of the smaller of the borders above and below, in pixels (N, M, 3); 0 if there are none."""
    count = len(pixels)
    most = int(LARGEST * count)
    least = max(round(SMALLEST * count), 2)
    if any(np.median(pixels[end].max(axis=1)) > BLACK for end in (0, -1)):  # quick: most pictures have none
        return 0
    first, last = (_black_rows(side.max(axis=2)) for side in (pixels[: most + 1], pixels[: -most - 2 : -1]))
    border = min(first, last)
    if not least <= border <= most:
        return 0
    ends = np.concatenate([pixels[:border], pixels[count - border :]]).max(axis=2).astype(float)
    return border if np.std(np.minimum(ends, BLACK)) <= EVEN else 0


def _black_rows(rows: NDArray[np.uint8]) -> int:
    """Number of black rows from the first row on."""
    is_black = np.mean(rows > BLACK, axis=1) <= FEW
    return int(len(rows) if np.all(is_black) else np.argmin(is_black))
