"""Four points moved by Adam so that a cost falls: the predicted error, or the distances from lines (`lines`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import torch
from torch import Tensor

STEPS, LEARNING_RATE = 400, 1e-3  # the paper's

Cost: TypeAlias = Callable[[Tensor], Tensor]
"""The cost of each of N frames, (N,), by their points (N, 4, 2); differentiable."""


@dataclass(frozen=True)
class Path:
    """What the points of N frames went through, from the initial guess on."""

    points: Tensor
    """(steps + 1, N, 4, 2)."""
    costs: Tensor
    """(steps + 1, N)."""

    @property
    def best(self) -> Tensor:
        """The points of least cost, (N, 4, 2); of equal ones the first."""
        first = torch.argmin(torch.nan_to_num(self.costs, nan=torch.inf), dim=0)
        return self.points[first, torch.arange(len(first))]


def optimise(cost: Cost, initial: Tensor, *, steps: int = STEPS, learning_rate: float = LEARNING_RATE) -> Path:
    """Follow the gradient of the costs of N frames; each frame is by itself.

    Parameters
    ----------
    cost : callable
    initial : (N, 4, 2) tensor
    steps : int
    learning_rate : float

    Examples
    --------
    >>> path = optimise(lambda points: points.square().sum(dim=(1, 2)), torch.full((1, 4, 2), 0.1), steps=200)
    >>> path.costs.shape, bool(path.best.abs().max() < 0.01)
    (torch.Size([201, 1]), True)
    """
    points = initial.detach().clone().requires_grad_()
    optimizer = torch.optim.Adam([points], learning_rate)
    visited, costs = [], []
    for step in range(steps + 1):
        values = cost(points)
        visited.append(points.detach().clone())
        costs.append(values.detach())
        if step < steps:
            optimizer.zero_grad()
            values.sum().backward()
            optimizer.step()
    return Path(torch.stack(visited), torch.stack(costs))
