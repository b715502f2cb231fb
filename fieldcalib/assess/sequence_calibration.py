"""The calibration of frames of one camera: the frames, and the parameters that they share.

A sequence of calibrations of the frames of a clip, each made on access.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as attribute
from functools import partial
from reprlib import repr as short
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, overload

import numpy as np

from fieldcalib._extras import imported
from fieldcalib._html import long_table, spread
from fieldcalib._json import from_json, reading, texts_from_json, to_json
from fieldcalib._types import Array, BoolArray, IntArray, expect, real_array, whole_number
from fieldcalib.assess.camera_errors import KnownErrors, NoErrors
from fieldcalib.assess.findings import Finding, What
from fieldcalib.assess.frame_table import (
    ACCEPTED,
    BASES,
    IMPROBABLE,
    STATUSES,
    Basis,
    FrameTable,
    array_from_record,
    array_to_record,
    interpolated,
)
from fieldcalib.assess.ground import Considered
from fieldcalib.assess.label_errors import is_contradicted
from fieldcalib.assess.paint_in_view import MarkingInView, checked_markings, contradiction, paint_confirms
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_errors import whole_covariance
from fieldcalib.fields.field import Field, tolerance_of
from fieldcalib.fields.records import field_from_record, field_to_record
from fieldcalib.geometry.camera import CAMERA_TITLES, Camera, camera_cells
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F, PRINCIPAL_POINT, Layout, exp_of
from fieldcalib.problem.records import check_covariances, check_parameters, layout_from_record, layout_to_record, sized

if TYPE_CHECKING:
    import pandas

SURE = 0.5  # times the field's tolerance: frames with larger errors of the field in view are to be looked at
NUMBERS = (  # columns of the table of frames, NaN for frames without a camera
    *("pan_degrees", "tilt_degrees", "roll_degrees", "focal_length_px", "x_m", "y_m", "z_m"),
    *("rms_px", "ground_error_m"),
)


class Codec(NamedTuple):
    """How an attribute is written to JSON, and read from it."""

    write: Callable[[Any], Any]
    read: Callable[[Any], Any]

    @property
    def or_none(self) -> Codec:
        """The codec of an attribute that may be None, which is null in JSON."""
        return Codec(
            lambda value: None if value is None else self.write(value),
            lambda value: None if value is None else self.read(value),
        )


class FrameSequence(Sequence[Calibration]):
    """A sequence of one calibration for each frame; subclasses store the frames.

    A slice is of the same class. Two sequences are equal if their `to_dict` is.
    """

    _what: ClassVar[str]
    """Noun for it in messages."""
    _version: ClassVar[int]
    """Version of its `to_dict`."""
    _codecs: ClassVar[Mapping[str, Codec]]
    """Its attributes in JSON."""
    _added: ClassVar[frozenset[str]] = frozenset()
    """Attributes that older files of this version lack, and that are None there."""

    @abstractmethod
    def _frame(self, t: int) -> Calibration:
        """The calibration of frame t."""

    @abstractmethod
    def _check(self) -> None:
        """Check attributes that were read; a ValueError if they do not fit together."""

    @abstractmethod
    def _at(self, index: IntArray) -> Self:
        """A sequence of some of the frames, in that order."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}(frames={len(self)}, accepted={sum(one.accepted for one in self)})"

    def to_dict(self) -> dict[str, Any]:
        """The calibration as a dict for `json.dumps`."""
        return {"version": self._version} | {name: one.write(getattr(self, name)) for name, one in self._codecs.items()}

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Self:
        """The inverse of `to_dict`.

        Raises
        ------
        ValueError
            If the record has another version, a key is missing, or a value is invalid.
        """
        new: Callable[..., Self] = cls
        with reading(record, f"calibration of {cls._what}", cls._version):
            complete = {**dict.fromkeys(cls._added), **record}
            found = new(**{name: one.read(complete[name]) for name, one in cls._codecs.items()})
            found._check()
        return found

    @overload
    def __getitem__(self, index: int) -> Calibration: ...

    @overload
    def __getitem__(self, index: slice) -> Self: ...

    def __getitem__(self, index: int | slice) -> Calibration | Self:
        frames = range(len(self))
        if isinstance(index, slice):
            return self._at(np.array(frames[index], dtype=np.intp))
        try:
            return self._frame(frames[index])
        except IndexError:
            raise IndexError(f"frame {index} is out of range: there are {len(self)} frames") from None

    def __iter__(self) -> Iterator[Calibration]:
        return (self._frame(t) for t in range(len(self)))

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return self is other or self.to_dict() == other.to_dict()

    def _repr_html_(self) -> str:
        """The field with what some frames see of it, and a table of these frames, for notebooks."""
        frames = {index: self[index] for index in spread(len(self))}
        cameras = [frame.camera for frame in frames.values() if frame.camera is not None]
        field = next((frame.field for frame in frames.values() if frame.field is not None), None)
        picture = "" if field is None else field.as_svg(cameras)
        rows = [[str(t), str(c.verdict), *camera_cells(c.camera if c else None), c.reason] for t, c in frames.items()]
        return picture + long_table(["frame", "verdict", *CAMERA_TITLES, "reason"], rows, len(self))

    @property
    def cameras(self) -> list[Camera | None]:
        """Cameras of the frames; None for frames without one."""
        return [frame.camera for frame in self]


