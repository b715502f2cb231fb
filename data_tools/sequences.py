"""Cameras of frames of one tripod, calibrated together and one by one, against true ones.

    python -m data_tools.sequences CAMERAS [--count N]

CAMERAS holds ``<name>.npz`` as for `data_tools.measured_cameras`. For each, N of 300 frames of a synthetic clip with
its zoom and lens are calibrated (`data_tools.synthetic.clips`). Printed are, in the median over frames and clips, the
errors of focal length (percent) and centre (metres), together and one by one; the mean error of the pitch's size
(metres); and how often the 95 % regions contain the truth (percent).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from data_tools.measured_cameras import SIZE, camera_files, errors
from data_tools.synthetic.clips import camera_path, labelled
from fieldcalib.assess.result import Calibration
from fieldcalib.calibrate.from_segments import calibrate_batch
from fieldcalib.calibrate.sequence import calibrate_sequence
from fieldcalib.cli.arguments import count, positive
from fieldcalib.cli.main import run_command
from fieldcalib.fields.soccer import soccer
from fieldcalib.fields.traits import DEVIATIONS
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.layout import LOG_F

FRAMES = 300  # of a clip


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line of JSON for each way."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cameras", type=Path, help="folder of <name>.npz")
    parser.add_argument("--count", type=count, default=20, help="frames of a clip that are calibrated (20)")
    parser.add_argument("--noise", type=positive, default=1.0, help="pixels (1)")
    parser.add_argument("--seed", type=int, default=0)
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    files = camera_files(options.cameras)
    field = soccer()
    together: list[tuple[Calibration, Camera]] = []
    alone: list[tuple[Calibration, Camera]] = []
    sizes, place = [], []
    for number, path in enumerate(files):
        rng = np.random.default_rng(options.seed + number)
        cameras = camera_path(rng, FRAMES, path)[:: max(FRAMES // options.count, 1)][: options.count]
        frames = [frame.pixels for frame in labelled(cameras, field, rng, options.noise)]
        found = calibrate_sequence(field, frames, SIZE)
        together += [pair for pair in zip(found, cameras, strict=True) if pair[0].camera is not None]
        single = calibrate_batch(soccer(size_known=True), frames, SIZE)
        alone += [pair for pair in zip(single, cameras, strict=True) if pair[0].camera is not None]
        if found.names:
            sizes.append([found.shared["length"][0] - field.length, found.shared["width"][0] - field.width])
            sigma = np.sqrt(np.diagonal(found.covariance)[:3])
            place.append(np.abs(found.values[:3] - cameras[0].C) < DEVIATIONS * sigma)
    for name, pairs in (("together", together), ("one by one", alone)):
        f, C = np.median([errors(*pair) for pair in pairs], axis=0)
        print(
            json.dumps(
                {"frames": name, "count": len(pairs), "focal_length_percent": round(f, 2), "centre_m": round(C, 2)}
            )
        )
    held = [_holds_focal_length(*pair) for pair in together]
    regions = {
        "focal_length": round(100.0 * float(np.mean(held)), 1),
        "centre": round(100.0 * float(np.mean(place)), 1),
    }
    size = np.mean(np.abs(sizes), axis=0).round(2).tolist()
    print(json.dumps({"size_m": size, "95_percent_regions_hold": regions}))
    return 0


def _holds_focal_length(found: Calibration, truth: Camera) -> bool:
    sigma = np.sqrt(found.covariance[LOG_F, LOG_F])
    camera = found.uncertainty.camera
    return bool(abs(np.log(camera.focal_length / truth.focal_length)) < DEVIATIONS * sigma)


if __name__ == "__main__":
    raise SystemExit(main())
