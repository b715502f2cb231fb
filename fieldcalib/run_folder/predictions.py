"""Reading of predictions and ground truth: cameras or homographies of any tool, and annotations to score them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.files import MOST_BYTES, BrokenFileError, FrameFile, named_in_errors, read_regular_file
from fieldcalib.io.formats import ANNOTATIONS, CAMERAS, HOMOGRAPHIES, RECORDS, Format, frames_in, parse_frame
from fieldcalib.io.frame_source import read_each
from fieldcalib.io.results import ResultFile, lines_file
from fieldcalib.io.soccernet import read_camera_types
from fieldcalib.io.tvcalib import TVCalibRecord
from fieldcalib.io.wc14 import IMAGE_SIZE
from fieldcalib.metrics import Prediction
from fieldcalib.metrics.accuracy import check_annotation
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.processes.jobs import in_order
from fieldcalib.run_folder.labelled_frames import name_left_out
from fieldcalib.run_folder.record import RunRecord, camera_content
from fieldcalib.run_folder.work_units import units_of

OFF_CENTRE = 0.1  # of the image's size: if the sizes differ by more, the camera was made for images of another size
LARGEST_SIZE = 100_000  # px: a principal point beyond does not indicate the size of an image
READ_AT_ONCE = 256  # files that one process reads at a time
MOST_PIXELS = 20_000  # of an annotation: their distances to projected segments take 200 MB
SEVERAL_SIZES = "the predictions are for images of several sizes: say by --size which one the annotations have"

Parsed = TypeVar("Parsed")


@dataclass(frozen=True)
class Predictions:
    """Cameras or homographies by frame."""

    by_frame: Mapping[str, Prediction]
    size: tuple[int, int]
    """Size of the images for which they are scored."""
    files: Sequence[FrameFile] = ()
    """Files in folders and zips from which they were read."""
    made_for: tuple[int, int] | None = None
    """Size of the images from which they were calibrated, if a run has recorded it."""
    line_width: float | None = None
    """Width of the lines, in metres, whose middles a run took as markings, if one has recorded it."""

    @property
    def of_other_sizes(self) -> list[tuple[int, int]]:
        """Sizes of images for which cameras were made, as far as they differ from `size`."""
        cameras = [p for p in self.by_frame.values() if isinstance(p, Camera)]
        made_for = {natural_size(p) for p in cameras} if self.made_for is None else {self.made_for}
        size = np.array(self.size)
        return sorted(s for s in made_for if s and np.any(np.abs(s - size) > OFF_CENTRE * size))


def natural_size(camera: Camera) -> tuple[int, int] | None:
    """Size of the image whose centre is the principal point, in even numbers; a camera file has no size of its own."""
    centre = camera.K[:2, 2]
    if not np.all((centre > 0.0) & (centre < LARGEST_SIZE)):
        return None
    width, height = (2.0 * np.floor(centre + 0.5)).astype(int).tolist()
    return width, height


@dataclass(frozen=True)
class FileReader:
    """Reads files, by several processes if there is an executor, and collects messages about broken ones."""

    broken: list[str]
    """Messages about files that cannot be read, added by reading."""
    most_bytes: float = MOST_BYTES
    executor: Executor | None = None

    def read(self, files: Sequence[FrameFile], parse: Callable[[bytes], Parsed]) -> dict[str, Parsed]:
        """Parse the content of files, by frame."""
        return self.parse(files, partial(_parsed, parse=parse, most_bytes=self.most_bytes))

    def parse(self, files: Sequence[FrameFile], parse: Callable[[FrameFile], Parsed]) -> dict[str, Parsed]:
        """Parse files, by frame."""
        found: dict[str, Parsed] = {}
        units = list(units_of(files, READ_AT_ONCE))
        results = in_order(self.executor, partial(read_each, read=parse), units)
        for unit, (parsed, broken) in zip(units, results, strict=True):
            found |= parsed
            self.broken.extend(f"{file.path}: {broken[file.id]}" for file in unit if file.id in broken)
        return found


def _parsed(file: FrameFile, *, parse: Callable[[bytes], Parsed], most_bytes: float) -> Parsed:
    return parse(file.read(most_bytes))


def read_predictions(
    reader: FileReader, path: Path, size: tuple[int, int] | None = None, *, homographies: bool = False
) -> Predictions:
    """Read cameras of a folder, a zip or a TVCalib output; homographies if requested or if there are no cameras.

    Cameras are taken as they are. Homographies are scaled to `size` if the size of their images is known. Frames whose
    files are broken have no prediction.

    Raises
    ------
    ValueError
        If there is no prediction, or if no size is given and the predictions do not agree on one.
    """
    files: Sequence[FrameFile] = ()
    size_of_run = line_width = None
    of_cameras = partial(CAMERAS.read, image_size=size or IMAGE_SIZE)
    if path.is_file() and RECORDS.recognises(path):
        found, own_size = _read_tvcalib(reader, path, size, homographies=homographies)
    elif not homographies and not HOMOGRAPHIES.recognises(path) and (files := _files(CAMERAS, path)):
        cameras = reader.read(files, of_cameras)
        found = dict(cameras)
        size_of_run, line_width = _run_of(path)
        own_size = size_of_run or _only({natural_size(camera) for camera in cameras.values()})
    elif not homographies and lines_file(path).is_file() and not _files(HOMOGRAPHIES, path):
        size_of_run, line_width = _run_of(path)
        own_size = size_of_run
        found = {id: of_cameras(content) for id, content in _cameras_of_run(path)}
    else:
        files, own_size = _homography_files(path, homographies=homographies), size or IMAGE_SIZE
        found = dict(reader.read(files, partial(HOMOGRAPHIES.read, image_size=own_size)))
    if not found:
        raise ValueError(f"{path} holds no prediction that can be evaluated")
    if size is None and own_size is None:
        raise ValueError(SEVERAL_SIZES)
    return Predictions(found, size or own_size or IMAGE_SIZE, files, size_of_run, line_width)


def _files(form: Format[Any, Any], path: Path) -> list[FrameFile]:
    """Find files of a format; [] if an existing folder or zip has none."""
    try:
        return form.find([path])
    except FileNotFoundError:
        if not path.exists():
            raise
        return []


def _cameras_of_run(path: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the cameras of a run by frame, each as the content of its file."""
    record = RunRecord.read(path)
    for line in ResultFile(lines_file(path)).mains():
        if record is not None and record.keeps(line):
            yield line["id"], camera_content(line)


