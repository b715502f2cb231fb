"""The tables of TVCalib's paper, measured on given data, with the published numbers beside them.

    python -m baselines.tables --sncalib DIR --wc14 DIR [--markdown | --json] [--figures DIR]

    python -m baselines.tables --sncalib DIR --sncalib-images DIR --wc14 DIR --wc14-images DIR --wc14-pnlcalib DIR

SN-Calib-test-center is scored at 960x540, WC14-test at 1280x720. CS is the variant of the compound score
that made the paper's tables (`fieldcalib.metrics.compound_score`). Rows whose input is missing are listed with the
reason.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_args

import numpy as np

import fieldcalib
from baselines import published as paper
from baselines import tvcalib
from baselines.chen.database import Database
from baselines.methods import Dataset, Runs, read_dataset, run_methods
from fieldcalib._progress import say
from fieldcalib.console.options import add_options, given, option, switch
from fieldcalib.console.program import exit_code
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.metrics import compound_score, evaluate_segments, iou_part

SN, WC, SN_PICTURES, WC_PICTURES = get_args(paper.DatasetName)
SIZES: dict[paper.DatasetName, tuple[int, int]] = {
    SN: (960, 540),
    WC: (1280, 720),
    SN_PICTURES: (960, 540),
    WC_PICTURES: (1280, 720),
}
SHARES: dict[paper.DatasetName, float] = dict.fromkeys(SIZES, 1.0) | {SN: paper.SN_TEST_CENTER / paper.SN_TEST}
TITLES: dict[paper.Evaluated, str] = {"camera": "cameras", "homography": "homographies, segments on the ground only"}
ONLY_HOMOGRAPHIES = (paper.DLT, paper.ANNOTATED, paper.CHEN, paper.CHEN_WIDER, paper.JIANG)
FOLDER: dict[str, Any] = {"type": Path, "metavar": "DIR"}  # of options
COLUMNS = ("AC@5", "AC@10", "AC@20", "CR", "CS", "IoU_part mean", "median")


@dataclass(frozen=True)
class Measured:
    """A row of a table: measured values in percent, or the reason why they are missing."""

    dataset: paper.DatasetName
    evaluated: paper.Evaluated
    method: str
    segments: paper.Segments
    tau: float | None
    values: tuple[float, ...] | None
    """Values in the order of COLUMNS; IoU only for homographies, if there are annotated ones."""
    published: tuple[float, ...] | None
    milliseconds: float | None
    """Time per frame."""
    reason: str | None


@dataclass(frozen=True)
class Options:
    """What is measured, and how the tables are printed."""

    sncalib: Path | None = option("SoccerNet-Calibration test annotations", **FOLDER)
    wc14: Path | None = option("WC14 test annotations and homographies", **FOLDER)
    sncalib_pred: Path | None = option("segments that a network found in SN-Calib", **FOLDER)
    wc14_pred: Path | None = option("segments that a network found in WC14", **FOLDER)
    sncalib_images: Path | None = option("pictures of some of these frames: a table of methods from images", **FOLDER)
    wc14_images: Path | None = option("the same of WC14, squashed or not", **FOLDER)
    wc14_pnlcalib: Path | None = option("points and lines that PnLCalib's networks found in WC14", **FOLDER)
    chen: Path | None = option("Chen's homographies of WC14, <id>.homographyMatrix", **FOLDER)
    chen_database: Sequence[Path] | None = option(
        "run Chen's method with this database of python -m baselines.chen; again for one of other cameras",
        type=Path,
        action="append",
        metavar="FILE",
    )
    jiang: Path | None = option("Jiang's homographies, as baselines.jiang writes them", **FOLDER)
    steps: int = option(f"of TVCalib's optimiser ({tvcalib.STEPS}, the paper's)", default=tvcalib.STEPS, type=int)
    markdown: bool = switch("print Markdown", exclusive="form")
    json: bool = switch("print JSON", exclusive="form")
    figures: Path | None = option("draw the paper's two figures there (matplotlib)", **FOLDER)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m baselines.tables", description="Measure the paper's tables on given data."
    )
    add_options(parser, Options)
    options = given(Options, parser.parse_args(arguments))
    if options.sncalib is None and options.wc14 is None:
        parser.error("nothing to measure: give --sncalib, --wc14 or both")
    for name in ("sncalib", "wc14"):
        if getattr(options, name) is None and getattr(options, f"{name}_images") is not None:
            parser.error(f"--{name}-images needs --{name}: pictures are scored with the annotations of their frames")
    if options.figures is not None and find_spec("matplotlib") is None:
        parser.error("drawing figures needs matplotlib: pip install 'fieldcalib[figures]'")
    return exit_code(partial(_run, options))


def _run(options: Options) -> int:
    field = soccer()
    databases = [Database.read(path) for path in options.chen_database or ()]
    for database in databases:
        database.check_field(field)
    datasets: list[Dataset] = []
    if options.sncalib is not None:
        datasets.append(_read(SN, options.sncalib, predicted=options.sncalib_pred))
        if options.sncalib_images is not None:
            datasets.append(_read(SN_PICTURES, options.sncalib, pictures=options.sncalib_images))
    if options.wc14 is not None:
        others = {m: path for m, path in ((paper.CHEN, options.chen), (paper.JIANG, options.jiang)) if path is not None}
        datasets.append(
            _read(WC, options.wc14, predicted=options.wc14_pred, others=others, detections=options.wc14_pnlcalib)
        )
        if options.wc14_images is not None:
            datasets.append(_read(WC_PICTURES, options.wc14, pictures=options.wc14_images))
    runs = {dataset.name: run_methods(dataset, field, options.steps, databases) for dataset in datasets}
    rows = [row for dataset in datasets for row in measure(dataset, runs[dataset.name], field)]
    statistics = [dataset_statistics(dataset) for dataset in datasets]
    if options.json:
        record = {
            "version": fieldcalib.__version__,
            "tvcalib_steps": options.steps,
            "datasets": statistics,
            "rows": [as_record(row) for row in rows],
        }
        print(json.dumps(record, indent=2))
    else:
        print(as_text(statistics, rows, options.steps, markdown=options.markdown))
    if options.figures is not None:
        from baselines import figures  # imports matplotlib

        annotated = [dataset for dataset in datasets if dataset.pictures is None]
        for path in figures.draw(options.figures, annotated, runs):
            say(str(path))
    return 0


def _read(name: paper.DatasetName, path: Path, **more: Any) -> Dataset:
    return read_dataset(name, path, SIZES[name], **more)


def measure(dataset: Dataset, runs: Runs, field: Field) -> list[Measured]:
    """Measure all rows of a data set: fieldcalib, the published methods, and methods that the paper does not have."""
    rows: list[Measured] = []
    published = [row for row in (*paper.ROWS, *paper.RELEASED) if row.dataset == dataset.name]
    for evaluated in TITLES:
        wanted: dict[tuple[str, paper.Segments, float | None], paper.Published | None] = {
            (method, segments, tau): None
            for (method, segments) in runs
            if method in (paper.OURS, paper.OURS_PINHOLE) and segments in ("GT", "pred")
            for tau in (paper.TAU, None)
        }
        wanted |= {(r.method, r.segments, r.tau): r for r in published if r.evaluated == evaluated}
        extra = [key for key in runs if evaluated == "homography" or key[0] not in ONLY_HOMOGRAPHIES]
        taus = {key: (paper.TAU, None) if runs[key].losses is not None else (None,) for key in extra}
        wanted |= {(*key, tau): None for key in extra for tau in taus[key] if (*key, tau) not in wanted}
        rows += [_measure(key, row, evaluated, dataset, runs, field) for key, row in wanted.items()]
    return rows


def _measure(
    key: tuple[str, paper.Segments, float | None],
    published: paper.Published | None,
    evaluated: paper.Evaluated,
    dataset: Dataset,
    runs: Runs,
    field: Field,
) -> Measured:
    method, segments, tau = key
    theirs = None
    if published is not None:
        row = published
        theirs = (row.ac5, row.ac10, row.ac20, row.cr, row.cs, *(row.iou_part or ()))
    run = runs.get((method, segments))
    if run is None:
        reason = _reason(method, segments, dataset)
        return Measured(dataset.name, evaluated, method, segments, tau, None, theirs, None, reason)
    predictions = run.at(tau)
    evaluation = evaluate_segments(
        predictions,
        list(dataset.annotations.values()),
        dataset.size,
        planar=evaluated == "homography",
        field=field,
    )
    cr, ac = evaluation.completeness, evaluation.accuracy
    values = [*ac, cr, compound_score(ac, cr, "tables", share=SHARES[dataset.name])]
    if evaluated == "homography" and paper.ANNOTATED in dataset.homographies:
        pairs = zip(predictions, dataset.homographies[paper.ANNOTATED], strict=True)
        ious = [iou_part(p, H, dataset.size, field=field) for p, H in pairs if p is not None and H is not None]
        values += [float(np.mean(ious)), float(np.median(ious))] if ious else []
    percent = tuple(100.0 * float(value) for value in values)
    return Measured(dataset.name, evaluated, method, segments, tau, percent, theirs, run.milliseconds, None)


def _reason(method: str, segments: paper.Segments, dataset: Dataset) -> str:
    """Reason why a row cannot be measured."""
    if method == paper.PNLCALIB:
        return "their solver is not part of this project; fieldcalib's row has the same input"
    if method.endswith(paper.LENS):
        return "the lens of TVCalib's own optimiser is not part of this project; fieldcalib's row has one"
    name = "--sncalib-pred" if dataset.name == "SN-Calib-test-center" else "--wc14-pred"
    for network, flag in ((paper.CHEN_WIDER, None), (paper.CHEN, "--chen"), (paper.JIANG, "--jiang")):
        if network in method:
            if segments == "-" and flag:
                return f"needs their homographies: {flag} DIR"
            if network in (paper.CHEN, paper.CHEN_WIDER) and segments == "GT":
                return "needs their database: --chen-database FILE"
            if network in (paper.CHEN, paper.CHEN_WIDER):
                return f"needs segments that a network found, and their database: {name} DIR --chen-database FILE"
            return "needs their network, run on these segments"
    if segments == "pred":
        return f"needs segments that a network found: {name} DIR"
    return "needs annotated homographies beside the annotations"


def dataset_statistics(dataset: Dataset) -> dict[str, Any]:
    """Count images, annotated segments and pixels, and types of cameras: a row of the paper's table of data sets."""
    width, height = dataset.size
    frames = list(dataset.annotations.values())
    segments = [len(frame) for frame in frames]
    record: dict[str, Any] = {
        "dataset": dataset.name,
        "images": len(frames),
        "size": f"{width}x{height}",
        "segments_per_image": float(np.mean(segments)),
        "pixels_per_segment": sum(len(xy) for frame in frames for xy in frame.values()) / max(sum(segments), 1),
        "camera_types_percent": None,
    }
    if dataset.types is not None:
        count = Counter(dataset.types.values())
        record["camera_types_percent"] = {name: 100.0 * n / len(dataset.types) for name, n in count.most_common()}
    return record


