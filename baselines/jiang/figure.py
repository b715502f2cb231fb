"""Figure of the cost and the true overlap over the steps of the optimisation. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.homography import ALIGNMENTS

POINTS = {"guess": "#e0a030", "after the steps": "#0b6e4f", "true": "#222222"}
COST, WHOLE, PART = "#0b6e4f", "#c44536", "#2d5d9f"
TITLES = {"learned": "predicted error", "lines": "distances from lines"}


def draw(path: Path, traces: Sequence[Mapping[str, Any]]) -> None:
    """Draw traces that `baselines.jiang.score` wrote, one per column.

    The upper row shows medians over the frames with their interquartile range, the lower one the four points of the
    worst frames on the field.
    """
    count = len(traces)
    figure = Figure(figsize=(5.5 * count, 6.2), layout="constrained")
    grid = figure.add_gridspec(2, count, height_ratios=(2.4, 1.0))
    for column, trace in enumerate(traces):
        _draw_steps(figure.add_subplot(grid[0, column]), trace)
        worst = grid[1, column].subgridspec(1, len(trace["worst"]))
        for i, points in enumerate(trace["worst"]):
            _draw_points(figure.add_subplot(worst[i]), points)
    names = [Patch(color=colour, label=name) for name, colour in POINTS.items()]
    figure.legend(handles=names, loc="outside lower center", ncols=len(names), frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)


def _draw_steps(axis: Axes, trace: Mapping[str, Any]) -> None:
    cost = np.array(trace["cost_at_step"])
    steps = np.arange(len(cost))
    learned = trace["cost"] == "learned"
    if learned:
        _band(axis, steps, 1.0 - cost[:, ::-1], COST, "predicted IoU_whole")
    else:
        other = axis.twinx()
        _band(other, steps, cost, COST, "cost")
        other.set_ylabel("cost [px$^2$]", color=COST)
        other.set_ylim(bottom=0.0)
    some = steps[:: trace["every"]]
    _band(axis, some, np.array(trace["iou_whole_at_step"]), WHOLE, "true IoU_whole")
    _band(axis, some, np.array(trace["iou_part_at_step"]), PART, "true IoU_part")
    axis.set(title=f"cost: {TITLES[trace['cost']]}", xlabel="step", ylabel="IoU", ylim=(None, 1.0))
    axis.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.0 if learned else 0.1))


def _draw_points(axis: Axes, points: Mapping[str, Any]) -> None:
    """Draw the guessed, the best and the true points of a frame on the field."""
    size = np.array(ALIGNMENTS["jiang"].template)
    for segment in soccer(*size).markings.values():
        X = segment.sample()
        if not np.any(X[:, 2]):
            axis.plot(X[:, 0], X[:, 1], color="0.7", linewidth=0.6)
    for kind, (name, colour) in zip(("guess", "best", "true"), POINTS.items(), strict=True):
        xy = size * points[kind]
        axis.fill(xy[:, 0], xy[:, 1], fill=False, edgecolor=colour, linewidth=1.5, label=name)
    axis.set_aspect("equal")
    axis.invert_yaxis()  # y towards the camera
    axis.set_axis_off()


def _band(axis: Axes, x: np.ndarray, quartiles: np.ndarray, colour: str, label: str) -> None:
    low, middle, high = quartiles.T
    axis.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0.0)
    axis.plot(x, middle, color=colour, label=label)
