"""`fieldcalib calibrate`: annotated frames to cameras."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any

from fieldcalib.assess.result import Calibration
from fieldcalib.calibrate.field_size import FieldSize, estimate_field_size
from fieldcalib.calibrate.from_segments import calibrate_batch
from fieldcalib.calibrate.options import ALL, Prior
from fieldcalib.cli.arguments import (
    KNOWN,
    LENSES,
    add_camera,
    add_field,
    add_input_and_output,
    field_of,
    positive,
    prior_of,
    probability,
)
from fieldcalib.cli.declared import Placement, add_declarations
from fieldcalib.cli.folder import FRAMES_AT_ONCE, by_prior, calibrate_folder
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.soccernet import CAMERA_TYPES, DISTRIBUTIONS_OF_TYPE, read_camera_types
from fieldcalib.problem.labelled_pixels import Pixels

STACKED = "stacked"  # the paper's name for the case that the kind of camera is known frame by frame
SHARED = "shared"
SEE_ONE_PITCH = {"each": 1, SHARED: sys.maxsize}  # frames at once


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command, add its arguments and set ``run``, a function of them that gives the exit code."""
    parser.description = (
        "Calibrate frames from SoccerNet annotations (<id>.json: label -> normalised points). Writes "
        "camera_<id>.json in SoccerNet's format, cameras.jsonl with one line a frame, and summary.json."
    )
    add_input_and_output(parser)
    add_declarations(parser)
    add_field(parser)
    parser.add_argument(
        "--free-field-size",
        choices=SEE_ONE_PITCH,
        help="estimate length and width too, near --field-length and --field-width; each: frame by frame; shared: of "
        "the one pitch that all frames show (off)",
    )
    add_camera(parser, **{STACKED: f"as {CAMERA_TYPES} in INPUT says of each frame"})
    parser.add_argument(
        "--tau", type=positive, metavar="T", help="reject frames whose NDC loss is above; the paper's is 0.019 (off)"
    )
    parser.add_argument(
        "--least-probability",
        type=probability,
        metavar="P",
        help="reject cameras that are less probably right to 1 m everywhere in view (off)",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Calibrate; returns the exit code."""
    if options.free_field_size == SHARED and options.prior == STACKED:
        raise ValueError(f"--prior {STACKED} goes with --free-field-size each: {SHARED} has one prior for all frames")
    if options.free_field_size is not None and options.field_size == KNOWN:
        raise ValueError(f"--field-size {KNOWN} leaves nothing to --free-field-size: give one of them")
    try:
        placement = Placement.declared(options, options.size)
    except BrokenFileError as error:
        raise ValueError(f"--size {error}") from None
    field = field_of(options)
    types = read_camera_types(options.input) if options.prior == STACKED else {}

    def prior_of_frame(id: str) -> Prior:
        if options.prior == STACKED:
            return DISTRIBUTIONS_OF_TYPE.get(types.get(id, ""), ALL)
        return prior_of(options)

    how = {"flags": LENSES[options.lens], "tau": options.tau}
    details: dict[str, dict[str, Any]] = {}

    def calibrate_part(frames: list[Pixels], prior: Prior) -> list[Calibration]:
        return calibrate_batch(field, frames, placement.frame_size, prior=prior, **how)

    def on_free_field(frames: dict[str, Pixels]) -> Sequence[Calibration]:
        (prior,) = {prior_of_frame(id) for id in frames}
        found = estimate_field_size(field, list(frames.values()), placement.frame_size, prior=prior, **how)
        details.update(dict.fromkeys(frames, _of_field_size(found)))
        if options.free_field_size == SHARED:
            print(found)
        return found.calibrations

    def method(pictures: dict[str, Pixels]) -> Sequence[Calibration]:
        frames = {id: placement.to_frame(pixels) for id, pixels in pictures.items()}
        free = options.free_field_size is not None
        found = on_free_field(frames) if free else by_prior(frames, prior_of_frame, calibrate_part)
        if options.least_probability is not None:
            found = [calibration.doubted(options.least_probability) for calibration in found]
        return [placement.from_frame(calibration) for calibration in found]

    at_once = SEE_ONE_PITCH.get(options.free_field_size, FRAMES_AT_ONCE)
    return calibrate_folder(options, field, method, at_once=at_once, details=details)


def _of_field_size(found: FieldSize) -> dict[str, Any]:
    """What the lines of frames say about their pitch."""
    return {
        "field_length": found.length,
        "field_width": found.width,
        "field_standard_deviations": found.std_deviations.tolist(),
        "field_from_labels": found.from_labels.tolist(),
    }
