"""Frames of one camera in which lines were found, calibrated together with what ties them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fieldcalib._types import Array
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.matches import Matches
from fieldcalib.images.refinement import LOSS_SCALE
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.solve.given_camera import NOTHING_GIVEN, GivenCamera
from fieldcalib.solve.options import (
    DEFAULT_FLAGS,
    CalibrationFlags,
    Prior,
    default_flags,
    pixel_unit,
)
from fieldcalib.solve.sequence_problem import SequenceOptions, SequenceProblem
from fieldcalib.solve.ties import LEAST_CELLS, thinned
from fieldcalib.solve.tripod import Labels

Cells = tuple[Array, Array]
"""Matched pixels (n, 2) of two frames, averaged over cells."""


def cells_of(matches: Matches | None, image_size: tuple[int, int]) -> Cells | None:
    """Matches averaged over cells; None if they tie nothing."""
    if matches is None:
        return None
    cells = thinned(matches.first, matches.second, image_size)
    return cells if len(cells[0]) >= LEAST_CELLS else None


def problem_of_lines(
    object_segments: ObjectSegments,
    frames: Sequence[int],
    labels: Mapping[int, Labels],
    matches: Mapping[tuple[int, int], Cells],
    image_size: tuple[int, int],
    *,
    flags: int,
    prior: Prior,
    shared: Sequence[str],
    given: GivenCamera = NOTHING_GIVEN,
) -> SequenceProblem:
    """The problem of some frames, from the lines in them and from those of the matches that are between them.

    Parameters
    ----------
    frames : sequence of int
        Numbers of the frames, T of them; the problem counts them from 0.
    labels : mapping of int to Labels
        Of frames that have some, with weights as arguments have them.
    flags : int
        As for one frame. By default k2 is estimated too, and also where a single frame's labels would say how much of
        the lens is (CALIB_AUTO_LENS): all frames together tell it.
    """
    number = {frame: k for k, frame in enumerate(frames)}
    found = [labels.get(frame, ({}, {})) for frame in frames]
    position = flags & CalibrationFlags.CALIB_FIX_POSITION
    if flags == DEFAULT_FLAGS | position or flags & CalibrationFlags.CALIB_AUTO_LENS:
        flags = default_flags(prior) & ~CalibrationFlags.CALIB_FIX_K2 | position
    loss = RobustLoss("cauchy", LOSS_SCALE * pixel_unit(image_size))
    return SequenceProblem.of(
        object_segments,
        [pixels for pixels, _ in found],
        image_size,
        SequenceOptions(flags, prior, loss, trust_labels=True, shared=shared, given=given),
        weights=[weights for _, weights in found],
        matches={(number[i], number[j]): cells for (i, j), cells in matches.items() if i in number and j in number},
    )
