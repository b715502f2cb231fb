"""Homographies of the ground from lines by the DLT, and the cameras that they are decomposed into.

The baseline "DLT lines" of TVCalib's paper: only lines on the ground are used, each as the
line fitted to its pixels; circles, posts and crossbars are left out.

    python -m baselines.dlt_lines INPUT --size 960x540 --out DIR

writes what `fieldcalib calibrate` writes, and for every frame that has a homography ``<id>.homographyMatrix``, in the
format of WC14: from pixels of the image at 1280x720 to the field in yards.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import (
    add_input_and_output,
    add_run_options,
    add_sized_field,
    annotation_reader,
    field_of,
    run_options,
)
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.geometry.homography import SINGULAR
from fieldcalib.io.formats import HOMOGRAPHIES
from fieldcalib.io.wc14 import AlignmentName
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.problem.observations import pack
from fieldcalib.run_folder.labelled_frames import CalibratedFrame, calibrate_folder
from fieldcalib.solve.from_homography import NO_FOCAL_LENGTH, closed_form, judged_camera
from fieldcalib.solve.initial_cameras import ground_homographies


def homographies(field: Field, frames: Sequence[Pixels], image_size: tuple[int, int]) -> list[Array | None]:
    """Homographies of the ground from the labelled lines of T frames.

    Parameters
    ----------
    field : Field
        The field.
    frames : sequence of T dicts of str to (N, 2) array
        Pixels by label, as `check_segments` returns them.
    image_size : (int, int)
        Width and height in pixels.

    Returns
    -------
    list of T (3, 3) arrays or None
        Each maps field points (x, y, 1) in metres to pixels, up to scale and sign. Four or more lines on the ground
        determine it; None where there are fewer.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> camera = Camera.from_angles(-0.4, 1.35, 0.0, 1200.0, (0.0, 65.0, -15.0), (960, 540))
    >>> labels = ("Side line top", "Side line left", "Big rect. left main", "Big rect. left top")
    >>> frame = {label: camera.project(soccer()[label].sample(9.0)) for label in labels}
    >>> H, none = homographies(soccer(), [frame, {}], (960, 540))
    >>> bool(np.allclose(H / H[2, 2], camera.homography / camera.homography[2, 2])), none
    (True, None)
    """
    if not len(frames):
        return []
    H, found = ground_homographies(pack(field, frames, image_size), np.array(image_size) / 2.0)
    # if all lines but one meet in a point, H is not determined and the DLT gives a singular matrix
    found[found] = np.linalg.cond(H[found]) < SINGULAR
    return [H[t] if found[t] else None for t in range(len(H))]


def calibrate(
    homographies: Sequence[Array | None], field: Field, frames: Sequence[Pixels], image_size: tuple[int, int]
) -> list[Calibration]:
    """Decompose each frame's homography in closed form, without refinement.

    These are steps (1) to (3) of the paper's appendix "Homography Decomposition".

    Parameters
    ----------
    homographies : sequence of (3, 3) arrays or None
        As `homographies` finds them; None for a frame without one.
    field, frames, image_size
        As in `homographies`.

    Returns
    -------
    list of Calibration
        Without a camera where there is no homography, or where it has no real focal length.
    """
    calibrations = []
    for frame, H in zip(frames, homographies, strict=True):
        if H is None:
            message = "a homography needs four lines on the ground, no three of them through one point"
            calibrations.append(Calibration.without_camera(Status.TOO_FEW_SEGMENTS, message))
            continue
        camera = closed_form(H, image_size)
        if camera is None:
            calibrations.append(Calibration.without_camera(Status.IMPLAUSIBLE, NO_FOCAL_LENGTH))
            continue
        calibrations.append(judged_camera(camera, field, frame, "closed form, not refined"))
    return calibrations


def homography_file(
    id: str, H: Array | None, image_size: tuple[int, int], alignment: AlignmentName = "wc14"
) -> dict[str, bytes]:
    """Content of a frame's ``<id>.homographyMatrix`` by its name; empty if it has no homography."""
    if H is None:
        return {}
    return {HOMOGRAPHIES.file_name(id): HOMOGRAPHIES.write(H, alignment, image_size=image_size).encode()}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m baselines.dlt_lines", description=__doc__.splitlines()[0])
    add_input_and_output(parser)
    add_sized_field(parser)
    add_run_options(parser)
    parser.set_defaults(run=_run, command="baselines.dlt_lines")
    return run_command(parser.parse_args(arguments))


def _run(options: argparse.Namespace) -> int:
    field = field_of(options)
    writes = [HOMOGRAPHIES.file_name("<id>")]
    reader = annotation_reader(options, field)
    return calibrate_folder(run_options(options), options.input, reader, _Method(field), writes=writes)


@dataclass(frozen=True)
class _Method:
    """Calibrates annotated frames."""

    field: Field

    def __call__(self, frames: dict[str, Pixels], size: tuple[int, int]) -> list[CalibratedFrame]:
        members = list(frames.values())
        by_lines = homographies(self.field, members, size)
        calibrations = calibrate(by_lines, self.field, members, size)
        return [
            CalibratedFrame(calibration, files=homography_file(id, H, size))
            for id, calibration, H in zip(frames, calibrations, by_lines, strict=True)
        ]


if __name__ == "__main__":
    from baselines.dlt_lines import main as main_of_module  # other processes find its classes there

    raise SystemExit(main_of_module())
