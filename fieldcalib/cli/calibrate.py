"""`fieldcalib calibrate`: annotated frames to cameras."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from fieldcalib.assess.result import Calibration, doubted, in_picture
from fieldcalib.cli.camera_options import KnownCamera
from fieldcalib.console.arguments import (
    add_camera,
    add_field,
    add_input_and_output,
    add_run_options,
    annotation_reader,
    field_of,
    positive,
    prior_of,
    probability,
    run_options,
)
from fieldcalib.console.options import add_options, given, option
from fieldcalib.fields.field import Field
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.soccernet import CAMERA_TYPES, DISTRIBUTIONS_OF_TYPE, read_camera_types
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.problem.picture_shape import Declared, Placement
from fieldcalib.run_folder.labelled_frames import CalibratedFrame, calibrate_folder
from fieldcalib.run_folder.record import ESTIMATED
from fieldcalib.run_folder.work_units import in_groups
from fieldcalib.solve.batch import calibrate_labels, compute_errors
from fieldcalib.solve.field_size import FieldSize, estimate_field_size
from fieldcalib.solve.likelier_shape import with_border_complaint, with_likely_aspect
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import ALL, Prior

STACKED = "stacked"  # the paper's name for the case that the kind of camera is known frame by frame
EACH, SHARED = "each", "shared"
SEE_ONE_PITCH = {EACH: 1, SHARED: sys.maxsize}  # frames that are worked on at once


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Calibrate frames from annotations of SoccerNet (<id>.json: label -> normalised points), CVAT, labelme, Label "
        "Studio or COCO. Writes cameras.jsonl with one line a frame, and summary.json."
    )
    add_input_and_output(parser)
    add_field(parser)
    add_camera(parser, **{STACKED: f"as {CAMERA_TYPES} in INPUT says of each frame"})
    add_options(parser, KnownCamera)
    add_options(parser, _Method)
    add_run_options(parser)


def run(options: argparse.Namespace) -> int:
    """Calibrate; returns the exit code."""
    if all(IMAGES.recognises(path) or VIDEOS.recognises(path) for path in options.input):
        raise ValueError(f"{options.input[0]} has no labels: fieldcalib run finds cameras in pictures and videos")
    free = _free_field_size(options)
    known = given(KnownCamera, options)
    if options.size is not None:
        try:
            known.check(known.placement(options.size).frame_size)
        except BrokenFileError as error:
            raise ValueError(f"--size {error}") from None
    if free is not None and not known.given.is_empty:
        raise ValueError(
            f"--field-size {ESTIMATED} finds the pitch with cameras of which nothing is known: leave it out"
        )
    field = field_of(options)
    types = read_camera_types(options.input) if options.prior == STACKED else None
    prior = prior_of(options) if types is None else None
    method = _Method(field, prior, types, known, free, options.tau, options.least_probability)
    reader = annotation_reader(options, field)
    at_once = SEE_ONE_PITCH.get(free or "")
    return calibrate_folder(run_options(options), options.input, reader, method, at_once=at_once, more=types or {})


def _free_field_size(options: argparse.Namespace) -> str | None:
    """Check the options of the field's size: the frames that share one estimated size, or None if none is estimated."""
    if options.field_size != ESTIMATED:
        if options.same_field:
            raise ValueError(
                f"--same-field says what the size is estimated from: give --field-size {ESTIMATED} with it"
            )
        return None
    free = SHARED if options.same_field else EACH
    if free == SHARED and options.prior == STACKED:
        raise ValueError(f"--prior {STACKED} has a prior for each frame, and --same-field one for all: leave one out")
    if free == SHARED and options.shard is not None:
        raise ValueError("--same-field is of all frames together: leave --shard out")
    return free


@dataclass(frozen=True)
class _Method:
    """Calibrates labelled pixels of pictures."""

    field: Field
    prior: Prior
    types: Mapping[str, str] | None
    """Types of the frames' cameras, where these determine the prior."""
    known: KnownCamera
    free_field_size: str | None
    tau: float | None = option(
        "reject frames whose NDC loss is above; the paper's is 0.019 (off)", type=positive, metavar="T"
    )
    least_probability: float | None = option(
        "reject cameras that are less probably right to 1 m everywhere in view, on courts to less (off)",
        type=probability,
        metavar="P",
    )

    def __call__(self, pictures: dict[str, Pixels], size: tuple[int, int]) -> list[CalibratedFrame]:
        placement = self.known.placement(size)
        frames = {id: {label: placement.to_frame(xy) for label, xy in one.items()} for id, one in pictures.items()}
        if self.free_field_size is not None:
            return self._on_free_field(pictures, frames, placement)

        def of_prior(prior: Prior, ids: Sequence[str]) -> list[Calibration]:
            task = Task(self.field, self.known.given, self.known.flags(prior), prior=prior, tau=self.tau)
            some, method = [frames[id] for id in ids], partial(calibrate_labels, task)
            is_estimated = self.known.is_aspect_estimated
            return with_likely_aspect(self.field, method, some, placement.frame_size, estimated=is_estimated)

        found = in_groups(list(frames), self._prior_of, of_prior)
        if self.least_probability is not None:
            compute_errors(found)
        return [
            CalibratedFrame(self._in_picture(one, placement, labels))
            for one, labels in zip(found, pictures.values(), strict=True)
        ]

    def _prior_of(self, id: str) -> Prior:
        return self.prior if self.types is None else DISTRIBUTIONS_OF_TYPE.get(self.types.get(id, ""), ALL)

    def _on_free_field(
        self, pictures: dict[str, Pixels], frames: dict[str, Pixels], placement: Placement
    ) -> list[CalibratedFrame]:
        (prior,) = {self._prior_of(id) for id in frames}
        size = placement.frame_size
        found = estimate_field_size(
            self.field, list(frames.values()), size, prior=prior, flags=self.known.flags(prior), tau=self.tau
        )
        message = str(found) if self.free_field_size == SHARED else ""
        details = _size_record(found)
        return [
            CalibratedFrame(self._in_picture(one, placement, labels), details, message=message if index == 0 else "")
            for index, (one, labels) in enumerate(zip(found.calibrations, pictures.values(), strict=True))
        ]

    def _in_picture(self, calibration: Calibration, placement: Placement, labels: Pixels) -> Calibration:
        if self.known.declared is not Declared.NOTHING:
            calibration = replace(calibration, declared=self.known.declared)
        if self.known.crop_of is not None:  # labels of a part stop short of the whole frame
            calibration = replace(calibration, are_annotated=False)
        if self.least_probability is not None:
            calibration = doubted(calibration, self.least_probability)
        return with_border_complaint(self.field, labels, in_picture(calibration, placement))


def _size_record(found: FieldSize) -> dict[str, Any]:
    """The estimated size in the lines of cameras.jsonl."""
    return {
        "field_length": found.length,
        "field_width": found.width,
        "field_standard_deviations": found.std_deviations.tolist(),
        "field_from_labels": found.from_labels.tolist(),
    }
