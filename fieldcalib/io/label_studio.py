"""Label Studio's JSON: vectors, polygons and key points of many images, in percent of their width and height.

The percents count from the corner of the image: the centre of the first pixel is at 50 / width and 50 / height.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any
from urllib.parse import parse_qs, quote, unquote, urlsplit

import numpy as np

import fieldcalib
from fieldcalib.io.annotations import Annotation, Shapes, annotation_of, checked_size, exported, member
from fieldcalib.io.files import BrokenFileError, parse_json

PERCENT = 100.0
LABELS = ("vectorlabels", "polygonlabels", "keypointlabels", "labels")  # keys of a region's labels
UPLOADED = re.compile(r"[0-9a-f]{8}-")  # prefix that Label Studio adds to the name of an uploaded image
LOCAL_FILES = "/data/local-files/?d="  # URL of images in Label Studio's local storage


def parse_label_studio(content: bytes | str) -> list[Annotation]:
    """The annotations of all tasks of an export ("JSON"), or of one task.

    Of several annotations of a task, the one that is marked as ground truth is taken, or else the last that was not
    skipped; where there is none, the last prediction. Regions that are no vectors, polygons or key points are left
    out. An image without regions has no size.

    Raises
    ------
    BrokenFileError
        If it is no JSON of tasks. What is wrong with one image is in its annotation.
    """
    tasks = parse_json(content)
    annotations = []
    for number, task in enumerate(tasks if isinstance(tasks, list) else [tasks], 1):
        what = f"task {number}"
        if not isinstance(task, dict) or not isinstance(task.get("data"), dict):
            raise BrokenFileError(f"{what}: expected an object with 'data': export as JSON, not as JSON-MIN")
        annotations.append(annotation_of(_image(task), partial(_shapes, task), what))
    if not annotations:
        raise BrokenFileError("holds no tasks")
    return annotations


def _image(task: Mapping[str, Any]) -> str | None:
    """Path of the image of a task."""
    data = task["data"]
    url = data.get("image") or next((value for value in data.values() if isinstance(value, str)), None)
    if not isinstance(url, str):
        return None
    if url.startswith("data:"):  # the image itself
        return f"task-{task.get('id')}"
    path = _path(url) if "://" in url or url.startswith("/") else url
    if "/data/upload/" in path:
        folder, _, name = path.rpartition("/")
        path = f"{folder}/{UPLOADED.sub('', name, count=1)}"
    return path


def _path(url: str) -> str:
    """Path of an image in a URL; Label Studio's local storage has it in the query."""
    try:
        parts = urlsplit(url)
        local = parse_qs(parts.query).get("d") if "local-files" in parts.path else None
    except ValueError:
        return url
    return local[0] if local else unquote(parts.path)


def _shapes(task: Mapping[str, Any]) -> Shapes:
    shapes = Shapes(None, {}, {})
    for region in _regions(task):
        if not isinstance(region, dict):
            raise BrokenFileError(f"expected a list of regions, got {type(region).__name__} in it")
        value = region.get("value")
        if not isinstance(value, dict):  # a relation
            continue
        names = next((value[key] for key in LABELS if value.get(key)), None)
        points = _points(value)
        if names is None:  # with tags such as Polygon and Labels, the labels are in another entry of the same region
            continue
        if not isinstance(names, list):
            raise BrokenFileError(f"expected a list of labels, got {names!r}")
        if points is None:
            for name in names:
                shapes.leave_out(region.get("type", "region"), name)
            continue
        size = checked_size(region.get("original_width"), region.get("original_height"))
        if region.get("image_rotation"):
            raise BrokenFileError("the image was rotated in Label Studio: its pixels are not those of the file")
        if shapes.image_size not in (None, size):
            raise BrokenFileError(f"its regions are of images of {shapes.image_size} and {size}")
        shapes.image_size = size
        for name in names:
            shapes.add(name, _in_pixels(name, points, size))
    return shapes


def _regions(task: Mapping[str, Any]) -> list[Any]:
    what = "the task"
    made = [
        one
        for one in member({"annotations": [], **task}, "annotations", list, what)
        if isinstance(one, dict) and not one.get("was_cancelled")
    ]
    chosen = [one for one in made if one.get("ground_truth")] or made
    predicted = member({**task, "predictions": task.get("predictions") or []}, "predictions", list, what)
    chosen = chosen or [one for one in predicted if isinstance(one, dict)]
    return list(member(chosen[-1], "result", list, what)) if chosen else []


def _points(value: Mapping[str, Any]) -> list[Any] | None:
    """Points of a region in percent, None if it has none."""
    if isinstance(value.get("vertices"), list):
        return [(v.get("x"), v.get("y")) if isinstance(v, dict) else v for v in value["vertices"]]
    if isinstance(value.get("points"), list):
        return list(value["points"])
    is_point = "x" in value and "y" in value and not {"height", "radiusX", "rle"} & value.keys()
    return [(value["x"], value["y"])] if is_point else None


def _in_pixels(name: Any, points: list[Any], size: tuple[int, int]) -> Any:
    try:
        return np.array([(float(x), float(y)) for x, y in points]).reshape(-1, 2) * size / PERCENT
    except (TypeError, ValueError, OverflowError):
        raise BrokenFileError(f"{name!r}: expected points (x, y) in percent") from None


def format_label_studio(annotations: Iterable[Annotation]) -> str:
    """The JSON of tasks with predictions, to be imported and corrected: the inverse of `parse_label_studio`.

    Lines are regions of a ``VectorLabels`` tag named "lines", single points of a ``KeyPointLabels`` tag named
    "points", both of an ``Image`` tag named "image".

    Raises
    ------
    ValueError
        As `exported`.

    Examples
    --------
    >>> text = format_label_studio([Annotation("1", {"Middle line": [(9.5, 20.0), (9.5, 40.0)]}, (100, 50), "1.jpg")])
    >>> json.loads(text)[0]["predictions"][0]["result"][0]["value"]["vertices"][0]
    {'x': 10.0, 'y': 41.0, 'id': '1-0', 'prevPointId': None, 'isBezier': False}
    """
    tasks = []
    for image, size, shapes in map(exported, annotations):
        regions = [
            _region(str(number), label, np.array(points), size) for number, (label, points) in enumerate(shapes, 1)
        ]
        prediction = {"model_version": f"fieldcalib {fieldcalib.__version__}", "result": regions}
        data = {"image": LOCAL_FILES + quote(image)}
        tasks.append({"data": data, "predictions": [prediction]})
    return json.dumps(tasks, indent=1) + "\n"


def _region(id: str, label: str, points: Any, size: tuple[int, int]) -> dict[str, Any]:
    percents = (points * PERCENT / size).tolist()
    region: dict[str, Any] = {"id": id, "to_name": "image"}
    region |= {"original_width": size[0], "original_height": size[1], "image_rotation": 0}
    if len(percents) == 1:
        ((x, y),) = percents
        value: dict[str, Any] = {"x": x, "y": y, "width": 0.5, "keypointlabels": [label]}
        return region | {"type": "keypointlabels", "from_name": "points", "value": value}
    vertices = [
        {"x": x, "y": y, "id": f"{id}-{k}", "prevPointId": f"{id}-{k - 1}" if k else None, "isBezier": False}
        for k, (x, y) in enumerate(percents)
    ]
    value = {"vertices": vertices, "closed": False, "vectorlabels": [label]}
    return region | {"type": "vectorlabels", "from_name": "lines", "value": value}
