"""Detection of clips that are, or may be, enlarged parts of larger pictures (digital zoom).

The frames of a tripod share their principal point. If their lines put it far from the middle, a shot is solved with a
free principal point from the beginning (`CUT_OUT` of `clip_models`). If they put it near the middle, the frames are
whole. In short shots with few lines they determine neither: the cameras are then right if the frames are whole, and may
be wrong by metres if not, although all lines fit.

Two kinds of evidence count together. One is the log likelihood ratio of a part to a whole frame from the principal
point (`PrincipalPointEvidence`): -3 to -4.5 if lines show that it is near the middle, about 0 if they do not determine
it. The other is whether the keyframes were enlarged, which shows in little fine detail
(`fieldcalib.images.shape.enlarged`) or in the pattern of interpolation. Frames that may be enlarged are solved once
more, with a principal point that may lie anywhere. The errors of these cameras include those of the principal point.
They are taken if a part is more likely, or if they are sure; if they are not sure, the user is told to check them.

Interpolation leaves a pattern in pictures that were enlarged: interpolated pixels are smoother than others, and more so
the farther they lie from pixels of the original. So the size of the second differences along rows varies with the
column, with the period at which pixels of both pictures coincide. Enlarging s times gives a line at the frequency 1 / s
in the spectrum of its mean over rows, and the same along columns (Gallagher, Detection of Linear and Cubic
Interpolation in JPEG Compressed Images, 2005). Averaging several frames that were enlarged alike makes the line stand
out. Blocks of codecs also give lines, at multiples of 1/16 of the sampling frequency; there only a line at 1/4
(enlarged 4/3 times) counts, if it is much stronger than those at 1/8 and 3/8. A picture that was enlarged exactly twice
has no such line, as all of its pixels are equally far from those of the original.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, Float32, IntArray
from fieldcalib.assess.cropping_evidence import ENLARGED, FAINT, LARGEST_SPREAD, SURE, PrincipalPointEvidence
from fieldcalib.assess.sequence_calibration import SequenceCalibration, with_doubts
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.from_images import How
from fieldcalib.images.paint.line_profiles import LUMA
from fieldcalib.images.shape.enlarged import LARGEST_SOFTNESS, SCORE_OF_SOFTNESS, softness, window_prior
from fieldcalib.io.image import Image
from fieldcalib.problem.prior import is_whole_shape, principal_point_sigma
from fieldcalib.solve.solver_options import Prior, checked_prior

# Distance of a principal point from the middle in standard deviations: beyond the first it is freed, beyond the second
# the picture is not a whole one. Measured broadcast cameras are up to 1.75 off.
MAY_BE_OFF = 2.0
OFF_MIDDLE = 2.8
# Score of log likelihood ratio and softness together above which frames may be enlarged: soft whole shots of broadcasts
# with good cameras have up to 1.6, enlarged shots whose cameras pass as good but are over 1 m off at least 3.2.
LEAST_SCORE = 2.9

MOST = 8.0  # levels: larger second differences count as this, so that edges do not decide
SMOOTH = 15  # px over which the mean is subtracted, as the pattern is finer
SHORTEST = 128  # px: shorter sides do not show the pattern
SPECTRUM = 4096  # number of samples after padding with zeros
FLOOR = 161  # frequencies, 0.04 of the sampling frequency, whose median is the level of noise
WIDTH = 4  # frequencies to both sides: the line is as wide as the picture is short
LOWEST = 0.06  # lowest frequency that is considered, in units of the sampling frequency
BLOCK, NEAR_BLOCK = 16, 0.006  # px: codecs work on blocks of 16, 8 and 4; distance from their frequencies
# Of ten broadcasts and 24 synthetic clips, all whole, the line is at most 11 times as strong as the noise, and 9 times
# as strong at 1/4 as at 1/8 and 3/8; of 23 clips enlarged 4/3 to 5/3 times at least 130 and 200 times.
STRONG = 40.0


class Detail(NamedTuple):
    """Evidence in a keyframe that it was enlarged."""

    softness: float
    """Lack of fine detail (`fieldcalib.images.shape.enlarged.softness`)."""
    differences: SecondDifferences

    @classmethod
    def of(cls, image: Image) -> Detail:
        """Measure a keyframe."""
        return cls(softness(image), SecondDifferences.of(image))


def softness_of_shot(keyframes: Sequence[Detail]) -> float:
    """Softness of a shot, from 0 to 0.9: the median over its keyframes, or 0.9 if they are interpolated."""
    if are_interpolated([one.differences for one in keyframes]):
        return LARGEST_SOFTNESS
    return float(np.median([one.softness for one in keyframes])) if keyframes else 0.0


@dataclass(frozen=True, eq=False)
class SharedPrincipalPoint:
    """The principal point that frames of a clip share."""

    offset: Array
    """Offset (2,) from the middle of the picture, pixels."""
    covariance: Array
    """Covariance of the offset, (2, 2)."""
    prior: Array
    """Standard deviations (2,) of the prior under which it was estimated."""
    of_whole: Array
    """Standard deviations (2,) of the principal points of whole pictures."""

    @classmethod
    def of(cls, found: SequenceCalibration, how: How, *, is_free: bool = False) -> SharedPrincipalPoint | None:
        """Take the principal point of frames that share one; None if they do not, or have no prior.

        `is_free`: they were solved with the wide prior for parts of pictures
        (`fieldcalib.images.shape.enlarged.window_prior`).
        """
        if how.task.prior is None or found.layout is None or not {"cx", "cy"} <= set(found.names):
            return None
        size, objects = found.layout.image_size, how.task.object_segments
        of_whole = _sigma(how.task.prior, objects, size)
        prior = _sigma(window_prior(how.task.prior, objects, size), objects, size) if is_free else of_whole
        index = [found.names.index(name) for name in ("cx", "cy")]
        offset = found.values[index] - np.divide(size, 2.0)
        return cls(offset, found.covariance[np.ix_(index, index)], prior, of_whole)

    @property
    def off_middle(self) -> float:
        """Distance from the middle, in standard deviations of whole pictures' principal points and the estimate."""
        return float(np.max(np.abs(self.offset) / np.hypot(self.of_whole, np.sqrt(np.diagonal(self.covariance)))))

    @property
    def log_ratio_of_part(self) -> float:
        """Log likelihood ratio of a part of a frame to a whole one, without the prior of the estimate.

        Examples
        --------
        >>> middle, anywhere = (
        ...     SharedPrincipalPoint(np.zeros(2), sigma**2 * np.eye(2), np.full(2, 19.2), np.full(2, 19.2))
        ...     for sigma in (3.0, 19.19)
        ... )
        >>> middle.log_ratio_of_part < -3.0, abs(anywhere.log_ratio_of_part) < 0.5
        (True, True)
        """
        z, V = self.offset / self.of_whole, self.covariance / np.outer(self.of_whole, self.of_whole)
        of_lines, vectors = np.linalg.eigh(np.linalg.inv(V) - np.diag(np.square(self.of_whole / self.prior)))
        covariance = vectors @ np.diag(1.0 / np.maximum(of_lines, FAINT)) @ vectors.T
        return PrincipalPointEvidence(covariance @ np.linalg.solve(V, z), covariance).log_ratio_of_part


