"""What stands around a synthetic field: advertising boards, stands with their crowds, dugouts in the foreground.

All are textures on upright walls, a rectangle of them around the field: the stands behind, boards in front. A wall
between the camera and the field hides the ground only up to its own height.
"""

from __future__ import annotations

import math
import string
from dataclasses import dataclass

import cv2
import numpy as np

from data_tools.synthetic.colours import random_colour, vivid_colour, wrapped
from fieldcalib._types import BoolArray
from fieldcalib.camera import Camera
from fieldcalib.field import Field
from fieldcalib.render import Float32, Image

BOARDS_AWAY = (2.5, 9.0)  # m behind the lines
BOARD_HEIGHT = (0.7, 1.2)  # m
STAND_AWAY = (0.5, 8.0)  # m behind the boards
STAND_HEIGHT, STAND_LENGTH = 40.0, 128.0  # m that the texture covers before it repeats
STAND_SCALE, BOARD_SCALE = 5.0, 16.0  # px of the textures per metre
FONT = cv2.FONT_HERSHEY_SIMPLEX


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
    picture: Float32, camera: Camera, ray: Float32, field: Field, rng: np.random.Generator
) -> BoolArray:
    """Put stands and boards around the field onto planes (3, height, width), in place; the foreground that hides it."""
    away, behind = rng.uniform(*BOARDS_AWAY, size=2), rng.uniform(*STAND_AWAY)
    boards, board_height = _boards(rng), rng.uniform(*BOARD_HEIGHT)
    stand = _stand(rng)
    bowl = rng.random() < 0.9  # otherwise a ground with a low fence, and trees or houses behind
    hidden = np.zeros(picture.shape[1:], bool)
    half = np.array([field.length, field.width]) / 2.0 + away
    walls = [(axis, sign) for axis in (0, 1) for sign in (-1.0, 1.0)]
    beyond = [sign * camera.C[axis] < half[axis] for axis, sign in walls]  # the field is on the camera's side of it
    for (axis, sign), is_beyond in zip(walls, beyond, strict=True):
        if is_beyond:
            wall = Wall.of_rays(camera, ray, axis, sign * (half[axis] + behind), half[1 - axis] + behind + 1.0)
            rows = (STAND_HEIGHT - (wall.height if bowl else wall.height + 30.0)) * STAND_SCALE
            _cover(picture, wrapped(stand, wall.along * STAND_SCALE, np.clip(rows, 0.0, len(stand) - 1.0)), wall.met)
    for (axis, sign), is_beyond in zip(walls, beyond, strict=True):
        wall = Wall.of_rays(camera, ray, axis, sign * half[axis], half[1 - axis])
        if is_beyond:
            rows = (1.0 - wall.height / board_height) * len(boards)
            shown = wall.met & (wall.height < board_height)
            _cover(picture, wrapped(boards, wall.along * BOARD_SCALE, rows), shown)
        else:
            hidden |= _foreground(picture, camera, ray, wall, (axis, sign * half[axis]), stand, rng)
    return hidden


def _cover(picture: Float32, texture: Float32, shown: BoolArray) -> None:
    """Texture (height, width, 3) over the pixels that show it, with soft edges."""
    share = cv2.GaussianBlur(shown.astype(np.float32), (3, 3), 0.5)
    for plane, colour in zip(picture, np.moveaxis(texture, -1, 0), strict=True):
        plane += share * (colour - plane)


def _foreground(
    picture: Float32,
    camera: Camera,
    ray: Float32,
    wall: Wall,
    place: tuple[int, float],
    stand: Float32,
    rng: np.random.Generator,
) -> BoolArray:
    """Spectators, concrete, boards and dugouts between the camera and the field."""
    axis, at = place
    C = camera.C.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = -C[2] / ray[2]
        across = math.copysign(1.0, at) * (C[axis] + scale * ray[axis] - at)
        along = C[1 - axis] + scale * ray[1 - axis]
    floor = (scale > 0.0) & (across > rng.uniform(0.0, 6.0))
    if rng.random() < 0.5:
        rows = np.clip(STAND_HEIGHT * 0.9 - across, 0.0, STAND_HEIGHT - 1.0) * STAND_SCALE
        _cover(picture, wrapped(stand, along * STAND_SCALE, rows) * rng.uniform(0.3, 1.0), floor)
    profile = _profile(rng)
    top = profile[np.mod(np.nan_to_num(wall.along) + 0.5 * len(profile), len(profile)).astype(np.intp)]
    hidden = wall.met & (wall.height < top)
    panel = np.mod(np.floor(np.nan_to_num(wall.along) / rng.uniform(3.0, 12.0)), 2.0)
    colour = np.array(random_colour(rng, saturation=(0.0, 0.5), value=(0.05, 0.95)), np.float32)
    _cover(picture, (1.0 - rng.uniform(0.0, 0.6) * panel)[..., None] * colour, hidden)
    return np.asarray(hidden | floor)


def _profile(rng: np.random.Generator) -> Float32:
    """How high the near wall is at each metre: nothing, boards, or dugouts between gaps."""
    height = np.zeros(128, np.float32)
    if rng.random() < 0.6:
        height[:] = rng.choice((0.0, rng.uniform(*BOARD_HEIGHT)))
        for start in rng.integers(0, 110, size=rng.integers(0, 4)):
            height[start : start + rng.integers(4, 18)] = rng.choice((0.0, rng.uniform(1.5, 2.8)))
    return height


