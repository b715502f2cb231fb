"""The boards around a rink: upright walls along its sides and round its corners."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from data_tools.synthetic.colours import BOARD_SCALE, boards_texture, random_colour, vivid_colour, wrapped
from data_tools.synthetic.surroundings import SIDES, Wall, cover
from fieldcalib._types import BoolArray, Float32
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc
from fieldcalib.geometry.camera import Camera

KICK_PLATE, RAIL = 0.2, 0.06  # m: at the foot, usually yellow, and at the top


def add_boards(
    picture: Float32, camera: Camera, ray: Float32, field: Field, height: float, rng: np.random.Generator
) -> BoolArray:
    """Draw boards onto planes (3, height, width), in place; returns the mask of the pixels in which they hide the
    ice."""
    texture = _texture(height, rng)
    outside = np.full_like(texture, np.float32(rng.uniform(20.0, 90.0)))
    hidden = np.zeros(picture.shape[1:], bool)
    for wall, near in sorted(_walls(camera, ray, field), key=lambda one: one[1]):
        rows = np.clip((1.0 - wall.height / height) * len(texture), 0.0, len(texture) - 1.0)
        share = wall.up_to(height)
        cover(picture, wrapped(outside if near else texture, wall.along * BOARD_SCALE, rows), share)
        if near:
            hidden |= share > 0.5
    return hidden


def _texture(height: float, rng: np.random.Generator) -> Float32:
    """White boards with advertisements on most of them, (rows, columns, 3)."""
    rows = 32
    adverts = np.repeat(boards_texture(rng), rows // 16, axis=0)
    white = random_colour(rng, saturation=(0.0, 0.05), value=(0.85, 1.0))
    if rng.random() < 0.4:
        adverts[:] = white
    for start in rng.integers(0, adverts.shape[1], size=rng.integers(2, 10)):
        adverts[:, start : start + int(rng.uniform(2.0, 15.0) * BOARD_SCALE)] = white
    adverts[round(rows * (1.0 - KICK_PLATE / height)) :] = random_colour(rng, (42.0, 58.0), (0.5, 0.95), (0.7, 1.0))
    adverts[: max(1, round(rows * RAIL / height))] = vivid_colour(rng)
    return adverts


def _walls(camera: Camera, ray: Float32, field: Field) -> Iterator[tuple[Wall, bool]]:
    """The parts of the boards, and whether they stand between the camera and the ice."""
    corners = [segment for label, segment in field.markings.items() if label.startswith("Corner board")]
    half = 0.5 * field.length, 0.5 * field.width
    radius = corners[0].radius if corners and isinstance(corners[0], Arc) else 0.0
    for axis, sign in SIDES:
        near = bool(sign * camera.C[axis] > half[axis])
        yield Wall.of_rays(camera, ray, axis, sign * half[axis], half[1 - axis] - radius), near
    for corner in corners:
        if isinstance(corner, Arc):
            yield from _corner_walls(camera, ray, corner)


def _corner_walls(camera: Camera, ray: Float32, corner: Arc) -> Iterator[tuple[Wall, bool]]:
    """Points where rays enter and leave a cylinder, in the quarter that is the corner."""
    C = (camera.C - corner.center).astype(np.float32)
    a = np.square(ray[0]) + np.square(ray[1])
    b = ray[0] * C[0] + ray[1] * C[1]
    c = float(C[0] ** 2 + C[1] ** 2) - np.float32(corner.radius) ** 2
    outwards = np.sign(corner.center[:2])
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(b * b - a * c)
        for sign in (1.0, -1.0):
            scale = np.asarray((-b + sign * root) / a, np.float32)
            x, y = C[0] + scale * ray[0], C[1] + scale * ray[1]
            height = np.asarray(-camera.C[2] - scale * ray[2], np.float32)
            pixel = np.asarray(np.abs(np.gradient(height, axis=0)) + np.float32(1e-6), np.float32)
            ahead = (scale > 0.0) & (x * outwards[0] >= 0.0) & (y * outwards[1] >= 0.0) & np.isfinite(pixel)
            along = np.asarray(corner.radius * np.arctan2(y, x), np.float32)
            yield Wall(np.nan_to_num(height), np.nan_to_num(along), np.nan_to_num(pixel, nan=1.0), ahead), sign < 0.0
