"""The ground that a camera sees: its surface, and the paint on it.

Pictures are (3, height, width) planes here, blue, green, red. Components of vectors come first too, (2, ...).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray, Float32, IntArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground import Terrain
from fieldcalib.fields.segments import Segment, outwards
from fieldcalib.fields.segments.segment import Ring
from fieldcalib.fields.sports.soccer import GOAL_AREA_DEPTH
from fieldcalib.fields.traits import Paint
from fieldcalib.geometry.camera import Camera

Colour: TypeAlias = tuple[int, int, int]

LIGHT_GRASS: Colour = (60, 141, 80)
DARK_GRASS: Colour = (50, 123, 66)
TRACK: Colour = (52, 74, 56)
# By name: of surfaces but grass, which has stripes; of labels and players, far from the green of grass
COLOURS: Mapping[str, Mapping[str, Colour]] = {
    what: {name: tuple(colour) for name, colour in some.items()}
    for what, some in json.loads(Path(__file__).with_name("colours.json").read_text("utf-8")).items()
}
OUTSIDE = 0.72  # brightness beyond the run-off, relative to the surface
RUN_OFF = 3.0  # m of the surface around the field
MARGIN = 1.0  # m around the paint: pixels whose centres are further away have none of it
STRIPE = GOAL_AREA_DEPTH  # m: width of mown stripes, which then end at the lines of the goal and the penalty area


def rays(camera: Camera) -> Float32:
    """World direction of the ray of every pixel, (3, height, width); NaN where there is none (`Camera.normalized`)."""
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    x, y = np.moveaxis(camera.normalized(pixels).astype(np.float32), -1, 0)
    right, down, forward = camera.R.astype(np.float32)
    return np.stack([x * right[i] + (y * down[i] + forward[i]) for i in range(3)])


@dataclass(frozen=True)
class Ground:
    """The ground points of pixels, metres, and their derivatives along the image's rows and columns; each (2, ...)."""

    xy: Float32
    along_row: Float32
    along_column: Float32

    @classmethod
    def of_rays(cls, camera: Camera, ray: Float32, terrain: Terrain | None = None) -> Ground:
        """The ground points at which the rays of a camera's pixels end; NaN for those above the horizon.

        `terrain` is the ground of a field (`Field.terrain`), by default level.
        """
        if terrain is not None and not terrain.is_level:
            X = terrain.met_by_rays(camera.C, np.moveaxis(ray, 0, -1).astype(float))
            met = np.asarray(np.moveaxis(X[..., :2], -1, 0), np.float32)
            down, across = (np.asarray(one, np.float32) for one in np.gradient(met, axis=(1, 2)))
            return cls(met, across, down)
        C = camera.C.astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = -C[2] / ray[2]
            scale[~(scale > 0.0)] = np.nan
            xy = C[:2, None, None] + scale * ray[:2]
            along_column, along_row = np.gradient(xy, axis=(1, 2))
        return cls(xy, along_row, along_column)

    def __getitem__(self, index: IntArray | BoolArray) -> Ground:
        return Ground(self.xy[:, index], self.along_row[:, index], self.along_column[:, index])

    def pixel_size(self, normal: Any) -> Float32:
        """Size of a pixel in metres along the direction `normal` (2,) or (2, ...) of the ground."""
        x, y = (np.asarray(n, np.float32) for n in normal)
        u = x * self.along_row[0] + y * self.along_row[1]
        v = x * self.along_column[0] + y * self.along_column[1]
        return np.asarray(np.sqrt(u * u + v * v) + 1e-9, np.float32)

    @cached_property
    def largest_pixel_size(self) -> Float32:
        """An upper bound of `pixel_size` over all directions."""
        return np.asarray(np.sqrt(np.sum(np.square(self.along_row) + np.square(self.along_column), axis=0)))


