"""Joint calibration problem of frames of one camera, from the lines in some of them and the matches that tie them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fieldcalib._checks import truth
from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.images.background.matches import Matches
from fieldcalib.images.from_images import ImageTask, calibrate_alone
from fieldcalib.images.paint.detected_lines import line_loss
from fieldcalib.images.search.court_search import search_courts
from fieldcalib.io.image import Image
from fieldcalib.localize import Network
from fieldcalib.localize.batches import check_network
from fieldcalib.problem.pixel_table import NO_PIXELS, PixelTable
from fieldcalib.solve.request import Task, check_of_clip
from fieldcalib.solve.sequence.background_matches import LEAST_CELLS, cell_means
from fieldcalib.solve.sequence.sequence_problem import SHARED, SIZE, SequenceProblem
from fieldcalib.solve.solver_options import DEFAULT_FLAGS, CalibrationFlags, default_flags, paint_sigma

Cells = tuple[Array, Array]
"""Matched pixels (n, 2) of two frames, averaged over cells."""


@dataclass(frozen=True, eq=False)
class ClipOptions:
    """Options for the calibration of a clip."""

    task: Task
    """The task of each frame by itself."""
    shared: tuple[str, ...] = SHARED
    """Names of the parameters that frames share, as in `calibrate_sequence`."""
    may_be_enlarged: bool = True
    """Whether frames may be enlarged parts of larger ones (`fieldcalib.images.clip.enlarged_clip`)."""

    def check(self, network: Network | None) -> None:
        """Raise a ValueError for an invalid network, or flags that cannot hold for a clip."""
        if network is not None:
            check_network(network)
        check_of_clip(self.task.chosen_flags)

    def calibrate_alone(self, images: Sequence[Image], network: Network | None) -> list[Calibration]:
        """Calibrate frames as single images, without estimating size of the field, borders or aspect ratio from each.

        Without a network the court is searched for.
        """
        if network is None:
            return search_courts(self.task, images)
        return calibrate_alone(ImageTask(self.task, network), images)

    def not_sharing(self, name: str) -> ClipOptions:
        """Remove a name from `shared`."""
        return replace(self, shared=tuple(one for one in self.shared if one != name))

    @property
    def flags_together(self) -> int:
        """Flags for frames that are solved together.

        By default and with CALIB_AUTO_LENS k2 is estimated too, as all frames together determine the lens.
        """
        flags = self.task.chosen_flags
        position = flags & CalibrationFlags.CALIB_FIX_POSITION
        if flags == DEFAULT_FLAGS | position or flags & CalibrationFlags.CALIB_AUTO_LENS:
            return default_flags(self.task.prior) & ~CalibrationFlags.CALIB_FIX_K2 | position
        return flags


def shared_parameters(names: Sequence[str], estimate_size: bool) -> tuple[str, ...]:
    """Names of shared parameters, without the size of the field unless it is to be estimated."""
    is_estimated = truth(estimate_size, "estimate_size")
    return tuple(name for name in names if is_estimated or name != SIZE)


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

    options: ClipOptions
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
        options, loss = self.options, line_loss(self.image_size)
        paint = paint_sigma(options.task.object_segments)
        task = replace(options.task, flags=options.flags_together, loss=loss, paint=paint, trust_labels=True)
        labels = [self.labels.get(frame, NO_PIXELS) for frame in self.frames]
        pixels = PixelTable.joined(options.task.object_segments, labels)
        matches = between(self.frames, self.matches)
        return SequenceProblem.of(task.options(self.image_size), pixels, options.shared, matches)
