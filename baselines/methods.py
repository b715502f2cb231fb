"""Runs of the methods that `baselines.tables` compares, on data sets that have the input for them."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy as np

from baselines import dlt_lines, hdecomp, tvcalib
from baselines import published as paper
from baselines.chen import cameras as chen_cameras
from baselines.chen.database import Database
from baselines.chen.edges import edges_of_pixels, edges_of_probabilities
from baselines.chen.search import homography
from baselines.published import hdecomp as decomposed
from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.io.formats import ANNOTATIONS, HOMOGRAPHIES
from fieldcalib.io.image_files import Image, parse_image
from fieldcalib.io.pnlcalib import Detections, keypoint_field, parse_detections
from fieldcalib.io.soccernet import CAMERA_TYPES, UNKNOWN_LABELS, read_camera_types
from fieldcalib.io.wc14 import AlignmentName
from fieldcalib.localize import SegmentationNetwork
from fieldcalib.metrics import Prediction
from fieldcalib.problem.labelled_pixels import Pixels, check_segments
from fieldcalib.run_folder.engine import image_files
from fieldcalib.run_folder.predictions import FileReader, read_ground_truth
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.solver_options import PINHOLE_FLAGS

Homographies: TypeAlias = Sequence[Array | None]
T = TypeVar("T")

MAIN_CAMERA = "Main camera center"
ZETA, FAR_ZETA = 100.0, 1000.0  # px


@dataclass(frozen=True)
class Dataset:
    """Frames of a data set, in the order of their ids."""

    name: paper.DatasetName
    size: tuple[int, int]
    annotations: Mapping[str, Pixels]
    """Annotated pixels, including those of segments that annotators could not identify."""
    predicted: Mapping[str, Pixels] | None
    """Segments that a network found, or None."""
    homographies: Mapping[str, Homographies]
    """Homographies from the field to the image, by method."""
    types: Mapping[str, str] | None
    """Camera type of every image in the folder, or None."""
    detections: Sequence[Detections] | None = None
    """Detections of PnLCalib's networks, or None."""
    pictures: Sequence[Image] | None = None
    """Pictures of the frames in the data set's size; if given, methods that take images are run on them."""

    @property
    def frames(self) -> list[Pixels]:
        """Annotated pixels of identified segments."""
        return [{k: xy for k, xy in frame.items() if k not in UNKNOWN_LABELS} for frame in self.annotations.values()]


def read_dataset(
    name: paper.DatasetName,
    path: Path,
    size: tuple[int, int],
    *,
    predicted: Path | None = None,
    others: Mapping[str, Path] | None = None,
    detections: Path | None = None,
    pictures: Path | None = None,
) -> Dataset:
    """Read a folder of annotations, homographies beside them included.

    If ``match_info_cam_gt.json`` gives the types of the cameras, only frames of the main centre camera are read, as in
    the paper.

    Parameters
    ----------
    name : str
        Name of the data set.
    path : Path
        Folder of ``<id>.json``.
    size : (int, int)
        Width and height of its images in pixels.
    predicted : Path, optional
        Folder of ``<id>.json`` with segments that a network found.
    others : mapping of str to Path, optional
        Folders of other systems' ``<id>.homographyMatrix``, by method.
    detections : Path, optional
        Folder of ``<id>.json`` with the points and lines that PnLCalib's networks found.
    pictures : Path, optional
        Folder of ``<id>.jpg`` or ``<id>.png``, squashed or not; frames without one are left out.

    Raises
    ------
    ValueError
        If no frame has a picture, or a file is broken: tables of the other frames would not be comparable.
    """
    broken: list[str] = []
    types = read_camera_types([path]) if (path / CAMERA_TYPES).is_file() else None
    reader = FileReader(broken)
    truth = read_ground_truth(reader, path, size, soccer(), MAIN_CAMERA if types else None)
    images = {} if pictures is None else _read_pictures(pictures, truth.annotations, size, reader)
    annotations = {id: one for id, one in truth.annotations.items() if pictures is None or id in images}
    if not annotations:
        raise ValueError(f"{pictures}: expected pictures of the annotated frames, <id>.jpg or <id>.png")
    ids = list(annotations)
    homographies: dict[str, Homographies] = {}
    if truth.homographies:
        homographies[paper.ANNOTATED] = [truth.homographies.get(id) for id in ids]
    for method, folder in (others or {}).items():
        alignment: AlignmentName = "chen" if method == paper.CHEN else "jiang"
        parse = partial(HOMOGRAPHIES.read, alignment=alignment, image_size=size)
        found = reader.read(HOMOGRAPHIES.find([folder]), parse)
        homographies[method] = [found.get(id) for id in ids]
    segments = None
    if predicted is not None:
        files = ANNOTATIONS.find([predicted])
        parsed = reader.read(files, lambda content: check_segments(soccer(), ANNOTATIONS.read(content, size), size))
        segments = {id: parsed.get(id, {}) for id in ids}
    found_by_pnlcalib = None
    if detections is not None:
        files = [file for file in ANNOTATIONS.find([detections]) if file.id in annotations]
        parsed_detections = reader.read(files, lambda content: parse_detections(content, size))
        found_by_pnlcalib = [parsed_detections.get(id, Detections({}, {})) for id in ids]
    if broken:
        raise ValueError(f"broken files: {'; '.join(broken)}")
    views = None if pictures is None else list(images.values())
    return Dataset(name, size, annotations, segments, homographies, types, found_by_pnlcalib, views)