def _run_of(path: Path) -> tuple[tuple[int, int] | None, float | None]:
    """Size of the images of a run and width of the lines of its field; each None if there is no run, or several."""
    if not lines_file(path).is_file():
        return None, None
    sizes: set[tuple[int, int] | None] = set()
    widths: set[float | None] = set()
    for line in ResultFile(lines_file(path)).mains():
        if line.get("image_size"):
            sizes.add((int(line["image_size"][0]), int(line["image_size"][1])))
        if line.get("field"):
            widths.add(line["field"].get("line_width") or 0.0)
    return _only(sizes), widths.pop() if len(widths) == 1 else None


def _homography_files(path: Path, *, homographies: bool) -> list[FrameFile]:
    """Find files of homographies, if these are requested or there are no cameras."""
    files = HOMOGRAPHIES.find([path]) if homographies else _files(HOMOGRAPHIES, path)
    if not files:
        raise FileNotFoundError(
            f"{path} holds no prediction: expected {CAMERAS.file_name('<id>')}, {HOMOGRAPHIES.file_name('<id>')}, what "
            f"run or calibrate wrote, or TVCalib's per_sample_output.json itself"
        )
    return files


def _read_tvcalib(
    reader: FileReader, path: Path, size: tuple[int, int] | None, *, homographies: bool
) -> tuple[dict[str, Prediction], tuple[int, int] | None]:
    """Read the predictions of a per_sample_output.json, and the size of their images."""
    lines: list[str] = []
    with named_in_errors(path):
        records = RECORDS.read(read_regular_file(path, reader.most_bytes), broken=lines)
    reader.broken.extend(f"{path}: {line}" for line in lines)
    twice = [id for id, count in Counter(record.id for record in records).items() if count > 1]
    if twice:
        raise BrokenFileError(f"{path}: frame {twice[0]} has several records")
    cameras = {r.id: r.camera for r in records if r.camera is not None}
    if cameras and not homographies:
        return dict(cameras), _only({natural_size(camera) for camera in cameras.values()})
    maps = [record for record in records if record.homography is not None]
    return {r.id: _scaled(r, size) for r in maps}, _only({r.image_size for r in maps})


def _scaled(record: TVCalibRecord, size: tuple[int, int] | None) -> Array:
    """Scale the homography of a record to images of another size, if the size of its own images is known."""
    assert record.homography is not None
    if size is None or record.image_size is None:
        return record.homography
    return np.asarray(np.diag([*np.divide(size, record.image_size), 1.0]) @ record.homography)


def _only(sizes: set[tuple[int, int] | None]) -> tuple[int, int] | None:
    """The only one of some sizes; None if there are several, or none."""
    return sizes.pop() if len(sizes) == 1 else None


@dataclass(frozen=True)
class GroundTruth:
    """Annotations and homographies of the frames of a data set."""

    annotations: Mapping[str, Pixels]
    homographies: Mapping[str, Array]
    """Homographies from the field to the image, of the frames that have one."""
    share: float = 1.0
    """Share of the data set's frames that were chosen, broken ones included."""
    files: Sequence[FrameFile] = ()
    """All files of the data set, also frames of other camera types."""


def read_ground_truth(
    reader: FileReader, path: Path, size: tuple[int, int], field: Field, camera_type: str | None = None
) -> GroundTruth:
    """Read annotations of a folder or a zip, and homographies that lie beside them.

    With `camera_type`, only frames from cameras of this type, according to match_info_cam_gt.json.
    """
    found = frames_in(ANNOTATIONS.find([path]), known=field, most_bytes=reader.most_bytes)
    name_left_out(found, field)
    files = found.frames
    beside = [file for file in _files(HOMOGRAPHIES, path) if file.path != path]  # none for a single annotation
    chosen = files
    if camera_type is not None:
        types = read_camera_types([path])
        chosen = [file for file in files if types.get(file.id) == camera_type]
        if not chosen:
            raise ValueError(f"no frame is of type {camera_type!r}; there are {', '.join(sorted(set(types.values())))}")
    ids = {file.id for file in chosen}
    parse = partial(_annotation, field=field, size=size, most_bytes=reader.most_bytes)
    annotations = reader.parse(chosen, parse)
    scored = [file for file in beside if file.id in ids]
    homographies = reader.read(scored, partial(HOMOGRAPHIES.read, image_size=size))
    return GroundTruth(annotations, homographies, len(chosen) / len(files), [*files, *beside])


def _annotation(file: FrameFile, *, field: Field, size: tuple[int, int], most_bytes: float) -> Pixels:
    pixels = parse_frame(file, size, most_bytes=most_bytes, unknown=True).pixels
    count = sum(map(len, pixels.values()))
    if count > MOST_PIXELS:
        raise BrokenFileError(f"has {count} labelled pixels: up to {MOST_PIXELS} are evaluated")
    return check_annotation(pixels, field)