def _boards(rng: np.random.Generator) -> Float32:
    """A strip of advertisements, (16, 2048, 3): panels with words."""
    strip = np.empty((16, round(STAND_LENGTH * BOARD_SCALE), 3), np.uint8)
    same = [vivid_colour(rng) for _ in range(rng.integers(1, 6))]
    x = 0
    while x < strip.shape[1]:
        width = int(rng.uniform(3.0, 14.0) * BOARD_SCALE)
        strip[:, x : x + width] = same[rng.integers(len(same))]
        _write(strip, (x + 6, 13), 0.5, vivid_colour(rng), rng)
        x += width
    if rng.random() < 0.5:
        strip[: rng.integers(1, 3)] = vivid_colour(rng)  # the upper edge, often bright
    return strip.astype(np.float32)


def _stand(rng: np.random.Generator) -> Float32:
    """A stand's face, (200, 640, 3): tiers of crowd or seats, aisles, rails, banners, doors, and a roof above."""
    rows, columns = round(STAND_HEIGHT * STAND_SCALE), round(STAND_LENGTH * STAND_SCALE)
    face = np.empty((rows, columns, 3), np.uint8)
    palette = np.array([vivid_colour(rng) for _ in range(3)], np.uint8)
    face[:] = palette[0]  # empty seats
    crowded = rng.random(size=(1, 16)) < rng.choice((0.0, 0.5, 0.95), p=(0.15, 0.25, 0.6))
    crowded = np.repeat(np.repeat(crowded, columns // 16, axis=1), rows, axis=0)
    _letters(face, palette[1], rng)
    # spectators wear anything, more or less in the colours of their team
    team = palette[rng.integers(len(palette), size=(rows // 2, columns // 2))]
    anything = rng.integers(0, 256, size=(rows // 2, columns // 2, 3), dtype=np.uint8)
    dressed = np.where(rng.random((rows // 2, columns // 2, 1)) < rng.uniform(0.1, 0.8), team, anything)
    people = cv2.resize(dressed, (columns, rows), interpolation=cv2.INTER_NEAREST)
    face[crowded] = people[crowded]
    colour = face.astype(np.float32)
    colour *= rng.uniform(0.6, 1.4, size=(rows, columns, 1)).astype(np.float32)
    pale = rng.uniform(0.0, 0.8)
    colour += pale * (colour.mean(axis=-1, keepdims=True) - colour)
    if rng.random() < 0.6:
        cv2.GaussianBlur(colour, (0, 0), rng.uniform(0.5, 1.5), dst=colour)
    _fittings(colour, rng)
    colour *= rng.uniform(0.12, 0.4) if rng.random() < 0.4 else rng.uniform(0.4, 1.0)  # many stands lie in the dark
    roof = int(rng.uniform(0.0, 0.65) * rows)
    colour[:roof] = random_colour(rng, (180.0, 260.0), (0.0, 0.4), (0.02, 0.9))
    if rng.random() < 0.5:  # lamps or a screen below the roof
        for x in rng.integers(0, columns, size=rng.integers(1, 20)).tolist():
            cv2.circle(colour, (x, max(roof - 3, 0)), 2, (255, 255, 250), cv2.FILLED)
    return np.clip(colour, 0.0, 255.0)


def _letters(face: Image, colour: Image, rng: np.random.Generator) -> None:
    """Words that are spelt in seats of another colour."""
    for _ in range(rng.integers(0, 4)):
        origin = (int(rng.integers(0, face.shape[1] - 100)), int(rng.integers(60, face.shape[0])))
        word = "".join(rng.choice(list(string.ascii_uppercase), size=6))
        cv2.putText(face, word, origin, FONT, rng.uniform(0.8, 2.5), colour.tolist(), int(rng.integers(2, 7)))


def _fittings(face: Float32, rng: np.random.Generator) -> None:
    """Aisles, rails, tiers and banners: most of them straight, some of them white, none of them markings."""
    rows, columns = face.shape[:2]
    aisle = random_colour(rng, saturation=(0.0, 0.2), value=(0.3, 1.0))
    for x in range(int(rng.integers(20)), columns, int(rng.integers(40, 90))):
        cv2.line(face, (x, 0), (x + int(rng.integers(-8, 9)), rows), aisle, int(rng.integers(1, 4)))
    for _ in range(rng.integers(1, 5)):
        y = int(rng.integers(0, rows))
        cv2.line(face, (0, y), (columns, y), vivid_colour(rng), int(rng.integers(1, 6)))
    for _ in range(rng.integers(0, 14)):  # banners and doors
        left, top = int(rng.integers(0, columns)), int(rng.integers(rows // 2, rows))
        corner = (left + int(rng.integers(4, 60)), top + int(rng.integers(3, 14)))
        cv2.rectangle(face, (left, top), corner, vivid_colour(rng), cv2.FILLED)
    if rng.random() < 0.3:  # a fence or a wall at the foot
        face[-int(rng.integers(2, 14)) :] = vivid_colour(rng)


def _write(
    picture: Image, origin: tuple[int, int], scale: float, colour: tuple[int, int, int], rng: np.random.Generator
) -> None:
    word = "".join(rng.choice(list(string.ascii_uppercase + string.digits), size=rng.integers(3, 9)))
    cv2.putText(picture, word, origin, FONT, scale, colour, 1, cv2.LINE_AA)
