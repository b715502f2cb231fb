"""Training batches: pictures with their true points on the field, and perturbed points with their overlap.

A batch depends on the seed and its number only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from baselines.jiang.four_points import CANONICAL, points_of_homography
from baselines.jiang.networks import SIZE, squashed
from fieldcalib._types import Array
from fieldcalib.geometry.homography import ALIGNMENTS, dehomogenize, homogenize
from fieldcalib.io.formats import HOMOGRAPHIES, IMAGES
from fieldcalib.io.image_files import Image
from fieldcalib.metrics import iou_whole

FIRST_SHARE = 0.5  # share of a batch that comes from the first folder, however few pictures that has
FARTHEST = 1.5  # largest coordinate of the canonical points on the field, in field lengths and widths
SMALLEST_WINDOW = 0.7  # share of the picture's width and height
ASPECT = 0.05  # standard deviation of the logarithm of a window's aspect ratio
ROTATION = np.radians(1.0)  # standard deviation of a window's rotation
GAIN, GAIN_OF_CHANNEL = 0.15, 0.06  # standard deviations of the logarithms of brightness factors

# The largest perturbations of the true points. Each is multiplied by a size between these two, drawn log-uniformly,
# since the last errors to be removed are small and large ones are rare.
SMALLEST, LARGEST = 0.01, 1.0
SHIFT = 0.25  # share of the field's length and width, uniform
TURN = np.radians(45.0)  # uniform
SCALE = 2.0  # log-uniform between 1 / SCALE and SCALE
SCATTER = 0.05  # standard deviation of independent shifts of the points

TO_PIXELS = np.array([[SIZE, 0.0, (SIZE - 1.0) / 2.0], [0.0, SIZE, (SIZE - 1.0) / 2.0], [0.0, 0.0, 1.0]])
FLIP = np.diag([-1.0, 1.0, 1.0])
CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
CANVAS = 4.0 * CORNERS  # `iou_whole` ignores what lies beyond


@dataclass(frozen=True)
class Pair:
    """A picture and its homography, in the convention of `four_points`."""

    picture: Image
    """(SIZE, SIZE, 3), squashed; kept in memory, 0.2 MB each."""
    H: Array


def read_pairs(pictures: Path, homographies: Path) -> list[Pair]:
    """Read the pictures that have a homography of the same name, unless its points lie beyond `FARTHEST`.

    Raises
    ------
    ValueError
        If there are none.
    """
    by_id = {file.id: file for file in HOMOGRAPHIES.find([homographies])}
    pairs = []
    for file in IMAGES.find([pictures]):
        if file.id in by_id:
            H = ALIGNMENTS["jiang"].from_fieldcalib(HOMOGRAPHIES.read(by_id[file.id].read()))
            if np.all(np.abs(points_of_homography(H)) < FARTHEST):
                pairs.append(Pair(squashed(IMAGES.read(file.read())), H))
    if not pairs:
        raise ValueError(
            f"expected pictures in {pictures} and <id>.homographyMatrix of the same ids in {homographies}, whose lower "
            f"parts show the ground; found none"
        )
    return pairs


@dataclass(frozen=True)
class Batches(Dataset[tuple[Tensor, ...]]):
    """Batches by number: pictures (N, 3, SIZE, SIZE) uint8, RGB; points; perturbed points (N, 4, 2); their IoU (N,)."""

    seed: int
    count: int
    """Number of pictures in a batch."""
    folders: Sequence[Sequence[Pair]]

    def __getitem__(self, step: int) -> tuple[Tensor, ...]:
        rng = np.random.default_rng((self.seed, step))
        pictures, points, others, overlaps = zip(*[self._sample(rng) for _ in range(self.count)], strict=True)
        images = np.ascontiguousarray(np.stack(pictures)[..., ::-1].transpose(0, 3, 1, 2))
        numbers = (np.stack(points), np.stack(others), np.array(overlaps))
        return torch.from_numpy(images), *(torch.from_numpy(values.astype(np.float32)) for values in numbers)

    def _sample(self, rng: np.random.Generator) -> tuple[Image, Array, Array, float]:
        first = len(self.folders) == 1 or rng.random() < FIRST_SHARE
        folder = self.folders[0 if first else int(rng.integers(1, len(self.folders)))]
        while True:
            pair = folder[int(rng.integers(len(folder)))]
            image, H = augmented(pair.picture, pair.H, rng)
            points = points_of_homography(H)
            if np.all(np.abs(points) < FARTHEST):
                break
        others = perturbed(points, rng)
        return image, points, others, overlap(others, points)


def augmented(picture: Image, H: Array, rng: np.random.Generator) -> tuple[Image, Array]:
    """Augment a picture: a random window, mirrored or not, with changed colours, and its homography."""
    width, height = np.clip(
        rng.uniform(SMALLEST_WINDOW, 1.0) * np.exp(np.array([0.5, -0.5]) * rng.normal(0.0, ASPECT)), 0.0, 1.0
    )
    x, y = (rng.uniform(-0.5, 0.5) * (1.0 - side) for side in (width, height))
    cos, sin = np.cos(turn := rng.normal(0.0, ROTATION)), np.sin(turn)
    window = np.array([[width * cos, -width * sin, x], [height * sin, height * cos, y], [0.0, 0.0, 1.0]])
    field = np.eye(3)
    if rng.random() < 0.5:
        window, field = FLIP @ window, FLIP
    moved = cv2.warpPerspective(
        picture,
        TO_PIXELS @ window @ np.linalg.inv(TO_PIXELS),
        (SIZE, SIZE),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    gain = np.exp(rng.normal(0.0, GAIN) + rng.normal(0.0, GAIN_OF_CHANNEL, size=3))
    table = np.clip(np.arange(256.0)[:, None] * gain, 0.0, 255.0).astype(np.uint8)
    return np.asarray(cv2.LUT(moved, table[None])), field @ H @ window


def perturbed(points: Array, rng: np.random.Generator) -> Array:
    """Perturb points on the field (4, 2): shifted, turned and scaled about their centre, and scattered."""
    size = np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST)))
    turn, scale = size * rng.uniform(-TURN, TURN), np.exp(size * rng.uniform(-1.0, 1.0) * np.log(SCALE))
    metres = np.array(ALIGNMENTS["jiang"].template)
    rotation = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle = points.mean(axis=0)
    moved = (points - middle) * metres @ rotation.T / metres + middle
    moved = moved + size * rng.uniform(-SHIFT, SHIFT, size=2)
    return np.asarray(moved + size * rng.normal(0.0, SCATTER, size=points.shape))


def overlap(points: Array, truth: Array) -> float:
    """IoU of the whole field for the homographies of points (4, 2), by polygons; `iou_whole` where the horizon matters.

    The field's rectangle, mapped to the picture by the truth and back to the field by the points, is a quadrilateral.

    Examples
    --------
    >>> from baselines.jiang.four_points import CANONICAL
    >>> round(overlap(0.5 * CANONICAL + (0.1, 0.0), 0.5 * CANONICAL), 3)  # a tenth of the length off: 0.9 / 1.1
    0.818
    """
    moved = np.asarray(cv2.getPerspectiveTransform(truth.astype(np.float32), points.astype(np.float32)), float)
    corners = homogenize(CORNERS) @ moved.T
    if not (np.all(corners[:, 2] > 0.0) or np.all(corners[:, 2] < 0.0)):
        return _overlap_on_raster(points, truth)
    field, canvas = CORNERS.astype(np.float32), CANVAS.astype(np.float32)
    _, on_canvas = cv2.intersectConvexConvex(dehomogenize(corners).astype(np.float32), canvas)
    if on_canvas is None:
        return 0.0
    both, _ = cv2.intersectConvexConvex(on_canvas, field)
    return float(both / (cv2.contourArea(on_canvas) + 1.0 - both))


def _overlap_on_raster(points: Array, truth: Array) -> float:
    H, H_true = (
        cv2.getPerspectiveTransform(CANONICAL.astype(np.float32), p.astype(np.float32)) for p in (points, truth)
    )
    if np.linalg.matrix_rank(H) < 3:  # three of the points are on a line
        return 0.0
    alignment = ALIGNMENTS["jiang"]
    return iou_whole(alignment.to_fieldcalib(H), alignment.to_fieldcalib(H_true), alignment.image_size)
