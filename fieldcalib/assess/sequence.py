"""What the calibration of frames of one tripod returns: the frames, and what they share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from dataclasses import field as attribute
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fieldcalib._extras import imported
from fieldcalib._json import from_json, to_json
from fieldcalib._types import Array, BoolArray, Float32, IntArray
from fieldcalib.assess.camera_errors import KnownErrors, NoErrors
from fieldcalib.assess.frame_sequence import FrameSequence, read_record
from fieldcalib.assess.level import if_level
from fieldcalib.assess.markings import MarkingInView, paint_complaints, paint_confirms, paint_contradicts
from fieldcalib.assess.misfit import is_contradicted
from fieldcalib.assess.own_errors import OwnErrors, ground_errors, whole_covariance
from fieldcalib.assess.result import Calibration, Status, SuspectLabel
from fieldcalib.fields.field import Field
from fieldcalib.fields.records import field_from_record, field_to_record
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F, PRINCIPAL_POINT, Layout, exp_of
from fieldcalib.problem.records import layout_from_record, layout_to_record

if TYPE_CHECKING:
    import pandas

VERSION = 3  # of `SequenceCalibration.to_dict`
SURE = 0.5  # m: what is known of the field in view to no better than that is to be looked at
LARGEST_ERROR = 1.0  # m over the field in view: frames that others tell are accepted up to that
STEP = 1e-3  # radians, or of log f, by which a frame may be off an even motion, for each frame that is missing,
STEP_OF_CENTRE = 0.05  # and m, of a camera that moves,
STEP_OF_POINT = 2e-3  # and widths of the picture, of the principal point where a window moves
STATUSES = tuple(Status)
NUMBERS = (  # columns of the table of frames, NaN of those without a camera
    *("pan_degrees", "tilt_degrees", "roll_degrees", "focal_length_px", "x_m", "y_m", "z_m"),
    *("rms_px", "ground_error_m"),
)


class Basis(StrEnum):
    """What the camera of a frame rests on."""

    NOTHING = ""
    """There is no camera."""
    LINES = "lines"
    """Labelled pixels of this frame."""
    MATCHES = "matches"
    """Static points that other frames see too."""
    BOTH = "lines and matches"
    INTERPOLATED = "interpolated"
    """The frames before and after it."""


BASES = tuple(Basis)


@dataclass(frozen=True, eq=False)
class Frames:
    """T frames in columns, which take a tenth of the room of as many calibrations."""

    theta: Array
    """Parameters, (T, n); NaN where there is no camera."""
    own: Array
    """E of `fieldcalib.assess.own_errors`, (T, o, o)."""
    following: Array
    """F, (T, o, S)."""
    status: IntArray
    """Index into `STATUSES`, (T,)."""
    basis: IntArray
    """Index into `BASES`, (T,)."""
    rms: Array
    """Root mean square distance of the labelled pixels, (T,)."""
    ground_error: Array
    """Root mean square error of the field, metres, the median over what is in view, (T,); NaN where none is."""
    labels: tuple[str, ...]
    label_errors: Float32
    """Root mean square distance of each label's pixels, (T, L)."""
    label_counts: NDArray[np.uint16]
    """Number of pixels of each label, (T, L)."""
    notes: Mapping[int, str]
    """Messages of frames for which the numbers do not say everything."""
    suspects: Mapping[int, tuple[SuspectLabel, ...]]
    """Labels that the rest of a frame contradicts."""
    misfit: Array
    """By how much the labels of each frame lie farther off its camera than off one with a place of its own, pixels, or
    those of the frames around it, (T,); NaN where that is unknown (`fieldcalib.assess.misfit`)."""
    markings: Mapping[int, tuple[MarkingInView, ...]] = attribute(default_factory=dict)
    """What the images of frames show of the markings in view."""
    doubts: Mapping[int, str] = attribute(default_factory=dict)
    """What else speaks against the cameras of frames."""

    def __len__(self) -> int:
        return len(self.theta)

    def at(self, index: IntArray) -> Frames:
        """Some of the frames, in that order."""
        columns: dict[str, Any] = {one.name: getattr(self, one.name) for one in fields(self)}
        columns = {name: value[index] for name, value in columns.items() if isinstance(value, np.ndarray)}
        place = list(enumerate(index.tolist()))
        return replace(
            self,
            **columns,
            notes={k: self.notes[t] for k, t in place if t in self.notes},
            suspects={k: self.suspects[t] for k, t in place if t in self.suspects},
            markings={k: self.markings[t] for k, t in place if t in self.markings},
            doubts={k: self.doubts[t] for k, t in place if t in self.doubts},
        )

    def message(self, t: int) -> str:
        """Why frame t has the status that it has."""
        labelled, basis = int(np.count_nonzero(self.label_counts[t])), BASES[self.basis[t]]
        parts = [self.notes[t]] if t in self.notes else []
        if labelled and basis in (Basis.LINES, Basis.BOTH):
            parts.append(f"rms {self.rms[t]:.2f} px over {labelled} segment{'s' * (labelled != 1)}")
        if np.isfinite(self.ground_error[t]):
            how = basis if basis is Basis.INTERPOLATED else f"by {basis}"
            parts.append(f"{how}, the field in view to {self.ground_error[t]:.2f} m")
        return "; ".join(parts)

    def to_dict(self) -> dict[str, Any]:
        """Everything, for `json.dumps`."""
        columns = {one.name: getattr(self, one.name) for one in fields(self)}
        suspects = {t: [[s.label, s.fits, to_json(s.error_px)] for s in found] for t, found in self.suspects.items()}
        return {
            **{name: _to_record(value) for name, value in columns.items() if isinstance(value, np.ndarray)},
            "labels": list(self.labels),
            "notes": [[t, note] for t, note in self.notes.items()],
            "suspects": [[t, found] for t, found in suspects.items()],
            "markings": [[t, [asdict(one) for one in found]] for t, found in self.markings.items()],
            "doubts": [[t, doubt] for t, doubt in self.doubts.items()],
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Frames:
        """The inverse of `to_dict`."""
        arrays: dict[str, Any] = {
            name: _from_record(value) for name, value in record.items() if isinstance(value, dict)
        }
        suspects = {
            t: tuple(SuspectLabel(label, fits, float(from_json(error))) for label, fits, error in found)
            for t, found in record["suspects"]
        }
        markings = {t: tuple(MarkingInView(**one) for one in found) for t, found in record.get("markings", ())}
        notes, doubts = dict(record["notes"]), dict(record.get("doubts", ()))
        return cls(
            **arrays, labels=tuple(record["labels"]), notes=notes, suspects=suspects, markings=markings, doubts=doubts
        )


def _place(centre: Array) -> str:
    return "({:.1f}, {:.1f}, {:.1f})".format(*centre.tolist())


def _to_record(array: NDArray[Any]) -> dict[str, Any]:
    return {"shape": array.shape, "type": array.dtype.str, "values": to_json(array.ravel())}


def _from_record(record: Mapping[str, Any]) -> NDArray[Any]:
    return np.array(from_json(record["values"])).astype(record["type"]).reshape(record["shape"])


@dataclass(frozen=True, eq=False)
class SequenceCalibration(FrameSequence):
    """The calibrations of frames of one tripod, and what the frames share.

    It is a sequence of `Calibration`, one for each frame, which are made when they are asked for. Their uncertainties
    are the frames' own marginals: what a frame alone leaves open, and what all frames together leave open of what they
    share. A slice keeps what is shared.

    Examples
    --------
    >>> from fieldcalib import calibrate_sequence, soccer
    >>> nothing = calibrate_sequence(soccer(), [{}, {}], (960, 540))
    >>> len(nothing), nothing.cameras, nothing.shared, str(nothing[0].status)
    (2, [None, None], {}, 'too few segments')
    >>> nothing[:1]
    SequenceCalibration(names=(), together=0)
    """

    frames: Frames = attribute(repr=False)
    names: tuple[str, ...] = ()
    """Of the shared parameters (`fieldcalib.problem.layout`); none where no place of the tripod was found."""
    values: Array = attribute(default_factory=lambda: np.zeros(0), repr=False)
    """Their estimates, (S,)."""
    covariance: Array = attribute(default_factory=lambda: np.zeros((0, 0)), repr=False)
    """Their joint covariance, (S, S)."""
    field: Field | None = attribute(default=None, repr=False)
    """The field, of the estimated size; None if the object is no `Field`."""
    together: int = 0
    """Number of frames that the shared parameters were estimated from."""
    layout: Layout | None = attribute(default=None, repr=False)
    """Of the parameters of a frame; None where there is no camera."""
    considered: Array = attribute(default_factory=lambda: np.zeros((0, 0)), repr=False)
    """Covariance of all parameters that the layout considers: the shared ones, and a size that is hardly told."""
    alternatives: Array = attribute(default_factory=lambda: np.zeros((0, 3)), repr=False)
    """Other centres that explain the frames as well, (A, 3); known only where the first solution was doubted."""

    def __len__(self) -> int:
        return len(self.frames)

    def _frame(self, t: int) -> Calibration:
        frames, status, camera, errors = self.frames, STATUSES[self.frames.status[t]], None, None
        if self.layout is not None and np.isfinite(frames.theta[t]).all():
            camera = self.layout.camera(frames.theta[t])
            covariance = whole_covariance(frames.own[t], frames.following[t], self.considered, self.layout)
            errors = KnownErrors(self.layout, frames.theta[t], covariance)
        labelled = np.flatnonzero(frames.label_counts[t])
        suspects, metres = frames.suspects.get(t, ()), float(frames.ground_error[t])
        doubts = [f"{len(suspects)} of {len(labelled)} labels are suspect"] if suspects else []
        doubts += [f"the field in view is known to {metres:.1f} m only"] if metres > SURE else []
        if not len(labelled) and self.layout is not None and np.any(self.layout.free[PRINCIPAL_POINT]):
            doubts.append("no line of it tells where its window is: static points hardly tell that from a turn")
        markings = frames.markings.get(t, ())
        is_misfit = self.layout is not None and is_contradicted(frames.misfit[t], self.layout.image_size)
        if is_misfit and not paint_confirms(markings):  # paint has the last word
            doubts.append(f"what the frames share brings its lines {frames.misfit[t]:.0f} px off")
        doubts += [f"its camera may as well stand at {_place(centre)}" for centre in self.alternatives]
        doubts += [frames.doubts[t]] if t in frames.doubts else []
        return Calibration(
            camera,
            status,
            frames.message(t),
            float(frames.rms[t]),
            float("nan"),
            {frames.labels[k]: float(frames.label_errors[t, k]) for k in labelled},
            suspects,
            complaints=tuple(doubts),
            pixel_counts={frames.labels[k]: int(frames.label_counts[t, k]) for k in labelled},
            field=self.field,
            errors=errors or NoErrors(),
            markings=markings,
        )

    def _at(self, index: IntArray) -> SequenceCalibration:
        return replace(self, frames=self.frames.at(index))

    def interpolated(self, run: IntArray, longest: int) -> SequenceCalibration:
        """With cameras for up to `longest` frames in a row that have none, between frames of the same run that have.

        Parameters
        ----------
        run : (T,) int array
            Frames with the same number follow one another.
        """
        frames = self.frames
        has = np.isfinite(frames.theta).all(axis=1) & (frames.theta.shape[1] > 0)
        known, missing = np.flatnonzero(has), np.flatnonzero(~has)
        if not len(known) or not len(missing) or self.layout is None:
            return self
        place = np.searchsorted(known, missing)
        inside = (place > 0) & (place < len(known))
        missing, place = missing[inside], place[inside]
        before, after = known[place - 1], known[place]
        near = (run[before] == run[missing]) & (run[missing] == run[after]) & (after - before - 1 <= longest)
        index, before, after = missing[near], before[near], after[near]
        gap = (after - before)[:, None]
        share = (index - before)[:, None] / gap
        at_both = frames.theta[before], frames.theta[after]
        change = at_both[1] - at_both[0]

        def slope(near: IntArray, far: IntArray) -> Array:
            """Change per gap at one end: that to the next frame beyond it, where this has a camera."""
            far = np.clip(far, 0, len(has) - 1)
            usable = (has[far] & (run[far] == run[near]) & (far != near))[:, None]
            return np.asarray(
                np.where(usable, gap * (far - near)[:, None] * (frames.theta[far] - frames.theta[near]), change)
            )

        # Hermite's cubic: even motion, and what the slopes at both ends add to it
        bend = (
            share
            * (1.0 - share)
            * ((1.0 - share) * (slope(before, before - 1) - change) - share * (slope(after, after + 1) - change))
        )
        bend[:, ~self.layout.free] = 0.0
        theta = at_both[0] + share * change + bend
        free = self.layout.free
        step = np.where(self.layout.is_centre, STEP_OF_CENTRE, STEP)
        step[PRINCIPAL_POINT] = STEP_OF_POINT * self.layout.image_size[0]
        step = step[free]
        spread = 0.5 * np.abs(bend[:, free]) + share * (1.0 - share) * step * gap
        share = share[..., None]
        own = (
            (1.0 - share) * frames.own[before]
            + share * frames.own[after]
            + spread[..., None] ** 2 * np.eye(int(np.count_nonzero(free)))
        )
        following = (1.0 - share) * frames.following[before] + share * frames.following[after]
        metres = ground_errors(theta, self.layout, OwnErrors(own, following), self.considered, self.field)
        values = {
            "theta": theta,
            "own": own,
            "following": following,
            "ground_error": metres,
            "misfit": np.fmax(frames.misfit[before], frames.misfit[after]),  # a wrong camera makes others wrong
        }
        columns = {name: getattr(frames, name).copy() for name in (*values, "status", "basis")}
        for name, one in values.items():
            columns[name][index] = one
        columns["basis"][index] = BASES.index(Basis.INTERPOLATED)
        status = np.where(metres > LARGEST_ERROR, STATUSES.index(Status.IMPROBABLE), STATUSES.index(Status.ACCEPTED))
        columns["status"][index] = status
        notes = {t: note for t, note in frames.notes.items() if t not in set(index.tolist())}
        return replace(self, frames=replace(frames, notes=notes, **columns))

    def with_notes(self, others: Mapping[str, str]) -> SequenceCalibration:
        """With other messages of frames for which the numbers do not say everything, by those of before."""
        notes = {t: others.get(note, note) for t, note in self.frames.notes.items()}
        return replace(self, frames=replace(self.frames, notes=notes))

    def doubted(self, doubts: Mapping[int, str]) -> SequenceCalibration:
        """With what else speaks against the cameras of some frames."""
        return replace(self, frames=replace(self.frames, doubts={**self.frames.doubts, **doubts}))

    def seen_in_images(self, markings: Mapping[int, tuple[MarkingInView, ...]]) -> SequenceCalibration:
        """Add what the images of frames show of their markings, as `Calibration.seen_in_image`."""
        frames = self.frames
        status, notes = frames.status.copy(), dict(frames.notes)
        for t, seen in markings.items():
            if self.accepted[t] and paint_contradicts(seen):
                status[t] = STATUSES.index(Status.IMPROBABLE)
                words = "; ".join([*paint_complaints(seen), *([notes[t]] if t in notes else [])])
                notes[t] = f"most of the paint lies beside the markings: {words}"
        return replace(self, frames=replace(frames, status=status, notes=notes, markings=markings))

    @property
    def crown(self) -> float:
        """Root mean square height, metres, that the middle of the field may have above its touchlines.

        It is what the frames tell of it (`fieldcalib.assess.crown`), 0 where all such fields are level. Their cameras
        are those of a level field.
        """
        if self.layout is None or not np.any(self.layout.is_crown):
            return 0.0
        return float(np.sqrt(self.considered[-1, -1]))  # it is the last parameter

    @property
    def covariance_if_level(self) -> Array:
        """`covariance` if the field were known to be level (`fieldcalib.fields.crown`), (S, S)."""
        if self.layout is None or not np.any(self.layout.is_crown):
            return self.covariance
        names = np.array(self.layout.names)[self.layout.considered].tolist()
        index = [names.index(name) for name in self.names]
        return if_level(self.considered, self.layout.is_crown[self.layout.considered])[np.ix_(index, index)]

    @property
    def accepted(self) -> BoolArray:
        """Which frames have a camera that is accepted, (T,)."""
        return np.asarray(self.frames.status == STATUSES.index(Status.ACCEPTED))

    @property
    def usable(self) -> BoolArray:
        """Which frames have a camera that fits, though it may be known too badly to be accepted, (T,)."""
        fits = self.accepted | (self.frames.status == STATUSES.index(Status.IMPROBABLE))
        return np.asarray(fits & np.isfinite(self.frames.theta).all(axis=1))

    @property
    def basis(self) -> list[Basis]:
        """What the camera of each frame rests on."""
        return [BASES[index] for index in self.frames.basis]

    @property
    def shared(self) -> Mapping[str, tuple[float, float]]:
        """Estimate and standard deviation of each shared parameter, by name."""
        sigma = np.sqrt(np.diagonal(self.covariance))
        return {name: (float(v), float(s)) for name, v, s in zip(self.names, self.values, sigma, strict=True)}

    def to_pandas(self) -> pandas.DataFrame:
        """One row a frame: status, basis, angles in degrees, focal length in pixels, place and errors in metres.

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

    def to_dict(self) -> dict[str, Any]:
        """Everything as JSON, for `json.dumps`."""
        return {
            "version": VERSION,
            "frames": self.frames.to_dict(),
            "names": list(self.names),
            "values": to_json(self.values),
            "covariance": to_json(self.covariance),
            "field": None if self.field is None else field_to_record(self.field),
            "together": self.together,
            "layout": None if self.layout is None else layout_to_record(self.layout),
            "considered": _to_record(self.considered),
            "alternatives": _to_record(self.alternatives),
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> SequenceCalibration:
        """The inverse of `to_dict`.

        Raises
        ------
        ValueError
            If the record is of another version, a key is missing, or a value cannot be right.
        """
        return read_record(record, "a sequence", VERSION, cls._from_record)

    @classmethod
    def _from_record(cls, record: Mapping[str, Any]) -> SequenceCalibration:
        return cls(
            Frames.from_dict(record["frames"]),
            tuple(record["names"]),
            from_json(record["values"]),
            from_json(record["covariance"]).reshape(2 * (len(record["names"]),)),
            None if record["field"] is None else field_from_record(record["field"]),
            record["together"],
            None if record["layout"] is None else layout_from_record(record["layout"]),
            _from_record(record["considered"]),
            _from_record(record["alternatives"]),
        )