def as_record(row: Measured) -> dict[str, Any]:
    """Turn a row into a record for JSON, with null instead of NaN."""
    record = asdict(row)
    for name in ("values", "published"):
        values = record[name]
        record[name] = values and {
            column: value if np.isfinite(value) else None for column, value in zip(COLUMNS, values, strict=False)
        }
    return record


# --- printed tables ---


def as_text(statistics: Sequence[Mapping[str, Any]], rows: Sequence[Measured], steps: int, *, markdown: bool) -> str:
    """Format all tables, with aligned columns or in Markdown."""
    parts = [_heading("Data sets", markdown), _table(*_statistics_table(statistics), markdown=markdown)]
    for dataset in dict.fromkeys(row.dataset for row in rows):
        for evaluated, title in TITLES.items():
            width, height = SIZES[dataset]
            parts.append(_heading(f"{dataset}, {width}x{height}: {title}", markdown))
            parts.append(
                f"Measured, in brackets published; percent. TVCalib with {steps} steps (published: {tvcalib.STEPS}). "
                f"Segments: GT annotated, pred found by a network, PnLCalib points and lines that its networks found, "
                "images found by the method itself, - not used."
            )
            members = [row for row in rows if (row.dataset, row.evaluated) == (dataset, evaluated)]
            parts.append(_table(*_results_table(members), markdown=markdown))
            missing = [row for row in members if row.values is None]
            if missing:
                parts.append("Not measured:")
                parts.append("\n".join(f"- {_name(row)} ({row.segments}): {row.reason}" for row in missing))
    return "\n\n".join(parts)


