"""The pattern that interpolation leaves in pictures that were enlarged.

Interpolated pixels are smoother than others, the more the farther they lie from those of the original. So the size of
the second differences along rows varies with the column, with the period at which pixels of both pictures coincide:
enlarging s times gives a line at the frequency 1 / s in the spectrum of its mean over rows, and the same along columns.
(Gallagher, Detection of Linear and Cubic Interpolation in JPEG Compressed Images, 2005.) Several frames that were
enlarged alike are averaged, which makes the line stand out. Blocks of codecs give lines at multiples of 1/16 of the
sampling frequency too; there only a line at 1/4 (enlarged 4/3 times) counts, if it is much stronger than those at 1/8
and 3/8. A picture that was enlarged twice has no such line: it is symmetric in all of its pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, Float32
from fieldcalib.images.line_profiles import LUMA
from fieldcalib.io.image import Image

MOST = 8.0  # levels: larger second differences count as this, so that edges do not decide
SMOOTH = 15  # px: means over these are taken off, as the pattern is finer
SHORTEST = 128  # px: shorter sides tell nothing
SPECTRUM = 4096  # number of samples, zeros added
FLOOR = 161  # frequencies, 0.04 of the sampling frequency, whose median is the level of noise
WIDTH = 4  # frequencies to both sides: the line is as wide as the picture is short
LOWEST = 0.06  # in units of the sampling frequency
BLOCK, NEAR_BLOCK = 16, 0.006  # px: codecs work on blocks of 16, 8 and 4; distance from their frequencies
# Of ten broadcasts and 24 synthetic clips, all whole, the line is at most 11 times as strong as the noise, and 9 times
# as strong at 1/4 as at 1/8 and 3/8; of 23 clips enlarged 4/3 to 5/3 times at least 130 and 200 times.
STRONG = 40.0


@dataclass(frozen=True, eq=False)
class SecondDifferences:
    """Mean size of the second differences of brightness in a picture."""

    of_columns: Float32
    """Along rows, for each column but the first and the last."""
    of_rows: Float32
    """Along columns, for each row but the first and the last."""

    @classmethod
    def of(cls, image: Image) -> SecondDifferences:
        """The second differences of a picture."""
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
    """Power of the pattern at each frequency, relative to the noise at those around it; the largest nearby counts."""
    box = np.ones(SMOOTH) / SMOOTH
    pattern = (means - np.convolve(np.pad(means, SMOOTH // 2, mode="edge"), box, "valid"))[SMOOTH:-SMOOTH]
    power = np.square(np.abs(np.fft.rfft(pattern * np.hanning(len(pattern)), SPECTRUM)))
    noise = np.median(_around(power, FLOOR // 2), axis=1)
    relative = power / np.maximum(noise, np.finfo(np.float32).tiny)
    return np.asarray(np.max(_around(relative, WIDTH), axis=1))


def _around(values: Array, reach: int) -> Array:
    """Each value with those around it, (n, 2 reach + 1)."""
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, reach, mode="reflect"), 2 * reach + 1)
