"""Pictures in which a network sees too little of a field: the field is searched for in their stripes instead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fieldcalib.assess.result import Calibration
from fieldcalib.images.court_search import search_courts
from fieldcalib.images.pictures import Method
from fieldcalib.io.image import Image
from fieldcalib.solve.task import Task

NOTE = "the network's labels gave no camera"


def with_second_opinion(
    calibrate: Method, task: Task, estimate_size: bool, images: Sequence[Image]
) -> list[Calibration]:
    """Calibrate pictures by a network; where its camera is refused, take the one that is found by search, if any."""
    found = calibrate(images)
    refused = [index for index, one in enumerate(found) if not one.accepted]
    searched = search_courts(task, [images[index] for index in refused], estimate_size=estimate_size)
    for index, one in zip(refused, searched, strict=True):
        if one.accepted:
            found[index] = replace(one, message=f"{NOTE}; {one.message}")
    return found


def may_be_searched(task: Task) -> bool:
    """Whether a field can be searched for: it has stands, and nothing of the camera is given."""
    field = task.field
    return field is not None and bool(field.stands or field.named_stands) and task.given.is_empty
