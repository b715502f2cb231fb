"""`fieldcalib calibrate`: annotated frames to cameras."""

from __future__ import annotations

import argparse
from dataclasses import replace

from fieldcalib.calibrate import calibrate_batch
from fieldcalib.commands.arguments import add_field_size, add_input_and_output, positive, probability
from fieldcalib.commands.folder import by_prior, calibrate_folder
from fieldcalib.field import soccer
from fieldcalib.io.soccernet import CAMERA_TYPES, DISTRIBUTIONS_OF_TYPE, read_camera_types
from fieldcalib.options import ALL, DEFAULT_FLAGS, PINHOLE_FLAGS, CalibrationFlags, Prior
from fieldcalib.parameters import DISTRIBUTIONS
from fieldcalib.result import Calibration, Status
from fieldcalib.segments import Pixels

LENSES = {
    "none": PINHOLE_FLAGS,
    "k1": DEFAULT_FLAGS,
    "k1k2": DEFAULT_FLAGS & ~CalibrationFlags.CALIB_FIX_K2,
}
STACKED = "stacked"  # the paper's name for the case that the kind of camera is known frame by frame


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = commands.add_parser(
        "calibrate",
        help="calibrate annotated frames",
        description="Calibrate frames from SoccerNet annotations (<id>.json: label -> normalised points). Writes "
        "camera_<id>.json in SoccerNet's format, cameras.jsonl with one line a frame, and summary.json.",
    )
    add_input_and_output(parser)
    add_field_size(parser)
    parser.add_argument(
        "--prior",
        default=ALL,
        choices=[ALL, *DISTRIBUTIONS, STACKED, "none"],
        metavar="NAME",
        help=f"where the camera stands: {', '.join([ALL, *DISTRIBUTIONS])}; {STACKED}: as {CAMERA_TYPES} in INPUT says "
        f"of each frame; none: solve without a prior (all)",
    )
    parser.add_argument(
        "--tau", type=positive, metavar="T", help="reject frames whose NDC loss is above; the paper's is 0.019 (off)"
    )
    parser.add_argument(
        "--least-probability",
        type=probability,
        metavar="P",
        help="reject cameras that are less probably right to 1 m everywhere in view (off)",
    )
    parser.add_argument("--lens", choices=LENSES, default="k1", help="radial lens: none, one or two coefficients (k1)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Calibrate; returns the exit code."""
    field = soccer(options.field_length, options.field_width)
    types = read_camera_types(options.input) if options.prior == STACKED else {}

    def prior_of(id: str) -> Prior:
        if options.prior == STACKED:
            return DISTRIBUTIONS_OF_TYPE.get(types.get(id, ""), ALL)
        return None if options.prior == "none" else str(options.prior)

    def calibrate_part(frames: list[Pixels], prior: Prior) -> list[Calibration]:
        flags = LENSES[options.lens]
        found = calibrate_batch(field, frames, options.size, flags=flags, prior=prior, tau=options.tau)
        return found if options.least_probability is None else [_doubted(c, options.least_probability) for c in found]

    def method(frames: dict[str, Pixels]) -> list[Calibration]:
        return by_prior(frames, prior_of, calibrate_part)

    return calibrate_folder(options, field, method)


def _doubted(calibration: Calibration, least: float) -> Calibration:
    """The calibration, with the verdict that it is probably wrong where it is."""
    if calibration.solved is None or calibration.status is Status.REJECTED or calibration.probability() >= least:
        return calibration
    message = f"right to 1 m with a probability of {calibration.probability():.2f}, below {least:g}"
    return replace(calibration, status=Status.IMPROBABLE, message=f"{message}; {calibration.message}")
