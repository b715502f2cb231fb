"""Frames of a sequence, gathered in columns as they are solved."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.level import if_level
from fieldcalib.assess.own_errors import OwnErrors, ground_errors
from fieldcalib.assess.result import Calibration, Status, SuspectLabel
from fieldcalib.assess.sequence_calibration import BASES, LARGEST_ERROR, STATUSES, Basis, Frames
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.solve.options import Options


class FrameColumns:
    """T frames of which some are filled already.

    Parameters
    ----------
    count : int
        T.
    labels : tuple of str
        Of the object.
    options : Options
        What is free in them is the frames' own, what they consider is what the frames share.
    considered : (S, S) array
        Its covariance.
    message : str
        Of frames that nothing is filled in for.
    largest_error : float
        Metres, of the field in view: a camera that is known no better is not accepted.
    """

    def __init__(
        self,
        count: int,
        labels: tuple[str, ...],
        options: Options,
        considered: Array,
        message: str,
        largest_error: float = LARGEST_ERROR,
    ) -> None:
        layout = options.layout
        own, shared = np.count_nonzero(layout.free), np.count_nonzero(layout.considered)
        self.options, self.considered, self.labels = options, considered, labels
        self.largest_error = largest_error
        self.theta = np.full((count, layout.size), np.nan)
        self.errors = OwnErrors(np.full((count, own, own), np.nan), np.full((count, own, shared), np.nan))
        self.status = np.full(count, STATUSES.index(Status.TOO_FEW_SEGMENTS))
        self.basis = np.zeros(count, dtype=np.intp)
        self.rms, self.ground_error = np.full(count, np.nan), np.full(count, np.nan)
        self.label_errors = np.zeros((count, len(labels)), np.float32)
        self.label_counts = np.zeros((count, len(labels)), np.uint16)
        self.notes = dict.fromkeys(range(count), message)
        self.suspects: dict[int, tuple[SuspectLabel, ...]] = {}
        self.misfit = np.full(count, np.nan)

    def fill(
        self,
        index: IntArray,
        evaluation: Evaluation,
        errors: OwnErrors,
        *,
        tied: BoolArray,
        alone: Mapping[int, Calibration],
    ) -> None:
        """Frames `index` at their solutions, with what is known of their own errors.

        What some of them were `alone` says which labels are suspect and, unless they are tied, whether the camera is to
        be believed.
        """
        observations = evaluation.problem.observations.without_ends
        squares = np.square(evaluation.r[:, : observations.weight.shape[1]])
        counts = observations.pixels_by_label
        per_label = observations.by_label(np.where(observations.label >= 0, squares, 0.0))
        self.theta[index] = evaluation.theta
        self.errors.own[index], self.errors.following[index] = errors
        with np.errstate(invalid="ignore"):
            self.rms[index] = np.sqrt(np.sum(per_label, axis=1) / np.sum(counts, axis=1))
            of_labels = np.sqrt(per_label / counts)
        number = np.array([self.labels.index(label) for label in observations.labels], dtype=np.intp)
        self.label_errors[np.ix_(index, number)] = np.nan_to_num(of_labels)
        self.label_counts[np.ix_(index, number)] = np.round(counts)
        metres = self._ground_errors(evaluation.theta, errors)
        self.ground_error[index] = metres
        labelled = np.sum(counts, axis=1) > 0
        basis = np.where(
            labelled, np.where(tied, BASES.index(Basis.BOTH), BASES.index(Basis.LINES)), BASES.index(Basis.MATCHES)
        )
        self.basis[index] = basis
        for k, t in enumerate(index.tolist()):
            self._judge(t, alone.get(t), float(metres[k]), bool(tied[k]))

    def fill_from(self, theta: Array, errors: OwnErrors, basis: Basis) -> None:
        """The only frame, from a camera (n,) and its errors that are known already."""
        one = OwnErrors(errors.own[None], errors.following[None])
        self.theta[0], self.errors.own[0], self.errors.following[0] = theta, *errors
        self.ground_error[:] = self._ground_errors(theta[None], one)
        self.basis[0] = BASES.index(basis)
        self._judge(0, None, float(self.ground_error[0]), True)

    def centre_sigma(self, index: IntArray) -> Array:
        """Standard deviations (B, 3) of the centres of frames `index` that have one of their own."""
        centre = self.options.layout.is_centre[self.options.layout.free]
        E, F = self.errors.own[index], self.errors.following[index][:, centre]
        V = if_level(self.considered, self.options.layout.is_crown[self.options.layout.considered])
        variance = np.diagonal(E, axis1=1, axis2=2)[:, centre] + np.einsum("bij,jk,bik->bi", F, V, F)
        return np.asarray(np.sqrt(variance))

    def _ground_errors(self, theta: Array, errors: OwnErrors) -> Array:
        return ground_errors(theta, self.options.layout, errors, self.considered, self.options.field)

    def _judge(self, t: int, alone: Calibration | None, metres: float, tied: bool) -> None:
        status = Status.ACCEPTED if alone is None or tied else alone.status
        self.notes.pop(t, None)
        if alone is not None:
            for suspect in alone.suspect_labels:
                k = self.labels.index(suspect.label)
                self.label_errors[t, k] = suspect.error_px
                self.label_counts[t, k] = alone.pixel_counts[suspect.label]
            if alone.suspect_labels:
                self.suspects[t] = alone.suspect_labels
                self.notes[t] = "; ".join(map(str, alone.suspect_labels))
            if not tied and not alone.accepted:
                self.notes[t] = alone.message
        if status is Status.ACCEPTED and metres > self.largest_error:
            status = Status.IMPROBABLE
        self.status[t] = STATUSES.index(status)

    def set_misfit(self, misfit: Mapping[int, float]) -> None:
        """Set the misfit of some frames, pixels, and interpolate that of the others that have a camera."""
        known = sorted(t for t, excess in misfit.items() if np.isfinite(excess))
        if known:
            has = np.flatnonzero(np.isfinite(self.theta).all(axis=1))
            self.misfit[has] = np.interp(has, known, [misfit[t] for t in known])

    def without_camera(self, t: int, alone: Calibration) -> None:
        """A frame of which not even a wrong camera is known."""
        self.status[t], self.notes[t] = STATUSES.index(alone.status), alone.message

    @property
    def frames(self) -> Frames:
        """What was filled in."""
        return Frames(
            self.theta,
            *self.errors,
            self.status,
            self.basis,
            self.rms,
            self.ground_error,
            self.labels,
            self.label_errors,
            self.label_counts,
            self.notes,
            self.suspects,
            self.misfit,
        )