def _read_pictures(folder: Path, ids: Iterable[str], size: tuple[int, int], reader: FileReader) -> dict[str, Image]:
    """Pictures by id, in the order of `ids`, stretched to a size if they have another one."""
    import cv2

    files = [file for file in image_files([folder]) if file.id in set(ids)]
    found = reader.read(files, parse_image)
    return {id: np.asarray(cv2.resize(found[id], size, interpolation=cv2.INTER_CUBIC)) for id in ids if id in found}


@dataclass(frozen=True)
class Run:
    """Results of a method on the frames of a data set."""

    predictions: list[Prediction | None]
    losses: Array | None = None
    """Loss in NDC of each frame, NaN without a camera; None if the method has no such loss."""
    milliseconds: float | None = None
    """Time per frame, if it was measured."""

    def at(self, tau: float | None) -> list[Prediction | None]:
        """Predictions, with None where the loss is above tau."""
        if tau is None:
            return self.predictions
        assert self.losses is not None
        return [p if loss <= tau else None for p, loss in zip(self.predictions, self.losses, strict=True)]


Runs: TypeAlias = Mapping[tuple[str, paper.Segments], Run]
"""Results by method and source of the segments."""


def run_methods(dataset: Dataset, field: Field, steps: int, databases: Sequence[Database] = ()) -> Runs:
    """Run every method that the data set has the input for.

    Parameters
    ----------
    dataset : Dataset
    field : Field
    steps : int
        Number of steps of TVCalib's optimiser.
    databases : sequence of Database
        Databases for Chen and Little's method, of the same field, each with another distribution of cameras.
    """
    if dataset.pictures is not None:
        return _from_pictures(dataset, dataset.pictures, field, databases)
    runs: dict[tuple[str, paper.Segments], Run] = {}
    if dataset.detections is not None:
        detected = partial(_from_detections, keypoint_field(field), dataset.detections, dataset.size)
        what = f"{dataset.name}: {paper.OURS}, PnLCalib's detections"
        calibrations, milliseconds = _timed(what, len(dataset.detections), detected)
        runs[paper.OURS, "PnLCalib"] = Run([c.camera for c in calibrations], milliseconds=milliseconds)
    for method, homographies in dataset.homographies.items():
        runs |= _with_decomposed(method, "-", homographies, dataset)
    inputs: dict[paper.Segments, list[Pixels]] = {"GT": dataset.frames}
    if dataset.predicted is not None:
        inputs["pred"] = list(dataset.predicted.values())
    for segments, raw in inputs.items():
        frames = [check_segments(field, frame, dataset.size) for frame in raw]
        ours = partial(calibrate_batch, field, frames, dataset.size)
        calibrate_batch(field, frames[:1], dataset.size)  # compiles: not to be measured
        pinhole = partial(ours, flags=PINHOLE_FLAGS)
        theirs = partial(tvcalib.calibrate, field, frames, dataset.size, steps=steps)
        for method, calibrate in ((paper.OURS, ours), (paper.OURS_PINHOLE, pinhole), (paper.TVCALIB, theirs)):
            calibrations, milliseconds = _timed(f"{dataset.name}: {method}", len(frames), calibrate)
            losses = np.array([c.loss_ndc for c in calibrations])
            runs[method, segments] = Run([c.camera for c in calibrations], losses, milliseconds)
        by_lines = dlt_lines.homographies(field, frames, dataset.size)
        runs |= _with_decomposed(paper.DLT, segments, by_lines, dataset)
        for database in databases:
            method = _method_of(database)
            retrieve = partial(_retrieved, database, field, frames, dataset.size)
            retrieved, milliseconds = _timed(f"{dataset.name}: {method}", len(frames), retrieve)
            runs |= _with_decomposed(method, segments, retrieved, dataset, milliseconds)
    return runs


