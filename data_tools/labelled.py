"""Real frames with cameras: results of fieldcalib, or hand-labelled field points, up to 32 of them, each with an index.

Results are a folder that `fieldcalib open`, `calibrate` or `run` wrote. Pictures with the verdict "good" are taken, if
they lie where they were then.

The layout of labelled points is that of the pitch keypoints from Roboflow's Universe:
``<clip>_<frame>_png_jpg.rf.<hash>.jpg``, squashed from 16:9 to a square, beside a ``.txt`` with one line
``0 cx cy w h  x0 y0 v0  x1 y1 v1 ...``, normalised, v = 2 for visible points. The field is 105 x 68 m; a JSON next to
the folder holds the position of each index, in metres from the far left corner.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.findings import Verdict
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.results import lines_file
from fieldcalib.results.entry import read
from fieldcalib.solve.from_points import calibrate_from_points
from fieldcalib.solve.solver_options import DEFAULT_FLAGS

POINTS_FILE = "keypoints_105x68.json"
MISPLACED = (4, 5, 16, 28, 29, 30, 31)  # often labelled at the border of the frame or elsewhere: not used
VISIBLE = 2
SIZE = (960, 540)  # px; any size with the aspect ratio of the original picture
LEAST_POINTS = 6  # enough for a camera with a lens and one outlier
LARGEST_MEDIAN = 2.0  # px of `SIZE`: above it, the field has another size or labels are wrong


@dataclass(frozen=True)
class LabelledFrame:
    """A picture and the camera calibrated from its labelled points."""

    image: Path
    camera: Camera
    """Camera for an image of the aspect ratio of the original picture."""
    clip: str
    """Name of the clip that it was taken from."""
    field: Field


def clip_of(image: Path) -> str:
    """The clip that a frame was taken from.

    Examples
    --------
    >>> clip_of(Path("08fd33_4_12_png_jpg.rf.7069.jpg"))
    '08fd33_4'
    """
    return image.name.split("_png_jpg")[0].split("_jpg")[0].rpartition("_")[0]


def labelled_frames(folder: Path) -> Iterator[LabelledFrame]:
    """The frames of a folder of results that are good, or whose labelled points give an accepted camera, in order.

    Raises
    ------
    ValueError
        If there is no picture in it.
    """
    if is_results(folder):
        yield from _results(folder)
        return
    if not any(folder.glob("*.jpg")):
        raise ValueError(f"{folder}: expected results of fieldcalib open, or *.jpg with labelled points beside them")
    for image in sorted(folder.glob("*.jpg")):
        camera = _camera(*labelled_points(image))
        if camera is not None:
            yield LabelledFrame(image, camera, clip_of(image), soccer())


def is_results(folder: Path) -> bool:
    """Whether a folder holds results of fieldcalib."""
    return lines_file(folder).is_file()


def _results(folder: Path) -> Iterator[LabelledFrame]:
    """The good pictures of a folder of results, each a clip of its own."""
    results = read(folder)
    for file in results.pictures.files:
        if results.verdicts.get(file.id) is not Verdict.GOOD:
            continue
        found = results[file.id]
        if found.camera is None or found.field is None:
            continue
        if file.path.suffix == ".zip" or not file.path.is_file():
            raise ValueError(f"{folder}: its picture {file.path} is not there as a file of its own")
        yield LabelledFrame(file.path, found.camera, file.id, found.field)


def labelled_points(image: Path) -> tuple[Array, Array]:
    """Visible field points X (N, 3) and their pixels (N, 2), as shares of the image's width and height.

    Points of `MISPLACED` are left out.
    """
    places = json.loads((image.parent.parent / POINTS_FILE).read_text())
    half = np.array([soccer().length, soccer().width]) / 2.0
    X = np.array([[*(np.array(places[str(index)]) - half), 0.0] for index in range(len(places))])
    line = np.array(image.with_suffix(".txt").read_text().split(), dtype=float)
    points = line[5:].reshape(-1, 3)
    use = points[:, 2] == VISIBLE
    use[list(MISPLACED)] = False
    return X[use], points[use, :2]


def _camera(X: Array, shares: Array) -> Camera | None:
    """The camera calibrated from labelled points; the robust loss rejects outliers."""
    if len(X) < LEAST_POINTS:
        return None
    found = calibrate_from_points(X, shares * SIZE, SIZE, flags=DEFAULT_FLAGS)
    errors = list(found.per_segment_errors.values())
    return found.camera if found.accepted and np.median(errors) < LARGEST_MEDIAN else None
