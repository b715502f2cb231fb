"""Objects on a synthetic field, drawn from the farthest to the nearest."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, Float32
from fieldcalib.draw.scene import Colour
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image import Image
from fieldcalib.synthetic.colours import random_colour
from fieldcalib.synthetic.goals import add_goal
from fieldcalib.synthetic.people import Person, Sun, add_person, random_kit, random_positions, random_suns

TEAM_SHARES = (0.42, 0.42, 0.03, 0.03, 0.1)  # of the people: two teams, two keepers, the referees


class Drawable(NamedTuple):
    """A person or an object on the field, and how it is drawn."""

    X: Array
    """Position in metres, (3,)."""
    draw: Callable[[], object]
    """Draws it onto the image."""


def add_objects(image: Image, light: Float32, camera: Camera, field: Field, rng: np.random.Generator) -> None:
    """Draw goals and people onto an image, in place; `light` is that of the ground, (3, height, width)."""
    goals = soccer_goals(image, camera, field, *random_goals(rng))
    people = players(image, light, camera, rng, lambda rng: random_positions(field, rng))
    add_far_to_near(camera, [*people, *goals])


def players(
    image: Image,
    light: Float32,
    camera: Camera,
    rng: np.random.Generator,
    positions: Callable[[np.random.Generator], Iterable[Array]],
    shadows: Callable[[np.random.Generator], list[Sun]] = random_suns,
) -> list[Drawable]:
    """Players of two teams and referees, to be drawn onto an image."""
    kits, suns = [random_kit(rng) for _ in TEAM_SHARES], shadows(rng)

    def standing(X: Array) -> Drawable:
        def draw() -> None:
            person, kit = Person.random(rng), kits[rng.choice(len(kits), p=TEAM_SHARES)]
            add_person(image, light, camera, X, person, kit, suns)

        return Drawable(X, draw)

    return [standing(X) for X in positions(rng)]


def random_goals(rng: np.random.Generator) -> tuple[tuple[Colour, float], tuple[float, float]]:
    """Colour and opacity of the nets, and their depths on the ground and at the top, metres."""
    net = random_colour(rng, saturation=(0.0, 0.2), value=(rng.choice((0.15, 0.85)), 1.0)), rng.uniform(0.1, 0.6)
    return net, (rng.uniform(1.5, 2.5), rng.uniform(0.0, 1.5))


def soccer_goals(
    image: Image, camera: Camera, field: Field, net: tuple[Colour, float], depth: tuple[float, float]
) -> list[Drawable]:
    """Both goals as `random_goals` makes them, to be drawn onto an image."""
    middles = [np.array([sign * field.length / 2.0, 0.0, 0.0]) for sign in (-1.0, 1.0)]
    return [Drawable(X, partial(add_goal, image, camera, X, net, depth)) for X in middles]


def add_far_to_near(camera: Camera, things: list[Drawable]) -> None:
    """Draw things, the farthest first."""
    for thing in sorted(things, key=lambda thing: float(np.linalg.norm(thing.X - camera.C)), reverse=True):
        thing.draw()
