"""Minimises a cost of four points by Adam: the predicted error, or distances from lines (`lines`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import torch
from torch import Tensor

STEPS, LEARNING_RATE = 400, 1e-3  # as in the paper

Cost: TypeAlias = Callable[[Tensor], Tensor]
"""Maps the points (N, 4, 2) of N frames to their costs (N,); differentiable."""


@dataclass(frozen=True)
class Path:
    """Points and costs of N frames at every step, from the initial guess on."""

    points: Tensor
    """(steps + 1, N, 4, 2)."""
    costs: Tensor
    """(steps + 1, N)."""

    @property
    def best(self) -> Tensor:
        """The points of least cost, (N, 4, 2); the first of them where costs are equal."""
        first = torch.argmin(torch.nan_to_num(self.costs, nan=torch.inf), dim=0)
        return self.points[first, torch.arange(len(first))]


def optimise(cost: Cost, initial: Tensor, *, steps: int = STEPS) -> Path:
    """Move the points (N, 4, 2) of N frames down the gradients of their costs; frames do not influence each other.

    Examples
    --------
    >>> path = optimise(lambda points: points.square().sum(dim=(1, 2)), torch.full((1, 4, 2), 0.1), steps=200)
    >>> path.costs.shape, bool(path.best.abs().max() < 0.01)
    (torch.Size([201, 1]), True)
    """
    points = initial.detach().clone().requires_grad_()
    optimizer = torch.optim.Adam([points], LEARNING_RATE)
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
