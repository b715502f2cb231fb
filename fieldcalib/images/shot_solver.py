"""The keyframes of a shot of a live video, solved together.

    keyframes -> matches between them; markings in the newest one -> cameras of all of them, and what they share

What goes in and what comes out can be pickled: it is worked on in another process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, Float32
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.frame_lines import as_given
from fieldcalib.images.frames_together import Cells, cells_of, problem_of_lines
from fieldcalib.images.from_images import calibrate_frames_alone
from fieldcalib.images.keyframes import KeyframePair
from fieldcalib.images.line_profiles import Markings
from fieldcalib.io.image import Image
from fieldcalib.problem.layout import Layout
from fieldcalib.solve.given_camera import NOTHING_GIVEN, GivenCamera
from fieldcalib.solve.joint_problem import labels_of
from fieldcalib.solve.options import Prior
from fieldcalib.solve.sequence_problem import SHARED
from fieldcalib.solve.sequence_solver import solve_from_cameras, solve_sequence
from fieldcalib.solve.tripod import KnownTripod, Labels

MOST_KEYS = 40  # keyframes of a shot that are solved together: 20 seconds


class KnownCamera(NamedTuple):
    """A camera that frames can be tied to."""

    theta: Array
    """(n,)"""
    E: Array
    """As in `OwnErrors`, (o, o)."""
    F: Array
    """(o, S)"""


@dataclass(frozen=True, eq=False)
class SolvedShot:
    """The keyframes of a shot, solved together."""

    tripod: KnownTripod
    sequence: SequenceCalibration
    markings: Markings
    keys: Mapping[int, KnownCamera]
    """Those that have a camera."""

    @property
    def shared(self) -> Array:
        """Parameters (n,), of which those that are shared have a meaning."""
        return next(iter(self.keys.values())).theta


@dataclass(frozen=True, eq=False)
class Seen:
    """A picture with what a network says of it; it stands in for that network."""

    image: Image
    classes: tuple[str, ...]
    probabilities: Float32
    """(1, K, h, w)"""

    def __call__(self, images: Sequence[Image]) -> Float32:
        """What the network said."""
        return self.probabilities


@dataclass(frozen=True, eq=False)
class KeyframeOptions:
    """How keyframes are calibrated."""

    object_segments: ObjectSegments
    flags: int
    prior: Prior
    given: GivenCamera = NOTHING_GIVEN
    shared: tuple[str, ...] = SHARED
    """As in `calibrate_sequence`."""


@dataclass(frozen=True, eq=False)
class ShotProblem:
    """The keyframes of a shot with a new one, by their indices."""

    options: KeyframeOptions
    image_size: tuple[int, int]
    new: int
    labels: Mapping[int, Labels]
    """Lines in each of them; empty where no camera is found."""
    matches: Mapping[tuple[int, int], Cells]
    pairs: Sequence[KeyframePair]
    """What is to be matched."""
    layout: Layout | None
    """In which cameras are known already; None as long as none is."""
    cameras: Mapping[int, Array]
    """Parameters (n,)."""


class ShotSolution(NamedTuple):
    """What is new of a shot."""

    labels: Labels | None
    """In the new keyframe; None if they stay as they were."""
    matches: Mapping[tuple[int, int], Cells]
    tried: Sequence[tuple[int, int]]
    """What was to be matched."""
    solved: SolvedShot | None
    """None as long as no keyframe has a camera."""


def prepare(options: KeyframeOptions) -> None:
    """Import what `solve_shot` needs, which takes longer than the first keyframe.

    That the options arrive says at once whether they can be handed on.
    """
    import_module("scipy.spatial.transform")


def solve_shot(problem: ShotProblem, seen: Seen | None) -> ShotSolution:
    """Match the keyframes that are to be matched, take the new one's markings if it was seen, and solve all of them."""
    size = problem.image_size
    found = {pair.indices: matched for pair in problem.pairs if (matched := cells_of(pair.matches(), size)) is not None}
    labels = None if seen is None else _labels(problem.options, seen)
    every = dict(problem.labels) if labels is None else {**problem.labels, problem.new: labels}
    tried = [pair.indices for pair in problem.pairs]
    return ShotSolution(labels, found, tried, _solved(problem, every, {**problem.matches, **found}))


def _labels(options: KeyframeOptions, seen: Seen) -> Labels | None:
    """The labels of a picture as its camera has them; None if it has none that is accepted."""
    (found,) = calibrate_frames_alone(
        options.object_segments, [seen.image], seen, flags=options.flags, prior=options.prior, given=options.given
    )
    if not found.accepted or found.solved is None:
        return None
    return as_given(labels_of(found.solved.alone.evaluation))


def _solved(
    problem: ShotProblem, labels: Mapping[int, Labels], matches: Mapping[tuple[int, int], Cells]
) -> SolvedShot | None:
    keys = sorted(labels)[-MOST_KEYS:]
    number = {key: k for k, key in enumerate(keys)}
    frames_together = problem_of_lines(
        problem.options.object_segments,
        keys,
        labels,
        matches,
        problem.image_size,
        flags=problem.options.flags,
        prior=problem.options.prior,
        shared=problem.options.shared,
        given=problem.options.given,
    )
    if problem.layout is None:
        sequence, tripod = solve_sequence(frames_together)
    else:
        cameras = {number[key]: theta for key, theta in problem.cameras.items() if key in number}
        sequence, tripod = solve_from_cameras(frames_together, problem.layout, cameras)
    if tripod is None or not np.any(sequence.usable):
        return None
    frames = sequence.frames
    cameras_of_keys = {
        key: KnownCamera(frames.theta[k], frames.own[k], frames.following[k])
        for key, k in number.items()
        if sequence.usable[k]
    }
    return SolvedShot(tripod, sequence, Markings.of(tripod.object_segments), cameras_of_keys)
