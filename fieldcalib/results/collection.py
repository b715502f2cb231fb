"""Results of many frames: a mapping of their ids to calibrations, and what is asked of all of them."""

from __future__ import annotations

import os
from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as attribute
from functools import cached_property
from pathlib import Path
from reprlib import repr as short
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldcalib._checks import file_path, truth
from fieldcalib._html import long_table, spread, table
from fieldcalib.assess.findings import UP_TO_SIDE, Verdict
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.draw.clip_plot import plot_sequence
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.draw.sheet import contact_sheet, worst_frames
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground_homography import FieldHomography, field_homography
from fieldcalib.fields.sides import MAIN, side_of
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import CAMERA_TITLES, Camera, camera_cells
from fieldcalib.io.image import Image, checked_image
from fieldcalib.io.image_files import encode_image
from fieldcalib.results.frames import ById, FrameStore, Lazy, LazyList, NoFrameError
from fieldcalib.results.pictures import Pictures

if TYPE_CHECKING:
    import pandas


from collections.abc import Iterable
from typing import TYPE_CHECKING

from fieldcalib._extras import imported

if TYPE_CHECKING:
    import pandas

WORST = 12  # pictures of `Results.plot`
GROUND = (52, 92, 58)  # colour of a picture that is not there
SHOWN = 960  # px: width of a picture in a notebook

FOR_READING_BACK = frozenset({"version", "field", "solved", "errors"})  # keys without a column


