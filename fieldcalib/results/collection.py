"""Results of many frames: a mapping of their ids to calibrations, with tables, plots and overlays of all of them.

Results are saved to a folder by the same writer that the command line uses.
"""

from __future__ import annotations

import os
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as attribute
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, overload
from warnings import warn

import numpy as np

from fieldcalib._extras import imported
from fieldcalib._html import long_table, spread, table
from fieldcalib._types import file_path, truth
from fieldcalib._whole_files import whole_file
from fieldcalib.assess.estimate import PIXEL_SD
from fieldcalib.assess.findings import UP_TO_SIDE, Verdict
from fieldcalib.assess.ground_points import GroundPoints, locate_on_ground
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.draw.clip_plot import plot_sequence
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.draw.sheet import contact_sheet, worst_frames
from fieldcalib.fields.field import MAIN, Field, side_of
from fieldcalib.fields.ground_homography import FieldHomography, field_homography
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import CAMERA_TITLES, Camera, camera_cells
from fieldcalib.images.clip.from_video import PART
from fieldcalib.io.boxes import foot_points
from fieldcalib.io.clips import ClipInput, whole_frame
from fieldcalib.io.files import can_name_files
from fieldcalib.io.formats import OVERLAYS, VIDEOS
from fieldcalib.io.image_files import IMAGES_AT_ONCE, Image, checked_image, html_picture
from fieldcalib.io.output_folder import check_targets, output_folder
from fieldcalib.io.results import LINES, SOLVER, TABLE, broken_line
from fieldcalib.problem.picture_shape import Placement
from fieldcalib.results.frames import NO_PICTURE, ById, FrameStore, Lazy, LazyList, Numbered, Pictures, number_of
from fieldcalib.run_folder.clip_results import write_clip, write_clip_results
from fieldcalib.run_folder.record import CAMERA_FILE, ID, RECORD, Outcome, RunOptions, RunRecord, as_json, is_squashed
from fieldcalib.run_folder.results import (
    OVERLAY,
    SHARED_FILES,
    SUMMARY,
    ResultsWriter,
    UsedFolderError,
    finish,
    open_run_folder,
)

if TYPE_CHECKING:
    import pandas
    import pyarrow

LABELLED = "calibrate"  # the command that writes results of labelled pixels

WORST = 12  # number of pictures in `Results.plot`
GROUND = (52, 92, 58)  # colour of the ground if there is no picture

FOR_READING_BACK = frozenset({"version", "field", "solved", "errors"})  # keys without a column

WORDS = ("status", "verdict", "reason", "remedy", "basis")
COLUMNS = (
    *WORDS,
    *("focal_length_px", "focal_length_sd_px", "pan_degrees", "tilt_degrees", "roll_degrees", "x_m", "y_m", "z_m"),
    *("k1", "principal_point_x_px", "principal_point_y_px", "image_width_px", "image_height_px"),
    *("rms_px", "probability_right_1m", "field_length_m", "field_width_m"),
)


