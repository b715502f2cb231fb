"""What stands on a synthetic field, the farthest behind the nearest."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from data_tools.synthetic.colours import random_colour
from data_tools.synthetic.goals import add_goal
from data_tools.synthetic.people import Person, add_person, random_kit, random_positions, random_suns
from fieldcalib._types import Array, Float32
from fieldcalib.draw.scene import Colour
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image import Image

TEAM_SHARES = (0.42, 0.42, 0.03, 0.03, 0.1)  # of the people: two teams, two keepers, the referees


def add_objects(image: Image, light: Float32, camera: Camera, field: Field, rng: np.random.Generator) -> None:
    """Goals and people onto an image, in place; `light` is that of the ground, (3, height, width)."""
    net, depth = random_goals(rng)
    kits, suns = [random_kit(rng) for _ in TEAM_SHARES], random_suns(rng)
    people = random_positions(field, rng)

    def draw(index: int) -> None:
        person, kit = Person.random(rng), kits[rng.choice(len(kits), p=TEAM_SHARES)]
        add_person(image, light, camera, people[index], person, kit, suns)

    add_far_to_near(image, camera, field, net, depth, people, draw)


def random_goals(rng: np.random.Generator) -> tuple[tuple[Colour, float], tuple[float, float]]:
    """Colour and opacity of the nets, and how deep they are below and above, metres."""
    net = random_colour(rng, saturation=(0.0, 0.2), value=(rng.choice((0.15, 0.85)), 1.0)), rng.uniform(0.1, 0.6)
    return net, (rng.uniform(1.5, 2.5), rng.uniform(0.0, 1.5))


def add_far_to_near(
    image: Image,
    camera: Camera,
    field: Field,
    net: tuple[Colour, float],
    depth: tuple[float, float],
    people: Sequence[Array],
    draw: Callable[[int], None],
) -> None:
    """Goals as `random_goals` makes them, and people, of whom `draw` draws one by its index."""
    goals = [np.array([sign * field.length / 2.0, 0.0, 0.0]) for sign in (-1.0, 1.0)]
    distances = [float(np.linalg.norm(X - camera.C)) for X in (*people, *goals)]
    for index in sorted(range(len(distances)), key=distances.__getitem__, reverse=True):
        if index < len(people):
            draw(index)
        else:
            add_goal(image, camera, goals[index - len(people)], net, depth)
