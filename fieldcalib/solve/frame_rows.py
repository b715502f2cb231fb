"""Solved frames as rows of the table of a sequence, with their status and messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fieldcalib._types import BoolArray, IntArray
from fieldcalib.assess.frame_table import (
    ACCEPTED,
    BASES,
    IMPROBABLE,
    STATUSES,
    Basis,
    FrameTable,
)
from fieldcalib.assess.label_errors import rms_by_label, rms_of_labels
from fieldcalib.assess.own_errors import OwnErrors, ground_errors
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import tolerance_of
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.solve.from_segments import NO_PIXELS
from fieldcalib.solve.shared_parameters import SharedParameters

NOTHING: Mapping[int, Calibration] = MappingProxyType({})


class SolvedFrames(NamedTuple):
    """B frames at their solutions."""

    evaluation: Evaluation
    errors: OwnErrors
    is_tied: BoolArray
    """Mask (B,) of the frames that are tied to others."""


def table_without_cameras(shared: SharedParameters, count: int) -> FrameTable:
    """The table of frames of a tripod before any of them is solved."""
    return FrameTable.without_cameras(count, shared.options.layout, tuple(shared.object_segments), NO_PIXELS)


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
    return replace(
        rows,
        theta=evaluation.theta,
        own=errors.own,
        following=errors.following,
        status=np.where((status == ACCEPTED) & (metres > largest_error), IMPROBABLE, status),
        basis=_bases(np.sum(counts, axis=1) > 0, is_tied),
        rms=rms_of_labels(evaluation),
        ground_error=metres,
        label_errors=label_errors,
        label_counts=label_counts,
        notes=_notes(alone, is_tied),
        suspects={k: one.suspect_labels for k, one in alone.items() if one.suspect_labels},
    )


def without_camera(table: FrameTable, failed: Mapping[int, Calibration]) -> FrameTable:
    """Set status and message of frames that have no camera."""
    index = np.array(list(failed), dtype=np.intp)
    status = table.status.copy()
    status[index] = [STATUSES.index(one.status) for one in failed.values()]
    return replace(table, status=status, notes={**table.notes, **{t: one.message for t, one in failed.items()}})


def _bases(labelled: BoolArray, is_tied: BoolArray) -> IntArray:
    by_lines = np.where(is_tied, BASES.index(Basis.BOTH), BASES.index(Basis.LINES))
    return np.where(labelled, by_lines, BASES.index(Basis.MATCHES))


def _notes(alone: Mapping[int, Calibration], is_tied: BoolArray) -> dict[int, str]:
    notes = {k: "; ".join(map(str, one.suspect_labels)) for k, one in alone.items() if one.suspect_labels}
    return notes | {k: one.message for k, one in alone.items() if not is_tied[k] and not one.accepted}