@dataclass(frozen=True, eq=False, repr=False)
class Results(Mapping[str, Calibration]):
    """Calibrations by the ids of their frames, in the order of the input.

    Frames whose files could not be read have none: they are in `broken`. Two results are equal if they have the same
    frames with the same calibrations, and the same calibration of a clip. Frames of a folder are parsed when they are
    asked for.

    Examples
    --------
    >>> import fieldcalib
    >>> field = fieldcalib.soccer()
    >>> truth = fieldcalib.Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")
    >>> pixels = {label: truth.project(field[label].sample(9.0)) for label in labels}
    >>> results = fieldcalib.calibrate({"00001": pixels}, image_size=(960, 540), progress=False)
    >>> results, results.verdicts
    (Results(1 calibration: 1 good), {'00001': <Verdict.GOOD: 'good'>})
    >>> results.overlay("00001").shape
    (540, 960, 3)
    """

    frames: FrameStore
    """What is kept of each frame."""
    pictures: Pictures = attribute(default_factory=Pictures)
    """Where the pictures of the frames are."""
    clip: Callable[[], tuple[VideoCalibration, float]] | None = None
    """Gives the calibration of a clip, and its frames per second; None where frames were calibrated by themselves."""
    command: str = "run"
    """The command that writes such results: calibrate, of labelled pixels, or run."""
    options: Mapping[str, Any] = attribute(default_factory=dict)
    """What they were calibrated with, for the record in their folder."""
    folder: Path | None = None
    """The folder that they were read from."""

    @cached_property
    def _numbers(self) -> dict[str, int]:
        """Numbers of the frames that have a calibration, by id."""
        broken = self.frames.broken
        return {id: number for number, id in enumerate(self.frames.ids) if id not in broken}

    def __getitem__(self, id: str) -> Calibration:
        return self.frames.calibration(self._number(id))

    def _number(self, id: str) -> int:
        if not isinstance(id, str) or id not in self._numbers:
            raise NoFrameError(id, self._numbers, self.broken)
        return self._numbers[id]

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    def __contains__(self, id: object) -> bool:
        return id in self._numbers

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
        broken = f", {len(self.broken)} broken files" if self.broken else ""
        side = ", up to the side" if self.is_side_open else ""
        return f"Results({count}: {self._counts()}{broken}{side})"

    @cached_property
    def is_side_open(self) -> bool:
        """Whether nothing tells on which side of the field the cameras are.

        Then each is on the main side by convention, and `Calibration.alternatives` has the one that is turned by 180
        degrees about the centre mark. The first good frame tells it.
        """
        good = next((id for id, verdict in self.verdicts.items() if verdict is Verdict.GOOD), None)
        if good is None or not self[good].alternatives:
            return False
        found = self[good]  # of labels, which tell the side, only a camera on the opposite one has an alternative
        return found.field is not None and side_of(found.required_camera.C, found.field) == MAIN

    @property
    def notes(self) -> tuple[str, ...]:
        """What is to be known of all cameras, in words: of a clip its camera model too, where that is not the usual."""
        if self.video is not None:
            return self.video.remarks
        return (UP_TO_SIDE,) if self.is_side_open else ()

    def _counts(self) -> str:
        counts = Counter(self.verdicts.values())
        return ", ".join(f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict]) or "none"

    @property
    def calibrations(self) -> Mapping[str, Calibration]:
        """The calibrations by id: the results themselves."""
        return self

    @property
    def broken(self) -> Mapping[str, str]:
        """Problems of files that could not be read, by id."""
        return self.frames.broken

    @property
    def lines(self) -> Sequence[Mapping[str, Any]]:
        """Everything that is kept of each frame, broken ones included, by the keys of ``docs/reference/files.md``."""
        return LazyList(len(self.frames.ids), self.frames.line)

    @property
    def cameras(self) -> Mapping[str, Camera | None]:
        """The best camera of each frame by id, whatever the verdict; None where there is none."""
        return Lazy(self._numbers, lambda number: self.frames.camera(number))

    @cached_property
    def verdicts(self) -> Mapping[str, Verdict]:
        """The verdict on each frame by id: "good", "check" or "reject"."""
        return ById({line["id"]: Verdict(line["verdict"]) for line in self.frames.mains() if "verdict" in line})

    @property
    def basis(self) -> Mapping[str, str]:
        """What the camera of each frame of a clip rests on, by id; empty texts for other frames."""
        return Lazy(self._numbers, lambda number: str(self.frames.main(number).get("basis", "")))

    @cached_property
    def _clip(self) -> tuple[VideoCalibration | None, float | None]:
        return (None, None) if self.clip is None else self.clip()

    @property
    def video(self) -> VideoCalibration | None:
        """The calibration of a clip, with its shots and tripods; None where frames were calibrated by themselves."""
        return self._clip[0]

    @property
    def frames_per_second(self) -> float | None:
        """Frame rate of a clip; None for others."""
        return self._clip[1]

    def image(self, id: str) -> Image:
        """The picture of a frame, read from where it was.

        Raises
        ------
        ValueError
            If it is not known where it is, or it is gone.
        BrokenFileError
            If it cannot be read.
        """
        return self.pictures.image(id)

    def overlay(self, frame: str | int | None = None, image: Image | None = None, *, show_paint: bool = False) -> Image:
        """The picture of a frame with the projected field, as `fieldcalib run` draws it.

        Parameters
        ----------
        frame : str or int, optional
            The id of a frame, or its place in the order of the frames; may be left out if there is one only.
        image : (height, width, 3) uint8 array, optional
            The picture; by default it is read again from the input. Where it cannot be, the field is drawn on a plain
            ground.
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
            If no frame is named, and there are several; or if the image is none.
        """
        id = self._id(frame)
        found = self[id]
        if image is None:
            image = self.image(id) if self.pictures.has(id) else _plain(found)
        return draw_calibration(checked_image(image), found, self._field(found), show_paint=show_paint)

    def _id(self, frame: str | int | None) -> str:
        """The id of a frame that a user names."""
        ids = list(self) if not isinstance(frame, str) else []
        if frame is None and len(ids) != 1:
            raise ValueError(f"say which frame: there are {len(ids)}, as {', '.join(map(repr, ids[:3]))}")
        if not isinstance(frame, str | int | None) or (isinstance(frame, int) and not 0 <= frame < len(ids)):
            raise ValueError(f"expected an id, or the number of a frame from 0 to {len(ids) - 1}, got {short(frame)}")
        found = frame if isinstance(frame, str) else ids[frame or 0]
        self._number(found)
        return found

    def _field(self, calibration: Calibration) -> Field:
        return calibration.field or soccer()

    def plot(self) -> Image:
        """A picture of all results: of a clip its cameras over time, else the frames to look at first.

        Returns
        -------
        (height, width, 3) uint8 array
            Blue, green, red: `fieldcalib.draw.plot_sequence`, or a `fieldcalib.draw.contact_sheet` of overlays.

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
        return contact_sheet([self.overlay(id) for id in ids], captions, title=self._counts())

    def homographies(self) -> Mapping[str, FieldHomography]:
        """Homographies from pixels to metres on the ground, by id, of the frames that have a camera.

        Returns
        -------
        mapping of str to FieldHomography
            Of undistorted pixels (exact), of the pixels of the picture (nearest), and what the lens leaves of that in
            pixels and metres; made when they are asked for.
        """
        numbers = {id: number for id, number in self._numbers.items() if self.cameras[id] is not None}
        return Lazy(numbers, lambda number: self._homography(self.frames.ids[number]))

    def _homography(self, id: str) -> FieldHomography:
        camera = self.cameras[id]
        assert camera is not None
        return field_homography(camera, self._field(self[id]))

    def to_pandas(self, *, everything: bool = False) -> pandas.DataFrame:
        """A table with a row for each frame, broken ones included, indexed by id.

        Parameters
        ----------
        everything : bool
            By default there are the columns of `COLUMNS` of this module: verdict and reason, the camera in
            pixels, degrees and metres, its fit, and the size of the field. Otherwise all keys of
            ``docs/reference/files.md`` without those that only serve to read results back; nested ones as
            "angles_degrees.pan", matrices and lists in one cell.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        if truth(everything, "everything"):
            return whole_table(self.lines)
        return short_table(self.frames.mains())

    def save(self, folder: str | os.PathLike[str], *, overwrite: bool = False, overlays: bool = True) -> None:
        """Write the results to a folder as `fieldcalib run` (or `calibrate`, of labelled pixels) does.

        Parameters
        ----------
        folder : path
            It is made if it is not there.
        overwrite : bool
            Whether results in it are replaced.
        overlays : bool
            Whether pictures with the projected field are drawn, where the pictures can be read again.

        Raises
        ------
        FileExistsError
            If there are results in the folder already.
        OSError
            If it cannot be written to.
        """
        from fieldcalib.results.saving import save

        out = file_path(folder, "a folder")
        save(self, out, overwrite=truth(overwrite, "overwrite"), overlays=truth(overlays, "overlays"))

    def line(self, id: str) -> Mapping[str, Any]:
        """Everything that is kept of a frame, see `lines`."""
        return self.frames.line(self._number(id))

    def _repr_html_(self) -> str:
        """Verdicts, a picture where one can be made, and a table of some frames, for notebooks."""
        rows = {"frames": str(len(self.frames.ids)), "verdicts": self._counts()}
        if self.broken:
            rows["broken files"] = str(len(self.broken))
        if self.is_side_open:
            rows["side"] = "open"
        if self.video is not None:
            rows |= {"shots": str(len(self.video.shots)), "tripods": str(len(self.video.tripods))}
        return table(rows) + self._html_picture() + self._html_frames()

    def _html_frames(self) -> str:
        """A table of some of the frames, broken ones included."""
        ids, rows = list(self.frames.ids), []
        for id in (ids[index] for index in spread(len(ids))):
            if id in self.broken:
                rows.append([id, "broken file", "", "", "", self.broken[id]])
            else:
                rows.append([id, str(self.verdicts[id]), *camera_cells(self.cameras[id]), self[id].reason])
        return long_table(["frame", "verdict", *CAMERA_TITLES, "reason"], rows, len(ids))

    def _html_picture(self) -> str:
        import cv2

        try:
            picture = self.overlay() if len(self) == 1 and self.video is None else self.plot()
        except (ValueError, OSError):  # nothing to draw, or pictures that are gone
            return ""
        if picture.shape[1] > SHOWN:
            size = SHOWN, max(round(picture.shape[0] * SHOWN / picture.shape[1]), 1)
            picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
        data = b64encode(encode_image(picture, ".jpg")).decode()
        return f'<img alt="cameras" src="data:image/jpeg;base64,{data}">'


