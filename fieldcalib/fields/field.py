"""A field: a calibration object that knows its size, its symmetry and the world around it.

The world around it is where cameras stand, how lines look and which sizes occur: facts that hold for one kind of field
only. The rest of the package asks the field for them. The symmetry is the 180-degree turn about the centre mark, which
maps many fields onto themselves.

World coordinates: origin at the centre mark, x right along the touchline as the main camera sees it, y towards the main
camera, z down, so that a crossbar is at z = -2.44.

A plan of a field as SVG, with what cameras see of it, for notebooks.

The sides of a field that looks the same once it is turned by 180 degrees about its centre mark: no marking tells such a
field from the turned one, and no picture of its markings tells on which side of it the camera is. By convention a
camera is on the main side: in front of the near touchline (y > 0, where the main stand is) or, if it is behind an end,
behind the left one (x < 0). Left and right in labels of pictures are as seen from there. Turned by 180 degrees, that is
the opposite side: beyond the far touchline, or behind the right end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from itertools import compress, pairwise
from types import MappingProxyType
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._html import long_table, spread, table
from fieldcalib._types import CAMERA, Array, ReadOnlyDict, expect, is_number, listed, number, one_of, truth
from fieldcalib.fields.ground import LEVEL, Ground, Terrain
from fieldcalib.fields.segments import Point, Segment, boxes, check_members
from fieldcalib.fields.traits import (
    DISTRIBUTIONS,
    SOCCER_SCALE,
    SURFACES,
    UNPAINTED,
    CameraDistribution,
    Crown,
    Halves,
    LineLook,
    Paint,
    ProbabilityModel,
    SizePrior,
)
from fieldcalib.geometry.camera import Camera

ObjectSegments: TypeAlias = Mapping[str, Segment]

WIDTH = 480  # px
MARGIN = 0.08  # around the field, as a share of its diagonal
SPACING = 0.5  # m: of the points along curves
BORDER = 24  # points along each side of a picture
FARTHEST = 4.0  # diagonals of the field: what a camera sees beyond is drawn there
GROUND, PAINT, VIEW = "#3c7a46", "#fff", "#ffe15a"

TOLERANCE = 40.0  # the scale of a field as a multiple of the largest error of a good camera
SCALE = 0.32  # share of the diagonal that is usually in view: on a soccer field 40 of 125 m
ALIKE = 0.005  # metres: ends nearer to each other than this coincide
ROUNDED = 6  # decimals of metres: coordinates that agree to these are the same place, computed in another way
Side = Literal["main", "opposite"]
MAIN: Side = "main"
OPPOSITE: Side = "opposite"
SIDES: tuple[Side, ...] = get_args(Side)
BEHIND_MARGIN = 5.0  # m beyond the corners, between whose lines a camera is behind an end
TURN: Array = np.array([-1.0, -1.0, 1.0])


def plan(length: float, width: float, markings: Iterable[Segment], cameras: Sequence[Camera] = ()) -> str:
    """SVG of markings as seen from above, and of the ground in view of some cameras; see `Field.as_svg`."""
    diagonal = float(np.hypot(length, width))
    half = np.array([length, width]) / 2.0 + MARGIN * diagonal
    (x, y), (across, down) = -half, 2.0 * half
    stroke = f'fill="none" stroke="{PAINT}" stroke-width="{across / WIDTH * 1.4:.3f}"'
    curves = (one.polyline(SPACING)[:, :2] for one in markings if one.is_curve)
    lines = "".join(f'<polyline points="{_points(one)}"/>' for one in curves)
    views = "".join(_view(camera, FARTHEST * diagonal, share=1.0 / max(len(cameras), 1)) for camera in cameras)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{round(WIDTH * down / across)}" '
        f'viewBox="{x:.2f} {y:.2f} {across:.2f} {down:.2f}">'
        f'<rect x="{x:.2f}" y="{y:.2f}" width="{across:.2f}" height="{down:.2f}" fill="{GROUND}"/>'
        f"{views}<g {stroke}>{lines}</g></svg>"
    )


def _view(camera: Camera, farthest: float, share: float) -> str:
    """The part of the ground that a camera sees, as far as it is drawn."""
    along = np.linspace(0.0, 1.0, BORDER)[:, None]
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)], dtype=float)
    border = np.concatenate([a + along * (b - a) for a, b in pairwise(corners)])
    X = camera.image_to_field(border * np.subtract(camera.image_size, 1.0))[:, :2]
    X = X[np.linalg.norm(X, axis=1) <= farthest]  # those above the horizon are NaN
    strength = max(0.45 * share, 0.08)
    return f'<polygon points="{_points(X)}" fill="{VIEW}" fill-opacity="{strength:.2f}"/>' if len(X) > 2 else ""


def _points(X: Array) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in X.tolist())


@dataclass(frozen=True)
class Field(Mapping[str, Segment]):
    """A field: a mapping of labels to segments, with its size in metres and the world around it.

    Labels are looked up without surrounding blanks, which SoccerNet's files have ("Goal left post left "). By default
    only size and segments are known; `soccer` sets all parameters.

    Parameters
    ----------
    length, width : float
        Size along x and along y, metres.
    segments : mapping of str to segment
        The markings and named points.
    stands : sequence of CameraDistribution
        Where cameras stand, for calibrations without a prior: each is tried, the best one is kept. Without any, the
        camera of labels may be anywhere, and pictures are not searched.
    more_stands : sequence of CameraDistribution
        Stands that are used only where a prior names them.
    farthest_camera : float
        Distance from the origin beyond which no camera stands, metres.
    scale : float
        Size of the part that is usually in view, metres: the unit of the solver's steps, and of `tolerance`. By default
        0.32 of the diagonal.
    lines : LineLook
        How the lines look in images.
    paint : mapping of str to Paint
        The paint of the segments of these labels. Other segments are white lines, points are not painted. Labels
        without a segment are ignored.
    surface : str
        The ground, for drawing: grass, turf (artificial), ice, wood, floor (of a hall), hard court or clay.
    halves : mapping of str to (str, str, str)
        For a circle whose halves are segments too: their labels, left and right, and that of the line between them.
    size_model : SizePrior, optional
        The sizes that such a field may have; None where length and width cannot be estimated.
    size_known : bool
        Whether length and width are exact. By default they are not: no field is built to the centimetre.
    probability : ProbabilityModel, optional
        Gives the probability that a camera is right; None where it was not fitted to such fields.
    ground : Ground, optional
        The ground, if it is known. None where it is not: it is taken to be level, and an estimate from frames, or the
        uncertainty that `crown` states, replaces what is not known.
    crown : Crown, optional
        How many of such fields are crowned, and how high; None where all are level.
    repeats : float, optional
        Metres along x after which markings look alike, as yard lines do: 4.572 on a field of American football.

    Raises
    ------
    ValueError
        If the size, the scale, the farthest camera or `repeats` is not positive, a segment has another type, two
        stands share a name, the surface is unknown, or `halves` has a label that the field does not have.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> field = soccer()
    >>> field["Goal left post left "] == field["Goal left post left"]
    True
    >>> field.symmetric["Big rect. left top"]
    'Big rect. right bottom'

    A court that knows where its camera is:

    >>> from fieldcalib.fields.segments import Line
    >>> near = CameraDistribution("side", (-50, 50), (50, 85), (-5, 5), (15, 70), (-8, 8), (15, 30), (-9, -2))
    >>> court = Field(28.0, 15.0, {"Middle line": Line((0.0, -7.5, 0.0), (0.0, 7.5, 0.0))}, stands=(near,))
    >>> round(court.scale, 1), court.probability is None
    (10.2, True)
    """

    length: float
    width: float
    segments: Mapping[str, Segment] = field(repr=False)
    stands: tuple[CameraDistribution, ...] = field(default=(), repr=False)
    more_stands: tuple[CameraDistribution, ...] = field(default=(), repr=False)
    farthest_camera: float = field(default=np.inf, repr=False)
    scale: float = field(default=np.nan, repr=False)
    lines: LineLook = field(default=LineLook(), repr=False)
    paint: Mapping[str, Paint] = field(default_factory=ReadOnlyDict, repr=False)
    surface: str = field(default=SURFACES[0], repr=False)
    halves: Mapping[str, Halves] = field(default_factory=ReadOnlyDict, repr=False)
    size_model: SizePrior | None = field(default=None, repr=False)
    size_known: bool = field(default=False, repr=False)
    probability: ProbabilityModel | None = field(default=None, repr=False)
    repeats: float | None = field(default=None, repr=False)
    ground: Ground | None = field(default=None, repr=False)
    crown: Crown | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self._check_types()
        scale = SCALE * float(np.hypot(self.length, self.width)) if math.isnan(self.scale) else self.scale
        given = {
            "segments": ReadOnlyDict(self.segments),
            "stands": tuple(self.stands),
            "more_stands": tuple(self.more_stands),
            "scale": scale,
            "paint": ReadOnlyDict(self.paint),
            "halves": ReadOnlyDict({label: Halves(*parts) for label, parts in self.halves.items()}),
        }
        for name, value in given.items():
            object.__setattr__(self, name, value)
        check_members(self.segments)
        for name in ("length", "width", "scale", "farthest_camera", "repeats"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise ValueError(f"a Field needs a positive {name} in metres, got {value}")
            if name in ("length", "width") and not math.isfinite(value):
                raise ValueError(f"a Field needs a finite {name} in metres, got {value}")
        if self.ground is not None:
            expect(self.ground, Ground, "fieldcalib.fields.Ground(crown=0.3)").on(self.length, self.width)
        names = [stand.name for stand in (*self.stands, *self.more_stands)]
        if len(set(names)) < len(names):
            raise ValueError(f"the stands of a Field need different names, got {names}")
        one_of(self.surface, SURFACES, "surface")
        unknown = [label for circle, parts in self.halves.items() for label in (circle, *parts) if label not in self]
        if unknown:
            raise ValueError(f"halves name {unknown[0]!r}, which is no segment of the field")

    def _check_types(self) -> None:
        """Raise a ValueError that names an argument of a wrong type."""
        for name in ("length", "width", "scale", "farthest_camera", "repeats"):
            value = getattr(self, name)
            if not is_number(value) and not (name == "repeats" and value is None):
                raise ValueError(f"a Field needs {name} as a number of metres, got {value!r}")
        for name in ("segments", "paint", "halves"):
            expect(getattr(self, name), Mapping, "{label: value}")
        for parts in self.halves.values():
            if not (isinstance(parts, tuple | list) and len(parts) == len(Halves._fields)):
                raise ValueError(f"halves must be tuples of labels, {Halves._fields}, got {parts!r}")
        truth(self.size_known, "size_known")
        if self.crown is not None:
            expect(self.crown, Crown, "Crown(share=0.5, height=0.2), where a height is ground=Ground(crown=0.3)")
        for name in ("stands", "more_stands"):
            for stand in listed(getattr(self, name), name):
                expect(stand, CameraDistribution, "fieldcalib.fields.DISTRIBUTIONS['main center']")

    def __reduce__(self) -> tuple[Callable[..., Field], tuple[Any, ...]]:
        if self.is_built:
            assert self.size_model is not None
            return built, (self.size_model.build, self.length, self.width, self.size_known, self.ground)
        return Field, tuple(getattr(self, one.name) for one in fields(self))

    def __hash__(self) -> int:
        return hash((self.length, self.width, self.ground, tuple(self.segments)))

    def __getitem__(self, label: str) -> Segment:
        return self.segments[label.strip() if isinstance(label, str) else label]

    def __iter__(self) -> Iterator[str]:
        return iter(self.segments)

    def __len__(self) -> int:
        return len(self.segments)

    def _repr_html_(self) -> str:
        """The markings, the size and some labels, for notebooks."""
        labels = list(self)
        rows = [[label, type(self[label]).__name__] for label in (labels[index] for index in spread(len(labels)))]
        size = {"size": f"{self.length:g} x {self.width:g} m", "surface": self.surface}
        return self.as_svg() + table(size) + long_table(["label", "segment"], rows, len(labels))

    def as_svg(self, cameras: Sequence[Camera] = ()) -> str:
        """The markings as seen from above as SVG, whose unit is the metre, with the ground in view of some cameras.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> soccer().as_svg()[:61]
        '<svg xmlns="http://www.w3.org/2000/svg" width="480" height="3'
        """
        for camera in listed(cameras, "cameras"):
            expect(camera, Camera, CAMERA)
        return plan(self.length, self.width, self.markings.values(), cameras)

    def paint_of(self, label: str) -> Paint:
        """The paint of a segment, its width filled in: its entry in `paint`, by default a line of the field's width.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> soccer().paint_of("Middle line").width, soccer().paint_of("CENTER_MARK").width
        (0.12, 0.22)
        """
        segment = self.segments.get(expect(label, str, '"Middle line"').strip())
        if segment is None:
            raise ValueError(f"expected a segment of the field, as 'Middle line', got {label!r}")
        paint = self.paint.get(label.strip())
        if paint is None:
            paint = UNPAINTED if segment.is_point else Paint()
        return replace(paint, width=self.lines.width) if paint.width is None else paint

    @cached_property
    def is_built(self) -> bool:
        """Whether `size_model` builds this field from its length and width; `size_known` may differ."""
        if self.size_model is None:
            return False
        try:
            return self == built(self.size_model.build, self.length, self.width, self.size_known, self.ground)
        except ValueError:  # it cannot build this size
            return False

    @cached_property
    def moves_with_size(self) -> bool:
        """Whether the segments are those that `size_model` builds, so that their motion with the size is known."""
        if self.size_model is None:
            return False
        return self.is_built or dict(self) == dict(self.size_model.build(self.length, self.width))

    @cached_property
    def terrain(self) -> Terrain:
        """The ground as a surface, level where it is not known; its method `raised` puts points on it.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> from fieldcalib.fields import Ground
        >>> field = soccer().with_ground(Ground(crown=0.3))
        >>> field.terrain.raised(field["Middle line"].sample(34.0))
        array([[  0. , -34. ,   0. ],
               [  0. ,   0. ,  -0.3],
               [  0. ,  34. ,   0. ]])
        """
        return (self.ground or LEVEL).on(self.length, self.width)

    @cached_property
    def boxes(self) -> tuple[Array, Array]:
        """Least and largest coordinates (L, 3) of each segment, metres."""
        return boxes(self.segments)

    @property
    def tolerance(self) -> float:
        """Largest error of a good camera anywhere in view, metres: a fortieth of `scale`, 1 m on a soccer pitch.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> from fieldcalib.fields import tennis
        >>> soccer().tolerance, tennis().tolerance
        (1.0, 0.21)
        """
        return round(self.scale / TOLERANCE, 2)

    @cached_property
    def half_extent(self) -> Array:
        """Largest absolute x and y of the field and of its markings on the ground, (2,) metres.

        Examples
        --------
        >>> from fieldcalib.fields import rugby_union
        >>> rugby_union().half_extent  # with the in-goal areas
        array([60.05, 35.05])
        """
        reach = np.array([self.length, self.width]) / 2.0
        for low, high in zip(*self.boxes, strict=True):
            if not (low[2] or high[2]):
                reach = np.maximum(reach, np.maximum(-low, high)[:2])
        return reach

    @cached_property
    def points(self) -> Mapping[str, Point]:
        """The named points alone."""
        return MappingProxyType({name: s for name, s in self.segments.items() if isinstance(s, Point)})

    @cached_property
    def markings(self) -> Mapping[str, Segment]:
        """Everything that is painted or stands on the field: lines, posts, crossbars, arcs; without the points."""
        return MappingProxyType({name: s for name, s in self.segments.items() if not s.is_point})

    @cached_property
    def half_labels(self) -> frozenset[str]:
        """Labels of the halves of circles; an image has labels of a whole circle or of its halves, not of both.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> sorted(soccer().half_labels)
        ['Circle central left', 'Circle central right']
        """
        return frozenset(label for halves in self.halves.values() for label in (halves.left, halves.right))

    @cached_property
    def named_stands(self) -> Mapping[str, CameraDistribution]:
        """Camera distributions by name: the field's own, or a soccer field's where it has none."""
        own = {stand.name: stand for stand in (*self.stands, *self.more_stands)}
        return MappingProxyType(own or dict(DISTRIBUTIONS))

    @cached_property
    def symmetric(self) -> Mapping[str, str]:
        """Label -> label of the same segment seen from the other side: the 180-degree turn about the centre mark.

        Segments that have no counterpart are left out: all of them on a field without this symmetry.
        """

        return self._counterparts(turn=(-1.0, -1.0, 1.0))

    @cached_property
    def mirrored(self) -> tuple[Mapping[str, str], Mapping[str, str]]:
        """Label -> label of the segment mirrored at the middle line, and at the axis through both ends.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> [names["Big rect. left top"] for names in soccer().mirrored]
        ['Big rect. right top', 'Big rect. left bottom']
        """
        return self._counterparts(turn=(-1.0, 1.0, 1.0)), self._counterparts(turn=(1.0, -1.0, 1.0))

    @cached_property
    def alike_further_on(self) -> tuple[frozenset[str], frozenset[str]]:
        """Labels of segments that look the same one step of `repeats` to the left, and to the right; empty without it.

        Lines along x of at least two steps are among them: their ends are seldom in view.

        Examples
        --------
        >>> from fieldcalib.fields import american_football
        >>> to_the_left, to_the_right = american_football("nfl").alike_further_on
        >>> "Yard line 50" in to_the_left, "Side line top" in to_the_left, "Goal line left" in to_the_right
        (True, True, False)
        """
        if self.repeats is None:
            return frozenset(), frozenset()
        step = self.repeats
        along = {
            label
            for label, segment in self.items()
            if segment.is_straight
            for _, (x, y, z) in [segment.vectors]
            if y == z == 0.0 and abs(x) >= 2.0 * step
        }
        left, right = (frozenset(along | self._counterparts(move=(x, 0.0, 0.0)).keys()) for x in (-step, step))
        return left, right

    def _counterparts(
        self, turn: tuple[float, float, float] = (1.0, 1.0, 1.0), move: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> Mapping[str, str]:
        """Label -> label of the segment onto which a turn and a move map this one, if there is one."""
        if not self.segments:
            return MappingProxyType({})
        names, kinds = list(self.segments), [type(segment).__name__ for segment in self.segments.values()]
        number = np.unique(kinds, return_inverse=True)[1].ravel()  # as one more coordinate: kinds are far apart
        ends = np.array(boxes(self.segments, spacing=0.05))
        here, there = (
            np.column_stack([*np.sort(some, axis=0), number]) for some in (ends, np.array(turn) * ends + move)
        )
        # the field's own label, if the same segment was added under another one
        places, first = np.unique(np.round(here, ROUNDED), axis=0, return_index=True)
        distance = np.max(np.abs(there[:, None] - places), axis=-1)
        nearest = np.argmin(distance, axis=1)
        alike = np.flatnonzero(distance[np.arange(len(there)), nearest] < ALIKE)
        return MappingProxyType({names[i]: names[first[nearest[i]]] for i in alike.tolist()})

    @cached_property
    def self_symmetric(self) -> frozenset[str]:
        """Labels of whole lines and circles that the 180-degree turn maps onto themselves, and of their parts.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> sorted(soccer().self_symmetric)[:3]
        ['CENTER_MARK', 'Circle central', 'Circle central left']
        """
        pairs = self.symmetric.items()
        return frozenset(label for label, other in pairs if self.segments[label].whole == self.segments[other].whole)

    def with_segments(self, extra: Mapping[str, Segment]) -> Field:
        """The field with more segments, such as points of one's own.

        A plain dict of both would lack the field's world. How the new segments move with the size of the field is
        unknown, so the size is not estimated.

        Raises
        ------
        ValueError
            If the field already has one of the names.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> field = soccer().with_segments({"corner flag": Point((-52.5, -34.0, -1.5))})
        >>> field.length, field["corner flag"]
        (105.0, Point(X=(-52.5, -34.0, -1.5)))
        """
        given = expect(extra, Mapping, '{"corner flag": Point((-52.5, -34.0, -1.5))}')
        names = {expect(name, str, '"corner flag"').strip(): segment for name, segment in given.items()}
        taken = sorted(names.keys() & self.segments.keys())
        if taken:
            raise ValueError(f"the field has a segment {taken[0]!r} already: give yours another name")
        return replace(self, segments={**self.segments, **names})

    def with_ground(self, ground: Ground | None) -> Field:
        """The field on a ground that is known; None for one that is not.

        Raises
        ------
        ValueError
            If the ground is steeper than that of any field.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> soccer().with_ground(Ground(crown=0.3)).ground
        Ground(crown=0.3, fall=0.0)
        """
        return replace(self, ground=ground)

    def resized(self, length: float, width: float) -> Field:
        """The field in another size.

        Raises
        ------
        ValueError
            If the field has no `size_model`, or one that builds other segments than these.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> soccer().resized(100.0, 64.0) == soccer(100.0, 64.0)
        True
        """
        build, size = self._moving.build, (number(length, "length"), number(width, "width"))
        return built(build, *size, self.size_known, self.ground)

    @cached_property
    def motion(self) -> Array:
        """Derivatives of the ends of the segments by length and width.

        Every coordinate is affine in the size, so this holds for any change. Lines that get longer keep their middle,
        arcs keep their radius.

        Returns
        -------
        (L, 2, 3, 2) array
            Derivatives by (length, width) of each segment, in the order of the field: of start and end for a line, of
            the centre (twice) for an arc or a point; 0 for point clouds.

        Raises
        ------
        ValueError
            As in `resized`.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> dict(zip(soccer(), soccer().motion))["Side line right"][:, 0, 0]  # half a metre in x with a metre of length
        array([0.5, 0.5])
        """
        return _motion(self._moving.build, *self._moving.limits[0].tolist())

    @cached_property
    def moved_by_width(self) -> frozenset[str]:
        """Segments that move as a whole with the width: the touchlines, and points on them. Empty if none moves."""
        if not self.moves_with_size:
            return frozenset()
        start, end = np.moveaxis(self.motion[..., 1], 1, 0)
        is_whole = np.all(start == end, axis=1) & np.any(start, axis=1)
        return frozenset(compress(self, is_whole))

    @property
    def _moving(self) -> SizePrior:
        if self.size_model is None or not self.moves_with_size:
            raise ValueError("expected a field as soccer(length, width) makes it: how other segments move is not known")
        return self.size_model


@lru_cache(maxsize=16)
def _motion(build: Callable[[float, float], Field], length: float, width: float) -> Array:
    """`Field.motion` of the fields of a builder, of all sizes, from one of them."""
    sizes = (length, width), (length + 1.0, width), (length, width + 1.0)
    here, longer, wider = (np.array([segment.anchors for segment in build(*size).values()]) for size in sizes)
    motion = np.stack([longer - here, wider - here], axis=-1)
    motion.flags.writeable = False
    return motion


@lru_cache(maxsize=64)
def built(
    build: Callable[[float, float], Field], length: float, width: float, size_known: bool, ground: Ground | None = None
) -> Field:
    """The field of a size, cached: fields are immutable."""
    return replace(build(length, width), size_known=size_known, ground=ground)


def tolerance_of(field: Field | None) -> float:
    """The tolerance of a field, metres (`Field.tolerance`); of an object that is no field, that of a soccer pitch."""
    return SOCCER_SCALE / TOLERANCE if field is None else field.tolerance


def terrain_of(object_segments: ObjectSegments | None) -> Terrain | None:
    """The ground that an object stands on; None where it is level, as under an object that is no field."""
    terrain = object_segments.terrain if isinstance(object_segments, Field) else None
    return None if terrain is None or terrain.is_level else terrain


def unlike_turned(field: Field) -> list[str]:
    """Labels of segments without a counterpart once a field is turned by 180 degrees; unpainted points are not seen."""
    alone = [label for label in field if label not in field.symmetric]
    return [label for label in alone if label not in field.points or field.paint_of(label).width]


def looks_the_same_turned(field: Field) -> bool:
    """Whether all that is seen of a field has a counterpart once it is turned by 180 degrees.

    Examples
    --------
    >>> from fieldcalib.fields import soccer
    >>> looks_the_same_turned(soccer())
    True
    """
    return not unlike_turned(field)


def is_behind_end(C: ArrayLike, field: Field) -> bool:
    """Whether a place (3,), metres, is behind the left or the right end of a field, not beside it."""
    x, y, _ = np.abs(np.asarray(C, dtype=float))
    return bool(x > field.length / 2.0 and y <= field.width / 2.0 + BEHIND_MARGIN)


def side_of(C: ArrayLike, field: Field) -> Side:
    """The side of a field on which a place (3,), metres, is.

    Examples
    --------
    >>> from fieldcalib.fields import soccer
    >>> [side_of(C, soccer()) for C in ((10, 60, -15), (10, -60, -15), (-70, -3, -9), (70, 3, -9))]
    ['main', 'opposite', 'main', 'opposite']
    """
    x, y, _ = np.asarray(C, dtype=float)
    is_turned = x > 0.0 if is_behind_end(C, field) else y < 0.0
    return OPPOSITE if is_turned else MAIN


def turned_camera(camera: Camera) -> Camera:
    """The camera turned by 180 degrees about the centre mark: it takes the same picture of the turned field."""
    return camera.moved(camera.R * TURN, camera.C * TURN)


def side_of_stand(stand: CameraDistribution, field: Field) -> Side:
    """The side of a field on which the middle of a stand is."""
    return side_of([np.mean(stand.x), np.mean(stand.y), np.mean(stand.z)], field)


def turned_stand(stand: CameraDistribution) -> CameraDistribution:
    """The stand turned by 180 degrees about the centre mark.

    Examples
    --------
    >>> from fieldcalib.fields.traits import BEHIND_LEFT_GOAL, BEHIND_RIGHT_GOAL
    >>> turned_stand(BEHIND_LEFT_GOAL).x == BEHIND_RIGHT_GOAL.x
    True
    """
    pan = np.array(stand.pan)
    pan = pan + (180.0 if np.mean(pan) < 0.0 else -180.0)
    x, y = ((-high, -low) for low, high in (stand.x, stand.y))
    return replace(stand, name=f"{stand.name}, turned", pan=tuple(pan.tolist()), x=x, y=y)