@dataclass(frozen=True, eq=False, repr=False)
class Results(Numbered[Calibration]):
    """Calibrations by the ids of their frames, in the order of the input.

    Frames whose files could not be read have no calibration: they are in `broken`. Two results are equal if they have
    the same frames with the same calibrations, and the same calibration of a clip. Frames of a folder are parsed when
    they are accessed.

    Examples
    --------
    >>> import fieldcalib, numpy as np
    >>> field = fieldcalib.soccer()
    >>> truth = fieldcalib.Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")
    >>> pixels = {label: truth.project(field[label].sample(9.0)) for label in labels}
    >>> results = fieldcalib.calibrate({"00001": pixels}, image_size=(960, 540), progress=False)
    >>> results, results.verdicts
    (Results(1 calibration: 1 good), {'00001': <Verdict.GOOD: 'good'>})
    >>> results.overlay("00001", image=np.zeros((540, 960, 3), np.uint8)).shape
    (540, 960, 3)
    """

    frames: FrameStore
    """Data of each frame."""
    pictures: Pictures = attribute(default_factory=Pictures)
    """Sources of the pictures of the frames."""
    clip: Callable[[], tuple[VideoCalibration, float]] | None = None
    """Returns the calibration of a clip and its frames per second; None if frames were calibrated by themselves."""
    command: str = "run"
    """The command that writes such results: "calibrate" for labelled pixels, or "run"."""
    options: Mapping[str, Any] = attribute(default_factory=dict)
    """Options of the calibration, for the record in the folder."""
    folder: Path | None = None
    """Folder from which they were read; None if they were not."""

    @cached_property
    def _numbers(self) -> dict[str, int]:  # type: ignore[override]
        """Numbers of the frames that have a calibration, by id."""
        broken = self.frames.broken
        return {id: number for number, id in enumerate(self.frames.ids) if id not in broken}

    @overload
    def __getitem__(self, id: str | int) -> Calibration: ...

    @overload
    def __getitem__(self, id: slice) -> Mapping[str, Calibration]: ...

    def __getitem__(self, id: str | int | slice) -> Calibration | Mapping[str, Calibration]:
        """The calibration of a frame, by its id or by its number among those that have one; of a slice a mapping."""
        if isinstance(id, slice):
            return Lazy(dict([*self._numbers.items()][id]), self.frames.calibration)
        return self.frames.calibration(self._number(id))

    def _number(self, id: str | int) -> int:
        return number_of(self._numbers, id, self._why_broken)

    def _why_broken(self, id: str) -> str:
        return f"could not be read: {self.broken[id]}" if id in self.broken else ""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Results):
            return NotImplemented
        if list(self.frames.ids) != list(other.frames.ids) or dict(self.broken) != dict(other.broken):
            return False
        same = all(self[id] == other[id] and self.basis[id] == other.basis[id] for id in self)
        return same and self.video == other.video

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        count = f"{len(self)} calibration{'s' * (len(self) != 1)}"
        broken = f", {len(self.broken)} broken file{'s' * (len(self.broken) != 1)}" if self.broken else ""
        side = ", main side assumed" if self.is_side_open else ""
        return f"Results({count}: {self._counts()}{broken}{side})"

    @cached_property
    def is_side_open(self) -> bool:
        """Whether it is unknown on which side of the field the cameras are, according to the first good frame.

        Then each camera is on the main side by convention, and `Calibration.alternatives` has the camera turned by 180
        degrees about the centre mark.
        """
        good = next((id for id, verdict in self.verdicts.items() if verdict is Verdict.GOOD), None)
        if good is None or not self[good].alternatives:
            return False
        found = self[good]  # from labels, which determine the side, only a camera on the opposite side has alternatives
        return found.field is not None and side_of(found.required_camera.C, found.field) == MAIN

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes that concern all cameras; for a clip also its camera model, if that is not a tripod."""
        if self.video is not None:
            return self.video.remarks
        return (UP_TO_SIDE,) if self.is_side_open else ()

    def _counts(self) -> str:
        counts = Counter(self.verdicts.values())
        return ", ".join(f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict]) or "none"

    @property
    def broken(self) -> Mapping[str, str]:
        """Problems of files that could not be read, by id."""
        return self.frames.broken

    @property
    def lines(self) -> Sequence[Mapping[str, Any]]:
        """All data of each frame, broken ones included, by the keys of ``docs/reference/files.md``."""
        return LazyList(len(self.frames.ids), self.frames.line)

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """Best camera of each frame that has one, by id, whatever the verdict; the error for another says why not."""
        return Lazy(self._with_camera, lambda number: cast(Camera, self.frames.camera(number)), self._why_none)

    @cached_property
    def _with_camera(self) -> dict[str, int]:
        """Numbers of the frames that have a camera, by id."""
        with_one = {line["id"] for line in self.frames.mains() if line.get("K") is not None}
        return {id: number for id, number in self._numbers.items() if id in with_one}

    def _why_none(self, id: str) -> str:
        return f"has no camera: {self[id].message}" if id in self else self._why_broken(id)

    @cached_property
    def verdicts(self) -> Mapping[str, Verdict]:
        """The verdict on each frame by id: "good", "check" or "reject"."""
        lines = (line for line in self.frames.mains() if line["id"] in self)
        return ById({line["id"]: Verdict(line.get("verdict") or self[line["id"]].verdict) for line in lines})

    @property
    def basis(self) -> Mapping[str, str]:
        """Basis of the camera of each frame of a clip (lines, matches ...), by id; empty texts for other frames."""
        return Lazy(self._numbers, lambda number: str(self.frames.main(number).get("basis", "")))

    @cached_property
    def _clip(self) -> tuple[VideoCalibration | None, float | None]:
        return (None, None) if self.clip is None else self.clip()

    @property
    def video(self) -> VideoCalibration | None:
        """Calibration of a clip, with its shots and tripods; None if frames were calibrated by themselves."""
        return self._clip[0]

    @property
    def frames_per_second(self) -> float | None:
        """Frame rate of a clip; None if there is no clip."""
        return self._clip[1]

    def image(self, id: str | int) -> Image:
        """Read the picture of a frame again from the input.

        Raises
        ------
        ValueError
            If its place is not known, or it is no longer there.
        BrokenFileError
            If it cannot be read.
        """
        return self.pictures.image(id if isinstance(id, str) else self._id(id))

    def overlay(self, frame: str | int | None = None, image: Image | None = None, *, show_paint: bool = False) -> Image:
        """Draw the projected field over the picture of a frame, as `fieldcalib run` does.

        Parameters
        ----------
        frame : str or int, optional
            The id of a frame, or its place in the order of the frames; may be left out if there is one only.
        image : (height, width, 3) uint8 array, optional
            The picture; by default it is read again from the input.
        show_paint : bool
            Whether markings beside their paint are orange, and those without any grey.

        Returns
        -------
        (height, width, 3) uint8 array
            Blue, green, red.

        Raises
        ------
        KeyError
            If there is no such frame, or it could not be read.
        ValueError
            If no frame is named and there are several, or if the image is not valid.

        Warns
        -----
        UserWarning
            If there is no picture to read, as of labelled pixels: the field is drawn on a plain ground.
        """
        id = self._id(frame)
        if image is None and not self.pictures.has(id):
            warn(f"{NO_PICTURE.format(id)}; the field is drawn on a plain ground", stacklevel=2)
        return self._overlay(id, image, show_paint=show_paint)

    def _overlay(self, id: str, image: Image | None = None, *, show_paint: bool = False) -> Image:
        """Draw the field over the picture of a frame, or over a plain ground where that cannot be read."""
        found = self[id]
        if image is None:
            image = self.image(id) if self.pictures.has(id) else _plain(found)
        return draw_calibration(checked_image(image), found, self._field(found), show_paint=show_paint)

    def _id(self, frame: str | int | None) -> str:
        """Find the id of a frame that a user names by id or number."""
        if frame is None and len(self) != 1:
            raise ValueError(f"say which frame: there are {len(self)}, as {', '.join(map(repr, list(self)[:3]))}")
        return self.frames.ids[self._number(0 if frame is None else frame)]

    def _field(self, calibration: Calibration) -> Field:
        return calibration.field or soccer()

    def plot(self) -> Image:
        """Plot all results: the cameras of a clip over time, or else the frames to look at first.

        Returns
        -------
        (height, width, 3) uint8 array
            Blue, green, red: `fieldcalib.draw.plot_sequence`, or a `fieldcalib.draw.contact_sheet` of overlays. In a
            notebook ``matplotlib.pyplot.imshow(results.plot()[..., ::-1])`` shows it.

        Raises
        ------
        ValueError
            If there is no calibration.
        """
        if not len(self):
            raise ValueError("there is no calibration to plot")
        if self.video is not None:
            return plot_sequence(self.video, frames_per_second=self.frames_per_second)
        ids = list(self)
        ids = [ids[index] for index in worst_frames(LazyList(len(ids), lambda k: self[ids[k]]), WORST)]
        captions = [f"{id}: {self[id].verdict}, {self[id].reason}" for id in ids]
        return contact_sheet([self._overlay(id) for id in ids], captions, title=self._counts())

    def homographies(self) -> Mapping[str, FieldHomography]:
        """Homographies from pixels to metres on the ground, by id, of the frames that have a camera.

        Returns
        -------
        mapping of str to FieldHomography
            Exact homographies of undistorted pixels, the closest homographies of the pixels of the picture, and the
            errors of the latter due to the lens, in pixels and metres. They are computed when they are accessed.
        """
        return Lazy(self._with_camera, lambda number: self._homography(self.frames.ids[number]), self._why_none)

    def _homography(self, id: str) -> FieldHomography:
        return field_homography(self.cameras[id], self._field(self[id]))

    def to_field(self, detections: Any, frame: str | int | None = None, *, pixel_sd: float = PIXEL_SD) -> GroundPoints:
        """Ground points, with their errors, of what a detector found in a frame.

        Parameters
        ----------
        detections : supervision.Detections, (N, 4) array_like or (N, 2) array_like
            Anything with boxes ``xyxy``, such as ultralytics' ``result.boxes``; boxes (left, top, right, bottom), of
            which the middle of the lower edge is taken (`fieldcalib.io.boxes.foot_points`); or pixels.
        frame : str or int, optional
            The id or the number of the frame; may be left out if there is one only.
        pixel_sd : float
            Standard deviation of the feet in the picture, pixels.

        Returns
        -------
        GroundPoints
            `X` (N, 3), metres, and `standard_deviations` (N, 2); NaN where no ground is seen.

        Raises
        ------
        ValueError
            As `fieldcalib.locate_on_ground`; without a camera it says why there is none.

        Examples
        --------
        >>> import fieldcalib
        >>> truth = fieldcalib.Camera.from_angles(0.2, 1.35, 0.01, 1400.0, (1.0, 65.0, -16.0), (960, 540))
        >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")
        >>> pixels = {label: truth.project(fieldcalib.soccer()[label].sample(9.0)) for label in labels}
        >>> results = fieldcalib.calibrate(pixels, image_size=(960, 540), progress=False)
        >>> results.to_field([(400, 200, 420, 260), (610, 240, 632, 305)]).X[:, :2].round(1)
        array([[11.8, -8.7],
               [19.9,  3.7]])
        """
        boxes = np.asarray(getattr(detections, "xyxy", detections))
        if boxes.dtype.kind not in "fiu" or (boxes.size and boxes.shape[-1:] not in ((2,), (4,))):
            raise ValueError(f"expected boxes (N, 4) or pixels (N, 2), got {boxes.dtype} of shape {boxes.shape}")
        if np.any(boxes > 0) and np.all(boxes <= 1):
            warn("all boxes lie within 0..1, as shares of the picture do: multiply them by its size", stacklevel=2)
        xy = foot_points(boxes) if boxes.shape[-1:] == (4,) else boxes.reshape(-1, 2)
        return locate_on_ground(self[self._id(frame)], xy, pixel_sd=pixel_sd)

    def to_pandas(self, *, everything: bool = False) -> pandas.DataFrame:
        """Make a table with a row for each frame, broken ones included, indexed by id.

        Parameters
        ----------
        everything : bool
            By default the table has the columns `COLUMNS` of this module: verdict and reason, the camera in pixels,
            degrees and metres, its fit, and the size of the field. Otherwise it has all keys of
            ``docs/reference/files.md``, except those that only serve to read results back; nested keys become
            "angles_degrees.pan" and the like, matrices and lists fill one cell.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        if truth(everything, "everything"):
            return whole_table(self.lines)
        return short_table(self.frames.mains())

    def to_arrow(self) -> pyarrow.Table:
        """Make the table of `to_pandas` as one of Arrow, which polars and DuckDB take without a copy.

        Its columns have the same types in all results, so that tables of many runs can be joined.

        Raises
        ------
        ImportError
            If pyarrow is not installed.
        """
        return arrow_table(self.frames.mains())

    def save(self, folder: str | os.PathLike[str], *, overwrite: bool = False, overlays: bool = True) -> None:
        """Write the results to a folder as `fieldcalib run` (or `calibrate`, for labelled pixels) does.

        Parameters
        ----------
        folder : path
            The folder, which is made if it does not exist.
        overwrite : bool
            Whether results in it are replaced.
        overlays : bool
            Whether pictures with the projected field are drawn, if the pictures can be read again.

        Raises
        ------
        FileExistsError
            If there are results in the folder already.
        OSError
            If it cannot be written to.
        """
        out = file_path(folder, "a folder")
        save(self, out, overwrite=truth(overwrite, "overwrite"), overlays=truth(overlays, "overlays"))

    def line(self, id: str | int) -> Mapping[str, Any]:
        """All data of a frame, see `lines`."""
        return self.frames.line(self._number(id))

    def _repr_html_(self) -> str:
        """Show verdicts, a picture if one can be made, and a table of some frames in a notebook."""
        rows = {"frames": str(len(self.frames.ids)), "verdicts": self._counts()}
        if self.broken:
            rows["broken files"] = str(len(self.broken))
        if self.is_side_open:
            rows["side"] = "main, assumed"
        if self.video is not None:
            rows |= {"shots": str(len(self.video.shots)), "tripods": str(len(self.video.tripods))}
        return table(rows) + self._html_picture() + self._html_frames()

    def _html_frames(self) -> str:
        """Format a table of some of the frames, broken ones included."""
        ids, rows = list(self.frames.ids), []
        for id in (ids[index] for index in spread(len(ids))):
            if id in self.broken:
                rows.append([id, "broken file", "", "", "", self.broken[id]])
            else:
                one = self[id]  # a rejected camera is not to be used
                rows.append([id, str(one.verdict), *camera_cells(one.camera if one else None), one.reason])
        return long_table(["frame", "verdict", *CAMERA_TITLES, "reason"], rows, len(ids))

    def _html_picture(self) -> str:
        try:
            return html_picture(
                self._overlay(*self) if len(self) == 1 and self.video is None else self.plot(), "cameras"
            )
        except (ValueError, OSError):  # nothing to draw, or pictures that are gone
            return ""


