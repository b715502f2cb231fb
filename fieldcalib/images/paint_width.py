"""Width of the paint of markings in an image, against the width that a camera projects.

Lines of soccer are at most 12 cm wide. A smaller field with the same markings gives the same picture, and so the same
labels, as a larger one from further away; but its paint then looks wider than it should. Motion and lenses that are out
of focus widen lines too, and their edges as well: a line that is blurred to a multiple of its width has edges as long
as it is wide. So only places with sharp edges count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, Float32, IntArray
from fieldcalib.assess.markings import MarkingInView
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.line_profiles import LUMA, Profiles, colours_across, profiles_along
from fieldcalib.images.paint_evidence import LEAST_PAINTED
from fieldcalib.io.image import Image

NARROWEST = 3.0  # px of any image: the width of narrower lines cannot be measured
SHARPEST = 0.6  # of the projected width, up to which edges are sharp; a moving or defocused line has longer ones
STEPS = 16  # samples in a projected width
REACH = 4.5  # projected widths to both sides of a marking that are sampled: past where ground begins on both sides
NEAR, NEAR_PX = 1.2, 1.0  # projected widths, and px more, in which the middle of the paint lies
BESIDE, BESIDE_PX = 1.8, 1.0  # from there, where the ground begins
LEAST_CONTRAST = 15.0  # levels
EVEN = 0.5  # of the contrast: largest difference between the grounds on both sides


def with_widths(seen: Sequence[MarkingInView], widths: Mapping[str, Array]) -> tuple[MarkingInView, ...]:
    """The markings in view, with the widths (n,) of the paint of those that lie on it."""
    return tuple(
        replace(one, width=float(np.median(widths[one.label])), widths=len(widths[one.label]))
        if one.label in widths and not one.is_beside
        else one
        for one in seen
    )


def widths_by_marking(image: Image, camera: Camera, markings: Markings) -> dict[str, Array]:
    """Widths (n,) of the paint of each marking that looks wide enough to be measured, in units of the projected width.

    Lines that may be borders of painted areas have no such widths.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> from fieldcalib.draw.scene import render_field
    >>> camera = Camera.from_angles(0.3, 1.36, 0.0, 3200.0, (0.0, 66.0, -16.0), (1920, 1080))
    >>> found = widths_by_marking(render_field(camera, soccer()), camera, Markings.of(soccer()))
    >>> {label: round(float(np.median(width)), 1) for label, width in found.items()}
    {'Middle line': 1.0, 'Circle right': 1.0, 'Circle central': 1.0}
    """
    if not np.isfinite(markings.look.ground_difference):
        return {}
    profiles = profiles_along(camera, markings)
    solid = markings.painted[profiles.member] >= LEAST_PAINTED
    profiles = profiles.take(np.flatnonzero(profiles.on_ground & solid & (profiles.width >= NARROWEST)))
    width = paint_widths(image, profiles)
    measured = np.isfinite(width)
    members = np.unique(profiles.member[measured]).tolist()
    return {markings.labels[k]: width[measured & (profiles.member == k)] for k in members}


def paint_widths(image: Image, profiles: Profiles) -> Array:
    """Width (n,) of the paint at profiles, in units of their projected widths; NaN where it is not sharp, or not there.

    It is measured at half the height of the paint above the ground on each side.
    """
    if not len(profiles):
        return np.zeros(0)
    half = round(REACH * STEPS)
    colour = colours_across(image, profiles, profiles.width / STEPS, half + 1)
    level = np.tensordot(LUMA if profiles.look.lighter else -LUMA, colour, axes=1)
    pixel = STEPS / profiles.width  # in samples
    near = np.abs(np.arange(-half, half + 1)) <= (NEAR * STEPS + NEAR_PX * pixel)[:, None]
    top = np.argmax(np.where(near, level, -np.inf), axis=1)
    peak = np.take_along_axis(level, top[:, None], axis=1)[:, 0]
    away = BESIDE * STEPS + BESIDE_PX * pixel
    sides = [_Side.of(level, top, away), _Side.of(level[:, ::-1], 2 * half - top, away)]
    contrast = peak - np.maximum(*(one.ground for one in sides))
    even = np.abs(np.subtract(*(one.ground for one in sides))) <= EVEN * contrast
    sharp = np.maximum(*(one.length for one in sides)) < SHARPEST * STEPS  # false for NaN
    width = sum(one.edge for one in sides) / STEPS
    return np.where((contrast >= LEAST_CONTRAST) & even & sharp, width, np.nan)


class _Side(NamedTuple):
    """One side of the paint in each profile."""

    ground: Array
    """Level of the ground, (n,)."""
    edge: Array
    """Samples from the top of the paint to half its height, (n,)."""
    length: Array
    """Samples from the foot to the top of its edge if that goes on as between a quarter and three, (n,)."""

    @classmethod
    def of(cls, level: Float32, top: IntArray, away: Array) -> _Side:
        """The right side of profiles (n, m) with the top at a sample (n,); its ground begins `away` (n,) samples on."""
        index = np.arange(level.shape[1])
        ground = np.nanmedian(np.where(index > (top + away)[:, None], level, np.nan), axis=1)
        peak = np.take_along_axis(level, top[:, None], axis=1)[:, 0]
        upper, middle, lower = (_fall(level, top, ground + share * (peak - ground)) for share in (0.75, 0.5, 0.25))
        return cls(ground, middle, 2.0 * (lower - upper))


def _fall(level: Float32, top: IntArray, height: Array) -> Array:
    """Samples (n,) from the top of each row rightwards to where its level falls to a height (n,); NaN if nowhere."""
    below = (level <= height[:, None]) & (np.arange(level.shape[1]) > top[:, None])  # false for NaN
    at = np.argmax(below, axis=1)
    low, high = (np.take_along_axis(level, one[:, None], axis=1)[:, 0] for one in (at, at - 1))
    found = np.any(below, axis=1) & (high > low)
    return np.where(found, at - top - (height - low) / np.where(found, high - low, 1.0), np.nan)
