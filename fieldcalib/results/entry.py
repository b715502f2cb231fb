"""The entry points `fieldcalib.calibrate`, from any input to its cameras, and `fieldcalib.read`, for saved results.

The kinds of input that `fieldcalib.calibrate` takes, and how each is calibrated.
"""

from __future__ import annotations

import glob
import os
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._progress import Progress, progress_bar, solving
from fieldcalib._types import expect, file_path, is_number, named, number, truth
from fieldcalib.assess.result import Calibration, in_picture
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.fields.catalogue import AUTO
from fieldcalib.fields.catalogue import field as field_named
from fieldcalib.fields.field import Field, Side
from fieldcalib.geometry.camera import checked_image_size
from fieldcalib.images.clip.from_video import calibrate_clip
from fieldcalib.images.from_images import How, Mount
from fieldcalib.images.search.stored_cameras import StoredCameras
from fieldcalib.io.annotations import Annotation
from fieldcalib.io.clips import SOLVING, ClipInput, part_of_frame
from fieldcalib.io.field_files import is_field_file, read_field
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.formats import are_annotations
from fieldcalib.io.frame_range import WHOLE, Cut, Position
from fieldcalib.io.frame_source import ArrayFrames, Frame, ReadImage, is_clip, is_video, pixels_of, read_each, videos_in
from fieldcalib.io.image_files import IMAGES_AT_ONCE, Image, checked_image, in_parts
from fieldcalib.io.results import lines_file
from fieldcalib.io.streams import Stream, StreamReader
from fieldcalib.localize import Network
from fieldcalib.problem.labelled_pixels import ImageSegments, Pixels, check_segments, thinned
from fieldcalib.problem.picture_shape import Crop
from fieldcalib.processes.jobs import in_order
from fieldcalib.results.collection import Results
from fieldcalib.results.frames import EQ3, Collected, KeptFrames, Pictures, StoredFrames, auto_field
from fieldcalib.run_folder.clip_results import read_clip
from fieldcalib.run_folder.engine import calibrate_images, live_tracker, tracked
from fieldcalib.run_folder.labelled_frames import AnnotationReader, paper_losses
from fieldcalib.run_folder.record import RECORD, RunRecord
from fieldcalib.run_folder.results import CLIP
from fieldcalib.run_folder.work_units import grouped, unit_size, units_of
from fieldcalib.solve.batch import calibrate_labels
from fieldcalib.solve.field_size import of_size, shared_size
from fieldcalib.solve.likelier_shape import with_likely_aspect
from fieldcalib.solve.request import GivenCamera, Task
from fieldcalib.solve.solver_options import ALL, Prior

PathLike: TypeAlias = str | os.PathLike[str]
Labels: TypeAlias = ImageSegments | Annotation
Labelling: TypeAlias = tuple[Pixels, tuple[int, int]]  # checked pixels, and the size of their picture
Source: TypeAlias = (
    PathLike | Image | Iterable[Image] | Sequence[PathLike] | Labels | Mapping[str, Labels] | Sequence[Labels]
)
Time: TypeAlias = str | float | None
EXPECTED = (
    "expected a path, pictures (uint8 arrays, one, a list or an iterator) or labelled pixels (a mapping of labels to "
    "pixels, or several)"
)


