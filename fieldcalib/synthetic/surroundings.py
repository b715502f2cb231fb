"""Surroundings of a synthetic field: advertising boards, stands with their crowds, dugouts in the foreground.

All are textures on upright walls that form rectangles around the field: boards in front, stands behind. A wall between
the camera and the field hides the ground only up to its own height.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from fieldcalib._types import BoolArray, Float32
from fieldcalib.draw.ground import Ground, rays
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.synthetic.colours import (
    BOARD_SCALE,
    STAND_HEIGHT,
    STAND_SCALE,
    Range,
    boards_texture,
    random_colour,
    stand_texture,
    wrapped,
)

BOARDS_AWAY = (2.5, 9.0)  # m behind the lines
BOARD_HEIGHT = (0.7, 1.2)  # m
DUGOUT_HEIGHT = (1.5, 2.8)  # m
STAND_AWAY = (0.5, 8.0)  # m behind the boards
FLOOR_AWAY = (0.0, 6.0)  # m behind the boards: where the foreground begins to hide the ground
OPEN_SHARE, OPEN_DROP = 0.1, 30.0  # share of grounds without stands: lowered by so many m, their tops look like trees
NOWHERE = (0.0, 0.0)
SIDES = ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0))  # coordinate and sign: behind the goals, along the touchlines


@dataclass(frozen=True)
class Around:
    """Distances of objects around a field, as ranges in metres; by default as around soccer pitches."""

    boards: Range | None = BOARDS_AWAY
    """Distance of boards behind the lines; None where boards or walls are the field's own border."""
    stands: Range = STAND_AWAY
    """Distance of stands behind the boards."""
    floor: Range = FLOOR_AWAY
    """Distance, behind the boards, from which the foreground hides the ground."""
    past: tuple[float, float] = (0.0, 0.0)
    """Extent of the field's paint beyond its length and its width, at each end."""


SOCCER = Around()


class GroundView(NamedTuple):
    """A camera, the rays of its pixels, and the points where these meet the ground."""

    camera: Camera
    ray: Float32
    ground: Ground

    @classmethod
    def of(cls, camera: Camera) -> GroundView:
        """The view of a camera onto level ground."""
        ray = rays(camera)
        return cls(camera, ray, Ground.of_rays(camera, ray))


@dataclass(frozen=True)
class Wall:
    """Points where the rays of all pixels meet an upright plane around the field."""

    height: Float32
    """Metres above the ground."""
    along: Float32
    """Metres along the wall."""
    pixel: Float32
    """Height of a pixel, metres."""
    ahead: BoolArray
    """Whether a ray meets the plane in front of the camera and within the wall's length, above or below the ground."""

    def up_to(self, top: Float32 | float) -> Float32:
        """Share of every pixel that the wall covers from the ground to a height in metres."""
        with np.errstate(invalid="ignore"):  # pixels at the horizon
            below, above = self.height / self.pixel, (top - self.height) / self.pixel
        return np.where(self.ahead, np.clip(below + 0.5, 0.0, 1.0) * np.clip(above + 0.5, 0.0, 1.0), np.float32(0.0))

    @classmethod
    def of_rays(cls, camera: Camera, ray: Float32, axis: int, at: float, half_length: float) -> Wall:
        """The wall where coordinate `axis` (0: x, 1: y) is `at`."""
        C = camera.C.astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = (at - C[axis]) / ray[axis]
            height = -C[2] - scale * ray[2]
            along = C[1 - axis] + scale * ray[1 - axis]
            pixel = np.abs(np.gradient(height, axis=0)) + np.float32(1e-6)
            ahead = (scale > 0.0) & (np.abs(along) <= half_length)
        return cls(height, along, pixel, ahead)


