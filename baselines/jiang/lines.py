"""Cost of four points: distances of labelled pixels from the projected markings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from baselines.jiang.four_points import homography_of_points
from fieldcalib._types import Array
from fieldcalib.fields.segments import Arc, Line, Segment
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.homography import ALIGNMENTS
from fieldcalib.localize import Localization

UNIT = (960, 540)  # distances are in pixels of images of this size
LOSS_SCALE = 3.0  # px: scale of the Cauchy loss

# From pixels of an image of `UNIT` to the picture's coordinates, and from the field's coordinates to metres
FROM_PIXELS = np.linalg.inv([[UNIT[0], 0.0, UNIT[0] / 2.0], [0.0, UNIT[1], UNIT[1] / 2.0], [0.0, 0.0, 1.0]])
METRES = np.diag([*ALIGNMENTS["jiang"].template, 1.0])


@dataclass(frozen=True)
class LineCost:
    """Maps points (N, 4, 2) of N frames to the mean Cauchy loss of the distances of their pixels, (N,).

    A line or circle of the ground, l or C on the field, has the image ``H^T l`` or ``H^T C H``. The distance is
    ``l p / |l_xy|``, and Sampson's ``p^T C p / |2 (C p)_xy|`` for circles.
    """

    pixels: Tensor
    """Homogeneous pixels, (N, M, 3); rows beyond the pixels of a frame have weight 0."""
    lines: Tensor
    """Line of the field on which each pixel lies, (N, M, 3); 0 for pixels on circles."""
    conics: Tensor
    """Conic on which each pixel lies, (N, M, 3, 3); 0 for pixels on lines."""
    weights: Tensor
    """Weights of the pixels, (N, M), with sum 1 for each frame, or 0 where no marking was found."""

    @classmethod
    def of(cls, frames: Sequence[Localization], image_size: tuple[int, int]) -> LineCost:
        """Make the cost of frames with labelled pixels in images of one size.

        Examples
        --------
        >>> pixels = np.array([[640.0, 100.0], [640.0, 700.0]])
        >>> cost = LineCost.of([Localization({"Middle line": pixels}, {"Middle line": np.ones(2)})], (1280, 720))
        >>> x = torch.tensor([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.1], [-0.1, 0.1]])  # 24 px for a 40th of the field
        >>> cost(x[None]).item(), cost(x[None] + torch.tensor([0.005, 0.0])).item() > 10.0
        (0.0, True)
        """
        shapes = {
            label: shape for label, one in soccer(*ALIGNMENTS["jiang"].template).items() if (shape := _shape(one))
        }
        to_unit = np.divide(UNIT, image_size)
        rows = [
            [
                (*shapes[label], [*p, 1.0], weight)
                for label in frame.pixels
                if label in shapes
                for p, weight in zip(frame.pixels[label] * to_unit, frame.weights[label], strict=True)
            ]
            for frame in frames
        ]
        count = max(map(len, rows), default=0)
        nothing = (np.zeros(3), np.zeros((3, 3)), [0.0, 0.0, 1.0], 0.0)
        columns = zip(*[row for frame in rows for row in frame + [nothing] * (count - len(frame))], strict=True)
        lines, conics, pixels, weights = (
            torch.tensor(np.array(column), dtype=torch.float32).unflatten(0, (len(rows), count)) for column in columns
        )
        weights = weights / weights.sum(dim=1, keepdim=True).clamp(min=1e-6)
        return cls(pixels, lines, conics, weights)

    def __call__(self, points: Tensor) -> Tensor:
        """Cost of each frame, (N,), differentiable by the points."""
        H = homography_of_points(points) @ torch.as_tensor(FROM_PIXELS, dtype=points.dtype)
        x = self.pixels @ H.transpose(-1, -2)  # on the field
        normal = self.lines @ H[:, :, :2]
        tangent = (self.conics @ x[..., None])[..., 0]
        gradient = normal + 2.0 * tangent @ H[:, :, :2]
        value = torch.sum((self.lines + tangent) * x, dim=-1)
        squared = value.square() / (gradient.square().sum(dim=-1) + 1e-20)
        return torch.sum(self.weights * LOSS_SCALE**2 * torch.log1p(squared / LOSS_SCALE**2), dim=1)


def _shape(segment: Segment) -> tuple[Array, Array] | None:
    """Line (3,) and conic (3, 3) of a segment on the ground, in the field's coordinates; one of them is 0."""
    if np.any(segment.sample()[:, 2]):
        return None
    if isinstance(segment, Line):
        start, end = (np.linalg.solve(METRES, [*X[:2], 1.0]) for X in (segment.start, segment.end))
        line = np.cross(start, end)
        return line / np.linalg.norm(line), np.zeros((3, 3))
    if isinstance(segment, Arc):
        x, y, _ = np.divide(segment.center, segment.radius)
        unit = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [-x, -y, x * x + y * y - 1.0]])
        scaled = np.diag([1.0 / segment.radius, 1.0 / segment.radius, 1.0]) @ METRES
        return np.zeros(3), scaled.T @ unit @ scaled
    return None
