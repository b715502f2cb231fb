"""Goals on a synthetic field: white posts and a crossbar in front of a net."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from fieldcalib._types import Array
from fieldcalib.draw.scene import NEAR_PLANE, SHIFT, Colour, fixed_point
from fieldcalib.fields.sports.soccer import GOAL_HEIGHT, GOAL_WIDTH
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image import Image

FINER = 4  # samples across a pixel for the share of it that a thin bar covers
FARTHEST = 1e4  # px: shapes that reach farther outside the image are too close to the camera to be drawn


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
