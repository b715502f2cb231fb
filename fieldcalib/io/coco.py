"""COCO's JSON: segmentations and key points of many images, by category.

The coordinates of a segmentation count from the corner of the image, the centre of the first pixel is at (0.5, 0.5);
key points are indices of pixels, the first one is at (0, 0).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from fieldcalib._types import Array
from fieldcalib.io.annotations import Annotation, Shapes, annotation_of, exported, member
from fieldcalib.io.files import BrokenFileError, parse_json_object

LEAST_POINTS = 3  # of a polygon: other readers refuse fewer


def parse_coco(content: bytes | str) -> list[Annotation]:
    """The annotations of all images of a file.

    The lists of a segmentation are points of its category, without repeated neighbours. The label of a key point is its
    own name, or that of the category if this does not name its key points. Masks (RLE) and boxes are left out.

    Raises
    ------
    BrokenFileError
        If it is no JSON object with images, annotations and categories. What is wrong with one image is in its
        annotation.
    """
    record = parse_json_object(content, "images, annotations and categories")
    images, made, categories = (
        member(record, key, list, "the file") for key in ("images", "annotations", "categories")
    )
    if not images:
        raise BrokenFileError("holds no images")
    by_category = _by_id(categories, "categories")
    by_image: dict[Any, list[Any]] = {id: [] for id in _by_id(images, "images")}
    for one in made:
        id = one.get("image_id") if isinstance(one, dict) else None
        if not _is_id(id) or id not in by_image:
            raise BrokenFileError(f"annotations: expected the image_id of one of the images, got {id!r}")
        by_image[id].append(one)
    return [
        annotation_of(
            image.get("file_name"), partial(_shapes, image, by_image[image["id"]], by_category), f"image {image['id']}"
        )
        for image in images
    ]


def _by_id(records: list[Any], what: str) -> dict[Any, Any]:
    found: dict[Any, Any] = {}
    for one in records:
        id = one.get("id") if isinstance(one, dict) else None
        if not _is_id(id) or id in found:
            raise BrokenFileError(f"{what}: expected objects with an id of their own, got {id!r}")
        found[id] = one
    return found


def _is_id(id: Any) -> bool:
    return isinstance(id, int | str)


def _shapes(image: Mapping[str, Any], made: list[Any], categories: Mapping[Any, Any]) -> Shapes:
    shapes = Shapes.of(image.get("width"), image.get("height"))
    for one in made:
        category = categories.get(one["category_id"]) if _is_id(one.get("category_id")) else None
        if category is None:
            raise BrokenFileError(f"expected the category_id of one of the categories, got {one.get('category_id')!r}")
        label, parts, keypoints = category.get("name"), one.get("segmentation"), one.get("keypoints")
        lines = parts if isinstance(parts, list) else []
        for part in lines:
            shapes.add(label, _without_repeats(_rows(label, part, 2)))
        if keypoints and (category.get("keypoints") or not lines):
            for name, (x, y, visibility) in _named(label, category.get("keypoints"), _rows(label, keypoints, 3)):
                if visibility:  # 0: it is not labelled
                    shapes.add(name, [(x, y)], shift=0.0)
        elif not lines:
            shapes.leave_out("mask" if parts else "box", label)
    return shapes


def _rows(label: Any, numbers: Any, length: int) -> list[list[Any]]:
    if not isinstance(numbers, list) or len(numbers) % length:
        raise BrokenFileError(f"{label!r}: expected a list of {length} numbers for each point")
    return [numbers[k : k + length] for k in range(0, len(numbers), length)]


def _without_repeats(points: list[list[Any]]) -> list[list[Any]]:
    """The points of a polygon without those that equal the one before."""
    kept = [point for k, point in enumerate(points) if k == 0 or point != points[k - 1]]
    return kept[:-1] if len(kept) > 1 and kept[0] == kept[-1] else kept


def _named(label: Any, names: Any, points: list[list[Any]]) -> list[tuple[Any, list[Any]]]:
    if not names:
        return [(label, point) for point in points]
    if not isinstance(names, list) or len(names) != len(points):
        raise BrokenFileError(f"{label!r}: its category does not name its {len(points)} key points")
    return list(zip(names, points, strict=True))


def format_coco(annotations: Iterable[Annotation]) -> str:
    """The JSON of annotations: the inverse of `parse_coco`, each label a segmentation of its category.

    A segmentation is a polygon, which needs three points: of a label with one or two pixels some are repeated.

    Raises
    ------
    ValueError
        As `exported`.

    Examples
    --------
    >>> text = format_coco([Annotation("1", {"Middle line": [(10.0, 20.0), (10.5, 40.0)]}, (96, 54), "1.jpg")])
    >>> json.loads(text)["annotations"][0]["segmentation"]
    [[10.5, 20.5, 11.0, 40.5, 10.5, 20.5]]
    """
    images: list[dict[str, Any]] = []
    made: list[dict[str, Any]] = []
    categories: dict[str, int] = {}
    for number, (name, (width, height), shapes) in enumerate(map(exported, annotations), 1):
        images.append({"id": number, "file_name": name, "width": width, "height": height})
        for label, points in shapes:
            closed = np.array(points + points[:1] * max(LEAST_POINTS - len(points), 0))
            made.append(
                {
                    "id": len(made) + 1,
                    "image_id": number,
                    "category_id": categories.setdefault(label, len(categories) + 1),
                    "segmentation": [closed.ravel().tolist()],
                    "bbox": [*closed.min(axis=0).tolist(), *np.ptp(closed, axis=0).tolist()],
                    "area": _area(closed),
                    "iscrowd": 0,
                }
            )
    named = [{"id": id, "name": name, "supercategory": ""} for name, id in categories.items()]
    return json.dumps({"images": images, "annotations": made, "categories": named}) + "\n"


def _area(xy: Array) -> float:
    x, y = (xy - xy.mean(axis=0)).T
    return float(abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2.0)
