"""The shape of a clip's frames: each hypothesis (`fieldcalib.problem.picture_shape`) asked of several frames together.

Borders are the smallest among the frames looked at. A window counts if most of them have it; of several windows the one
that gives the most cameras is taken, and the user is told to check all cameras.

Frames of another shape than 16:9 may have been squashed from it. They are calibrated both as they are and stretched to
the shape in which they would be shown, both times as frames of one camera, whose place and lens cannot absorb the
errors of single frames. With the right shape the lines lie nearer to their markings. With u and v the distances of the
lines of one label in one frame, as it is and as shown, both in the picture's own pixels, the log odds of squashed
frames are

    prior  +  1/2 sum log(u / v)  +  mean over frames of the log ratio of each frame by itself (`log_ratio_of_squash`)

over all labels of all frames.

The shape of a live video is estimated as its pictures come (`LiveShape`). Borders begin with those of the first picture
that shows something. They shrink at once if a later picture shows something in them, and grow if all of the last
pictures that were looked at have larger ones. Whether pictures were squashed is estimated once some have been seen;
until then the user is told to check every camera.

The frames of a tripod share their principal point. If their lines put it far from the middle, a shot is solved with a
free principal point from the beginning (`CUT_OUT` of `clip_models`). If they put it near the middle, the frames are
whole. In short shots with few lines they determine neither: the cameras are then right if the frames are whole, and may
be wrong by metres if not, although all lines fit. Two kinds of evidence count together: the log likelihood ratio of a
part to a whole frame from the principal point (-3 to -4.5 if lines show that it is near the middle, about 0 if they do
not determine it), and whether the keyframes were enlarged (`fieldcalib.images.shape.enlarged`). Frames that may be
enlarged are solved once more, with a principal point that may lie anywhere. The errors of these cameras include those
of the principal point. They are taken if a part is more likely, or if they are sure; if they are not sure, the user is
told to check them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.camera_errors import FAINT
from fieldcalib.assess.findings import ENLARGED, IN_WINDOW, SEVERAL_VIEWS, SHAPE, WAS_SQUASHED
from fieldcalib.assess.label_errors import rms_by_label
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration, with_doubts
from fieldcalib.assess.video import Shape
from fieldcalib.images.clip.clip_problem import ClipProblem, calibrate_frames_alone
from fieldcalib.images.from_images import How
from fieldcalib.images.shape.borders_and_windows import borders_of, parts_of, within_borders
from fieldcalib.images.shape.shape_of_picture import SCORE_OF_SOFTNESS, as_part, log_ratio_of_squash, place_of_part
from fieldcalib.io.image_files import Image, each_checked, size_of
from fieldcalib.problem.evaluation import evaluate_cameras
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.picture_shape import (
    LARGEST_SPREAD,
    SURE,
    Placement,
    PrincipalPoint,
    is_whole_shape,
    may_be_squashed,
    principal_point_sigma,
    squash_log_odds,
)
from fieldcalib.solve.request import Task
from fieldcalib.solve.sequence.sequence_solver import solve_sequence
from fieldcalib.solve.solver_options import CERTAIN, checked_prior

SEEN, APART = 8, 12  # number of frames that are used, and distance from one to the next in frames
FURTHEST = 3000  # frames, two minutes, among which they are
DARK = 10.0  # largest mean brightness of a frame that shows nothing
# Half a second apart, frames share part of their errors. With this weight 34 of 45 squashed stretches of nine clips and
# 53 of 89 parts of frames are recognised, and none is taken for the other; with twice as much some parts nearly are.
WEIGHT = 0.5  # factor of the sum over labels in the log odds
CHANCE = 0.05  # px: distances of lines below this are chance
ASKED = SEEN // 2, SEEN  # numbers of pictures seen at which the log odds of squashed frames are estimated
SAME = 2  # px: borders that differ by no more are the same, up to compression
# Distance of a principal point from the middle in standard deviations: beyond the first it is freed, beyond the second
# the picture is not a whole one. Measured broadcast cameras are up to 1.75 off.
MAY_BE_OFF = 2.0
OFF_MIDDLE = 2.8
# Score of log likelihood ratio and softness together above which frames may be enlarged: soft whole shots of broadcasts
# with good cameras have up to 1.6, enlarged shots whose cameras pass as good but are over 1 m off at least 2.8.
LEAST_SCORE = 2.3


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
        part = self.how.part
        some = bright_frames(images) if self.finds_borders or self.finds_squash or part is not None else []
        if not some:
            return None
        if part is not None:
            return Shape(place_of_part(np.max(some, axis=0), part)) or None
        found = self._part(some) if self.finds_borders else Shape(Placement.whole(size_of(some[0])))
        pixel_aspect = getattr(images, "pixel_aspect", 1.0)  # of a video whose file states it
        if self.finds_squash and pixel_aspect != 1.0:
            found = found._replace(placement=found.placement.stretched(pixel_aspect))
        elif self.finds_squash and may_be_squashed(found.placement.frame_size):
            log_odds = self.log_odds([found.placement.image_in_frame(image) for image in some])
            found = shape_of_odds(log_odds, found)
        return found or None

    def _part(self, images: Sequence[Image]) -> Shape:
        """Choose the part that shows the frame: between borders or, if there are windows, with the most cameras."""
        parts = parts_of(images)
        if len(parts) == 1:
            return Shape(parts[0])
        cameras = [
            sum(one.accepted for one in self._alone([part.image_in_frame(image) for image in images])) for part in parts
        ]
        best = len(parts) - 1 - int(np.argmax(cameras[::-1]))  # a window rather than the whole
        return Shape(parts[best], (IN_WINDOW,) if best == 0 else (SEVERAL_VIEWS,) * (len(parts) > 2))

    def _alone(self, images: Sequence[Image]) -> list[Calibration]:
        return calibrate_frames_alone(self.how, images)

    def log_odds(self, images: Sequence[Image]) -> float:
        """Log odds that frames of another shape than 16:9 were squashed from it, by the formula of the module."""
        size = size_of(images[0])
        squashed = Placement.whole(size).squashed
        both = [self._alone(some) for some in (images, [squashed.image_in_frame(one) for one in images])]
        alone = [
            log_ratio_of_squash(self.how.task, one, other)
            for one, other in zip(*both, strict=True)
            if one.accepted or other.accepted
        ]
        together = []
        for found in both:
            frames = [_lines(one, size) for one in found if one.accepted and one.solved is not None]
            if len(frames) > 1:
                u, v = (self._distances(frames, size, to) for to in (size, squashed.frame_size))
                together.append(WEIGHT * np.nansum(np.log(np.hypot(u, CHANCE) / np.hypot(v, CHANCE))))
        return squash_log_odds(size, is_clip=True) + sum(float(np.mean(some)) for some in (alone, together) if some)

    def _distances(self, frames: Sequence[PixelTable], size: tuple[int, int], shown: tuple[int, int]) -> Array:
        """Root mean square distance of each label from cameras fitted to all frames together, (T, L).

        The cameras are fitted to frames scaled to the size `shown`. The distances are in pixels of pictures of `size`,
        as the labels are; NaN without a camera or pixels. A size of the field that is told may be off as well: a squash
        would make up for that, so it is estimated here.
        """
        scale = np.divide(shown, size)
        labels = {t: one.scaled(scale) for t, one in enumerate(frames)}
        task, field = self.how.task, self.how.task.field
        if field is not None:
            task = replace(task, object_segments=replace(field, size_known=False))
        how = replace(self.how, task=task, camera="tripod", estimate_size=True)
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


def shape_of_odds(log_odds: float, part: Shape) -> Shape:
    """Shape of frames in a part of their pictures from the log odds that they were squashed.

    Examples
    --------
    >>> whole = Shape(Placement.whole((960, 720)))
    >>> shape_of_odds(5.0, whole).placement.frame_size
    (1280, 720)
    >>> shape_of_odds(-5.0, whole) == whole, shape_of_odds(1.0, whole).findings[0] == SHAPE
    (True, True)
    """
    findings = (SHAPE,) * (abs(log_odds) <= CERTAIN) + (WAS_SQUASHED,) * (log_odds > 0.0)
    return Shape(part.placement.squashed if log_odds > 0.0 else part.placement, (*findings, *part.findings))


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
        if index >= self._next and np.mean(image[::APART, ::APART]) > DARK:
            self._next = index + APART
            self._look(image)
        if self._running is not None and self._running.done():
            self._log_odds, self._running = self._running.result(), None
        part = Shape(within_borders(size_of(image), self._border))
        before = self.shape or Shape(Placement.whole(size_of(image)))
        if self._log_odds is not None:
            found = shape_of_odds(self._log_odds, part)
        else:  # while pictures may be squashed, every camera is doubted
            found = part._replace(findings=(SHAPE,) if self._parts else ())
        self.shape = found or None
        return before.placement != found.placement

    def image_in_frame(self, image: Image) -> Image:
        """Cut the frame out of a picture, and stretch it if pictures were squashed."""
        return image if self.shape is None else self.shape.placement.image_in_frame(image)

    def _look(self, image: Image) -> None:
        if self._estimator.finds_borders:
            self._borders.append(borders_of(image))
            least = np.min(list(self._borders), axis=0)
            grown = np.max(least - self._border) > SAME and len(self._borders) in (1, SEEN)
            if grown or np.max(self._border - least) > SAME:
                self._border = (int(least[0]), int(least[1]))
                self._parts, self._running, self._log_odds = [], None, None
        if not self._estimator.finds_squash or len(self._parts) >= SEEN:
            return
        part = within_borders(size_of(image), self._border).image_in_frame(image)
        if may_be_squashed(size_of(part)):
            self._parts.append(part.copy())  # the caller may use its image again
            is_sure = self._log_odds is not None and abs(self._log_odds) > CERTAIN
            if len(self._parts) in ASKED and self._running is None and not is_sure:
                self._running = self._submit(self._estimator.log_odds, list(self._parts))


class SharedPrincipalPoint(NamedTuple):
    """The principal point that frames of a clip share."""

    off_middle: float
    """Distance from the middle, in standard deviations of whole pictures' principal points and the estimate."""
    log_ratio_of_part: float
    """Log likelihood ratio of a part of a frame to a whole one, without the prior of the estimate."""
    spread: float
    """Standard deviation of the principal points of whole pictures, the larger one of x and y, pixels."""

    @classmethod
    def of(cls, found: SequenceCalibration, how: How, *, is_free: bool = False) -> SharedPrincipalPoint | None:
        """Take the principal point of frames that share one; None if they do not, or have no prior.

        `is_free`: they were solved with the wide prior for parts of pictures (`as_part`).
        """
        if how.task.prior is None or found.layout is None or not {"cx", "cy"} <= set(found.names):
            return None
        size = found.layout.image_size
        of_whole = _sigma(how.task, size)
        prior = _sigma(as_part(how.task, size), size) if is_free else of_whole
        index = [found.names.index(name) for name in ("cx", "cy")]
        offset, V = found.values[index] - np.divide(size, 2.0), found.covariance[np.ix_(index, index)]
        off_middle = float(np.max(np.abs(offset) / np.hypot(of_whole, np.sqrt(np.diagonal(V)))))
        by_lines = without_prior(offset / of_whole, V / np.outer(of_whole, of_whole), prior / of_whole)
        return cls(off_middle, by_lines.log_ratio_of_part, float(np.max(of_whole)))


