"""Leave-one-out validation: leave one segment out, calibrate on the rest, measure the distance to it.

    python -m data_tools.leave_one_out ANNOTATIONS --size 960x540 [--free-field-size]

Every annotated segment of every frame is left out once, from frames that keep at least `--least` segments. The median
and the 90 % quantile of its root mean square distance in pixels are printed for each lens model. The pitch has 105 x
68 m, or with `--free-field-size` the size estimated from the other segments of the frame.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from data_tools.annotated_frames import read_frames
from fieldcalib._types import Array
from fieldcalib.console.arguments import add_size
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.field_size import estimate_field_size
from fieldcalib.solve.from_homography import judged_camera
from fieldcalib.solve.solver_options import LENS_FLAGS

LEAST = 5  # segments that remain for the calibration


def left_out_errors(
    field: Field,
    frames: Sequence[Pixels],
    size: tuple[int, int],
    *,
    lens: str = "k1",
    least: int = LEAST,
    free_field_size: bool = False,
) -> Array:
    """Root mean square distances of segments from their projections by the camera of the others in their frame, pixels.

    Parameters
    ----------
    field : Field
    frames : sequence of dicts of str to (N, 2) array
        Pixels by label, as `check_segments` returns them.
    size : (int, int)
        Width and height in pixels.
    lens : {"none", "k1", "k1k2"}
        Which lens is estimated.
    least : int
        Smallest number of segments that remain.
    free_field_size : bool
        Whether length and width of the field are estimated too, in each frame from the remaining segments.

    Returns
    -------
    (n,) array
        One distance for each segment that was left out, frame by frame.
    """
    parts = [(frame, label) for frame in frames if len(frame) > least for label in frame]
    if not parts:
        return np.zeros(0)
    rest = [{other: xy for other, xy in frame.items() if other != label} for frame, label in parts]
    flags = LENS_FLAGS[lens]
    if free_field_size:
        found = [estimate_field_size(field, [frame], size, flags=flags).calibrations[0] for frame in rest]
    else:
        found = calibrate_batch(field, rest, size, flags=flags)
    errors = []
    for calibration, (frame, label) in zip(found, parts, strict=True):
        assert calibration.camera is not None  # with labels there always is one, accepted or not
        assert calibration.field is not None
        alone = {label: frame[label]}
        errors.append(judged_camera(calibration.camera, calibration.field, alone, "").rms)
    return np.array(errors)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line of JSON for each lens model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("annotations", type=Path, help="folder or zip of <id>.json")
    add_size(parser, "of the images, e.g. 960x540", required=True)
    parser.add_argument("--free-field-size", action="store_true", help="estimate length and width of the pitch too")
    parser.add_argument("--least", type=int, default=LEAST, help=f"smallest number of segments that remain ({LEAST})")
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    field = soccer()
    frames = list(read_frames([options.annotations], field, options.size).values())
    for lens in LENS_FLAGS:
        errors = left_out_errors(
            field, frames, options.size, lens=lens, least=options.least, free_field_size=options.free_field_size
        )
        result = {"lens": lens, "segments": len(errors)}
        median, most = np.quantile(errors, (0.5, 0.9)).round(3).tolist() if len(errors) else (None, None)
        print(json.dumps({**result, "median_px": median, "90_percent_px": most}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
