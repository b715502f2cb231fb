"""Accuracy of the guess and of the optimised points, and the course of cost and overlap over the steps."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from baselines.jiang import optimiser
from baselines.jiang.estimate import CostName, Estimator, homographies
from baselines.jiang.four_points import points_of_homography
from baselines.jiang.training_pairs import overlap
from fieldcalib._types import Array
from fieldcalib._whole_files import write_text
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.homography import ALIGNMENTS, YARD
from fieldcalib.io.formats import ANNOTATIONS, HOMOGRAPHIES, IMAGES
from fieldcalib.metrics import evaluate_segments, iou_part, iou_whole
from fieldcalib.problem.labelled_pixels import Pixels

SIZE = (1280, 720)  # px: annotated images
AT_ONCE = 16  # images in a batch
EVERY = 10  # steps between two at which overlaps are computed: one takes milliseconds
QUANTILES = (0.25, 0.5, 0.75)
WORST = 3  # number of frames whose points are written


def score(
    images: Path, annotations: Path, weights: Path, cost: CostName, steps: int, trace: Path | None
) -> dict[str, Any]:
    """Accuracy of the guess and of the optimised homographies in percent, and the time per frame.

    Parameters
    ----------
    images : Path
        Folder of ``<id>.png``, 1280x720 or squashed from that.
    annotations : Path
        Folder of ``<id>.homographyMatrix`` and ``<id>.json``.
    weights, cost, steps
        As in `Estimator`.
    trace : Path, optional
        File for costs and overlaps at the steps, as quantiles over the frames, and for the points of the worst frames.
    """
    files = IMAGES.find([images])
    truths = [HOMOGRAPHIES.read((annotations / HOMOGRAPHIES.file_name(file.id)).read_bytes()) for file in files]
    segments = [ANNOTATIONS.read((annotations / f"{file.id}.json").read_bytes(), SIZE) for file in files]
    estimator = Estimator.load(weights, cost)
    pictures = [IMAGES.read(file.read()) for file in files]
    began = time.perf_counter()
    paths = [estimator(pictures[i : i + AT_ONCE], SIZE, steps) for i in range(0, len(files), AT_ONCE)]
    seconds = time.perf_counter() - began
    path = optimiser.Path(
        torch.cat([path.points for path in paths], dim=1), torch.cat([path.costs for path in paths], dim=1)
    )
    if trace is not None:
        write_text(trace, json.dumps({"cost": cost} | _trace(path, truths)) + "\n")
    result: dict[str, Any] = {"frames": len(files), "cost": cost, "seconds_per_frame": round(seconds / len(files), 2)}
    for name, points in (("guess", path.points[0]), (f"after {steps} steps", path.best)):
        result[name] = _accuracy(homographies(points, SIZE), truths, segments)
    return result


def _accuracy(
    found: Sequence[Array | None], truths: Sequence[Array], segments: Sequence[Pixels]
) -> dict[str, float | list[float]]:
    """IoU, mean and median, and AC in percent; a frame without a homography counts 0."""
    yards = soccer(*ALIGNMENTS["jiang"].template)
    measures: dict[str, Callable[[Array, Array], float]] = {
        "IoU_part": lambda H, true: iou_part(H, true, SIZE),
        "IoU_part, cells of a yard": lambda H, true: iou_part(H, true, SIZE, field=yards, cell=YARD),
        "IoU_whole": lambda H, true: iou_whole(H, true, SIZE),
    }
    result: dict[str, float | list[float]] = {}
    for name, measure in measures.items():
        values = [0.0 if H is None else measure(H, true) for H, true in zip(found, truths, strict=True)]
        result[name] = [round(100.0 * float(value), 1) for value in (np.mean(values), np.median(values))]
    evaluation = evaluate_segments(found, segments, SIZE, planar=True)
    for t, value in zip(evaluation.thresholds, evaluation.accuracy, strict=True):
        result[f"AC@{t:g}"] = round(100.0 * float(value), 1)
    return result


def _trace(path: optimiser.Path, truths: Sequence[Array]) -> dict[str, Any]:
    """Quantiles over the frames of costs and overlaps at the steps, and the points of the worst frames."""
    true_points = points_of_homography(ALIGNMENTS["jiang"].from_fieldcalib(np.stack(truths)))
    points = path.points.numpy()
    whole = [[overlap(*pair) for pair in zip(of_step, true_points, strict=True)] for of_step in points[::EVERY]]
    part = [
        [
            0.0 if H is None else iou_part(H, true, SIZE)
            for H, true in zip(homographies(of_step, SIZE), truths, strict=True)
        ]
        for of_step in path.points[::EVERY]
    ]
    best = path.best
    worst = np.argsort([overlap(*pair) for pair in zip(best.numpy(), true_points, strict=True)])[:WORST]
    return {
        "quantiles": QUANTILES,
        "cost_at_step": _quantiles(path.costs.numpy()),
        "every": EVERY,
        "iou_whole_at_step": _quantiles(whole),
        "iou_part_at_step": _quantiles(part),
        "worst": [
            {name: values[i].tolist() for name, values in (("true", true_points), ("guess", points[0]), ("best", best))}
            for i in worst
        ],
    }


def _quantiles(values: Sequence[Sequence[float]] | Array) -> list[list[float]]:
    """Quantiles over the frames of values (steps, frames)."""
    return np.quantile(np.asarray(values, dtype=float), QUANTILES, axis=1).T.round(5).tolist()  # type: ignore[no-any-return]
