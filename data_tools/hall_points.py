"""Cameras of a hall whose positions were measured, and points of its volleyball court that were set by hand.

A folder has `points.yaml`: for each camera its position, points of the court, and their pixels in `out<camera>.jpg`;
metres from the middle of the court, x along it, y across, z upwards (ours are -x, y, -z).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from data_tools.court_truth import UNIT, distances
from fieldcalib._types import Array
from fieldcalib.fields.field import TURN
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import Image, parse_image

FIELD = "volleyball"
RIGHT = 15.0 * UNIT / 3840.0  # px of an image of 1280 columns: the largest median distance of a right camera
AXES = (-1.0, 1.0, -1.0)  # of the file, to ours


@dataclass(frozen=True, eq=False)
class HallPicture:
    """A picture, and what is known of its camera."""

    name: str
    image: Image
    X: Array
    """Points on the floor, metres, (N, 3)."""
    xy: Array
    """Their pixels, (N, 2)."""
    C: Array
    """Where the camera stands, (3,) metres."""

    def distances(self, camera: Camera) -> Array:
        """Distances (N,) of the points from their projections (`data_tools.court_truth.distances`)."""
        return distances(camera, self.X, self.xy, camera.image_size[0])

    def metres(self, camera: Camera) -> float:
        """Distance of a camera, or of its twin on the other side of the court, from where it stands."""
        return min(float(np.linalg.norm(camera.C * turn - self.C)) for turn in (1.0, TURN))


def hall_pictures(folder: Path) -> Iterator[HallPicture]:
    """The pictures of a folder."""
    for name, known in yaml.safe_load((folder / "points.yaml").read_text(encoding="utf-8")).items():
        image = parse_image((folder / f"out{name}.jpg").read_bytes())
        X, xy, C = (np.array(known[key]) for key in ("world_points", "image_points", "camera_position"))
        yield HallPicture(f"camera {name}", image, X * AXES, xy, C * AXES)
