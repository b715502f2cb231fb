"""Soccer frames that are hard where reality is.

Sun and shadow with sharp edges along and across the lines, faint and coloured lines, those of other sports, grounds
between trees, and cameras where people and their machines stand: behind the goal, in corners, beside the line at head
height, on masts, and above the field.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from data_tools.synthetic.cameras import STANDS
from data_tools.synthetic.colours import Hsv, noise_at, one_of, random_colour
from data_tools.synthetic.games import Game, game_named
from data_tools.synthetic.looks import BLUE, ORANGE, RED, WHITE, YELLOW, Look
from data_tools.synthetic.paint import coverage
from data_tools.synthetic.surroundings import (
    Around,
    GroundView,
    add_surroundings,
    grass,
    paint_pitch,
    surround,
)
from fieldcalib._types import BoolArray, Float32
from fieldcalib.console.arguments import SOCCER
from fieldcalib.draw.ground import Ground, mix
from fieldcalib.fields.catalogue import field_named
from fieldcalib.fields.field import Field
from fieldcalib.fields.traits import CameraDistribution

LOW_BEHIND = CameraDistribution(
    "low behind the goal", (50, 130), (70, 92), (-4, 4), (25, 100), (-80, -54), (-25, 25), (-5, -1)
)
HIGH_BEHIND = CameraDistribution(
    "high behind the goal", (60, 120), (45, 85), (-4, 4), (15, 90), (-110, -56), (-25, 25), (-40, -6)
)
CORNER = CameraDistribution("corner", (0, 80), (60, 92), (-4, 4), (20, 100), (-75, -48), (36, 60), (-20, -1.5))
TOUCHLINE = CameraDistribution("touchline", (-70, 70), (72, 95), (-4, 4), (35, 110), (-50, 50), (36, 52), (-4, -1.5))
MAST = CameraDistribution("mast", (-50, 50), (50, 88), (-4, 4), (50, 120), (-25, 25), (37, 58), (-10, -4))
DRONE = CameraDistribution("drone", (-60, 60), (20, 75), (-4, 4), (25, 90), (-75, 75), (10, 120), (-120, -15))
OVERHEAD = CameraDistribution("overhead", (-20, 20), (0, 35), (-4, 4), (30, 90), (-40, 40), (-30, 60), (-130, -20))
OVERHEAD_BEHIND = replace(OVERHEAD, name="overhead, along", pan=(70, 110))
HARD_STANDS = {
    **{stand: 0.35 * share for stand, share in STANDS.items()},
    LOW_BEHIND: 0.08,
    HIGH_BEHIND: 0.14,
    CORNER: 0.06,
    TOUCHLINE: 0.06,
    MAST: 0.08,
    DRONE: 0.08,
    OVERHEAD: 0.10,
    OVERHEAD_BEHIND: 0.05,
}
SHAPES = ((16 / 9, 0.55), (4 / 3, 0.1), (1.0, 0.1), (3 / 4, 0.07), (9 / 16, 0.13), (21 / 9, 0.05))  # with proportions

SHADED = 0.7  # share of frames with sun and shadow
ALONG_LINES = 0.65  # share of the edges of shadows that are parallel to lines
BAND = (0.4, 14.0)  # m: width of a band of sun or shadow
OTHERS = (
    "american-football-nfl",
    "field-hockey",
    "lacrosse-men",
    "rugby-union",
    "soccer-5v5",
    "soccer-7v7",
    "soccer-9v9",
)
OTHER_COLOURS: tuple[Hsv, ...] = (BLUE, RED, YELLOW, ORANGE, YELLOW, BLUE, WHITE)
FRESH, FAINT = 0.55, 0.3  # least opacity of paint
ABOVE = 30.0  # m: cameras that see over stands and trees
TOP = 12.0  # m of stands and trees that they see
BETWEEN_TREES = Around(boards=None, stands=(3.0, 40.0), trees=True)


def hard_game() -> Game:
    """The parts of a hard frame.

    Examples
    --------
    >>> hard_game().classes == game_named("soccer").classes
    True
    """
    return replace(game_named(SOCCER), stands=HARD_STANDS, light=sunlight, ground=used_ground, surround=surroundings)


def random_shape(size: tuple[int, int], rng: np.random.Generator) -> tuple[int, int]:
    """Width and height of a picture of about as many pixels as `size`: wide, square or upright.

    Examples
    --------
    >>> random_shape((512, 288), np.random.default_rng(1))
    (512, 288)
    """
    shapes, shares = zip(*SHAPES, strict=True)
    aspect = float(rng.choice(shapes, p=shares))
    width = math.sqrt(size[0] * size[1] * aspect)
    return round(width), round(width / aspect)


def sunlight(ground: Ground, field: Field, rng: np.random.Generator) -> Float32:
    """Factors of sun and shadow, (3, height, width), exposed for the one, the other, or between.

    Edges are sharp, or ragged as of trees; the sun may shine on all but bands of shadow, or on bands only.
    """
    x, y = ground.xy
    if rng.random() > SHADED:
        clouds = 1.0 + rng.uniform(0.0, 0.1) * noise_at(x, y, rng.uniform(0.6, 3.0), rng)
        return np.stack([clouds] * 3)
    sun = np.ones_like(x)
    for _ in range(rng.integers(1, 4)):
        sun *= 1.0 - _band(ground, field, rng)
    if rng.random() < 0.4:
        sun = 1.0 - sun
    dark = rng.uniform(0.3, 0.8)
    light = (dark + (1.0 - dark) * np.nan_to_num(sun, nan=1.0)) / dark ** rng.uniform(0.0, 0.6)
    warm = rng.uniform(0.0, 0.25)  # the sun is yellow, shadows are lit by the blue sky
    return np.stack([light * (1.0 + tint * (1.0 - light)) for tint in (warm, 0.0, -0.3 * warm)]).clip(0.1)


def _band(ground: Ground, field: Field, rng: np.random.Generator) -> Float32:
    """Share of every pixel within a band, or on one side of an edge."""
    x, y = ground.xy
    half = 0.5 * np.array([field.length, field.width])
    if rng.random() < ALONG_LINES:
        axis = int(rng.integers(2))
        angle, reach = 0.5 * np.pi * axis + rng.normal(0.0, 0.03), half[axis]
        near = reach * rng.choice((-1.0, 1.0)) + rng.normal(0.0, 7.0)  # stands end beside the lines
        edge = near if rng.random() < 0.7 else rng.uniform(-1.0, 1.0) * reach
    else:
        angle = rng.uniform(0.0, np.pi)
        edge = rng.uniform(-0.9, 0.9) * np.abs([math.cos(angle), math.sin(angle)]) @ half
    across = x * math.cos(angle) + y * math.sin(angle) - np.float32(edge)
    if rng.random() < 0.25:  # the tops of trees
        across += rng.uniform(0.5, 6.0) * noise_at(x, y, rng.uniform(0.1, 0.6), rng)
    soft = np.maximum(rng.uniform(0.02, 0.6), ground.largest_pixel_size)
    low = np.clip(across / soft + 0.5, 0.0, 1.0)
    if rng.random() < 0.4:
        return np.asarray(low if rng.random() < 0.5 else 1.0 - low, np.float32)
    width = math.exp(rng.uniform(*np.log(BAND)))
    share = low * np.clip((width - across) / soft + 0.5, 0.0, 1.0)
    if rng.random() < 0.5:  # it ends somewhere
        along = y * math.cos(angle) - x * math.sin(angle) - np.float32(rng.uniform(-0.8, 0.8) * half.max())
        share *= np.clip(along * rng.choice((-1.0, 1.0)) / soft + 0.5, 0.0, 1.0)
    return np.asarray(share, np.float32)


def used_ground(ground: Ground, field: Field, rng: np.random.Generator) -> Float32:
    """Grass or turf in even light, its lines fresh, faint or coloured, and those of other sports."""
    picture = grass(ground, field, rng)
    surround(picture, ground, field, rng)
    for _ in range(int(rng.choice((0, 1, 2), p=(0.5, 0.35, 0.15)))):
        other_lines(picture, ground, rng)
    colour = WHITE if rng.random() < 0.93 else one_of((YELLOW, ORANGE), rng)
    paint_pitch(picture, ground, field, rng, FAINT if rng.random() < 0.25 else FRESH, colour)
    return picture


def other_lines(picture: Float32, ground: Ground, rng: np.random.Generator) -> None:
    """Add the lines of another sport, along or across the field, somewhere and in another colour, in place."""
    other = field_named(one_of(OTHERS, rng))
    shift = rng.normal(0.0, 3.0, size=(2, 1, 1)).astype(np.float32)
    across = min(other.length, other.width) < 60.0
    if across:
        shift[0] += np.float32(rng.choice((-1.0, 0.0, 1.0)) * 26.0)
    turn = slice(None, None, -1 if across else 1)
    moved = Ground((ground.xy - shift)[turn], ground.along_row[turn], ground.along_column[turn])
    colour, opacity = random_colour(rng, *one_of(OTHER_COLOURS, rng)), rng.uniform(0.3, 1.0)
    for cover in coverage(moved, other, Look(("turf",))).values():
        mix(picture, colour, opacity * np.nan_to_num(cover))


def surroundings(picture: Float32, view: GroundView, field: Field, rng: np.random.Generator) -> BoolArray:
    """Add a stadium, or trees and the sky."""
    around = BETWEEN_TREES if rng.random() < 0.4 else Around()
    if -view.camera.C[2] > ABOVE:
        around = replace(around, top=TOP)
    return add_surroundings(picture, view, field, rng, around=around)
