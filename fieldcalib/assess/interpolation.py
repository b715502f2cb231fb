"""Interpolation of missing cameras between those of the frames before and after."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.frame_table import Basis, FrameTable
from fieldcalib.assess.level import Considered
from fieldcalib.assess.own_errors import OwnErrors, ground_errors
from fieldcalib.fields.field import Field, tolerance_of
from fieldcalib.problem.layout import PRINCIPAL_POINT, Layout

# Standard deviations from a uniform motion, for each missing frame:
STEP = 1e-3  # radians, or of log f,
STEP_OF_CENTRE = 0.05  # m, of a camera that moves,
STEP_OF_POINT = 2e-3  # widths of the picture, of the principal point where a window moves


class Gaps(NamedTuple):
    """Frames to interpolate, and the nearest frames with a camera around them, (G,) each."""

    missing: IntArray
    before: IntArray
    after: IntArray

    @property
    def length(self) -> Array:
        """Number of frames from `before` to `after`, (G, 1)."""
        return np.asarray(self.after - self.before, dtype=float)[:, None]

    @property
    def share(self) -> Array:
        """Position of each frame between `before` and `after`, from 0 to 1, (G, 1)."""
        return np.asarray((self.missing - self.before)[:, None] / self.length)

    def between(self, values: Array) -> Array:
        """Values (G, ...), interpolated linearly from those of all frames, (T, ...)."""
        share = self.share.reshape(-1, *(1,) * (values.ndim - 1))
        return np.asarray((1.0 - share) * values[self.before] + share * values[self.after])


def interpolated(
    frames: FrameTable, run: IntArray, longest: int, considered: Considered, field: Field | None
) -> FrameTable:
    """Add cameras in gaps of up to `longest` frames without camera, between frames of the same run (T,)."""
    gaps = _gaps(frames, run, longest)
    if not len(gaps.missing):
        return frames
    layout, free = considered.layout, considered.layout.free
    bend = _bend(frames, run, gaps)
    bend[:, ~free] = 0.0
    at_start = frames.theta[gaps.before]
    theta = at_start + gaps.share * (frames.theta[gaps.after] - at_start) + bend
    uneven = gaps.share * (1.0 - gaps.share) * _step(layout)[free] * gaps.length
    spread = 0.5 * np.abs(bend[:, free]) + uneven
    own = gaps.between(frames.own) + spread[..., None] ** 2 * np.eye(int(np.count_nonzero(free)))
    errors = OwnErrors(own, gaps.between(frames.following))
    metres = ground_errors(theta, errors, considered, field)
    rows = frames.at(gaps.missing).with_cameras(theta, errors, metres, Basis.INTERPOLATED, tolerance_of(field))
    misfit = np.fmax(frames.misfit[gaps.before], frames.misfit[gaps.after])  # a wrong camera makes others wrong
    return frames.replaced(gaps.missing, replace(rows, misfit=misfit))


def _gaps(frames: FrameTable, run: IntArray, longest: int) -> Gaps:
    has = frames.has_camera
    known, missing = np.flatnonzero(has), np.flatnonzero(~has)
    place = np.searchsorted(known, missing)
    inside = (place > 0) & (place < len(known))
    missing, place = missing[inside], place[inside]
    before, after = known[place - 1], known[place]
    near = (run[before] == run[missing]) & (run[missing] == run[after]) & (after - before - 1 <= longest)
    return Gaps(missing[near], before[near], after[near])


def _bend(frames: FrameTable, run: IntArray, gaps: Gaps) -> Array:
    """Difference (G, n) between Hermite's cubic, with the slopes at both ends of the gap, and a uniform motion."""
    has, change = frames.has_camera, frames.theta[gaps.after] - frames.theta[gaps.before]

    def slope(near: IntArray, far: IntArray) -> Array:
        """Slope at one end of each gap: to the next frame beyond it if that has a camera, else of a uniform motion."""
        far = np.clip(far, 0, len(has) - 1)
        usable = (has[far] & (run[far] == run[near]) & (far != near))[:, None]
        beyond = gaps.length * (far - near)[:, None] * (frames.theta[far] - frames.theta[near])
        return np.asarray(np.where(usable, beyond, change))

    share, at_start, at_end = gaps.share, slope(gaps.before, gaps.before - 1), slope(gaps.after, gaps.after + 1)
    return np.asarray(share * (1.0 - share) * ((1.0 - share) * (at_start - change) - share * (at_end - change)))


def _step(layout: Layout) -> Array:
    """Standard deviation of each parameter from a uniform motion, for each frame that is missing, (n,)."""
    step = np.where(layout.is_centre, STEP_OF_CENTRE, STEP)
    step[PRINCIPAL_POINT] = STEP_OF_POINT * layout.image_size[0]
    return step
