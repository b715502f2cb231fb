"""Fields as JSON: the name and the size of one that this package builds, otherwise all that is known of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from fieldcalib._json import from_json, to_json
from fieldcalib.fields.field import Field, built
from fieldcalib.fields.segments import Arc, Line, Point, PointCloud
from fieldcalib.fields.soccer import soccer
from fieldcalib.fields.stands import CameraDistribution
from fieldcalib.fields.traits import LineLook, ProbabilityModel, SizePrior

BUILDERS: Mapping[str, Callable[..., Field]] = {"soccer": soccer}
SEGMENTS = {kind.__name__: kind for kind in (Point, Line, Arc, PointCloud)}


def field_to_record(field: Field) -> dict[str, Any]:
    """A field for `json.dumps`.

    Its `size_model` is left out if that builds fields by a function of somebody else: JSON has none.

    Examples
    --------
    >>> field_to_record(soccer(100, 64))
    {'builder': 'soccer', 'length': 100.0, 'width': 64.0, 'size_known': False}
    """
    size = {"length": float(field.length), "width": float(field.width), "size_known": field.size_known}
    model = field.size_model
    builder = next((name for name, build in BUILDERS.items() if model is not None and build is model.build), None)
    if builder is not None and field.is_built:
        return {"builder": builder, **size}
    return size | {
        "segments": {label: {"kind": type(one).__name__, **asdict(one)} for label, one in field.items()},
        "stands": [asdict(stand) for stand in field.stands],
        "more_stands": [asdict(stand) for stand in field.more_stands],
        "farthest_camera": to_json(field.farthest_camera),
        "scale": to_json(field.scale),
        "lines": {name: value if name == "lighter" else to_json(value) for name, value in asdict(field.lines).items()},
        "halves": {circle: list(parts) for circle, parts in field.halves.items()},
        "size_model": None if model is None or builder is None else {**asdict(model), "build": builder},
        "probability": None if field.probability is None else list(field.probability.coefficients),
    }


def field_from_record(record: Mapping[str, Any]) -> Field:
    """The inverse of `field_to_record`.

    Raises
    ------
    ValueError
        If the builder is none of this package.
    """
    if "builder" in record:
        return built(_builder(record["builder"]), record["length"], record["width"], record["size_known"])
    model, probability = record["size_model"], record["probability"]
    if model is not None:
        ranges = {name: _ranges(model[name]) for name in ("legal", "usual")}
        model = SizePrior(**{**model, **ranges, "build": _builder(model["build"])})
    lines = {name: float(from_json(value)) for name, value in record["lines"].items() if name != "lighter"}
    return Field(
        record["length"],
        record["width"],
        {label: _segment(**one) for label, one in record["segments"].items()},
        stands=tuple(_stand(**one) for one in record["stands"]),
        more_stands=tuple(_stand(**one) for one in record["more_stands"]),
        farthest_camera=float(from_json(record["farthest_camera"])),
        scale=float(from_json(record["scale"])),
        lines=LineLook(lighter=record["lines"]["lighter"], **lines),
        halves=record["halves"],
        size_model=model,
        size_known=record["size_known"],
        probability=None if probability is None else ProbabilityModel(tuple(probability)),
    )


def _builder(name: str) -> Callable[..., Field]:
    if name not in BUILDERS:
        raise ValueError(f"expected a field that is one of {', '.join(BUILDERS)}, got {name!r}")
    return BUILDERS[name]


def _segment(kind: str, **values: Any) -> Point | Line | Arc | PointCloud:
    return SEGMENTS[kind](**values)


def _stand(name: str, **ranges: Any) -> CameraDistribution:
    return CameraDistribution(name, **{key: tuple(value) for key, value in ranges.items()})


def _ranges(pairs: Any) -> Any:
    return tuple(tuple(pair) for pair in pairs)
