"""The entry points `fieldcalib.calibrate`, from any input to its cameras, and `fieldcalib.read`, for saved results."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from numpy.typing import ArrayLike

from fieldcalib._progress import Progress
from fieldcalib._types import file_path, is_number, number
from fieldcalib.fields.catalogue import AUTO
from fieldcalib.fields.catalogue import field as field_named
from fieldcalib.fields.field import Field, Side
from fieldcalib.images.from_images import How, Mount
from fieldcalib.io.field_files import is_field_file, read_field
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.frame_range import Cut, Position
from fieldcalib.io.image_files import Image
from fieldcalib.io.results import lines_file
from fieldcalib.localize import Network
from fieldcalib.results.collection import Results
from fieldcalib.results.frames import StoredFrames
from fieldcalib.results.inputs import Labels, input_of, pictures_of
from fieldcalib.results.pictures import Pictures, auto_field
from fieldcalib.run_folder.clip_results import read_clip
from fieldcalib.run_folder.record import RECORD, RunRecord
from fieldcalib.run_folder.results import CLIP
from fieldcalib.solve.request import GivenCamera, Task
from fieldcalib.solve.solver_options import ALL, DEFAULT_FLAGS, Prior

PathLike: TypeAlias = str | os.PathLike[str]
Source: TypeAlias = (
    PathLike | Image | Iterable[Image] | Sequence[PathLike] | Labels | Mapping[str, Labels] | Sequence[Labels]
)
Time: TypeAlias = str | float | None


def calibrate(
    source: Source,
    field: str | Field = "soccer",
    *,
    start: Time = None,
    end: Time = None,
    step: int = 1,
    clip: bool | None = None,
    image_size: tuple[int, int] | None = None,
    network: Network | None = None,
    camera_matrix: ArrayLike | None = None,
    dist_coeffs: ArrayLike | None = None,
    rvec: ArrayLike | None = None,
    tvec: ArrayLike | None = None,
    flags: int = DEFAULT_FLAGS,
    prior: Prior = ALL,
    camera: Mount = "tripod",
    side: Side | None = None,
    progress: Progress = True,
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
        * a (height, width, 3) uint8 array in blue, green, red, a list of them, or an iterator;
        * labelled pixels, a mapping of labels to (N, 2) pixels, several of them in a list or by id, or what
          `read_annotations` returns;
        * a URL, or ``"-"`` for standard input, up to `end`. To calibrate frames as they come, use `Tracker`.
    field : str or Field
        The name of a sport (`fieldcalib.fields.catalogue.FIELDS`), a file with a field of one's own, a `Field`, or
        ``"auto"``: all sports are tried on some of the pictures, and the best one is taken if no other explains them
        about as well (`fieldcalib.images.which_field.which_field`). The size of a field in pictures is estimated from
        them, unless it is declared known (`Field.size_known`).
    start, end : str or float, optional
        The first frame, and the one after the last: seconds, ``"1:30"``, or the number of a frame, ``"750f"``.
    step : int
        Take every n-th frame only.
    clip : bool, optional
        Whether pictures are a clip whose frames are calibrated together. By default a video is one, pictures are not.
    image_size : (int, int), optional
        Width and height of the pictures in which pixels were labelled, if the labels do not have it.
    network : Network, optional
        Finds the markings in pictures; by default the one that comes with the package, for soccer. Courts of other
        fields are found by search (`fieldcalib.images.find_courts`).
    camera_matrix, dist_coeffs, rvec, tvec, flags, prior
        What is known of the camera, as in `calibrate_from_segments`.
    camera : {"tripod", "moving"}
        How the camera of a clip is carried, see `calibrate_video`.
    side : {"main", "opposite"}, optional
        The side of the field that the camera of pictures is on, as in `calibrate_from_images`; labelled pixels name it.
    progress : bool or function
        True shows a bar on a terminal and in a notebook, and prints a line every ten seconds elsewhere. A function is
        called with the number of frames that are done, how many there are (None if that is not known), and the stage;
        an error that it raises ends the work.

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
    >>> import numpy as np
    >>> results = calibrate(np.zeros((540, 960, 3), np.uint8), progress=False)
    >>> str(results.verdicts["000000"])  # a black picture
    'reject'
    """
    taken = input_of(source, _cut(start, end, step), clip, image_size)
    if isinstance(field, str) and field == AUTO:
        field = auto_field(pictures_of(taken))
    task = Task(_field(field), GivenCamera(camera_matrix, dist_coeffs, rvec, tvec), flags, prior=prior)
    how = How(task, network, side, camera=camera)
    options = {"field": field if isinstance(field, str) else repr(field), "step": step, "prior": str(prior)}
    options |= {name: str(_position(one)) for name, one in (("start", start), ("end", end)) if one is not None}
    return replace(taken.calibrate(how, progress), options=options)


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
    raise ValueError(f'expected a Field, as fieldcalib.soccer(), or the name of a sport, as "soccer", got {field!r}')


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
