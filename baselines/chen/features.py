"""Features of edge images: short vectors that are near one another where the images are similar."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from typing import Any, Protocol, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from baselines.chen.edges import EDGE_SIZE, Edges
from fieldcalib._types import Float32
from fieldcalib.io.files import BrokenFileError

SIAMESE, HOG = "siamese", "hog"
SHIPPED = files("baselines") / "chen" / "siamese.onnx"

HOG_SIZE, HOG_CELL, HOG_BINS = (160, 96), 16, 9  # size of the resized edge image and of a cell in pixels, directions
HOG_LENGTH = 64
AT_ONCE = 256  # edge images in memory as float32


class Features(Protocol):
    """Extracts features of edge images."""

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to write into a file; `kind` is SIAMESE or HOG."""

    def __call__(self, edges: Edges) -> Float32:
        """Features (N, D) of N edge images (N, height, width)."""


@dataclass(frozen=True)
class Siamese:
    """Features of length 1 by a network that was trained on pairs of edge images (`baselines.chen.training`)."""

    model: bytes
    """Network in ONNX: from "edges" (N, 1, 180, 320), float32 from 0 to 255, to "features" (N, 16)."""

    @classmethod
    def shipped(cls) -> Self:
        """Load the network that comes with the package."""
        return cls(SHIPPED.read_bytes())

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """The kind, and the network."""
        return {"kind": np.array(SIAMESE), "model": np.frombuffer(self.model, np.uint8)}

    @cached_property
    def _session(self) -> Any:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        try:
            return onnxruntime.InferenceSession(self.model, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime's errors have no common base class
            raise BrokenFileError(f"the network of the features is none: {error}") from error

    def __reduce__(self) -> tuple[Any, ...]:
        return Siamese, (self.model,)

    def __call__(self, edges: Edges) -> Float32:
        """Features (N, 16) of N edge images (N, height, width)."""
        parts = [self._session.run(None, {"edges": part[:, None].astype(np.float32)})[0] for part in _parts(edges)]
        return np.concatenate(parts)


@dataclass(frozen=True)
class Hog:
    """Principal components of histograms of oriented gradients, which need no training.

    Dalal and Triggs, CVPR 2005, as implemented in OpenCV; cells of 16 pixels, edge images of 160 x 96.
    """

    mean: Float32
    """Mean of the histograms, (540,)."""
    axes: Float32
    """Principal components of the histograms, (540, 64)."""

    @classmethod
    def fitted(cls, edges: Edges) -> Self:
        """Fit the principal components to N edge images (N, height, width)."""
        histograms = _histograms(edges)
        mean = histograms.mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov((histograms - mean).T))
        return cls(mean, vectors[:, : -HOG_LENGTH - 1 : -1].astype(np.float32))

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """The kind, and the principal components."""
        return {"kind": np.array(HOG), "mean": self.mean, "axes": self.axes}

    def __call__(self, edges: Edges) -> Float32:
        """Features (N, 64) of N edge images (N, height, width)."""
        return np.asarray((_histograms(edges) - self.mean) @ self.axes, np.float32)


def features_from_arrays(arrays: dict[str, NDArray[Any]]) -> Features:
    """Make the extractor that has these `arrays`."""
    if str(arrays["kind"]) == SIAMESE:
        return Siamese(arrays["model"].tobytes())
    return Hog(arrays["mean"], arrays["axes"])


def _histograms(edges: Edges) -> Float32:
    cell = (HOG_CELL, HOG_CELL)
    hog = cv2.HOGDescriptor(HOG_SIZE, cell, cell, cell, HOG_BINS)
    resized = (cv2.resize(edge, HOG_SIZE, interpolation=cv2.INTER_AREA) for edge in edges)
    return np.array([np.ravel(hog.compute(edge)) for edge in resized], np.float32)


def _parts(edges: Edges) -> Iterator[Edges]:
    if edges.shape[1:] != EDGE_SIZE[::-1]:
        raise ValueError(f"edges must be (N, {EDGE_SIZE[1]}, {EDGE_SIZE[0]}), got {edges.shape}")
    for begin in range(0, len(edges), AT_ONCE):
        yield edges[begin : begin + AT_ONCE]