def calibrate(
    source: Source,
    field: str | Field = "soccer",
    *,
    start: Time = None,
    end: Time = None,
    step: int = 1,
    clip: bool | None = None,
    rgb: bool = False,
    image_size: tuple[int, int] | None = None,
    crop_of: str | None = None,
    network: Network | None = None,
    camera_matrix: ArrayLike | None = None,
    dist_coeffs: ArrayLike | None = None,
    rvec: ArrayLike | None = None,
    tvec: ArrayLike | None = None,
    flags: int | None = None,
    prior: Prior = ALL,
    camera: Mount = "tripod",
    side: Side | None = None,
    estimate_size: bool = True,
    same_camera: Mapping[str, Calibration] | PathLike | None = None,
    progress: Progress = True,
    executor: Executor | None = None,
) -> Results:
    """Calibrate the cameras of pictures, of a clip, or of labelled pixels.

    The frames of a video are calibrated together (`calibrate_video`), pictures one by one (`calibrate_from_images`), as
    `fieldcalib run` does; labelled pixels as `fieldcalib calibrate` does. Files that cannot be read are in
    `Results.broken`, unless none can.

    Parameters
    ----------
    source : path, pictures or labelled pixels
        One of

        * the path of a video, a picture, a folder or a zip of pictures, a pattern of paths (``"match/*.jpg"``), or a
          list of paths;
        * a (height, width, 3) uint8 array in blue, green, red, a picture of PIL, a list of them, or an iterator;
        * a ``cv2.VideoCapture``, whose frames are calibrated one by one;
        * labelled pixels, a mapping of labels to (N, 2) pixels, several of them in a list or by id, or what
          `read_annotations` reads, or the path of that, or a list of these;
        * a URL, or ``"-"`` for standard input, up to `end`. To calibrate frames as they come, use `Tracker`.
    field : str or Field
        The name of a sport (`fieldcalib.fields.catalogue.FIELDS`), a file with a field of one's own, a `Field`, or
        ``"auto"``: sports are tried on some of the pictures, and the best one is taken if no other explains them
        about as well (`fieldcalib.images.which_field.which_field`). The size of a field in pictures is estimated from
        them, unless it is declared known (`Field.size_known`).
    start, end : str or float, optional
        The first frame, and the one after the last: seconds, ``"1:30"``, or the number of a frame, ``"750f"``.
    step : int
        Take every n-th frame only.
    clip : bool, optional
        Whether pictures are a clip whose frames are calibrated together. By default a video is one, pictures are not.
    rgb : bool
        Whether arrays are in red, green, blue.
    image_size : (int, int), optional
        Width and height of the pictures in which pixels were labelled, if the labels do not have it.
    crop_of : str, optional
        The part of their frames that pictures show, ``"1920x1080+960+0"``: the size of the frames, and where the upper
        left corners of the pictures are. Their own size with ``+0+0`` says that nothing is cut off.
    network : Network, optional
        Finds the markings in pictures; by default the one that comes with the package, for soccer. Courts of other
        fields are found by search (`fieldcalib.images.find_courts`).
    camera_matrix, dist_coeffs, rvec, tvec, flags, prior
        What is known of the camera, as in `calibrate_from_segments`.
    camera : {"tripod", "moving"}
        How the camera of a clip is carried, see `calibrate_video`.
    side : {"main", "opposite"}, optional
        The side of the field that the camera of pictures is on, as in `calibrate_from_images`; labelled pixels name it.
    estimate_size : bool
        Whether size and ground of the field are estimated from pictures and clips, or stay as given.
    same_camera : Results or path, optional
        Earlier results of the cameras of some of the pictures, or their folder. Pictures are recognised as those of a
        good camera there by their paint, which takes milliseconds, also if it has moved by some pixels since; the
        reason says of which frame, and by how much. Other pictures are calibrated as usual.
    progress : bool or function
        True shows a bar on a terminal and in a notebook, and prints a line every ten seconds elsewhere. A function is
        called with the number of frames that are done, how many there are (None if that is not known), and the stage;
        an error that it raises ends the work.
    executor : concurrent.futures.Executor, optional
        Works on pictures, labelled pixels and the parts of a long clip, e.g. `fieldcalib.processes.Processes`, or the
        executor of a cluster (dask's ``Client.get_executor()``); other processes must be able to read the files, and to
        import the classes of the arguments. The results are the same.

    Returns
    -------
    Results
        A mapping of ids to `Calibration`: names of files without ending, numbers of frames with six digits for videos
        and arrays.

    Raises
    ------
    FileNotFoundError, BrokenFileError
        If there is no input, or a video or every picture cannot be read.
    ValueError
        If the source is none of these, or a stream without an `end`; or as the functions above.

    Examples
    --------
    >>> import fieldcalib
    >>> results = calibrate(fieldcalib.sample("picture"), progress=False)  # or a path of yours
    >>> str(results[0].verdict), results[0].image_to_field([480, 300]).round()[:2]  # metres
    ('good', array([-18.,  15.]))

    A black picture has no camera:

    >>> import numpy as np
    >>> results = calibrate(np.zeros((540, 960, 3), np.uint8), progress=False)
    >>> str(results.verdicts["000000"])
    'reject'
    """
    taken = input_of(source, _cut(start, end, step), clip, image_size, rgb=truth(rgb, "rgb"))
    if isinstance(field, str) and field == AUTO:
        field = auto_field(pictures_of(taken), progress=progress)
    task = Task(_field(field), GivenCamera(camera_matrix, dist_coeffs, rvec, tvec), flags, prior=prior)
    part = None if crop_of is None else Crop.parse(crop_of)
    how = How(task, network, side, camera=camera, estimate_size=estimate_size).of_part(part)
    if same_camera is not None:
        if not isinstance(taken, OneByOne):
            raise ValueError("same_camera is of pictures: leave it out for clips, streams and labelled pixels")
        earlier = same_camera if isinstance(same_camera, Mapping) else read(same_camera)
        how = replace(how, stored=StoredCameras.of(earlier, _field(field), side))
    options = {"field": field if isinstance(field, str) else repr(field), "step": step, "prior": str(prior)}
    options |= {name: str(_position(one)) for name, one in (("start", start), ("end", end)) if one is not None}
    options |= {} if part is None else {"crop_of": str(part)}
    return replace(taken.calibrate(how, progress, executor), options=options)


