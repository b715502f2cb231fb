"""Joint calibration problem of frames of one camera, from the lines in some of them and the matches that tie them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.images.background.matches import Matches
from fieldcalib.images.from_images import How, calibrate_alone
from fieldcalib.images.paint.detected_lines import line_loss
from fieldcalib.io.image_files import Image
from fieldcalib.problem.labelled_pixels import NO_PIXELS, PixelTable
from fieldcalib.solve.request import Task
from fieldcalib.solve.sequence.background_matches import LEAST_CELLS, cell_means
from fieldcalib.solve.sequence.sequence_problem import SequenceProblem
from fieldcalib.solve.solver_options import DEFAULT_FLAGS, CalibrationFlags, default_flags, paint_sigma

Cells = tuple[Array, Array]
"""Matched pixels (n, 2) of two frames, averaged over cells."""


def calibrate_frames_alone(how: How, images: Sequence[Image]) -> list[Calibration]:
    """Calibrate frames as single images, without estimating size of the field, borders or aspect ratio from each."""
    return calibrate_alone(replace(how, estimate_size=False), images)


def cells_of(matches: Matches, image_size: tuple[int, int]) -> Cells | None:
    """Average matches over cells; None if they are too few to tie two frames."""
    cells = cell_means(matches.first, matches.second, image_size)
    return cells if len(cells[0]) >= LEAST_CELLS else None


def between(frames: Sequence[int], matches: Mapping[tuple[int, int], Cells]) -> dict[tuple[int, int], Cells]:
    """Select the matches between some frames, renumbered by position in `frames`."""
    number = {frame: k for k, frame in enumerate(frames)}
    return {(number[i], number[j]): cells for (i, j), cells in matches.items() if i in number and j in number}


@dataclass(frozen=True, eq=False)
class ClipProblem:
    """Frames of one camera, with the lines and the matches from which they are calibrated."""

    how: How
    image_size: tuple[int, int]
    frames: Sequence[int]
    """Numbers of the T frames, ascending."""
    labels: Mapping[int, PixelTable]
    """Lines by frame; entries of frames that are not in `frames` are ignored."""
    matches: Mapping[tuple[int, int], Cells]
    """Matches by the numbers of both frames; entries of other frames are ignored."""

    @property
    def from_zero(self) -> SequenceProblem:
        """Problem for the joint solver, with frames numbered from 0."""
        task, loss = self.how.task, line_loss(self.image_size)
        paint = paint_sigma(task.object_segments)
        together = replace(task, flags=_flags_together(task), loss=loss, paint=paint, trust_labels=True)
        labels = [self.labels.get(frame, NO_PIXELS) for frame in self.frames]
        pixels = PixelTable.joined(task.object_segments, labels)
        matches = between(self.frames, self.matches)
        return SequenceProblem.of(together.options(self.image_size), pixels, self.how.shared, matches)


def _flags_together(task: Task) -> int:
    """Flags for frames that are solved together.

    By default and with CALIB_AUTO_LENS k2 is estimated too, as all frames together determine the lens.
    """
    flags = task.chosen_flags
    position = flags & CalibrationFlags.CALIB_FIX_POSITION
    if flags == DEFAULT_FLAGS | position or flags & CalibrationFlags.CALIB_AUTO_LENS:
        return default_flags(task.prior) & ~CalibrationFlags.CALIB_FIX_K2 | position
    return flags