def _from_pictures(
    dataset: Dataset, pictures: Sequence[Image], field: Field, databases: Sequence[Database]
) -> dict[tuple[str, paper.Segments], Run]:
    """Run the methods that take images: fieldcalib, and Chen and Little's on markings that our network finds."""
    network = SegmentationNetwork.load()
    # scores are about the field of the given size
    ours = partial(calibrate_from_images, field, pictures, network, estimate_size=False)
    calibrate_from_images(field, pictures[:1], network)  # compiles: not to be measured
    calibrations, milliseconds = _timed(f"{dataset.name}: {paper.OURS}", len(pictures), ours)
    cameras = [c.camera if c.accepted else None for c in calibrations]
    runs: dict[tuple[str, paper.Segments], Run] = {
        (paper.OURS, "images"): Run(list(cameras), milliseconds=milliseconds)
    }
    for database in databases:
        method = _method_of(database)
        retrieve = partial(_retrieved_from_pictures, database, field, pictures, network)
        retrieved, milliseconds = _timed(f"{dataset.name}: {method}", len(pictures), retrieve)
        runs[method, "images"] = Run(list(retrieved), milliseconds=milliseconds)
        runs[decomposed(method), "images"] = _decompose(retrieved, dataset, ZETA)
    return runs


def _retrieved_from_pictures(
    database: Database, field: Field, pictures: Sequence[Image], network: SegmentationNetwork
) -> list[Array | None]:
    found = []
    for picture in pictures:
        (probability,) = network([picture])
        edges = edges_of_probabilities(probability, network.classes, field)
        found.append(homography(database, edges, (picture.shape[1], picture.shape[0])))
    return found


def _from_detections(field: Field, detections: Sequence[Detections], size: tuple[int, int]) -> list[Calibration]:
    frames = [check_segments(field, one.image_segments, size) for one in detections]
    return calibrate_batch(field, frames, size, weights=[one.weights for one in detections])


def _method_of(database: Database) -> str:
    return paper.CHEN if database.distribution == chen_cameras.CHEN else paper.CHEN_WIDER


def _retrieved(database: Database, field: Field, frames: Sequence[Pixels], size: tuple[int, int]) -> list[Array | None]:
    return [homography(database, edges_of_pixels(field, frame, size), size) for frame in frames]


def _with_decomposed(
    method: str,
    segments: paper.Segments,
    homographies: Homographies,
    dataset: Dataset,
    milliseconds: float | None = None,
) -> dict[tuple[str, paper.Segments], Run]:
    """The homographies of a method, and the cameras that they are decomposed into, with both limits of distances."""
    return {
        (method, segments): Run(list(homographies), milliseconds=milliseconds),
        (decomposed(method), segments): _decompose(homographies, dataset, ZETA),
        (decomposed(method) + paper.FAR, segments): _decompose(homographies, dataset, FAR_ZETA),
    }


def _decompose(homographies: Homographies, dataset: Dataset, zeta: float) -> Run:
    return Run([c.camera for c in hdecomp.calibrate(homographies, dataset.size, zeta=zeta)])


def _timed(what: str, count: int, method: Callable[[], T]) -> tuple[T, float]:
    """Run a method on some frames; returns its result and the milliseconds per frame."""
    print(f"{what}, {count} frames", file=sys.stderr)
    began = time.perf_counter()
    result = method()
    return result, 1e3 * (time.perf_counter() - began) / max(count, 1)
