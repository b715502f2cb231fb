"""Command line of Chen and Little's method.

    python -m baselines.chen INPUT --size WxH --database FILE --out DIR [--from annotations|masks|images]
    python -m baselines.chen database FILE [--cameras chen|uniform] [--features siamese|hog]
    python -m baselines.chen train MODEL

The first writes what `fieldcalib calibrate` writes, and homographies as ``<id>.homographyMatrix``; the cameras are
decomposed from these, which is "HDecomp + Chen" in TVCalib's paper.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import get_args

import cv2
import numpy as np

from baselines import hdecomp
from baselines.chen.cameras import CHEN, DRAWS
from baselines.chen.database import CAMERAS, Database
from baselines.chen.edges import Edges, edges_of_mask, edges_of_pixels, edges_of_probabilities
from baselines.chen.features import HOG, SIAMESE, Siamese
from baselines.chen.search import PUBLISHED, WIDER, Recipe, homography
from baselines.dlt_lines import homography_file
from fieldcalib._progress import progress_bar
from fieldcalib.console.arguments import (
    add_input_and_output,
    add_run_options,
    add_sized_field,
    annotation_reader,
    count,
    field_of,
    run_options,
)
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.io.formats import HOMOGRAPHIES
from fieldcalib.io.frame_source import ReadImage
from fieldcalib.io.image_files import IMAGES_AT_ONCE, Image
from fieldcalib.io.wc14 import AlignmentName
from fieldcalib.localize import SegmentationNetwork
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.run_folder.engine import image_files
from fieldcalib.run_folder.labelled_frames import (
    CalibratedFrame,
    FromFiles,
    calibrate_files,
    calibrate_folder,
)
from fieldcalib.solve.from_homography import judged_camera

PROG = "python -m baselines.chen"
ANNOTATED, MASKS, IMAGES = "annotations", "masks", "images"
RECIPES = {"wider": WIDER, "published": PUBLISHED}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    commands = {"database": _database_parser, "train": _training_parser}
    if given and given[0] in commands:
        return run_command(commands[given[0]]().parse_args(given[1:]))
    return run_command(_parser().parse_args(given))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=PROG,
        description="Homographies and their cameras by retrieval from a database and alignment of distance images. "
        f"{PROG} database --help and {PROG} train --help say how the database is made.",
    )
    add_input_and_output(parser)
    parser.add_argument(
        "--database", type=Path, required=True, metavar="FILE", help=f"made by {PROG} database FILE, of the same field"
    )
    parser.add_argument(
        "--from",
        dest="source",
        choices=(ANNOTATED, MASKS, IMAGES),
        default=ANNOTATED,
        help="what INPUT holds: labelled pixels; pictures of white lines on black; or images, whose markings the "
        f"network that comes along finds ({ANNOTATED})",
    )
    parser.add_argument(
        "--recipe",
        choices=tuple(RECIPES),
        default="wider",
        help="published: the nearest camera, aligned once; wider: three of twenty cameras, each aligned three times "
        "(wider)",
    )
    parser.add_argument(
        "--alignment",
        choices=get_args(AlignmentName),
        default="wc14",
        help="whose axes the homography files have (wc14: pixels to yards)",
    )
    add_sized_field(parser)
    add_run_options(parser)
    parser.set_defaults(run=_run, command="baselines.chen")
    return parser


def _database_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=f"{PROG} database", description="Make the database: random cameras and the features of what they see."
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="where it goes, e.g. chen.npz; 11 MB")
    add_cameras(parser)
    parser.add_argument("--count", type=count, default=CAMERAS, metavar="N", help=f"of cameras ({CAMERAS})")
    parser.add_argument(
        "--features",
        choices=(SIAMESE, HOG),
        default=SIAMESE,
        help=f"by the network of {PROG} train, or histograms of gradients, which need no training ({SIAMESE})",
    )
    parser.add_argument("--model", type=Path, metavar="FILE", help="that network (the one that comes along)")
    add_sized_field(parser)
    parser.set_defaults(run=_make_database)
    return parser


def _training_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=f"{PROG} train", description="Train the network of the features on drawn edge images (PyTorch)."
    )
    parser.add_argument("model", type=Path, metavar="MODEL", help="where it goes, in ONNX")
    add_cameras(parser)
    parser.add_argument("--steps", type=count, metavar="N", help="of 64 pairs of each kind (1280)")
    add_sized_field(parser)
    parser.set_defaults(run=_train)
    return parser


def add_cameras(parser: argparse.ArgumentParser) -> None:
    """Add --cameras and --seed."""
    parser.add_argument(
        "--cameras",
        choices=tuple(DRAWS),
        default=CHEN,
        help="chen: their distribution, fitted to WC14; uniform: fields of view and positions of any main stand "
        "in the centre (chen)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the random numbers (0)")


def _make_database(options: argparse.Namespace) -> int:
    extract = None
    if options.features == SIAMESE:
        extract = Siamese.shipped() if options.model is None else Siamese(options.model.read_bytes())
    elif options.model is not None:
        raise ValueError("--model is about --features siamese: histograms of gradients have none")
    with progress_bar(total=options.count, unit="camera") as progress:
        database = Database.made(
            field_of(options),
            options.cameras,
            DRAWS[options.cameras],
            extract,
            count=options.count,
            seed=options.seed,
            progress=progress.update,
        )
    database.write(options.file)
    print(f"{options.file}: {options.count} cameras")
    return 0


def _train(options: argparse.Namespace) -> int:
    from baselines.chen import training  # imports torch

    steps = training.STEPS if options.steps is None else options.steps

    def report(step: int, loss: float) -> None:
        if step % 100 == 0 or step == steps:
            print(f"step {step} of {steps}: loss {loss:.4f}", file=sys.stderr)

    draw = DRAWS[options.cameras]
    network = training.trained(field_of(options), draw, steps=steps, seed=options.seed, progress=report)
    training.write_model(network, options.model)
    print(options.model)
    return 0


def _run(options: argparse.Namespace) -> int:
    run, field, database = run_options(options), field_of(options), _database(options.database)
    if options.source != MASKS:  # masks show the field that their network was trained on
        database.check_field(field)
    more = {"database": hashlib.sha256(options.database.read_bytes()).hexdigest()}
    found = _FromEdges(options.database, RECIPES[options.recipe], options.alignment)
    writes = [HOMOGRAPHIES.file_name("<id>")]
    if options.source == ANNOTATED:
        method = _FromPixels(field, found)
        return calibrate_folder(run, options.input, annotation_reader(options, field), method, writes=writes, more=more)
    if options.size is None:
        raise ValueError(f"--from {options.source} needs --size: homographies are for images of that size")
    network = SegmentationNetwork.load(threads=1) if options.source == IMAGES else None
    read = partial(ReadImage(options.most_bytes).sized, size=options.size)
    method_of_images = FromFiles(read, _FromImages(field, found, network))
    return calibrate_files(run, image_files(options.input), method_of_images, IMAGES_AT_ONCE, writes, more)


@lru_cache(maxsize=1)
def _database(path: Path) -> Database:
    """Read the database, once per process."""
    return Database.read(path)


@dataclass(frozen=True)
class _FromEdges:
    """Finds homographies and cameras of edge images."""

    database: Path
    recipe: Recipe
    alignment: AlignmentName

    def __call__(self, id: str, edges: Edges, size: tuple[int, int]) -> CalibratedFrame:
        H = homography(_database(self.database), edges, size, self.recipe)
        (calibration,) = hdecomp.calibrate([H], size)
        return CalibratedFrame(calibration, files=homography_file(id, H, size, self.alignment))


@dataclass(frozen=True)
class _FromPixels:
    """Calibrates annotated frames."""

    field: Field
    from_edges: _FromEdges

    def __call__(self, frames: dict[str, Pixels], size: tuple[int, int]) -> list[CalibratedFrame]:
        return [self._calibrated(id, pixels, size) for id, pixels in frames.items()]

    def _calibrated(self, id: str, pixels: Pixels, size: tuple[int, int]) -> CalibratedFrame:
        found = self.from_edges(id, edges_of_pixels(self.field, pixels, size), size)
        calibration = found.calibration
        if calibration.camera is not None:
            calibration = judged_camera(calibration.camera, self.field, pixels, calibration.message)
        return CalibratedFrame(calibration, files=found.files)


@dataclass(frozen=True)
class _FromImages:
    """Calibrates masks of lines, or images with a network that finds the markings."""

    field: Field
    from_edges: _FromEdges
    network: SegmentationNetwork | None

    def __call__(self, images: dict[str, Image], size: tuple[int, int]) -> list[CalibratedFrame]:
        return [self.from_edges(id, self._edges(image), size) for id, image in images.items()]

    def _edges(self, image: Image) -> Edges:
        if self.network is None:
            return edges_of_mask(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8))
        (probability,) = self.network([image])
        return edges_of_probabilities(probability, self.network.classes, self.field)