def _sigma(prior: Prior, object_segments: ObjectSegments, image_size: tuple[int, int]) -> Array:
    """Standard deviations (2,) of a principal point under a prior, the widest of its stands."""
    assert prior is not None
    stands = checked_prior(prior, object_segments if isinstance(object_segments, Field) else None)
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
    is_usual = is_whole_shape(size) and np.max(shared.of_whole) <= LARGEST_SPREAD * size[0]
    return bool(is_usual and shared.log_ratio_of_part + SCORE_OF_SOFTNESS * softness > LEAST_SCORE)


def is_better_free(whole: SequenceCalibration, freed: SequenceCalibration, how: How) -> bool:
    """Whether frames that may be enlarged have better cameras with a principal point that may lie anywhere.

    They have if the frames are more likely parts than whole, or if most of the accepted cameras are sure with such a
    principal point.

    Parameters
    ----------
    whole, freed : SequenceCalibration
        The frames solved as whole ones, and with such a principal point.
    """
    shared = SharedPrincipalPoint.of(freed, how, is_free=True)
    if shared is None:
        return False
    return shared.log_ratio_of_part > 0.0 or bool(np.mean(_is_sure(freed)[whole.accepted]) > 0.5)


def with_doubts_of_all(whole: SequenceCalibration) -> SequenceCalibration:
    """Add the doubt that they are enlarged parts to all accepted frames that were solved as whole ones."""
    return with_doubts(whole, np.flatnonzero(whole.accepted).tolist(), ENLARGED)