def calibrate_rig(sources: Mapping[str, Source], field: str | Field = "soccer", **options: Any) -> dict[str, Results]:
    """Calibrate several cameras of one field, which share its size and its ground.

    Each is calibrated by itself, on a field of its own size, then the size and the ground are estimated from all of
    them together, and each is calibrated once more on that field. The error of its size is in the errors of all
    cameras, which have it in common (`fieldcalib.assess.joint_covariance`). `fieldcalib.assess.triangulate` gives
    points in space from them. Clips estimate the size of their field each by itself.

    Parameters
    ----------
    sources : mapping of str to a source of `calibrate`
        Pictures, clips or labelled pixels of each camera, by its name.
    field : str or Field
        As in `calibrate`. The size of a field that is known stays.
    options
        Further arguments of `calibrate`, for all cameras.

    Raises
    ------
    FileNotFoundError, BrokenFileError, ValueError
        As `calibrate`.

    Examples
    --------
    >>> import fieldcalib
    >>> field = fieldcalib.soccer()
    >>> def labelled(pan, x):
    ...     camera = fieldcalib.Camera.from_angles(pan, 1.35, 0.0, 700.0, (x, 62.0, -15.0), (960, 540))
    ...     return {label: camera.project(one.sample(4.0)) for label, one in field.items() if "rect" in label}
    >>> pixels = {"left": labelled(-0.4, -15.0), "right": labelled(0.4, 15.0)}
    >>> rig = calibrate_rig(pixels, image_size=(960, 540), progress=False)
    >>> list(rig), rig["left"][0].field == rig["right"][0].field
    (['left', 'right'], True)
    """
    given, each = _field(field), expect(sources, Mapping, '{"left": "left.mp4", "right": "right.mp4"}')
    alone = [calibrate(one, given, **options) for one in each.values()]
    found = shared_size(given, [one for results in alone for one in results.values()])
    shown = given if given.size_known else replace(found.field, size_known=found.is_told)
    own = [{**options, "estimate_size": results.video is not None} for results in alone]
    rig = {name: calibrate(one, shown, **some) for (name, one), some in zip(each.items(), own, strict=True)}
    if not given.size_known:
        for name, results in rig.items():
            if isinstance(results.frames, KeptFrames):
                with_size = results.frames.changed(lambda one: of_size(one, shown, found.covariance))
                rig[name] = replace(results, frames=with_size)
    return rig


def _field(field: object) -> Field:
    """Find the field that a user gives.

    Raises
    ------
    ValueError
        If it is neither a field nor the name or the file of a field.
    """
    if isinstance(field, Field):
        return field
    if isinstance(field, str):
        return read_field(field) if is_field_file(field) else field_named(field)
    expected = "expected a Field, as fieldcalib.soccer() or Field(length, width, mapping), or the name of a sport"
    raise ValueError(f"{expected}, got {named(field)}")


def _position(time: str | float) -> Position:
    return Position.parse(time if isinstance(time, str) else f"{number(time, 'a time in seconds'):.6f}")


