"""Verdicts on pictures that were changed without saying so: parts of frames, wrong image sizes.

    python -m data_tools.undeclared ANNOTATIONS --size WxH [--shapes]
    python -m data_tools.undeclared --images FOLDER
    python -m data_tools.undeclared --basketball CAMERAS.json

The camera of a frame is taken as true where its unchanged labels give a good one. The labels are then changed as a user
may change a picture without saying so: the left or right half, a corner of three quarters, an upright part of 9:16, a
stated size that is a third larger or smaller than the true one, squashed to a square or to 3:2. One line of JSON for
each kind says how many frames keep three labels, which share of all is good, and which share is good although it is off
by more than 1 m somewhere in view.

`--shapes` draws the labels of pictures of other shapes from these cameras: whole ones, which see more above and below,
parts of frames, and frames that were squashed. Whether a picture was squashed is estimated.

`--images` does the same with pictures, from which cameras are calibrated on a field of the given size: parts of them,
squashed pictures, and pictures between black bars. Changed pictures are not stored.

`--basketball` takes real cameras whose principal point is far from the centre of their views: K, R, T of each in
centimetres, origin at a corner of the court. The lines of the court are projected with noise; a camera is wrong if it
is off by more than the tolerance of the field.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.annotated_frames import read_frames
from data_tools.probability import largest_true_error
from data_tools.random_frames import NOISE_SPREAD, noisy_pixels
from fieldcalib.assess.findings import Verdict, What
from fieldcalib.assess.result import LEAST_PROBABILITY, Calibration
from fieldcalib.console.arguments import image_size
from fieldcalib.console.program import run_command
from fieldcalib.fields.catalogue import field_named
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.io.image_files import Image, parse_image
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.problem.labelled_pixels import Pixels, check_segments
from fieldcalib.solve.batch import calibrate_batch, compute_errors
from fieldcalib.solve.likelier_shape import with_likely_aspect

LEAST_LABELS = 3
CORNER = 0.75  # of width and height
UPRIGHT = 9.0 / 16.0
STRIP = 3.0 / 32.0  # of width or height, as screenshots lack one
SAID_SIZES = {"a third larger": 4.0 / 3.0, "a third smaller": 2.0 / 3.0}
BASKETBALL, COURT_CORNER = "basketball-fiba", (14.0, 7.5, 0.0)
NOISE, SPACING = 1.5, 0.5  # px, metres
BAR = 1.0 / 6.0  # of the height, on each side: 540 rows in a picture of 720
LARGEST_HEIGHT_ERROR = 0.1  # share of the camera's height
SUFFIXES = (".jpg", ".png")
CUT = {"4:3": 4.0 / 3.0, "3:2": 1.5}  # width by height
SHAPES = {**CUT, "16:10": 1.6}
KEPT = (0.6, 1.0)  # share of the markings in view that is labelled in drawn pictures
SQUASHED = {"squashed to a square": 1.0, "squashed to 3:2": 1.5, "squashed to 4:3": 4.0 / 3.0}  # width by height


@dataclass(frozen=True)
class ChangedPicture:
    """Labels of a picture, its stated size and its true camera."""

    pixels: Pixels
    image_size: tuple[int, int]
    """Size stated by the user, (width, height)."""
    truth: Camera
    """True camera of the picture."""


def part_of(pixels: Pixels, camera: Camera, corner: tuple[int, int], size: tuple[int, int]) -> ChangedPicture:
    """The part of a frame with a size and an upper left corner."""
    inside = {
        label: (xy - corner)[np.all((xy >= corner) & (xy <= np.add(corner, size) - 1), axis=1)]
        for label, xy in pixels.items()
    }
    return ChangedPicture({label: xy for label, xy in inside.items() if len(xy)}, size, camera.cropped(corner, size))


def changed(pixels: Pixels, camera: Camera, rng: np.random.Generator) -> dict[str, ChangedPicture]:
    """The frame changed in each way: name of the change -> picture.

    Examples
    --------
    >>> camera = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> halves = changed({"Middle line": np.array([[100.0, 20.0], [500.0, 300.0]])}, camera, np.random.default_rng(0))
    >>> halves["right half"].pixels, halves["right half"].image_size
    ({'Middle line': array([[ 20., 300.]])}, (480, 540))
    """
    width, height = camera.image_size
    half, (w, h) = width // 2, (round(CORNER * width), round(CORNER * height))
    x, y = (rng.integers(2, size=2) * (width - w, height - h)).tolist()
    upright = round(UPRIGHT * height)
    left = int(rng.integers(width - upright, endpoint=True))
    found = {
        "as they are": ChangedPicture(pixels, camera.image_size, camera),
        "left half": part_of(pixels, camera, (0, 0), (half, height)),
        "right half": part_of(pixels, camera, (half, 0), (width - half, height)),
        "corner": part_of(pixels, camera, (x, y), (w, h)),
        "upright": part_of(pixels, camera, (left, 0), (upright, height)),
    }
    for name, factor in SAID_SIZES.items():
        found[name] = ChangedPicture(pixels, (round(factor * width), round(factor * height)), camera)
    for name, shape in SQUASHED.items():
        size = round(shape * height), height
        squashed = {label: xy * np.divide(size, camera.image_size) for label, xy in pixels.items()}
        found[name] = ChangedPicture(squashed, size, camera.scaled(size))
    return found


def counts(pictures: Sequence[ChangedPicture], found: Sequence[Calibration], field: Field) -> Mapping[str, object]:
    """Shares, percent of all pictures: verdict good, and good but off by more than the field's tolerance."""
    good = [one.verdict is Verdict.GOOD for one in found]
    wrong = [
        is_good
        and one.camera is not None
        and not largest_true_error(one.camera, picture.truth, field) <= field.tolerance
        for is_good, one, picture in zip(good, found, pictures, strict=True)
    ]
    share = 100.0 / max(len(pictures), 1)
    return {
        "count": len(pictures),
        "good_percent": round(share * sum(good), 1),
        "good_and_wrong_percent": round(share * sum(wrong), 1),
    }


