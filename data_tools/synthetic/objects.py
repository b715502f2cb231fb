"""What stands on a synthetic field: goals with nets, players and referees with their shadows."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np

from data_tools.synthetic.colours import random_colour, vivid_colour
from fieldcalib._types import Array
from fieldcalib.camera import Camera
from fieldcalib.field import GOAL_HEIGHT, GOAL_WIDTH, Field
from fieldcalib.render import NEAR_PLANE, SHIFT, Colour, Float32, Image, fixed_point

POST_WIDTH = 0.12  # m, law 1
FINER = 4  # px across which a pixel's share of a thin bar is counted
FARTHEST = 1e4  # px: what reaches farther out of the image is too close to the camera to be drawn
# A person facing along +x, as joints (forward, sideways, up) in shares of the height.
HEAD, NECK, HIP = (0.0, 0.0, 0.93), (0.0, 0.0, 0.83), (0.0, 0.0, 0.5)
KNEE, FOOT, ELBOW, HAND = 0.28, 0.02, 0.62, 0.5
SKIN: tuple[Colour, ...] = ((150, 180, 225), (110, 145, 200), (60, 85, 130), (40, 55, 85))


def add_objects(image: Image, light: Float32, camera: Camera, field: Field, rng: np.random.Generator) -> None:
    """Goals and people onto an image, in place, the farthest first; `light` is that of the ground, (3, h, w)."""
    goals = [np.array([sign * field.length / 2.0, 0.0, 0.0]) for sign in (-1.0, 1.0)]
    people = _positions(field, rng)
    kits = [_kit(rng) for _ in range(5)]  # two teams, two keepers, the referees
    suns = _suns(rng)
    net = random_colour(rng, saturation=(0.0, 0.2), value=(rng.choice((0.15, 0.85)), 1.0)), rng.uniform(0.1, 0.6)
    depth = rng.uniform(1.5, 2.5), rng.uniform(0.0, 1.5)
    order = sorted([*goals, *people], key=lambda X: -float(np.linalg.norm(X - camera.C)))
    for X in order:
        if any(X is goal for goal in goals):
            _add_goal(image, camera, X, net, depth)
        else:
            kit = kits[rng.choice(len(kits), p=(0.42, 0.42, 0.03, 0.03, 0.1))]
            _add_person(image, light, camera, X, kit, suns, rng)


# Goals


def _add_goal(
    image: Image, camera: Camera, middle: Array, net: tuple[Colour, float], depth: tuple[float, float]
) -> None:
    """White posts and a crossbar, `POST_WIDTH` wide, before a net: (colour, opacity) and (depth below, depth above)."""
    back = np.sign(middle[0]) * np.array([1.0, 0.0, 0.0])
    up, side = np.array([0.0, 0.0, -GOAL_HEIGHT]), np.array([0.0, GOAL_WIDTH / 2.0, 0.0])
    frame = middle + np.array([-side, -side + up, side + up, side])
    below, above = depth[0] * back, depth[1] * back
    strands: list[Sequence[Array]] = []
    for s in np.linspace(-1.0, 1.0, 25):
        strands.append([middle + s * side + up, middle + s * side + up + above, middle + s * side + below])
    for t in np.linspace(0.0, 1.0, 9):
        behind = middle + below + t * (up + above - below)
        strands.append([frame[0] + t * up, behind - side, behind + side, frame[3] + t * up])
    stays = [[frame[0] + up + above, middle + below - side, middle + below + side, frame[3] + up + above]]
    _mix_curves(image, camera, strands, 0.03, *net)
    _mix_curves(image, camera, stays, 0.06, net[0], 0.7)
    _mix_curves(image, camera, [frame], POST_WIDTH, (245, 245, 245), 1.0)


def _mix_curves(
    image: Image,
    camera: Camera,
    curves: Sequence[Sequence[Array] | Array],
    width: float,
    colour: Colour,
    opacity: float,
) -> None:
    """Bars of `width` metres through points of the world; each pixel by the share of it that they cover."""
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
    # bars thinner than a stroke of one fine pixel cover less
    share = min(1.0, thickness * FINER / strokes) * opacity / 255.0
    covered = share * cv2.resize(mask, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA).astype(np.float32)[..., None]
    patch = image[y0:y1, x0:x1]
    patch[:] = (patch + covered * (np.array(colour, np.float32) - patch)).astype(np.uint8)


# People


def _positions(field: Field, rng: np.random.Generator) -> list[Array]:
    """Where people stand, (3,) each: most near the play, some anywhere, some around the field."""
    half = np.array([field.length, field.width]) / 2.0
    play = rng.uniform(-0.9, 0.9, size=2) * half
    xy = [
        play + rng.normal(size=(rng.integers(0, 16), 2)) * rng.uniform(4.0, 18.0),
        rng.uniform(-1.0, 1.0, size=(rng.integers(0, 12), 2)) * half,
    ]
    along = rng.uniform(-1.0, 1.0, size=(rng.integers(0, 10), 2)) * half
    side = rng.integers(2, size=len(along))
    along[np.arange(len(along)), side] = np.copysign(
        half[side] + rng.uniform(0.5, 4.0), along[np.arange(len(along)), side]
    )
    return [np.array([x, y, 0.0]) for x, y in np.concatenate([*xy, along])]


def _kit(rng: np.random.Generator) -> tuple[Colour, Colour, Colour]:
    """Colours of shirt, shorts and socks."""
    shirt = vivid_colour(rng)
    shorts = shirt if rng.random() < 0.4 else vivid_colour(rng)
    return shirt, shorts, shirt if rng.random() < 0.4 else vivid_colour(rng)


def _suns(rng: np.random.Generator) -> list[tuple[Array, float]]:
    """How shadows fall, metres of ground (x, y) for a metre of height, and how dark: the sun's, those of four lamps."""
    angle, length = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.3, 2.5)
    towards = np.array([np.cos(angle), np.sin(angle)])
    kind = rng.random()
    if kind < 0.45:
        return [(length * towards, rng.uniform(0.3, 0.7))]
    if kind < 0.75:
        across = np.array([-towards[1], towards[0]])
        return [(length * d, rng.uniform(0.1, 0.25)) for d in (towards, -towards, across, -across)]
    return []


