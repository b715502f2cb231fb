"""Points of rinks that were set by hand in frames of hockey, and how far a camera projects from them.

A folder has `<id>.jpg` and `<id>.txt`, in subfolders too: a line for each point, ``name x y``, in pixels. Names are
those of matinsaedi/hockey-homography-estimation: `00_`, `01_`, `10_`, `11_` are the face-off circles at the left end
(0) and the right one (1), nearer to the camera (0) and farther away (1); their "arrows" are L marks, whose second point
is the corner, and their "vertical lines" hash marks, from the inner to the outer end. The footage is of 2014, and its
rink `ice-hockey-nhl-2013`. Some names are exchanged, so that a median is compared.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_tools.court_truth import UNIT, distances
from fieldcalib._types import Array
from fieldcalib.fields.catalogue import field
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera

FIELD = "ice-hockey-nhl-2013"
RIGHT = 10.0 * UNIT / 1920.0  # px of an image of 1280 columns: the largest median distance of a right camera
SIDES = {"0": "left", "1": "right"}
DEPTHS = {"0": "bottom", "1": "top"}
# Ends of the L marks by corner and number: the second point of each is its corner.
ENDS = {
    ("bottom", "left"): ("along end", "corner", "across end"),
    ("bottom", "right"): ("across end", "corner", "along end"),
    ("top", "right"): ("along end", "corner", "across end"),
    ("top", "left"): ("across end", "corner", "along end"),
}
OTHERS = {
    "circle_center": "Face-off spot {side} {depth}",
    "circle": "Face-off spot {side} {depth}",
    "small_circle": "Neutral spot {side} {depth}",
    "corner": "Goal line and boards {side} {depth}",
}
CENTRE = {
    "center_circle_bottom": "Centre line and centre circle bottom",
    "center_circle_top": "Centre line and centre circle top",
}


@dataclass(frozen=True, eq=False)
class RinkFrame:
    """The points that were set in a frame."""

    path: Path
    X: Array
    """On the ice, metres, (N, 3)."""
    xy: Array
    """Their pixels, (N, 2)."""

    def distances(self, camera: Camera) -> Array:
        """Distances (N,) of the points from their projections (`data_tools.court_truth.distances`)."""
        return distances(camera, self.X, self.xy, camera.image_size[0])

    def is_right(self, camera: Camera) -> bool:
        """Whether a camera is within `RIGHT` of the points in the median."""
        return float(np.median(self.distances(camera))) <= RIGHT


def point_named(rink: Field, name: str) -> Array | None:
    """The point (3,) of a name in the files; None for a name without a point of the field.

    Examples
    --------
    >>> point_named(field(FIELD), "00_bottom_left_arrow_2").round(1).tolist()
    [-21.7, 7.0, 0.0]
    """
    label = CENTRE.get(name)
    if found := re.fullmatch(r"([01])([01])_(bottom|top)_(left|right)_(arrow|vertical_line)_([123])", name):
        side, depth, row, column, kind, number = found.groups()
        where = f"{SIDES[side]} {DEPTHS[depth]} {row[0].upper()}{column[0].upper()}"
        ends = ENDS[row, column] if kind == "arrow" else ("inner end", "outer end", "")
        label = f"{'L' if kind == 'arrow' else 'Hash'} mark {where} {ends[int(number) - 1]}"
    elif found := re.fullmatch(r"(bottom|top)_(left|right)_(\w+)", name):
        depth, side, kind = found.groups()
        label = OTHERS.get(kind, "").format(side=side, depth=depth)
    return None if label is None or label not in rink.points else np.array(rink.points[label].X)


def rink_frames(folder: Path) -> Iterator[RinkFrame]:
    """Read the points of all frames in a folder."""
    rink = field(FIELD)
    for path in sorted(folder.glob("**/*.txt")):
        picture = path.with_suffix(".jpg")
        if not picture.exists():
            continue
        lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
        named = [(point_named(rink, name), (float(x), float(y))) for name, x, y in lines]
        known = [(X, xy) for X, xy in named if X is not None]
        yield RinkFrame(picture, np.array([X for X, _ in known]), np.array([xy for _, xy in known]))
