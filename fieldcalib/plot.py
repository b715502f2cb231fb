"""Players, their errors and the view of a camera, on the pitches of mplsoccer (extra `plot`).

Points are those of this package, with y towards the main camera; mplsoccer's y is up. The pitches here are of
mplsoccer's type "skillcorner": metres from the centre mark, (x, -y).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._extras import imported
from fieldcalib._types import CAMERA, FIELD, Array, expect, listed, named, real_array
from fieldcalib.assess.estimate import GroundError
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import EllipseCollection, PathCollection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Polygon

__all__ = [
    "draw_errors",
    "draw_players",
    "draw_trails",
    "draw_visible_area",
    "on_pitch",
    "soccer_pitch",
    "visible_ground",
]

PITCH_TYPES = ("skillcorner", "secondspectrum")  # metres from the centre mark, y up
FARTHEST = 300.0  # m from the centre mark: ground further away, up to the horizon, is cut off


def __dir__() -> list[str]:
    return __all__.copy()


def soccer_pitch(field: Field, **options: Any) -> Any:
    """An `mplsoccer.Pitch` of a field's length and width, in metres from the centre mark.

    Parameters
    ----------
    field : Field
        A soccer field.
    **options
        Options of `mplsoccer.Pitch`, such as ``pitch_color="grass"``.

    Returns
    -------
    mplsoccer.Pitch

    Raises
    ------
    ImportError
        If mplsoccer is not installed: ``pip install 'fieldcalib[plot]'``.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> figure, ax = soccer_pitch(soccer(), line_color="gray").draw()
    >>> [round(float(limit)) for limit in (*ax.get_xlim(), *ax.get_ylim())]
    [-56, 56, -38, 38]
    """
    expect(field, Field, FIELD)
    mplsoccer: Any = imported("mplsoccer", "plot", "fieldcalib.plot")
    return mplsoccer.Pitch("skillcorner", pitch_length=field.length, pitch_width=field.width, **options)


def on_pitch(X: ArrayLike) -> tuple[Array, Array]:
    """Field points in the coordinates of `soccer_pitch`: x and y, as the methods of mplsoccer take them.

    Parameters
    ----------
    X : (..., 2) or (..., 3) array_like
        Metres.

    Examples
    --------
    >>> on_pitch([[10.0, 5.0]])
    (array([10.]), array([-5.]))
    """
    points = real_array(X)
    if points.ndim == 0 or points.shape[-1] not in (2, 3):
        raise ValueError(f"expected field points of shape (..., 2) or (..., 3), got {points.shape}")
    return points[..., 0], -points[..., 1]


def draw_players(pitch: Any, ax: Axes, X: ArrayLike, **options: Any) -> PathCollection:
    """Draw players as dots on a pitch.

    Parameters
    ----------
    pitch : mplsoccer.Pitch
        A pitch of `soccer_pitch`, or a `VerticalPitch` of the same type.
    ax : matplotlib.axes.Axes
    X : (N, 2) or (N, 3) array_like
        Field points, metres; NaN is left out.
    **options
        Options of ``pitch.scatter``, such as `color` or `s`.

    Raises
    ------
    ValueError
        If the pitch is of another type, or the points have another shape.
    """
    _check(pitch, ax)
    x, y = on_pitch(X)
    drawn: PathCollection = pitch.scatter(x, y, ax=ax, **{"s": 60, "edgecolors": "black", "zorder": 4, **options})
    return drawn


def draw_trails(pitch: Any, ax: Axes, trails: Sequence[ArrayLike], **options: Any) -> list[Line2D]:
    """Draw the earlier places of players as lines on a pitch.

    Parameters
    ----------
    pitch, ax
        As of `draw_players`.
    trails : sequence of (M, 2) or (M, 3) array_like
        Field points of each player, metres; NaN is a gap.
    **options
        Options of ``pitch.plot``, such as `color` or `linewidth`.

    Raises
    ------
    ValueError
        As `draw_players`.
    """
    _check(pitch, ax)
    drawn: list[Line2D] = []
    for trail in listed(trails, "trails of points"):
        x, y = on_pitch(trail)
        drawn += pitch.plot(x, y, ax=ax, **{"linewidth": 1.5, "alpha": 0.7, "zorder": 3, **options})
    return drawn


def draw_errors(pitch: Any, ax: Axes, X: ArrayLike, covariance: ArrayLike, level: float = 0.95) -> EllipseCollection:
    """Draw ellipses that hold the true points with a probability.

    Parameters
    ----------
    pitch, ax
        As of `draw_players`; a pitch whose x is horizontal.
    X : (N, 2) or (N, 3) array_like
        Field points, metres.
    covariance : (N, 2, 2) array_like
        As `fieldcalib.locate_on_ground` gives it.
    level : float
        The probability, of normal errors.

    Raises
    ------
    ValueError
        If the pitch is of another type or vertical, or an array has another shape.
    """
    _check(pitch, ax)
    if pitch.vertical:
        raise ValueError("expected a Pitch whose x is horizontal, got a VerticalPitch")
    ellipses: Any = imported("matplotlib.collections", "plot", "fieldcalib.plot")
    x, y = on_pitch(X)
    covariances = real_array(covariance)
    if covariances.shape != (*x.shape, 2, 2):
        raise ValueError(f"expected a covariance of each point, {(*x.shape, 2, 2)}, got shape {covariances.shape}")
    axes, angles = GroundError(covariances, np.inf).ellipse(level)
    drawn: EllipseCollection = ellipses.EllipseCollection(
        2.0 * axes[:, 0],
        2.0 * axes[:, 1],
        -np.degrees(angles),  # y is up here
        units="xy",
        offsets=np.column_stack([x, y]),
        offset_transform=ax.transData,
        facecolors="none",
        edgecolors="black",
        linewidths=1.0,
        zorder=3,
    )
    ax.add_collection(drawn)
    return drawn


def draw_visible_area(pitch: Any, ax: Axes, camera: Camera, **options: Any) -> Polygon:
    """Draw the ground that a camera sees.

    Parameters
    ----------
    pitch, ax
        As of `draw_players`.
    camera : Camera
        Ground more than 300 m from the centre mark is cut off.
    **options
        Options of ``pitch.polygon``, such as `color` or `alpha`.

    Raises
    ------
    ValueError
        If the pitch is of another type, or the camera sees no ground.
    """
    _check(pitch, ax)
    outline = visible_ground(camera)
    drawn: Polygon
    (drawn,) = pitch.polygon(
        [np.column_stack(on_pitch(outline))], ax=ax, **{"color": "gold", "alpha": 0.25, "zorder": 2, **options}
    )
    return drawn


def visible_ground(camera: Camera) -> Array:
    """The outline (N, 2) of the ground that a camera sees, metres, up to 300 m from the centre mark.

    Raises
    ------
    ValueError
        If it sees no ground.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> left, top = visible_ground(camera).min(axis=0)
    >>> bool(-80 < left < -40), bool(top < 0)
    (True, True)
    """
    import cv2

    expect(camera, Camera, CAMERA)
    columns, rows = (np.arange(side + 1) - 0.5 for side in camera.image_size)
    across, down = (np.repeat(along[[0, -1]], len(other)) for along, other in ((columns, rows), (rows, columns)))
    border = np.column_stack([np.append(across, np.tile(columns, 2)), np.append(np.tile(rows, 2), down)])
    X = camera.image_to_field(border)[:, :2]
    X = X[np.linalg.norm(X, axis=-1) <= FARTHEST]  # not those above the horizon, which are NaN
    if len(X) < 3:
        raise ValueError("the camera sees no ground within 300 m of the centre mark")
    return np.asarray(cv2.convexHull(X.astype(np.float32))[:, 0], dtype=float)


def _check(pitch: Any, ax: Any) -> None:
    """Raise a ValueError unless a pitch has the coordinates of `on_pitch`, and axes are some."""
    if not hasattr(ax, "transData"):
        raise ValueError(f"expected the axes of a drawing, as pitch.draw() makes them, got {named(ax)}")
    kind = getattr(pitch, "pitch_type", type(pitch).__name__)
    if kind not in PITCH_TYPES:
        raise ValueError(
            f"expected a pitch of type {PITCH_TYPES[0]!r}, as soccer_pitch makes it, got {kind!r}; for others "
            f"fieldcalib.io.coordinates.to_system has points, and the pitch their methods"
        )