def _cut(start: Time, end: Time, step: int) -> Cut:
    """Part of the input that a user asks for; a ValueError if it is invalid."""
    if not is_number(step) or not 1 <= step < float("inf") or step != int(step):
        raise ValueError(f"step must be a whole number from 1, got {step!r}")
    first = Position(frame=0) if start is None else _position(start)
    return Cut(first, None if end is None else _position(end), int(step))


def read(folder: str | os.PathLike[str]) -> Results:
    """Read the results that `fieldcalib run`, `fieldcalib calibrate` or `Results.save` wrote to a folder.

    Parameters
    ----------
    folder : path
        A folder with a ``cameras.jsonl`` or ``cameras.parquet``, or the path of that file. Its frames are parsed when
        they are accessed, so that an hour of video opens in a second.

    Returns
    -------
    Results
        A mapping of ids to `Calibration`. An unfinished run has the frames that are done.

    Warns
    -----
    UserWarning
        If the last line is incomplete.

    Raises
    ------
    FileNotFoundError
        If there is neither.
    ImportError
        If it is a ``cameras.parquet`` and pyarrow is not installed.
    BrokenFileError
        If a line is no result, or of another version; the message begins with file and line. Only the beginnings of
        lines are checked at once; errors in the rest are raised when the frame is accessed.

    Examples
    --------
    >>> import json, tempfile
    >>> line = {"id": "00001", "status": "broken file", "message": "is no JSON"}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = (Path(folder) / "cameras.jsonl").write_text(json.dumps(line))
    ...     results = read(folder)
    ...     len(results), results.broken
    (0, {'00001': 'is no JSON'})
    """
    path = file_path(folder, "a folder of results")
    if path.is_dir():
        path = lines_file(path)
    frames = StoredFrames(path)
    if frames.is_cut:
        _warn(f"{path}: its last line is incomplete and is left out: is a run still writing it, or was it cut off?")
    home = path.parent
    record, clip = RunRecord.read(home), home / CLIP
    options: Mapping[str, Any] = {} if record is None else record.options
    return Results(
        frames,
        Pictures() if record is None else _pictures(record, home, is_clip=clip.is_file()),
        partial(read_clip, clip) if clip.is_file() else None,
        "run" if record is None else record.command,
        options,
        home,
    )


def _pictures(record: RunRecord, home: Path, *, is_clip: bool) -> Pictures:
    """Find the pictures of a run from its record."""
    start, end = (record.options.get(name) for name in ("start", "end"))
    try:
        begin, stop = Position.parse(start or "0f"), None if end is None else Position.parse(end)
    except ValueError as error:
        raise BrokenFileError(f"{home / RECORD}: {error}") from None
    cut = Cut(begin, stop, record.options.get("step") or 1)
    return Pictures(tuple(map(Path, record.source)), cut=cut, is_clip=is_clip)


class Input(Protocol):
    """Input that can be calibrated."""

    def calibrate(self, how: How, progress: Progress, executor: Executor | None = None) -> Results:
        """Calibrate the whole input; `how` has the network that the user gives, if any."""


def input_of(
    source: object, cut: Cut, clip: bool | None, image_size: tuple[int, int] | None, *, rgb: bool = False
) -> Input:
    """Recognise the kind of a source of `fieldcalib.calibrate`; a ValueError if it is none of them."""
    labels, image_size = _labels_in(source), None if image_size is None else checked_image_size(image_size)
    if labels is not None:
        if cut != WHOLE or clip is not None:
            raise ValueError("start, end, step and clip are of pictures: leave them out for labelled pixels")
        return Labelled(labels, image_size)
    if image_size is not None:
        raise ValueError("image_size is of labelled pixels (io.read_annotations): pictures have a size, leave it out")
    if isinstance(source, str) and Stream.recognises(source):
        if cut.end is None or clip is not None:
            raise ValueError(
                f"{Stream(source)} is a stream, which may have no end: give end= to calibrate a part of it, without "
                f"clip, or use Tracker for frames as they come"
            )
        return LiveStream(Stream(source), cut)
    if isinstance(source, str | os.PathLike):
        return _files(_paths(source), cut, clip)
    if isinstance(source, np.ndarray):
        source = [source] if source.ndim < 4 else list(source)
    if isinstance(source, Sequence) and len(source) and all(isinstance(one, str | os.PathLike) for one in source):
        return _files([file_path(one, "a picture") for one in source], cut, clip)
    if hasattr(source, "getbands"):  # a picture of PIL
        source = [source]
    if isinstance(source, Sequence):
        return _arrays([_in_bgr(one) for one in source] if rgb else source, cut, clip)
    if hasattr(source, "retrieve"):  # a cv2.VideoCapture
        source = _captured(source)
    if source is None:
        checked_image(source)  # it is what cv2.imread returns for a file that is not there
    if not isinstance(source, Iterable):
        raise ValueError(f"{EXPECTED}, got {source!r}")
    if clip:
        raise ValueError("the frames of a clip are read several times, an iterator only once: give a list or a path")
    return OneByOne(Pictures(cut=cut), map(_in_bgr, source) if rgb else source)


