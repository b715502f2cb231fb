"""Problem and results of a joint calibration of frames of one camera, as passed between the steps of its solution.

`SequenceProblem` has the checked arguments of `calibrate_sequence`. `SharedParameters` are the estimated shared
parameters, from which further frames are solved. `solved_rows` turns solved frames into rows of the table of a
sequence, with their status and messages.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray, several
from fieldcalib.assess.frame_table import ACCEPTED, BASES, IMPROBABLE, STATUSES, Basis, FrameTable
from fieldcalib.assess.ground import Considered
from fieldcalib.assess.label_errors import rms_by_label, rms_of_labels
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_errors import OwnErrors, ground_errors, own_errors
from fieldcalib.fields.field import ObjectSegments, tolerance_of
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.frame_ties import BackgroundPairs
from fieldcalib.problem.labelled_pixels import NO_PIXELS, PixelTable
from fieldcalib.problem.layout import CENTER, CROWN, FIELD_SIZE, GaussianPrior
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.observations import Observations
from fieldcalib.solve.batch import calibrate_frames
from fieldcalib.solve.from_segments import NOTHING_LABELLED
from fieldcalib.solve.initial_cameras import given_cameras
from fieldcalib.solve.request import Options
from fieldcalib.solve.sequence.background_matches import Matched, Ties

FOLLOWED = 1e-4  # relative decrease of the cost at which a further frame is done: a hundredth of a standard deviation

SIZE = "field size"
SHARED = ("centre", "principal point", "lens", "zoom law", SIZE)
SHARED_IN_MOTION = SHARED[1:]  # shared by the frames of a moving camera
MOST_TOGETHER = 400  # largest number of frames that are solved together,
MOST_TIED_TOGETHER = 100  # and if matches tie them, which couples all of them in one system

NOTHING: Mapping[int, Calibration] = MappingProxyType({})


class PixelNoise(NamedTuple):
    """Noise of the labelled pixels (`fieldcalib.assess.label_errors`)."""

    sigma: float
    kappa: float


@dataclass(frozen=True, eq=False)
class SharedParameters:
    """Shared parameters of the frames of one camera, with their covariance."""

    options: Options
    """Options in which the shared parameters are known and considered, and the object has the estimated size."""
    noise: PixelNoise
    by_line: Mapping[str, Array] | None = None
    """Their errors by lines, see `Considered`."""

    @property
    def object_segments(self) -> ObjectSegments:
        """The calibration object, of the estimated size."""
        return self.options.object_segments

    @property
    def considered(self) -> Considered:
        """The shared parameters, with their covariance."""
        layout, covariance = self.options.layout, self.options.considered
        size = int(np.count_nonzero(layout.considered))
        return Considered(layout, np.zeros((size, size)) if covariance is None else covariance, self.by_line)

    def prior(self, theta: Array) -> GaussianPrior | None:
        """Prior of frames with cameras near theta (B, n); None without a prior."""
        return given_cameras(theta, self.options.stands).prior if self.options.use_prior else None

    def solved(
        self, theta: Array, pixels: PixelTable, pairs: BackgroundPairs | None, prior: GaussianPrior | None
    ) -> Evaluation:
        """Solve B frames from their labels and from the known cameras that they are tied to.

        Parameters
        ----------
        theta : (B, n) array
            Initial cameras.
        pixels : PixelTable
            Labelled pixels of the frames.
        pairs : BackgroundPairs
            Ties from known cameras to these frames, numbered from 0; None without any.
        """
        options = self.options
        observations = Observations.of(self.object_segments, pixels, options.image_size, options.motion)
        start = evaluate(replace(options.problem(observations, prior), background=pairs), theta)
        tolerance = max(options.tolerance, FOLLOWED)
        return levenberg_marquardt(start, max_iterations=options.max_iterations, tolerance=tolerance).evaluation

    def errors(self, solved: Evaluation, of_first: OwnErrors | None = None) -> OwnErrors:
        """Errors of solved frames; `of_first` has those of the first frame of each pair, if its camera is known."""
        return own_errors(solved, *self.noise, of_first, self.considered)


@dataclass(frozen=True, eq=False)
class SequenceProblem:
    """T frames of one camera, with the matches between them and the names of shared parameters."""

    pixels: PixelTable
    """Labelled pixels of the frames, some of which may have none."""
    ties: Ties
    options: Options
    shared: tuple[str, ...]
    """Names of the shared parameters, of `SHARED`."""

    @classmethod
    def of(
        cls, options: Options, pixels: PixelTable, shared: Sequence[str], matches: Matched | None = None
    ) -> SequenceProblem:
        """Check names and matches; a ValueError says what is wrong."""
        if isinstance(shared, str):
            raise ValueError(
                f"shared must be a sequence of names, got the name {shared!r}: did you mean ({shared!r},)?"
            )
        names = several(shared, f"names to share among {', '.join(SHARED)}")
        unknown = [name for name in names if not isinstance(name, str) or name not in SHARED]
        if unknown:
            raise ValueError(f"frames cannot share {unknown}: expected some of {', '.join(SHARED)}")
        matches = {} if matches is None else matches
        ties = Ties.of(options.object_segments, matches, pixels.count, options.image_size)
        return cls(pixels, ties, options, tuple(names))

    @property
    def object_segments(self) -> ObjectSegments:
        """The calibration object."""
        return self.options.object_segments

    def __len__(self) -> int:
        return self.pixels.count

    @property
    def moves(self) -> bool:
        """Whether the camera moves, on a smooth path."""
        return "centre" not in self.shared

    @property
    def finds_centre(self) -> bool:
        """Whether the frames share a centre that is estimated."""
        return not self.moves and bool(np.any(self.options.layout.free[CENTER]))

    @property
    def is_linked(self) -> bool:
        """Whether frames are linked by more than shared parameters: by matches, or by a path."""
        return self.moves or len(self.ties) > 0

    @property
    def estimates_size(self) -> bool:
        """Whether length and width of the field are estimated."""
        return SIZE in self.shared or not self.options.layout.is_sized

    @property
    def fixed_sizes(self) -> dict[str, float]:
        """Variances of length, width and crown that are not estimated: infinite, as only their prior is known.

        A crown is estimated only once frames turn out to determine it.
        """
        return dict.fromkeys(CROWN if self.estimates_size else (*FIELD_SIZE, *CROWN), np.inf)

    @cached_property
    def solved_together(self) -> IntArray:
        """Numbers of the frames that are solved together: frames to which others are tied, and labelled frames."""
        most = MOST_TIED_TOGETHER if self.is_linked else MOST_TOGETHER
        hubs = np.unique(self.ties.pairs.first)
        hubs = hubs[np.linspace(0, len(hubs), min(len(hubs), MOST_TOGETHER), endpoint=False, dtype=int)]
        return np.union1d(hubs, self.spread(most - len(hubs))) if len(hubs) < most else hubs

    def spread(self, count: int) -> IntArray:
        """Up to `count` labelled frames: the one with most labels in each of `count` equal parts of the sequence."""
        frame, _ = np.unique(np.column_stack([self.pixels.frame, self.pixels.label]), axis=0).T
        labels = np.bincount(frame, minlength=len(self))
        parts = np.array_split(np.arange(len(labels)), min(count, max(len(labels), 1)))
        best = [part[np.argmax(labels[part])] for part in parts if len(part)]
        return np.array([t for t in best if labels[t]], dtype=np.intp)

    def calibrate_alone(
        self, index: IntArray, options: Options, given: Mapping[int, Array] | None = None
    ) -> dict[int, Calibration]:
        """Calibrate labelled frames by themselves, from `given` cameras or, without one, from a search for a camera."""
        found: dict[int, Calibration] = {}
        given = given or {}
        labelled = index[self.pixels.has_pixels[index]].tolist()
        for members in ([t for t in labelled if t in given], [t for t in labelled if t not in given]):
            if not members:
                continue
            theta = np.array([given[t] for t in members]) if members[0] in given else None
            calibrations = calibrate_frames(self.pixels.of_frames(members), options, given=theta)
            found |= dict(zip(members, calibrations, strict=True))
        return found

    def fitted(self, t: int, alone: Calibration | None = None) -> PixelTable:
        """Labelled pixels of frame t: all if labels are trusted, else those that its calibration `alone` accepted."""
        if self.options.task.trust_labels:
            return self.pixels.of_frames([t])
        return NO_PIXELS if alone is None or not alone.accepted or alone.solved is None else alone.solved.pixels


class SolvedFrames(NamedTuple):
    """B frames at their solutions."""

    evaluation: Evaluation
    errors: OwnErrors
    is_tied: BoolArray
    """Mask (B,) of the frames that are tied to others."""


def table_without_cameras(shared: SharedParameters, count: int) -> FrameTable:
    """Table of the frames of a sequence before any of them is solved."""
    return FrameTable.without_cameras(count, shared.options.layout, tuple(shared.object_segments), NOTHING_LABELLED)


def solved_rows(
    shared: SharedParameters,
    solved: SolvedFrames,
    alone: Mapping[int, Calibration] = NOTHING,
    largest_error: float | None = None,
) -> FrameTable:
    """Make rows of B solved frames.

    Parameters
    ----------
    alone : mapping of int to Calibration
        Calibrations of some of the B frames by themselves, by row: they give the suspect labels and, unless a frame is
        tied, its status.
    largest_error : float, optional
        Metres over the field in view: cameras with larger errors are not accepted. By default the field's tolerance.
    """
    evaluation, errors, is_tied = solved
    rows = table_without_cameras(shared, len(evaluation.theta))
    counts = evaluation.problem.observations.pixels_by_label
    number = np.array([rows.labels.index(label) for label in evaluation.problem.observations.labels], dtype=np.intp)
    label_errors, label_counts = rows.label_errors.copy(), rows.label_counts.copy()
    label_errors[:, number], label_counts[:, number] = np.nan_to_num(rms_by_label(evaluation)), np.round(counts)
    for k, one in alone.items():
        for suspect in one.suspect_labels:
            column = rows.labels.index(suspect.label)
            label_errors[k, column], label_counts[k, column] = suspect.error_px, one.pixel_counts[suspect.label]
    largest_error = tolerance_of(shared.options.field) if largest_error is None else largest_error
    metres = ground_errors(evaluation.theta, errors, shared.considered, shared.options.field)
    status = np.full(len(rows), ACCEPTED)
    for k, one in alone.items():
        status[k] = ACCEPTED if is_tied[k] else STATUSES.index(one.status)
    by_lines = np.where(is_tied, BASES.index(Basis.BOTH), BASES.index(Basis.LINES))
    return replace(
        rows,
        theta=evaluation.theta,
        own=errors.own,
        following=errors.following,
        status=np.where((status == ACCEPTED) & (metres > largest_error), IMPROBABLE, status),
        basis=np.where(np.sum(counts, axis=1) > 0, by_lines, BASES.index(Basis.MATCHES)),
        rms=rms_of_labels(evaluation),
        ground_error=metres,
        label_errors=label_errors,
        label_counts=label_counts,
        notes={k: one.message for k, one in alone.items() if not is_tied[k] and not one.accepted},
        suspects={k: one.suspect_labels for k, one in alone.items() if one.suspect_labels},
    )


def without_camera(table: FrameTable, failed: Mapping[int, Calibration]) -> FrameTable:
    """Set status and message of frames that have no camera."""
    index = np.array(list(failed), dtype=np.intp)
    status = table.status.copy()
    status[index] = [STATUSES.index(one.status) for one in failed.values()]
    return replace(table, status=status, notes={**table.notes, **{t: one.message for t, one in failed.items()}})
