"""What stands around a synthetic field: advertising boards, stands with their crowds, dugouts in the foreground.

All are textures on upright walls, a rectangle of them around the field: the stands behind, boards in front. A wall
between the camera and the field hides the ground only up to its own height.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from data_tools.synthetic.colours import random_colour, wrapped
from data_tools.synthetic.textures import BOARD_SCALE, STAND_HEIGHT, STAND_SCALE, boards_texture, stand_texture
from fieldcalib._types import BoolArray, Float32
from fieldcalib.draw.scene import Ground
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera

BOARDS_AWAY = (2.5, 9.0)  # m behind the lines
BOARD_HEIGHT = (0.7, 1.2)  # m
DUGOUT_HEIGHT = (1.5, 2.8)  # m
STAND_AWAY = (0.5, 8.0)  # m behind the boards
FLOOR_AWAY = (0.0, 6.0)  # m behind the boards: where the foreground begins to hide the ground
OPEN_SHARE, OPEN_DROP = 0.1, 30.0  # of the grounds have no stands: only the uppermost 10 m of them are seen, as trees
SIDES = ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0))  # coordinate and sign: behind the goals, along the touchlines


@dataclass(frozen=True)
class Wall:
    """Where the rays of all pixels meet an upright plane around the field."""

    height: Float32
    """Metres above the ground."""
    along: Float32
    """Metres along the wall."""
    met: BoolArray
    """Whether they meet it above the ground and in front of the camera, within the length of the wall."""

    @classmethod
    def of_rays(cls, camera: Camera, ray: Float32, axis: int, at: float, half_length: float) -> Wall:
        """The wall where coordinate `axis` (0: x, 1: y) is `at`."""
        C = camera.C.astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = (at - C[axis]) / ray[axis]
            height = -C[2] - scale * ray[2]
            along = C[1 - axis] + scale * ray[1 - axis]
            met = (scale > 0.0) & (height > 0.0) & (np.abs(along) <= half_length)
        return cls(height, along, met)


def add_surroundings(
    picture: Float32, camera: Camera, ray: Float32, ground: Ground, field: Field, rng: np.random.Generator
) -> BoolArray:
    """Put stands and boards around the field onto planes (3, height, width), in place.

    Returns
    -------
    (height, width) array
        Where the foreground hides the field.
    """
    boards, board_height, stand = boards_texture(rng), rng.uniform(*BOARD_HEIGHT), stand_texture(rng)
    drop = OPEN_DROP if rng.random() < OPEN_SHARE else 0.0
    half = np.array([field.length, field.width]) / 2.0 + rng.uniform(*BOARDS_AWAY, size=2)
    behind = half + rng.uniform(*STAND_AWAY)
    beyond = [side for side in SIDES if side[1] * camera.C[side[0]] < half[side[0]]]  # past the field
    for axis, sign in beyond:
        wall = Wall.of_rays(camera, ray, axis, sign * behind[axis], behind[1 - axis] + 1.0)
        rows = np.clip((STAND_HEIGHT - drop - wall.height) * STAND_SCALE, 0.0, len(stand) - 1.0)
        _cover(picture, wrapped(stand, wall.along * STAND_SCALE, rows), wall.met)
    for axis, sign in beyond:
        wall = Wall.of_rays(camera, ray, axis, sign * half[axis], half[1 - axis])
        rows = (1.0 - wall.height / board_height) * len(boards)
        _cover(picture, wrapped(boards, wall.along * BOARD_SCALE, rows), wall.met & (wall.height < board_height))
    hidden = np.zeros(picture.shape[1:], bool)
    for axis, sign in (side for side in SIDES if side not in beyond):
        wall = Wall.of_rays(camera, ray, axis, sign * half[axis], half[1 - axis])
        past, along = sign * ground.xy[axis] - half[axis], ground.xy[1 - axis]
        hidden |= _add_floor(picture, past, along, stand, rng) | _add_near_wall(picture, wall, rng)
    return hidden


def _cover(picture: Float32, texture: Float32, shown: BoolArray) -> None:
    """Texture (height, width, 3) over the pixels that show it, with soft edges."""
    share = cv2.GaussianBlur(shown.astype(np.float32), (3, 3), 0.5)
    for plane, colour in zip(picture, np.moveaxis(texture, -1, 0), strict=True):
        plane += share * (colour - plane)


def _add_floor(picture: Float32, past: Float32, along: Float32, stand: Float32, rng: np.random.Generator) -> BoolArray:
    """Spectators, or the ground as it is, from somewhat behind the boards on; `past` is metres behind them."""
    floor = past > rng.uniform(*FLOOR_AWAY)  # false above the horizon
    if rng.random() < 0.5:
        rows = np.clip(0.9 * STAND_HEIGHT - past, 0.0, STAND_HEIGHT - 1.0) * STAND_SCALE
        _cover(picture, rng.uniform(0.3, 1.0) * wrapped(stand, along * STAND_SCALE, rows), floor)
    return np.asarray(floor)


def _add_near_wall(picture: Float32, wall: Wall, rng: np.random.Generator) -> BoolArray:
    """The backs of boards and dugouts between the camera and the field."""
    profile = _profile(rng)
    if not profile.any():
        return np.zeros(wall.met.shape, bool)
    along = np.nan_to_num(wall.along)
    top = profile[np.mod(along + 0.5 * len(profile), len(profile)).astype(np.intp)]
    shown = wall.met & (wall.height < top)
    panel = np.mod(np.floor(along / rng.uniform(3.0, 12.0)), 2.0)
    colour = np.array(random_colour(rng, saturation=(0.0, 0.5), value=(0.05, 0.95)), np.float32)
    _cover(picture, (1.0 - rng.uniform(0.0, 0.6) * panel)[..., None] * colour, shown)
    return np.asarray(shown)


def _profile(rng: np.random.Generator) -> Float32:
    """How high the near wall is at each metre: nothing, boards, or dugouts between gaps."""
    height = np.zeros(128, np.float32)
    if rng.random() < 0.6:
        height[:] = rng.choice((0.0, rng.uniform(*BOARD_HEIGHT)))
        for start in rng.integers(0, 110, size=rng.integers(0, 4)):
            height[start : start + rng.integers(4, 18)] = rng.choice((0.0, rng.uniform(*DUGOUT_HEIGHT)))
    return height
