"""Database of synthetic cameras with features of their views, and the search for the nearest ones."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from baselines.chen.cameras import Cameras, Draw
from baselines.chen.edges import Edges, edge_images, ground_pieces
from baselines.chen.features import Features, Hog, features_from_arrays
from fieldcalib._types import Array, Float32, IntArray
from fieldcalib._whole_files import write_bytes
from fieldcalib.fields.field import Field
from fieldcalib.io.files import BrokenFileError

CAMERAS = 90_000  # as in the paper
AT_ONCE = 500  # edge images in memory
FITTED = 5_000  # edge images to which the principal components of histograms are fitted
LEAST_LINES = 0.003  # least share of an edge image that lines must cover; other cameras are drawn again


@dataclass(frozen=True)
class Database:
    """Cameras and the features of their views."""

    distribution: str
    """Name of the cameras' distribution."""
    cameras: Cameras
    """N cameras."""
    features: Float32
    """Features of the cameras' edge images, (N, D)."""
    extract: Features
    """Extractor of the features."""
    pieces: Array
    """Straight pieces of the markings, (M, 2, 2), see `edges.ground_pieces`."""

    @classmethod
    def made(
        cls,
        field: Field,
        distribution: str,
        draw: Draw,
        extract: Features | None,
        *,
        count: int = CAMERAS,
        seed: int = 0,
        progress: Callable[[int], object] = lambda count: None,
    ) -> Self:
        """Make a database of random cameras.

        Parameters
        ----------
        field : Field
            The field whose markings are drawn.
        distribution : str
            Name of the distribution.
        draw : callable
            Draws cameras; those that see hardly any line are replaced.
        extract : Features or None
            Extractor of features; None for histograms of gradients, with principal components fitted to this database.
        count, seed : int
        progress : callable
            Called with the number of cameras that were added since the last call.
        """
        rng = np.random.default_rng(seed)
        pieces = ground_pieces(field)
        parts: list[Cameras] = []
        features: list[Float32] = []
        if extract is None:
            extract = Hog.fitted(_views(draw, FITTED, pieces, np.random.default_rng([seed, 1]))[1])
        for begin in range(0, count, AT_ONCE):
            cameras, views = _views(draw, min(AT_ONCE, count - begin), pieces, rng)
            parts.append(cameras)
            features.append(extract(views))
            progress(len(cameras))
        return cls(distribution, Cameras.joined(parts), np.concatenate(features), extract, pieces)

    def write(self, path: Path) -> None:
        """Write an .npz file, whole or not at all."""
        content = io.BytesIO()
        arrays: dict[str, NDArray[Any]] = {
            "distribution": np.array(self.distribution),
            "angles": self.cameras.angles,
            "focal_length": self.cameras.focal_length,
            "C": self.cameras.C,
            "features": self.features,
            "pieces": self.pieces,
            **{f"extract_{name}": value for name, value in self.extract.arrays.items()},
        }
        np.savez(content, **arrays)  # type: ignore[arg-type]
        write_bytes(path, content.getvalue())

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file that `write` wrote.

        Raises
        ------
        FileNotFoundError
            If the file does not exist.
        BrokenFileError
            If it is no such file.
        """
        if not path.is_file():
            raise FileNotFoundError(f"{path} does not exist: python -m baselines.chen database {path} makes it")
        try:
            with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
                arrays = dict(file)
            extract = {name.removeprefix("extract_"): value for name, value in arrays.items() if "extract_" in name}
            cameras = Cameras(arrays["angles"], arrays["focal_length"], arrays["C"])
            features = features_from_arrays(extract)
            return cls(str(arrays["distribution"]), cameras, arrays["features"], features, arrays["pieces"])
        except (OSError, ValueError, KeyError, EOFError, TypeError, BadZipFile) as error:
            raise BrokenFileError(f"{path} is no database of python -m baselines.chen database: {error}") from error

    def check_field(self, field: Field) -> None:
        """Raise a ValueError unless the database is of this field."""
        pieces = ground_pieces(field)
        if pieces.shape != self.pieces.shape or not np.allclose(pieces, self.pieces):
            raise ValueError(
                "the database is of another field: give the same --field, --field-length and --field-width as to "
                "python -m baselines.chen database, or make one of this field"
            )

    @cached_property
    def _squares(self) -> Float32:
        return np.asarray(np.einsum("nd,nd->n", self.features, self.features), np.float32)

    def nearest(self, feature: Float32, count: int = 1) -> IntArray:
        """Indices of the cameras with the nearest features, the nearest first, by exhaustive search."""
        distance = self._squares - 2.0 * (self.features @ feature)
        count = min(count, len(distance))
        first = np.argpartition(distance, count - 1)[:count]
        return np.asarray(first[np.argsort(distance[first], kind="stable")])


def _views(draw: Draw, count: int, pieces: Array, rng: np.random.Generator) -> tuple[Cameras, Edges]:
    """Draw cameras that see lines, and their edge images."""
    found: list[tuple[Cameras, Edges]] = []
    missing = count
    while missing:
        cameras = draw(missing, rng)
        views = edge_images(cameras.homographies, pieces)
        sees = np.mean(views > 0, axis=(1, 2)) > LEAST_LINES
        found.append((cameras[sees], views[sees]))
        missing -= int(np.count_nonzero(sees))
    return Cameras.joined([cameras for cameras, _ in found]), np.concatenate([views for _, views in found])
