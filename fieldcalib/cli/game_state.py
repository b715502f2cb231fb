"""`fieldcalib project` of SoccerNet's game state: the same file with the place of each player on the pitch."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.frame_cameras import Cameras
from fieldcalib.console.arguments import image_size, number
from fieldcalib.console.options import option, switch
from fieldcalib.io.boxes import GAME_STATE, Box, open_boxes
from fieldcalib.io.coordinates import OWN_SYSTEMS
from fieldcalib.io.files import parse_json_object, read_regular_file, write_text

# weights of the left and right end of a box's lower edge
PLACES = {"left": (1.0, 0.0), "right": (0.0, 1.0), "middle": (0.5, 0.5)}


def _noise(text: str) -> float:
    return number(text, lambda value: 0.0 <= value < np.inf, "a number of pixels, 0 or more")


@dataclass(frozen=True)
class Projection:
    """Boxes and cameras of a projection, and its options."""

    boxes: Path
    cameras: Cameras
    most_bytes: float
    system: str = option(
        f"coordinates: {', '.join(OWN_SYSTEMS)}, or those of kloppy: skillcorner, tracab, statsbomb, opta, ... "
        f"({OWN_SYSTEMS[0]})",
        name="--to",
        default=OWN_SYSTEMS[0],
        metavar="SYSTEM",
    )
    size: tuple[int, int] | None = option(
        "of the images that boxes are in pixels of (as the cameras')", type=image_size, metavar="WxH"
    )
    frame_offset: int | None = option(
        "added to the numbers of frames: -1 where boxes count from 1 and cameras from 0 (0)", type=int, metavar="N"
    )
    box_noise: float = option(
        "standard deviation of the foot point in the image, pixels of the boxes (0: errors of the camera alone)",
        default=0.0,
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
    X = camera.image_to_field(np.array(list(PLACES.values())) @ ends)
    if not np.isfinite(X).all():
        return None
    values: dict[str, Any] = {}
    for place, (x, y, _) in zip(PLACES, X.tolist(), strict=True):
        values |= {f"x_bottom_{place}": x, f"y_bottom_{place}": y}
    return values