def _in_bgr(image: Any) -> Image:
    """A picture in blue, green, red, of an array in red, green, blue or a picture of PIL."""
    array = checked_image(image)
    return array[..., ::-1] if isinstance(image, np.ndarray) else array


def _captured(video: Any) -> Iterator[Image]:
    """Frames of a cv2.VideoCapture from where it is."""
    if not video.isOpened():
        raise ValueError("the cv2.VideoCapture is not open: is its path or its camera there?")
    while (frame := video.read())[0]:
        yield frame[1]


def _check_no_clip(how: How) -> None:
    """Raise a ValueError for an option that is of clips."""
    if how.camera != "tripod":
        raise ValueError("camera is of clips: give a video, or clip=True with pictures")


def pictures_of(input: Input) -> Pictures:
    """Pictures of an input, if they can be read several times; otherwise a ValueError."""
    if isinstance(input, Clip) or (isinstance(input, OneByOne) and input.iterator is None):
        return input.pictures
    raise ValueError("the field is found in pictures that can be read twice: name it, or give a list or a path")


def _labels_in(source: object) -> Mapping[str, Labels] | list[Path] | None:
    """Labelled pixels by id, or the paths of annotations; None if the source is something else."""
    several = source if isinstance(source, Sequence) and not isinstance(source, str) else [source]
    if len(several) and all(isinstance(one, str | os.PathLike) for one in several):
        paths = [file_path(one, "a picture, a folder or a video") for one in several if str(one)]
        return paths if paths and all(path.exists() and are_annotations(path) for path in paths) else None
    if isinstance(source, Annotation):
        return {source.id: source}
    if isinstance(source, Mapping):
        if source and all(isinstance(one, Mapping | Annotation) for one in source.values()):
            return dict(source)
        return {"000000": source}
    if isinstance(source, Sequence) and len(source) and all(isinstance(one, Mapping | Annotation) for one in source):
        return {f"{number:06d}": one for number, one in enumerate(source)}
    return None


def _paths(source: str | os.PathLike[str]) -> list[Path]:
    """Expand a path or a pattern to paths."""
    if not os.fspath(source):
        raise ValueError("the path is empty: expected that of a picture, a folder or a video; '.' is this folder")
    path = file_path(source, "a picture, a folder or a video")
    if path.exists() or not glob.has_magic(str(source)):
        return [path]
    found = sorted(map(Path, glob.glob(str(source), recursive=True)))
    if not found:
        raise FileNotFoundError(f"there is no file named {source}")
    return found


def _files(paths: Sequence[Path], cut: Cut, clip: bool | None) -> Input:
    """Make the input from some paths, a clip or pictures, as `fieldcalib run` does."""
    found = [Path(str(part)) for path in paths for part in videos_in(path)]
    videos = [path for path in found if is_video(path)]
    if videos and len(found) > 1:
        raise ValueError(
            f"there are {len(videos)} videos, as {videos[0].name}: calibrate them one by one, or with fieldcalib run"
        )
    together = is_clip(found[0], together=bool(clip), alone=clip is False)
    pictures = Pictures(tuple(found), cut=cut, is_clip=together)
    return Clip(pictures) if together else OneByOne(pictures)


def _arrays(images: Sequence[Image], cut: Cut, clip: bool | None) -> Input:
    """Make the input from pictures in memory."""
    if not len(images):
        raise ValueError(f"{EXPECTED}, got nothing")
    checked_image(images[0])
    pictures = Pictures(images=images, cut=cut, is_clip=bool(clip))
    return Clip(pictures) if clip else OneByOne(pictures)


