"""Lines detected in images near projected markings, as labelled pixels with weights, and cameras fitted to them.

A line is usually found in single profiles across its marking (`line_profiles`). Faint lines that a person has labelled
are traced instead. In a small or blurred picture a distant line is narrower than a pixel, and in most profiles across
it the noise is as strong as the line. But the labels show that it is there, a few pixels away at most. So the marking
is displaced by small amounts (both ends of a line independently, an arc along both axes of the image), and the contrast
of all its profiles is summed at each displacement: with n profiles the sum stands out sqrt(n) times more than a single
profile. Edges of boards, with different ground on one side, add nothing. Where one displacement is clearly the best,
the line is taken from every profile that shows contrast close to it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.paint.line_profiles import Markings, Profiles, Strips, find_lines, pixels_of_lines
from fieldcalib.io.image_files import Image, size_of
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.solve.batch import calibrate_pixels
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import paint_sigma, pixel_unit

# Lengths are in pixels of a 960 x 540 image and grow with the image.
SEARCH_RANGES = (12.0, 4.0)  # px from the projected markings, in the first and the second pass
LOSS_SCALE = 2.0  # px: detected lines are more accurate than this; larger residuals are outliers
SIGMAS = 3.0  # half width of the search for a line, in standard deviations of its projected marking

CLICK = 2.0  # px, in smaller images px of the image itself: standard deviation of pixels that a person labels
REACH = 3.0  # largest displacement of a marking, in standard deviations of a label
LEAST_PROFILES = 5  # of a marking
FEW = 0.7  # share of the profiles that show a line, below which the line is traced
FAINTEST, STRONGEST = -1.0, 3.0  # limits of one profile's contrast, in units of the noise: no profile decides alone
LEAST_NOISE = 1.0  # grey values
TO_SIGMA = 1.48  # standard deviation of normal noise in units of its median absolute deviation
# Least sum over a marking divided by the root of the number of profiles. In eleven broadcast frames reduced to 600 px,
# 85 of 90 markings exceed it at their true place, and one exceeds it 3 to 6 px beside it.
LEAST_SIGNAL = 4.0
LEAST_LEAD = 3.0  # by which the best displacement's sum, less the penalty of distant labels, must exceed all others
OTHER = 2.0  # px: displacements that differ by more, in the mean, compete with one another
POSITIONS = 25  # displacements of each end of a line, or along each axis for an arc
NEAR = 0.8  # px, as `CLICK`, between the line in one profile and the displacement that all profiles agree on
SHOWN = 0.5  # contrast, in units of the noise, from which a profile shows the line


def line_loss(image_size: tuple[int, int], scale: float = LOSS_SCALE) -> RobustLoss:
    """Robust loss for lines that are detected in images of a size."""
    return RobustLoss("cauchy", scale * pixel_unit(image_size))


def detected_lines(image: Image, profiles: Profiles, markings: Markings, sigma: float = 0.0) -> PixelTable:
    """Detect lines near the markings that a camera projects.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    profiles : Profiles
        Those of the camera (`profiles_along`).
    markings : Markings
    sigma : float
        Standard deviation of the projected markings, pixels: the less certain the camera, the wider the search.
    """
    search_range = np.clip(SIGMAS * sigma / pixel_unit(size_of(image)), SEARCH_RANGES[1], SEARCH_RANGES[0])
    return pixels_of_lines(markings, profiles, find_lines(image, profiles, float(search_range)))


def with_replaced(labels: PixelTable, others: PixelTable, dropped: Collection[str] = ()) -> PixelTable:
    """Merge labelled pixels of one image: labels that `others` has replace those of the same name or are added.

    Labels that are `dropped` go, whether or not `others` has them.
    """
    names = tuple(dict.fromkeys((*labels.labels, *others.labels)))
    left = set(names).difference(dropped, others.by_label(0))
    both = PixelTable.joined(names, [labels.of_labels(left), others])
    return replace(both, count=1, frame=np.zeros_like(both.frame))


def calibrate_on_lines(
    task: Task,
    lines: Sequence[PixelTable],
    image_size: tuple[int, int],
    cameras: Sequence[Camera] | None = None,
    scale: float = LOSS_SCALE,
) -> list[Calibration]:
    """Calibrate each image from its detected lines, starting from `cameras` or, without them, from anywhere."""
    paint = paint_sigma(task.object_segments)
    task = replace(task, loss=line_loss(image_size, scale), trust_labels=True, paint=paint)
    return calibrate_pixels(task, PixelTable.joined(task.object_segments, lines), image_size, cameras)


def with_traced(strips: Strips, lines: Array, markings: Markings, labelled: Mapping[str, Array]) -> Array:
    """Trace the labelled lines that few profiles show; returns all lines as signed distances (n,), NaN for none.

    Parameters
    ----------
    strips : Strips
        Samples across the markings that a camera projects, a few pixels from the lines.
    lines : (n,) array
        Signed distances of lines from the markings, as single profiles show them (`Strips.lines`).
    markings : Markings
    labelled : mapping of str to (N, 2) array
        Pixels on the lines.
    """
    found = lines.copy()
    for label in labelled.keys() & set(markings.labels):
        k = markings.labels.index(label)
        at = np.flatnonzero(strips.profiles.member == k)
        if len(at) >= LEAST_PROFILES and strips.profiles.on_ground[at[0]] and np.mean(np.isfinite(lines[at])) < FEW:
            line = _traced(strips, at, labelled[label], is_arc=bool(markings.is_arc[k]))
            found[at] = line if np.any(np.isfinite(line)) else lines[at]
    return found


def _traced(strips: Strips, at: IntArray, labels: Array, *, is_arc: bool) -> Array:
    """Trace the line of one marking through its profiles `at`, near labelled pixels (N, 2).

    Returns signed distances (k,) from the marking, NaN where a profile does not show the line, or everywhere if no
    displacement of the marking is clearly the best.
    """
    unit, profiles = max(strips.unit, 1.0), strips.profiles.take(at)
    reach = min(REACH * CLICK * unit, float(np.min(strips.offset[at, -1])))
    grid = np.linspace(-reach, reach, 2 * POSITIONS - 1)
    signal, least = _signal(strips, at, grid)

    # every displacement of the marking is a signed distance in each profile: that of a shifted arc is normal . shift,
    # that of a line with moved ends is linear along it
    t = np.linspace(0.0, 1.0, len(at))
    basis = profiles.normal if is_arc else np.column_stack([1.0 - t, t])
    coefficients = np.stack(np.meshgrid(grid[::2], grid[::2], indexing="ij"), axis=-1).reshape(-1, 2)
    moved = coefficients @ basis.T  # (positions, k)
    moved = moved[np.all(np.abs(moved) <= reach, axis=1)]
    column = np.round((moved + reach) / (grid[1] - grid[0])).astype(int)
    total = np.sum(signal[np.arange(len(at)), column], axis=1)

    # labels are noisy and may belong to another marking, so distance from them is penalised with a heavy tail
    near = np.argmin(np.linalg.norm(labels[:, None] - profiles.xy, axis=-1), axis=1)
    distance = np.sum((labels - profiles.xy[near]) * profiles.normal[near], axis=1)
    if np.all(np.abs(distance) > reach):  # the labels belong to another marking
        return np.full(len(at), np.nan)
    off = (moved[:, near] - distance) / (CLICK * unit)
    likely = total - np.sum(np.log1p(0.5 * np.square(off)), axis=1)
    best = int(np.argmax(likely))
    others = np.mean(np.abs(moved - moved[best]), axis=1) > OTHER * unit
    lead = likely[best] - np.max(likely[others], initial=-np.inf)
    if total[best] < LEAST_SIGNAL * np.sqrt(len(at)) or lead < LEAST_LEAD:
        return np.full(len(at), np.nan)
    return strips.peaks_near(at, moved[best], NEAR * unit, least)


def _signal(strips: Strips, at: IntArray, grid: Array) -> tuple[Array, Array]:
    """Contrast (k, m) at distances `grid` (m,) from a marking, in units of its noise, and the least of a line, (k,).

    The least contrast of a line is in grey values.
    """
    sampled = zip(strips.offset[at], strips.contrast[at], strips.may_be_line[at].astype(float), strict=True)
    contrast, alike = np.swapaxes([[np.interp(grid, x, y) for y in both] for x, *both in sampled], 0, 1)
    middle = np.median(contrast, axis=1)
    noise = max(TO_SIGMA * float(np.median(np.abs(contrast - middle[:, None]))), LEAST_NOISE)
    may_be_line = (alike > 0.5) & (np.abs(grid) <= strips.profiles.room[at, None])
    signal = np.clip((contrast - middle[:, None]) / noise, FAINTEST, np.where(may_be_line, STRONGEST, 0.0))
    return signal, middle + SHOWN * noise