def calibrated(pictures: Sequence[ChangedPicture], field: Field, *, estimated: bool = False) -> list[Calibration]:
    """The calibrations of pictures of any sizes; whether they were squashed is `estimated`, or they were not."""
    by_size: dict[tuple[int, int], list[int]] = {}
    for index, picture in enumerate(pictures):
        by_size.setdefault(picture.image_size, []).append(index)
    found: dict[int, Calibration] = {}
    for size, members in by_size.items():
        frames = [pictures[index].pixels for index in members]
        calibrations = with_likely_aspect(field, partial(calibrate_batch, field), frames, size, estimated=estimated)
        compute_errors([one for one in calibrations if one.accepted])
        found.update(zip(members, calibrations, strict=True))
    return [found[index] for index in range(len(pictures))]


def judge_annotations(options: argparse.Namespace) -> int:
    """Judge annotated frames, each changed in every way, or pictures of other shapes drawn from their cameras."""
    rng, field = np.random.default_rng(options.seed), soccer()
    frames = list(read_frames([options.annotations], field, options.size).values())
    by_kind: dict[str, list[ChangedPicture]] = {}
    truths = calibrate_batch(field, frames, options.size)
    compute_errors([one for one in truths if one.accepted])
    for pixels, one in zip(frames, truths, strict=True):
        if one.verdict is not Verdict.GOOD or one.camera is None:
            continue
        made = drawn(one.camera, field, rng) if options.shapes else changed(pixels, one.camera, rng)
        for kind, picture in made.items():
            by_kind.setdefault(kind, []).append(picture)
    print(json.dumps({"frames": len(frames), "good": max(map(len, by_kind.values()), default=0)}))
    for kind, pictures in by_kind.items():
        enough = [
            picture for picture in pictures if len(picture.pixels) >= LEAST_LABELS and _is_possible(field, picture)
        ]
        _print_counts(kind, enough, field, estimated=options.shapes)
    return 0


