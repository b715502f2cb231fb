"""Estimation of the shape of a clip's frames from some of them: borders, windows, and whether they were squashed.

Borders are the smallest among the frames looked at. A window counts if most of them have it; of several windows the one
that gives the most cameras is taken, and the user is told to check all cameras.

Frames of another shape than 16:9 may have been squashed from it. They are calibrated both as they are and stretched to
the shape in which they would be shown, both times as frames of one camera, whose place and lens cannot absorb the
errors of single frames. With the right shape the lines lie nearer to their markings. With u and v the distances of the
lines of one label in one frame, as it is and as shown, both in the picture's own pixels, the log odds of squashed
frames are

    1/2 sum log(u / v)  +  mean over frames of the log odds of each frame by itself
    (`fieldcalib.images.shape.borders_and_squash`)

over all labels of all frames.

The shape of a live video is estimated as its pictures come (`LiveShape`). Borders begin with those of the first picture
that shows something. They shrink at once if a later picture shows something in them, and grow if all of the last
pictures that were looked at have larger ones. Whether pictures were squashed is estimated once some have been seen;
until then the user is told to check every camera.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.cropping_evidence import IN_WINDOW, SEVERAL_VIEWS, SHAPE
from fieldcalib.assess.findings import Finding
from fieldcalib.assess.label_errors import rms_by_label
from fieldcalib.assess.placement import Crop, Placement, Shape
from fieldcalib.assess.result import Calibration
from fieldcalib.images.clip.clip_problem import ClipProblem, calibrate_frames_alone
from fieldcalib.images.from_images import How
from fieldcalib.images.shape.borders_and_squash import (
    as_shown,
    log_ratio_of_squash,
    placement_of,
    shape_within,
    shown_part,
    within_borders,
)
from fieldcalib.images.shape.picture_in_picture import Window, windows_of
from fieldcalib.io.image import Image, each_checked, size_of
from fieldcalib.problem.evaluation import evaluate_cameras
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.picture_shape import SQUARE_LOG_ODDS, WAS_SQUASHED, may_be_squashed, shown_size
from fieldcalib.solve.sequence.sequence_solver import solve_sequence
from fieldcalib.solve.solver_options import CERTAIN

SEEN, APART = 8, 12  # number of frames that are used, and distance from one to the next in frames
FURTHEST = 3000  # frames, two minutes, among which they are
DARK = 10.0  # largest mean brightness of a frame that shows nothing
# Half a second apart, frames share part of their errors. With this weight 34 of 45 squashed stretches of nine clips and
# 53 of 89 parts of frames are recognised, and none is taken for the other; with twice as much some parts nearly are.
WEIGHT = 0.5  # factor of the sum over labels in the log odds
UPRIGHT_LOG_ODDS = -3.0  # prior log odds of a squashed picture that is higher than wide: most were cut out for phones
CHANCE = 0.05  # px: distances of lines below this are chance
ASKED = SEEN // 2, SEEN  # numbers of pictures seen at which the log odds of squashed frames are estimated
SAME = 2  # px: borders that differ by no more are the same, up to compression


@dataclass(frozen=True, eq=False)
class ShapeEstimator:
    """Estimates the shape of the frames of a clip."""

    how: How

    @property
    def finds_borders(self) -> bool:
        """Whether borders are looked for; not with a camera matrix, which is given for whole pictures."""
        return self.how.take_off_borders and self.how.task.given.camera_matrix is None

    @property
    def finds_squash(self) -> bool:
        """Whether it is estimated if frames were squashed; not with a camera matrix or without a prior."""
        is_free = self.how.task.given.camera_matrix is None and self.how.task.prior is not None
        return self.how.estimate_aspect and is_free

    def shape(self, images: Iterable[Image]) -> Shape | None:
        """Estimate the shape of the frames of a clip; None for frames without borders that were not squashed."""
        some = bright_frames(images) if self.finds_borders or self.finds_squash else []
        if not some:
            return None
        size = size_of(some[0])
        placement = common_borders(some) if self.finds_borders else Placement(size, size, None)
        placement, findings = self._window(some, placement) if self.finds_borders else (placement, ())
        shape = None if placement.is_whole else shape_within(placement)
        if self.finds_squash and may_be_squashed(placement.frame_size):
            shape = shape_of_odds(self.log_odds([placement.image_in_frame(image) for image in some]), placement)
        return shape if shape is None else replace(shape, findings=(*shape.findings, *findings))

    def _window(self, images: Sequence[Image], placement: Placement) -> tuple[Placement, tuple[Finding, ...]]:
        """Choose among the windows between black borders, and the whole, the one that gives the most cameras.

        Returns its placement, and findings if the whole was chosen or there are several windows.
        """
        inner = [placement.image_in_frame(image) for image in images]
        windows = common_windows(inner)
        if not windows:
            return placement, ()
        size = placement.frame_size
        ways = [Placement(size, size, None), *(placement_of(one, size) for one in windows)]
        cameras = [self._cameras([way.image_in_frame(image) for image in inner]) for way in ways]
        best = len(ways) - 1 - int(np.argmax(cameras[::-1]))  # a window rather than the whole
        way = ways[best]
        findings = (IN_WINDOW,) if best == 0 else (SEVERAL_VIEWS,) * (len(windows) > 1)
        corner = np.add(placement.corner, way.corner).tolist()
        return replace(placement, crop=Crop(way.frame_size, (corner[0], corner[1]))), findings

    def _cameras(self, images: Sequence[Image]) -> int:
        """Number of images that have a camera of their own."""
        return sum(one.accepted for one in calibrate_frames_alone(self.how, images))

    def log_odds(self, images: Sequence[Image]) -> float:
        """Log odds that frames of another shape than 16:9 were squashed from it, by the formula of the module."""
        size, shown = size_of(images[0]), shown_size(size_of(images[0]))
        both = [calibrate_frames_alone(self.how, some) for some in (images, [as_shown(one) for one in images])]
        alone = [
            log_ratio_of_squash(self.how.task, one, other)
            for one, other in zip(*both, strict=True)
            if one.accepted or other.accepted
        ]
        together = []
        for found in both:
            frames = [_lines(one, size) for one in found if one.accepted and one.solved is not None]
            if len(frames) > 1:
                together.append(_log_ratio(*(self._distances(frames, size, to) for to in (size, shown))))
        log_odds = SQUARE_LOG_ODDS * (size[0] == size[1]) + UPRIGHT_LOG_ODDS * (size[0] < size[1])
        return log_odds + sum(float(np.mean(some)) for some in (alone, together) if some)

    def _distances(self, frames: Sequence[PixelTable], size: tuple[int, int], shown: tuple[int, int]) -> Array:
        """Root mean square distance of each label from cameras fitted to all frames together, (T, L).

        The cameras are fitted to frames scaled to the size `shown`. The distances are in pixels of pictures of `size`,
        as the labels are; NaN without a camera or pixels.
        """
        scale = np.divide(shown, size)
        labels = {t: one.scaled(scale) for t, one in enumerate(frames)}
        how = replace(self.how, camera="tripod", estimate_size=True)
        problem = ClipProblem(how, shown, range(len(frames)), labels, {})
        solved = solve_sequence(problem.from_zero).calibration
        segments = self.how.task.object_segments if solved.field is None else solved.field
        cameras = {t: camera.scaled(size) for t, one in enumerate(solved) if (camera := one.camera) is not None}
        found = np.full((len(frames), len(segments)), np.nan)
        if cameras:
            pixels = PixelTable.joined(segments, [frames[t] for t in cameras])
            found[list(cameras)] = rms_by_label(evaluate_cameras(list(cameras.values()), segments, pixels))
        return found


def bright_frames(images: Iterable[Image]) -> list[Image]:
    """Select up to `SEEN` of the first frames that are not dark."""
    bright = (image for image in each_checked(islice(images, 0, FURTHEST, APART)) if np.mean(image) > DARK)
    return list(islice(bright, SEEN))


def common_borders(images: Sequence[Image]) -> Placement:
    """Placement of the frames between the black borders that all of the pictures have.

    Examples
    --------
    >>> picture = np.zeros((720, 960, 3), np.uint8)
    >>> picture[90:630] = 100
    >>> common_borders([picture, picture]).frame_size
    (960, 540)
    >>> common_borders([picture, picture + 50]).is_whole
    True
    """
    x, y = np.max([shown_part(image).corner for image in images], axis=0).tolist()
    return within_borders(size_of(images[0]), (-x, -y))


def common_windows(images: Sequence[Image]) -> list[Window]:
    """Windows (`fieldcalib.images.shape.picture_in_picture.windows_of`) that most of the pictures have.

    Examples
    --------
    >>> picture = np.full((540, 960, 3), 60, np.uint8)
    >>> picture[100:505, 200:920] = np.random.default_rng(0).integers(90, 250, (405, 720, 3))
    >>> len(common_windows([picture, picture])), common_windows([picture, np.zeros_like(picture)])
    (1, [])
    """
    found = [windows_of(image) for image in images]
    often = max(found, key=lambda some: sum(_are_same(some, other) for other in found))
    count = sum(_are_same(often, other) for other in found)
    return often if count > len(found) / 2 else []


def _are_same(some: Sequence[Window], others: Sequence[Window]) -> bool:
    return len(some) == len(others) and bool(np.all(np.abs(np.subtract(some, others)) <= SAME))


def shape_of_odds(log_odds: float, placement: Placement) -> Shape | None:
    """Shape of frames between borders from the log odds that they were squashed; None for whole unsquashed frames.

    Examples
    --------
    >>> whole = Placement((960, 720), (960, 720), None)
    >>> shape_of_odds(5.0, whole).placement.frame_size
    (1280, 720)
    >>> shape_of_odds(-5.0, whole) is None, shape_of_odds(1.0, whole).findings[0] == SHAPE
    (True, True)
    """
    doubt: tuple[Finding, ...] = () if abs(log_odds) > CERTAIN else (SHAPE,)
    message = shape_within(placement).message
    if log_odds > 0.0:
        size, shown = placement.frame_size, shown_size(placement.frame_size)
        scale = np.divide(shown, size)
        whole = np.rint(scale * placement.size).astype(int).tolist()
        x, y = np.rint(scale * placement.corner).astype(int).tolist()
        part = None if placement.crop is None else Crop(shown, (x, y))
        placement = Placement(placement.size, (whole[0], whole[1]), part)
        message, doubt = "; ".join(filter(None, (message, str(WAS_SQUASHED)))), (*doubt, WAS_SQUASHED)
    elif not doubt and placement.is_whole:
        return None
    return Shape(placement, message, doubt)


def _log_ratio(as_it_is: Array, shown: Array) -> float:
    """Log odds that frames were squashed, from the distances u and v of their lines as they are and as shown."""
    u, v = np.hypot(as_it_is, CHANCE), np.hypot(shown, CHANCE)
    return float(WEIGHT * np.nansum(np.log(u / v)))


def _lines(calibration: Calibration, size: tuple[int, int]) -> PixelTable:
    """Lines that a camera was fitted to, in pixels of pictures of a size."""
    assert calibration.solved is not None
    return calibration.solved.pixels.scaled(np.divide(size, calibration.required_camera.image_size))


class LiveShape:
    """Estimates the shape of the pictures of a video as they come.

    Parameters
    ----------
    estimator : ShapeEstimator
    submit : callable
        Starts a function on some pictures, and returns the future of its result.
    """

    def __init__(
        self,
        estimator: ShapeEstimator,
        submit: Callable[[Callable[[Sequence[Image]], float], list[Image]], Future[float]],
    ) -> None:
        self._estimator, self._submit = estimator, submit
        self._size = (0, 0)
        self._next = 0  # number of the next picture that will be looked at
        self._index = 0  # number of the next picture
        self._borders: deque[tuple[int, int]] = deque(maxlen=SEEN)  # borders of the last pictures looked at
        self._border = (0, 0)  # columns, rows
        self._parts: list[Image] = []  # frames from which the odds are estimated
        self._running: Future[float] | None = None
        self._log_odds: float | None = None
        self.shape: Shape | None = None
        """Shape of the pictures; None without borders if they were not squashed."""

    def update(self, image: Image) -> bool:
        """Take the next picture; return whether the placement of frames in the pictures has changed."""
        if not (self._estimator.finds_borders or self._estimator.finds_squash):
            return False
        index, self._index = self._index, self._index + 1
        self._size = size_of(image)
        if index >= self._next and np.mean(image[::APART, ::APART]) > DARK:
            self._next = index + APART
            self._look(image)
        if self._running is not None and self._running.done():
            self._log_odds, self._running = self._running.result(), None
        before, self.shape = self.shape, self._estimated()
        whole = Placement(self._size, self._size, None)
        old, new = (whole if shape is None else shape.placement for shape in (before, self.shape))
        return old != new

    def image_in_frame(self, image: Image) -> Image:
        """Cut the frame out of a picture, and stretch it if pictures were squashed."""
        return image if self.shape is None else self.shape.placement.image_in_frame(image)

    def _look(self, image: Image) -> None:
        if self._estimator.finds_borders:
            x, y = shown_part(image).corner
            self._borders.append((-x, -y))
            least = np.min(list(self._borders), axis=0)
            grown = np.max(least - self._border) > SAME and len(self._borders) in (1, SEEN)
            if grown or np.max(self._border - least) > SAME:
                self._border = (int(least[0]), int(least[1]))
                self._parts, self._running, self._log_odds = [], None, None
        if not self._estimator.finds_squash or len(self._parts) >= SEEN:
            return
        part = self._placement.image_in_frame(image)
        if may_be_squashed(size_of(part)):
            self._parts.append(part.copy())  # the caller may use its image again
            is_sure = self._log_odds is not None and abs(self._log_odds) > CERTAIN
            if len(self._parts) in ASKED and self._running is None and not is_sure:
                self._running = self._submit(self._estimator.log_odds, list(self._parts))

    @property
    def _placement(self) -> Placement:
        """Placement of the frames between the borders."""
        return within_borders(self._size, self._border)

    def _estimated(self) -> Shape | None:
        """Shape as far as it is known; while pictures may be squashed, with a finding that doubts every camera."""
        if self._log_odds is not None:
            return shape_of_odds(self._log_odds, self._placement)
        shape = replace(shape_within(self._placement), findings=(SHAPE,) if self._parts else ())
        return shape if shape.findings or not shape.placement.is_whole else None
