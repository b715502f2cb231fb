"""Point clouds: curves through points in order, and shapes of points in any order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, IntArray, real_array, truth, whole_number
from fieldcalib.fields.segments.closest import ClosestPoints, CurveSearch, View, at_points, away_from_zero, on_ground
from fieldcalib.fields.segments.rows import Rows
from fieldcalib.fields.segments.segment import Segment, Vector, mirrored_point

BEHIND_PENALTY = 1e12  # px^2: added to the squared distance of a sample behind the camera


class CloudRows(Rows):
    """Pixels of unordered clouds: the vectors of a row are the points, the last one repeated as padding."""

    name, vectors, components = "clouds", 1, 2
    shares_noise = False

    def closest_points(self, view: View) -> list[ClosestPoints]:
        """The points whose images are nearest to the pixels."""
        return at_points(view, self.xy, self.nearest_sample(view)[0])

    def nearest_sample(self, view: View) -> tuple[Array, IntArray]:
        """The point (B, N, 3) of each row's cloud whose image is nearest to the pixel, and its index (B, N)."""
        B, N, S, _ = self.geometry.shape
        h = view.points(on_ground(view, self.geometry.reshape(B, N * S, 3)))
        image = view.real_offset(h[:2] / away_from_zero(h[2])).reshape(2, B, N, S)
        distance = np.sum(np.square(image - view.observed_offset(self.xy)[..., None]), axis=0)
        distance[h[2].reshape(B, N, S) < 0.0] += BEHIND_PENALTY  # chosen only if no sample is in front
        nearest = np.argmin(distance, axis=-1)
        return np.take_along_axis(self.geometry, nearest[..., None, None], axis=2)[:, :, 0], nearest


class CurveRows(CloudRows):
    """Pixels of ordered clouds: the vectors of a row are the points, the last one repeated as padding."""

    name, vectors, components = "curves", 3, 1
    shares_noise = True

    def closest_points(self, view: View) -> list[ClosestPoints]:
        """Points on the parabola through the nearest sample and its two neighbours."""
        _, nearest = self.nearest_sample(view)
        # padding repeats the last sample: no parabola may reach into it
        own = np.any(self.geometry != self.geometry[:, :, -1:], axis=-1)
        last = self.geometry.shape[2] - np.argmax(own[..., ::-1], axis=-1)
        middle = np.clip(nearest, 1, np.maximum(last - 1, 1))
        before, at, after = (
            view.points(
                on_ground(view, np.take_along_axis(self.geometry, (middle + i)[..., None, None], axis=2)[:, :, 0])
            )
            for i in (-1, 0, 1)
        )
        slope, curvature = (after - before) / 2.0, after - 2.0 * at + before
        t = (nearest - middle).astype(float)
        search = CurveSearch(view, view.observed_offset(self.xy), self.label >= 0)
        for _ in search.iterations:
            t = t + search.step(at + t * (slope + 0.5 * t * curvature), slope + t * curvature, curvature, largest=1.0)
        return [search.found]


@dataclass(frozen=True)
class PointCloud(Segment):
    """Points of a curve or of a shape, (N, 3).

    An `ordered` cloud is a curve: pixels are measured against the smooth curve through its points. Otherwise each
    pixel is compared, in both coordinates, with the nearest of the points.

    Examples
    --------
    >>> PointCloud([(0.0, 0.0, 0.0), (1.0, 0.1, 0.0), (2.0, 0.4, 0.0)], ordered=True).X.shape
    (3, 3)
    """

    points: tuple[tuple[float, float, float], ...]
    ordered: bool = False

    def __post_init__(self) -> None:
        X, least = real_array(self.points), 3 if truth(self.ordered, "ordered") else 1
        if X.ndim != 2 or X.shape[1] != 3 or len(X) < least:
            which = "three points for an ordered cloud" if self.ordered else "one point"
            raise ValueError(f"a PointCloud needs an (N, 3) array with at least {which}, got shape {X.shape}")
        object.__setattr__(self, "points", tuple(map(tuple, X.tolist())))

    @property
    def is_curve(self) -> bool:
        """Whether it is a curve, along which something may be painted."""
        return self.ordered

    @property
    def X(self) -> Array:
        """The points as an (N, 3) array."""
        return np.array(self.points)

    def sample(self, spacing: float = 1.0) -> Array:
        """The points themselves, (N, 3)."""
        return self.X

    @property
    def rows(self) -> type[Rows]:
        """The class of rows that its labelled pixels are packed in."""
        return CurveRows if self.ordered else CloudRows

    @property
    def vectors(self) -> Array:
        """The points, (N, 3)."""
        return self.X

    def equations(self, pixels: int) -> int:
        """One for each pixel of a curve, two for each of a shape."""
        return whole_number(pixels, "pixels") * (1 if self.ordered else 2)

    def mirrored(self, signs: Vector) -> PointCloud:
        """The cloud with its coordinates multiplied by signs."""
        return PointCloud(tuple(mirrored_point(X, signs) for X in self.points), self.ordered)

    def polyline(self, spacing: float) -> Array:
        """Points on the smooth curve through its points, nine from one to the next, (N, 3).

        The curve blends the parabolas through each three neighbours.
        """
        X, start = self.X, np.arange(len(self.points) - 1)
        middle = np.clip(np.arange(len(X)), 1, len(X) - 2)
        t = np.linspace(0.0, 1.0, 9)[:-1, None, None]

        def parabola(index: IntArray, s: Array) -> Array:
            m = middle[index]
            s = s + (index - m)[:, None]
            before, at, after = X[m - 1], X[m], X[m + 1]
            return np.asarray(at + s * (after - before) / 2.0 + s * s * (after - 2.0 * at + before) / 2.0)

        pieces = (1.0 - t) * parabola(start, t) + t * parabola(start + 1, t - 1.0)
        return np.concatenate([pieces.swapaxes(0, 1).reshape(-1, 3), X[-1:]])
