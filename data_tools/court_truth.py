"""Crossings of court lines in frames of clips, set by hand, and how far a camera projects from them.

`tests/court_truth.json` has, for each clip of `shared/data/courts`, its field, the size of its pictures, pairs of
markings, and for ten frames the pixel at which each pair crosses (null where it is hidden, out of the picture or not
clear). It has coordinates only, no pictures.

How the crossings were made: the corners of the court were set by hand in the first frame of a clip. Near every crossing
that follows from them, the middle of the paint was located in profiles across both markings, on both sides of the
crossing, to about 45 px away; a straight line was fitted to each, robustly, and the crossing is where the two lines
meet. Every crossing was then looked at, enlarged four times, with the two lines drawn, and left out where a player
or the net hid it or a line did not lie in the middle of its paint. One camera per frame, with one lens coefficient,
fits all of them within 0.9 px of an image of 1280 columns (median 0.3).

A court looks the same when it is turned by 180 degrees: the ends are named as seen by a camera behind the left one.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.catalogue import field as field_named
from fieldcalib.fields.field import TURN, Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import dehomogenize, homogenize

TRUTH = Path(__file__).parents[1] / "tests" / "court_truth.json"
UNIT = 1280.0  # columns of the image in whose pixels distances are given
RIGHT, FARTHEST = 3.0, 6.0  # px of that image: the largest median and the largest distance of a right camera
LIMITS = RIGHT, FARTHEST


def distances(camera: Camera, X: Array, xy: Array, columns: int) -> Array:
    """Distances (N,) of pixels from the points that a camera projects, in pixels of an image of 1280 columns.

    They are those of the camera or of its twin on the other side of the field, whichever is nearer in the median;
    infinite for what is behind the camera.
    """
    both = []
    for turn in (1.0, TURN):
        off = np.linalg.norm(camera.project(X * turn) - xy, axis=1) * UNIT / columns
        both.append(np.where(np.isfinite(off), off, np.inf))
    return min(both, key=lambda off: float(np.median(off)))


@dataclass(frozen=True, eq=False)
class CourtFrame:
    """The crossings of lines that were set in a frame."""

    clip: str
    number: int
    """Of the frame in its clip, from 0."""
    field: str
    size: tuple[int, int]
    X: Array
    """The crossings on the field, metres, (N, 3)."""
    xy: Array
    """Their pixels, (N, 2)."""

    def distances(self, camera: Camera) -> Array:
        """Distances (N,) of the crossings from their projections, in pixels of an image of 1280 columns.

        They are those of the camera or of its twin on the other side of the court, whichever is nearer in the median;
        infinite for what is behind the camera.
        """
        return distances(camera, self.X, self.xy, self.size[0])

    def is_right(self, camera: Camera) -> bool:
        """Whether a camera is right: within 3 px of 1280 in the median, and nowhere more than 6 px off."""
        off = self.distances(camera)
        return bool(np.median(off) <= RIGHT and np.max(off) <= FARTHEST)


def court_frames(path: Path = TRUTH) -> list[CourtFrame]:
    """Read the crossings of all frames.

    Examples
    --------
    >>> frames = court_frames()
    >>> len(frames), min(len(frame.xy) for frame in frames)
    (50, 7)
    """
    found = []
    for clip, record in json.loads(path.read_text(encoding="utf-8")).items():
        field = field_named(record["field"])
        X = np.array([crossing(field, *pair) for pair in record["crossings"]])
        for number, pixels in record["frames"].items():
            seen = [index for index, xy in enumerate(pixels) if xy is not None]
            xy = np.array([pixels[index] for index in seen])
            found.append(CourtFrame(clip, int(number), record["field"], tuple(record["size"]), X[seen], xy))
    return found


def crossing(field: Field, one: str, other: str) -> Array:
    """The point (3,) of the ground at which two straight markings of a field, or their extensions, cross.

    Examples
    --------
    >>> crossing(field_named("tennis"), "Service line left", "Centre service line").tolist()
    [-6.375, 0.0, 0.0]
    """
    ends = [[start, start + along] for start, along in (field[label].vectors for label in (one, other))]
    a, b = np.cross(*np.moveaxis(homogenize(np.array(ends)[..., :2]), 1, 0))
    return np.append(dehomogenize(np.cross(a, b)), 0.0)
