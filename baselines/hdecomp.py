"""Homography decomposition: the baseline "HDecomp" of TVCalib's paper, for homographies of any origin.

    python -m baselines.hdecomp INPUT --size 960x540 --out DIR
    python -m baselines.hdecomp INPUT --homographies --size 1280x720 --out DIR

The first decomposes the homographies that `baselines.dlt_lines` finds in the annotations of INPUT, the second those of
INPUT's files ``<id>.homographyMatrix``. Both write what `fieldcalib calibrate` writes.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import get_args

from baselines import dlt_lines
from fieldcalib._types import Array
from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import (
    add_input_and_output,
    add_run_options,
    add_sized_field,
    annotation_reader,
    field_of,
    positive,
    run_options,
)
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.io.files import FrameFile
from fieldcalib.io.formats import HOMOGRAPHIES
from fieldcalib.io.wc14 import AlignmentName
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.run_folder.labelled_frames import (
    CalibratedFrame,
    FromFiles,
    calibrate_files,
    calibrate_folder,
    name_skipped,
)
from fieldcalib.run_folder.work_units import unit_size
from fieldcalib.solve.from_homography import camera_from_homography, judged_camera, judged_decomposition


def calibrate(
    homographies: Sequence[Array | None], image_size: tuple[int, int], *, zeta: float = 100.0, tolerance: float = 0.1
) -> list[Calibration]:
    """Decompose homographies into cameras as the paper does; rejected ones have no camera.

    Parameters
    ----------
    homographies : sequence of (3, 3) arrays or None
        Each maps field points (x, y, 1) in metres to pixels; None where there is none.
    image_size : (int, int)
        Width and height in pixels.
    zeta, tolerance : float
        As in `camera_from_homography`.

    Returns
    -------
    list of Calibration
        In the order of `homographies`.

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> truth = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540))
    >>> [str(calibration.status) for calibration in calibrate([truth.homography, None], (960, 540))]
    ['accepted', 'too few segments']
    """
    calibrations = []
    for H in homographies:
        if H is None:
            calibrations.append(Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "there is no homography"))
            continue
        decomposition = camera_from_homography(H, image_size, zeta=zeta, tolerance=tolerance)
        calibration = judged_decomposition(decomposition)
        calibrations.append(calibration if decomposition.camera else replace(calibration, camera=None))
    return calibrations


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m baselines.hdecomp", description=__doc__.splitlines()[0])
    add_input_and_output(parser)
    add_sized_field(parser)
    parser.add_argument("--homographies", action="store_true", help="decompose INPUT's <id>.homographyMatrix files")
    parser.add_argument(
        "--alignment",
        choices=get_args(AlignmentName),
        default="wc14",
        help="whose axes those files have (wc14: pixels to yards)",
    )
    parser.add_argument(
        "--zeta", type=positive, default=100.0, metavar="PX", help="largest distance of a field point that counts (100)"
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=0.1,
        metavar="SHARE",
        help="how far outside the image field points count, in widths and heights (0.1)",
    )
    add_run_options(parser)
    parser.set_defaults(run=_run, command="baselines.hdecomp")
    return run_command(parser.parse_args(arguments))


def _run(options: argparse.Namespace) -> int:
    run = run_options(options)
    if options.homographies:
        if options.size is None:
            raise ValueError("--homographies needs --size: those files do not say how large the images are")
        files = HOMOGRAPHIES.find(options.input)
        name_skipped(options.input, files)
        read = partial(_of_file, size=options.size, alignment=options.alignment, most_bytes=options.most_bytes)
        method = partial(_of_homographies, zeta=options.zeta, tolerance=options.tolerance)
        return calibrate_files(run, files, FromFiles(read, method), unit_size(len(files)))
    if options.alignment != "wc14":
        raise ValueError("--alignment is about homography files: it needs --homographies")
    field = field_of(options)
    method_of_lines = _Method(field, options.zeta, options.tolerance)
    return calibrate_folder(run, options.input, annotation_reader(options, field), method_of_lines)


@dataclass(frozen=True)
class _Method:
    """Calibrates annotated frames."""

    field: Field
    zeta: float
    tolerance: float

    def __call__(self, frames: dict[str, Pixels], size: tuple[int, int]) -> list[CalibratedFrame]:
        by_lines = dlt_lines.homographies(self.field, list(frames.values()), size)
        calibrations = calibrate(by_lines, size, zeta=self.zeta, tolerance=self.tolerance)
        return [  # judged by the annotated pixels, which do not come from the homography
            CalibratedFrame(judged_camera(c.camera, self.field, frame, c.message) if c.camera else c)
            for c, frame in zip(calibrations, frames.values(), strict=True)
        ]


def _of_file(
    file: FrameFile, size: tuple[int, int], alignment: AlignmentName, most_bytes: float
) -> tuple[Array, tuple[int, int]]:
    return HOMOGRAPHIES.read(file.read(most_bytes), alignment, image_size=size), size


def _of_homographies(
    homographies: dict[str, Array], size: tuple[int, int], zeta: float, tolerance: float
) -> list[CalibratedFrame]:
    return list(map(CalibratedFrame, calibrate(list(homographies.values()), size, zeta=zeta, tolerance=tolerance)))


if __name__ == "__main__":
    from baselines.hdecomp import main as main_of_module  # other processes find its classes there

    raise SystemExit(main_of_module())
