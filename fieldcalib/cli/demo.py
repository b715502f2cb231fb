"""The demonstration: a synthetic pan over a field, calibrated from noisy labels and compared with the truth.

It needs no data: the cameras are made up, the frames are rendered, the labels are projected markings with noise.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.arguments import folder_name
from fieldcalib.draw.minimap import add_minimap
from fieldcalib.draw.overlays import draw_field, draw_segments
from fieldcalib.draw.scene import render_field
from fieldcalib.draw.sheet import contact_sheet
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc
from fieldcalib.fields.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import RadialLens
from fieldcalib.io.files import write_text
from fieldcalib.io.image import Image
from fieldcalib.io.images import write_image
from fieldcalib.io.output_folder import output_folder
from fieldcalib.io.soccernet import camera_to_record, format_annotation
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.solve.batch import calibrate_batch

IMAGE_SIZE = (960, 540)
PIXELS_PER_CIRCLE = 9
SHORTEST_SEGMENT = 15.0  # px: what shows less in the image is not labelled
TITLE = "fieldcalib: one pan, every frame on its own"
LEGEND = "dots: labelled pixels    magenta: the markings as calibrated from them    inset: what the camera sees"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command, add its arguments and set ``run``, a function of them that gives the exit code."""
    parser.description = (
        "Render a pan over a pitch with known cameras, calibrate it from noisy pixels, print the errors "
        "and write overlays. Needs no data and no network."
    )
    parser.add_argument("--out", required=True, type=folder_name, metavar="DIR", help="where the pictures go")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Demonstrate; returns the exit code."""
    with output_folder(options.out):
        run_demo(options.out)
    return 0


@dataclass(frozen=True)
class CameraErrors:
    """How far an estimated camera is from the true one; NaN where there is no camera."""

    focal_length: float
    """Percent."""
    position: float
    """Metres."""
    pan: float
    """Degrees, as tilt and roll."""
    tilt: float
    roll: float
    reprojection: float
    """Largest distance in pixels between the images of a point of the ground, over the visible field."""


def run_demo(out: Path, *, count: int = 12, noise: float = 1.0, seed: int = 0) -> list[CameraErrors]:
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
        Of the noise and of the pictures' crowd.

    Returns
    -------
    list of CameraErrors
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
    errors = [camera_errors(found.camera, truth, field) for found, truth in zip(calibrations, truths, strict=True)]
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


def pan_over_field(count: int) -> list[Camera]:
    """A broadcast camera on the main stand, with the usual lens, that follows the play from goal to goal.

    Examples
    --------
    >>> [round(float(np.degrees(camera.angles[0]))) for camera in pan_over_field(3)]
    [-27, 1, 28]
    """
    C, lens = np.array([-1.0, 68.0, -17.0]), RadialLens(float(np.hypot(*IMAGE_SIZE) / 2.0))
    cameras = []
    for s in np.linspace(-1.0, 1.0, count):
        x, y, z = np.array([38.0 * s, -2.0 + 2.0 * np.cos(3.0 * s), 0.0]) - C  # from the camera to where it looks
        pan, tilt = np.arctan2(x, -y), np.arctan2(np.hypot(x, y), z)
        roll, f = np.radians(0.4) * np.sin(4.0 * s), 1000.0 + 420.0 * s * s + 60.0 * np.sin(5.0 * s)
        cameras.append(Camera.from_angles(pan, tilt, roll, f, C, IMAGE_SIZE, k=lens.to_opencv(lens.mean, f)))
    return cameras


def observe(
    camera: Camera, field: Field, rng: np.random.Generator, noise: float, pixels_per_line: tuple[int, int] = (2, 3)
) -> Pixels:
    """What an annotator would label: a few pixels on every visible marking, with normal noise, inside the image.

    Parameters
    ----------
    camera : Camera
    field : Field
    rng : numpy.random.Generator
    noise : float
        Standard deviation in pixels along x and along y.
    pixels_per_line : (int, int)
        At least and at most so many, the ends of what is visible among them.

    Returns
    -------
    dict of str to (N, 2) array
        Nine pixels a circle. Halves of a circle are not labelled, the whole is.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> pixels = observe(camera, soccer(), np.random.default_rng(0), noise=1.0)
    >>> sorted(pixels), len(pixels["Circle central"])
    (['Circle central', 'Middle line', 'Side line top'], 9)
    """
    margin = 3.0 * noise  # so that noise hardly ever moves a pixel out of the image
    pixels = {}
    for label, segment in field.markings.items():
        xy = camera.project(segment.sample(spacing=0.1))
        xy = xy[_inside(xy, margin, camera.image_size)]
        if label in field.half_labels or not len(xy) or np.max(np.ptp(xy, axis=0)) < SHORTEST_SEGMENT:
            continue
        if isinstance(segment, Arc):
            share = (np.arange(PIXELS_PER_CIRCLE) + 0.5) / PIXELS_PER_CIRCLE  # a circle has no ends
        else:
            share = np.linspace(0.0, 1.0, rng.integers(*pixels_per_line, endpoint=True))
        chosen = xy[np.rint(share * (len(xy) - 1)).astype(int)]
        labelled = chosen + rng.normal(0.0, noise, size=chosen.shape)
        pixels[label] = labelled[_inside(labelled, 0.0, camera.image_size)]
    return pixels


def camera_errors(camera: Camera | None, truth: Camera, field: Field) -> CameraErrors:
    """Errors of an estimated camera against the true one.

    Examples
    --------
    >>> truth = pan_over_field(1)[0]
    >>> moved = Camera(truth.K, truth.R, truth.C + [0.0, 0.0, -0.5], truth.image_size)
    >>> errors = camera_errors(moved, truth, soccer())
    >>> errors.position, errors.pan, errors.reprojection > 5.0
    (0.5, 0.0, True)
    """
    if camera is None:
        return CameraErrors(*[np.nan] * 6)
    half = np.array([field.length, field.width]) / 2.0
    x, y = np.meshgrid(np.linspace(-half[0], half[0], 106), np.linspace(-half[1], half[1], 69))  # 1 m apart
    X = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    xy = truth.project(X)
    visible = _inside(xy, 0.0, truth.image_size)
    distance = np.linalg.norm(camera.project(X[visible]) - xy[visible], axis=-1)
    pan, tilt, roll = np.abs(np.degrees((camera.angles - truth.angles + np.pi) % (2.0 * np.pi) - np.pi)).tolist()
    return CameraErrors(
        100.0 * abs(camera.focal_length / truth.focal_length - 1.0),
        float(np.linalg.norm(camera.C - truth.C)),
        pan,
        tilt,
        roll,
        float(np.max(np.nan_to_num(distance, nan=np.inf))),
    )


def _inside(xy: Array, margin: float, image_size: tuple[int, int]) -> BoolArray:
    return np.asarray(np.all((xy >= margin) & (xy <= np.array(image_size) - 1.0 - margin), axis=-1))


def _table(errors: Sequence[CameraErrors], calibrations: Sequence[Calibration]) -> str:
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


# Pictures


def _picture(rendered: Image, field: Field, frame: Pixels, found: Calibration, *, names: bool) -> Image:
    """A frame with the calibrated markings, the labelled pixels and, in a corner, the view from above."""
    camera = found.camera
    if camera is None:
        return draw_segments(rendered, frame, names=names)
    return add_minimap(
        draw_segments(draw_field(rendered, camera, field, thickness=1), frame, names=names), camera, field
    )


def _caption(name: str, truth: Camera, error: CameraErrors) -> str:
    """A line of text below a picture."""
    pan = np.degrees(truth.angles[0])
    return f"{name}   pan {pan:+.0f} deg   f {truth.focal_length:.0f} px   worst error {error.reprojection:.1f} px"