def _add_person(
    image: Image,
    light: Float32,
    camera: Camera,
    X: Array,
    kit: tuple[Colour, Colour, Colour],
    suns: Sequence[tuple[Array, float]],
    rng: np.random.Generator,
) -> None:
    """A person of thick strokes: two legs, shorts, shirt, arms and a head, in any phase of running."""
    width, height = camera.image_size
    foot = camera.project(X)
    depth = float(camera.depth(X))
    if not (depth > 2.0 and np.all(np.abs(foot - np.array([width, height]) / 2.0) < (width, height))):
        return
    tall = rng.uniform(1.65, 1.95)
    joints = tall * _pose(rng)
    heading = rng.uniform(0.0, 2.0 * np.pi)
    cos, sin = np.cos(heading), np.sin(heading)
    world = np.column_stack(
        [cos * joints[:, 0] - sin * joints[:, 1], sin * joints[:, 0] + cos * joints[:, 1], -joints[:, 2]]
    )
    scale = camera.focal_length / depth  # px per metre
    for fall, dark in suns:
        on_ground = camera.project(X + np.column_stack([world[:, :2] - world[:, 2:] * fall, np.zeros(len(world))]))
        if np.all(np.abs(on_ground) < FARTHEST):
            _darken(image, on_ground, 0.35 * scale, dark)
    xy = camera.project(X + world)
    if not np.all(np.abs(xy) < FARTHEST):
        return
    row, column = int(np.clip(foot[1], 0, height - 1)), int(np.clip(foot[0], 0, width - 1))
    lit = light[:, row, column] * rng.uniform(0.8, 1.1)
    shirt, shorts, socks, skin = (
        np.clip(np.array(colour) * lit, 0.0, 255.0).tolist() for colour in (*kit, SKIN[rng.integers(len(SKIN))])
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


def _pose(rng: np.random.Generator) -> Array:
    """Joints (11, 3) of a person one metre tall, facing +x: head, neck, hip; knee, foot, elbow, hand of each side."""
    stride, swing = rng.uniform(0.0, 0.28) * rng.choice((-1.0, 1.0)), rng.uniform(0.0, 0.25)
    raised = 0.45 if rng.random() < 0.03 else 0.0  # arms, in joy or protest
    joints = [HEAD, NECK, HIP]
    for side in (-1.0, 1.0):
        forward = side * stride
        joints += [
            (0.6 * forward + 0.05, 0.06 * side, KNEE),
            (forward - 0.1 * abs(stride), 0.06 * side, FOOT + max(0.0, -0.5 * forward)),
            (-0.4 * side * swing, 0.16 * side, ELBOW + raised),
            (0.12 - 0.8 * side * swing, 0.17 * side, HAND + 1.2 * raised),
        ]
    return np.array(joints)


def _stroke(image: Image, start: Array, end: Array, thickness: float, colour: Colour) -> None:
    """A line with round ends; strokes thinner than a pixel are drawn one pixel wide."""
    a, b = fixed_point(start).tolist(), fixed_point(end).tolist()
    cv2.line(image, a, b, colour, max(1, round(thickness)), cv2.LINE_AA, SHIFT)


def _darken(image: Image, joints: Array, thickness: float, dark: float) -> None:
    """A shadow through the joints of a body."""
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
