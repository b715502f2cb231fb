"""The shape of the frames of a clip, seen in some of them: black borders, and whether they were squashed from 16:9.

Borders are what all frames that are looked at have in common. Frames of another shape than 16:9 are calibrated as they
are and as they would be shown, in both ways as frames of one camera, whose place and lens cannot follow what each of
them has wrong. The lines of the better way lie nearer to their markings: with u and v the distances of the lines of one
label in one frame, squarely as the picture's own pixels have them, the log odds that frames were squashed are

    1/2 sum log(u / v)  +  the mean over frames of what each by itself says (`fieldcalib.images.pictures`)

over all labels of all frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from fieldcalib.assess.misfit import rms_by_label
from fieldcalib.assess.placement import Crop, Placement, Shape
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.whole_picture import SHAPE
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.borders import shown_part
from fieldcalib.images.frame_lines import as_given, per_pixel
from fieldcalib.images.frames_together import problem_of_lines
from fieldcalib.images.from_images import calibrate_frames_alone
from fieldcalib.images.pictures import as_shown, log_ratio_of_squash
from fieldcalib.images.refinement import LOSS_SCALE
from fieldcalib.io.image import Image, each_checked
from fieldcalib.localize import Network
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.solve.aspect import SQUARE_LOG_ODDS, WAS_SQUASHED, may_be_squashed, shown_size, stretched
from fieldcalib.solve.given_camera import NOTHING_GIVEN, GivenCamera
from fieldcalib.solve.joint_problem import labels_of
from fieldcalib.solve.options import CERTAIN, Prior
from fieldcalib.solve.sequence_problem import SHARED
from fieldcalib.solve.sequence_solver import solve_sequence
from fieldcalib.solve.tripod import Labels

SEEN, APART = 8, 12  # frames that are looked at, and how far they are from one another
FURTHEST = 3000  # frames, two minutes, among which they are
DARK = 10.0  # mean brightness: of a frame that shows nothing
# Half a second apart, frames share part of their errors. Of 45 squashed stretches of nine clips 34 are told with this
# weight, of 89 parts 53, and none is taken for the other; with twice as much some parts nearly are.
WEIGHT = 0.5  # of the labels of a frame
UPRIGHT_LOG_ODDS = -3.0  # what is higher than it is wide was cut out for telephones: prior log odds of a squashed one
NEAR = 0.05  # px: of lines nearer than that the distance is chance


@dataclass(frozen=True, eq=False)
class LookedAt:
    """What is known, and asked, of the pictures of a clip."""

    object_segments: ObjectSegments
    network: Network
    flags: int
    prior: Prior
    given: GivenCamera = NOTHING_GIVEN
    take_off_borders: bool = True
    estimate_aspect: bool = True

    def shape(self, images: Iterable[Image]) -> Shape | None:
        """That of the frames of a clip; None if they are as they seem."""
        if not (self.take_off_borders or self.estimate_aspect):
            return None
        some = some_of(images)
        placement = between_borders(some) if self.take_off_borders else None
        if self.estimate_aspect and some:
            size = _size(some[0])
            parts = [_part(image, placement) for image in some]
            if may_be_squashed(_size(parts[0])):
                return shape_of_odds(self.log_odds(parts), placement or Placement(size, size, None), _size(parts[0]))
        return None if placement is None else shape_within(placement)

    def log_odds(self, images: Sequence[Image]) -> float:
        """Log odds that frames of another shape than 16:9 were squashed from it."""
        size, shown = _size(images[0]), shown_size(_size(images[0]))
        both = self._each(images), self._each([as_shown(image) for image in images])
        alone = [
            log_ratio_of_squash(self.object_segments, one, other, flags=self.flags, prior=self.prior)
            for one, other in zip(*both, strict=True)
            if one.accepted or other.accepted
        ]
        together = []
        for found in both:
            frames = [_labels(one, size) for one in found if one.accepted and one.solved is not None]
            if len(frames) > 1:
                distances = [self._distances(frames, size, to) for to in (size, shown)]
                together.append(_log_ratio(*distances))
        log_odds = SQUARE_LOG_ODDS * (size[0] == size[1]) + UPRIGHT_LOG_ODDS * (size[0] < size[1])
        return log_odds + sum(float(np.mean(some)) for some in (alone, together) if some)

    def _each(self, images: Sequence[Image]) -> list[Calibration]:
        return calibrate_frames_alone(
            self.object_segments, images, self.network, flags=self.flags, prior=self.prior, given=self.given
        )

    def _distances(
        self, frames: Sequence[Labels], size: tuple[int, int], shown: tuple[int, int]
    ) -> dict[tuple[int, str], float]:
        """How far the lines of each label of each frame lie off in pictures that are shown at a size, together; px."""
        scale = np.divide(shown, size)
        labels = {t: (stretched(pixels, scale), weights) for t, (pixels, weights) in enumerate(frames)}
        problem = problem_of_lines(
            self.object_segments,
            range(len(frames)),
            labels,
            {},
            shown,
            flags=self.flags,
            prior=self.prior,
            shared=SHARED,
            given=self.given,
        )
        return distances_in_pictures(self.object_segments, solve_sequence(problem).calibration, frames, size)


def some_of(images: Iterable[Image]) -> list[Image]:
    """Some of the first frames that show something."""
    bright = (image for image in each_checked(islice(images, 0, FURTHEST, APART)) if np.mean(image) > DARK)
    return list(islice(bright, SEEN))


def between_borders(images: Sequence[Image]) -> Placement | None:
    """Where the frames lie between the black borders that all of some pictures have; None if they have none.

    Examples
    --------
    >>> picture = np.zeros((720, 960, 3), np.uint8)
    >>> picture[90:630] = 100
    >>> between_borders([picture, picture]).frame_size
    (960, 540)
    >>> between_borders([picture, picture + 50]) is None
    True
    """
    if not images:
        return None
    x, y = np.min([shown_part(image).corner for image in images], axis=0).tolist()
    return placement_within(_size(images[0]), (x, y))


def placement_within(size: tuple[int, int], corner: tuple[int, int]) -> Placement | None:
    """Of frames that begin at a corner of pictures, with as much of these left out on the other sides; None at (0, 0).

    Examples
    --------
    >>> placement_within((960, 720), (0, 90)).crop
    Crop(frame_size=(960, 540), corner=(0, -90))
    """
    (width, height), (x, y) = size, corner
    return Placement(size, size, Crop((width - 2 * x, height - 2 * y), (-x, -y))) if x or y else None


def shape_within(placement: Placement) -> Shape:
    """That of frames between borders, in words."""
    (width, height), (x, y) = placement.frame_size, placement.corner
    return Shape(placement, f"without black borders: {width} x {height} at {-x}, {-y}")


def shape_of_odds(log_odds: float, placement: Placement, size: tuple[int, int]) -> Shape | None:
    """That of frames of a size within pictures, from the odds that they were squashed.

    Examples
    --------
    >>> whole = Placement((960, 720), (960, 720), None)
    >>> shape_of_odds(5.0, whole, (960, 720)).placement.frame_size
    (1280, 720)
    >>> shape_of_odds(-5.0, whole, (960, 720)) is None, shape_of_odds(1.0, whole, (960, 720)).complaints == (SHAPE,)
    (True, True)
    """
    doubt = () if abs(log_odds) > CERTAIN else (SHAPE,)
    said = "" if placement.is_whole else shape_within(placement).message
    if log_odds > 0.0:
        shown = shown_size(size)
        scale = np.divide(shown, size)
        whole = np.rint(scale * placement.size).astype(int).tolist()
        x, y = np.rint(scale * placement.corner).astype(int).tolist()
        part = None if placement.crop is None else Crop(shown, (x, y))
        placement = Placement(placement.size, (whole[0], whole[1]), part)
        said = "; ".join(filter(None, (said, WAS_SQUASHED)))
    elif not doubt and placement.is_whole:
        return None
    return Shape(placement, said, doubt)


def distances_in_pictures(
    object_segments: ObjectSegments,
    calibration: SequenceCalibration,
    frames: Sequence[Labels],
    size: tuple[int, int],
) -> dict[tuple[int, str], float]:
    """Root mean square distance of each label of each frame that has a camera, in the pictures' own pixels.

    Parameters
    ----------
    calibration : SequenceCalibration
        Of the frames as shown.
    frames : sequence of Labels
        In pixels of the pictures.
    size : (int, int)
        Of the pictures.
    """
    segments = object_segments if calibration.field is None else calibration.field
    names, found = list(segments), {}
    for t, labels in enumerate(frames):
        camera = calibration[t].camera
        if camera is None:
            continue
        camera = camera.scaled(size)
        layout, (pixels, weights) = Layout.of(size, camera.lens), per_pixel(labels)
        problem = Problem(pack(segments, [pixels], size, [weights]), layout, RobustLoss("cauchy", LOSS_SCALE))
        rms = rms_by_label(evaluate(problem, layout.theta(camera)[None]))[0]
        found.update({(t, names[k]): float(rms[k]) for k in np.flatnonzero(np.isfinite(rms)).tolist()})
    return found


def _log_ratio(as_it_is: Mapping[tuple[int, str], float], shown: Mapping[tuple[int, str], float]) -> float:
    """Log odds that frames were squashed, from the distances of their lines as they are and as shown."""
    both = sorted(as_it_is.keys() & shown.keys())
    u, v = (np.hypot([some[key] for key in both], NEAR) for some in (as_it_is, shown))
    return float(WEIGHT * np.sum(np.log(u / v)))


def _labels(calibration: Calibration, size: tuple[int, int]) -> Labels:
    """The lines that a camera was fitted to, in pixels of pictures of a size."""
    assert calibration.camera is not None
    assert calibration.solved is not None
    pixels, weights = as_given(labels_of(calibration.solved.alone.evaluation))
    return stretched(pixels, np.divide(size, calibration.camera.image_size)), weights


def _part(image: Image, placement: Placement | None) -> Image:
    return image if placement is None else placement.image_in_frame(image)


def _size(image: Image) -> tuple[int, int]:
    return image.shape[1], image.shape[0]