def _plain(calibration: Calibration) -> Image:
    """Make a picture of one colour, with the size of the camera's image."""
    width, height = (960, 540) if calibration.camera is None else calibration.camera.image_size
    return np.full((height, width, 3), GROUND, np.uint8)


def short_table(lines: Iterable[Mapping[str, Any]]) -> pandas.DataFrame:
    """Make a table of the lines of ``cameras.jsonl``, with one number or text in each cell."""
    pandas = imported("pandas", "pandas", "to_pandas")
    return pandas.DataFrame([_row(line) for line in lines], columns=["id", *COLUMNS]).set_index("id")


def arrow_table(lines: Iterable[Mapping[str, Any]]) -> pyarrow.Table:
    """Make the table of `short_table` for Arrow: words are texts, everything else is a number or null."""
    arrow = imported("pyarrow", "parquet", "to_arrow")
    texts = {"id", "reason", *WORDS}
    types = [(name, arrow.string() if name in texts else arrow.float64()) for name in ("id", *COLUMNS)]
    return arrow.Table.from_pylist([_row(line) for line in lines], schema=arrow.schema(types))


def whole_table(lines: Iterable[Mapping[str, Any]]) -> pandas.DataFrame:
    """Make a table of all data of frames; nested keys are joined as "angles_degrees.pan"."""
    pandas = imported("pandas", "pandas", "to_pandas")
    rows = [{key: value for key, value in line.items() if key not in FOR_READING_BACK} for line in lines]
    table = pandas.json_normalize(rows) if rows else pandas.DataFrame(columns=["id"])
    return table.set_index("id")


