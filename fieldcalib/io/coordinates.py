"""Field points in the coordinate systems of data providers, which kloppy knows.

The systems of this package and of SoccerNet are the same: metres from the centre mark, x right along the touchline as
the main camera sees it, y towards the main camera.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._extras import imported
from fieldcalib._types import Array
from fieldcalib.fields.field import Field

OWN_SYSTEMS = ("fieldcalib", "soccernet")
SYSTEMS = (  # those of kloppy are named here, as a misspelt one must be found out without it
    *OWN_SYSTEMS,
    *("datafactory", "hawkeye", "impect", "kloppy", "metrica", "opta", "pff", "second_spectrum", "signality"),
    *("skillcorner", "sportec", "sportvu", "statsbomb", "tracab", "wyscout"),
)
MARKING = "Big rect. left main"  # shows that a field is one of soccer: the systems stretch its parts between the lines
STEP = 1e-3  # m: the systems are linear from one line of the field to the next


def to_system(xy: ArrayLike, system: str, field: Field) -> Array:
    """Field points in a coordinate system.

    No point is turned: x grows to the right as the main camera sees it, whoever attacks there. Systems of one size for
    all pitches (StatsBomb's 120 x 80, Opta's 100 x 100) stretch what lies between two lines of the pitch, so that a
    point on a line stays on it.

    Parameters
    ----------
    xy : (..., 2) or (..., 3) array_like
        Points on the field, metres, as `Camera.image_to_field` gives them; the third coordinate is not used.
    system : str
        One of `SYSTEMS`: "fieldcalib" or "soccernet", which are the same, or one that kloppy knows.
    field : Field
        Of soccer; its length and width are those of the pitch.

    Returns
    -------
    (..., 2) array
        In the unit of the system: metres, centimetres (tracab), or shares of the pitch. NaN stays NaN; points off the
        pitch are beyond the numbers of the touchline.

    Raises
    ------
    ValueError
        If there is no such system, the field is none of soccer, or the points have another shape.
    ImportError
        If kloppy is not installed: ``pip install 'fieldcalib[coordinates]'``. Own systems do not need it.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> to_system([[41.5, 0.0, 0.0], [0.0, -34.0, 0.0]], "statsbomb", soccer())  # penalty mark, far touchline
    array([[108.,  40.],
           [ 60.,   0.]])
    """
    points = np.asarray(xy, dtype=float)
    if points.ndim == 0 or points.shape[-1] not in (2, 3):
        raise ValueError(f"expected field points of shape (..., 2) or (..., 3), got shape {points.shape}")
    flat = points[..., :2].reshape(-1, 2)
    if system not in OWN_SYSTEMS:
        convert = _converter(system, field)
        flat = np.array([convert(x, y) if x == x and y == y else (np.nan, np.nan) for x, y in flat.tolist()])
    return flat.reshape(*points.shape[:-1], 2).copy()


def scale_of_system(xy: ArrayLike, system: str, field: Field) -> Array:
    """Change of a system's coordinates along x and along y per metre of the field.

    ``d system / d field`` of each axis by itself, as no system turns the axes; negative where one is reversed.

    Parameters
    ----------
    xy, system, field
        As for `to_system`.

    Returns
    -------
    (..., 2) array
        Units of the system per metre, which standard deviations are multiplied by.

    Raises
    ------
    ValueError, ImportError
        As `to_system`.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> scale_of_system([10.0, 5.0], "tracab", soccer()).round(6)
    array([ 100., -100.])
    """
    points = np.asarray(xy, dtype=float)
    return np.asarray((to_system(points + STEP, system, field) - to_system(points, system, field)) / STEP)


@lru_cache(maxsize=8)
def _converter(system: str, field: Field) -> Callable[[float, float], tuple[float, float]]:
    """A function that converts one point, by kloppy."""
    if _bare(system) not in map(_bare, SYSTEMS):
        raise ValueError(f"expected a system among {', '.join(SYSTEMS)}, got {system!r}")
    kloppy: Any = imported("kloppy.domain", "coordinates", f"the coordinate system {system!r}")
    if MARKING not in field:
        raise ValueError(
            f"the coordinates of {system!r} are of soccer pitches, this field is none: use {OWN_SYSTEMS[0]!r}"
        )
    length, width = field.length, field.width
    providers = {_bare(provider.value): provider for provider in kloppy.Provider}
    # tracking, not events: Sportec has a system for each, and players are tracked
    found = kloppy.build_coordinate_system(
        providers[_bare(system)], kloppy.DatasetType.TRACKING, pitch_length=length, pitch_width=width
    )
    # the main camera's side is the bottom
    down = found.vertical_orientation is kloppy.VerticalOrientation.TOP_TO_BOTTOM

    def convert(x: float, y: float) -> tuple[float, float]:
        base = kloppy.Point(x + length / 2.0, (y if down else -y) + width / 2.0)
        point = found.pitch_dimensions.from_metric_base(base, length, width)
        return point.x, point.y

    return convert


def _bare(name: str) -> str:
    """A name in lower case, without separators between its words.

    Examples
    --------
    >>> _bare("Second-Spectrum") == _bare("second_spectrum")
    True
    """
    return name.lower().replace("_", "").replace("-", "")
