"""Objects on a synthetic field, drawn from the farthest to the nearest.

Goals on a synthetic field: white posts and a crossbar in front of a net.

Players and referees on a synthetic field, with their shadows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np

from data_tools.synthetic.colours import random_colour, vivid_colour
from fieldcalib._types import Array, Float32
from fieldcalib.draw.scene import NEAR_PLANE, SHIFT, Colour, fixed_point
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import GOAL_HEIGHT, GOAL_WIDTH
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import Image

FINER = 4  # samples across a pixel for the share of it that a thin bar covers
FARTHEST = 1e4  # px: shapes that reach farther outside the image are too close to the camera to be drawn

# A person facing along +x, as joints (forward, sideways, up) in shares of the height.
HEAD, NECK, HIP = (0.0, 0.0, 0.93), (0.0, 0.0, 0.83), (0.0, 0.0, 0.5)
KNEE, FOOT, ELBOW, HAND = 0.28, 0.02, 0.62, 0.5
SKIN: tuple[Colour, ...] = ((150, 180, 225), (110, 145, 200), (60, 85, 130), (40, 55, 85))
Kit: TypeAlias = tuple[Colour, Colour, Colour]  # shirt, shorts, socks
Sun: TypeAlias = tuple[Array, float]  # shadow (x, y) in metres per metre of height, and its darkness
NEAREST = 2.0  # m in front of the camera

TEAM_SHARES = (0.42, 0.42, 0.03, 0.03, 0.1)  # of the people: two teams, two keepers, the referees


@dataclass(frozen=True)
class GoalFrame:
    """Posts and crossbar: size of the goal, thickness and colour; by default those of soccer (law 1)."""

    width: float = GOAL_WIDTH
    height: float = GOAL_HEIGHT
    bars: float = 0.12
    colour: Colour = (245, 245, 245)


def add_goal(
    image: Image,
    camera: Camera,
    middle: Array,
    net: tuple[Colour, float],
    depth: tuple[float, float],
    goal: GoalFrame = GoalFrame(),
) -> None:
    """Draw posts and a crossbar before a net of (colour, opacity) and (depth below, depth above)."""
    back = np.sign(middle[0]) * np.array([1.0, 0.0, 0.0])
    up, side = np.array([0.0, 0.0, -goal.height]), np.array([0.0, goal.width / 2.0, 0.0])
    frame = middle + np.array([-side, -side + up, side + up, side])
    xy = camera.project(frame)
    if np.any(np.max(xy, axis=0) < 0.0) or np.any(np.min(xy, axis=0) > camera.image_size):
        return
    below, above = depth[0] * back, depth[1] * back
    strands: list[Sequence[Array]] = []
    for s in np.linspace(-1.0, 1.0, 25):
        strands.append([middle + s * side + up, middle + s * side + up + above, middle + s * side + below])
    for t in np.linspace(0.0, 1.0, 9):
        behind = middle + below + t * (up + above - below)
        strands.append([frame[0] + t * up, behind - side, behind + side, frame[3] + t * up])
    stays = [[frame[0] + up + above, middle + below - side, middle + below + side, frame[3] + up + above]]
    mix_bars(image, camera, strands, 0.03, *net)
    mix_bars(image, camera, stays, 0.06, net[0], 0.7)
    mix_bars(image, camera, [frame], goal.bars, goal.colour, 1.0)


def mix_bars(
    image: Image,
    camera: Camera,
    curves: Sequence[Sequence[Array] | Array],
    width: float,
    colour: Colour,
    opacity: float,
) -> None:
    """Draw bars of `width` metres through points of the world; each pixel is mixed by the share that they cover."""
    drawn = []
    for curve in curves:
        ends = np.asarray(curve)
        X = np.concatenate([np.linspace(a, b, 5) for a, b in pairwise(ends)])
        xy, near = camera.project(X), camera.depth(X) > NEAR_PLANE
        if np.all(near) and np.all(np.abs(xy) < FARTHEST):
            drawn.append(xy)
    if not drawn:
        return
    depth = float(np.mean([camera.depth(np.asarray(curve)).mean() for curve in curves]))
    thickness = width * camera.focal_length / max(depth, 1.0)  # px
    low = np.maximum(np.floor(np.min([xy.min(axis=0) for xy in drawn], axis=0) - thickness - 1.0), 0.0).astype(int)
    size = np.array(camera.image_size)
    high = np.minimum(np.ceil(np.max([xy.max(axis=0) for xy in drawn], axis=0) + thickness + 2.0), size).astype(int)
    if np.any(low >= high):
        return
    (x0, y0), (x1, y1) = low.tolist(), high.tolist()
    mask = np.zeros(((y1 - y0) * FINER, (x1 - x0) * FINER), np.uint8)
    points = [fixed_point((xy - low + 0.5) * FINER - 0.5) for xy in drawn]
    strokes = max(1, round(thickness * FINER))
    cv2.polylines(mask, points, False, 255, strokes, cv2.LINE_8, SHIFT)
    # a bar that is thinner than one sample covers less of it
    share = min(1.0, thickness * FINER / strokes) * opacity / 255.0
    covered = share * cv2.resize(mask, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA).astype(np.float32)[..., None]
    patch = image[y0:y1, x0:x1]
    patch[:] = (patch + covered * (np.array(colour, np.float32) - patch)).astype(np.uint8)


def random_kit(rng: np.random.Generator) -> Kit:
    """Colours of a team."""
    shirt = vivid_colour(rng)
    shorts = shirt if rng.random() < 0.4 else vivid_colour(rng)
    return shirt, shorts, shirt if rng.random() < 0.4 else vivid_colour(rng)


def random_suns(rng: np.random.Generator) -> list[Sun]:
    """Shadows: of the sun, of four floodlights, or none."""
    angle, length = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.3, 2.5)
    towards = np.array([np.cos(angle), np.sin(angle)])
    kind = rng.random()
    if kind < 0.45:
        return [(length * towards, rng.uniform(0.3, 0.7))]
    if kind < 0.75:
        across = np.array([-towards[1], towards[0]])
        return [(length * d, rng.uniform(0.1, 0.25)) for d in (towards, -towards, across, -across)]
    return []


@dataclass(frozen=True)
class Person:
    """A person in the middle of a step."""

    tall: float
    """Height in metres."""
    stride: float
    """Distance of the front foot forwards, and of the other foot backwards, as a share of the height."""
    swing: float
    """Swing of the arms, as a share of the height."""
    raised: bool
    """Whether the arms are raised."""
    heading: float
    """Direction in radians from x."""
    bright: float
    skin: Colour

    @classmethod
    def random(cls, rng: np.random.Generator) -> Person:
        """A random person in a random phase of running."""
        tall = rng.uniform(1.65, 1.95)
        stride, swing = rng.uniform(0.0, 0.28) * rng.choice((-1.0, 1.0)), rng.uniform(0.0, 0.25)
        raised, heading = bool(rng.random() < 0.03), rng.uniform(0.0, 2.0 * np.pi)
        return cls(tall, stride, swing, raised, heading, rng.uniform(0.8, 1.1), SKIN[rng.integers(len(SKIN))])

    @property
    def joints(self) -> Array:
        """Joints (11, 3), metres from the person's place: head, neck, hip; knee, foot, elbow, hand of each side."""
        up = 0.45 if self.raised else 0.0
        pose = [HEAD, NECK, HIP]
        for side in (-1.0, 1.0):
            forward = side * self.stride
            pose += [
                (0.6 * forward + 0.05, 0.06 * side, KNEE),
                (forward - 0.1 * abs(self.stride), 0.06 * side, FOOT + max(0.0, -0.5 * forward)),
                (-0.4 * side * self.swing, 0.16 * side, ELBOW + up),
                (0.12 - 0.8 * side * self.swing, 0.17 * side, HAND + 1.2 * up),
            ]
        forward, sideways, height = self.tall * np.array(pose).T
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        return np.column_stack([cos * forward - sin * sideways, sin * forward + cos * sideways, -height])


