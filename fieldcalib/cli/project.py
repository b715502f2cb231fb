"""`fieldcalib project`: boxes of players to metres on the field, with their errors.

`fieldcalib project` of SoccerNet's game state: the same file with the place of each player on the pitch.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as attribute
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from fieldcalib._progress import say, show
from fieldcalib._types import Array
from fieldcalib._whole_files import whole_file, write_text
from fieldcalib.assess.estimate import CENTRE_MARK, PIXEL_SD
from fieldcalib.assess.ground_points import locate_on_ground
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.frame_cameras import Cameras
from fieldcalib.console.arguments import add_cameras_and_out, add_most_bytes, image_size, number
from fieldcalib.console.options import add_options, given, option, switch
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.boxes import GAME_STATE, KINDS, Box, BoxRow, foot_points, open_boxes
from fieldcalib.io.coordinates import OWN_SYSTEMS, SYSTEMS, scale_of_system, to_system
from fieldcalib.io.files import parse_json_object, read_regular_file
from fieldcalib.io.image_files import in_parts
from fieldcalib.io.output_folder import check_targets
from fieldcalib.io.players import POINT, SYSTEM
from fieldcalib.solve.origin_and_unit import hint_of_another_size

# weights of the left and right end of a box's lower edge
PLACES = {"left": (1.0, 0.0), "right": (0.0, 1.0), "middle": (0.5, 0.5)}

FROM_CENTRE = ("field_x_sd_from_centre", "field_y_sd_from_centre")
NUMBERS = (*POINT, "field_x_sd", "field_y_sd", "field_correlation", *FROM_CENTRE)
COLUMNS = (*NUMBERS, SYSTEM, "problem")
NO_CAMERA, REJECTED, NO_BOX = "no camera", "camera rejected", "no box"
HORIZON, NO_RAY = "above the horizon", "outside the lens"
OFF_PITCH, CUT = "off the pitch", "cut by the image"
EDGE = 1.0  # px from the lower edge of the image, within which a box is cut by it
LEAST_BOXES = 100  # that show by how far they reach whether they are of images of another size
ROWS_AT_ONCE = 10_000  # of a frame


def _noise(text: str) -> float:
    return number(text, lambda value: 0.0 <= value < np.inf, "a number of pixels, 0 or more")


@dataclass(frozen=True)
class Projection:
    """Boxes and cameras of a projection, and its options."""

    boxes: Path
    cameras: Cameras
    most_bytes: float
    system: str = option(
        f"coordinates: {', '.join(SYSTEMS)} ({OWN_SYSTEMS[0]})", name="--to", default=OWN_SYSTEMS[0], metavar="SYSTEM"
    )
    size: tuple[int, int] | None = option(
        "of the images that boxes are in pixels of (as the cameras')", type=image_size, metavar="WxH"
    )
    frame_offset: int | None = option(
        "added to the numbers of frames: -1 where boxes count from 1 and cameras from 0 (0)", type=int, metavar="N"
    )
    box_noise: float = option(
        f"standard deviation of the foot point in the image, pixels of the boxes; 0: they are exact ({PIXEL_SD:g})",
        default=PIXEL_SD,
        type=_noise,
        metavar="PX",
    )
    keep_rejected: bool = switch('use cameras whose verdict is "reject" too')

    def calibration(self, frame: str) -> Calibration | None:
        """The calibration of a frame as the boxes call it."""
        return self.cameras.of(frame, self.frame_offset or 0)

    def uses(self, calibration: Calibration) -> bool:
        """Whether points are computed by a calibration."""
        return calibration.accepted or self.keep_rejected

    def scale(self, image_size: tuple[int, int], *, is_relative: bool = False) -> Array:
        """Pixels of the camera's image for the unit of the boxes, along x and y: a pixel, or the whole image."""
        return np.asarray(image_size, dtype=float) if is_relative else np.divide(image_size, self.size or image_size)


