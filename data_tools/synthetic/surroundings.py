"""Surroundings of a synthetic field: advertising boards, stands with their crowds, dugouts in the foreground.

All are textures on upright walls that form rectangles around the field: boards in front, stands behind. A wall between
the camera and the field hides the ground only up to its own height.

The ground of a synthetic frame: mown and worn grass, its paint, its surroundings, light and shadow.

Pictures are (3, height, width) planes, blue, green, red, as in `fieldcalib.draw.scene`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from data_tools.synthetic.colours import (
    BOARD_SCALE,
    STAND_HEIGHT,
    STAND_SCALE,
    Hsv,
    Range,
    boards_texture,
    noise_at,
    random_colour,
    stand_texture,
    trees_texture,
    wrapped,
)
from fieldcalib._types import BoolArray, Float32
from fieldcalib.draw.ground import Ground, mix, painted, rays
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, Segment
from fieldcalib.fields.sports.soccer import CIRCLE_RADIUS, GOAL_AREA_DEPTH, GOAL_WIDTH
from fieldcalib.fields.sports.soccer import LINE_WIDTH as WIDEST
from fieldcalib.geometry.camera import Camera

LINE_WIDTH = (0.08, 0.12)  # m, where the field's lines are as wide as the law allows
PAINT: Hsv = (20.0, 140.0), (0.0, 0.08), (0.82, 1.0)
FAINTEST = 0.55  # least opacity of the paint of a kept ground
RUN_OFF = (1.5, 9.0)  # m of grass around the field
STRIPE_WIDTHS = (GOAL_AREA_DEPTH, GOAL_AREA_DEPTH / 2.0, 16.5 / 4.0, 8.0)
CORNER_RADIUS = 1.0  # m, law 1
TECHNICAL_AREA = (8.0, 14.0, 1.0)  # m: from the middle line, along the touchline, distance to it
LANE = 1.22  # m: of a running track
FADES = 0.35  # m of ground per pixel from which fine texture averages out

BOARDS_AWAY = (2.5, 9.0)  # m behind the lines
BOARD_HEIGHT = (0.7, 1.2)  # m
DUGOUT_HEIGHT = (1.5, 2.8)  # m
STAND_AWAY = (0.5, 8.0)  # m behind the boards
FLOOR_AWAY = (0.0, 6.0)  # m behind the boards: where the foreground begins to hide the ground
OPEN_SHARE, OPEN_DROP = 0.1, 30.0  # share of grounds without stands: lowered by so many m, their tops look like trees
NOWHERE = (0.0, 0.0)
SIDES = ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0))  # coordinate and sign: behind the goals, along the touchlines


def random_ground(ground: Ground, field: Field, rng: np.random.Generator) -> Float32:
    """Grass with its markings and its surroundings, in even light; (3, height, width)."""
    picture = grass(ground, field, rng)
    surround(picture, ground, field, rng)
    paint_pitch(picture, ground, field, rng)
    return picture


def paint_pitch(
    picture: Float32,
    ground: Ground,
    field: Field,
    rng: np.random.Generator,
    faintest: float = FAINTEST,
    colour: Hsv = PAINT,
) -> None:
    """Paint the markings of a field, in place: in one colour, fresh or worn, with an opacity from `faintest` on."""
    (x, y), opacity = ground.xy, np.full_like(ground.xy[0], rng.uniform(faintest, 1.0))
    if rng.random() < 0.5:  # worn or wet paint
        opacity *= np.clip(0.9 + 0.15 * noise_at(x, y, rng.uniform(0.05, 0.5), rng), 0.3, 1.0)
    paint = random_colour(rng, *colour)
    line_width = rng.uniform(*LINE_WIDTH) * (field.lines.width / WIDEST)
    segments = {**field.segments, **_unlabelled(field, rng)}
    low, high = np.nanmin(ground.xy, axis=(1, 2)) - 1.0, np.nanmax(ground.xy, axis=(1, 2)) + 1.0
    in_view = {name: segment for name, segment in segments.items() if reaches(segment, low, high)}
    everything = Field(field.length, field.width, in_view, paint=field.paint)
    for share in painted(ground, everything, line_width).values():
        mix(picture, paint, opacity * share)


def reaches(segment: Segment, low: Float32, high: Float32) -> bool:
    """Whether a segment may lie in a rectangle of the ground; others are skipped to save time."""
    X = segment.sample(spacing=1.0)[:, :2]
    return bool(np.all(X.max(axis=0) >= low) and np.all(X.min(axis=0) <= high))


def random_light(ground: Ground, field: Field, rng: np.random.Generator) -> Float32:
    """Factors of the light on the ground relative to even daylight, (3, height, width)."""
    x, y = ground.xy
    light = np.ones_like(x)
    if rng.random() < 0.45:  # the shadow of a stand, of its roof, or the sun between two
        angle = 0.5 * np.pi if rng.random() < 0.4 else rng.uniform(0.0, 2.0 * np.pi)
        across = x * math.cos(angle) + y * math.sin(angle)
        reach = 0.5 * (field.length * abs(math.cos(angle)) + field.width * abs(math.sin(angle)))
        edge = rng.uniform(-0.9, 0.9) * reach
        if rng.random() < 0.3:  # a roof with corners
            across += rng.uniform(2.0, 12.0) * _square_wave(y, rng.uniform(10.0, 40.0), 1.0)
        soft = np.maximum(rng.uniform(0.1, 1.5), ground.largest_pixel_size)
        sunny = np.clip((across - edge) / soft + 0.5, 0.0, 1.0)
        if rng.random() < 0.25:
            sunny *= np.clip((edge + rng.uniform(5.0, 30.0) - across) / soft + 0.5, 0.0, 1.0)
        dark = rng.uniform(0.25, 0.75)
        light *= dark + (1.0 - dark) * np.nan_to_num(sunny, nan=1.0)
    else:  # clouds or floodlights
        light += rng.uniform(0.0, 0.12) * noise_at(x, y, rng.uniform(0.6, 3.0), rng)
    shade = 1.0 - light
    blue = rng.uniform(0.0, 0.3)  # shadows are lit by the blue sky
    return np.stack([light * (1.0 + tint * shade) for tint in (blue, 0.2 * blue, -0.2 * blue)])


def grass(ground: Ground, field: Field, rng: np.random.Generator) -> Float32:
    """Mown grass with wear and texture."""
    x, y = ground.xy
    kind = rng.random()
    hue, saturation = ((75.0, 135.0), (0.35, 0.9)) if kind < 0.8 else ((45.0, 80.0), (0.2, 0.6))  # green, dry
    base = random_colour(rng, hue, saturation, (0.28, 0.75))
    picture = np.full((3, *x.shape), np.reshape(base, (3, 1, 1)), np.float32)
    shade = rng.uniform(0.0, 0.14) * _mowing(ground, field, rng)
    fine = 1.0 / (1.0 + ground.largest_pixel_size / FADES)
    shade += rng.uniform(0.0, 0.16) * fine * noise_at(x, y, rng.uniform(0.03, 0.12), rng)
    shade += rng.uniform(0.0, 0.08) * noise_at(x, y, rng.uniform(0.3, 1.5), rng)
    picture *= 1.0 + np.nan_to_num(shade)
    if rng.random() < 0.5:
        brown = random_colour(rng, (25.0, 60.0), (0.2, 0.6), (0.3, 0.7))
        mix(picture, brown, rng.uniform(0.1, 0.8) * _wear(ground, field, rng))
    return picture


def _mowing(ground: Ground, field: Field, rng: np.random.Generator) -> Float32:
    """Light and dark stripes, -1 to 1: along the length, across it, both, around the centre, or none."""
    x, y = ground.xy
    width = rng.choice((*STRIPE_WIDTHS, rng.uniform(2.5, 10.0)))
    pixel_x, pixel_y = ground.pixel_size((1.0, 0.0)), ground.pixel_size((0.0, 1.0))
    kind = rng.choice(["across", "along", "checks", "rings", "slanted", "none"], p=[0.45, 0.1, 0.15, 0.06, 0.06, 0.18])
    if kind == "across":
        return _square_wave(x - field.length / 2.0, width, pixel_x)
    if kind == "along":
        return _square_wave(y - field.width / 2.0, width, pixel_y)
    if kind == "checks":
        across = _square_wave(x - field.length / 2.0, width, pixel_x)
        along = _square_wave(y, width * rng.uniform(0.8, 1.5), pixel_y)
        return across * along if rng.random() < 0.5 else 0.5 * (across + along)
    if kind == "rings":
        return _square_wave(np.hypot(x, y), width, ground.largest_pixel_size)
    if kind == "slanted":
        normal = np.array([np.cos(angle := rng.uniform(0.0, np.pi)), np.sin(angle)], np.float32)
        return _square_wave(normal[0] * x + normal[1] * y, width, ground.pixel_size(normal))
    return np.zeros_like(x)


def _square_wave(t: Float32, half_period: float, pixel_size: Float32 | float) -> Float32:
    """A wave of +1 and -1 that alternates every `half_period`, from t = 0 on; edges are smoothed over a pixel."""
    phase = t / (2.0 * half_period)
    phase -= np.floor(phase)
    wave = half_period - np.abs(4.0 * half_period * phase - 2.0 * half_period)
    return np.asarray(np.clip(wave / pixel_size, -1.0, 1.0), np.float32)


def _wear(ground: Ground, field: Field, rng: np.random.Generator) -> Float32:
    """Share of bare ground: in front of the goals, along the middle and here and there."""
    x, y = ground.xy
    goals = np.exp(-np.square((np.abs(x) - field.length / 2.0 - 2.0) / 5.0) - np.square(y / GOAL_WIDTH))
    middle = np.exp(-np.square(x / (2.0 * CIRCLE_RADIUS)) - np.square(y / (2.0 * CIRCLE_RADIUS)))
    weights = rng.uniform(0.0, 1.0, size=3).astype(np.float32)
    share = weights[0] * goals + 0.4 * weights[1] * middle + 0.3 * weights[2]
    patches = np.clip(0.5 + 0.6 * noise_at(x, y, rng.uniform(0.05, 0.4), rng), 0.0, 1.0)
    return np.asarray(np.nan_to_num(share * patches), np.float32)


def surround(picture: Float32, ground: Ground, field: Field, rng: np.random.Generator) -> None:
    """Add the ground beyond the run-off: a running track with its lanes, turf, tarmac or concrete."""
    x, y = np.abs(ground.xy)
    margin_x, margin_y = rng.uniform(*RUN_OFF, size=2).astype(np.float32)
    outside = np.maximum(
        (x - field.length / 2.0 - margin_x) / ground.pixel_size((1.0, 0.0)),
        (y - field.width / 2.0 - margin_y) / ground.pixel_size((0.0, 1.0)),
    )
    outside = np.clip(outside + 0.5, 0.0, 1.0)
    kind = rng.random()
    if kind < 0.15:
        track = random_colour(rng, rng.choice([(0.0, 20.0), (200.0, 220.0)]), (0.35, 0.7), (0.35, 0.75))
        mix(picture, track, outside)
        radial = np.maximum(x - field.length / 2.0 - margin_x, y - field.width / 2.0 - margin_y)
        lane = np.abs(np.mod(radial / LANE, 1.0) - 0.5) * LANE
        line = np.clip((0.06 - (0.5 * LANE - lane)) / ground.largest_pixel_size + 0.5, 0.0, 1.0) * (radial < 8.0 * LANE)
        mix(
            picture,
            (235, 235, 235),
            np.nan_to_num(0.85 * line * outside * np.clip(0.2 / ground.largest_pixel_size, 0.0, 1.0)),
        )
    elif kind < 0.5:
        mix(picture, random_colour(rng, (70.0, 140.0), (0.1, 0.7), (0.1, 0.5)), outside)
    else:
        mix(picture, random_colour(rng, (0.0, 360.0), (0.0, 0.25), (0.1, 0.6)), outside)


def _unlabelled(field: Field, rng: np.random.Generator) -> dict[str, Segment]:
    """Markings without a label: corner arcs, and marks that may be painted around a field."""
    half_x, half_y = field.length / 2.0, field.width / 2.0
    segments: dict[str, Segment] = {}
    corners = [(-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y)]
    for index, (x, y) in enumerate(corners):
        segments[f"corner {index}"] = Arc((x, y, 0.0), CORNER_RADIUS, 0.5 * index * np.pi, 0.5 * (index + 1) * np.pi)
    if rng.random() < 0.4:
        near, length, beyond = TECHNICAL_AREA
        side = float(rng.choice((-1.0, 1.0)))
        for sign in (-1.0, 1.0):
            x, y = sign * near, side * (half_y + beyond)
            for index, dash in enumerate(np.arange(0.0, length, 2.0)):
                segments[f"dash {sign} {index}"] = Line((x + sign * dash, y, 0.0), (x + sign * (dash + 1.0), y, 0.0))
            for x_end in (x, x + sign * length):
                segments[f"end {sign} {x_end}"] = Line((x_end, y, 0.0), (x_end, y + side * 4.0, 0.0))
    if rng.random() < 0.12:  # another field beside this one, or a line around it
        wider = 1.0 + rng.uniform(0.04, 0.2)
        for index in np.flatnonzero(rng.random(4) < 0.6).tolist():
            start, end = ((wider * x, wider * y, 0.0) for x, y in (corners[index], corners[(index + 1) % 4]))
            segments[f"around {index}"] = Line(start, end)
    return segments


@dataclass(frozen=True)
class Around:
    """Distances of objects around a field, as ranges in metres; by default as around soccer pitches."""

    boards: Range | None = BOARDS_AWAY
    """Distance of boards behind the lines; None where boards or walls are the field's own border."""
    stands: Range = STAND_AWAY
    """Distance of stands behind the boards."""
    floor: Range = FLOOR_AWAY
    """Distance, behind the boards, from which the foreground hides the ground."""
    past: tuple[float, float] = (0.0, 0.0)
    """Extent of the field's paint beyond its length and its width, at each end."""
    trees: bool = False
    """Whether trees stand where the stands would."""
    top: float = np.inf
    """Height of what is seen of stands and trees, metres: cameras above them see the ground beyond."""


