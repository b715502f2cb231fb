"""labelme's JSON, one file per image: lines, line strips, polygons and points.

Its coordinates count from the corner of the image: the centre of the first pixel is at (0.5, 0.5).
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import partial
from typing import Any

from fieldcalib.io.annotations import Annotation, Shapes, annotation_of, exported, member
from fieldcalib.io.files import BrokenFileError, parse_json_object

READ = ("line", "linestrip", "polygon", "point", "points")


def parse_labelme(content: bytes | str) -> list[Annotation]:
    """The annotation of a file, in a list as those of other formats.

    Rectangles, circles and masks are left out.

    Raises
    ------
    BrokenFileError
        If it is no JSON object. What else is wrong is in the annotation.
    """
    record = parse_json_object(content, "labelme's shapes")
    return [annotation_of(record.get("imagePath"), partial(_shapes, record), "imagePath")]


def _shapes(record: dict[str, Any]) -> Shapes:
    shapes = Shapes.of(record.get("imageWidth"), record.get("imageHeight"))
    for shape in member(record, "shapes", list, "the file"):
        if not isinstance(shape, dict):
            raise BrokenFileError(f"expected a list of shapes, got {type(shape).__name__} in it")
        label, kind = shape.get("label"), shape.get("shape_type") or "polygon"  # as of old versions
        if kind in READ:
            shapes.add(label, member(shape, "points", list, repr(label)))
        else:
            shapes.leave_out(kind, label)
    return shapes


def format_labelme(annotations: Iterable[Annotation]) -> str:
    """The JSON of one annotation: the inverse of `parse_labelme`, line strips and single points.

    Raises
    ------
    ValueError
        As `exported`, or if there is not just one annotation.

    Examples
    --------
    >>> text = format_labelme([Annotation("1", {"Middle line": [(10.0, 20.0), (10.5, 40.0)]}, (96, 54), "1.jpg")])
    >>> json.loads(text)["shapes"][0]["points"]
    [[10.5, 20.5], [11.0, 40.5]]
    """
    ((image, (width, height), written),) = map(exported, annotations)
    shapes: list[dict[str, Any]] = [
        {
            "label": label,
            "points": points,
            "group_id": None,
            "description": "",
            "shape_type": "linestrip" if len(points) > 1 else "point",
            "flags": {},
            "mask": None,
        }
        for label, points in written
    ]
    record: dict[str, Any] = {"version": "5.0.0", "flags": {}, "shapes": shapes}
    record |= {"imagePath": image, "imageData": None}
    record |= {"imageHeight": height, "imageWidth": width}
    return json.dumps(record, indent=2) + "\n"