def write_game_state(projection: Projection, out: Path) -> tuple[int, int]:
    """Write the file of boxes with `bbox_pitch` for each of them, null where there is no point.

    Returns
    -------
    (int, int)
        Number of boxes, and of those that have a point now.

    Raises
    ------
    ValueError
        If the boxes are in no such file, or another system is asked for: its coordinates are SoccerNet's.
    """
    boxes, most_bytes = projection.boxes, projection.most_bytes
    if boxes.suffix.lower() != ".json" or projection.system not in OWN_SYSTEMS:
        raise ValueError(f"{out} would be a game state: of JSON, and with --to {OWN_SYSTEMS[1]}; tables end with .csv")
    with open_boxes(boxes, most_bytes) as table:
        if table.columns != GAME_STATE:
            raise ValueError(f"{out} would be a game state, and {boxes} is none: tables end with .csv")
        rows = list(table.rows)
    record = parse_json_object(read_regular_file(boxes, most_bytes), "predictions or annotations")
    found = record.get("predictions", record.get("annotations", []))
    places = []
    for entry, row in zip((one for one in found if "bbox_image" in one), rows, strict=True):
        entry["bbox_pitch"] = _on_pitch(projection, projection.calibration(row.frame), row.box)
        places.append(entry["bbox_pitch"])
    write_text(out, json.dumps(record))
    return len(places), sum(place is not None for place in places)


def _on_pitch(projection: Projection, calibration: Calibration | None, box: Box | None) -> Mapping[str, float] | None:
    """The lower edge of a box on the pitch, None where it has no place."""
    if box is None or calibration is None or calibration.camera is None or not projection.uses(calibration):
        return None
    camera = calibration.camera
    left, _, right, bottom = np.array(box) * np.tile(projection.scale(camera.image_size), 2)
    # boxes count from the corner of the first pixel, as in `fieldcalib.io.boxes.foot_points`
    ends: Array = np.array([[left, bottom], [right, bottom]]) - 0.5
    X = calibration.image_to_field(np.array(list(PLACES.values())) @ ends)
    if not np.isfinite(X).all():
        return None
    values: dict[str, Any] = {}
    for place, (x, y, _) in zip(PLACES, X.tolist(), strict=True):
        values |= {f"x_bottom_{place}": x, f"y_bottom_{place}": y}
    return values


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Boxes of players, or pixels of feet and balls, to points on the field with their standard deviations: a table "
        "(CSV). Columns of a table of boxes are frame, and x, y, width, height or x1, y1, x2, y2; of points frame, x "
        f"and y. They come back with {', '.join(COLUMNS)}."
    )
    parser.add_argument("boxes", type=Path, metavar="BOXES", help=KINDS)
    written = "the table with the points, CSV; of game state JSON also .json, with bbox_pitch"
    add_cameras_and_out(parser, "FILE", written)
    add_options(parser, Projection)
    add_most_bytes(parser, files="files of JSON")


def run(options: argparse.Namespace) -> int:
    """Project; returns the exit code."""
    to_system((0.0, 0.0), options.system, soccer())  # before anything is read
    cameras = Cameras(options.cameras)
    check_targets([options.out], [options.boxes, *cameras.files], replaces=True)
    projection = given(Projection, options, cameras=cameras)
    if options.out.suffix.lower() == ".json":
        count, placed = write_game_state(projection, options.out)
        show(f"{count} rows in {options.out}, {placed} on the pitch")
        return 0
    extents: dict[tuple[int, int], Extent] = {}
    problems = _write_table(projection, options.out, extents)
    total = problems.total()
    said = ", ".join(f"{count} {problem}" for problem, count in problems.most_common() if problem)
    rows = "1 row" if total == 1 else f"{total} rows"  # of boxes or of points
    show(f"{rows} in {options.out}{': ' * bool(said)}{said}")
    for size, extent in extents.items():
        hint = hint_of_another_size(extent.farthest, extent.count, size)
        if size != (1, 1) and np.all(extent.farthest <= 1.0):
            say("all boxes lie within 0..1: if they are shares of the picture, --size 1x1 says so")
        elif hint and extent.count >= LEAST_BOXES:
            say(f"the boxes {hint} --size says of which they are, 1x1 for shares")
    return 0


