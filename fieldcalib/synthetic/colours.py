"""Colours and noise that synthetic frames draw from."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np

from fieldcalib._types import Float32
from fieldcalib.draw.scene import Colour

V = TypeVar("V")
Range = tuple[float, float]
Hsv = tuple[Range, Range, Range]  # hue in degrees, saturation, value
GREY = np.full(3, 1.0 / 3.0, np.float32)  # weights of the channels in brightness
NOISE_SIZE = 512  # px: side of the noise tile
OCTAVES = 7  # its coarsest spots are 64 px wide


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