def _plain(calibration: Calibration) -> Image:
    """A picture of one colour, of the size of the camera."""
    width, height = (960, 540) if calibration.camera is None else calibration.camera.image_size
    return np.full((height, width, 3), GROUND, np.uint8)


def short_table(lines: Iterable[Mapping[str, Any]]) -> pandas.DataFrame:
    """The table of the lines of ``cameras.jsonl`` with one number or text in each cell."""
    pandas = imported("pandas", "pandas", "to_pandas")
    return pandas.DataFrame([_row(line) for line in lines], columns=["id", *COLUMNS]).set_index("id")


def whole_table(lines: Iterable[Mapping[str, Any]]) -> pandas.DataFrame:
    """The table of everything that is kept of frames; nested keys are joined as "angles_degrees.pan"."""
    pandas = imported("pandas", "pandas", "to_pandas")
    rows = [{key: value for key, value in line.items() if key not in FOR_READING_BACK} for line in lines]
    table = pandas.json_normalize(rows) if rows else pandas.DataFrame(columns=["id"])
    return table.set_index("id")


def _row(line: Mapping[str, Any]) -> dict[str, Any]:
    """The cells of a frame; what it does not have is missing."""
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
    """A number of JSON, where infinity is a text."""
    return None if value is None else float(value)


WORDS = ("status", "verdict", "reason", "remedy", "basis")
COLUMNS = (
    *WORDS,
    *("focal_length_px", "focal_length_sd_px", "pan_degrees", "tilt_degrees", "roll_degrees", "x_m", "y_m", "z_m"),
    *("k1", "principal_point_x_px", "principal_point_y_px", "image_width_px", "image_height_px"),
    *("rms_px", "probability_right_1m", "field_length_m", "field_width_m"),
)