def _row(line: Mapping[str, Any]) -> dict[str, Any]:
    """Cells of a frame; values that it does not have are missing."""
    words = {name: line[name] for name in WORDS if name in line}
    row = {"id": line["id"], **words, "reason": line.get("reason", line["message"])}
    if line.get("field") is not None:
        row |= {f"field_{name}_m": line["field"][name] for name in ("length", "width")}
    if line.get("K") is None:
        return row
    K, angles, deviations = line["K"], line["angles_degrees"], line.get("standard_deviations")
    row |= dict(zip(("image_width_px", "image_height_px"), line["image_size"], strict=True))
    row |= {"focal_length_px": K[0][0], "principal_point_x_px": K[0][2], "principal_point_y_px": K[1][2]}
    row |= {f"{name}_degrees": angle for name, angle in angles.items()}
    row |= dict(zip(("x_m", "y_m", "z_m"), line["C"], strict=True)) | {"k1": line["dist"][0]}
    row |= {name: _number(line.get(name)) for name in ("rms_px", "probability_right_1m")}
    return row if deviations is None else row | {"focal_length_sd_px": _number(deviations["focal_length_px"])}


def _number(value: Any) -> float | None:
    """Convert a number from JSON, where infinity is a text."""
    return None if value is None else float(value)


def save(results: Results, out: Path, *, overwrite: bool, overlays: bool) -> None:
    """Write results to a folder, see `Results.save`."""
    if results.folder is not None:
        _copy(results, results.folder, out, overwrite=overwrite, overlays=overlays)
        return
    began = time.perf_counter()
    run, record = _record(results, out, overwrite=overwrite)
    overlays = overlays and results.command != LABELLED
    try:
        with open_run_folder(run, record, files=results.pictures.files) as writer:
            if results.video is not None:
                _write_clip(results, results.video, writer, overlays=overlays)
            else:
                _write_frames(results, writer, overlays=overlays)
            finish(out, writer.summary(run.recorded, time.perf_counter() - began))
    except UsedFolderError as error:  # which names options of the command line
        raise _used(error.found) from None


