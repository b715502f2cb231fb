"""`fieldcalib evaluate`: anybody's cameras or homographies against annotations."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fieldcalib._types import Array
from fieldcalib.commands.arguments import image_size, positive
from fieldcalib.field import soccer
from fieldcalib.io.files import BrokenFileError, FrameFile
from fieldcalib.io.soccernet import (
    CAMERA_TYPES,
    find_annotations,
    find_cameras,
    parse_annotation,
    parse_camera,
    read_camera_types,
)
from fieldcalib.io.tvcalib import parse_per_sample_output
from fieldcalib.io.wc14 import HOMOGRAPHY, IMAGE_SIZE, find_homographies, parse_homography
from fieldcalib.metrics import (
    THRESHOLDS,
    Confusion,
    Prediction,
    SegmentEvaluation,
    compound_score,
    evaluate_segments,
    iou_part,
    iou_whole,
    projection_error,
)
from fieldcalib.metrics.accuracy import check_annotation
from fieldcalib.rational import RationalCamera
from fieldcalib.segments import Pixels

PERCENT = 100.0
OFF_CENTRE = 0.1  # of the image's size: a principal point further off belongs to an image of another size


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = commands.add_parser(
        "evaluate",
        help="score cameras or homographies against annotations",
        description="Score cameras (camera_<id>.json in SoccerNet's format, or TVCalib's per_sample_output.json) or "
        "homographies (<id>.homographyMatrix, image to field in yards as in WC14) against annotated segments "
        "(<id>.json), as SoccerNet's evaluation does. Where the ground truth has homographies too, what is seen of the "
        "field is compared with them.",
    )
    parser.add_argument("predictions", type=Path, metavar="PREDICTIONS", help="a folder, a zip or a file")
    parser.add_argument("ground_truth", type=Path, metavar="GROUND_TRUTH", help="a folder or a zip of annotations")
    parser.add_argument(
        "--size",
        type=image_size,
        metavar="WxH",
        help="of the annotated images; by default that of the cameras, 1280x720 for homographies",
    )
    parser.add_argument(
        "--thresholds",
        type=_thresholds,
        default=THRESHOLDS,
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
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run)


def _thresholds(text: str) -> tuple[float, ...]:
    return tuple(sorted({positive(part) for part in text.split(",")}))


def run(options: argparse.Namespace) -> int:
    """Evaluate and print; returns the exit code."""
    broken: list[str] = []
    try:
        report = _report(options, broken)
    finally:  # broken files may be why there is nothing to evaluate
        for message in broken:
            print(f"fieldcalib: {message}", file=sys.stderr)
    print(json.dumps(report, indent=2, allow_nan=False) if options.json else table(report))
    return 1 if broken else 0


def _report(options: argparse.Namespace, broken: list[str]) -> dict[str, Any]:
    predictions = read_predictions(options.predictions, broken, size=options.size, homographies=options.homographies)
    if not predictions:
        raise ValueError(f"{options.predictions} holds no prediction that can be evaluated")
    size = options.size or _common_size(predictions)
    truth = read_ground_truth(options.ground_truth, size, broken, camera_type=options.camera_type)
    others = {_natural_size(p) for p in predictions.values() if isinstance(p, RationalCamera)}
    others = {other for other in others if np.any(np.abs(np.subtract(other, size)) > OFF_CENTRE * np.array(size))}
    if others:
        sizes = ", ".join(f"{width}x{height}" for width, height in sorted(others))
        print(
            f"fieldcalib: cameras for images of {sizes} are scored at {size[0]}x{size[1]} as they are: SoccerNet's "
            f"evaluation does not rescale",
            file=sys.stderr,
        )
    if not set(predictions) & set(truth.annotations):
        raise ValueError(
            f"{options.predictions} has {_some(predictions)}, {options.ground_truth} has {_some(truth.annotations)}: "
            f"no frame in common, do the ids agree?"
        )
    planar = options.planar or any(not isinstance(p, RationalCamera) for p in predictions.values())
    return evaluate(predictions, truth, size, thresholds=options.thresholds, planar=planar)


def _natural_size(camera: RationalCamera) -> tuple[int, int]:
    """The image whose centre is the principal point, as SoccerNet has it."""
    width, height = np.round(2.0 * camera.K[:2, 2]).astype(int).tolist()
    return width, height


def _some(frames: Mapping[str, Any]) -> str:
    """The first ids, for messages."""
    names = ", ".join(list(frames)[:3]) or "none"
    return f"the frames {names}" + (f" and {len(frames) - 3} more" if len(frames) > 3 else "")


@dataclass(frozen=True)
class GroundTruth:
    """What is known of the frames of a data set."""

    annotations: Mapping[str, Pixels]
    homographies: Mapping[str, Array]
    """From the field to the image, of the frames that have one."""


def read_predictions(
    path: Path, broken: list[str], *, size: tuple[int, int] | None = None, homographies: bool = False
) -> dict[str, Prediction]:
    """Cameras of a folder, a zip or a TVCalib output by frame, or homographies if asked for or if there are no cameras.

    Homographies of files are those of 1280 x 720 images and are scaled to `size`. What is wrong with files that cannot
    be read is added to `broken`; their frames have no prediction.
    """
    if path.suffix in (".json", ".jsonl") and path.is_file() and not path.name.startswith("camera_"):
        return _read_tvcalib(path, homographies=homographies)
    if not homographies and path.suffix != HOMOGRAPHY:
        try:
            return _read(find_cameras(path), lambda content: parse_camera(content, size), broken)
        except FileNotFoundError:
            if not path.exists():
                raise
    try:
        files = find_homographies(path)
    except FileNotFoundError:
        if homographies or not path.exists():
            raise
        raise FileNotFoundError(
            f"{path} holds no prediction: expected camera_<id>.json, <id>{HOMOGRAPHY}, or TVCalib's "
            f"per_sample_output.json itself"
        ) from None
    return _read(files, lambda content: parse_homography(content, image_size=size or IMAGE_SIZE), broken)


def _read_tvcalib(path: Path, *, homographies: bool) -> dict[str, Prediction]:
    try:
        records = parse_per_sample_output(path.read_bytes())
    except BrokenFileError as error:
        raise BrokenFileError(f"{path}: {error}") from None
    twice = [id for id, count in Counter(record.id for record in records).items() if count > 1]
    if twice:
        raise BrokenFileError(f"{path}: frame {twice[0]} has several records")
    cameras = {r.id: RationalCamera.from_camera(r.camera) for r in records if r.camera is not None}
    maps = {r.id: r.homography for r in records if r.homography is not None}
    return dict(maps if homographies or not cameras else cameras)


def read_ground_truth(
    path: Path, size: tuple[int, int], broken: list[str], *, camera_type: str | None = None
) -> GroundTruth:
    """Annotations of a folder or a zip, and homographies that lie beside them."""
    files = find_annotations([path])
    if camera_type is not None:
        types = read_camera_types([path])
        files = [file for file in files if types.get(file.id) == camera_type]
        if not files:
            raise ValueError(f"no frame is of type {camera_type!r}; there are {', '.join(sorted(set(types.values())))}")
    field = soccer()
    annotations = _read(
        files, lambda content: check_annotation(parse_annotation(content, size, unknown=True), field), broken
    )
    ids = {file.id for file in files}
    found = [file for file in _beside(path, find_homographies) if file.id in ids]
    return GroundTruth(annotations, _read(found, lambda content: parse_homography(content, image_size=size), broken))


def _beside(path: Path, find: Callable[[Path], list[FrameFile]]) -> list[FrameFile]:
    """What lies beside annotations in a folder or a zip; nothing where it is a single annotation."""
    try:
        return [file for file in find(path) if file.path != path]
    except FileNotFoundError:
        return []


def _read(files: Sequence[FrameFile], parse: Callable[[bytes], Any], broken: list[str]) -> dict[str, Any]:
    """Parsed content of files by frame; messages about broken ones go to `broken`."""
    found = {}
    for file in files:
        try:
            found[file.id] = parse(file.read())
        except ValueError as error:
            broken.append(f"{file.path}: {error}")
    return found


def _common_size(predictions: Mapping[str, Prediction]) -> tuple[int, int]:
    sizes = {p.image_size if isinstance(p, RationalCamera) else IMAGE_SIZE for p in predictions.values()}
    if len(sizes) != 1:
        raise ValueError("the cameras are for images of several sizes: say by --size which one the annotations have")
    return sizes.pop()


def evaluate(
    predictions: Mapping[str, Prediction],
    truth: GroundTruth,
    size: tuple[int, int],
    *,
    thresholds: Sequence[float] = THRESHOLDS,
    planar: bool = False,
) -> dict[str, Any]:
    """All metrics that the ground truth allows, as JSON: ratios in percent, the rest with its unit in the name."""
    ids = list(truth.annotations)
    evaluation = evaluate_segments(
        [predictions.get(id) for id in ids],
        list(truth.annotations.values()),
        size,
        thresholds=thresholds,
        planar=planar,
    )
    names = [f"{t:g}" for t in evaluation.thresholds]
    report: dict[str, Any] = {
        "frames": len(ids),
        "cameras": int(evaluation.found.sum()),
        "size": list(size),
        "planar": planar,
        "CR": _percent(evaluation.completeness),
        "AC": _percents(names, evaluation.accuracy),
        "precision": _percents(names, evaluation.precision),
        "recall": _percents(names, evaluation.recall),
    }
    if evaluation.thresholds == THRESHOLDS:
        report["CS"] = {
            kind: _percent(compound_score(evaluation.accuracy, evaluation.completeness, kind))
            for kind in ("printed", "tables")
        }
    report["segments"] = _per_segment(evaluation)
    compared = {id: (predictions[id], H) for id, H in truth.homographies.items() if id in predictions}
    if compared:
        report["against_homographies"] = _against_homographies(list(compared.values()), size)
    return report


def _percents(names: Sequence[str], values: Array) -> dict[str, float | None]:
    return {name: _percent(value) for name, value in zip(names, values.tolist(), strict=True)}


def _percent(value: float) -> float | None:
    """A ratio in percent; None where it is undefined, since JSON has no NaN."""
    return None if np.isnan(value) else PERCENT * value


def _per_segment(evaluation: SegmentEvaluation) -> dict[str, dict[str, Any]]:
    """AC of each label at each threshold over all frames, and its reprojection error in pixels.

    None where a label does not occur: which side's labels count may change with the threshold.
    """
    by_threshold = {f"{t:g}": evaluation.per_label(t) for t in evaluation.thresholds}
    errors = evaluation.segment_errors(evaluation.thresholds[-1])
    rows: dict[str, dict[str, Any]] = {}
    for label in evaluation.labels:
        found = {t: confusions.get(label, Confusion(0, 0, 0)) for t, confusions in by_threshold.items()}
        if not any(label in confusions for confusions in by_threshold.values()):
            continue
        rows[label] = {
            "AC": {t: _percent(confusion.accuracy) for t, confusion in found.items()},
            "precision": {t: _percent(confusion.precision) for t, confusion in found.items()},
            "recall": {t: _percent(confusion.recall) for t, confusion in found.items()},
        }
        if label in errors:
            rows[label] |= {
                "points": len(errors[label]),
                "median_px": float(np.median(errors[label])),
                "rms_px": float(np.sqrt(np.mean(np.square(errors[label])))),
            }
    return rows


def _against_homographies(pairs: Sequence[tuple[Prediction, Array]], size: tuple[int, int]) -> dict[str, Any]:
    """What is seen of the field, and where: means and medians over the frames."""
    part = [PERCENT * iou_part(prediction, H, size) for prediction, H in pairs]
    whole = [PERCENT * iou_whole(prediction, H, size) for prediction, H in pairs]
    whole_image = [PERCENT * iou_whole(prediction, H, size, kind="image") for prediction, H in pairs]
    metres = np.array([projection_error(prediction, H, size).mean for prediction, H in pairs])
    metres = metres[np.isfinite(metres)]
    values = {"IoU_part": part, "IoU_whole": whole, "IoU_whole_image": whole_image, "projection_error_m": metres}
    return {"frames": len(pairs)} | {
        name: {"mean": float(np.mean(v)), "median": float(np.median(v))} for name, v in values.items() if len(v)
    }


def table(report: Mapping[str, Any]) -> str:
    """A report for people."""
    thresholds = list(report["AC"])
    width, height = report["size"]
    lines = [
        f"{report['frames']} frames at {width}x{height}, {report['cameras']} with a prediction"
        + (", segments on the ground only" if report["planar"] else ""),
        "",
        f"{'':26s}" + "".join(f"{'@' + t:>8s}" for t in thresholds) + "  px",
    ]
    for name in ("AC", "precision", "recall"):
        lines.append(f"{name:26s}" + "".join(_cell(report[name][t]) for t in thresholds))
    lines.append(f"{'CR':26s}{_cell(report['CR'])}")
    if "CS" in report:
        lines.append(f"{'CS as printed':26s}{_cell(report['CS']['printed'])}")
        lines.append(f"{'CS as in the tables':26s}{_cell(report['CS']['tables'])}")
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
