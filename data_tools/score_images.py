"""Accuracy of cameras from images alone, on data with some ground truth.

    python -m data_tools.score_images keypoints FOLDER [--unlike TRAIN]
    python -m data_tools.score_images homographies IMAGES ANNOTATIONS
    python -m data_tools.score_images clip VIDEO CAMERAS.npz
    python -m data_tools.score_images frames FOLDER --model FILE [--field NAME]
    python -m data_tools.score_images views [--frames N]
    python -m data_tools.score_images nonsense [--frames N]

each with [--model FILE] [--no-refinement]; each prints a line of JSON.

`keypoints`: frames with four or more reliable hand-labelled field points (`data_tools.labelled`), with `--unlike` only
of clips that are not in TRAIN. Measured is, for each frame, the median distance of its points from their projections,
in pixels of 1920x1080.

`homographies`: IMAGES are ``<id>.png`` squashed from 1280x720, ANNOTATIONS ``<id>.homographyMatrix`` and ``<id>.json``,
as of the World Cup 2014. Measured are IoU_part against the homographies and AC against the annotated segments.

`clip`: a video of one static camera, of which K of the first frames is known, and R and t of the first one. Measured
are the errors of the median focal length (percent) and position (metres) of these frames, each with the median of the
standard deviations that the calibrations state.

`frames`: output of `data_tools.synthetic --out`. Measured is, for each frame that shows a field, the median distance
between the images of field points under the true and the calibrated camera, in pixels of 1280x720; and how many frames
without a field get an accepted camera.

`views`: rendered frames that are hard (`data_tools.synthetic.hard`), so many of each kind of view. Measured are, for
each kind, the share whose camera is accepted and right, to 6 pixels of 1280x720, and the shares that are accepted or
good, and not right.

`nonsense`: the number of pictures without a field (`data_tools.nonsense`) that get an accepted camera.

A frame is lost if no camera is accepted.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from data_tools.command_parser import add_made_frames, parser_of
from data_tools.labelled import clip_of, labelled_points
from data_tools.measured_cameras import read_camera
from data_tools.nonsense import nonsense
from data_tools.synthetic import SIZE as SYNTHETIC_SIZE
from data_tools.synthetic import SyntheticFrame
from data_tools.synthetic.cameras import BROADCAST
from data_tools.synthetic.frames import seen_from
from data_tools.synthetic.hard import (
    CORNER,
    DRONE,
    HIGH_BEHIND,
    LOW_BEHIND,
    MAST,
    OVERHEAD,
    OVERHEAD_BEHIND,
    TOUCHLINE,
)
from data_tools.truth import compared, points_in_view
from fieldcalib._types import Array
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import SOCCER, NetworkOptions, add_named_field, field_of, load_network
from fieldcalib.console.options import add_options
from fieldcalib.console.program import run_command
from fieldcalib.fields.traits import MAIN_CENTER
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.io.formats import CAMERAS
from fieldcalib.io.image_files import IMAGES_AT_ONCE, Image, in_parts, parse_image
from fieldcalib.io.soccernet import camera_from_record, parse_annotation
from fieldcalib.io.videos import VideoReader
from fieldcalib.io.wc14 import parse_homography
from fieldcalib.metrics import evaluate_segments, iou_part
from fieldcalib.problem.layout import CENTER, LOG_F

SIZE = (1280, 720)  # to which squashed images are stretched
REPORTED_WIDTH = 1920.0
LEAST_POINTS = 4
KINDS = (BROADCAST, MAIN_CENTER, LOW_BEHIND, HIGH_BEHIND, CORNER, TOUCHLINE, MAST, DRONE, OVERHEAD, OVERHEAD_BEHIND)
RIGHT = 6.0  # px of `SIZE`
TURN = (-1.0, -1.0, 1.0)  # of points about the centre mark


@dataclass(frozen=True)
class Calibrator:
    """Calibrates images on their own, a few at a time."""

    network: NetworkOptions
    refine: bool

    @classmethod
    def of(cls, options: argparse.Namespace) -> Calibrator:
        """Take the options of a command line."""
        return cls(NetworkOptions.of(options), options.refine)

    def __call__(self, images: Iterable[Image]) -> Iterator[Calibration]:
        """Calibrate images, in their order."""
        field, network = self.network.field, load_network(self.network)
        for part in in_parts(images, IMAGES_AT_ONCE):
            yield from calibrate_from_images(field, part, network, refine=self.refine, estimate_size=False)


def read_stretched(path: Path) -> Image:
    """A squashed image, resized to its original aspect ratio."""
    return np.asarray(cv2.resize(parse_image(path.read_bytes()), SIZE, interpolation=cv2.INTER_CUBIC), np.uint8)


def keypoints(options: argparse.Namespace) -> int:
    """Score frames with labelled points."""
    seen = {clip_of(path) for path in options.unlike.glob("*.jpg")} if options.unlike else set()
    frames: dict[Path, tuple[Array, Array]] = {}
    for path in sorted(options.folder.glob("*.jpg")):
        X, xy = labelled_points(path)
        if len(X) >= LEAST_POINTS and clip_of(path) not in seen:
            frames[path] = X, xy * SIZE
    errors = []
    found = Calibrator.of(options)(map(read_stretched, frames))
    for calibration, (X, xy) in zip(found, frames.values(), strict=True):
        if calibration.accepted and calibration.camera is not None:
            off = np.linalg.norm(calibration.camera.project(X) - xy, axis=1) * REPORTED_WIDTH / SIZE[0]
            errors.append(float(np.median(np.nan_to_num(off, nan=np.inf))))
    result = {"frames": len(frames), "lost": len(frames) - len(errors)}
    print(json.dumps({**result, **_quantiles("px", errors, (0.5, 0.95, 1.0))}))
    return 0


def homographies(options: argparse.Namespace) -> int:
    """Score frames with homographies and annotated segments."""
    paths = sorted(options.images.glob("*.png"))
    if not paths:
        raise ValueError(f"{options.images}: expected pictures named <id>.png, found none")
    found = list(Calibrator.of(options)(map(read_stretched, paths)))
    truths = [parse_homography((options.annotations / f"{path.stem}.homographyMatrix").read_text()) for path in paths]
    both = zip(found, truths, strict=True)
    iou = [100.0 * iou_part(c.camera, H, SIZE) for c, H in both if c.accepted and c.camera is not None]
    segments = [parse_annotation((options.annotations / f"{path.stem}.json").read_bytes(), SIZE) for path in paths]
    evaluation = evaluate_segments([c.camera if c.accepted else None for c in found], segments, SIZE)
    accuracy = {
        f"AC@{t:g}": round(100.0 * float(a), 1) for t, a in zip(evaluation.thresholds, evaluation.accuracy, strict=True)
    }
    result = {"frames": len(paths), "lost": len(paths) - len(iou)}
    shown = {"IoU_part_mean": round(float(np.mean(iou)), 1), "IoU_part_median": round(float(np.median(iou)), 1)}
    print(json.dumps({**result, **(shown if iou else {}), **accuracy}))
    return 0


def clip(options: argparse.Namespace) -> int:
    """Score a video of a measured camera."""
    truth = read_camera(options.cameras)
    with np.load(options.cameras) as arrays:
        f = arrays["K"][:, 0, 0]
    with VideoReader(options.video) as video:
        found = list(Calibrator.of(options)(islice(video, len(f))))
    accepted = [(c, true) for c, true in zip(found, f, strict=True) if c.accepted]
    result: dict[str, object] = {"frames": len(found), "lost": len(found) - len(accepted)}
    if accepted:
        cameras = [c.uncertainty.camera for c, _ in accepted]
        sigma = np.median([np.sqrt(np.diagonal(c.covariance)) for c, _ in accepted], axis=0)
        off = [camera.focal_length / true - 1.0 for camera, (_, true) in zip(cameras, accepted, strict=True)]
        C = np.median([camera.C for camera in cameras], axis=0)
        result |= {
            "focal_length_percent": [round(100.0 * float(v), 2) for v in (np.median(off), sigma[LOG_F])],
            "position_m": [round(float(np.linalg.norm(v)), 2) for v in (C - truth.C, sigma[CENTER])],
        }
    print(json.dumps(result))
    return 0


def synthetic_frames(options: argparse.Namespace) -> int:
    """Score frames of data_tools.synthetic --out."""
    field = field_of(options)
    names = sorted(path.stem for path in options.folder.glob("*.jpg"))
    images = (parse_image((options.folder / f"{name}.jpg").read_bytes()) for name in names)
    found = list(Calibrator.of(options)(images))
    cameras = [options.folder / CAMERAS.file_name(name) for name in names]  # there is no file where no field is in view
    shown = [(c, path) for c, path in zip(found, cameras, strict=True) if path.is_file()]
    accepted = [(c, path) for c, path in shown if c.accepted]
    off = []
    for calibration, path in accepted:
        truth = camera_from_record(json.loads(path.read_text()), SYNTHETIC_SIZE)
        off.append(compared(calibration, truth, field, "lines").image_px)
    without = [c for c, path in zip(found, cameras, strict=True) if not path.is_file()]
    result = {"frames": len(shown), "lost": len(shown) - len(accepted), **_quantiles("px", off, (0.5, 0.9))}
    print(json.dumps({**result, "without_field": len(without), "accepted_without": sum(c.accepted for c in without)}))
    return 0


def views(options: argparse.Namespace) -> int:
    """Score rendered frames by kind of view."""
    calibrator = Calibrator.of(options)
    for stand in KINDS:
        made = [seen_from(stand, seed) for seed in range(options.seed, options.seed + options.frames)]
        found = list(calibrator(one.image for one in made))
        right = np.array([_is_right(c, one) for c, one in zip(found, made, strict=True)])
        accepted = np.array([c.accepted for c in found])
        good = np.array([c.verdict == Verdict.GOOD for c in found])
        shares = {"right": right, "accepted_wrong": accepted & ~right, "good_wrong": good & ~right}
        percent = {name: round(100.0 * float(np.mean(one)), 1) for name, one in shares.items()}
        print(json.dumps({"view": stand.name, "frames": len(made), **percent}), flush=True)
    return 0


def _is_right(found: Calibration, made: SyntheticFrame) -> bool:
    """Whether a camera is accepted and right; it may be turned with the field."""
    if not found.accepted or found.camera is None or made.camera is None:
        return False
    xy, X = points_in_view(made.camera, made.field)
    turns = np.stack([X, X * TURN])
    off = np.median(np.linalg.norm(found.camera.project(turns) - xy, axis=-1), axis=-1)
    return bool(np.min(np.nan_to_num(off, nan=np.inf)) * SIZE[0] < RIGHT * made.camera.image_size[0])


def no_field(options: argparse.Namespace) -> int:
    """Count the cameras of pictures that show no field."""
    images = (nonsense(seed) for seed in range(options.seed, options.seed + options.frames))
    accepted = [c.probability() for c in Calibrator.of(options)(images) if c.accepted]
    print(
        json.dumps(
            {"frames": options.frames, "accepted": len(accepted), "probabilities": np.round(accepted, 2).tolist()}
        )
    )
    return 0


def _quantiles(unit: str, values: Sequence[float], levels: Sequence[float]) -> dict[str, float]:
    if not values:
        return {}
    found = np.quantile(values, levels)
    return {f"{100.0 * level:g}_percent_{unit}": round(float(v), 2) for level, v in zip(levels, found, strict=True)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line of JSON."""
    functions = {
        "keypoints": keypoints,
        "homographies": homographies,
        "clip": clip,
        "frames": synthetic_frames,
        "views": views,
        "nonsense": no_field,
    }
    parser, commands = parser_of(__doc__, functions)
    for name, command in commands.items():
        command.set_defaults(run=functions[name], field=SOCCER)
        add_options(command, NetworkOptions)
        command.add_argument("--no-refinement", dest="refine", action="store_false", help="do not look for white lines")
        if name == "keypoints":
            command.add_argument("folder", type=Path, help="<name>.jpg and <name>.txt")
            command.add_argument("--unlike", type=Path, metavar="TRAIN", help="leave out the clips of this folder")
        elif name == "homographies":
            command.add_argument("images", type=Path, help="<id>.png")
            command.add_argument("annotations", type=Path, help="<id>.homographyMatrix and <id>.json")
        elif name == "frames":
            command.add_argument("folder", type=Path, help="<id>.jpg and camera_<id>.json")
            add_named_field(command)
        elif name == "clip":
            command.add_argument("video", type=Path)
            command.add_argument("cameras", type=Path, help="<name>.npz")
        else:
            add_made_frames(command, 300 if name == "views" else 500)
    return run_command(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
