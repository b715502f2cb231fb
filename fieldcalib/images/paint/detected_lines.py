"""Lines detected in images near projected markings, as labelled pixels with weights, and cameras fitted to them.

Faint lines near labelled pixels: contrast summed along a whole marking locates a line that no single profile shows.

In a small or blurred picture a distant line is narrower than a pixel, and in most profiles across it noise is as
strong. But a person has labelled it, so it is there, a few pixels at most from the labels. A marking is moved by small
amounts, at both ends of a line and along both axes for an arc, and the contrast of all its profiles is added up: with n
profiles the sum stands out sqrt(n) times more than one of them. Edges of boards, with other ground on one side, add
nothing. Where one position is clearly the best, the line is taken from each profile that shows contrast close to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.paint.field_markings import Markings
from fieldcalib.images.paint.line_profiles import Strips, find_lines, pixels_of_lines, profiles_along
from fieldcalib.io.image import Image
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.batch import calibrate_pixels
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import paint_sigma, pixel_unit

# Lengths are in pixels of a 960 x 540 image and grow with the image.
SEARCH_RANGES = (12.0, 4.0)  # px from the projected markings, in the first and the second pass
LOSS_SCALE = 2.0  # px: detected lines are more accurate than that, others are outliers
SIGMAS = 3.0  # half width of the search for a line, in standard deviations of its projected marking

CLICK = 2.0  # px, of an image of 960 x 540 if the image is larger: standard deviation of labels that a person sets
REACH = 3.0  # standard deviations of a label from its marking, at most
LEAST_PROFILES = 5  # of a marking
FEW = 0.7  # share of the profiles with a line, below which it is traced
FAINTEST, STRONGEST = -1.0, 3.0  # contrast that one profile contributes, in units of the noise: none decides alone
LEAST_NOISE = 1.0  # grey values
TO_SIGMA = 1.48  # standard deviation of normal noise in units of its median absolute deviation
# Sum over a marking divided by the root of the number of profiles. In eleven broadcast frames reduced to 600 px, 85 of
# 90 markings have more where they are, and one has more 3 to 6 px beside it.
LEAST_SIGNAL = 4.0
LEAST_LEAD = 3.0  # by which the sum, less half the squared distances of the labels, exceeds that of other positions
OTHER = 2.0  # px: positions that far apart, in the mean, are other ones
POSITIONS = 25  # of each end of a line, or along each axis for an arc
NEAR = 0.8  # px of such an image between a line in one profile and the position by all
SHOWN = 0.5  # contrast, in units of the noise, from which a profile shows the line


def line_loss(image_size: tuple[int, int], scale: float = LOSS_SCALE) -> RobustLoss:
    """The loss of lines that are detected in images of a size."""
    return RobustLoss("cauchy", scale * pixel_unit(image_size))


def detected_lines(image: Image, camera: Camera, markings: Markings, sigma: float = 0.0) -> tuple[PixelTable, int]:
    """The lines near the markings that a camera projects, and the number of profiles in which they were searched.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    camera : Camera
    markings : Markings
    sigma : float
        Standard deviation of the projected markings, pixels: the worse the camera is known, the wider is the search.
    """
    search_range = np.clip(SIGMAS * sigma / pixel_unit(camera.image_size), SEARCH_RANGES[1], SEARCH_RANGES[0])
    profiles = profiles_along(camera, markings)
    return pixels_of_lines(markings, profiles, find_lines(image, profiles, float(search_range))), len(profiles)


def with_replaced(labels: PixelTable, others: PixelTable) -> PixelTable:
    """The labelled pixels of one image, with those of some labels replaced by `others` or added."""
    names = tuple(dict.fromkeys((*labels.labels, *others.labels)))
    labels, others = labels.numbered(names), others.numbered(names)
    both = PixelTable.joined(names, [labels.take(~np.isin(labels.label, others.label)), others])
    return replace(both, count=1, frame=np.zeros_like(both.frame))


def calibrate_on_lines(
    task: Task,
    lines: Sequence[PixelTable],
    image_size: tuple[int, int],
    cameras: Sequence[Camera] | None = None,
    scale: float = LOSS_SCALE,
) -> list[Calibration]:
    """Calibrations from the lines of each image, from cameras near them or from anywhere."""
    paint = paint_sigma(task.object_segments)
    task = replace(task, loss=line_loss(image_size, scale), trust_labels=True, paint=paint)
    return calibrate_pixels(task, PixelTable.joined(task.object_segments, lines), image_size, cameras)


def with_traced(strips: Strips, lines: Array, markings: Markings, labelled: Mapping[str, Array]) -> Array:
    """The lines (n,), with labelled lines traced that few of their profiles show; signed distances, NaN for none.

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
    """The line (k,) in the profiles `at` of a marking whose labels are pixels (N, 2); NaN if it is not clear."""
    unit, profiles = max(strips.unit, 1.0), strips.profiles.take(at)
    reach = min(REACH * CLICK * unit, float(np.min(strips.offset[at, -1])))
    grid = np.linspace(-reach, reach, 2 * POSITIONS - 1)
    signal, least = _signal(strips, at, grid)

    t = np.linspace(0.0, 1.0, len(at))
    basis = profiles.normal if is_arc else np.column_stack([1.0 - t, t])
    coefficients = np.stack(np.meshgrid(grid[::2], grid[::2], indexing="ij"), axis=-1).reshape(-1, 2)
    moved = coefficients @ basis.T  # (positions, k)
    moved = moved[np.all(np.abs(moved) <= reach, axis=1)]
    column = np.round((moved + reach) / (grid[1] - grid[0])).astype(int)
    total = np.sum(signal[np.arange(len(at)), column], axis=1)

    near = np.argmin(np.linalg.norm(labels[:, None] - profiles.xy, axis=-1), axis=1)
    distance = np.sum((labels - profiles.xy[near]) * profiles.normal[near], axis=1)
    if np.all(np.abs(distance) > reach):  # a label of another marking
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
    """Contrast (k, m) at distances (m,) from a marking in units of its noise, and the least one (k,) of a line."""
    sampled = zip(strips.offset[at], strips.contrast[at], strips.may_be_line[at].astype(float), strict=True)
    contrast, alike = np.swapaxes([[np.interp(grid, x, y) for y in both] for x, *both in sampled], 0, 1)
    middle = np.median(contrast, axis=1)
    noise = max(TO_SIGMA * float(np.median(np.abs(contrast - middle[:, None]))), LEAST_NOISE)
    may_be_line = (alike > 0.5) & (np.abs(grid) <= strips.profiles.room[at, None])
    signal = np.clip((contrast - middle[:, None]) / noise, FAINTEST, np.where(may_be_line, STRONGEST, 0.0))
    return signal, middle + SHOWN * noise
