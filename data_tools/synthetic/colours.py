"""Colours and noise that synthetic frames draw from.

Textures of the surroundings of a synthetic field: advertising boards, and stands with their crowds.
"""

from __future__ import annotations

import colorsys
import string
from collections.abc import Sequence
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np

from fieldcalib._types import Float32
from fieldcalib.draw.scene import Colour
from fieldcalib.io.image_files import Image

V = TypeVar("V")
Range = tuple[float, float]
Hsv = tuple[Range, Range, Range]  # hue in degrees, saturation, value
GREY = np.full(3, 1.0 / 3.0, np.float32)  # weights of the channels in brightness
NOISE_SIZE = 512  # px: side of the noise tile
OCTAVES = 7  # its coarsest spots are 64 px wide

LENGTH = 128.0  # m that a texture covers before it repeats
STAND_HEIGHT = 40.0  # m
STAND_SCALE, BOARD_SCALE = 5.0, 16.0  # px per metre
FONT = cv2.FONT_HERSHEY_SIMPLEX


def one_of(choices: Sequence[V], rng: np.random.Generator) -> V:
    """One of the choices, with equal probability."""
    return choices[int(rng.integers(len(choices)))]


def random_colour(
    rng: np.random.Generator, hue: Range = (0.0, 360.0), saturation: Range = (0.0, 1.0), value: Range = (0.0, 1.0)
) -> Colour:
    """Blue, green, red of a colour with uniform hue (degrees), saturation and value."""
    h, s, v = rng.uniform(*hue) / 360.0, rng.uniform(*saturation), rng.uniform(*value)
    red, green, blue = colorsys.hsv_to_rgb(h % 1.0, s, v)
    return round(255.0 * blue), round(255.0 * green), round(255.0 * red)


def vivid_colour(rng: np.random.Generator) -> Colour:
    """A colour of kits, boards and seats: white, black or bright."""
    kind = rng.random()
    if kind < 0.22:
        return random_colour(rng, saturation=(0.0, 0.08), value=(0.85, 1.0))
    if kind < 0.35:
        return random_colour(rng, saturation=(0.0, 0.3), value=(0.05, 0.25))
    return random_colour(rng, saturation=(0.5, 1.0), value=(0.35, 1.0))


@lru_cache(maxsize=1)
def noise_tile() -> Float32:
    """Noise of all scales with mean 0 and standard deviation 1 that repeats seamlessly, (512, 512)."""
    rng = np.random.default_rng(0)
    tile = np.zeros((NOISE_SIZE, NOISE_SIZE), np.float32)
    for octave in range(OCTAVES):
        side = NOISE_SIZE >> octave
        spots = np.pad(rng.standard_normal((side, side), dtype=np.float32), 2, mode="wrap")
        grown = cv2.resize(spots, None, fx=1 << octave, fy=1 << octave, interpolation=cv2.INTER_CUBIC)
        rim = 2 << octave
        tile += grown[rim : rim + NOISE_SIZE, rim : rim + NOISE_SIZE]
    return np.asarray((tile - tile.mean()) / tile.std(), np.float32)


def noise_at(x: Float32, y: Float32, scale: float, rng: np.random.Generator) -> Float32:
    """The noise tile, shifted at random, at coordinates in metres; one of its pixels is `scale` metres wide."""
    dx, dy = rng.uniform(0.0, NOISE_SIZE), rng.uniform(0.0, NOISE_SIZE)
    return wrapped(noise_tile(), x / scale + dx, y / scale + dy)


def wrapped(texture: Float32, u: Float32, v: Float32) -> Float32:
    """A texture that repeats in both directions, at pixels (u, v); arbitrary values where they are not finite."""
    rows, columns = texture.shape[:2]
    u, v = _remainder(u, columns), _remainder(v, rows)
    return np.asarray(cv2.remap(texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP))


def _remainder(values: Float32, period: int) -> Float32:
    """``np.mod`` in a third of its time; 0 where values are not finite."""
    turns = values / period
    with np.errstate(invalid="ignore"):
        turns -= np.floor(turns)
    turns *= period
    return np.asarray(np.nan_to_num(turns, copy=False), np.float32)


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


def trees_texture(rng: np.random.Generator) -> Float32:
    """A row of trees and houses below the sky, (200, 640, 3)."""
    rows, columns = round(STAND_HEIGHT * STAND_SCALE), round(LENGTH * STAND_SCALE)
    y, x = np.mgrid[:rows, :columns].astype(np.float32)
    sky = np.array(random_colour(rng, (190.0, 240.0), (0.0, 0.5), (0.4, 1.0)), np.float32)
    picture = sky + rng.uniform(0.0, 12.0) * noise_at(0.3 * x, y, 1.0, rng)[..., None]
    for _ in range(rng.integers(1, 4)):
        leaves = np.array(random_colour(rng, (50.0, 130.0), (0.15, 0.6), (0.08, 0.4)), np.float32)
        top = rng.uniform(2.0, 14.0) * STAND_SCALE * (1.0 + 0.4 * noise_at(x, 0.0 * x, rng.uniform(0.3, 3.0), rng))
        shade = 1.0 + rng.uniform(0.1, 0.4) * noise_at(x, y, rng.uniform(0.5, 2.0), rng)
        tree = rows - y < top
        picture[tree] = (shade[..., None] * leaves)[tree]
    image = np.clip(picture, 0.0, 255.0)
    for left in rng.integers(0, columns, size=rng.integers(0, 8)).tolist():  # houses, cars, fences
        wide, high = int(rng.uniform(2.0, 14.0) * STAND_SCALE), int(rng.uniform(1.2, 7.0) * STAND_SCALE)
        cv2.rectangle(image, (left, rows - high), (left + wide, rows), vivid_colour(rng), cv2.FILLED)
    return np.asarray(image, np.float32)


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
