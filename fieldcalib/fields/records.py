"""Fields as JSON: name and size of a field that this package builds, all attributes of any other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, asdict, fields, is_dataclass, replace
from functools import partial
from typing import Any, TypeAlias, TypeVar

from fieldcalib._json import from_json, to_json
from fieldcalib._types import one_of
from fieldcalib.fields.field import Field, built
from fieldcalib.fields.ground import Ground
from fieldcalib.fields.segments import KINDS, Segment
from fieldcalib.fields.sports.futsal import futsal
from fieldcalib.fields.sports.ice_hockey import ice_hockey_iihf
from fieldcalib.fields.sports.parts import mirrored
from fieldcalib.fields.sports.rugby_union import BuilderWithInGoal
from fieldcalib.fields.sports.soccer import SoccerBuilder
from fieldcalib.fields.traits import (
    CameraDistribution,
    Crown,
    Halves,
    LineLook,
    Paint,
    ProbabilityModel,
    SizePrior,
    stands_beside,
)

Build: TypeAlias = Callable[[float, float], Field]
BUILDERS: Mapping[str, Build] = {  # the attributes of one that is a dataclass are parameters of the field
    "soccer": SoccerBuilder(),
    "futsal": futsal,
    "ice-hockey-iihf": ice_hockey_iihf,
    "rugby-union": BuilderWithInGoal(),
}
SEGMENTS: Mapping[str, type[Segment]] = {kind.__name__: kind for kind in KINDS}

T = TypeVar("T")


def field_to_record(field: Field) -> dict[str, Any]:
    """A field for `json.dumps`: the name of its builder and its size where this package builds it, else all
    attributes.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> field_to_record(soccer(100, 64))
    {'builder': 'soccer', 'length': 100.0, 'width': 64.0, 'size_known': False}
    """
    builder = _builder_of(field)
    if builder is not None and field.is_built:
        return {"builder": builder.pop("build"), **builder, **_size_of(field)}
    return whole_record(field)


def whole_record(field: Field) -> dict[str, Any]:
    """A field for `json.dumps` with all attributes, segment by segment.

    Its `size_model` is left out if its builder is not of this package: JSON holds no functions.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> whole_record(soccer(100, 64))["segments"]["Middle line"]
    {'kind': 'Line', 'start': (0.0, -32.0, 0.0), 'end': (0.0, 32.0, 0.0)}
    """
    model, builder, of = field.size_model, _builder_of(field), field.probability
    return _size_of(field) | {
        "segments": {label: {"kind": type(one).__name__, **asdict(one)} for label, one in field.items()},
        "stands": [asdict(stand) for stand in field.stands],
        "more_stands": [asdict(stand) for stand in field.more_stands],
        "farthest_camera": to_json(field.farthest_camera),
        "scale": to_json(field.scale),
        "lines": {name: value if name == "lighter" else to_json(value) for name, value in asdict(field.lines).items()},
        "paint": {label: asdict(one) for label, one in field.paint.items()},
        "surface": field.surface,
        "halves": {circle: list(parts) for circle, parts in field.halves.items()},
        "size_model": None if model is None or builder is None else {**asdict(model), **builder},
        "probability": of and [*of.coefficients, *([] if of.least_in_picture is None else [of.least_in_picture])],
        "repeats": field.repeats,
        "crown": field.crown and asdict(field.crown),
    }


def _size_of(field: Field) -> dict[str, Any]:
    """Size of a field, and its ground if that is known."""
    size = {"length": float(field.length), "width": float(field.width), "size_known": field.size_known}
    return size if field.ground is None else {**size, "ground": asdict(field.ground)}


def _builder_of(field: Field) -> dict[str, Any] | None:
    """Name and parameters of the builder of a field; None if it is not of this package."""
    build = None if field.size_model is None else field.size_model.build
    for name, usual in BUILDERS.items():
        if build == usual:
            return {"build": name}
        if is_dataclass(build) and type(build) is type(usual):
            return {"build": name, **asdict(build)}  # type: ignore[call-overload]
    return None


def field_from_record(record: Mapping[str, Any]) -> Field:
    """The inverse of `field_to_record`; attributes with a default in `Field` may be left out.

    Three of them may be shorter than `whole_record` writes them: with ``mirrored: true`` the segments are those of the
    right bottom quarter, and their mirror images are added (`fieldcalib.fields.sports.parts.mirrored`), to each part if
    they are a list of parts, which sets the order of the labels; `stands` may be the distances and heights of cameras
    around the field (`fieldcalib.fields.traits.stands_beside`); and a key of `paint` that is no label may be the
    beginning of several.

    Raises
    ------
    ValueError
        If the builder is not of this package, or a key has a wrong value; the message names it.

    Examples
    --------
    >>> line = {"kind": "Line", "start": [0, -5, 0], "end": [0, 5, 0]}
    >>> field_from_record({"length": 20, "width": 10, "segments": {"Middle line": line}})
    Field(length=20.0, width=10.0)
    >>> end = {"kind": "Line", "start": [10, -5, 0], "end": [10, 5, 0]}
    >>> stands = {"away": [3, 30], "up": [2, 15]}
    >>> court = {"length": 20, "width": 10, "segments": {"End line right": end}, "mirrored": True, "stands": stands}
    >>> list(field_from_record(court)), field_from_record(court).stands[0].y
    (['End line right', 'End line left'], (8.0, 35.0))
    >>> field_from_record({"length": 20, "width": 10, "segments": {"Middle line": {"kind": "Line"}}})
    Traceback (most recent call last):
        ...
    ValueError: segments: Middle line: expected start, end
    """
    if isinstance(record, Mapping) and "builder" in record:
        build = _builder(record["builder"], record)
        _check_keys(record, ("builder", "length", "width"), ("size_known", "ground", *_parameters(build)))
        size = (_named("length", _number, record["length"]), _named("width", _number, record["width"]))
        ground = _named("ground", OPTIONAL["ground"], record.get("ground"))
        return built(build, *size, _named("size_known", _boolean, record.get("size_known", False)), ground)
    _check_keys(record, ("length", "width", "segments"), (*OPTIONAL, "mirrored"))
    record = _named("size_model", _with_crown_apart, record)
    length, width = (_named(name, _number, record[name]) for name in ("length", "width"))
    parts = record["segments"] if record["segments"] and isinstance(record["segments"], list) else [record["segments"]]
    parts = [_named("segments", partial(_by_label, _segment), part) for part in parts]
    is_quarter = _named("mirrored", _boolean, record.get("mirrored", False))
    segments = mirrored(*parts) if is_quarter else {label: one for part in parts for label, one in part.items()}
    parsers = dict(OPTIONAL)
    if isinstance(record.get("stands"), Mapping):
        parsers["stands"] = partial(_stands_beside, length, width)
    more = {name: _named(name, parse, record[name]) for name, parse in parsers.items() if name in record}
    if "paint" in more:
        more["paint"] = _named("paint", partial(_by_full_label, labels=segments), more["paint"])
    return Field(length, width, segments, **more)


def _with_crown_apart(record: Mapping[str, Any]) -> Mapping[str, Any]:
    """A record as it is written now: earlier versions kept share and height of the crown with the size."""
    model = record.get("size_model")
    if not isinstance(model, Mapping) or "crown" not in model:
        return record
    share_and_height = model["crown"]
    crown = None if share_and_height is None else dict(zip(("share", "height"), share_and_height, strict=True))
    return {**record, "size_model": {name: one for name, one in model.items() if name != "crown"}, "crown": crown}


def _named(name: str, parse: Callable[[Any], T], value: Any) -> T:
    """The parsed value; messages of errors begin with its name."""
    try:
        return parse(value)
    except (TypeError, ValueError, AttributeError, OverflowError) as error:  # OverflowError: of very long integers
        raise ValueError(f"{name}: {error}") from None


def _check_keys(record: Mapping[str, Any], needed: Iterable[str], more: Iterable[str] = ()) -> None:
    if not isinstance(record, Mapping):
        raise ValueError(f"expected names with values, got {record!r}")
    unknown = sorted(map(str, record.keys() - {*needed, *more}))
    missing = [name for name in needed if name not in record]
    if unknown or missing:
        named = f"unknown {', '.join(unknown)}: " if unknown else ""
        raise ValueError(f"{named}expected {', '.join(missing or [*needed, *more])}")


def _number(value: Any) -> float:
    number = from_json(value)
    if number.ndim or isinstance(value, bool):
        raise ValueError(f"expected a number, got {value!r}")
    return float(number)


def _boolean(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"expected true or false, got {value!r}")
    return value


def _builder(name: str, record: Mapping[str, Any]) -> Build:
    """The builder of a name, with the parameters of a record."""
    build = BUILDERS[one_of(name, BUILDERS, "builder")]
    given = {one: _named(one, _number, record[one]) for one in _parameters(build) if one in record}
    return replace(build, **given) if given else build  # type: ignore[type-var]


def _parameters(build: Build) -> list[str]:
    return [one.name for one in fields(build)] if is_dataclass(build) else []


def _by_label(parse: Callable[[Any], T], records: Any) -> dict[str, T]:
    if not isinstance(records, Mapping):
        raise ValueError(f"expected labels with values, got a {type(records).__name__}")
    return {str(label): _named(str(label), parse, one) for label, one in records.items()}


def _segment(record: Any) -> Segment:
    _check_keys(record, ("kind",), record)
    if not isinstance(record["kind"], str) or record["kind"] not in SEGMENTS:
        raise ValueError(f"expected a kind that is one of {', '.join(SEGMENTS)}, got {record['kind']!r}")
    return _from_attributes(SEGMENTS[record["kind"]], {name: value for name, value in record.items() if name != "kind"})


def _from_attributes(kind: type[T], values: Any) -> T:
    """A dataclass from its attributes."""
    attributes = fields(kind)  # type: ignore[arg-type]
    needed = [one.name for one in attributes if one.default is MISSING]
    _check_keys(values, needed, [one.name for one in attributes if one.default is not MISSING])
    return kind(**values)


def _by_full_label(paint: Mapping[str, Paint], labels: Iterable[str]) -> dict[str, Paint]:
    """Paint by label, where a key that is no label is the beginning of several."""
    meant = {key: [one for one in labels if one.startswith(key)] if key not in labels else [key] for key in paint}
    unknown = [key for key, some in meant.items() if not some]
    if unknown:
        raise ValueError(f"{unknown[0]!r} is none of the segments, and none begins with it")
    return {label: paint[key] for key, some in meant.items() for label in some}


def _stands_beside(length: float, width: float, record: Mapping[str, Any]) -> tuple[CameraDistribution, ...]:
    """Stands around a field, from the range of their distance and that of their height."""
    _check_keys(record, ("away", "up"), ("principal_point",))
    away, up = (_named(name, _pair, record[name]) for name in ("away", "up"))
    more = {name: _named(name, _number, record[name]) for name in ("principal_point",) if name in record}
    return stands_beside(length, width, away, up, **more)


def _pair(value: Any) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise ValueError(f"expected [least, largest], got {value!r}")
    return _number(value[0]), _number(value[1])


def _stands(records: Any) -> tuple[CameraDistribution, ...]:
    return tuple(_named(f"stand {number}", _stand, one) for number, one in enumerate(records, 1))


def _stand(record: Any) -> CameraDistribution:
    return _from_attributes(
        CameraDistribution, {name: tuple(v) if isinstance(v, list | tuple) else v for name, v in record.items()}
    )


def _lines(record: Any) -> LineLook:
    return _from_attributes(
        LineLook, {name: _or_none(_boolean, v) if name == "lighter" else _number(v) for name, v in record.items()}
    )


def _halves(record: Any) -> dict[str, Halves]:
    return {circle: Halves(*parts) for circle, parts in record.items()}


def _size_model(record: Any) -> SizePrior:
    ranges = {name: tuple(tuple(pair) for pair in record[name]) for name in ("legal", "usual") if name in record}
    build = _builder(record.get("build"), record)
    own = {name: value for name, value in record.items() if name not in _parameters(build)}
    return _from_attributes(SizePrior, {**own, **ranges, "build": build})


def _probability(numbers: Any) -> ProbabilityModel:
    values = tuple(map(_number, numbers))
    return ProbabilityModel(values[:5], *values[5:6]) if len(values) == 6 else ProbabilityModel(values)  # type: ignore[arg-type]


def _or_none(parse: Callable[[Any], T], value: Any) -> T | None:
    return None if value is None else parse(value)


OPTIONAL: Mapping[str, Callable[[Any], Any]] = {
    "stands": _stands,
    "more_stands": _stands,
    "farthest_camera": _number,
    "scale": _number,
    "lines": _lines,
    "paint": partial(_by_label, partial(_from_attributes, Paint)),
    "surface": str,
    "halves": _halves,
    "size_model": partial(_or_none, _size_model),
    "size_known": _boolean,
    "probability": partial(_or_none, _probability),
    "repeats": partial(_or_none, _number),
    "ground": partial(_or_none, partial(_from_attributes, Ground)),
    "crown": partial(_or_none, partial(_from_attributes, Crown)),
}