def surface(ground: Ground, field: Field) -> Float32:
    """Colours (3, ...) of the ground of a field, of its run-off and of the surroundings."""
    x, y = np.abs(ground.xy)
    pixel_x, pixel_y = ground.pixel_size((1.0, 0.0)), ground.pixel_size((0.0, 1.0))
    end, side = field.half_extent.tolist()
    outside_x, outside_y = (x - end - RUN_OFF) / pixel_x, (y - side - RUN_OFF) / pixel_y
    outside = np.clip(np.maximum(outside_x, outside_y) + 0.5, 0.0, 1.0)
    if field.surface in COLOURS["surfaces"]:
        colour = np.reshape(COLOURS["surfaces"][field.surface], (3, 1, 1))
        return np.asarray(colour * (1.0 - (1.0 - OUTSIDE) * np.nan_to_num(outside, nan=1.0)), np.float32)
    stripe = (x - field.length / 2.0) / STRIPE
    from_edge = np.abs(stripe - np.rint(stripe)) * STRIPE / pixel_x
    light = 0.5 + (1.0 - 2.0 * np.mod(np.floor(stripe), 2.0)) * np.minimum(from_edge, 0.5)
    picture = np.full((3, *x.shape), np.reshape(DARK_GRASS, (3, 1, 1)), np.float32)
    mix(picture, LIGHT_GRASS, light)
    mix(picture, TRACK, outside)
    return picture


def mix(picture: Float32, colour: Colour, share: Float32) -> None:
    """Blend `colour` into every pixel by its share, in place; NaN, as above the horizon, counts as 1."""
    share = np.nan_to_num(share, nan=1.0)
    for plane, value in zip(picture, colour, strict=True):
        plane += share * (np.float32(value) - plane)


# Paint


def add_paint(
    picture: Float32, ground: Ground, field: Field, opacity: float, line_width: float | None = None, least: float = 0.0
) -> None:
    """Blend the paint on the ground into a picture, in place; widths as in `painted`."""
    for colour, share in painted(ground, field, line_width, least).items():
        mix(picture, bgr(colour), opacity * share)


def bgr(colour: str) -> Colour:
    """Blue, green, red of a `Paint.colour`.

    Examples
    --------
    >>> bgr("#0033a0")
    (160, 51, 0)
    """
    red, green, blue = bytes.fromhex(colour[1:])
    return blue, green, red


def painted(ground: Ground, field: Field, line_width: float | None = None, least: float = 0.0) -> dict[str, Float32]:
    """Share of every pixel that is covered by the paint on the ground, for each of its colours (`Paint.colour`).

    Parameters
    ----------
    ground : Ground
    field : Field
        Its segments on the ground are drawn as `Field.paint_of` says.
    line_width : float, optional
        Width of lines without a width of their own, metres; by default that of the field.
    least : float
        Least width of drawn lines, metres.
    """
    if line_width is not None:
        field = replace(field, lines=replace(field.lines, width=line_width))
    strokes = [stroke for label, one in field.items() for stroke in _strokes(one, field.paint_of(label), field, least)]
    if not strokes:
        return {}
    boxes = np.array([stroke.box for stroke in strokes])
    low, high = boxes[:, 0].min(axis=0) - MARGIN, boxes[:, 1].max(axis=0) + MARGIN
    x, y = ground.xy
    near = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
    patch = ground[near]
    covers = {stroke.colour: np.zeros(patch.xy.shape[1:], np.float32) for stroke in strokes}
    for stroke in strokes:
        stroke.add(covers[stroke.colour], patch)
    found = {}
    for colour, cover in covers.items():
        found[colour] = np.zeros(near.shape, np.float32)
        found[colour][near] = cover
    return found


def _strokes(segment: Segment, paint: Paint, field: Field, least: float) -> Iterator[_Straight | _Ring]:
    """The pieces of paint of a segment on the ground."""
    if not paint.width or np.any(segment.sample()[:, 2]):
        return
    half, cap = 0.5 * max(paint.width, least), 0.5 * max(field.lines.width, least)
    dashes = paint.dashes
    if dashes is not None:  # at least `least` long, but no longer than half of the period
        dash = max(dashes[0], min(least, 0.5 * sum(dashes)))
        dashes = dash, sum(dashes) - dash
    if (ring := segment.ring) is not None:
        yield _Ring(paint.colour, ring._replace(radius=ring.radius + paint.outwards), half, dashes)
    elif segment.is_curve:
        X = segment.corners()
        ends = X[:, :2]
        lengths = np.hypot(*np.diff(ends, axis=0).T)
        begins = np.cumsum(lengths) - lengths - 0.5 * lengths.sum()  # from the middle of the segment
        moves = paint.outwards * outwards(segment, 0.5 * (X[:-1] + X[1:]), np.diff(X, axis=0))[:, :2]
        if paint.outwards:
            cap = paint.outwards + half  # so that a border is closed at its corners
        for start, end, move, begin in zip(ends[:-1], ends[1:], moves, begins, strict=True):
            yield _Straight(paint.colour, start + move, end + move, half, cap, begin, dashes)