def _used(found: str) -> FileExistsError:
    return FileExistsError(f"{found}: give overwrite=True to replace them, or another folder")


def _record(results: Results, out: Path, *, overwrite: bool) -> tuple[RunOptions, RunRecord]:
    """Make the options and the record of a run that would have had these results."""
    pictures = results.pictures
    options = as_json({**results.options, "input": list(pictures.paths)})
    run = RunOptions(out, options, results.command, overwrite=overwrite)
    is_alone = results.video is None and not pictures.is_video and results.command != LABELLED
    writes = [OVERLAYS.file_name(ID)] * is_alone
    unit = IMAGES_AT_ONCE if results.video is None else PART
    return run, RunRecord.of(run, pictures.files, unit=unit, writes=writes)


@dataclass(frozen=True)
class _Whole:
    """Writes and draws results of whole frames: the `FrameOptions` of `write_clip_results`."""

    results: Results
    draws = True

    def placement(self, image: Image) -> Placement:
        return whole_frame(image)

    def outcome(self, id: str, calibration: Calibration, **more: Any) -> Outcome:
        line = self.results.line(id)
        return Outcome(line, is_squashed(line), more.get("files", {}))

    def drawn(self, image: Image, calibration: Calibration) -> Image:
        return draw_calibration(image, calibration, calibration.field or soccer())


