"""Textures of the surroundings of a synthetic field: advertising boards, and stands with their crowds."""

from __future__ import annotations

import string

import cv2
import numpy as np

from fieldcalib._types import Float32
from fieldcalib.draw.scene import Colour
from fieldcalib.io.image import Image
from fieldcalib.synthetic.colours import GREY, random_colour, vivid_colour

LENGTH = 128.0  # m that a texture covers before it repeats
STAND_HEIGHT = 40.0  # m
STAND_SCALE, BOARD_SCALE = 5.0, 16.0  # px per metre
FONT = cv2.FONT_HERSHEY_SIMPLEX


def boards_texture(rng: np.random.Generator) -> Float32:
    """A strip of advertisements, (16, 2048, 3): panels with words."""
    strip = np.empty((16, round(LENGTH * BOARD_SCALE), 3), np.uint8)
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


def stand_texture(rng: np.random.Generator) -> Float32:
    """A stand's face, (200, 640, 3): tiers of crowd or seats, aisles, rails, banners, doors, and a roof above."""
    rows, columns = round(STAND_HEIGHT * STAND_SCALE), round(LENGTH * STAND_SCALE)
    face = np.empty((rows, columns, 3), np.uint8)
    palette = np.array([vivid_colour(rng) for _ in range(3)], np.uint8)
    face[:] = palette[0]  # empty seats
    crowded = rng.random(size=(1, 16)) < rng.choice((0.0, 0.5, 0.95), p=(0.15, 0.25, 0.6))
    crowded = np.repeat(np.repeat(crowded, columns // 16, axis=1), rows, axis=0)
    _letters(face, palette[1], rng)
    # some spectators wear colours of the teams
    team = palette[rng.integers(len(palette), size=(rows // 2, columns // 2))]
    anything = rng.integers(0, 256, size=(rows // 2, columns // 2, 3), dtype=np.uint8)
    dressed = np.where(rng.random((rows // 2, columns // 2, 1)) < rng.uniform(0.1, 0.8), team, anything)
    people = cv2.resize(dressed, (columns, rows), interpolation=cv2.INTER_NEAREST)
    face[crowded] = people[crowded]
    colour = face.astype(np.float32)
    colour *= 0.6 + 0.8 * rng.random((rows, columns, 1), dtype=np.float32)
    pale = rng.uniform(0.0, 0.8)
    colour += pale * ((colour @ GREY)[..., None] - colour)
    if rng.random() < 0.6:
        cv2.GaussianBlur(colour, (0, 0), rng.uniform(0.5, 1.5), dst=colour)
    _fittings(colour, rng)
    colour *= rng.uniform(0.12, 0.4) if rng.random() < 0.4 else rng.uniform(0.4, 1.0)  # many stands are in the dark
    roof = int(rng.uniform(0.0, 0.65) * rows)
    colour[:roof] = random_colour(rng, (180.0, 260.0), (0.0, 0.4), (0.02, 0.9))
    if rng.random() < 0.5:  # lamps or a screen below the roof
        for x in rng.integers(0, columns, size=rng.integers(1, 20)).tolist():
            cv2.circle(colour, (x, max(roof - 3, 0)), 2, (255, 255, 250), cv2.FILLED)
    return np.clip(colour, 0.0, 255.0)


def _letters(face: Image, colour: Image, rng: np.random.Generator) -> None:
    """Draw words of seats in another colour."""
    for _ in range(rng.integers(0, 4)):
        origin = (int(rng.integers(0, face.shape[1] - 100)), int(rng.integers(60, face.shape[0])))
        word = "".join(rng.choice(list(string.ascii_uppercase), size=6))
        cv2.putText(face, word, origin, FONT, rng.uniform(0.8, 2.5), colour.tolist(), int(rng.integers(2, 7)))


def _fittings(face: Float32, rng: np.random.Generator) -> None:
    """Draw aisles, rails, tiers and banners: straight and partly white lines that are no markings."""
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


def _write(picture: Image, origin: tuple[int, int], scale: float, colour: Colour, rng: np.random.Generator) -> None:
    word = "".join(rng.choice(list(string.ascii_uppercase + string.digits), size=rng.integers(3, 9)))
    cv2.putText(picture, word, origin, FONT, scale, colour, 1, cv2.LINE_AA)
