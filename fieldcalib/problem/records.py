"""A problem of one frame as JSON: pixels by label, layout, loss and prior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np

from fieldcalib._json import from_json, to_json
from fieldcalib._types import Array, are_finite, positive
from fieldcalib.fields.ground import Terrain
from fieldcalib.fields.segments import ROWS, EndRows, Rows
from fieldcalib.fields.traits import Crown
from fieldcalib.geometry.camera import checked_image_size
from fieldcalib.geometry.lens import LENSES
from fieldcalib.problem.evaluation import Problem
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.layout import LOG_F, GaussianPrior, Layout, Role, SizeBlock, ZoomLaw
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import Observations, packed

LARGEST_PARAMETER = 1e9  # of a camera: metres, pixels or radians
NOT_POSITIVE = 1e-6  # least eigenvalue of a matrix of correlations: rounding
LEAST_RHO = 0.5  # pixels
LARGEST_LOG = 20.0  # of a focal length in pixels
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
        if not np.all(sigma > 0.0):
            raise ValueError(f"'prior', 'sigma': expected positive numbers, got {np.min(sigma)}")
    considered, count = record.get("considered"), int(np.count_nonzero(layout.considered))
    return Problem(
        _observations_from_record(record["observations"], layout.image_size),
        layout,
        RobustLoss(record["loss"]["name"], float(from_json(record["loss"]["scale"]))),
        positive(record["noise"], "'noise'"),
        None if prior is None else GaussianPrior(mean, sigma),
        paint=float(from_json(record["paint"])),
        considered=None if considered is None else sized(considered, (count, count), "'considered'"),
        scale=positive(record["scale"], "'scale'"),
    )


def sized(values: Any, shape: tuple[int, ...], name: str) -> Array:
    """Numbers of a record in an array of a shape; a ValueError if they are of another one, or not finite."""
    array = from_json(values)
    if array.shape != shape or not are_finite(array):
        raise ValueError(f"{name}: expected finite numbers of shape {shape}, got {array.shape}: {values!s:.50}")
    return array


def check_parameters(layout: Layout, theta: Array) -> None:
    """Check that parameter vectors (..., n) of a record are those of cameras; a ValueError if they are not."""
    if theta.shape[-1] != layout.size:
        raise ValueError(f"'theta': expected {layout.size} parameters of a camera, got {theta.shape[-1]}")
    if np.any(np.abs(theta) > LARGEST_PARAMETER) or np.any(np.abs(theta[..., LOG_F]) > LARGEST_LOG):
        raise ValueError(f"'theta': expected parameters of a camera, got {np.nanmax(np.abs(theta)):g}")


def check_covariances(covariances: Array, name: str) -> None:
    """Check that those matrices (..., n, n) of a record that are finite are covariances; a ValueError if not."""
    known = covariances[np.all(np.isfinite(covariances), axis=(-2, -1))]
    variances = np.diagonal(known, axis1=-2, axis2=-1)
    if not are_finite(known) or np.any(variances < 0.0):
        raise ValueError(f"{name}: expected a covariance, got a matrix up to {np.max(np.abs(known)):g}")
    sigma = np.where(variances > 0.0, np.sqrt(variances), 1.0)
    correlations = known / sigma[..., :, None] / sigma[..., None, :]
    if known.size and np.min(np.linalg.eigvalsh(correlations)) < -NOT_POSITIVE:
        raise ValueError(f"{name}: expected a covariance, got a matrix that is not positive semidefinite")


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
        "terrain": None if observations.terrain is None else observations.terrain._asdict(),
    }


class _Stored(NamedTuple):
    """The part of a segment that a record keeps: the class of its rows, and its vectors."""

    rows: type[Rows]
    vectors: Array


def _observations_from_record(record: Mapping[str, Any], image_size: tuple[int, int]) -> Observations:
    labels, ends, kinds = record["labels"], record["ends"], {kind.name: kind for kind in ROWS}
    stored = [_Stored(kinds[part["kind"]], _vectors(part["geometry"], "'geometry'")) for part in labels.values()]
    for one in stored:
        if len(one.vectors) < one.rows.vectors:
            raise ValueError(f"'geometry': expected {one.rows.vectors} vectors of {one.rows.name}")
    frame = {label: _vectors(part["xy"], "'xy'", 2) for label, part in labels.items()}
    weights = {label: _weights(part["weight"], len(frame[label])) for label, part in labels.items()}
    moving = [part["motion"] for part in labels.values()]
    found = Observations(
        tuple(labels),
        image_size,
        (),
        *packed(PixelTable.of(labels, [frame], [weights]), stored),
        None if None in moving else sized(moving, np.shape(moving), "'motion'"),
        _surface(record.get("terrain")),
    )
    if not ends["label"]:
        return found
    label = np.array([found.labels.index(one) for one in ends["label"]])
    xy = sized(ends["xy"], (len(label), 2), "'ends', 'xy'")
    geometry = sized(ends["geometry"], (len(label), EndRows.vectors, 3), "'ends', 'geometry'")
    return found.with_ends(EndRows(xy[None], _weights(ends["weight"], len(label))[None], label[None], geometry[None]))


def _surface(record: Mapping[str, Any] | None) -> Terrain | None:
    """The ground of a record, if there is any."""
    return (
        None if record is None else Terrain(**{name: float(sized(one, (), repr(name))) for name, one in record.items()})
    )


def _vectors(values: Any, name: str, length: int = 3) -> Array:
    """Pixels or world points of a record, one or more."""
    return sized(values, (max(len(values), 1), length), name)


def _weights(values: Any, count: int) -> Array:
    """Weights of some pixels, or the one of all."""
    weights = np.broadcast_to(sized(values, np.shape(values), "'weight'"), count)
    if not np.all(weights > 0.0):
        raise ValueError(f"'weight': expected positive numbers, got {np.min(weights)}")
    return weights


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
            "crown": size.crown and asdict(size.crown),
            "height": to_json(size.height),
            "shift": to_json(size.shift),
        },
    }


def layout_from_record(record: Mapping[str, Any]) -> Layout:
    """The inverse of `layout_to_record`."""
    rho = positive(record["lens"]["rho"], "'rho'")
    if not LEAST_RHO <= rho <= LARGEST_PARAMETER:
        raise ValueError(f"'rho': expected half the diagonal of an image, got {rho}")
    lens = LENSES[record["lens"]["name"]](rho)
    size = None if record["field_size"] is None else _size_from_record(record["field_size"])
    law = record.get("zoom_law")
    zoom_law = None if law is None else ZoomLaw(float(sized(law, (), "'zoom_law'")))
    usual = Layout.of(checked_image_size(record["image_size"]), lens, size, zoom_law)
    roles = np.array([Role(one) for one in record["roles"]])
    if len(roles) != usual.size:
        raise ValueError(f"'roles': expected those of {', '.join(usual.names)}, got {record['roles']!s:.100}")
    return replace(usual, roles=roles)


def _size_from_record(record: Mapping[str, Any]) -> SizeBlock:
    count = len(record["probabilities"])
    shapes = ((2,), (2,), (2, 2), (count,), (count, 2))
    given, sigma, limits, *possible = (
        sized(record[name], shape, repr(name)) for name, shape in zip(SIZES, shapes, strict=True)
    )
    crown = record.get("crown")
    if crown is not None:
        crown = Crown(**{name: float(sized(one, (), repr(name))) for name, one in crown.items()})
    height, shift = float(sized(record.get("height", 0.0), (), "'height'")), sized(record["shift"], (3,), "'shift'")
    return SizeBlock(given, sigma, limits, (possible[0], possible[1]), crown, height, shift)
