"""Evidence in pixels that pictures are enlarged: parts of frames (digital zoom), or frames of another size.

An enlarged picture has less detail than its size allows, as enlarging makes no fine detail (`softness`). Whole frames
may be as soft, if they are out of focus.

Interpolation leaves a pattern in enlarged pictures (`are_interpolated`): interpolated pixels are smoother than others,
and more so the farther they lie from pixels of the original. So the size of the second differences along rows varies
with the column, with the period at which pixels of both pictures coincide. Enlarging s times gives a line at the
frequency 1 / s in the spectrum of its mean over rows, and the same along columns (Gallagher, Detection of Linear and
Cubic Interpolation in JPEG Compressed Images, 2005). Averaging several frames that were enlarged alike makes the line
stand out. Blocks of codecs also give lines, at multiples of 1/16 of the sampling frequency; there only a line at 1/4
(enlarged 4/3 times) counts, if it is much stronger than those at 1/8 and 3/8. A picture that was enlarged exactly twice
has no such line, as all of its pixels are equally far from those of the original.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, Float32
from fieldcalib.images.paint.line_profiles import LUMA
from fieldcalib.io.image_files import Image

PIECE, EVERY = 64, 4  # px: length of the pieces whose spectrum is taken; one row and one column in four is used
COARSE, FINE = slice(4, 9), slice(17, 24)  # bands of the spectrum, of 32 up to Nyquist's frequency
MOST_STRUCTURE = 0.95  # quantile of the power in the coarse band: edges above it tell how much detail there is
FAINT = 0.5  # power, levels squared, added to keep the logarithm finite
# Softness grows from 0 at a log ratio of SHARP downwards. Of 199 broadcast pictures with a good camera 85 % have more
# detail than -4.7, of enlarged parts of them 4 %.
SHARP, LARGEST_SOFTNESS = -4.2, 0.9
SOFTEST = -6.9  # few enlarged parts have less; pictures of 256 x 256 stretched to 1280 x 720 have -6.3 to -8.1

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


def softness(image: Image) -> float:
    """Lack of fine detail in a picture compared with usual ones, from 0 for sharp pictures to 0.9.

    It is 0 again for pictures softer than enlarged parts of frames: these are small pictures enlarged as a whole.

    Examples
    --------
    >>> import cv2
    >>> noise = np.random.default_rng(0).integers(0, 255, (540, 960, 3), dtype=np.uint8)
    >>> frame = cv2.GaussianBlur(noise, (0, 0), 0.7)
    >>> softness(frame), softness(cv2.resize(frame[:270, :480], (960, 540)))
    (0.0, 0.9)
    """
    return _softness(image[::EVERY] @ LUMA, image[:, ::EVERY] @ LUMA)


def _softness(rows: Float32, columns: Float32) -> float:
    """Softness by the brightness of some rows and of some columns.

    It follows from the log ratio of the power of fine and of coarse detail at the edges. Pictures that were squashed or
    interlaced are soft in one direction, enlarged ones in both; the larger ratio counts.
    """
    found = max(map(_detail_along_rows, (rows, columns.T)))
    return 0.0 if found < SOFTEST else float(np.clip(SHARP - found, 0.0, LARGEST_SOFTNESS))


def _detail_along_rows(brightness: Float32) -> float:
    width = brightness.shape[1] // PIECE * PIECE
    pieces = brightness[:, :width].reshape(-1, PIECE)
    if not len(pieces):
        return 0.0
    window = np.hanning(PIECE).astype(np.float32)
    power = np.square(np.abs(np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window, axis=1)))
    coarse, fine = (np.mean(power[:, band], axis=1) for band in (COARSE, FINE))
    edges = coarse >= np.quantile(coarse, MOST_STRUCTURE)
    return float(np.median(np.log((fine[edges] + FAINT) / (coarse[edges] + FAINT))))


class Detail(NamedTuple):
    """Evidence in a keyframe that it was enlarged."""

    softness: float
    """Lack of fine detail (`softness`)."""
    of_columns: Float32
    """Mean absolute second differences of brightness along rows, for each column but the first and the last."""
    of_rows: Float32
    """The same along columns, for each row but the first and the last."""

    @classmethod
    def of(cls, image: Image) -> Detail:
        """Measure a keyframe."""
        brightness = image @ LUMA
        soft = _softness(brightness[::EVERY], brightness[:, ::EVERY])
        return cls(soft, _second_differences(brightness), _second_differences(brightness.T))


def _second_differences(brightness: Float32) -> Float32:
    differences = brightness[:, 2:] + brightness[:, :-2]
    differences -= 2.0 * brightness[:, 1:-1]
    np.minimum(np.abs(differences, out=differences), MOST, out=differences)
    return np.asarray(differences.mean(axis=0), dtype=np.float32)


def softness_of_shot(keyframes: Sequence[Detail]) -> float:
    """Softness of a shot, from 0 to 0.9: the median over its keyframes, or 0.9 if they are interpolated."""
    if are_interpolated(keyframes):
        return LARGEST_SOFTNESS
    return float(np.median([one.softness for one in keyframes])) if keyframes else 0.0


def are_interpolated(pictures: Sequence[Detail]) -> bool:
    """Whether pictures of one size were all enlarged in the same way, in both directions.

    Examples
    --------
    >>> import cv2
    >>> noise = np.random.default_rng(0).integers(0, 255, (405, 720, 3), dtype=np.uint8)
    >>> frame = cv2.GaussianBlur(noise, (0, 0), 1.0)
    >>> enlarged = cv2.resize(frame, (960, 540), interpolation=cv2.INTER_LINEAR)
    >>> [are_interpolated([Detail.of(one)]) for one in (frame, enlarged)]
    [False, True]
    """
    if not pictures:
        return False
    means = [np.mean(some, axis=0) for some in zip(*((one.of_columns, one.of_rows) for one in pictures), strict=True)]
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
