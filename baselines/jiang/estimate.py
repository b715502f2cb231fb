"""Homographies of pictures: four points are guessed, then moved to a minimum of one of the two costs."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn.utils import parametrize

from baselines.jiang import optimiser
from baselines.jiang.four_points import homography_of_points
from baselines.jiang.lines import LineCost
from baselines.jiang.networks import ErrorNetwork, GuessNetwork, squashed
from baselines.jiang.training import ERROR, GUESS
from fieldcalib._types import Array
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.homography import ALIGNMENTS
from fieldcalib.io.files import read_regular_file
from fieldcalib.io.image_files import Image
from fieldcalib.localize import SegmentationNetwork, localize

CostName: TypeAlias = Literal["learned", "lines"]


@dataclass(frozen=True)
class Estimator:
    """Estimates the four points of pictures: the guess, and the steps from there."""

    guess: GuessNetwork
    error: ErrorNetwork | None
    """Predicts the learned cost; None if the cost is \"lines\"."""
    markings: SegmentationNetwork | None
    """Labels pixels for the cost \"lines\"; otherwise None."""

    @classmethod
    def load(cls, weights: Path, cost: CostName = "learned") -> Estimator:
        """Load the networks that `training` wrote into a folder.

        Raises
        ------
        FileNotFoundError, ValueError
            If a file is missing, or holds another network.
        """
        guess = _loaded(GuessNetwork, weights / GUESS)
        if cost == "lines":
            return cls(guess, None, SegmentationNetwork.load(threads=1))
        return cls(guess, _loaded(ErrorNetwork, weights / ERROR), None)

    def __call__(
        self, images: Sequence[Image], image_size: tuple[int, int], steps: int = optimiser.STEPS
    ) -> optimiser.Path:
        """Optimise the points of images (height, width, 3), blue, green, red; coordinates are those of `four_points`.

        `image_size` is the size before images were squashed.
        """
        bgr = np.stack([squashed(image) for image in images])
        pictures = torch.from_numpy(np.ascontiguousarray(bgr[..., ::-1].transpose(0, 3, 1, 2))).float()
        with torch.inference_mode():
            initial = self.guess(pictures)
        return optimiser.optimise(self._cost(images, pictures, image_size), initial.clone(), steps=steps)

    def _cost(self, images: Sequence[Image], pictures: Tensor, image_size: tuple[int, int]) -> optimiser.Cost:
        if self.error is not None:
            error = self.error
            return lambda points: error(pictures, points)
        assert self.markings is not None
        stretched = [
            np.asarray(cv2.resize(image, image_size, interpolation=cv2.INTER_CUBIC), np.uint8) for image in images
        ]
        return LineCost.of(localize(soccer(), stretched, self.markings), image_size)


def homographies(points: Tensor, image_size: tuple[int, int]) -> list[Array | None]:
    """Homographies from the field in metres to pixels, by points (N, 4, 2); None where points give no regular one."""
    alignment = ALIGNMENTS["jiang"]
    to_image = np.diag([*np.divide(image_size, alignment.image_size), 1.0])
    found: list[Array | None] = []
    for H in homography_of_points(points.double()).numpy():
        regular = np.all(np.isfinite(H)) and np.linalg.matrix_rank(H) == 3
        found.append(to_image @ alignment.to_fieldcalib(H) if regular else None)
    return found


def _loaded(kind: type[GuessNetwork] | type[ErrorNetwork], path: Path) -> Any:
    """Load a network in evaluation mode, with constant weights."""
    if not path.is_file():
        raise FileNotFoundError(f"{path}: there are no weights; python -m baselines.jiang train makes them")
    try:
        kept = torch.load(io.BytesIO(read_regular_file(path)), map_location="cpu", weights_only=True)
        network = kind(kept["width"], kept["size"])
        network.load_state_dict(kept["state"])
    except (RuntimeError, UnpicklingError, EOFError, LookupError, TypeError) as error:
        raise ValueError(f"{path}: is no {kind.__name__} that baselines.jiang train has written: {error}") from None
    network.eval()
    for module in network.modules():  # spectral normalisation serves training only: keep the normalised weights
        if parametrize.is_parametrized(module, "weight"):
            parametrize.remove_parametrizations(module, "weight")
    return network.requires_grad_(False)
