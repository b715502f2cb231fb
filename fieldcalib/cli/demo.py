"""The demonstration: a synthetic pan over a field, calibrated from noisy labels and compared with the truth.

It needs no data: the cameras are made up, the frames are rendered, the labels are projected markings with noise.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import folder_name
from fieldcalib.draw.minimap import add_minimap
from fieldcalib.draw.overlays import draw_field, draw_segments
from fieldcalib.draw.scene import render_field
from fieldcalib.draw.sheet import contact_sheet
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.files import write_text
from fieldcalib.io.image import Image
from fieldcalib.io.images import write_image
from fieldcalib.io.output_folder import output_folder
from fieldcalib.io.soccernet import camera_to_record, format_annotation
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.problem.simulated import IMAGE_SIZE, CameraDifference, camera_difference, observe, pan_over_field
from fieldcalib.solve.batch import calibrate_batch

TITLE = "fieldcalib: one pan, every frame on its own"
LEGEND = "dots: labelled pixels    magenta: the markings as calibrated from them    inset: what the camera sees"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Render a pan over a pitch with known cameras, calibrate it from noisy pixels, print the errors "
        "and write overlays. Needs no data and no network."
    )
    parser.add_argument("--out", required=True, type=folder_name, metavar="DIR", help="where the pictures go")


def run(options: argparse.Namespace) -> int:
    """Demonstrate; returns the exit code."""
    with output_folder(options.out):
        run_demo(options.out)
    return 0


def run_demo(out: Path, *, count: int = 12, noise: float = 1.0, seed: int = 0) -> list[CameraDifference]:
    """Calibrate a synthetic pan, print the errors against the truth and write pictures of it.

    Written are ``frame_XX.png`` (the rendered frame with the labelled pixels, the markings as calibrated and the view
    from above), ``overview.png`` (all frames), ``annotations/XX.json`` (the labels in SoccerNet's form, x divided by
    width - 1 and y by height - 1) and ``true_cameras.json`` (SoccerNet's records by frame).

    Parameters
    ----------
    out : Path
        Folder; it is made if need be. Files of these names are replaced.
    count : int
        Number of frames.
    noise : float
        Standard deviation of the labelled pixels along x and along y.
    seed : int
        Seed of the noise and of the rendered crowd.

    Returns
    -------
    list of CameraDifference
        One for each frame.

    Examples
    --------
    >>> import contextlib, io, tempfile
    >>> with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
    ...     errors = run_demo(Path(folder), count=1)
    >>> errors[0].reprojection < 5.0
    True
    """
    rng = np.random.default_rng(seed)
    field, truths = soccer(), pan_over_field(count)
    frames = [observe(truth, field, rng, noise) for truth in truths]
    calibrations = calibrate_batch(field, frames, IMAGE_SIZE)
    errors = [camera_difference(found.camera, truth, field) for found, truth in zip(calibrations, truths, strict=True)]
    print(f"{count} frames, each calibrated on its own from {noise:g} px noise; errors against the true cameras,")
    print("worst: the largest error in the image of any visible point of the ground.\n")
    print(_table(errors, calibrations))

    annotations = out / "annotations"
    annotations.mkdir(parents=True, exist_ok=True)
    names = [f"{index:02d}" for index in range(count)]
    pictures = []
    for name, truth, frame, found in zip(names, truths, frames, calibrations, strict=True):
        rendered = render_field(truth, field, rng=np.random.default_rng(seed))  # the same crowd in every frame
        write_image(out / f"frame_{name}.png", _picture(rendered, field, frame, found, names=True))
        write_text(annotations / f"{name}.json", format_annotation(frame, IMAGE_SIZE) + "\n")
        pictures.append(_picture(rendered, field, frame, found, names=False))
    captions = [_caption(name, truth, error) for name, truth, error in zip(names, truths, errors, strict=True)]
    write_image(out / "overview.png", contact_sheet(pictures, captions, title=TITLE, legend=LEGEND))
    records = {name: camera_to_record(truth) for name, truth in zip(names, truths, strict=True)}
    write_text(out / "true_cameras.json", json.dumps(records, indent=1) + "\n")
    print(f"\nPictures, annotations and the true cameras are in {out}; overview.png shows them all.")
    return errors


def _table(errors: Sequence[CameraDifference], calibrations: Sequence[Calibration]) -> str:
    """Errors of every frame and their median, aligned."""
    titles = ("focal [%]", "position [m]", "pan [°]", "tilt [°]", "roll [°]", "worst [px]", "rms [px]")
    values = np.array([[*astuple(error), found.rms] for error, found in zip(errors, calibrations, strict=True)])

    def line(name: str, row: Array, note: str) -> str:
        cells = (f"{value:{len(title)}.3f}" for value, title in zip(row, titles, strict=True))
        return "  ".join([f"{name:>6}", *cells, note]).rstrip()

    lines = ["  ".join([" frame", *titles, "status"])]
    for index, (row, found) in enumerate(zip(values, calibrations, strict=True)):
        lines.append(line(f"{index:02d}", row, str(found.status)))
    calibrated = values[np.isfinite(values[:, 0])]
    if len(calibrated):
        lines.append(line("median", np.median(calibrated, axis=0), ""))
    return "\n".join(lines)


def _picture(rendered: Image, field: Field, frame: Pixels, found: Calibration, *, names: bool) -> Image:
    """A frame with the calibrated markings, the labelled pixels and, in a corner, the view from above."""
    camera = found.camera
    if camera is None:
        return draw_segments(rendered, frame, names=names)
    return add_minimap(
        draw_segments(draw_field(rendered, camera, field, thickness=1), frame, names=names), camera, field
    )


def _caption(name: str, truth: Camera, error: CameraDifference) -> str:
    """A line of text below a picture."""
    pan = np.degrees(truth.angles[0])
    return f"{name}   pan {pan:+.0f} deg   f {truth.focal_length:.0f} px   worst error {error.reprojection:.1f} px"