@dataclass(frozen=True, eq=False)
class Labelled:
    """Labelled pixels by id, or the path of annotations; each frame is calibrated by itself."""

    labels: Mapping[str, Labels] | Sequence[Path]
    image_size: tuple[int, int] | None
    """Size of the pictures, if the user gives it."""

    def calibrate(self, how: How, progress: Progress, executor: Executor | None = None) -> Results:
        """Calibrate all of it."""
        if how.side is not None:
            raise ValueError("side is of pictures: labelled pixels name the ends of the field, leave it out")
        if how.part is not None:
            raise ValueError("crop_of is of pictures: add its corner to labelled pixels, with the frame's image_size")
        _check_no_clip(how)
        field = how.task.field
        assert field is not None  # `fieldcalib.calibrate` makes it
        (ids, frames, broken), collected = self._frames(field), Collected()
        method = partial(calibrate_labels, how.task, executor=executor)
        with progress_bar(unit="frame", total=len(ids), progress=progress) as bar:
            for unit in units_of(ids, unit_size(len(ids))):
                found: dict[str, Calibration] = {}
                losses: dict[str, float] = {}
                for size, some in grouped([id for id in unit if id in frames], lambda id: frames[id][1]).items():
                    pixels = {id: frames[id][0] for id in some}
                    labels, is_estimated = list(pixels.values()), how.task.given.camera_matrix is None
                    calibrations = with_likely_aspect(field, method, labels, size, estimated=is_estimated)
                    losses |= paper_losses(field, pixels, calibrations)
                    found |= zip(some, calibrations, strict=True)
                for id in unit:
                    if id in broken:
                        collected.add_broken(id, broken[id])
                    else:
                        collected.add(id, found[id], **({EQ3: losses[id]} if id in losses else {}))
                bar.update(len(unit))
        where = "" if isinstance(self.labels, Mapping) or len(self.labels) > 1 else f"{self.labels[0]}: "
        return Results(_readable(collected, {id: f"{where}{id}" for id in broken}), command="calibrate")

    def _frames(self, field: Field) -> tuple[list[str], Mapping[str, Labelling], Mapping[str, str]]:
        """Ids of the frames, pixels of each and the size of its picture, and what is wrong with the files of others."""
        if isinstance(self.labels, Mapping):
            return list(self.labels), {id: self._frame(id, one, field) for id, one in self.labels.items()}, {}
        reader = AnnotationReader(field, self.image_size)
        files = reader.find(self.labels)
        return [file.id for file in files], *read_each(files, reader.read)

    def _frame(self, id: str, labels: Labels, field: Field) -> Labelling:
        """Check the pixels of a frame; also returns the size of its picture."""
        pixels, size = (labels.pixels, labels.image_size) if isinstance(labels, Annotation) else (labels, None)
        size = self.image_size or size
        if size is None:
            raise ValueError("labelled pixels do not say the size of their pictures: give image_size=(width, height)")
        try:
            return thinned(check_segments(field, pixels, size)), size
        except ValueError as error:
            raise ValueError(f"frame {id}: {error}") from error


@dataclass(frozen=True, eq=False)
class OneByOne:
    """Pictures that are calibrated one by one: of files, of a video, in memory, or of an iterator."""

    pictures: Pictures
    iterator: Iterable[Image] | None = None
    """Images that can be read only once; None if `pictures` has them."""

    def calibrate(self, how: How, progress: Progress, executor: Executor | None = None) -> Results:
        """Calibrate all of it."""
        _check_no_clip(how)
        how, collected = how.with_network(), Collected()
        frames, total = self._frames(how.part)
        with progress_bar(unit="frame", total=total, progress=progress) as bar:
            parts = in_parts(frames, IMAGES_AT_ONCE, pixels_of)
            for part, calibrations in in_order(executor, partial(_calibrated, how), parts):
                found = iter(calibrations)
                for frame in part:
                    if frame.problem:
                        collected.add_broken(frame.id, frame.problem)
                    else:
                        collected.add(frame.id, next(found))
                bar.update(len(part))
        if not collected.ids:
            raise ValueError(f"{EXPECTED}, got nothing")
        return Results(_readable(collected, {file.id: file.path.name for file in self.pictures.files}), self.pictures)

    def _frames(self, part: Crop | None) -> tuple[Iterator[Frame], int | None]:
        """Open the frames; also returns how many there are, None if unknown."""
        if self.iterator is not None:
            numbers = self.pictures.cut.numbers()
            chosen = islice(self.iterator, numbers.start, min(numbers.stop, sys.maxsize), numbers.step)
            return iter(ArrayFrames(chosen, numbers)), None
        _warn(self.pictures.beyond())
        source = self.pictures.frames(_warn) if self.pictures.is_video or len(self.pictures.images) else None
        if source is not None:
            return iter(source), source.count or None
        return map(ReadImage(check=partial(part_of_frame, part)), self.pictures.files), len(self.pictures.files)


