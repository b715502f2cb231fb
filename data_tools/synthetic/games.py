"""Games by the name of their field: the functions that draw the parts of their frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from data_tools.synthetic.cameras import STANDS, random_field
from data_tools.synthetic.floors import hall_light, random_floor
from data_tools.synthetic.furniture import furniture
from data_tools.synthetic.looks import Look, look_of
from data_tools.synthetic.masks import Mask, classes_of, mirrored_values
from data_tools.synthetic.objects import (
    TEAM_SHARES,
    Drawable,
    Person,
    Sun,
    add_far_to_near,
    add_person,
    random_goals,
    random_kit,
    random_suns,
    soccer_goals,
)
from data_tools.synthetic.rink import add_boards
from data_tools.synthetic.surroundings import GroundView, add_surroundings, random_ground, random_light
from fieldcalib._types import Array, BoolArray, Float32
from fieldcalib.console.arguments import SOCCER, named_field
from fieldcalib.draw.ground import Ground
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import CameraDistribution, stands_around
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import Image

NOMINAL_SHARE = 0.5  # share of nominal sizes among fields whose size varies
NEAR_PLAY = 0.3  # standard deviation around the play, in shares of the field's size
AROUND_PLAY = 0.25  # share of the people who stand around the field
AWAY = (0.5, 2.0)  # m: distance from the field

Surrounds = Callable[[Float32, GroundView, Field, np.random.Generator], BoolArray]


@dataclass(frozen=True)
class Game:
    """Parts of a frame, in the order in which they are drawn."""

    field: Field
    """The field in its nominal size."""
    classes: tuple[str, ...]
    """Classes of its masks, see `data_tools.synthetic.masks.classes_of`."""
    random_field: Callable[[np.random.Generator], Field]
    stands: Mapping[CameraDistribution, float]
    """Stands of its cameras, with their proportions."""
    light: Callable[[Ground, Field, np.random.Generator], Float32]
    ground: Callable[[Ground, Field, np.random.Generator], Float32]
    surround: Surrounds
    """Adds stands and boards around the field; returns the mask of the pixels in which they hide it."""
    add_objects: Callable[[Image, Float32, Camera, Field, np.random.Generator], None]

    def mirrored_values(self, *, behind_goal: bool) -> Mask | None:
        """See `data_tools.synthetic.masks.mirrored_values`."""
        return mirrored_values(behind_goal=behind_goal, field=self.field, classes=self.classes)


@lru_cache(maxsize=8)
def game_named(name: str) -> Game:
    """The game of a field of the catalogue, or of a file with one.

    Raises
    ------
    ValueError
        If the file has no field, or the field has no markings that can be told apart.

    Examples
    --------
    >>> game_named("tennis").classes[:3]
    ('Base line left', 'Base line right', 'Centre mark left')
    """
    if name == SOCCER:
        field = soccer()
        return Game(
            field, classes_of(field), random_field, STANDS, random_light, random_ground, add_surroundings, add_objects
        )
    field = named_field(name)
    look = look_of(name, field)
    edges = [label for label in field.markings if look.is_edge(label)]
    return Game(
        field,
        classes_of(field, edges),
        partial(_sized, field),
        _stands(field, look.behind),
        (lambda ground, field, rng: hall_light(ground, rng)) if look.indoors else random_light,
        lambda ground, field, rng: random_floor(ground, field, look, rng),
        partial(_surround, look),
        partial(_add_objects, look),
    )


def _sized(field: Field, rng: np.random.Generator) -> Field:
    """The field, in a usual size if its size varies."""
    if field.size_model is None or rng.random() < NOMINAL_SHARE:
        return field
    length, width = (float(rng.uniform(*usual)) for usual in field.size_model.usual)
    return field.resized(length, width)


def _stands(field: Field, behind: float) -> Mapping[CameraDistribution, float]:
    """Stands of the field with their proportions, a share `behind` its ends; around it where it has no stands of its
    own.

    All have the same proportion if none or all of them are behind the ends.
    """
    stands = field.stands or stands_around(field.scale)
    is_behind = [abs(sum(stand.x)) > field.length for stand in stands]
    count = sum(is_behind)
    if count in (0, len(stands)):
        return dict.fromkeys(stands, 1.0)
    shares = {True: behind / count, False: (1.0 - behind) / (len(stands) - count)}
    return {stand: shares[one] for stand, one in zip(stands, is_behind, strict=True)}


def _surround(look: Look, picture: Float32, view: GroundView, field: Field, rng: np.random.Generator) -> BoolArray:
    hidden = add_surroundings(picture, view, field, rng, around=look.around)
    return hidden | add_boards(picture, view.camera, view.ray, field, look.boards, rng) if look.boards else hidden


def _add_objects(
    look: Look, image: Image, light: Float32, camera: Camera, field: Field, rng: np.random.Generator
) -> None:
    things = furniture(image, camera, field, look, rng)
    people = players(
        image, light, camera, rng, partial(_positions, look, field), _lamps if look.indoors else random_suns
    )
    add_far_to_near(camera, [*people, *things])


def _lamps(rng: np.random.Generator) -> list[Sun]:
    """Lamps in a hall: their shadows are short and weak."""
    if rng.random() < 0.5:
        return []
    return [(rng.normal(0.0, 0.3, size=2), rng.uniform(0.05, 0.2)) for _ in range(2)]


def _positions(look: Look, field: Field, rng: np.random.Generator) -> list[Array]:
    """Positions of people: most near the play, some around the field where it is free."""
    half = 0.5 * np.array([field.length, field.width])
    play = rng.uniform(-0.7, 0.7, size=2) * half
    X = np.clip(
        play + rng.normal(size=(rng.integers(*look.people, endpoint=True), 2)) * NEAR_PLAY * 2.0 * half, -half, half
    )
    if look.around.boards is not None:
        away = rng.random(len(X)) < AROUND_PLAY
        side = rng.integers(2, size=len(X))
        who = np.flatnonzero(away)
        X[who, side[who]] = np.copysign(half[side[who]] + rng.uniform(*AWAY, size=len(who)), X[who, side[who]])
    return [np.array([x, y, 0.0]) for x, y in X]


def add_objects(image: Image, light: Float32, camera: Camera, field: Field, rng: np.random.Generator) -> None:
    """Draw goals and people onto an image, in place; `light` is that of the ground, (3, height, width)."""
    goals = soccer_goals(image, camera, field, *random_goals(rng))
    people = players(image, light, camera, rng, lambda rng: random_positions(field, rng))
    add_far_to_near(camera, [*people, *goals])


def random_positions(field: Field, rng: np.random.Generator) -> list[Array]:
    """Positions of people, (3,) each: most near the play, some anywhere, some around the field."""
    half = np.array([field.length, field.width]) / 2.0
    play = rng.uniform(-0.9, 0.9, size=2) * half
    near = play + rng.normal(size=(rng.integers(0, 16), 2)) * rng.uniform(4.0, 18.0)
    anywhere = rng.uniform(-1.0, 1.0, size=(rng.integers(0, 12), 2)) * half
    around = rng.uniform(-1.0, 1.0, size=(rng.integers(0, 10), 2)) * half
    who, side = np.arange(len(around)), rng.integers(2, size=len(around))
    around[who, side] = np.copysign(half[side] + rng.uniform(0.5, 4.0), around[who, side])
    return [np.array([x, y, 0.0]) for x, y in np.concatenate([near, anywhere, around])]


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