def drawn(camera: Camera, field: Field, rng: np.random.Generator) -> dict[str, ChangedPicture]:
    """Pictures of other shapes, by the name of what they are, with labels drawn from a camera of a whole frame.

    Examples
    --------
    >>> camera = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> pictures = drawn(camera, soccer(), np.random.default_rng(0))
    >>> [pictures[f"{kind} 4:3"].image_size for kind in ("whole", "cut to", "squashed to")]
    [(960, 720), (720, 540), (720, 540)]
    """
    width, height = camera.image_size
    cameras = {"as they are": camera}
    for name, shape in SHAPES.items():
        taller, narrower = round(width / shape), round(shape * height)
        left = int(rng.integers(width - narrower, endpoint=True))
        cameras[f"whole {name}"] = camera.cropped((0, (height - taller) // 2), (width, taller))
        cameras[f"cut to {name}"] = camera.cropped((left, 0), (narrower, height))
        cameras[f"squashed to {name}"] = camera.scaled((narrower, height))
    found = {}
    for kind, one in cameras.items():
        noise, kept = float(np.exp(rng.normal(0.0, NOISE_SPREAD))), float(rng.uniform(*KEPT))
        found[kind] = ChangedPicture(noisy_pixels(one, field, rng, noise, kept), one.image_size, one)
    return found


def _is_possible(field: Field, picture: ChangedPicture) -> bool:
    """Whether the labels are accepted as input: not if most of them lie outside the picture."""
    try:
        check_segments(field, picture.pixels, picture.image_size)
    except ValueError:
        return False
    return True


def _print_counts(kind: str, pictures: Sequence[ChangedPicture], field: Field, *, estimated: bool = False) -> None:
    found = calibrated(pictures, field, estimated=estimated)
    print(json.dumps({"pictures": kind, **counts(pictures, found, field)}), flush=True)


def judge_images(options: argparse.Namespace) -> int:
    """Judge pictures, each changed in every way."""
    field, network = soccer(), SegmentationNetwork.load()
    paths = sorted(path for path in options.images.iterdir() if path.suffix in SUFFIXES)
    images = [parse_image(path.read_bytes()) for path in paths]
    calibrate = partial(calibrate_from_images, field, network=network, estimate_size=False)
    whole = calibrate(images)
    # the verdict need not be good: cameras that are probably right are enough
    pairs = [
        (image, one.camera)
        for image, one in zip(images, whole, strict=True)
        if one.camera is not None and one.accepted and one.probability(size_known=True) >= LEAST_PROBABILITY
    ]
    for kind in changed_image(*pairs[0]) if pairs else ():
        made = [changed_image(image, camera)[kind] for image, camera in pairs]
        found = calibrate([image for image, _ in made])
        pictures = [ChangedPicture({}, truth.image_size, truth) for _, truth in made]
        heights = [
            abs(one.camera.C[2] / truth.C[2] - 1.0) > LARGEST_HEIGHT_ERROR
            for one, (_, truth) in zip(found, made, strict=True)
            if one.verdict is Verdict.GOOD and one.camera is not None and not one.has_finding(What.GROUND_ONLY)
        ]
        row = {**counts(pictures, found, field), "good_and_height_wrong": int(sum(heights))}
        print(json.dumps({"pictures": kind, **row}), flush=True)
    return 0


def changed_image(image: Image, camera: Camera) -> dict[str, tuple[Image, Camera]]:
    """The picture and its camera changed in each way, by the name of the change.

    Examples
    --------
    >>> camera = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> image, letterboxed = changed_image(np.full((540, 960, 3), 90, np.uint8), camera)["letterboxed"]
    >>> image.shape, letterboxed.principal_point
    ((720, 960, 3), array([480., 360.]))
    """
    import cv2

    width, height = camera.image_size
    two, upright, bar = 2 * width // 3, round(UPRIGHT * height), round(BAR * height)
    parts = {
        "as they are": (0, 0, width, height),
        "left two thirds": (0, 0, two, height),
        "right two thirds": (width - two, 0, two, height),
        "upright": ((width - upright) // 2, 0, upright, height),
    }
    for name, shape in CUT.items():
        w = round(shape * height)
        parts |= {f"left {name}": (0, 0, w, height), f"right {name}": (width - w, 0, w, height)}
    columns, rows = round(STRIP * width), round(STRIP * height)
    parts |= {
        "without a strip above": (0, rows, width, height - rows),
        "without a strip below": (0, 0, width, height - rows),
        "without a strip at the left": (columns, 0, width - columns, height),
        "without a strip at the right": (0, 0, width - columns, height),
    }
    w, h = round(CORNER * width), round(CORNER * height)
    for y, upper in ((0, "upper"), (height - h, "lower")):
        parts |= {f"{upper} left corner": (0, y, w, h), f"{upper} right corner": (width - w, y, w, h)}
    found = {
        name: (np.ascontiguousarray(image[y : y + h, x : x + w]), camera.cropped((x, y), (w, h)))
        for name, (x, y, w, h) in parts.items()
    }
    for name, shape in SQUASHED.items():
        size = round(shape * height), height
        found[name] = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8), camera.scaled(size)
    for name, (x, y) in {"letterboxed": (0, bar), "pillarboxed": (bar, 0)}.items():
        size = width + 2 * x, height + 2 * y
        bars = cv2.copyMakeBorder(image, y, y, x, x, cv2.BORDER_CONSTANT, value=(0, 0, 0))
        found[name] = np.asarray(bars, np.uint8), camera.cropped((-x, -y), size)
    return found


def judge_basketball(options: argparse.Namespace) -> int:
    """Judge views of basketball games, whose principal point may be far from the middle."""
    rng, field = np.random.default_rng(options.seed), field_named(BASKETBALL)
    pictures = [
        ChangedPicture(projected(camera, field, rng), camera.image_size, camera)
        for camera in basketball_cameras(json.loads(options.basketball.read_bytes()))
    ]
    _print_counts("basketball", [picture for picture in pictures if len(picture.pixels) >= LEAST_LABELS], field)
    return 0


def basketball_cameras(records: Sequence[Mapping[str, Any]]) -> list[Camera]:
    """Cameras of records with K, R and T in centimetres from a corner of the court; the first record has the size."""
    width, height = int(records[0]["width"]), int(records[0]["height"])
    found = []
    for record in records[1:]:
        K, R = np.reshape(record["K"], (3, 3)), np.reshape(record["R"], (3, 3))
        U, _, V = np.linalg.svd(R)  # R is rounded
        K = np.array([[K[0, 0], 0.0, K[0, 2]], [0.0, K[1, 1], K[1, 2]], [0.0, 0.0, 1.0]])
        C = -R.T @ np.array(record["T"]) / 100.0 - COURT_CORNER
        found.append(Camera(K, U @ V, C, (width, height)))
    return found


def projected(camera: Camera, field: Field, rng: np.random.Generator) -> Pixels:
    """Pixels of the markings in view, with noise."""
    found: Pixels = {}
    largest = np.array(camera.image_size) - 1.0
    for label, segment in field.markings.items():
        xy = camera.project(segment.sample(SPACING))
        xy = xy[np.all((xy >= 0.0) & (xy <= largest), axis=1)]
        if len(xy) > 1 and label not in field.half_labels:
            found[label] = xy + rng.normal(0.0, NOISE, xy.shape)
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line of JSON for each kind of pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("annotations", type=Path, nargs="?", help="folder or zip of <id>.json")
    parser.add_argument("--size", type=image_size, metavar="WxH", help="of the images")
    parser.add_argument("--shapes", action="store_true", help="draw pictures of other shapes from their cameras")
    parser.add_argument("--basketball", type=Path, metavar="FILE", help="cameras of basketball games, instead")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--images", type=Path, metavar="FOLDER", help="pictures, instead")
    options = parser.parse_args(arguments)
    given = [options.annotations is not None, options.images is not None, options.basketball is not None]
    if sum(given) != 1 or given[0] != (options.size is not None):
        parser.error("expected ANNOTATIONS and --size, or --images, or --basketball")
    options.run = (judge_annotations, judge_images, judge_basketball)[given.index(True)]
    return run_command(options)


if __name__ == "__main__":
    raise SystemExit(main())