@dataclass(frozen=True)
class _Straight:
    colour: str
    start: Array
    end: Array
    half: float
    """Half of the width."""
    cap: float
    """Length of the paint beyond both ends of the line."""
    begin: float
    """Position of the start, from the middle of the segment, for its dashes."""
    dashes: tuple[float, float] | None

    @property
    def box(self) -> Array:
        """Least and largest x and y, (2, 2)."""
        ends, margin = np.array([self.start, self.end]), self.half + self.cap
        return np.array([ends.min(axis=0) - margin, ends.max(axis=0) + margin])

    def add(self, cover: Float32, patch: Ground) -> None:
        """Add the share of each pixel that this covers."""
        length = np.hypot(*(self.end - self.start))
        along = ((self.end - self.start) / length).astype(np.float32)
        across = np.array([-along[1], along[0]])
        distance = across[0] * patch.xy[0] + (across[1] * patch.xy[1] - across @ self.start.astype(np.float32))
        near = np.flatnonzero(np.abs(distance) < patch.largest_pixel_size + self.half)
        here = patch[near]
        share = _band(distance[near], self.half, here.pixel_size(across))
        place, size = along @ here.xy - along @ self.start.astype(np.float32), here.pixel_size(along)
        share *= _band(place - np.float32(0.5 * length), 0.5 * length + self.cap, size)
        if self.dashes is not None:
            share *= _dashed(place + np.float32(self.begin), self.dashes, size)
        cover[near] = np.maximum(cover[near], share)


@dataclass(frozen=True)
class _Ring:
    colour: str
    arc: Ring
    half: float
    """Half of the width."""
    dashes: tuple[float, float] | None = None

    @property
    def box(self) -> Array:
        """Least and largest x and y of the whole circle, (2, 2)."""
        centre, reach = np.array(self.arc.center[:2]), self.arc.radius + self.half
        return np.array([centre - reach, centre + reach])

    def add(self, cover: Float32, patch: Ground) -> None:
        """Add the share of each pixel that this covers."""
        arc, half = self.arc, self.half
        offset = patch.xy - np.array(arc.center[:2], np.float32)[:, None]
        distance = np.hypot(*offset) - arc.radius
        near = np.flatnonzero(np.abs(distance) < patch.largest_pixel_size + half)
        offset, distance = offset[:, near], distance[near]
        here, radial = patch[near], offset / (distance + arc.radius + 1e-6)
        phi = np.arctan2(np.array(arc.v[:2]) @ offset, np.array(arc.u[:2]) @ offset)
        from_start = np.mod(phi - min(arc.start, arc.stop), 2.0 * np.pi)
        share = (from_start <= abs(arc.stop - arc.start)) * _band(distance, half, here.pixel_size(radial))
        if self.dashes is not None:
            place = arc.radius * (from_start - 0.5 * abs(arc.stop - arc.start))
            share *= _dashed(place, self.dashes, here.pixel_size((-radial[1], radial[0])))
        cover[near] = np.maximum(cover[near], share)


def _band(distance: Float32, half_width: float, pixel_size: Float32) -> Float32:
    """Share of a pixel within `half_width` of a line at `distance` from the pixel's centre; all in metres."""
    high = np.minimum((distance + half_width) / pixel_size, 0.5)
    low = np.maximum((distance - half_width) / pixel_size, -0.5)
    return np.asarray(np.maximum(high - low, 0.0), np.float32)


def _dashed(place: Float32, dashes: tuple[float, float], pixel_size: Float32) -> Float32:
    """Share of pixels at `place` that is within dashes, of which one has its middle at 0; all in metres."""
    dash, period = dashes[0], sum(dashes)

    def up_to(x: Float32) -> Float32:
        """Length of the dashes up to x, from the start of the dash around 0."""
        x = x + 0.5 * dash
        count = np.floor(x / period)
        return np.asarray(dash * count + np.minimum(x - period * count, dash))

    share = (up_to(place + 0.5 * pixel_size) - up_to(place - 0.5 * pixel_size)) / pixel_size
    return np.asarray(share, np.float32)