SOCCER = Around()


class GroundView(NamedTuple):
    """A camera, the rays of its pixels, and the points where these meet the ground."""

    camera: Camera
    ray: Float32
    ground: Ground

    @classmethod
    def of(cls, camera: Camera) -> GroundView:
        """The view of a camera onto level ground."""
        ray = rays(camera)
        return cls(camera, ray, Ground.of_rays(camera, ray))


@dataclass(frozen=True)
class Wall:
    """Points where the rays of all pixels meet an upright plane around the field."""

    height: Float32
    """Metres above the ground."""
    along: Float32
    """Metres along the wall."""
    pixel: Float32
    """Height of a pixel, metres."""
    ahead: BoolArray
    """Whether a ray meets the plane in front of the camera and within the wall's length, above or below the ground."""

    def up_to(self, top: Float32 | float) -> Float32:
        """Share of every pixel that the wall covers from the ground to a height in metres."""
        with np.errstate(invalid="ignore"):  # pixels at the horizon
            below, above = self.height / self.pixel, (top - self.height) / self.pixel
        return np.where(self.ahead, np.clip(below + 0.5, 0.0, 1.0) * np.clip(above + 0.5, 0.0, 1.0), np.float32(0.0))

    @classmethod
    def of_rays(cls, camera: Camera, ray: Float32, axis: int, at: float, half_length: float) -> Wall:
        """The wall where coordinate `axis` (0: x, 1: y) is `at`."""
        C = camera.C.astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = (at - C[axis]) / ray[axis]
            height = -C[2] - scale * ray[2]
            along = C[1 - axis] + scale * ray[1 - axis]
            pixel = np.abs(np.gradient(height, axis=0)) + np.float32(1e-6)
            ahead = (scale > 0.0) & (np.abs(along) <= half_length)
        return cls(height, along, pixel, ahead)


