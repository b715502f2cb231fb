"""Frames of a sequence as a table of columns, which takes a tenth of the memory of their calibrations.

Interpolation of missing cameras between those of the frames before and after.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from dataclasses import field as attribute
from enum import StrEnum
from reprlib import repr as short
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fieldcalib._json import from_json, texts_from_json, to_json
from fieldcalib._types import LARGEST, Array, BoolArray, Float32, IntArray, expect, whole_number
from fieldcalib.assess.findings import Finding, Status, SuspectLabel, findings_from_json
from fieldcalib.assess.ground import Considered
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.assess.sequence_errors import OwnErrors, ground_errors
from fieldcalib.fields.field import Field, tolerance_of
from fieldcalib.problem.layout import PRINCIPAL_POINT, Layout

STATUSES = tuple(Status)
ACCEPTED, IMPROBABLE = STATUSES.index(Status.ACCEPTED), STATUSES.index(Status.IMPROBABLE)

Value = TypeVar("Value")

# Standard deviations from a uniform motion, for each missing frame:
STEP = 1e-3  # radians, or of log f,
STEP_OF_CENTRE = 0.05  # m, of a camera that moves,
STEP_OF_POINT = 2e-3  # widths of the picture, of the principal point where a window moves


class Basis(StrEnum):
    """Data that the camera of a frame rests on."""

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
class FrameTable:
    """T frames, one row each. Columns are arrays, or mappings from the frames that have an entry."""

    theta: Array
    """Parameters, (T, n); NaN where there is no camera."""
    own: Array
    """E of `fieldcalib.assess.sequence_errors`, (T, o, o)."""
    following: Array
    """F of `fieldcalib.assess.sequence_errors`, (T, o, S)."""
    status: IntArray
    """Index into `STATUSES`, (T,)."""
    basis: IntArray
    """Index into `BASES`, (T,)."""
    rms: Array
    """Root mean square distance of the labelled pixels, (T,)."""
    ground_error: Array
    """Root mean square error of field points, metres, median over those in view, (T,); NaN where none is in view."""
    labels: tuple[str, ...]
    """Labels of the object, L of them."""
    label_errors: Float32
    """Root mean square distance of the pixels of each label, (T, L)."""
    label_counts: NDArray[np.uint16]
    """Number of pixels of each label, (T, L)."""
    notes: Mapping[int, str]
    """Further messages about single frames."""
    suspects: Mapping[int, tuple[SuspectLabel, ...]]
    """Labels that the rest of their frame contradicts."""
    misfit: Array
    """Distance of the labels due to sharing parameters (`fieldcalib.assess.label_errors`), pixels, interpolated between
    frames, (T,); NaN where it is unknown."""
    markings: Mapping[int, tuple[MarkingInView, ...]] = attribute(default_factory=dict)
    """Paint that the images show of the markings in view."""
    doubts: Mapping[int, tuple[Finding, ...]] = attribute(default_factory=dict)
    """Further evidence against the camera of a frame."""

    @classmethod
    def without_cameras(cls, count: int, layout: Layout, labels: tuple[str, ...], message: str) -> FrameTable:
        """A table of frames without cameras; `message` is the reason."""
        o, S = np.count_nonzero(layout.free), np.count_nonzero(layout.considered)
        unknown: dict[str, Any] = {name: np.full(count, np.nan) for name in ("rms", "ground_error", "misfit")}
        return cls(
            **unknown,
            theta=np.full((count, layout.size), np.nan),
            own=np.full((count, o, o), np.nan),
            following=np.full((count, o, S), np.nan),
            status=np.full(count, STATUSES.index(Status.TOO_FEW_SEGMENTS)),
            basis=np.zeros(count, dtype=np.intp),
            labels=labels,
            label_errors=np.zeros((count, len(labels)), np.float32),
            label_counts=np.zeros((count, len(labels)), np.uint16),
            notes=dict.fromkeys(range(count), message),
            suspects={},
        )

    @classmethod
    def joined(cls, tables: Sequence[FrameTable]) -> FrameTable:
        """The frames of several tables with the same columns, one table after the other."""
        begins = np.cumsum([0, *map(len, tables)]).tolist()

        def column(name: str) -> Any:
            each = [getattr(table, name) for table in tables]
            if isinstance(each[0], Mapping):
                return {begin + t: value for begin, one in zip(begins, each, strict=False) for t, value in one.items()}
            return np.concatenate(each) if isinstance(each[0], np.ndarray) else each[0]

        return cls(**{one.name: column(one.name) for one in fields(cls)})

    def __len__(self) -> int:
        return len(self.theta)

    @property
    def has_camera(self) -> BoolArray:
        """Mask (T,) of the frames that have a camera."""
        return np.asarray(np.isfinite(self.theta).all(axis=1) & (self.theta.shape[1] > 0))

    def at(self, index: IntArray) -> FrameTable:
        """Some of the frames, in that order."""
        place = list(enumerate(index.tolist()))

        def taken(column: Any) -> Any:
            if isinstance(column, Mapping):
                return {k: column[t] for k, t in place if t in column}
            return column[index] if isinstance(column, np.ndarray) else column

        return FrameTable(**{name: taken(column) for name, column in self._columns.items()})

    def replaced(self, index: IntArray, rows: FrameTable) -> FrameTable:
        """The table with frames `index` (B,) replaced by the B rows of another one."""
        number = index.tolist()
        gone = set(number)

        def merged(old: Any, new: Any) -> Any:
            if isinstance(old, Mapping):
                kept = {t: value for t, value in old.items() if t not in gone}
                return kept | {number[k]: value for k, value in new.items()}
            if isinstance(old, np.ndarray):
                old = old.copy()
                old[index] = new
            return old

        return FrameTable(**{name: merged(old, getattr(rows, name)) for name, old in self._columns.items()})

    def with_cameras(
        self, theta: Array, errors: OwnErrors, ground_error: Array, basis: Basis, tolerance: float
    ) -> FrameTable:
        """The table with cameras (T, n) that rest on other frames; those known to `tolerance` metres are accepted."""
        return replace(
            self,
            theta=theta,
            own=errors.own,
            following=errors.following,
            ground_error=ground_error,
            status=np.where(ground_error > tolerance, IMPROBABLE, ACCEPTED),
            basis=np.full(len(self), BASES.index(basis)),
            notes={},
        )

    def with_misfit(self, misfit: Mapping[int, float]) -> FrameTable:
        """The table with the misfit of some frames in pixels, interpolated for other frames with a camera."""
        known = sorted(t for t, excess in misfit.items() if np.isfinite(excess))
        if not known:
            return self
        interpolated = np.interp(np.arange(len(self)), known, [misfit[t] for t in known])
        return replace(self, misfit=np.where(self.has_camera, interpolated, self.misfit))

    def message(self, t: int, tolerance: float) -> str:
        """Reason for the status of frame t; frames known to `tolerance` metres are accepted."""
        labelled, basis = int(np.count_nonzero(self.label_counts[t])), BASES[self.basis[t]]
        parts = [self.notes[t]] if t in self.notes else []
        if labelled and basis in (Basis.LINES, Basis.BOTH):
            parts.append(f"rms {self.rms[t]:.2f} px over {labelled} segment{'s' * (labelled != 1)}")
        if np.isfinite(self.ground_error[t]):
            how = basis if basis is Basis.INTERPOLATED else f"by {basis}"
            is_over = self.status[t] == IMPROBABLE and self.ground_error[t] > tolerance
            limit = f", and at most {tolerance:g} m are accepted" if is_over else ""
            parts.append(f"{how}, the field in view to {self.ground_error[t]:.2f} m{limit}")
        return "; ".join(parts)

    def to_dict(self) -> dict[str, Any]:
        """Everything, for `json.dumps`."""
        return {
            **{name: array_to_record(value) for name, value in self._columns.items() if isinstance(value, np.ndarray)},
            "labels": list(self.labels),
            "notes": [[t, note] for t, note in self.notes.items()],
            "suspects": [
                [t, [[s.label, s.fits, to_json(s.error_px)] for s in some]] for t, some in self.suspects.items()
            ],
            "markings": [[t, [asdict(one) for one in found]] for t, found in self.markings.items()],
            "doubts": [[t, [one.to_dict() for one in found]] for t, found in self.doubts.items()],
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> FrameTable:
        """The inverse of `to_dict`; a ValueError if its columns are not of the same frames."""
        labels = texts_from_json(record["labels"])
        T, n = record["theta"]["shape"]
        o, S = record["following"]["shape"][1:]
        shapes = {"theta": (T, n), "own": (T, o, o), "following": (T, o, S)}
        shapes |= dict.fromkeys(("label_errors", "label_counts"), (T, len(labels)))
        shapes |= dict.fromkeys(("status", "basis", "rms", "ground_error", "misfit"), (T,))
        arrays: dict[str, Any] = {name: array_from_record(record[name]) for name in shapes}
        for name, shape in shapes.items():
            if arrays[name].shape != shape:
                raise ValueError(f"{name!r}: expected shape {shape}, got {arrays[name].shape}")
        for name, words in (("status", STATUSES), ("basis", BASES)):
            check_indices(arrays[name], len(words), name)

        def by_frame(name: str, read: Callable[[Any], Value]) -> dict[int, Value]:
            return {whole_number(t, "the number of a frame"): read(value) for t, value in record.get(name, ())}

        return cls(
            **arrays,
            labels=labels,
            notes=by_frame("notes", lambda note: expect(note, str, '"no labelled pixels"')),
            suspects=by_frame("suspects", lambda found: tuple(_suspect(*one) for one in found)),
            markings=by_frame("markings", lambda found: tuple(MarkingInView(**one) for one in found)),
            doubts=by_frame("doubts", lambda found: findings_from_json([found] if isinstance(found, str) else found)),
        )

    @property
    def _columns(self) -> dict[str, Any]:
        return {one.name: getattr(self, one.name) for one in fields(self)}


def _suspect(label: Any, fits: Any, error_px: Any) -> SuspectLabel:
    return SuspectLabel(label, fits, float(from_json(error_px)))


def array_to_record(array: NDArray[Any]) -> dict[str, Any]:
    """Shape, type and values of an array, for `json.dumps`."""
    return {"shape": array.shape, "type": array.dtype.str, "values": to_json(array.ravel())}


def array_from_record(record: Mapping[str, Any]) -> NDArray[Any]:
    """The inverse of `array_to_record`."""
    kind = np.dtype(expect(record["type"], str, '"<f8"'))
    if kind.kind not in "fiu":
        raise ValueError(f"expected an array of numbers, got one of {kind}")
    values = from_json(record["values"])
    if np.any(np.abs(values[np.isfinite(values)]) > LARGEST):
        raise ValueError(f"expected numbers up to {LARGEST:g}, got {np.max(np.abs(values[np.isfinite(values)])):g}")
    return values.astype(kind).reshape(record["shape"])


def check_indices(index: NDArray[Any], count: int, name: str, least: int = 0) -> None:
    """Check indices of a record into `count` things; `least` is -1 where that stands for none."""
    if index.dtype.kind not in "iu" or np.any((index < least) | (index >= count)):
        raise ValueError(f"{name!r}: expected whole numbers from {least} to {count - 1}, got {short(index.tolist())}")


class Gaps(NamedTuple):
    """Frames to interpolate, and the nearest frames with a camera around them, (G,) each."""

    missing: IntArray
    before: IntArray
    after: IntArray

    @property
    def length(self) -> Array:
        """Number of frames from `before` to `after`, (G, 1)."""
        return np.asarray(self.after - self.before, dtype=float)[:, None]

    @property
    def share(self) -> Array:
        """Position of each frame between `before` and `after`, from 0 to 1, (G, 1)."""
        return np.asarray((self.missing - self.before)[:, None] / self.length)

    def between(self, values: Array) -> Array:
        """Values (G, ...), interpolated linearly from those of all frames, (T, ...)."""
        share = self.share.reshape(-1, *(1,) * (values.ndim - 1))
        return np.asarray((1.0 - share) * values[self.before] + share * values[self.after])


def interpolated(
    frames: FrameTable, run: IntArray, longest: int, considered: Considered, field: Field | None
) -> FrameTable:
    """Add cameras in gaps of up to `longest` frames without camera, between frames of the same run (T,)."""
    gaps = _gaps(frames, run, longest)
    if not len(gaps.missing):
        return frames
    layout, free = considered.layout, considered.layout.free
    bend = _bend(frames, run, gaps)
    bend[:, ~free] = 0.0
    at_start = frames.theta[gaps.before]
    theta = at_start + gaps.share * (frames.theta[gaps.after] - at_start) + bend
    uneven = gaps.share * (1.0 - gaps.share) * _step(layout)[free] * gaps.length
    spread = 0.5 * np.abs(bend[:, free]) + uneven
    own = gaps.between(frames.own) + spread[..., None] ** 2 * np.eye(int(np.count_nonzero(free)))
    errors = OwnErrors(own, gaps.between(frames.following))
    metres = ground_errors(theta, errors, considered, field)
    rows = frames.at(gaps.missing).with_cameras(theta, errors, metres, Basis.INTERPOLATED, tolerance_of(field))
    misfit = np.fmax(frames.misfit[gaps.before], frames.misfit[gaps.after])  # a wrong camera makes others wrong
    return frames.replaced(gaps.missing, replace(rows, misfit=misfit))


def _gaps(frames: FrameTable, run: IntArray, longest: int) -> Gaps:
    has = frames.has_camera
    known, missing = np.flatnonzero(has), np.flatnonzero(~has)
    place = np.searchsorted(known, missing)
    inside = (place > 0) & (place < len(known))
    missing, place = missing[inside], place[inside]
    before, after = known[place - 1], known[place]
    near = (run[before] == run[missing]) & (run[missing] == run[after]) & (after - before - 1 <= longest)
    return Gaps(missing[near], before[near], after[near])


def _bend(frames: FrameTable, run: IntArray, gaps: Gaps) -> Array:
    """Difference (G, n) between Hermite's cubic, with the slopes at both ends of the gap, and a uniform motion."""
    has, change = frames.has_camera, frames.theta[gaps.after] - frames.theta[gaps.before]

    def slope(near: IntArray, far: IntArray) -> Array:
        """Slope at one end of each gap: to the next frame beyond it if that has a camera, else of a uniform motion."""
        far = np.clip(far, 0, len(has) - 1)
        usable = (has[far] & (run[far] == run[near]) & (far != near))[:, None]
        beyond = gaps.length * (far - near)[:, None] * (frames.theta[far] - frames.theta[near])
        return np.asarray(np.where(usable, beyond, change))

    share, at_start, at_end = gaps.share, slope(gaps.before, gaps.before - 1), slope(gaps.after, gaps.after + 1)
    return np.asarray(share * (1.0 - share) * ((1.0 - share) * (at_start - change) - share * (at_end - change)))


def _step(layout: Layout) -> Array:
    """Standard deviation of each parameter from a uniform motion, for each frame that is missing, (n,)."""
    step = np.where(layout.is_centre, STEP_OF_CENTRE, STEP)
    step[PRINCIPAL_POINT] = STEP_OF_POINT * layout.image_size[0]
    return step