def add_surroundings(
    picture: Float32,
    view: GroundView,
    field: Field,
    rng: np.random.Generator,
    shown: Float32 | None = None,
    around: Around = SOCCER,
) -> BoolArray:
    """Put stands and boards around the field onto planes (3, height, width), in place.

    The boards show the texture `shown`, by default one drawn from `rng`. All positions depend on `rng` only.

    Returns
    -------
    (height, width) array
        Mask of the pixels in which the foreground hides the field.
    """
    camera, ray, ground = view
    boards, board_height, stand = boards_texture(rng), rng.uniform(*BOARD_HEIGHT), stand_texture(rng)
    boards = boards if shown is None else shown
    drop = OPEN_DROP if rng.random() < OPEN_SHARE else 0.0
    half = np.array([field.length, field.width]) / 2.0 + around.past + rng.uniform(*(around.boards or NOWHERE), size=2)
    behind = half + rng.uniform(*around.stands)
    beyond = [side for side in SIDES if side[1] * camera.C[side[0]] < half[side[0]]]  # on the other side of the field
    for axis, sign in beyond:
        wall = Wall.of_rays(camera, ray, axis, sign * behind[axis], behind[1 - axis] + 1.0)
        rows = np.clip((STAND_HEIGHT - drop - wall.height) * STAND_SCALE, 0.0, len(stand) - 1.0)
        cover(picture, wrapped(stand, wall.along * STAND_SCALE, rows), wall.up_to(np.inf))
    for axis, sign in beyond if around.boards else ():
        wall = Wall.of_rays(camera, ray, axis, sign * half[axis], half[1 - axis])
        rows = np.clip((1.0 - wall.height / board_height) * len(boards), 0.0, len(boards) - 1.0)
        cover(picture, wrapped(boards, wall.along * BOARD_SCALE, rows), wall.up_to(board_height))
    hidden = np.zeros(picture.shape[1:], bool)
    for axis, sign in (side for side in SIDES if side not in beyond):
        wall = Wall.of_rays(camera, ray, axis, sign * half[axis], half[1 - axis])
        past, along = sign * ground.xy[axis] - half[axis], ground.xy[1 - axis]
        hidden |= _add_floor(picture, past, along, stand, around.floor, rng)
        if around.boards:
            hidden |= _add_near_wall(picture, wall, rng)
    return hidden


def cover(picture: Float32, texture: Float32, share: Float32) -> None:
    """Mix a texture (height, width, 3) into every pixel by its share."""
    for plane, colour in zip(picture, np.moveaxis(texture, -1, 0), strict=True):
        plane += share * (colour - plane)


def _softened(shown: BoolArray) -> Float32:
    return np.asarray(cv2.GaussianBlur(shown.astype(np.float32), (3, 3), 0.5))


def _add_floor(
    picture: Float32, past: Float32, along: Float32, stand: Float32, away: Range, rng: np.random.Generator
) -> BoolArray:
    """Draw the foreground from some distance behind the boards on: spectators, or unchanged ground.

    `past` are distances behind the boards, metres. Returns the mask of the foreground.
    """
    floor = past > rng.uniform(*away)  # false above the horizon
    if rng.random() < 0.5:
        rows = np.clip(0.9 * STAND_HEIGHT - past, 0.0, STAND_HEIGHT - 1.0) * STAND_SCALE
        cover(picture, rng.uniform(0.3, 1.0) * wrapped(stand, along * STAND_SCALE, rows), _softened(floor))
    return np.asarray(floor)


def _add_near_wall(picture: Float32, wall: Wall, rng: np.random.Generator) -> BoolArray:
    """Draw the backs of boards and dugouts between the camera and the field; returns the mask of their pixels."""
    profile = _profile(rng)
    if not profile.any():
        return np.zeros(wall.ahead.shape, bool)
    along = np.nan_to_num(wall.along)
    top = profile[np.mod(along + 0.5 * len(profile), len(profile)).astype(np.intp)]
    share = wall.up_to(top)
    panel = np.mod(np.floor(along / rng.uniform(3.0, 12.0)), 2.0)
    colour = np.array(random_colour(rng, saturation=(0.0, 0.5), value=(0.05, 0.95)), np.float32)
    cover(picture, (1.0 - rng.uniform(0.0, 0.6) * panel)[..., None] * colour, share)
    return np.asarray(share > 0.5)


def _profile(rng: np.random.Generator) -> Float32:
    """Height of the near wall at each metre: nothing, boards, or dugouts between gaps."""
    height = np.zeros(128, np.float32)
    if rng.random() < 0.6:
        height[:] = rng.choice((0.0, rng.uniform(*BOARD_HEIGHT)))
        for start in rng.integers(0, 110, size=rng.integers(0, 4)):
            height[start : start + rng.integers(4, 18)] = rng.choice((0.0, rng.uniform(*DUGOUT_HEIGHT)))
    return height