def _heading(text: str, markdown: bool) -> str:
    return f"### {text}" if markdown else f"{text}\n{'=' * len(text)}"


def _statistics_table(statistics: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[str]]]:
    header = ["data set", "images", "size", "segments per image", "pixels per segment", "camera types"]
    rows = []
    for s in statistics:
        types = s["camera_types_percent"]
        named = "no match_info_cam_gt.json" if types is None else ", ".join(f"{k} {v:.1f} %" for k, v in types.items())
        means = [f"{s['segments_per_image']:.1f}", f"{s['pixels_per_segment']:.1f}"]
        rows.append([s["dataset"], str(s["images"]), s["size"], *means, named])
    for name, (images, resolution, shares) in paper.DATASETS.items():
        center, left, right, other = shares
        types = f"main center {center} %, left {left} %, right {right} %, other {other} %"
        rows.append([f"{name} (published)", str(images), resolution, "", "", types])
    return header, rows


def _results_table(rows: Sequence[Measured]) -> tuple[list[str], list[list[str]]]:
    columns = max(len(row.values or row.published or ()) for row in rows)
    header = ["method", "segments", *COLUMNS[:columns], "ms per frame"]
    body = []
    for row in rows:
        cells = [_cell(row.values, row.published, index) for index in range(columns)]
        milliseconds = "" if row.milliseconds is None else f"{row.milliseconds:.1f}"
        body.append([_name(row), row.segments, *cells, milliseconds])
    return header, body


def _cell(values: tuple[float, ...] | None, published: tuple[float, ...] | None, column: int) -> str:
    """Format the measured value and, in brackets, the published one."""
    parts = []
    for numbers, form in ((values, "{:.1f}"), (published, "({:.1f})")):
        if numbers is not None and column < len(numbers) and np.isfinite(numbers[column]):
            parts.append(form.format(numbers[column]))
    return " ".join(parts)


def _name(row: Measured) -> str:
    return row.method if row.tau is None else f"{row.method} (tau {row.tau:g})"


def _table(header: list[str], rows: list[list[str]], *, markdown: bool) -> str:
    widths = [max(len(cell) for cell in column) for column in zip(header, *rows, strict=True)]
    lines = [header, ["-" * width for width in widths], *rows]
    padded = [[cell.ljust(width) for cell, width in zip(line, widths, strict=True)] for line in lines]
    if markdown:
        return "\n".join(f"| {' | '.join(line)} |" for line in padded)
    return "\n".join("  ".join(line).rstrip() for line in padded)


if __name__ == "__main__":
    raise SystemExit(main())
