"""Comparison of measured cameras with those calibrated from their field markings.

    python -m data_tools.measured_cameras CAMERAS

CAMERAS holds ``<name>.npz`` with K (N, 3, 3), k (N, 5) = k1, k2, 0, 0, 0, R (1, 3, 3) and t (1, 3): cameras of images
of 1920x1080 whose world has y away from the camera and z up. Each projects the markings in view, three points per line
and nine per circle, with noise; the pixels are calibrated with each lens model, with and without a free principal
point. Printed are the median and the 90 % quantile of the errors of focal length (percent) and position (metres), and
how often the 95 % regions of focal length, position and points of the ground in view contain the truth (percent).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from data_tools.simulated import observe
from data_tools.synthetic.paths import SIZE, MeasuredZoom
from fieldcalib._types import Array
from fieldcalib.assess.estimate import CENTRE_MARK
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import count, positive
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground import LEVEL
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import FisheyeLens
from fieldcalib.problem.layout import CENTER, LOG_F
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.solver_options import LENS_FLAGS, CalibrationFlags

FROM_Z_UP = np.diag([1.0, -1.0, -1.0])  # axes of the files' world in ours; its own inverse
FIXED_POINT = CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT
LENSES = {name: flags for name, flags in LENS_FLAGS.items() if name != FisheyeLens.name}  # none of them is a fisheye
MODELS = {**LENSES, **{f"{lens}, centred": flags | FIXED_POINT for lens, flags in LENSES.items()}}
GRID = 12  # ground points along the image's width and height at which regions are tested


def camera_files(folder: Path) -> list[Path]:
    """The files of measured cameras in a folder, in the order of their names."""
    files = sorted(folder.glob("*.npz"))
    if not files:
        raise FileNotFoundError(f"{folder} holds no <name>.npz")
    return files


def read_camera(path: Path) -> Camera:
    """The camera of the first frame of a file."""
    with np.load(path) as arrays:
        R = arrays["R"][0] @ FROM_Z_UP
        return Camera(arrays["K"][0], R, -R.T @ arrays["t"][0], SIZE, arrays["k"][0][:2])


def read_zoom(path: Path) -> MeasuredZoom:
    """The zoom of all frames of a file."""
    with np.load(path) as arrays:
        return MeasuredZoom(arrays["K"], arrays["k"][:, :2], read_camera(path).C)


def with_simulated_pixels(
    truths: Sequence[Camera], field: Field, noise: float, repeats: int, seed: int = 0
) -> list[tuple[Camera, dict[str, Array]]]:
    """Each camera with its pixels of the field's markings, `repeats` times with different noise."""
    rng = np.random.default_rng(seed)
    return [(truth, observe(truth, field, rng, noise, (3, 3))) for _ in range(repeats) for truth in truths]


def errors(found: Calibration, truth: Camera) -> tuple[float, float]:
    """Errors of the focal length, percent, and of the position, metres."""
    camera = found.uncertainty.camera
    return (
        100.0 * abs(camera.focal_length / truth.focal_length - 1.0),
        float(np.linalg.norm(camera.C - truth.C)),
    )


def held(found: Calibration, truth: Camera, field: Field) -> tuple[float, float, float]:
    """Share of 95 % regions that contain the true focal length, coordinates of the position, and ground points."""
    uncertainty = found.uncertainty
    index = [LOG_F, *range(CENTER.start, CENTER.stop)]
    off = np.abs(uncertainty.layout.theta(truth) - uncertainty.theta)[index]
    inside = off <= uncertainty.radius() * np.sqrt(np.diagonal(uncertainty.covariance)[index])
    xy = np.stack(np.meshgrid(*(np.linspace(0.0, side - 1.0, GRID) for side in SIZE)), axis=-1).reshape(-1, 2)
    X = truth.image_to_field(xy)
    seen = np.all(np.abs(X[:, :2]) <= (field.length / 2.0, field.width / 2.0), axis=1)  # false for NaN
    off_ground = (uncertainty.camera.image_to_field(xy[seen]) - X[seen])[:, :2]
    precision = np.linalg.inv(uncertainty.at_image(xy[seen], relative_to=CENTRE_MARK).covariance)
    distance = np.sqrt(np.einsum("ni,nij,nj->n", off_ground, precision, off_ground))
    return float(inside[0]), float(np.mean(inside[1:])), float(np.mean(distance <= uncertainty.radius(2)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line of JSON for each model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cameras", type=Path, help="folder of <name>.npz")
    parser.add_argument("--noise", type=positive, default=1.0, help="pixels (1)")
    parser.add_argument("--repeats", type=count, default=20, help="draws of the noise (20)")
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    files = camera_files(options.cameras)
    field = soccer(size_known=True).with_ground(LEVEL)  # the field of the synthetic pixels
    pairs = with_simulated_pixels([read_camera(path) for path in files], field, options.noise, options.repeats)
    for model, flags in MODELS.items():
        found = calibrate_batch(field, [frame for _, frame in pairs], SIZE, flags=flags)
        both = [(calibration, truth) for calibration, (truth, _) in zip(found, pairs, strict=True)]
        f, C = np.quantile([errors(*pair) for pair in both], (0.5, 0.9), axis=0).T.round(2).tolist()
        regions = 100.0 * np.mean([held(*pair, field) for pair in both], axis=0)
        shares = dict(zip(("focal_length", "position", "ground"), regions.round(1).tolist(), strict=True))
        result = {"model": model, "frames": len(both), "focal_length_percent": f, "position_m": C}
        print(json.dumps({**result, "95_percent_regions_hold": shares}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