@dataclass(frozen=True, eq=False, repr=False)
class SequenceCalibration(FrameSequence):
    """The calibrations of frames of one camera, and the parameters that the frames share.

    It is a sequence of `Calibration`, one for each frame, made on access. Their uncertainties are marginals: of the
    frame's own parameters and of those that it shares with the others. A slice keeps the shared parameters.

    Examples
    --------
    >>> from fieldcalib import calibrate_sequence, soccer
    >>> nothing = calibrate_sequence(soccer(), [{}, {}], (960, 540))
    >>> len(nothing), nothing.cameras, nothing.shared, str(nothing[0].status)
    (2, [None, None], {}, 'too few segments')
    >>> nothing[:1]
    SequenceCalibration(frames=1, accepted=0)
    """

    _what: ClassVar[str] = "a sequence"
    _version: ClassVar[int] = 3
    _codecs: ClassVar[Mapping[str, Codec]] = {
        "frames": Codec(FrameTable.to_dict, FrameTable.from_dict),
        "names": Codec(list, texts_from_json),
        "values": Codec(to_json, lambda values: sized(values, (len(values),), "'values'")),
        "covariance": Codec(to_json, lambda rows: from_json(rows).reshape(2 * (len(rows),))),
        "field": Codec(field_to_record, field_from_record).or_none,
        "together": Codec(int, partial(whole_number, name="together")),
        "layout": Codec(layout_to_record, layout_from_record).or_none,
        "considered": Codec(array_to_record, array_from_record),
        "alternatives": Codec(array_to_record, array_from_record),
    }
    frames: FrameTable
    names: tuple[str, ...] = ()
    """Names of the shared parameters (`fieldcalib.problem.layout`); empty if no position of the tripod was found."""
    values: Array = attribute(default_factory=lambda: np.zeros(0))
    """Estimates of the shared parameters, (S,)."""
    covariance: Array = attribute(default_factory=lambda: np.zeros((0, 0)))
    """Joint covariance of the shared parameters, (S, S)."""
    field: Field | None = None
    """The field, of the estimated size; None if the object is not a `Field`."""
    together: int = 0
    """Number of frames that the shared parameters were estimated from."""
    layout: Layout | None = None
    """Layout of the parameters of a frame; None if there is no camera."""
    considered: Array = attribute(default_factory=lambda: np.zeros((0, 0)))
    """Covariance of all considered parameters: the shared ones, and a field size that frames hardly determine."""
    alternatives: Array = attribute(default_factory=lambda: np.zeros((0, 3)))
    """Other centres that explain the frames equally well, (A, 3); searched only if the first solution was doubtful."""

    def __len__(self) -> int:
        return len(self.frames)

    def _frame(self, t: int) -> Calibration:
        frames, camera, errors = self.frames, None, None
        if self.layout is not None and np.isfinite(frames.theta[t]).all():
            camera = self.layout.camera(frames.theta[t])
            considered = Considered(self.layout, self.considered)
            covariance = whole_covariance(frames.own[t], frames.following[t], considered)
            errors = KnownErrors(self.layout, frames.theta[t], covariance, field=self.field)
        labelled = np.flatnonzero(frames.label_counts[t])
        return Calibration(
            camera,
            STATUSES[frames.status[t]],
            frames.message(t, tolerance_of(self.field)),
            float(frames.rms[t]),
            float("nan"),
            {frames.labels[k]: float(frames.label_errors[t, k]) for k in labelled},
            frames.suspects.get(t, ()),
            _found=self._found(t),
            pixel_counts={frames.labels[k]: int(frames.label_counts[t, k]) for k in labelled},
            field=self.field,
            errors=errors or NoErrors(),
            markings=frames.markings.get(t, ()),
        )

    def _check(self) -> None:
        count, frames, layout = len(self.names), self.frames, self.layout
        if self.values.shape != (count,) or self.covariance.shape != (count, count):
            raise ValueError(f"expected 'values' and 'covariance' of {count} shared parameters")
        for name, matrices in (("covariance", self.covariance), ("considered", self.considered), ("own", frames.own)):
            check_covariances(matrices, repr(name))
        if self.alternatives.ndim != 2 or self.alternatives.shape[1] != 3:
            raise ValueError(f"'alternatives': expected positions, got shape {self.alternatives.shape}")
        if layout is None:
            return
        check_parameters(layout, frames.theta)
        S = int(np.count_nonzero(layout.considered))
        if self.considered.shape != (S, S) or frames.following.shape[1:] != (np.count_nonzero(layout.free), S):
            raise ValueError(f"expected 'considered', 'own' and 'following' of the parameters of {layout}")

    def _found(self, t: int) -> tuple[Finding, ...]:
        """Evidence against the camera of frame t."""
        frames, metres = self.frames, float(self.frames.ground_error[t])
        suspects, labelled = frames.suspects.get(t, ()), int(np.count_nonzero(frames.label_counts[t]))
        found = [Finding(What.SUSPECTS, numbers=(len(suspects), labelled))] if suspects else []
        if metres > SURE * tolerance_of(self.field):
            found.append(Finding(What.INACCURATE, numbers=(metres,)))
        if not labelled and self.layout is not None and np.any(self.layout.free[PRINCIPAL_POINT]):
            found.append(Finding(What.NO_LINE))
        is_misfit = self.layout is not None and is_contradicted(frames.misfit[t], self.layout.image_size)
        if is_misfit and not paint_confirms(frames.markings.get(t, ())):  # paint overrules
            found.append(Finding(What.SHARED_MISFIT, numbers=(float(frames.misfit[t]),)))
        found += [Finding(What.OTHER_PLACE, numbers=tuple(place)) for place in self.alternatives.tolist()]
        return (*found, *frames.doubts.get(t, ()))

    def _at(self, index: IntArray) -> SequenceCalibration:
        return replace(self, frames=self.frames.at(index))

    def interpolated(self, run: IntArray, longest: int) -> SequenceCalibration:
        """Add cameras in gaps of up to `longest` frames without camera, between frames of the same run.

        Parameters
        ----------
        run : (T,) int array
            Number of the run of each frame; frames of a run are consecutive in time.
        """
        runs = real_array(run)
        if runs.shape != (len(self),) or not np.all(np.isfinite(runs)):
            raise ValueError(f"run must have a whole number for each of {len(self)} frames, got {short(run)}")
        longest = whole_number(longest, "longest")
        if self.layout is None:
            return self
        frames = interpolated(
            self.frames, runs.astype(np.intp), longest, Considered(self.layout, self.considered), self.field
        )
        return self if frames is self.frames else replace(self, frames=frames)

    def with_notes(self, others: Mapping[str, str]) -> SequenceCalibration:
        """Replace messages about frames by a mapping from old to new messages."""
        expect(others, Mapping, '{"old": "new"}')
        notes = {t: others.get(note, note) for t, note in self.frames.notes.items()}
        return replace(self, frames=replace(self.frames, notes=notes))

    def seen_in_images(self, markings: Mapping[int, tuple[MarkingInView, ...]]) -> SequenceCalibration:
        """Add the paint that images show of the markings of frames, as in `Calibration.seen_in_image`."""
        frames = self.frames
        status, notes = frames.status.copy(), dict(frames.notes)
        for t, seen in expect(markings, Mapping, "{0: calibration.markings}").items():
            if whole_number(t, "the number of a frame") >= len(self):
                raise ValueError(f"expected the number of a frame from 0 to {len(self) - 1}, got {t}")
            reason = contradiction(checked_markings(seen))
            if self.accepted[t] and reason:
                status[t], notes[t] = IMPROBABLE, "; ".join([reason, *([notes[t]] if t in notes else [])])
        return replace(self, frames=replace(frames, status=status, notes=notes, markings=markings))

    @property
    def crown(self) -> float:
        """Root mean square height of the middle of the field above its touchlines, metres, given all frames.

        See `fieldcalib.solve.sequence.joint_solution`. Where the frames determine it, the height itself is the ground
        of `field` and one of the shared parameters; otherwise cameras are those of a level field.
        """
        height = 0.0 if self.field is None else self.field.terrain.crown
        if self.layout is None or not np.any(self.layout.is_crown):
            return height
        return float(np.hypot(height, np.sqrt(self.considered[-1, -1])))  # it is the last parameter

    @property
    def accepted(self) -> BoolArray:
        """Mask (T,) of the frames with an accepted camera."""
        return np.asarray(self.frames.status == ACCEPTED)

    @property
    def usable(self) -> BoolArray:
        """Mask (T,) of the frames whose camera fits; its errors may be too large for it to be accepted."""
        fits = np.isin(self.frames.status, (ACCEPTED, IMPROBABLE))
        return np.asarray(fits & self.frames.has_camera)

    @property
    def basis(self) -> list[Basis]:
        """Data that the camera of each frame rests on."""
        return [BASES[index] for index in self.frames.basis]

    @property
    def shared(self) -> Mapping[str, tuple[float, float]]:
        """Estimate and standard deviation of each shared parameter, by name."""
        sigma = np.sqrt(np.diagonal(self.covariance))
        return {name: (float(v), float(s)) for name, v, s in zip(self.names, self.values, sigma, strict=True)}

    def to_pandas(self) -> pandas.DataFrame:
        """One row per frame: status, basis, angles in degrees, focal length in pixels, position and errors in metres.

        Raises
        ------
        ImportError
            Without pandas, ``pip install fieldcalib[pandas]``.
        """
        pandas = imported("pandas", "pandas", "to_pandas")
        frames, T = self.frames, len(self)
        theta = np.full((T, CENTER.stop), np.nan) if self.layout is None else self.layout.at_zoom(frames.theta)
        angles, f, C = np.degrees(theta[:, ANGLES]), exp_of(theta, LOG_F), theta[:, CENTER]
        numbers = np.column_stack([angles, f, C, frames.rms, frames.ground_error])
        words = {"status": [str(STATUSES[one]) for one in frames.status], "basis": [str(one) for one in self.basis]}
        return pandas.DataFrame({**words, **dict(zip(NUMBERS, numbers.T, strict=True))})


def with_doubts(calibration: SequenceCalibration, numbers: Iterable[int], *doubts: Finding) -> SequenceCalibration:
    """Add evidence against the cameras of some frames, after what speaks against them already."""
    frames = calibration.frames
    added = {t: (*frames.doubts.get(t, ()), *doubts) for t in numbers}
    return replace(calibration, frames=replace(frames, doubts={**frames.doubts, **added}))
