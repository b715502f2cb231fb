"""Dispatch between compiled code, where Numba is installed, and NumPy.

Compiled code solves independent frames of lines, arcs and points under a radial lens or none, on fields whose size and
crown are known or estimated. NumPy solves frames that share parameters or are tied to each other, point clouds and
other lenses.
If both can solve a frame, their results differ by rounding only.
"""

from __future__ import annotations

import logging
from functools import cache
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.ground import Terrain
from fieldcalib.fields.segments.closest import ClosestPoints
from fieldcalib.geometry.lens import Pinhole, RadialLens
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.observations import Observations

LOG = logging.getLogger(__name__)
NO_FOLDER = "NumPy solves, slower than Numba, which has no folder for what it compiles (%s): NUMBA_CACHE_DIR names one"

NO_MOTION = np.zeros((1, 1, 3, 0))  # of segments on a field whose size is known


@cache
def compiled_module() -> ModuleType | None:
    """The module `fieldcalib.problem.compiled`; None where Numba is not installed, or can keep nothing on the disk.

    Compiling takes half a minute: without a folder to keep the result in, NumPy is the quicker way.
    """
    if find_spec("numba") is None:
        return None
    try:
        from fieldcalib.problem import compiled as module
    except RuntimeError as error:
        LOG.info(NO_FOLDER, error)
        return None
    return module


def kernels(layout: Layout, observations: Observations) -> ModuleType | None:
    """The compiled functions; None if they do not support the lens or the kinds of rows."""
    plain = isinstance(layout.lens, RadialLens | Pinhole) and layout.zoom_law is None
    return compiled_module() if plain and observations.are_compiled else None


def compiled_closest_points(
    theta: Array, layout: Layout, observations: Observations, terrain: Terrain | None
) -> ClosestPoints | None:
    """`Observations.closest_points` of cameras theta (B, n); None if it is not compiled."""
    module = kernels(layout, observations)
    if module is None:
        return None
    found = no_points(observations)
    module.closest_points(packed_frames(module, layout, observations, terrain), unknowns(layout, theta), found)
    return found


def no_points(observations: Observations) -> ClosestPoints:
    """Closest points that compiled code writes; it leaves those of padding, which must be finite."""
    shape = observations.label.shape
    return ClosestPoints(np.zeros(shape), np.zeros((2, *shape)), np.ones(shape), np.ones((2, *shape)))


def unknowns(layout: Layout, theta: Array) -> Array:
    """The parameters (B, n) of the cameras and, where they are estimated, of the field, as a new array."""
    of_field = layout.field_size_block if layout.has_free_size else layout.lens_block
    return theta[:, : (layout.crown_block if layout.has_free_crown else of_field).stop].copy()


def packed_frames(
    module: ModuleType, layout: Layout, observations: Observations, terrain: Terrain | None, noise: float = 1.0
) -> Any:
    """Observations as `fieldcalib.problem.compiled.Frames`, with weights for pixels of some noise."""
    (names, rows), (xy, weight, label, geometry) = observations.compiled_kinds, observations.compiled_rows
    motion, given = len(rows) * (NO_MOTION,), np.zeros(0)
    if layout.has_free_size:
        assert layout.field_size is not None
        motion = tuple(np.ascontiguousarray(observations.motion_of_rows[k]) for k in rows)
        given = np.array(layout.field_size.given, dtype=float)
    return module.Frames(
        tuple(getattr(module, name) for name in names),
        xy,
        weight if noise == 1.0 else tuple(one / noise**2 for one in weight),
        label,
        geometry,
        motion,
        given,
        _raised(terrain, len(observations)),
        layout.field_size_block.start if layout.has_free_crown or layout.has_free_size else -1,
        layout.crown_block.start if layout.has_free_crown else -1,
        layout.lens.rho,
        module.Limits(),
    )


def _raised(terrain: Terrain | None, count: int) -> Array:
    """The ground of B frames as `fieldcalib.problem.compiled.Raised`, (B, 4)."""
    ground = np.zeros((count, 4))
    if terrain is not None:
        values = terrain.crown, terrain.fall, 2.0 / terrain.length, 2.0 / terrain.width
        for column, value in enumerate(values):
            ground[:, column] = np.ravel(value)
    return ground
