"""The result of localization, and the map from the grid of a network's output to pixels of the image."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib._checks import expect, listed, several
from fieldcalib._types import Array, Float32
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.labelled_pixels import Pixels, check_object

BACKGROUND = "background"  # class of pixels that show no marking; several classes may have this name


@dataclass(frozen=True)
class Localization:
    """Labelled pixels of one image, as `calibrate_from_segments` takes them.

    Examples
    --------
    >>> from fieldcalib import calibrate_from_segments, soccer
    >>> found = Localization({"Middle line": np.array([[480.0, 100.0]])}, {"Middle line": np.array([0.9])})
    >>> str(calibrate_from_segments(soccer(), found.pixels, (960, 540), weights=found.weights).status)
    'too few segments'
    """

    pixels: Pixels
    """Label -> (N, 2) pixels."""
    weights: dict[str, Array]
    """Label -> (N,) weight of each pixel."""

    @property
    def weight(self) -> dict[str, float]:
        """Label -> sum of the weights of its pixels."""
        return {label: float(np.sum(values)) for label, values in self.weights.items()}

    def only(self, labels: Iterable[str]) -> Localization:
        """The localization restricted to some of its labels."""
        kept = several(labels, "labels")
        unknown = [label for label in kept if not isinstance(label, str) or label not in self.pixels]
        if unknown:
            raise ValueError(f"expected labels among {', '.join(self.pixels)}, got {unknown[0]!r}")
        return Localization({k: self.pixels[k] for k in kept}, {k: self.weights[k] for k in kept})


def image_from_grid(xy: Array, grid_size: tuple[int, int], image_size: tuple[int, int]) -> Array:
    """Pixels of an image at points (..., 2) of a grid that covers it.

    Pixel centres have integer coordinates in both, so both begin at (-1/2, -1/2), as in cv2.resize.

    Examples
    --------
    >>> image_from_grid(np.array([[0.0, 0.0], [319.0, 179.0]]), (320, 180), (1920, 1080))
    array([[   2.5,    2.5],
           [1916.5, 1076.5]])
    """
    return np.asarray((xy + 0.5) * np.divide(image_size, grid_size) - 0.5)


def check_classes(probability: Float32, classes: Sequence[str], object_segments: ObjectSegments) -> None:
    """Raise a ValueError unless there is one map per class and each class is a segment or the background."""
    check_object(object_segments)
    expect(probability, np.ndarray, "what a network returns")
    for name in listed(classes, "names of classes"):
        expect(name, str, '"Middle line"')
    if probability.ndim != 3 or len(probability) != len(classes):
        raise ValueError(
            f"expected probabilities of shape ({len(classes)}, height, width), one per class, got {probability.shape}"
        )
    unknown = classes_without_segment(classes, object_segments)
    if unknown:
        raise ValueError(
            f"the network's class {unknown[0]!r} is not a segment of the object: give the object that the network was "
            f"trained for, or name the class {BACKGROUND!r} to ignore it"
        )


def classes_without_segment(classes: Sequence[str], object_segments: ObjectSegments) -> list[str]:
    """Classes of a network that are neither a segment of the object nor the background."""
    return [name for name in classes if name != BACKGROUND and name not in object_segments]
