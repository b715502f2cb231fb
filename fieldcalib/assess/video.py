"""The calibration of a video: its frames, the shots that they belong to, and the tripods of these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from fieldcalib._extras import imported
from fieldcalib._json import texts_from_json
from fieldcalib._types import IntArray, expect, listed
from fieldcalib.assess.findings import UP_TO_SIDE, Finding, Status, findings_from_json
from fieldcalib.assess.frame_table import Basis, check_indices
from fieldcalib.assess.result import Calibration, in_picture
from fieldcalib.assess.sequence_calibration import NUMBERS, Codec, FrameSequence, SequenceCalibration
from fieldcalib.fields.field import turned_camera
from fieldcalib.problem.picture_shape import Placement

if TYPE_CHECKING:
    import pandas

NO_TRIPOD = -1


class Shape(NamedTuple):
    """What the pictures of a clip are of: where each lies in a frame, and findings on that.

    Examples
    --------
    >>> shape = Shape(Placement.around((1280, 960), 0, 120, 1280, 840).squashed)
    >>> shape == Shape.from_dict(shape.to_dict())
    True
    """

    placement: Placement
    findings: tuple[Finding, ...] = ()
    """Findings that are added to those of each frame."""

    def __bool__(self) -> bool:
        """Whether anything is said: false if the pictures are frames, without findings."""
        return not self.placement.is_whole or bool(self.findings)

    @property
    def words(self) -> tuple[str, ...]:
        """Sentences on the borders, and of the findings."""
        return (*filter(None, [self.placement.borders]), *map(str, self.findings))

    def to_dict(self) -> dict[str, Any]:
        """Everything, for `json.dumps`."""
        return {**self.placement.to_dict(), "findings": [one.to_dict() for one in self.findings]}

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Shape:
        """The inverse of `to_dict`."""
        findings = record["findings"] if "findings" in record else record["complaints"]
        return cls(Placement.from_dict(record), findings_from_json(findings))


class Shot(NamedTuple):
    """Consecutive frames connected by matches: a cut, or a pan too fast to follow, ends them."""

    start: int
    """Number of the first frame."""
    stop: int
    """Number of the first frame after it."""
    tripod: int
    """Index into `VideoCalibration.tripods`; -1 if its camera is not known."""


@dataclass(frozen=True, eq=False, repr=False)
class VideoCalibration(FrameSequence):
    """The calibrations of the frames of a video.

    It is a sequence of `Calibration`, one for each frame, made on access. A slice has the parts of shots and the frames
    of tripods that are in it.

    Examples
    --------
    >>> nothing = VideoCalibration((), (Shot(0, 2, -1),), np.full(2, -1), np.zeros(2, dtype=int))
    >>> nothing
    VideoCalibration(frames=2, accepted=0)
    >>> nothing.cameras, str(nothing[1].status)
    ([None, None], 'too few segments')
    >>> nothing[1:].shots
    (Shot(start=0, stop=1, tripod=-1),)
    """

    _what: ClassVar[str] = "a video"
    _version: ClassVar[int] = 2
    _codecs: ClassVar[Mapping[str, Codec]] = {
        "tripods": Codec(
            lambda tripods: [one.to_dict() for one in tripods],
            lambda records: tuple(map(SequenceCalibration.from_dict, records)),
        ),
        "shots": Codec(lambda shots: list(map(list, shots)), lambda records: tuple(Shot(*shot) for shot in records)),
        "tripod": Codec(np.ndarray.tolist, partial(np.array, dtype=np.intp)),
        "number": Codec(np.ndarray.tolist, partial(np.array, dtype=np.intp)),
        "notes": Codec(list, texts_from_json),
        "shape": Codec(Shape.to_dict, Shape.from_dict).or_none,
        "is_side_open": Codec(bool, bool),
        "findings": Codec(
            lambda findings: [one.to_dict() for one in findings], lambda record: findings_from_json(record or [])
        ),
    }
    _added: ClassVar[frozenset[str]] = frozenset({"shape", "is_side_open", "findings"})
    tripods: tuple[SequenceCalibration, ...]
    """The frames of each tripod and their shared parameters, the tripod with most frames first."""
    shots: tuple[Shot, ...]
    """The shots in order; every frame is in one."""
    tripod: IntArray
    """Index of the tripod of each frame, (T,); -1 without a tripod."""
    number: IntArray
    """Index of each frame among those of its tripod, (T,)."""
    notes: tuple[str, ...] = ()
    """Model of the camera, and the reason, where frames do not share the parameters that they were to share
    (`fieldcalib.images.clip.clip_models`)."""
    shape: Shape | None = None
    """Borders, of windows too, and pixels that are not square; `tripods` are in square pixels within the borders, the
    frames of this sequence in pixels of the pictures. None where there are neither."""
    is_side_open: bool = False
    """Whether nothing tells on which side of the field the camera is: each frame has the one that is turned by 180
    degrees among its `alternatives`."""
    findings: tuple[Finding, ...] = ()
    """What a person has changed since the clip was solved."""

    @classmethod
    def joined(cls, parts: Sequence[VideoCalibration]) -> VideoCalibration:
        """Join the calibrations of parts of a video, one after the other."""
        for part in listed(parts, "the calibrations of parts"):
            expect(part, VideoCalibration, "fieldcalib.calibrate_video(...)")
        tripods = [tripod for part in parts for tripod in part.tripods]
        order = sorted(range(len(tripods)), key=lambda index: -len(tripods[index]))
        place = {index: k for k, index in enumerate(order)} | {NO_TRIPOD: NO_TRIPOD}
        shots, tripod, start, before = [], [np.zeros(0, dtype=np.intp)], 0, 0
        for part in parts:
            number = {k: place[before + k] for k in range(len(part.tripods))} | {NO_TRIPOD: NO_TRIPOD}
            shots += [Shot(start + a, start + b, number[k]) for a, b, k in part.shots]
            tripod.append(np.array([number[k] for k in part.tripod.tolist()], dtype=np.intp))
            start, before = start + len(part), before + len(part.tripods)
        return cls(
            tuple(tripods[index] for index in order),
            tuple(shots),
            np.concatenate(tripod),
            np.concatenate([np.zeros(0, dtype=np.intp), *(part.number for part in parts)]),
            tuple(note for part in parts for note in part.notes),
            next((part.shape for part in parts), None),
            any(part.is_side_open for part in parts),
            tuple(dict.fromkeys(one for part in parts for one in part.findings)),
        )

    def __len__(self) -> int:
        return len(self.tripod)

    def _check(self) -> None:
        check_indices(self.tripod, len(self.tripods), "tripod", NO_TRIPOD)
        check_indices(np.array([one.tripod for one in self.shots], np.intp), len(self.tripods), "shots", NO_TRIPOD)
        shapes = self.tripod.shape, self.number.shape
        if self.tripod.ndim != 1 or shapes[0] != shapes[1]:
            raise ValueError(f"expected 'tripod' and 'number' of the same frames, got {shapes[0]} and {shapes[1]}")
        for index, tripod in enumerate(self.tripods):
            check_indices(self.number[self.tripod == index], len(tripod), "number")
        ends = [0, *(one.stop for one in self.shots)]
        if [one.start for one in self.shots] != ends[:-1] or ends[-1] != len(self) or ends != sorted(ends):
            raise ValueError(f"'shots': expected shots that follow one another, of {len(self)} frames")

    def _frame(self, t: int) -> Calibration:
        if self.tripod[t] == NO_TRIPOD:
            return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "nothing in this shot determines the camera")
        tripod: SequenceCalibration = self.tripods[self.tripod[t]]
        found = tripod[int(self.number[t])]
        if self.is_side_open and found.camera is not None:
            found = replace(found, alternatives=(turned_camera(found.camera),))
        return found if self.shape is None else in_picture(found, self.shape.placement, *self.shape.findings)

    def _at(self, index: IntArray) -> VideoCalibration:
        shot, tripod = self.shot[index], self.tripod[index]
        members = [np.flatnonzero(tripod == k) for k in range(len(self.tripods))]
        order = sorted((k for k in range(len(members)) if len(members[k])), key=lambda k: -len(members[k]))
        place = {k: new for new, k in enumerate(order)} | {NO_TRIPOD: NO_TRIPOD}
        number = np.zeros(len(index), dtype=np.intp)
        for k in order:
            number[members[k]] = np.arange(len(members[k]))
        starts, stops = np.flatnonzero(np.diff(shot, prepend=-1)), np.flatnonzero(np.diff(shot, append=-1)) + 1
        ends = zip(starts.tolist(), stops.tolist(), strict=True)
        return VideoCalibration(
            tuple(self.tripods[k]._at(self.number[index[members[k]]]) for k in order),
            tuple(Shot(start, stop, place[self.shots[shot[start]].tripod]) for start, stop in ends),
            np.array([place[k] for k in tripod.tolist()], dtype=np.intp),
            number,
            self.notes,
            self.shape,
            self.is_side_open,
            self.findings,
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """The notes, what a person has changed since, and what holds for all cameras."""
        return (*self.notes, *map(str, self.findings), *([UP_TO_SIDE] if self.is_side_open else []))

    @property
    def shot(self) -> IntArray:
        """Index of the shot of each frame, (T,)."""
        return np.repeat(np.arange(len(self.shots)), [one.stop - one.start for one in self.shots])

    @property
    def basis(self) -> list[Basis]:
        """Data that the camera of each frame rests on."""
        of_tripods = [tripod.basis for tripod in self.tripods]
        return [
            Basis.NOTHING if tripod == NO_TRIPOD else of_tripods[tripod][number]
            for tripod, number in zip(self.tripod.tolist(), self.number.tolist(), strict=True)
        ]

    def to_pandas(self) -> pandas.DataFrame:
        """One row per frame: its shot and its tripod (-1 for none), and the columns of `SequenceCalibration.to_pandas`.

        Raises
        ------
        ImportError
            Without pandas, ``pip install fieldcalib[pandas]``.
        """
        pandas = imported("pandas", "pandas", "to_pandas")
        table = pandas.DataFrame({"shot": self.shot, "tripod": self.tripod})
        nothing = {"status": str(Status.TOO_FEW_SEGMENTS), "basis": str(Basis.NOTHING)}
        parts = []
        for index, tripod in enumerate(self.tripods):
            frames = np.flatnonzero(self.tripod == index)
            part = tripod.to_pandas().iloc[self.number[frames]]
            parts.append(part.set_index(frames))
        if not parts:
            return table.assign(**nothing, **dict.fromkeys(NUMBERS, np.nan))
        return table.join(pandas.concat(parts)).fillna(nothing)
