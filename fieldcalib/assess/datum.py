"""The reference of errors on the ground: the markings in view, or the centre mark.

Where the length of a pitch is not known and one end of it is in view, positions relative to the centre mark are
uncertain by half of its error, while positions relative to the paint in view are known to centimetres. The true pitch
is the assumed one with its markings moved by M (`Field.motion`) per metre of length and width. A camera that was fitted
to them locates a point X at X + J e, with e the error of its parameters, length and width among them. Relative to the
markings the point is off by

    J e - t e_size,

where t e_size is the common displacement of the markings in view: t is the translation of the ground nearest to their
motion,

    t = argmin sum_i w_i |n_i . (M_i - t)|^2,

over the metres w_i of all markings in view, with n_i their normals. A line does not show motion along itself, so lines
across x determine the x of t, lines across y its y, and circles both. With one end in view t is the motion of this end,
and the error of the length drops out. With both ends in view their motions cancel, t is small, and the error of the
length remains at both. Along a coordinate that no marking in view determines, t is 0: the error stays relative to the
centre mark.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.ground import pixels_of_points
from fieldcalib.fields.field import Field
from fieldcalib.problem.projection import Projection

RelativeTo: TypeAlias = Literal["markings in view", "centre mark"]
MARKINGS_IN_VIEW: RelativeTo = "markings in view"
CENTRE_MARK: RelativeTo = "centre mark"

SPACING = 1.0  # m, of the places along the markings
FAINT = 1e-3  # m of marking: less does not determine a translation
APART = 0.5  # m: larger errors of the centre mark relative to the markings in view are mentioned
SIDES = (("length", ("left end", "right end")), ("width", ("far side", "near side")))  # as the main camera sees them


class _Places(NamedTuple):
    """N places along the painted markings of a field."""

    X: Array
    """Positions, (N, 3)."""
    normal: Array
    """Terms ``w n n^T`` of the normal equations of t, row by row, (N, 4)."""
    moving: Array
    """Terms ``w n n^T M`` of their right side, (N, 4)."""


@lru_cache(maxsize=64)
def _places(field: Field) -> _Places:
    X, normal, moving = [np.zeros((0, 3))], [np.zeros((0, 2, 2))], [np.zeros((0, 2, 2))]
    for (label, segment), motion in zip(field.items(), field.motion, strict=True):
        if label in field.half_labels or field.paint_of(label).width == 0.0:
            continue
        parts = segment.parts(SPACING)
        if parts is None:
            continue
        share = parts.share[:, None, None]
        moved = (1.0 - share) * motion[0, :2] + share * motion[1, :2]
        along = parts.along[:, :2]
        X.append(parts.X)
        across = np.eye(2) - along[:, :, None] * along[:, None, :]  # for a post both directions
        normal.append(parts.length / len(moved) * across)
        moving.append(normal[-1] @ moved)
    return _Places(np.concatenate(X), *(np.concatenate(one).reshape(-1, 4) for one in (normal, moving)))


def motion_in_view(projection: Projection, field: Field) -> Array:
    """Common motion t of the markings that B cameras see, in metres per metre of length and width, (B, 2, 2).

    Every marking that the camera projects into its image counts as in view, even if something hides it.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> from fieldcalib.problem.layout import Layout
    >>> right = Camera.from_angles(0.6, 1.35, 0.0, 2500.0, (0.0, 65.0, -16.0), (960, 540))
    >>> layout = Layout.of((960, 540))
    >>> abs(motion_in_view(Projection(layout.theta(right)[None], layout), soccer()).round(3))  # x with half the length
    array([[[0.5  , 0.   ],
            [0.   , 0.091]]])
    """
    places = _places(field)
    xy, has_pixel = pixels_of_points(projection, places.X[None])
    size = np.array(projection.layout.image_size)
    in_view = (has_pixel & np.all((xy >= -0.5) & (xy < size - 0.5), axis=-1)).astype(float)
    normal = (in_view @ places.normal).reshape(-1, 2, 2)
    return np.asarray(np.linalg.solve(normal + FAINT * np.eye(2), (in_view @ places.moving).reshape(-1, 2, 2)))


def by_parameters(projection: Projection, field: Field | None) -> Array:
    """Motion of the markings in view as derivatives (B, 2, n) by all parameters: 0 except by length and width."""
    layout = projection.layout
    moved = np.zeros((len(projection.theta), 2, layout.size))
    if field is not None and layout.field_size is not None:
        moved[:, :, layout.field_size_block] = motion_in_view(projection, field)
    return moved


def relative_to_markings(
    derivatives: Array, projection: Projection, field: Field | None, some: BoolArray | None = None
) -> Array:
    """Derivatives (B, N, 2, P) of ground points by some parameters (n,), less the motion of the markings in view."""
    layout = projection.layout
    some = np.ones(layout.size, dtype=bool) if some is None else some
    if field is None or not np.any(some[layout.field_size_block]):
        return derivatives
    return derivatives - by_parameters(projection, field)[:, None, :, some]


def checked(relative_to: RelativeTo) -> RelativeTo:
    """Return `relative_to`, or raise a ValueError if it is neither of the two."""
    if not isinstance(relative_to, str) or relative_to not in (MARKINGS_IN_VIEW, CENTRE_MARK):
        raise ValueError(f"relative_to must be {MARKINGS_IN_VIEW!r} or {CENTRE_MARK!r}, got {relative_to!r}")
    return relative_to


def in_words(motion: Array, standard_deviations: Array) -> str:
    """Describe the reference of positions, with advice; empty if the centre mark is known well enough.

    Parameters
    ----------
    motion : (2, 2) array
        Motion of the markings in view with length and width, see `motion_in_view`.
    standard_deviations : (2,) array
        Standard deviations of length and width, metres.

    Examples
    --------
    >>> print(in_words(np.diag([0.5, -0.5]), np.array([2.5, 0.1])))
    the length is not visible: positions are relative to the right end; the known length gives metres from the centre
    """
    found = []
    for axis, (name, sides) in enumerate(SIDES):
        if abs(motion[axis, axis]) * standard_deviations[axis] > APART:
            side = sides[int(motion[axis, axis] > 0.0)]
            found.append((name, side))
    if not found:
        return ""
    names, sides_in_view = (" and ".join(one) for one in zip(*found, strict=True))
    verb, gives = ("is", "gives") if len(found) == 1 else ("are", "give")
    return (
        f"the {names} {verb} not visible: positions are relative to the {sides_in_view}; the known {names} {gives} "
        f"metres from the centre"
    )