def without_prior(z: Array, V: Array, prior: Array) -> PrincipalPoint:
    """A principal point by lines alone, from the estimate z (2,) with covariance V under a prior of some deviations.

    Examples
    --------
    >>> middle, anywhere = (without_prior(np.zeros(2), s**2 * np.eye(2), np.ones(2)) for s in (0.16, 0.9995))
    >>> middle.log_ratio_of_part < -3.0, abs(anywhere.log_ratio_of_part) < 0.5
    (True, True)
    """
    of_lines, vectors = np.linalg.eigh(np.linalg.inv(V) - np.diag(1.0 / np.square(prior)))
    covariance = vectors @ np.diag(1.0 / np.maximum(of_lines, FAINT)) @ vectors.T
    return PrincipalPoint(covariance @ np.linalg.solve(V, z), covariance)


def _sigma(task: Task, image_size: tuple[int, int]) -> Array:
    """Standard deviations (2,) of a principal point under the prior of a task, the widest of its stands."""
    assert task.prior is not None
    stands = checked_prior(task.prior, task.field)
    return principal_point_sigma(max(stand.principal_point for stand in stands), image_size)


def off_middle(found: SequenceCalibration, how: How) -> float:
    """Distance of the principal point from the middle, `SharedPrincipalPoint.off_middle`; 0 if frames share none."""
    shared = SharedPrincipalPoint.of(found, how)
    return 0.0 if shared is None else shared.off_middle


