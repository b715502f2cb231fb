"""Grounds of other sports: floors of halls, ice, hard courts, clay and turf, with their paint."""

from __future__ import annotations

import numpy as np

from data_tools.synthetic.areas import Area
from data_tools.synthetic.colours import Hsv, noise_at, one_of, random_colour, vivid_colour
from data_tools.synthetic.looks import DARK, Look, Surface
from data_tools.synthetic.paint import coverage, paint_areas, paint_lines
from data_tools.synthetic.surroundings import FADES, grass, surround
from fieldcalib._types import Float32
from fieldcalib.draw.ground import Ground, mix
from fieldcalib.fields.catalogue import field_named
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc

SURFACES: dict[Surface, tuple[Hsv, ...]] = {
    "wood": (((24.0, 38.0), (0.35, 0.65), (0.5, 0.8)),),
    "floor": (
        ((200.0, 230.0), (0.4, 0.85), (0.3, 0.7)),
        ((100.0, 170.0), (0.35, 0.8), (0.25, 0.6)),
        ((8.0, 30.0), (0.45, 0.8), (0.5, 0.75)),
        ((340.0, 365.0), (0.35, 0.75), (0.35, 0.65)),
        ((0.0, 360.0), (0.0, 0.12), (0.3, 0.65)),
    ),
    "ice": (((190.0, 225.0), (0.0, 0.07), (0.62, 0.85)),),
    "hard court": (
        ((205.0, 230.0), (0.45, 0.8), (0.35, 0.65)),
        ((90.0, 150.0), (0.25, 0.6), (0.3, 0.55)),
        ((255.0, 280.0), (0.3, 0.55), (0.35, 0.6)),
    ),
    "clay": (((10.0, 24.0), (0.5, 0.75), (0.5, 0.75)),),
    "sand": (((32.0, 46.0), (0.2, 0.45), (0.6, 0.85)),),
    "turf": (((85.0, 150.0), (0.4, 0.85), (0.25, 0.55)),),
    "blue turf": (((200.0, 225.0), (0.5, 0.9), (0.35, 0.65)), ((95.0, 150.0), (0.4, 0.85), (0.25, 0.55))),
}
WEAR: dict[Surface, float] = {
    "wood": 0.02,
    "floor": 0.02,
    "ice": 0.02,
    "hard court": 0.04,
    "clay": 0.08,
    "sand": 0.15,
    "turf": 0.06,
    "blue turf": 0.06,
}
AROUND: Hsv = (0.0, 360.0), (0.0, 0.3), (0.1, 0.45)  # ground around the court
APRON_SHARE = 0.6  # share of courts that lie in ground of another colour
RUN_OFF = (1.5, 5.0)  # m of ground around a court
PLANK = 0.07  # m
OVERLAYS = ("badminton", "volleyball", "handball", "basketball-fiba", "futsal")
OVERLAY_COLOURS: tuple[Hsv, ...] = (((0.0, 360.0), (0.5, 0.9), (0.3, 0.9)), DARK)


def random_floor(ground: Ground, field: Field, look: Look, rng: np.random.Generator) -> Float32:
    """The ground of a field with this look, its markings and its surroundings, in even light; (3, height, width)."""
    surface = one_of(look.surfaces, rng)
    if surface == "grass":
        picture = grass(ground, field, rng)
        surround(picture, ground, field, rng)
    else:
        picture = _plain(ground, surface, rng)
        if look.around.boards is not None:
            _apron(picture, ground, field, look, surface, rng)
    paint_areas(picture, ground, field, look, rng)
    if surface == "wood":
        picture *= 1.0 + _planks(ground, rng)
    if surface in ("wood", "floor", "ice"):
        _logos(picture, ground, field, rng)
    if rng.random() < look.overlaid:
        _overlay(picture, ground, rng)
    paint_lines(picture, ground, field, look, rng)
    if look.around.boards is None:  # lines end at walls that are the field's border
        beyond = 1.0 - inside_walls(field).share(ground)
        mix(picture, random_colour(rng, *AROUND), beyond)
    return picture


def _plain(ground: Ground, surface: Surface, rng: np.random.Generator) -> Float32:
    """A colour with fine texture and wear."""
    x, y = ground.xy
    choices = SURFACES[surface]
    colour = random_colour(rng, *one_of(choices, rng))
    picture = np.full((3, *x.shape), np.reshape(colour, (3, 1, 1)), np.float32)
    fine = 1.0 / (1.0 + ground.largest_pixel_size / FADES)
    shade = rng.uniform(0.0, WEAR[surface]) * fine * noise_at(x, y, rng.uniform(0.01, 0.05), rng)
    shade += rng.uniform(0.0, WEAR[surface]) * noise_at(x, y, rng.uniform(0.1, 0.8), rng)
    if surface == "ice":  # traces of skates
        for _ in range(2):
            turn = rng.uniform(0.0, np.pi)
            along, across = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
            shade += rng.uniform(0.0, 0.03) * fine * noise_at(along / 20.0, across, 0.05, rng)
    picture *= 1.0 + np.nan_to_num(shade)
    return picture


