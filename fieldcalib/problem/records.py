"""A problem of one frame as JSON: pixels by label, layout, loss and prior."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from fieldcalib._json import from_json, to_json
from fieldcalib._types import Array
from fieldcalib.fields.segments import ROWS, EndRows, Rows
from fieldcalib.fields.traits import Crown
from fieldcalib.geometry.lens import LENSES
from fieldcalib.problem.evaluation import Problem
from fieldcalib.problem.layout import Layout, SizeBlock, ZoomLaw
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import Observations, packed
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.problem.prior import GaussianPrior

SIZES = ("given", "sigma", "limits", "probabilities", "sigmas")  # arrays of a `SizeBlock`


def problem_to_record(problem: Problem, frame: int) -> dict[str, Any]:
    """The problem of one of the frames, without padding."""
    prior = problem.prior
    return {
        "observations": _observations_to_record(problem.observations, frame),
        "layout": layout_to_record(problem.layout),
        "loss": {"name": problem.loss.name, "scale": to_json(problem.loss.scale)},
        "noise": to_json(problem.noise),
        "prior": None if prior is None else {"mean": to_json(prior.mean[frame]), "sigma": to_json(prior.sigma[frame])},
        "paint": to_json(problem.paint),
        "considered": None if problem.considered is None else to_json(problem.considered),
        "scale": to_json(problem.scale),
    }


def problem_from_record(record: Mapping[str, Any]) -> Problem:
    """The inverse of `problem_to_record`."""
    layout, prior = layout_from_record(record["layout"]), record["prior"]
    if prior is not None:
        mean, sigma = (sized(prior[name], (layout.size,), f"'prior', {name!r}")[None] for name in ("mean", "sigma"))
    considered, count = record.get("considered"), int(np.count_nonzero(layout.considered))
    return Problem(
        _observations_from_record(record["observations"], layout.image_size),
        layout,
        RobustLoss(record["loss"]["name"], float(from_json(record["loss"]["scale"]))),
        float(from_json(record["noise"])),
        None if prior is None else GaussianPrior(mean, sigma),
        paint=float(from_json(record["paint"])),
        considered=None if considered is None else sized(considered, (count, count), "'considered'"),
        scale=float(from_json(record["scale"])),
    )


def sized(values: Any, shape: tuple[int, ...], name: str) -> Array:
    """Numbers of a record in an array of a shape; a ValueError if they are of another one."""
    array = np.asarray(from_json(values), dtype=float)
    if array.shape != shape:
        raise ValueError(f"{name}: expected numbers of shape {shape}, got {array.shape}")
    return array


def _observations_to_record(observations: Observations, frame: int) -> dict[str, Any]:
    """Pixels and weights of each label, the vectors of its segment, and their derivatives by the field's size."""
    found: dict[int, Any] = {}
    *kinds, ends = (rows.take(slice(frame, frame + 1)) for rows in observations.rows)
    for rows in kinds:
        for index in dict.fromkeys(rows.label[rows.label >= 0].tolist()):
            of_label = rows.label[0] == index
            weight = rows.weight[0, of_label].tolist()
            found[index] = {
                "kind": rows.name,
                "geometry": to_json(rows.geometry[0, np.argmax(of_label)]),
                "motion": None if observations.motion is None else to_json(observations.motion[index]),
                "xy": to_json(rows.xy[0, of_label]),
                "weight": to_json(weight[0] if weight.count(weight[0]) == len(weight) else weight),
            }
    seen = ends.label >= 0
    return {
        "labels": {observations.labels[index]: found[index] for index in sorted(found)},
        "ends": {
            "label": [observations.labels[index] for index in ends.label[seen]],
            **{name: to_json(getattr(ends, name)[seen]) for name in ("xy", "weight", "geometry")},
        },
    }


class _Stored(NamedTuple):
    """The part of a segment that a record keeps: the class of its rows, and its vectors."""

    rows: type[Rows]
    vectors: Array


def _observations_from_record(record: Mapping[str, Any], image_size: tuple[int, int]) -> Observations:
    labels, ends, kinds = record["labels"], record["ends"], {kind.name: kind for kind in ROWS}
    stored = [_Stored(kinds[part["kind"]], from_json(part["geometry"])) for part in labels.values()]
    frame = {label: from_json(part["xy"]) for label, part in labels.items()}
    weights = {label: np.broadcast_to(from_json(part["weight"]), len(frame[label])) for label, part in labels.items()}
    motions = [part["motion"] for part in labels.values()]
    found = Observations(
        tuple(labels),
        image_size,
        (),
        *packed(PixelTable.of(labels, [frame], [weights]), stored),
        None if None in motions else from_json(motions),
    )
    if not ends["label"]:
        return found
    label = np.array([found.labels.index(one) for one in ends["label"]])
    xy, weight, geometry = (from_json(ends[name])[None] for name in ("xy", "weight", "geometry"))
    return found.with_ends(EndRows(xy, weight, label[None], geometry))


def layout_to_record(layout: Layout) -> dict[str, Any]:
    """The layout of a camera's parameters."""
    size = layout.field_size
    return {
        "image_size": list(layout.image_size),
        "lens": {"name": layout.lens.name, "rho": to_json(layout.lens.rho)},
        "roles": layout.roles.tolist(),
        "zoom_law": None if layout.zoom_law is None else to_json(layout.zoom_law.reference),
        "field_size": None
        if size is None
        else {
            **{name: to_json(one) for name, one in zip(SIZES, (*size[:3], *size.possibilities), strict=True)},
            "crown": None if size.crown is None else size.crown._asdict(),
        },
    }


def layout_from_record(record: Mapping[str, Any]) -> Layout:
    """The inverse of `layout_to_record`."""
    width, height = record["image_size"]
    lens = LENSES[record["lens"]["name"]](float(from_json(record["lens"]["rho"])))
    size = record["field_size"]
    if size is not None:
        given, sigma, limits, *possible = (from_json(size[name]) for name in SIZES)
        crown = size.get("crown")  # older files have none
        size = SizeBlock(given, sigma, limits, (possible[0], possible[1]), crown and Crown(**crown))
    law = record.get("zoom_law")
    zoom_law = None if law is None else ZoomLaw(float(from_json(law)))
    return Layout((width, height), lens, np.array(record["roles"]), size, zoom_law)
