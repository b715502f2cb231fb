"""Boxes in JSON: SoccerNet's game state, and COCO's datasets and lists of detections."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from fieldcalib.io.boxes.rows import WITH_SIZE, BoxRow, BoxTable, box_of
from fieldcalib.io.files import BrokenFileError, parse_json

EDGES = ("bb_left", "bb_top", "bb_width", "bb_height")
GAME_STATE = ("id", "image_id", "track_id", "role", "jersey", "team", *EDGES)
COCO = ("id", "image_id", "track_id", "category", "score", *EDGES)


def json_boxes(path: Path, content: bytes) -> BoxTable:
    """The boxes of JSON of one of these kinds.

    Raises
    ------
    BrokenFileError
        If it is none.
    """
    record = parse_json(content)
    if isinstance(record, list):  # COCO's detections
        return BoxTable(COCO, _rows(path, record, lambda one: _coco_row(one, {}, {})))
    if not isinstance(record, dict):
        raise BrokenFileError(f"expected a JSON object or a list of boxes, got {type(record).__name__}")
    found = record.get("predictions", record.get("annotations"))
    if not isinstance(found, list):
        raise BrokenFileError(
            "expected the key 'predictions' or 'annotations' with a list, as in a game state of SoccerNet and in COCO, "
            "or a list of COCO's detections"
        )
    if any(isinstance(one, dict) and "bbox" in one for one in found):
        images, categories = _names(record, "images", "id", "file_name"), _names(record, "categories", "id", "name")
        return BoxTable(COCO, _rows(path, found, lambda one: _coco_row(one, images, categories)))
    images = _names(record, "images", "image_id", "file_name")
    return BoxTable(GAME_STATE, _rows(path, found, lambda one: _game_state_row(one, images)))


def _names(record: Mapping[str, Any], key: str, id: str, name: str) -> dict[str, str]:
    listed = record.get(key) or []
    if not isinstance(listed, list):
        raise BrokenFileError(f"expected a list for the key {key!r}, got {type(listed).__name__}")
    return {str(one[id]): str(one[name]) for one in listed if isinstance(one, dict) and id in one and name in one}


def _rows(path: Path, found: list[Any], row_of: Callable[[Mapping[str, Any]], BoxRow | None]) -> Iterator[BoxRow]:
    for number, one in enumerate(found):
        if not isinstance(one, dict):
            raise BrokenFileError(f"{path}, entry {number}: expected an object, got {type(one).__name__}")
        try:
            row = row_of(one)
        except (KeyError, TypeError, AttributeError) as error:
            raise BrokenFileError(f"{path}, entry {number}: is no box with an image: {error}") from None
        except BrokenFileError as error:
            raise BrokenFileError(f"{path}, entry {number}: {error}") from None
        if row is not None:
            yield row


def _game_state_row(one: Mapping[str, Any], images: Mapping[str, str]) -> BoxRow | None:
    if "bbox_image" not in one:  # lines and cameras
        return None
    numbers = [one["bbox_image"][key] for key in ("x", "y", "w", "h")]
    image, attributes = str(one["image_id"]), one.get("attributes") or {}
    said = [one.get("id"), image, one.get("track_id"), *(attributes.get(k) for k in ("role", "jersey", "team"))]
    # "3021000012": part and number of the video, then the frame
    frame = images.get(image) or (image[-6:] if re.fullmatch(r"\d{10}", image) else image)
    return BoxRow(frame, box_of(numbers, WITH_SIZE), [*_cells(said), *map(str, numbers)])


def _coco_row(one: Mapping[str, Any], images: Mapping[str, str], categories: Mapping[str, str]) -> BoxRow | None:
    if "bbox" not in one:  # masks and key points alone
        return None
    numbers, image, category = list(one["bbox"]), str(one["image_id"]), one.get("category_id")
    if len(numbers) != 4:
        raise BrokenFileError(f"expected four numbers in bbox ({WITH_SIZE.numbers}), got {len(numbers)}")
    said = [one.get("id"), image, one.get("track_id"), categories.get(str(category), category), one.get("score")]
    return BoxRow(images.get(image, image), box_of(numbers, WITH_SIZE), [*_cells(said), *map(str, numbers)])


def _cells(values: list[Any]) -> list[str]:
    return ["" if value is None else str(value) for value in values]