def _planks(ground: Ground, rng: np.random.Generator) -> Float32:
    """Light and dark planks of a floor, along or across the court."""
    along, across = ground.xy if rng.random() < 0.7 else ground.xy[::-1]
    fine = 1.0 / (1.0 + ground.largest_pixel_size / (2.0 * PLANK))
    plank = np.floor(across / PLANK)
    shift = 7.3 * np.mod(plank * 0.618, 1.0)  # ends of planks are staggered
    piece = np.floor((along + shift) / rng.uniform(0.8, 2.5))
    return np.asarray(np.nan_to_num(rng.uniform(0.02, 0.09) * fine * noise_at(31.7 * piece, 17.3 * plank, 1.0, rng)))


def _apron(
    picture: Float32, ground: Ground, field: Field, look: Look, surface: Surface, rng: np.random.Generator
) -> None:
    """Add the ground beyond the lines in another colour, and the surroundings beyond it."""
    half = 0.5 * field.length, 0.5 * field.width
    run_off = rng.uniform(*RUN_OFF, size=2) + look.around.past
    court = Area((0.0, 0.0), half).share(ground)
    if rng.random() < APRON_SHARE:
        choices = SURFACES["floor" if surface == "wood" else surface]
        mix(picture, random_colour(rng, *one_of(choices, rng)), 1.0 - court)
    floor = Area((0.0, 0.0), (half[0] + run_off[0], half[1] + run_off[1])).share(ground)
    if rng.random() < 0.7:
        mix(picture, random_colour(rng, *AROUND), 1.0 - floor)


def inside_walls(field: Field) -> Area:
    """The whole of a field with walls around it, whose corners may be round."""
    corners = [s for label, s in field.markings.items() if label.startswith("Corner board") and isinstance(s, Arc)]
    radius = corners[0].radius if corners else 0.0
    return Area((0.0, 0.0), (0.5 * field.length - radius, 0.5 * field.width - radius), radius)


def _logos(picture: Float32, ground: Ground, field: Field, rng: np.random.Generator) -> None:
    """Add advertisements on floor and ice: boxes and discs with illegible letters."""
    x, y = ground.xy
    places = [np.zeros(2)] if rng.random() < 0.5 else []
    half = 0.5 * np.array([field.length, field.width])
    places += [rng.uniform(-0.9, 0.9, size=2) * half for _ in range(rng.integers(0, 5))]
    for place in places:
        size = rng.uniform(0.03, 0.1) * field.width * np.array([rng.uniform(1.0, 2.5), 1.0])
        moved = Ground(ground.xy - place.astype(np.float32)[:, None, None], ground.along_row, ground.along_column)
        area = Area((0.0, 0.0), (0.0, 0.0), size[1]) if rng.random() < 0.4 else Area((0.0, 0.0), (size[0], size[1]))
        letters = np.clip(0.5 + 2.0 * noise_at(x, y, 0.03 * size[1], rng), 0.0, 1.0) if rng.random() < 0.7 else 1.0
        mix(picture, vivid_colour(rng), rng.uniform(0.3, 0.95) * letters * area.share(moved))


def _overlay(picture: Float32, ground: Ground, rng: np.random.Generator) -> None:
    """Add the lines of another court in the same hall, in another colour."""
    other = field_named(one_of(OVERLAYS, rng))
    colour = random_colour(rng, *one_of(OVERLAY_COLOURS, rng))
    for cover in coverage(ground, other, Look(("floor",))).values():
        mix(picture, colour, rng.uniform(0.4, 0.8) * np.nan_to_num(cover))


def hall_light(ground: Ground, rng: np.random.Generator) -> Float32:
    """Variation of the light in a hall: factors (3, height, width)."""
    x, y = ground.xy
    light = 1.0 + rng.uniform(0.0, 0.08) * noise_at(x, y, rng.uniform(0.1, 0.6), rng)
    tint = rng.normal(0.0, 0.04, size=3)  # colour of the lamps
    return np.asarray(np.nan_to_num(light, nan=1.0)[None] * (1.0 + tint[:, None, None]), np.float32)