def add_surroundings(
    picture: Float32,
    view: GroundView,
    field: Field,
    rng: np.random.Generator,
    shown: Float32 | None = None,
    around: Around = SOCCER,
) -> BoolArray:
    """Put stands and boards around the field onto planes (3, height, width), in place.

    The boards show the texture `shown`, by default one drawn from `rng`. All positions depend on `rng` only.

    Returns
    -------
    (height, width) array
        Mask of the pixels in which the foreground hides the field.
    """
    camera, ray, ground = view
    boards, board_height = boards_texture(rng), rng.uniform(*BOARD_HEIGHT)
    stand = trees_texture(rng) if around.trees else stand_texture(rng)
    boards = boards if shown is None else shown
    drop = OPEN_DROP if rng.random() < OPEN_SHARE else 0.0
    half = np.array([field.length, field.width]) / 2.0 + around.past + rng.uniform(*(around.boards or NOWHERE), size=2)
    behind = half + rng.uniform(*around.stands)
    beyond = [side for side in SIDES if side[1] * camera.C[side[0]] < half[side[0]]]  # on the other side of the field
    for axis, sign in beyond:
        wall = Wall.of_rays(camera, ray, axis, sign * behind[axis], behind[1 - axis] + 1.0)
        rows = np.clip((STAND_HEIGHT - drop - wall.height) * STAND_SCALE, 0.0, len(stand) - 1.0)
        cover(picture, wrapped(stand, wall.along * STAND_SCALE, rows), wall.up_to(around.top))
    for axis, sign in beyond if around.boards else ():
        wall = Wall.of_rays(camera, ray, axis, sign * half[axis], half[1 - axis])
        rows = np.clip((1.0 - wall.height / board_height) * len(boards), 0.0, len(boards) - 1.0)
        cover(picture, wrapped(boards, wall.along * BOARD_SCALE, rows), wall.up_to(board_height))
    hidden = np.zeros(picture.shape[1:], bool)
    for axis, sign in (side for side in SIDES if side not in beyond):
        wall = Wall.of_rays(camera, ray, axis, sign * half[axis], half[1 - axis])
        past, along = sign * ground.xy[axis] - half[axis], ground.xy[1 - axis]
        hidden |= _add_floor(picture, past, along, stand, around.floor, rng)
        if around.boards:
            hidden |= _add_near_wall(picture, wall, rng)
    return hidden


