"""Training batches of synthetic frames, made on demand or read from a cache, and real ones with labelled points.

A batch depends on the seed and its number only, so an interrupted training resumes with the same batches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from data_tools.labelled import LabelledFrame
from data_tools.network import STRIDE
from data_tools.onnx_model import MEAN, STD
from data_tools.synthetic import SIZE, Mask, frame
from data_tools.synthetic.cache import read_frame
from data_tools.synthetic.degraded import degraded
from data_tools.synthetic.games import game_named
from data_tools.synthetic.masks import CLASSES, markings_mask
from fieldcalib._types import Array
from fieldcalib.console.arguments import SOCCER
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import Image, size_of
from fieldcalib.localize.network import SHAPE, Padded, continued

LABELLED_SHARE = 1.0 / 3.0
OVERSAMPLING = 4  # of masks against the grid of the classes
SMALLEST_WINDOW = 0.6  # of a real frame's width and height
NARROW_SHARE, NARROWEST = (
    0.3,
    0.3,
)  # share of square and upright windows, which are squashed, and least share of the width
NARROWED_SHARE = 0.25  # share of pictures of which an upright or square part is continued, as the network is used
NARROWED = (0.45, 1.25)  # width of these parts by their height
LOWEST_PART = 0.7  # least height of a part by the frame's, for a network of narrow pictures
SMALL_SHARE, SMALL = 0.12, (180, 300)  # share of pictures that were squashed to small squares, and the side of these
GAIN, GAIN_OF_CHANNEL = 0.12, 0.04  # standard deviations of the logarithm


@dataclass(frozen=True)
class Batches(Dataset[tuple[Tensor, Tensor]]):
    """Batch number `step`, for any step: images (N, 3, H, W) uint8, RGB, and classes (N, H / 2, W / 2) int64."""

    seed: int
    count: int
    """Number of images in a batch."""
    size: tuple[int, int]
    """Width and height of the images; multiples of 32."""
    cached: Sequence[Path] = ()
    """Images of a cache, see `data_tools.synthetic.cache`; without any, frames are generated."""
    labelled: Sequence[LabelledFrame] = ()
    """Real frames, of the field."""
    field: str = SOCCER
    """Name of the field, see `data_tools.synthetic.frame`."""

    @property
    def are_narrow(self) -> bool:
        """Whether they are parts of frames, as shown to a network for narrow pictures: one with a narrow input."""
        return self.size[0] < SHAPE * self.size[1]

    def __getitem__(self, step: int) -> tuple[Tensor, Tensor]:
        rng = np.random.default_rng((self.seed, step))
        return stacked([self._sample(rng) for _ in range(self.count)], self.size)

    def _sample(self, rng: np.random.Generator) -> tuple[Image, Mask]:
        if self.labelled and rng.random() < LABELLED_SHARE:
            labelled = self.labelled[int(rng.integers(len(self.labelled)))]
            share = 0.0 if self.are_narrow else NARROW_SHARE
            image, mask = window(labelled, rng, game_named(self.field).classes, narrow_share=share)
            behind_goal = False
        elif self.cached:
            image, mask, behind_goal = read_frame(self.cached[int(rng.integers(len(self.cached)))])
        else:
            made = frame(int(rng.integers(1 << 62)), name=self.field)
            image, mask, behind_goal = made.image, made.mask, made.behind_goal
        if rng.random() < 0.5:
            image, mask = mirrored_sample(image, mask, behind_goal=behind_goal, name=self.field)
        chance = rng.random()
        if self.are_narrow:
            image, mask = part(image, mask, rng, lowest=LOWEST_PART)
        elif chance < NARROWED_SHARE:
            image, mask = narrowed(image, mask, rng)
        elif chance < NARROWED_SHARE + SMALL_SHARE:
            image = once_small(image, rng)
        gain = np.exp(rng.normal(0.0, GAIN) + rng.normal(0.0, GAIN_OF_CHANNEL, size=3))
        return np.clip(image * gain.astype(np.float32), 0.0, 255.0).astype(np.uint8), mask


def mirrored_sample(image: Image, mask: Mask, *, behind_goal: bool, name: str = SOCCER) -> tuple[Image, Mask]:
    """Image and mask mirrored left to right; labels swap left and right, or far and near behind the goal.

    They are returned unchanged if the field is not its own mirror image.
    """
    values = _mirrored_values(name, behind_goal)
    return (image, mask) if values is None else (np.ascontiguousarray(image[:, ::-1]), values[mask[:, ::-1]])


@lru_cache(maxsize=8)
def _mirrored_values(name: str, behind_goal: bool) -> Mask | None:
    return game_named(name).mirrored_values(behind_goal=behind_goal)


def narrowed(image: Image, mask: Mask, rng: np.random.Generator) -> tuple[Image, Mask]:
    """A part of a picture, as high as it and upright or about square, continued on both sides as by `Padded`."""
    image, mask = part(image, mask, rng)
    missing = Padded.missing(size_of(image))
    left, right = missing // 2, missing - missing // 2
    return continued(image, left, right), np.pad(mask, ((0, 0), (left, right)))


def part(image: Image, mask: Mask, rng: np.random.Generator, *, lowest: float = 1.0) -> tuple[Image, Mask]:
    """An upright or about square part of a picture, at least `lowest` of its height high."""
    whole_height, whole_width = mask.shape
    height = round(whole_height * rng.uniform(lowest, 1.0))
    width = min(round(height * rng.uniform(*NARROWED)), whole_width)
    x, y = int(rng.integers(whole_width - width + 1)), int(rng.integers(whole_height - height + 1))
    chosen = slice(y, y + height), slice(x, x + width)
    return np.ascontiguousarray(image[chosen]), np.ascontiguousarray(mask[chosen])


def once_small(image: Image, rng: np.random.Generator) -> Image:
    """A picture that was squashed to a small square and stretched again, as thumbnails are."""
    side = int(rng.integers(*SMALL))
    small = cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(small, image.shape[1::-1], interpolation=cv2.INTER_CUBIC), np.uint8)


def window(
    labelled: LabelledFrame,
    rng: np.random.Generator,
    classes: Sequence[str] = CLASSES,
    *,
    narrow_share: float = NARROW_SHARE,
) -> tuple[Image, Mask]:
    """A random window of a real frame, wide or upright and squashed, degraded as synthetic frames are."""
    share = np.full(2, rng.uniform(SMALLEST_WINDOW, 1.0))
    if rng.random() < narrow_share:
        share[0] = rng.uniform(NARROWEST, share[1])
    return cut(labelled, share, rng.uniform(0.0, 1.0 - share), rng, classes)


def whole(labelled: LabelledFrame, classes: Sequence[str] = CLASSES) -> tuple[Image, Mask]:
    """A whole real frame and its mask."""
    return cut(labelled, np.ones(2), np.zeros(2), None, classes)


def cut(
    labelled: LabelledFrame,
    share: Array,
    corner: Array,
    rng: np.random.Generator | None,
    classes: Sequence[str],
) -> tuple[Image, Mask]:
    """A window of a frame; its size (2,) and corner (2,) are shares of the frame's width and height."""
    picture = np.asarray(cv2.imread(str(labelled.image), cv2.IMREAD_COLOR), np.uint8)
    pixels = np.array(picture.shape[1::-1])
    (x, y), (w, h) = np.rint(corner * pixels).astype(int), np.rint(share * pixels).astype(int)
    image = np.asarray(cv2.resize(picture[y : y + h, x : x + w], SIZE, interpolation=cv2.INTER_AREA), np.uint8)
    camera = labelled.camera.scaled((int(pixels[0]), int(pixels[1])))
    moved = Camera(camera.K - [[0, 0, x], [0, 0, y], [0, 0, 0]], camera.R, camera.C, (int(w), int(h)), camera.dist)
    mask = markings_mask(moved.scaled(SIZE), labelled.field, classes)
    return image if rng is None else degraded(image, rng), mask


def stacked(samples: Sequence[tuple[Image, Mask]], size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """Images and masks as a batch, images of `size` (width, height); masks are reduced so that markings stay."""
    width, height = size[0] // STRIDE, size[1] // STRIDE
    finer = (OVERSAMPLING * width, OVERSAMPLING * height)
    images = np.stack([cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image, _ in samples])
    images = np.ascontiguousarray(images[..., ::-1].transpose(0, 3, 1, 2))
    masks = np.stack([cv2.resize(mask, finer, interpolation=cv2.INTER_NEAREST) for _, mask in samples])
    blocks = masks.reshape(len(masks), height, OVERSAMPLING, width, OVERSAMPLING)
    return torch.from_numpy(images), torch.from_numpy(blocks.max(axis=(2, 4)).astype(np.int64))


def normalised(images: Tensor) -> Tensor:
    """Input of the network, float32, from images (N, 3, H, W) uint8, RGB."""
    mean, std = (torch.tensor(values, device=images.device).view(3, 1, 1) for values in (MEAN, STD))
    return (images.float() / 255.0 - mean) / std
