"""Random pictures without a field, from which no camera should be accepted; one for each seed.

Textures, grass without lines, crowds, and drawings of other lines: boards, street grids, courts of other shapes. They
differ from those of `data_tools.synthetic`, on which networks are trained.
"""

from __future__ import annotations

import cv2
import numpy as np

from fieldcalib.io.image_files import Image

SIZE = (1280, 720)
GREEN = (50.0, 120.0, 60.0)  # blue, green, red


def nonsense(seed: int) -> Image:
    """A picture of 1280x720 without a field; the kinds alternate with the seed.

    Examples
    --------
    >>> nonsense(3).shape
    (720, 1280, 3)
    """
    rng = np.random.default_rng(seed)
    kinds = (_grass, _crowd, _chessboard, _lines, _circles, _boards, _plain)
    picture = kinds[seed % len(kinds)](rng)
    noisy = picture + rng.normal(0.0, rng.uniform(0.0, 8.0), picture.shape)
    return np.clip(noisy, 0.0, 255.0).astype(np.uint8)


def _plain(rng: np.random.Generator) -> Image:
    return np.asarray(np.full((SIZE[1], SIZE[0], 3), rng.integers(0, 256, 3)), np.uint8)


def _cloud(rng: np.random.Generator, cell: int) -> Image:
    """Smooth noise about a colour."""
    small = rng.uniform(0.0, 255.0, (SIZE[1] // cell + 2, SIZE[0] // cell + 2, 3)).astype(np.float32)
    return np.asarray(cv2.resize(small, SIZE, interpolation=cv2.INTER_CUBIC))


def _grass(rng: np.random.Generator) -> Image:
    texture = _cloud(rng, int(rng.integers(4, 200))).mean(axis=2, keepdims=True) - 128.0
    stripes = np.sign(np.sin(np.arange(SIZE[0]) / rng.uniform(20.0, 150.0)))[None, :, None] * rng.uniform(0.0, 15.0)
    colour = GREEN + rng.normal(0.0, 20.0, 3)
    return np.asarray(np.clip(colour + 0.2 * texture + stripes, 0.0, 255.0), np.uint8)


def _crowd(rng: np.random.Generator) -> Image:
    return np.clip(_cloud(rng, int(rng.integers(3, 14))), 0.0, 255.0).astype(np.uint8)


def _seen_from_somewhere(drawing: Image, rng: np.random.Generator) -> Image:
    """A drawing on the ground in a random perspective; the background has its colour."""
    width, height = SIZE
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    moved = corners + rng.uniform(-0.3, 0.3, (4, 2)).astype(np.float32) * (width, height)
    warp = cv2.getPerspectiveTransform(corners, moved.astype(np.float32))
    border = tuple(float(v) for v in drawing[0, 0])
    return np.asarray(cv2.warpPerspective(drawing, warp, SIZE, borderValue=border), np.uint8)


def _ground(rng: np.random.Generator) -> Image:
    return _grass(rng) if rng.random() < 0.6 else _plain(rng)


def _chessboard(rng: np.random.Generator) -> Image:
    side = int(rng.integers(20, 160))
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    dark, light = rng.uniform(0.0, 120.0, 3), rng.uniform(120.0, 255.0, 3)
    board = np.where(((x // side + y // side) % 2)[..., None], light, dark).astype(np.uint8)
    return _seen_from_somewhere(board, rng)


def _lines(rng: np.random.Generator) -> Image:
    picture = _ground(rng)
    for _ in range(int(rng.integers(3, 15))):
        a, b = (rng.uniform((0.0, 0.0), SIZE).astype(int).tolist() for _ in range(2))
        cv2.line(picture, a, b, (255, 255, 255), int(rng.integers(1, 6)), cv2.LINE_AA)
    return _seen_from_somewhere(picture, rng)


def _circles(rng: np.random.Generator) -> Image:
    picture = _ground(rng)
    for _ in range(int(rng.integers(1, 8))):
        centre = rng.uniform((0.0, 0.0), SIZE).astype(int).tolist()
        cv2.circle(picture, centre, int(rng.integers(20, 300)), (255, 255, 255), int(rng.integers(1, 6)), cv2.LINE_AA)
    return _seen_from_somewhere(picture, rng)


def _boards(rng: np.random.Generator) -> Image:
    """Random rectangles, nested and side by side, like courts of other games."""
    picture = _ground(rng)
    for _ in range(int(rng.integers(3, 12))):
        a, b = (rng.uniform((0.0, 0.0), SIZE).astype(int).tolist() for _ in range(2))
        colour = (255, 255, 255) if rng.random() < 0.7 else rng.uniform(0.0, 255.0, 3).tolist()
        cv2.rectangle(picture, a, b, colour, int(rng.integers(-1, 6)), cv2.LINE_AA)
    return _seen_from_somewhere(picture, rng)
