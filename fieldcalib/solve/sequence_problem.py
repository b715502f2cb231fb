"""Frames of one camera that are to be calibrated together: the checked arguments of `calibrate_sequence`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fieldcalib._checks import several
from fieldcalib._types import Array, IntArray
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.layout import CENTER, FIELD_SIZE
from fieldcalib.problem.pixel_table import NO_PIXELS, PixelTable
from fieldcalib.solve.batch import calibrate_frames
from fieldcalib.solve.options import Options
from fieldcalib.solve.ties import Matched, Ties

SIZE = "field size"
SHARED = ("centre", "principal point", "lens", "zoom law", SIZE)
SHARED_IN_MOTION = SHARED[1:]  # by the frames of a moving camera
MOST_TOGETHER = 400  # largest number of frames that are solved together,
MOST_TIED_TOGETHER = 100  # and if matches tie them, which couples all of them in one system


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
    def fixed_sizes(self) -> dict[str, float]:
        """Variances of length and width if these are not estimated: infinite, as only their prior is known."""
        is_estimated = SIZE in self.shared or self.options.layout.field_size is None
        return {} if is_estimated else dict.fromkeys(FIELD_SIZE, np.inf)

    @cached_property
    def solved_together(self) -> IntArray:
        """Numbers of the frames that are solved together: those to which others are tied, and labelled ones."""
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
        """Calibrate labelled frames by themselves, from given cameras; without one, the camera is searched."""
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
        """Labelled pixels of frame t that its fit by itself accepted, or all of them if labels are trusted."""
        if self.options.trust_labels:
            return self.pixels.of_frames([t])
        return NO_PIXELS if alone is None or not alone.accepted or alone.solved is None else alone.solved.pixels
