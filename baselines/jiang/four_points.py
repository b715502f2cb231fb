"""A homography as four points: where fixed points of the picture lie on the field, and the field warped by it.

Coordinates are those of ``ALIGNMENTS["jiang"]``: picture and field from -0.5 to 0.5, y towards the camera. A
homography H maps the picture to the field, up to scale.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from fieldcalib._types import Array
from fieldcalib.draw.ground import Ground, painted
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.homography import ALIGNMENTS, dehomogenize, homogenize

CANONICAL = np.array([[-0.5, 0.1], [0.5, 0.1], [0.5, 0.5], [-0.5, 0.5]])
"""Four points of the picture, on the borders of its lower part, which shows the ground in all broadcasts."""

CELL = 0.25  # m: width of a cell of the drawn field
LINE_WIDTH = 0.75  # m: lines of true width are thinner than the pixels of a small picture
MARGIN = 1.0  # m around the field
OUTSIDE = -1.0  # value outside the field; the field has 0, its lines 1


def points_of_homography(H: Array) -> Array:
    """Map the canonical points to the field, (..., 4, 2), by homographies (..., 3, 3).

    Examples
    --------
    >>> points_of_homography(np.diag([0.2, 0.4, 1.0]))[2]
    array([0.1, 0.2])
    """
    return np.asarray(dehomogenize(homogenize(CANONICAL) @ np.swapaxes(H, -1, -2)))


def homography_of_points(points: Tensor) -> Tensor:
    """Invert `points_of_homography`, differentiably: the DLT of four points in closed form.

    With homogeneous points of the field, D = [d1 d2 d3] and d4, and of the picture, C = [c1 c2 c3] and c4,
    ``H = D diag(a / b) C^-1``, where ``D a = d4`` and ``C b = c4``. By Cramer's rule a consists of three areas of
    triangles, up to scale.

    Parameters
    ----------
    points : (..., 4, 2) tensor

    Returns
    -------
    (..., 3, 3) tensor
        Scaled so that the third coordinate is 1 at the middle of the picture's lower border.

    Examples
    --------
    >>> H = homography_of_points(torch.tensor(0.5 * CANONICAL))
    >>> bool(torch.allclose(H, torch.diag(torch.tensor([0.5, 0.5, 1.0], dtype=H.dtype))))
    True
    """
    d = torch.cat([points, torch.ones_like(points[..., :1])], dim=-1)
    first, last = d[..., :3, :], d[..., 3:, :]
    others = torch.linalg.cross(first.roll(-1, -2), first.roll(-2, -2), dim=-1)
    a = torch.sum(others * last, dim=-1)
    c = homogenize(CANONICAL)
    b = np.linalg.solve(c[:3].T, c[3])
    to_basis = torch.as_tensor(np.diag(1.0 / b) @ np.linalg.inv(c[:3].T), dtype=points.dtype, device=points.device)
    H = (a[..., None] * first).transpose(-1, -2) @ to_basis
    w = H[..., 2, 1] / 2.0 + H[..., 2, 2]
    return H / w[..., None, None]


def field_drawing() -> Array:
    """Draw the field from above with `MARGIN` around it, one value per cell; rows go towards the camera."""
    field = soccer(*ALIGNMENTS["jiang"].template)
    columns, rows = (round((side + 2.0 * MARGIN) / CELL) for side in (field.length, field.width))
    x, y = ((np.arange(count) + 0.5) * CELL - count * CELL / 2.0 for count in (columns, rows))
    xy = np.stack(np.meshgrid(x, y)).astype(np.float32)
    step = np.float32(CELL) * np.ones_like(xy[0])
    ground = Ground(xy, np.stack([step, 0.0 * step]), np.stack([0.0 * step, step]))
    inside = (np.abs(xy[0]) <= field.length / 2.0) & (np.abs(xy[1]) <= field.width / 2.0)
    (lines,) = painted(ground, field, LINE_WIDTH).values()
    return np.where(inside | (lines > 0.0), lines, OUTSIDE)


def pixel_centres(size: int) -> Tensor:
    """Homogeneous coordinates of the pixels of a square picture, (size, size, 3)."""
    u = (torch.arange(size) + 0.5) / size - 0.5
    v, u = torch.meshgrid(u, u, indexing="ij")
    return torch.stack([u, v, torch.ones_like(u)], dim=-1)


def warped_field(H: Tensor, drawing: Tensor, size: int) -> Tensor:
    """Warp the drawn field into pictures by homographies, with the field coordinates of every pixel.

    Parameters
    ----------
    H : (N, 3, 3) tensor
        As `homography_of_points` gives them; the sign matters.
    drawing : (rows, columns) tensor
        `field_drawing`.
    size : int
        Width and height of the pictures.

    Returns
    -------
    (N, 3, size, size) tensor
        The drawing, x and y; `OUTSIDE`, 0 and 0 where there is no field.
    """
    X = pixel_centres(size).to(H) @ H.transpose(-1, -2)[:, None]
    x, y = X[..., 0], X[..., 1]
    w = X[..., 2]
    on_ground = w > 1e-3
    w = torch.where(on_ground, w, 1.0)
    xy = torch.stack([x / w, y / w], dim=-1)
    rows, columns = drawing.shape
    extent = torch.tensor(ALIGNMENTS["jiang"].template).to(H) / (CELL * torch.tensor([columns, rows]).to(H))
    values = grid_sample(
        drawing[None, None].to(H).expand(len(H), -1, -1, -1),
        torch.where(on_ground[..., None], 2.0 * extent * xy, 2.0),
        padding_mode="border",
        align_corners=False,
    )
    inside = on_ground & (xy.abs() <= 0.5).all(dim=-1)
    return torch.cat([values, torch.where(inside[..., None], xy, 0.0).permute(0, 3, 1, 2)], dim=1)