def cover(picture: Float32, texture: Float32, share: Float32) -> None:
    """Mix a texture (height, width, 3) into every pixel by its share."""
    for plane, colour in zip(picture, np.moveaxis(texture, -1, 0), strict=True):
        plane += share * (colour - plane)


def _softened(shown: BoolArray) -> Float32:
    return np.asarray(cv2.GaussianBlur(shown.astype(np.float32), (3, 3), 0.5))


def _add_floor(
    picture: Float32, past: Float32, along: Float32, stand: Float32, away: Range, rng: np.random.Generator
) -> BoolArray:
    """Draw the foreground from some distance behind the boards on: spectators, or unchanged ground.

    `past` are distances behind the boards, metres. Returns the mask of the foreground.
    """
    floor = past > rng.uniform(*away)  # false above the horizon
    if rng.random() < 0.5:
        rows = np.clip(0.9 * STAND_HEIGHT - past, 0.0, STAND_HEIGHT - 1.0) * STAND_SCALE
        cover(picture, rng.uniform(0.3, 1.0) * wrapped(stand, along * STAND_SCALE, rows), _softened(floor))
    return np.asarray(floor)


def _add_near_wall(picture: Float32, wall: Wall, rng: np.random.Generator) -> BoolArray:
    """Draw the backs of boards and dugouts between the camera and the field; returns the mask of their pixels."""
    profile = _profile(rng)
    if not profile.any():
        return np.zeros(wall.ahead.shape, bool)
    along = np.nan_to_num(wall.along)
    top = profile[np.mod(along + 0.5 * len(profile), len(profile)).astype(np.intp)]
    share = wall.up_to(top)
    panel = np.mod(np.floor(along / rng.uniform(3.0, 12.0)), 2.0)
    colour = np.array(random_colour(rng, saturation=(0.0, 0.5), value=(0.05, 0.95)), np.float32)
    cover(picture, (1.0 - rng.uniform(0.0, 0.6) * panel)[..., None] * colour, share)
    return np.asarray(share > 0.5)


def _profile(rng: np.random.Generator) -> Float32:
    """Height of the near wall at each metre: nothing, boards, or dugouts between gaps."""
    height = np.zeros(128, np.float32)
    if rng.random() < 0.6:
        height[:] = rng.choice((0.0, rng.uniform(*BOARD_HEIGHT)))
        for start in rng.integers(0, 110, size=rng.integers(0, 4)):
            height[start : start + rng.integers(4, 18)] = rng.choice((0.0, rng.uniform(*DUGOUT_HEIGHT)))
    return height