def may_be_enlarged(found: SequenceCalibration, how: How, softness: float, *, is_free: bool = False) -> bool:
    """Whether the frames of a tripod look enlarged, and may be parts of larger ones.

    Parameters
    ----------
    softness : float
        Softness of their shot (`softness_of_shot`).
    is_free : bool
        Whether they were solved with a principal point that may lie anywhere.
    """
    if not (how.may_be_enlarged and how.is_on_tripod and softness > 0.0):
        return False
    shared = SharedPrincipalPoint.of(found, how, is_free=is_free)
    if shared is None or found.layout is None or found.field is None or found.field.probability is None:
        return False
    size = found.layout.image_size
    is_usual = is_whole_shape(size) and shared.spread <= LARGEST_SPREAD * size[0]
    return is_usual and shared.log_ratio_of_part + SCORE_OF_SOFTNESS * softness > LEAST_SCORE


def better_of_enlarged(
    whole: SequenceCalibration, freed: SequenceCalibration, how: How, frames: IntArray
) -> tuple[SequenceCalibration, list[str]]:
    """Choose between frames that may be enlarged as solved as whole ones, and with a principal point that is `freed`.

    The latter are taken if the frames are more likely parts than whole, or if most of the accepted cameras are sure
    with such a principal point. Cameras that are not sure get a doubt; returned too are notes for the user on the
    `frames`, their numbers in the video.
    """
    shared = SharedPrincipalPoint.of(freed, how, is_free=True)
    is_sure = np.array([one.accepted and one.probability() >= SURE for one in freed])
    if shared is None or not (shared.log_ratio_of_part > 0.0 or np.mean(is_sure[whole.accepted]) > 0.5):
        return with_doubts(whole, np.flatnonzero(whole.accepted).tolist(), ENLARGED), []
    x, y = (freed.values[freed.names.index(name)] for name in ("cx", "cy"))
    note = (
        f"frames {frames[0]} to {frames[-1]}: the picture may be an enlarged part of a larger one: its principal point "
        f"was found at ({x:.0f}, {y:.0f})"
    )
    return with_doubts(freed, np.flatnonzero(freed.accepted & ~is_sure).tolist(), ENLARGED), [note]