def with_doubts_of_part(freed: SequenceCalibration) -> SequenceCalibration:
    """Add doubts to the accepted frames with a free principal point that are not sure."""
    return with_doubts(freed, np.flatnonzero(freed.accepted & ~_is_sure(freed)).tolist(), ENLARGED)


def _is_sure(freed: SequenceCalibration) -> BoolArray:
    return np.array([one.accepted and one.probability(level=True) >= SURE for one in freed])


def enlarged_note(frames: IntArray, found: SequenceCalibration) -> str:
    """Note for the user on frames that may be enlarged, and were solved with a free principal point."""
    x, y = (found.values[found.names.index(name)] for name in ("cx", "cy"))
    return (
        f"frames {frames[0]} to {frames[-1]}: the picture may be an enlarged part of a larger one: its principal point "
        f"was found at ({x:.0f}, {y:.0f})"
    )


@dataclass(frozen=True, eq=False)
class SecondDifferences:
    """Mean absolute second differences of brightness in a picture."""

    of_columns: Float32
    """Differences along rows, for each column but the first and the last."""
    of_rows: Float32
    """Differences along columns, for each row but the first and the last."""

    @classmethod
    def of(cls, image: Image) -> SecondDifferences:
        """Compute the second differences of a picture."""
        brightness = image @ LUMA
        return cls(_means(brightness), _means(brightness.T))


def _means(brightness: Float32) -> Float32:
    differences = np.abs(brightness[:, 2:] - 2.0 * brightness[:, 1:-1] + brightness[:, :-2])
    return np.asarray(np.minimum(differences, MOST).mean(axis=0), dtype=np.float32)


def are_interpolated(pictures: Sequence[SecondDifferences]) -> bool:
    """Whether pictures of one size were all enlarged in the same way, in both directions.

    Examples
    --------
    >>> import cv2
    >>> noise = np.random.default_rng(0).integers(0, 255, (405, 720, 3), dtype=np.uint8)
    >>> frame = cv2.GaussianBlur(noise, (0, 0), 1.0)
    >>> enlarged = cv2.resize(frame, (960, 540), interpolation=cv2.INTER_LINEAR)
    >>> [are_interpolated([SecondDifferences.of(one)]) for one in (frame, enlarged)]
    [False, True]
    """
    if not pictures:
        return False
    means = [np.mean([getattr(one, name) for one in pictures], axis=0) for name in ("of_columns", "of_rows")]
    if min(map(len, means)) < SHORTEST:
        return False
    strength = np.minimum(*map(_strength, means))
    off_blocks = _frequencies() > LOWEST
    off_blocks &= np.abs(_frequencies() - np.round(BLOCK * _frequencies()) / BLOCK) > NEAR_BLOCK
    eighth, quarter, three = (strength[k * SPECTRUM // 8] for k in (1, 2, 3))
    return bool(np.max(strength[off_blocks]) > STRONG or quarter > STRONG * max(eighth, three, 1.0))


def _frequencies() -> Array:
    return np.asarray(np.fft.rfftfreq(SPECTRUM), dtype=np.float64)


def _strength(means: Array) -> Array:
    """Power of the pattern at each frequency, relative to the noise around it; the maximum over `WIDTH` neighbours."""
    box = np.ones(SMOOTH) / SMOOTH
    pattern = (means - np.convolve(np.pad(means, SMOOTH // 2, mode="edge"), box, "valid"))[SMOOTH:-SMOOTH]
    power = np.square(np.abs(np.fft.rfft(pattern * np.hanning(len(pattern)), SPECTRUM)))
    noise = np.median(_around(power, FLOOR // 2), axis=1)
    relative = power / np.maximum(noise, np.finfo(np.float32).tiny)
    return np.asarray(np.max(_around(relative, WIDTH), axis=1))


def _around(values: Array, reach: int) -> Array:
    """Windows of each value with its neighbours, (n, 2 reach + 1)."""
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, reach, mode="reflect"), 2 * reach + 1)
