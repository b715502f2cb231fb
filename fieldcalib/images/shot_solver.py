"""The keyframes of a shot of a live video, solved together.

    keyframes -> matches between them; labels in the newest one -> cameras of all of them, and what they share

Problems and solutions can be pickled: they are worked on in another process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, Float32
from fieldcalib.assess.frame_table import FrameTable
from fieldcalib.assess.own_errors import OwnErrors
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.images.clip_keyframes import labels_of
from fieldcalib.images.clip_problem import Cells, ClipOptions, ClipProblem, cells_of
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.keyframes import KeyframePair
from fieldcalib.io.image import Image
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.sequence_solver import solve_from_cameras, solve_sequence
from fieldcalib.solve.shared_parameters import SharedParameters


class FrameCamera(NamedTuple):
    """The camera of a frame to which other frames can be tied."""

    theta: Array
    """Parameters, (n,)."""
    errors: OwnErrors
    """Errors of one frame: E (o, o) and F (o, S)."""

    @classmethod
    def of(cls, frames: FrameTable, k: int = 0) -> FrameCamera:
        """The camera of row k of a table."""
        return cls(frames.theta[k], OwnErrors(frames.own[k], frames.following[k]))


@dataclass(frozen=True, eq=False)
class SolvedShot:
    """The keyframes of a shot, solved together."""

    shared: SharedParameters
    sequence: SequenceCalibration
    markings: Markings
    cameras: Mapping[int, FrameCamera]
    """Cameras of the keyframes that have one."""

    @property
    def layout(self) -> Layout:
        """Layout of the parameters of each camera."""
        return self.shared.options.layout

    @property
    def some_theta(self) -> Array:
        """Parameters (n,) of one of the cameras, of which the shared ones are used."""
        return next(iter(self.cameras.values())).theta


@dataclass(frozen=True, eq=False)
class SegmentedImage:
    """An image with its class probabilities; it stands in for the network that found them."""

    image: Image
    classes: tuple[str, ...]
    probabilities: Float32
    """(1, K, h, w)"""

    def __call__(self, images: Sequence[Image]) -> Float32:
        """The probabilities, whatever the images."""
        return self.probabilities


@dataclass(frozen=True, eq=False)
class ShotProblem:
    """Keyframes of a shot with a new one."""

    problem: ClipProblem
    """The keyframes; labels are empty where no camera is found."""
    new: int
    """Number of the new keyframe."""
    pairs: Sequence[KeyframePair] = ()
    """Keyframes that are still to be matched."""
    layout: Layout | None = None
    """Layout of cameras that are known already; None without any."""
    cameras: Mapping[int, Array] = field(default_factory=dict)
    """Parameters (n,) of these cameras."""


class ShotSolution(NamedTuple):
    """The result of solving the keyframes of a shot."""

    labels: Mapping[int, PixelTable]
    """Labels that the network found in the new keyframe, by its number; empty if they stay as they were."""
    matches: Mapping[tuple[int, int], Cells]
    """New matches between keyframes."""
    tried: Sequence[tuple[int, int]]
    """Keyframes that were to be matched."""
    solved: SolvedShot | None
    """None as long as no keyframe has a camera."""


def prepare(options: ClipOptions) -> None:
    """Import what `solve_shot` needs, which takes longer than the first keyframe.

    `OtherProcess.run` calls it with the options, and raises an error at once if these cannot be pickled.
    """
    import_module("scipy.spatial.transform")


def solve_shot(shot: ShotProblem, segmented: SegmentedImage | None) -> ShotSolution:
    """Match the keyframes that are to be matched, label the new one if it was segmented, and solve all of them."""
    problem = shot.problem
    matches = {
        pair.indices: cells
        for pair in shot.pairs
        if (found := pair.matches()) is not None and (cells := cells_of(found, problem.image_size)) is not None
    }
    labels = {}
    if segmented is not None:
        (keyframe,) = labels_of(problem.options.calibrate_alone([segmented.image], segmented))
        if keyframe is not None and keyframe.accepted:
            labels = {shot.new: keyframe.labels}
    problem = replace(problem, labels={**problem.labels, **labels}, matches={**problem.matches, **matches})
    tried = [pair.indices for pair in shot.pairs]
    return ShotSolution(labels, matches, tried, _solved(problem, shot.layout, shot.cameras))


def _solved(problem: ClipProblem, layout: Layout | None, cameras: Mapping[int, Array]) -> SolvedShot | None:
    if layout is None:
        sequence, shared = solve_sequence(problem.from_zero)
    else:
        number = {key: k for k, key in enumerate(problem.frames)}
        known_cameras = {number[key]: theta for key, theta in cameras.items()}
        sequence, shared = solve_from_cameras(problem.from_zero, layout, known_cameras)
    if shared is None or not np.any(sequence.usable):
        return None
    known = {key: FrameCamera.of(sequence.frames, k) for k, key in enumerate(problem.frames) if sequence.usable[k]}
    return SolvedShot(shared, sequence, Markings.of(shared.object_segments), known)
