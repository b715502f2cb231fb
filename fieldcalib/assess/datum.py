"""What errors on the ground are relative to: the markings in view, or the centre mark.

Where the length of a pitch is not known and one end of it is in view, every place from the centre mark on is unknown by
half of that, while from the paint in view everything is known to centimetres. The true pitch is the assumed one with
its markings moved, M by their `Field.motion` with (length, width); a camera that follows them takes a point at X for
one at X + J e, e being the error of its parameters, those of length and width among them. Relative to the markings the
point is off by

    J e - t e_size,

t e_size being the displacement of the frame of reference that the markings in view are: the translation of the ground
that comes nearest to what moves them,

    t = argmin sum_i w_i |n_i . (M_i - t)|^2,

over the metres w_i of all markings that are in view, n_i across them: nobody tells a line from one that is moved along
itself, so that lines across x tell x, lines across y tell y, and circles both. With one end in view that is the motion
of this end, and nothing is left of it; with both ends in view their motions differ, the mean is none or little, and the
length is in the error of either. Along a coordinate that no marking in view tells, t is 0: the error stays that from
the centre mark.
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

SPACING = 1.0  # m along the markings, from one place to the next that is looked at
FAINT = 1e-3  # m of marking: what is told by less is told by nothing
APART = 0.5  # m: by as much as the centre mark must be unknown, from the markings in view, to speak of it
SIDES = (
    ("length", ("left end", "right end")),
    ("width", ("far side", "near side")),
)  # of a field, as the main camera sees


class _Places(NamedTuple):
    """Places along the painted markings of a field, N of them."""

    X: Array
    """(N, 3)."""
    telling: Array
    """Metres that each of them is for, across the marking, (N, 4): ``w n n^T`` row by row."""
    moving: Array
    """Motion across the marking, (N, 4): ``w n n^T M``."""


@lru_cache(maxsize=64)
def _places(field: Field) -> _Places:
    X, telling, moving = [np.zeros((0, 3))], [np.zeros((0, 2, 2))], [np.zeros((0, 2, 2))]
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
        across = np.eye(2) - along[:, :, None] * along[:, None, :]  # of a post both directions
        telling.append(parts.length / len(moved) * across)
        moving.append(telling[-1] @ moved)
    return _Places(np.concatenate(X), np.concatenate(telling).reshape(-1, 4), np.concatenate(moving).reshape(-1, 4))


def motion_in_view(projection: Projection, field: Field) -> Array:
    """How the markings that B cameras see move with length and width, as one, (B, 2, 2): t above, metres a metre.

    What hides a marking is not known: all that the camera projects into its image counts as in view.

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
    telling = (in_view @ places.telling).reshape(-1, 2, 2)
    return np.asarray(np.linalg.solve(telling + FAINT * np.eye(2), (in_view @ places.moving).reshape(-1, 2, 2)))


def by_parameters(projection: Projection, field: Field | None) -> Array:
    """Motion of the markings in view as derivatives (B, 2, n) by all parameters; 0 but for those of the size."""
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
    """What errors are asked to be relative to.

    Raises
    ------
    ValueError
        If it is neither.
    """
    if relative_to not in (MARKINGS_IN_VIEW, CENTRE_MARK):
        raise ValueError(f"relative_to must be {MARKINGS_IN_VIEW!r} or {CENTRE_MARK!r}, got {relative_to!r}")
    return relative_to


def in_words(motion: Array, standard_deviations: Array) -> str:
    """What positions are relative to, and what would help; nothing where that is the centre mark, or as good as that.

    Parameters
    ----------
    motion : (2, 2) array
        How the markings in view move with length and width, see `motion_in_view`.
    standard_deviations : (2,) array
        Of length and width, metres.

    Examples
    --------
    >>> print(in_words(np.diag([0.5, -0.5]), np.array([2.5, 0.1])))
    the length is not visible: positions are relative to the right end; --field-length with --field-size known gives \
metres from the centre
    """
    found = []
    for axis, (name, sides) in enumerate(SIDES):
        if abs(motion[axis, axis]) * standard_deviations[axis] > APART:
            side = sides[int(motion[axis, axis] > 0.0)]
            found.append((name, side, f"--field-{name}"))
    if not found:
        return ""
    names, sides_in_view, options = (" and ".join(one) for one in zip(*found, strict=True))
    verb, gives = ("is", "gives") if len(found) == 1 else ("are", "give")
    return (
        f"the {names} {verb} not visible: positions are relative to the {sides_in_view}; {options} with --field-size "
        f"known {gives} metres from the centre"
    )
