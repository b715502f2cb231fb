"""Two figures of TVCalib's paper: the loss of every frame, and accuracy against completeness as tau varies.

Needs matplotlib: the extra `figures`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from baselines.methods import Dataset, Runs
from baselines.published import OURS, TAU, TVCALIB, DatasetName
from fieldcalib.metrics import THRESHOLDS, evaluate_segments

COLORS = {OURS: "#0b6e4f", TVCALIB: "#c44536"}
STYLES = ("-", "--", ":")
LOSS_LIMIT = 0.06  # three times tau


def draw(folder: Path, datasets: Sequence[Dataset], runs: Mapping[DatasetName, Runs]) -> list[Path]:
    """Draw both figures for the methods that have a loss; returns their files."""
    folder.mkdir(parents=True, exist_ok=True)
    return [_losses(folder, datasets, runs), _accuracy_against_completeness(folder, datasets, runs)]


def _losses(folder: Path, datasets: Sequence[Dataset], runs: Mapping[DatasetName, Runs]) -> Path:
    """Loss of every frame, sorted, with tau (paper, figure "Segment reprojection loss per sample")."""
    figure, axes = _panels(len(datasets))
    for axis, dataset in zip(axes, datasets, strict=True):
        for (method, segments), run in runs[dataset.name].items():
            if run.losses is not None and method in COLORS:
                share = np.linspace(0.0, 100.0, len(run.losses))
                style = STYLES[0] if segments == "GT" else STYLES[1]
                axis.plot(share, np.sort(run.losses), style, color=COLORS[method], label=f"{method}, {segments}")
        axis.axhline(TAU, color="0.5", linewidth=0.8)
        axis.annotate(f"tau = {TAU}", (2.0, TAU), xytext=(0, 3), textcoords="offset points", color="0.4")
        axis.set(title=dataset.name, xlabel="frames, sorted [%]", ylim=(0.0, LOSS_LIMIT))
        axis.set_ylabel("loss in NDC")
        axis.legend(frameon=False, loc="upper left")
    return _save(figure, folder / "loss_per_frame.png")


def _accuracy_against_completeness(folder: Path, datasets: Sequence[Dataset], runs: Mapping[DatasetName, Runs]) -> Path:
    """AC at each threshold against CR, tau running over the losses (paper, figure "Aggregated results")."""
    figure, axes = _panels(len(datasets))
    for axis, dataset in zip(axes, datasets, strict=True):
        for (method, segments), run in runs[dataset.name].items():
            if run.losses is None or method not in COLORS or segments != "GT":
                continue
            evaluation = evaluate_segments(run.predictions, list(dataset.annotations.values()), dataset.size)
            order = np.argsort(run.losses)
            accuracy = np.cumsum(evaluation.frame_accuracy[order], axis=0) / np.arange(1, len(order) + 1)[:, None]
            cr = 100.0 * np.arange(1, len(order) + 1) / len(order)
            shown = cr >= 40.0  # below, the mean is over few frames
            at_tau = int(np.sum(run.losses <= TAU)) - 1
            for i, (t, style) in enumerate(zip(THRESHOLDS, STYLES, strict=True)):
                curve = 100.0 * accuracy[:, i]
                axis.plot(cr[shown], curve[shown], style, color=COLORS[method], label=f"{method}, AC@{t:g}")
                if at_tau >= 0 and shown[at_tau]:
                    axis.plot(cr[at_tau], curve[at_tau], "o", color=COLORS[method], markersize=4)
        axis.set(title=f"{dataset.name} (dots: tau = {TAU})", xlabel="completeness [%]", ylabel="accuracy [%]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, loc="outside right center")
    return _save(figure, folder / "accuracy_against_completeness.png")


def _panels(count: int) -> tuple[Figure, Sequence[Axes]]:
    figure = Figure(figsize=(5.5 * count, 4), layout="constrained")
    return figure, figure.subplots(1, count, squeeze=False)[0]


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=150)
    return path
