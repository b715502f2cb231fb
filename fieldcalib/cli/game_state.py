"""`fieldcalib project` of SoccerNet's game state: the same file with the place of each player on the pitch."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.frame_cameras import Cameras
from fieldcalib.io.boxes import Box, open_boxes
from fieldcalib.io.coordinates import OWN
from fieldcalib.io.files import parse_json_object, read_regular_file, write_text

PLACES = {"left": (1.0, 0.0), "right": (0.0, 1.0), "middle": (0.5, 0.5)}  # shares of the lower edge's ends


def write_game_state(options: argparse.Namespace, cameras: Cameras, offset: int) -> tuple[int, int]:
    """Write the file of boxes with `bbox_pitch` for each of them, null where there is no point.

    Returns
    -------
    (int, int)
        Number of boxes, and of those that have one now.

    Raises
    ------
    ValueError
        If the boxes are in no such file, or another system is asked for: its coordinates are SoccerNet's.
    """
    if options.boxes.suffix.lower() != ".json" or options.to not in OWN:
        raise ValueError(f"{options.out} would be a game state: of JSON, and with --to {OWN[1]}; tables end with .csv")
    with open_boxes(options.boxes, options.most_bytes) as table:
        rows = list(table.rows)
    record = parse_json_object(read_regular_file(options.boxes, options.most_bytes), "predictions or annotations")
    found = record.get("predictions", record.get("annotations", []))
    places = []
    for entry, row in zip((one for one in found if "bbox_image" in one), rows, strict=True):
        calibration = cameras.of(row.frame, offset)
        entry["bbox_pitch"] = _on_pitch(calibration, row.box, options.size, keep_rejected=options.keep_rejected)
        places.append(entry["bbox_pitch"])
    write_text(options.out, json.dumps(record))
    return len(places), sum(place is not None for place in places)


def _on_pitch(
    calibration: Calibration | None, box: Box | None, size: tuple[int, int] | None, *, keep_rejected: bool
) -> Mapping[str, float] | None:
    """The lower edge of a box on the pitch, None where it has no place."""
    if box is None or calibration is None or calibration.camera is None:
        return None
    if not (calibration.accepted or keep_rejected):
        return None
    camera = calibration.camera
    left, _, right, bottom = np.array(box) * np.tile(np.divide(camera.image_size, size or camera.image_size), 2)
    # boxes count from the corner of the first pixel, as in `fieldcalib.io.boxes.foot_points`
    ends: Array = np.array([[left, bottom], [right, bottom]]) - 0.5
    X = camera.image_to_field(np.array(list(PLACES.values())) @ ends)
    if not np.isfinite(X).all():
        return None
    values: dict[str, Any] = {}
    for place, (x, y, _) in zip(PLACES, X.tolist(), strict=True):
        values |= {f"x_bottom_{place}": x, f"y_bottom_{place}": y}
    return values