def _calibrated(how: How, part: Sequence[Frame]) -> tuple[Sequence[Frame], list[Calibration]]:
    """Calibrate the images of frames one by one; also returns the frames, without images that would have to be sent."""
    images = [frame.image for frame in part if frame.image is not None]
    calibrations = calibrate_images(how, images, partial(part_of_frame, how.part))
    return [replace(frame, image=None) for frame in part], calibrations


def _readable(collected: Collected, names: Mapping[str, str]) -> KeptFrames:
    """The frames; a BrokenFileError about the first one if there are some, and none can be read."""
    if collected.ids and len(collected.broken) == len(collected.ids):
        (id, problem), *others = collected.broken.items()
        more = f"; nor can the other {len(others)} be read" if others else ""
        raise BrokenFileError(f"{names.get(id, id)}: {problem}{more}")
    return collected.frames()


@dataclass(frozen=True, eq=False)
class Clip:
    """Frames that are calibrated together."""

    pictures: Pictures

    def calibrate(self, how: How, progress: Progress, executor: Executor | None = None) -> Results:
        """Calibrate all of it."""
        _warn(self.pictures.beyond())
        source = self.pictures.frames(_warn)
        input = ClipInput(source, partial(part_of_frame, how.part), progress)
        with solving(SOLVING, progress):
            found = calibrate_clip(how, input, executor=executor)
        readable = [id for id in input.ids if id not in source.broken]
        basis = {id: {"basis": str(one)} for id, one in zip(readable, found.basis, strict=True)}
        kept = KeptFrames(input.ids, found, dict(source.broken), basis)
        placement = input.placement()
        if placement is not None and not placement.is_whole:
            kept = kept.changed(partial(in_picture, placement=placement))
        return Results(kept, self.pictures, partial(_with_rate, found, source.frames_per_second))


def _with_rate(found: VideoCalibration, frames_per_second: float) -> tuple[VideoCalibration, float]:
    """Return both arguments: `Results.clip` for a clip in memory, as a module's function so that it can be pickled."""
    return found, frames_per_second


@dataclass(frozen=True, eq=False)
class LiveStream:
    """A part of a stream, whose frames are calibrated as they come."""

    stream: Stream
    cut: Cut

    def calibrate(self, how: How, progress: Progress, executor: Executor | None = None) -> Results:
        """Calibrate all of it."""
        _check_no_clip(how)
        if executor is not None:
            raise ValueError("executor is of files and arrays: the frames of a stream are calibrated as they come")
        how, collected, place = how.with_network(), Collected(), partial(part_of_frame, how.part)
        if how.network is None:
            raise ValueError(
                "the network that comes with fieldcalib knows soccer fields only: of a stream give network=, one that "
                "was trained for this field; pictures and clips of courts need none"
            )
        with (
            StreamReader(self.stream, cut=self.cut) as reader,
            live_tracker(how, self.stream, reader, place) as (frames, tracker),
            progress_bar(unit="frame", total=len(reader.numbers), progress=progress) as bar,
        ):
            for frame in frames:
                collected.add(frame.id, tracked(tracker, frame, place), basis=str(tracker.basis), time_s=frame.seconds)
                bar.update()
        _warn(reader.remark)
        _warn(reader.loss())
        return Results(collected.frames())


def _warn(message: str) -> None:
    """Warn the caller of `fieldcalib.calibrate`, unless the message is empty."""
    if message:
        warnings.warn(message, stacklevel=2)
