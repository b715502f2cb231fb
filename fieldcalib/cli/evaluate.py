"""`fieldcalib evaluate`: scores of cameras or homographies of any tool against annotations."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from fieldcalib import metrics
from fieldcalib._progress import say, show
from fieldcalib._types import Array
from fieldcalib.console.arguments import add_most_bytes, add_run_options, add_size, add_sized_field, field_of, positive
from fieldcalib.fields.field import Field
from fieldcalib.io.soccernet import CAMERA_TYPES
from fieldcalib.metrics.accuracy import CompoundScore
from fieldcalib.metrics.cameras import is_homography
from fieldcalib.run_folder.labelled_frames import name_skipped
from fieldcalib.run_folder.predictions import FileReader, GroundTruth, Predictions, read_ground_truth, read_predictions
from fieldcalib.run_folder.results import is_unfinished
from fieldcalib.run_folder.work_units import executor_of

PERCENT = 100.0
# keys of a report, and attributes of an evaluation
RATIOS = {"AC": "accuracy", "precision": "precision", "recall": "recall"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Score cameras (camera_<id>.json in SoccerNet's format, or TVCalib's per_sample_output.json) or "
        "homographies (<id>.homographyMatrix, 1280x720 image to field in yards as in WC14) against annotated segments "
        "(<id>.json), as SoccerNet's evaluation does. Where the ground truth has homographies too, what is seen of the "
        "field is compared with them. Pixels are those of --size: at a smaller one every prediction looks better."
    )
    parser.add_argument("predictions", type=Path, metavar="PREDICTIONS", help="a folder, a zip or a file")
    parser.add_argument("ground_truth", type=Path, metavar="GROUND_TRUTH", help="a folder or a zip of annotations")
    add_size(
        parser,
        "at which it is scored: cameras must be for it, homographies are scaled to it; by default that of the cameras, "
        "1280x720 for homographies",
    )
    parser.add_argument(
        "--thresholds",
        type=_thresholds,
        default=metrics.THRESHOLDS,
        metavar="PX,PX,...",
        help="of AC in pixels (5,10,20)",
    )
    parser.add_argument(
        "--planar", action="store_true", help="segments on the ground alone; homographies have no others"
    )
    parser.add_argument(
        "--homographies", action="store_true", help="score the homographies of PREDICTIONS, not the cameras"
    )
    parser.add_argument(
        "--camera-type", metavar="NAME", help=f"only frames that {CAMERA_TYPES} calls so, e.g. 'Main camera center'"
    )
    add_sized_field(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_run_options(parser, "jobs")
    add_most_bytes(parser)


def _thresholds(text: str) -> tuple[float, ...]:
    return tuple(sorted({positive(part) for part in text.split(",")}))


def run(options: argparse.Namespace) -> int:
    """Evaluate and print; returns the exit code."""
    broken: list[str] = []
    try:
        with executor_of(options.jobs) as executor:
            reader = FileReader(broken, options.most_bytes, executor)
            field, ground_truth = field_of(options), options.ground_truth
            predictions = read_predictions(reader, options.predictions, options.size, homographies=options.homographies)
            truth = read_ground_truth(reader, ground_truth, predictions.size, field, options.camera_type)
            _warn(predictions, truth, options.predictions, ground_truth, options.line_width or 0.0)
            planar = options.planar or any(map(is_homography, predictions.by_frame.values()))
            report = evaluate(
                predictions.by_frame,
                truth,
                predictions.size,
                field=field,
                thresholds=options.thresholds,
                planar=planar,
                executor=executor,
            )
    finally:  # broken files may be why there is nothing to evaluate
        for message in broken:
            say(message)
    show(json.dumps(report, indent=2, allow_nan=False) if options.json else table(report))
    return 1 if broken else 0


def _warn(predictions: Predictions, truth: GroundTruth, path: Path, truth_path: Path, line_width: float) -> None:
    """Say on stderr what may be wrong with the input; a ValueError if they have no frame in common."""
    width, height = predictions.size
    name_skipped([path], predictions.files)
    name_skipped([truth_path], truth.files)
    if is_unfinished(path):
        say(f"the run in {path} is not finished: frames without a camera may have one later")
    if predictions.of_other_sizes:
        sizes = ", ".join(f"{w}x{h}" for w, h in predictions.of_other_sizes)
        say(
            f"cameras for images of {sizes} are scored at {width}x{height} as they are: SoccerNet's "
            f"evaluation does not rescale"
        )
    if predictions.line_width not in (None, line_width):
        say(
            f"the cameras take the middles of lines {predictions.line_width:g} m wide as markings, and are scored on a "
            f"field with lines of {line_width:g} m: --line-width {predictions.line_width:g} scores them on theirs"
        )
    by_frame = predictions.by_frame
    if not set(by_frame) & set(truth.annotations):
        raise ValueError(
            f"{path} has {_first_ids(by_frame)}, {truth_path} has {_first_ids(truth.annotations)}: no frame in common, "
            f"do the ids agree?"
        )


def _first_ids(frames: Mapping[str, Any]) -> str:
    """The first ids, for messages."""
    names = ", ".join(list(frames)[:3]) or "none"
    return f"the frames {names}" + (f" and {len(frames) - 3} more" if len(frames) > 3 else "")


def evaluate(
    predictions: Mapping[str, metrics.Prediction],
    truth: GroundTruth,
    size: tuple[int, int],
    *,
    field: Field | None = None,
    thresholds: Sequence[float] = metrics.THRESHOLDS,
    planar: bool = False,
    executor: Executor | None = None,
) -> dict[str, Any]:
    """All metrics that the ground truth allows, as JSON: ratios in percent, the rest with its unit in the name."""
    ids = list(truth.annotations)
    evaluation = metrics.evaluate_segments(
        [predictions.get(id) for id in ids],
        list(truth.annotations.values()),
        size,
        field=field,
        thresholds=thresholds,
        planar=planar,
        executor=executor,
    )
    names = [f"{t:g}" for t in evaluation.thresholds]
    report: dict[str, Any] = {
        "frames": len(ids),
        "cameras": int(evaluation.found.sum()),
        "size": list(size),
        "planar": planar,
        "CR": _percent(evaluation.completeness),
        **{name: _percents(names, getattr(evaluation, value)) for name, value in RATIOS.items()},
    }
    if evaluation.thresholds == metrics.THRESHOLDS:
        report["CS"] = {kind: _compound_score(evaluation, kind, truth.share) for kind in ("printed", "tables")}
    report["segments"] = _per_segment(evaluation)
    compared = {id: (predictions[id], H) for id, H in truth.homographies.items() if id in predictions}
    if compared:
        report["against_homographies"] = _against_homographies(list(compared.values()), size, field)
    return report


def _compound_score(evaluation: metrics.SegmentEvaluation, kind: CompoundScore, share: float) -> float | None:
    if not np.any(evaluation.found):
        return None
    return _percent(metrics.compound_score(evaluation.accuracy, evaluation.completeness, kind, share=share))


def _percents(names: Sequence[str], values: Array) -> dict[str, float | None]:
    return {name: _percent(value) for name, value in zip(names, values.tolist(), strict=True)}


def _percent(value: float) -> float | None:
    """A ratio in percent; None where it is undefined, since JSON has no NaN."""
    return None if np.isnan(value) else PERCENT * value


def _per_segment(evaluation: metrics.SegmentEvaluation) -> dict[str, dict[str, Any]]:
    """AC of each label at each threshold over all frames, and its reprojection error in pixels.

    None where a label does not occur: which side's labels count may change with the threshold.
    """
    by_threshold = {f"{t:g}": evaluation.per_label(t) for t in evaluation.thresholds}
    errors = evaluation.segment_errors()
    rows: dict[str, dict[str, Any]] = {}
    for label in evaluation.labels:
        found = {t: confusions.get(label, metrics.Confusion(0, 0, 0)) for t, confusions in by_threshold.items()}
        if not any(label in confusions for confusions in by_threshold.values()):
            continue
        rows[label] = {
            name: {t: _percent(getattr(confusion, value)) for t, confusion in found.items()}
            for name, value in RATIOS.items()
        }
        if label in errors:
            rows[label] |= {
                "points": len(errors[label]),
                "median_px": float(np.median(errors[label])),
                "rms_px": float(np.sqrt(np.mean(np.square(errors[label])))),
            }
    return rows


def _against_homographies(
    pairs: Sequence[tuple[metrics.Prediction, Array]], size: tuple[int, int], field: Field | None
) -> dict[str, Any]:
    """Overlaps and errors against homographies: means and medians over the frames."""
    part = [PERCENT * metrics.iou_part(prediction, H, size, field=field) for prediction, H in pairs]
    whole = [PERCENT * metrics.iou_whole(prediction, H, size, field=field) for prediction, H in pairs]
    whole_image = [
        PERCENT * metrics.iou_whole(prediction, H, size, kind="image", field=field) for prediction, H in pairs
    ]
    errors = [metrics.projection_error(prediction, H, size, field=field) for prediction, H in pairs]
    metres = [error.mean for error in errors if np.isfinite(error.mean)]
    unseen = [PERCENT * error.unseen for error in errors if np.isfinite(error.unseen)]
    values = {"IoU_part": part, "IoU_whole": whole, "IoU_whole_image": whole_image, "projection_error_m": metres}
    values["field_unseen"] = unseen
    return {"frames": len(pairs)} | {
        name: {"mean": float(np.mean(v)), "median": float(np.median(v))} for name, v in values.items() if v
    }


def table(report: Mapping[str, Any]) -> str:
    """A report as a table to read."""
    thresholds = list(report["AC"])
    width, height = report["size"]
    lines = [
        f"{report['frames']} frames at {width}x{height}, {report['cameras']} with a prediction"
        + (", segments on the ground only" if report["planar"] else ""),
        "",
        f"{'':26s}" + "".join(f"{'@' + t:>8s}" for t in thresholds) + "  px",
    ]
    lines += [f"{name:26s}" + "".join(_cell(report[name][t]) for t in thresholds) for name in RATIOS]
    lines.append(f"{'CR':26s}{_cell(report['CR'])}")
    if "CS" in report:
        lines.append(f"{'CS as printed':26s}{_cell(report['CS']['printed'])}")
        lines.append(f"{'CS, weights reversed':26s}{_cell(report['CS']['tables'])}")
    for name, values in report.get("against_homographies", {}).items():
        if name != "frames":
            lines.append(f"{name:26s}{values['mean']:8.2f} mean, {values['median']:.2f} median")
    lines += ["", f"{'AC by segment':26s}" + "".join(f"{'@' + t:>8s}" for t in thresholds) + "  median px  rms px"]
    for label, row in report["segments"].items():
        errors = f"{row['median_px']:11.2f}{row['rms_px']:8.1f}" if "points" in row else ""
        lines.append(f"{label:26s}" + "".join(_cell(row["AC"][t]) for t in thresholds) + errors)
    return "\n".join(lines)


def _cell(value: float | None) -> str:
    return f"{'-':>8s}" if value is None else f"{value:8.2f}"
