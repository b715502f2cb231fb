"""Detection of mislabelled segments: real annotations with labels replaced by the other side's or a neighbour's.

    python -m data_tools.wrong_labels ANNOTATIONS --size WxH [--wrong N] [--seed N]

Frames with seven segments or more that fit to 2 px (at 960x540) and have no suspect labels are taken as correctly
labelled. In each of them N labels are replaced at random (`data_tools.random_frames`). Printed as one line of JSON:

* recall: share of the replaced labels that are reported; precision: share of the reported ones that were replaced;
  named: share of the replaced and reported labels for which the correct one is given;
* the largest distance between the images of the labelled segments under the camera and under that of the correct
  labels: its median and 90 % quantile, and the share of frames below 3 px (at 960x540);
* how many of all frames, unchanged, have suspect labels.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from data_tools.annotated_frames import read_frames
from data_tools.random_frames import mislabelled
from fieldcalib.console.arguments import add_size
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.solver_options import pixel_unit

LEAST_SEGMENTS, WELL_FITTED = 7, 2.0  # labels, px at 960 x 540
SAME_CAMERA = 3.0  # px at 960 x 540


def image_distance(camera: Camera, other: Camera, field: Field, frame: Pixels) -> float:
    """Largest distance in pixels between the images of the points of a frame's segments under two cameras."""
    size = np.array(camera.image_size)
    farthest = 0.0
    for label in frame:
        X = field[label].sample()
        a, b = camera.project(X), other.project(X)
        inside = np.all((a >= 0.0) & (a < size), axis=1)  # false for NaN
        if np.any(inside):
            farthest = max(farthest, float(np.max(np.nan_to_num(np.linalg.norm(a - b, axis=1)[inside], nan=np.inf))))
    return farthest


def detection_rates(
    field: Field, frames: Sequence[Pixels], size: tuple[int, int], count: int, rng: np.random.Generator
) -> dict[str, object]:
    """The statistics of the module's docstring, for annotated frames with `count` wrong labels each."""
    unit = pixel_unit(size)
    clean = calibrate_batch(field, frames, size)
    certain = [
        (frame, calibration.camera)
        for frame, calibration in zip(frames, clean, strict=True)
        if len(frame) >= LEAST_SEGMENTS
        and calibration.accepted
        and not calibration.suspect_labels
        and calibration.rms < WELL_FITTED * unit
        and calibration.camera is not None
    ]
    if not certain:
        raise ValueError(f"none of {len(frames)} frames has {LEAST_SEGMENTS} segments that fit to {WELL_FITTED:g} px")
    changed = [mislabelled(frame, field, count, rng) for frame, _ in certain]
    found = calibrate_batch(field, [pixels for pixels, _ in changed], size)
    replaced = accused = hit = named = 0
    distances = []
    for (frame, right), (_, wrong), calibration in zip(certain, changed, found, strict=True):
        suspects = {suspect.label: suspect.fits for suspect in calibration.suspect_labels}
        replaced, accused = replaced + len(wrong), accused + len(suspects)
        hit += len(wrong.keys() & suspects.keys())
        named += sum(suspects.get(label) == true for label, true in wrong.items())
        distances.append(image_distance(right, calibration.camera, field, frame) if calibration.camera else np.inf)
    near, d = SAME_CAMERA * unit, np.array(distances)
    return {
        "frames": len(certain),
        "replaced": replaced,
        "recall": _percent(hit, replaced),
        "precision": _percent(hit, accused),
        "named": _percent(named, hit),
        "camera_px": np.quantile(d, (0.5, 0.9)).round(2).tolist(),
        "camera_same": _percent(int(np.sum(d < near)), len(d)),
        "accused_as_they_are": [sum(bool(c.suspect_labels) for c in clean), len(clean)],
    }


def _percent(part: int, whole: int) -> float:
    return round(100.0 * part / max(whole, 1), 1)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("annotations", type=Path, help="folder or zip of <id>.json")
    add_size(parser, "of the images", required=True)
    parser.add_argument("--wrong", type=int, choices=(1, 2, 3), default=1, help="labels replaced in each frame (1)")
    parser.add_argument("--seed", type=int, default=0)
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    field, rng = soccer(), np.random.default_rng(options.seed)
    frames = list(read_frames([options.annotations], field, options.size).values())
    print(json.dumps({"wrong": options.wrong, **detection_rates(field, frames, options.size, options.wrong, rng)}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
