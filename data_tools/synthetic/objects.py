"""What stands on a synthetic field, the farthest behind the nearest."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from data_tools.synthetic.colours import random_colour
from data_tools.synthetic.goals import add_goal
from data_tools.synthetic.people import add_person, random_kit, random_positions, random_suns
from fieldcalib._types import Array, Float32
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image import Image

TEAM_SHARES = (0.42, 0.42, 0.03, 0.03, 0.1)  # of the people: two teams, two keepers, the referees


def add_objects(image: Image, light: Float32, camera: Camera, field: Field, rng: np.random.Generator) -> None:
    """Goals and people onto an image, in place; `light` is that of the ground, (3, height, width)."""
    net = random_colour(rng, saturation=(0.0, 0.2), value=(rng.choice((0.15, 0.85)), 1.0)), rng.uniform(0.1, 0.6)
    depth = rng.uniform(1.5, 2.5), rng.uniform(0.0, 1.5)
    kits, suns = [random_kit(rng) for _ in TEAM_SHARES], random_suns(rng)

    def distance(X: Array) -> float:
        return float(np.linalg.norm(X - camera.C))

    def add_people(positions: Iterable[Array]) -> None:
        for X in positions:
            add_person(image, light, camera, X, kits[rng.choice(len(kits), p=TEAM_SHARES)], suns, rng)

    goals = [np.array([sign * field.length / 2.0, 0.0, 0.0]) for sign in (-1.0, 1.0)]
    people = sorted(random_positions(field, rng), key=distance, reverse=True)
    for goal in sorted(goals, key=distance, reverse=True):
        behind = sum(distance(X) > distance(goal) for X in people)
        add_people(people[:behind])
        add_goal(image, camera, goal, net, depth)
        people = people[behind:]
    add_people(people)