def _write_clip(results: Results, video: VideoCalibration, writer: ResultsWriter, *, overlays: bool) -> None:
    """Write a clip, with pictures if these can be read again."""
    options = _Whole(results)
    if overlays and results and results.pictures.has(next(iter(results))):
        write_clip_results(writer, ClipInput(results.pictures.frames(), progress=False), video, options)
        return
    for id in results.frames.ids:
        broken = id in results.broken
        writer.add(_broken(results, id) if broken else options.outcome(id, results[id]))
    writer.notes = video.remarks
    write_clip(writer.out, video, results.frames_per_second or 0.0)


def _write_frames(results: Results, writer: ResultsWriter, *, overlays: bool) -> None:
    """Write frames that were calibrated one by one, with pictures if these can be read again."""
    options, writer.notes = _Whole(results), results.notes
    if overlays and results.pictures.is_video:
        path, source = writer.out / OVERLAY, results.pictures.frames()
        with VIDEOS.write(path, source.frames_per_second) as video:
            for frame in source:
                if frame.image is not None and frame.id in results:
                    video.write(options.drawn(frame.image, results[frame.id]))
        overlays = False
    for id in results.frames.ids:
        if id in results.broken:
            writer.add(_broken(results, id))
            continue
        files = {}
        if overlays and results.pictures.has(id):
            picture = options.drawn(results.image(id), results[id])
            files[OVERLAYS.file_name(id)] = OVERLAYS.write(picture)
        writer.add(options.outcome(id, results[id], files=files))


def _broken(results: Results, id: str) -> Outcome:
    """Make the outcome of a frame that could not be read, without a complaint, as that was reported before."""
    return Outcome(broken_line(id, results.broken[id]))


def _copy(results: Results, folder: Path, out: Path, *, overwrite: bool, overlays: bool) -> None:
    """Copy the files of a run, its record first and its summary last."""
    names = [RECORD, SOLVER, LINES, TABLE]
    patterns = [CAMERA_FILE] + [OVERLAYS.file_name(ID)] * overlays
    ids = [id for id in results.frames.ids if can_name_files(id)]
    names += [pattern.replace(ID, id) for pattern in patterns for id in ids]
    names += [name for name in SHARED_FILES if name != SUMMARY and (overlays or name != OVERLAY)]
    with output_folder(out):
        if out.samefile(folder):
            return
        there = next((name for name in (RECORD, LINES, TABLE, SUMMARY) if (out / name).exists()), None)
        if there is not None and not overwrite:
            raise _used(f"{out} holds results already, as {there}")
        check_targets(
            [out / name for name in (*names, SUMMARY)],
            [folder / name for name in names],
            replaces=overwrite,
            remedy="give overwrite=True to replace it, or another folder",
        )
        for name in (*names, SUMMARY):
            if (folder / name).is_file():
                with whole_file(out / name) as copy, (folder / name).open("rb") as file:
                    shutil.copyfileobj(file, copy)
            else:
                (out / name).unlink(missing_ok=True)