def add_person(
    image: Image, light: Float32, camera: Camera, X: Array, person: Person, kit: Kit, suns: Sequence[Sun]
) -> None:
    """Draw a person in thick strokes: two legs, shorts, shirt, arms and a head."""
    width, height = camera.image_size
    foot = camera.project(X)
    depth = float(camera.depth(X))
    if not (depth > NEAREST and np.all(np.abs(foot - np.array([width, height]) / 2.0) < (width, height))):
        return
    world = person.joints
    scale = camera.focal_length / depth  # px per metre
    for fall, dark in suns:
        on_ground = camera.project(X + np.column_stack([world[:, :2] - world[:, 2:] * fall, np.zeros(len(world))]))
        if np.all(np.abs(on_ground) < FARTHEST):
            _darken(image, on_ground, 0.35 * scale, dark)
    xy = camera.project(X + world)
    if not np.all(np.abs(xy) < FARTHEST):
        return
    row, column = int(np.clip(foot[1], 0, height - 1)), int(np.clip(foot[0], 0, width - 1))
    lit = light[:, row, column] * person.bright
    shirt, shorts, socks, skin = (
        np.clip(np.array(colour) * lit, 0.0, 255.0).tolist() for colour in (*kit, person.skin)
    )
    head, neck, hip, *limbs = xy
    for side in (0, 1):
        knee, ankle, elbow, hand = limbs[4 * side : 4 * side + 4]
        _stroke(image, knee, ankle, 0.13 * scale, socks)
        _stroke(image, hip, knee, 0.18 * scale, shorts)
        _stroke(image, elbow, hand, 0.09 * scale, skin)
        _stroke(image, neck, elbow, 0.13 * scale, shirt)
    _stroke(image, neck, hip, 0.36 * scale, shirt)
    _stroke(image, head, head, 0.23 * scale, skin)


def _stroke(image: Image, start: Array, end: Array, thickness: float, colour: Colour) -> None:
    """Draw a line with round ends, at least one pixel wide."""
    a, b = fixed_point(start).tolist(), fixed_point(end).tolist()
    cv2.line(image, a, b, colour, max(1, round(thickness)), cv2.LINE_AA, SHIFT)


def _darken(image: Image, joints: Array, thickness: float, dark: float) -> None:
    """Draw a shadow through the joints of a body."""
    low = np.maximum(joints.min(axis=0) - thickness - 1.0, 0.0).astype(int)
    high = np.minimum(joints.max(axis=0) + thickness + 2.0, image.shape[1::-1]).astype(int)
    if np.any(low >= high):
        return
    patch = image[low[1] : high[1], low[0] : high[0]]
    shadow = np.zeros(patch.shape[:2], np.uint8)
    head, _, hip, *limbs = joints - low
    for a, b in ((head, hip), (hip, limbs[1]), (hip, limbs[5])):
        ends = fixed_point(a).tolist(), fixed_point(b).tolist()
        cv2.line(shadow, *ends, 255, max(1, round(thickness)), cv2.LINE_AA, SHIFT)
    patch[:] = (patch * (1.0 - np.float32(dark / 255.0) * shadow[..., None])).astype(np.uint8)


class Drawable(NamedTuple):
    """A person or an object on the field, and how it is drawn."""

    X: Array
    """Position in metres, (3,)."""
    draw: Callable[[], object]
    """Draws it onto the image."""


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