def _write_table(projection: Projection, out: Path, extents: dict[tuple[int, int], Extent]) -> Counter[str]:
    """Write the table with the points; counts the problems, and adds how far boxes of images of a size reach."""
    boxes, cameras = projection.boxes, projection.cameras
    problems: Counter[str] = Counter()
    with open_boxes(boxes, projection.most_bytes) as table:
        if projection.frame_offset is None and table.counts_from_1 and cameras.first == 0:
            raise ValueError(
                f"frames of {table.counts_from_1} count from 1, those in {cameras.path} from 0: --frame-offset -1 "
                f"makes frame 1 the first one, --frame-offset 0 takes the numbers as they are"
            )
        taken = [name for name in COLUMNS if name in table.columns]
        relative = table.is_relative
        if taken:
            raise ValueError(f"{boxes} has the column {taken[0]!r} already: is it a table that this command wrote?")
        with whole_file(out) as file, io.TextIOWrapper(file, "utf-8", "backslashreplace", "") as text:
            writer = csv.writer(text, lineterminator="\n")
            writer.writerow([*table.columns, *COLUMNS])
            for frame, rows in groupby(table.rows, key=lambda row: row.frame):
                found = projection.calibration(frame)
                size = projection.size or (found and found.camera and found.camera.image_size)
                for part in in_parts(rows, ROWS_AT_ONCE):
                    if size and not relative:
                        extents.setdefault(size, Extent()).add([row.box for row in part if row.box is not None])
                    for row, cells in zip(part, _projected(part, found, projection, is_relative=relative), strict=True):
                        problems.update([cells[-1]])
                        writer.writerow([*row.values, *cells])
            if problems and set(problems) == {NO_CAMERA}:
                is_there = cameras.id_of(frame, projection.frame_offset or 0) is not None
                why = "its frames were refused or not read" if is_there else cameras.naming_hint(frame)
                raise ValueError(f"no frame of {boxes} has a camera in {cameras.path}: {why}")
    return problems


@dataclass
class Extent:
    """Largest right and lower edges of boxes."""

    farthest: Array = attribute(default_factory=lambda: np.zeros(2))
    count: int = 0

    def add(self, boxes: Sequence[Box]) -> None:
        """Include more boxes."""
        self.count += len(boxes)
        self.farthest = np.array([self.farthest, *(box[2:] for box in boxes)]).max(axis=0)


def _projected(
    rows: Sequence[BoxRow], calibration: Calibration | None, projection: Projection, *, is_relative: bool
) -> Iterator[list[str]]:
    """The cells of `COLUMNS` for the boxes of a frame."""
    rejected = calibration is not None and not projection.uses(calibration)
    if calibration is None or calibration.camera is None or rejected:
        for row in rows:
            yield _cells(projection.system, NO_BOX if row.box is None else REJECTED if rejected else NO_CAMERA)
        return
    camera, field = calibration.camera, calibration.field or soccer()
    scale = projection.scale(camera.image_size, is_relative=is_relative)
    boxes = np.array([row.box or (np.nan,) * 4 for row in rows]) * np.tile(scale, 2)
    xy = foot_points(boxes)
    noise = projection.box_noise * float(projection.scale(camera.image_size).mean())
    found = locate_on_ground(calibration, xy, pixel_sd=noise)
    points = to_system(found.X, projection.system, field)
    stretch = scale_of_system(found.X, projection.system, field)
    from_centre = locate_on_ground(calibration, xy, pixel_sd=noise, relative_to=CENTRE_MARK)
    deviations, others = (np.abs(stretch) * of.standard_deviations for of in (found, from_centre))
    correlations = np.prod(np.sign(stretch), axis=-1) * found.correlation
    is_off = np.asarray(np.any(np.abs(found.X[:, :2]) > (field.length / 2.0, field.width / 2.0), axis=-1))
    is_off &= not any(label.startswith("Net") for label in field)  # beside a net one plays behind the lines too
    is_cut = (boxes[:, 3] > camera.image_size[1] - EDGE) & (boxes[:, 1] < boxes[:, 3])
    has_ray = np.asarray(np.isfinite(camera.normalized(xy)).all(axis=-1))
    numbers = np.column_stack([points, deviations, correlations, others])
    for row, cells, ray, off, cut in zip(rows, numbers, has_ray, is_off, is_cut, strict=True):
        if row.box is None:
            yield _cells(projection.system, NO_BOX)
        elif np.isnan(cells[0]):
            yield _cells(projection.system, HORIZON if ray else NO_RAY)
        else:
            problem = "; ".join(text for text, has in ((OFF_PITCH, off), (CUT, cut)) if has)
            yield _cells(projection.system, problem, *cells)


def _cells(system: str, problem: str, *numbers: float) -> list[str]:
    """Cells of a row; unknown numbers are empty."""
    texts = ["" if np.isnan(number) else f"{number:.6f}" for number in numbers]
    return [*texts, *[""] * (len(NUMBERS) - len(texts)), system, problem]
