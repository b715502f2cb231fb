"""The cameras of a live video, frame by frame as the frames come.

    frame -> matches with its keyframe -> predicted camera -> lines at its projected markings -> camera
    keyframe -> (in a thread) markings -> what all keyframes of the shot share

Nothing waits for the network: until the first keyframe of a shot is calibrated its frames have no camera, and what the
keyframes share is as old as the last keyframe that is done.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.own_errors import OwnErrors
from fieldcalib.assess.result import Calibration, Status
from fieldcalib.assess.sequence import STEP, Basis, SequenceCalibration
from fieldcalib.calibrate.frame_columns import FrameColumns
from fieldcalib.calibrate.options import ALL, DEFAULT_FLAGS, PAINT, Prior, pixel_unit
from fieldcalib.calibrate.sequence_solver import SHARED, sequence_solver
from fieldcalib.calibrate.ties import LEAST_CELLS, Ties, thinned, with_tied
from fieldcalib.calibrate.together import labels_of
from fieldcalib.calibrate.tripod import KnownTripod, Labels
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.clip_solver import LEAST_SHARE
from fieldcalib.images.frame_lines import as_given, flags_together, frame_lines, per_pixel
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.images.keyframes import EVERY, KeyframeTracker, Tied
from fieldcalib.images.line_profiles import Markings
from fieldcalib.images.refinement import LOSS_SCALE
from fieldcalib.io.image import Image
from fieldcalib.localize import Network
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.problem.losses import RobustLoss

MOST_KEYS = 40  # keyframes of a shot that are solved together: 20 seconds
LOOKED_AT = 4  # keyframes of a shot that the network sees in any case,
SOLVE_AGAIN, LOOK_AGAIN = 3, 6  # then all are solved again, and the network sees one, every so many
LOST_FOR = 12  # frames that nothing ties for which a camera is extrapolated: half a second


class _Own(NamedTuple):
    """A camera that frames can be tied to."""

    theta: Array
    """(n,)"""
    E: Array
    F: Array


@dataclass(frozen=True, eq=False)
class _Solved:
    """The keyframes of a shot, solved together."""

    tripod: KnownTripod
    sequence: SequenceCalibration
    markings: Markings
    keys: Mapping[int, _Own]
    """Those that have a camera."""

    @property
    def shared(self) -> Array:
        """Parameters (n,), of which those that are shared have a meaning."""
        return next(iter(self.keys.values())).theta


@dataclass
class _Shot:
    """Keyframes of a shot so far."""

    piece: int
    looked_at: int = 0
    """How many of them the network has seen."""
    labels: dict[int, Labels] = field(default_factory=dict)
    """Lines in them; empty where no camera is found."""
    matches: dict[tuple[int, int], tuple[Array, Array]] = field(default_factory=dict)
    """Between them."""
    solved: _Solved | None = None
    followed: dict[int, _Own] = field(default_factory=dict)
    """Cameras of keyframes that are not solved yet, from those that are."""


class Tracker:
    """Calibrates a live video: every image gets its camera as it comes, from what came before.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object that the network was trained for, e.g. `soccer()`.
    network : Network, optional
        Finds the markings of keyframes; by default the one that comes with the package.
    flags, prior
        As in `calibrate_from_images`.
    every : int
        Frames from one keyframe to the next, at most.
    wait : bool
        Whether `update` waits until a keyframe is calibrated: for files, where each run shall give the same. Otherwise
        that is done by a thread.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> with Tracker(soccer()) as tracker:
    ...     calibration = tracker.update(np.zeros((540, 960, 3), np.uint8))
    >>> str(calibration.status), calibration.message
    ('too few segments', 'no keyframe of this shot has a camera yet')
    """

    def __init__(
        self,
        object_segments: ObjectSegments,
        network: Network | None = None,
        *,
        flags: int = DEFAULT_FLAGS,
        prior: Prior = ALL,
        every: int = EVERY,
        wait: bool = False,
    ) -> None:
        self._object_segments, self._flags, self._prior = object_segments, flags, prior
        self._network = SegmentationNetwork.load() if network is None else network
        self._keyframes = KeyframeTracker(every)
        self._worker = ThreadPoolExecutor(max_workers=1)
        self._wait = wait
        self._jobs: list[tuple[_Shot, Future[_Solved | None]]] = []
        self._shot = _Shot(0)
        self._index = 0
        self._size = (0, 0)
        self._last: list[tuple[int, _Own]] = []  # the last two frames that were tied, for the motion
        self._basis = Basis.NOTHING

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the thread."""
        self._worker.shutdown(cancel_futures=True)

    @property
    def basis(self) -> Basis:
        """What the camera of the last image rests on."""
        return self._basis

    def update(self, image: Image) -> Calibration:
        """The camera of the next image.

        Parameters
        ----------
        image : (height, width, 3) uint8 array
            Blue, green, red, of the same size as those before.

        Returns
        -------
        Calibration
            Its errors grow while nothing ties the images to a keyframe but the lines are where it has the markings.
            After a cut there is no camera until the first keyframe of the new shot is calibrated.

        Raises
        ------
        ValueError
            If the image is not of the size of those before, or no uint8 image.
        """
        index, self._index = self._index, self._index + 1
        tied = next((one for one in self._keyframes.update(image) if one.index == index), None)
        if tied is not None and tied.piece != self._shot.piece:
            self._shot, self._last = _Shot(tied.piece), []
        size = (image.shape[1], image.shape[0])
        ties = {} if tied is None else _thinned(tied, size)
        self._take_results()
        is_key = tied is not None and tied.is_key
        if is_key:
            self._shot.matches.update({(key, index): both for key, both in ties.items()})
        self._basis = Basis.NOTHING
        calibration = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no keyframe of this shot has a camera yet")
        lines, own = None, None
        if self._shot.solved is not None:
            calibration, lines, own = self._followed(self._shot.solved, index, image, ties)
        if is_key:
            if own is not None:
                self._shot.followed[index] = own
            self._submit(index, image, lines)
            if self._wait and own is None and self._shot.solved is not None:
                calibration, _, _ = self._followed(self._shot.solved, index, image, ties)
        return calibration

    def _submit(self, index: int, image: Image, lines: Labels | None) -> None:
        """Have a keyframe calibrated; one that is not begun yet gives way to it."""
        shot = self._shot
        if lines is not None and shot.looked_at >= LOOKED_AT and len(shot.labels) % SOLVE_AGAIN:
            shot.labels[index] = lines
            return
        looks = lines is None or shot.looked_at < LOOKED_AT or len(shot.labels) % LOOK_AGAIN == 0
        shot.looked_at += looks
        self._jobs = [(of, job) for of, job in self._jobs if not job.cancel()]
        self._jobs.append((shot, self._worker.submit(self._solve, shot, index, image if looks else None, lines)))
        if self._wait:
            self._jobs[-1][1].result()
            self._take_results()

    def _take_results(self) -> None:
        for shot, job in [pair for pair in self._jobs if pair[1].done()]:
            self._jobs.remove((shot, job))
            solved = None if job.cancelled() else job.result()
            if solved is not None:
                shot.solved = solved
                shot.followed = {key: own for key, own in shot.followed.items() if key not in solved.keys}

    def _solve(self, shot: _Shot, index: int, image: Image | None, lines: Labels | None) -> _Solved | None:
        """All keyframes of a shot, with a new one; None as long as none of them has a camera."""
        shot.labels[index] = ({}, {}) if lines is None else lines
        if image is not None:
            self._size = (image.shape[1], image.shape[0])
            (found,) = calibrate_from_images(
                self._object_segments, [image], self._network, flags=self._flags, prior=self._prior
            )
            if found.accepted and found.solved is not None:
                shot.labels[index] = as_given(labels_of(found.solved.alone.evaluation))
        size, solved = self._size, shot.solved
        keys = sorted(shot.labels)[-MOST_KEYS:]
        number = {key: k for k, key in enumerate(keys)}
        matches = dict(shot.matches)  # the other thread adds to them
        solver = sequence_solver(
            self._object_segments,
            [shot.labels[key][0] for key in keys],
            size,
            flags=flags_together(self._flags),
            prior=self._prior,
            loss=RobustLoss("cauchy", LOSS_SCALE * pixel_unit(size)),
            trust_labels=True,
            weights=[shot.labels[key][1] for key in keys],
            shared=SHARED,
            paint=PAINT,
            matches={(number[i], number[j]): both for (i, j), both in matches.items() if i in number and j in number},
        )
        if solved is None:
            sequence = solver.calibrated()
        else:
            cameras = {number[key]: own.theta for key, own in {**shot.followed, **solved.keys}.items() if key in number}
            sequence = solver.calibrated_from(solved.tripod.options.layout, cameras)
        if solver.tripod is None or not np.any(sequence.accepted):
            return None
        frames = sequence.frames
        keyframes = {
            key: _Own(frames.theta[k], frames.own[k], frames.following[k])
            for key, k in number.items()
            if sequence.accepted[k]
        }
        return _Solved(solver.tripod, sequence, Markings.of(solver.tripod.object_segments), keyframes)

    def _followed(
        self, solved: _Solved, index: int, image: Image, ties: Mapping[int, tuple[Array, Array]]
    ) -> tuple[Calibration, Labels | None, _Own | None]:
        """The camera of an image from the keyframes that it is tied to, or from the motion of those before.

        With it come the lines in the image and the camera that others can be tied to, if it is tied itself.
        """
        known = {**self._shot.followed, **solved.keys}
        keys = sorted(key for key in ties if key in known)
        tripod, layout = solved.tripod, solved.tripod.options.layout
        columns = tripod.columns(1)
        own = known.get(index)  # of a keyframe that was waited for
        if own is not None or not keys:
            basis = Basis.INTERPOLATED if own is None else Basis.LINES
            own = self._extrapolated(index, solved) if own is None else own
            if own is None:
                nothing = "nothing ties this frame to a keyframe that has a camera"
                return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, nothing), None, None
            if basis is Basis.INTERPOLATED and not self._shows_lines(image, layout.camera(own.theta), solved.markings):
                nothing = "nothing ties this frame, and it shows no lines where the camera should have them: a cut?"
                return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, nothing), None, None
            columns.fill_from(own.theta, OwnErrors(own.E, own.F), basis)
            return self._of(solved, columns), None, None
        here, is_known = np.array([len(keys)]), np.arange(len(keys) + 1) < len(keys)
        pairs = {(k, len(keys)): ties[key] for k, key in enumerate(keys)}
        local = Ties.of(tripod.object_segments, pairs, len(keys) + 1, layout.image_size)
        last = self._last[-1][1] if self._last else known[keys[-1]]
        theta = np.where(layout.free, [*(known[key].theta for key in keys), last.theta], solved.shared)
        theta, reached = with_tied(
            tripod.object_segments, local, theta, is_known, here, layout, tripod.options.scale, near=bool(self._last)
        )
        if not reached[-1]:
            nothing = "what ties this frame contradicts its keyframes"
            return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, nothing), None, None
        lines, _ = frame_lines(image, layout.camera(theta[-1]), solved.markings)
        towards, first = local.towards(here, theta, is_known)
        of_keys = [known[keys[k]] for k in first.tolist()]
        of_first = OwnErrors(np.array([one.E for one in of_keys]), np.array([one.F for one in of_keys]))
        tripod.follow(columns, np.array([0]), theta[-1:], [per_pixel(lines)], towards, of_first, {})
        own = _Own(columns.theta[0], columns.errors.own[0], columns.errors.following[0])
        self._last = [*self._last[-1:], (index, own)]
        return self._of(solved, columns), lines, own

    def _shows_lines(self, image: Image, camera: Camera, markings: Markings) -> bool:
        """Whether enough of the markings in view have a line in the image."""
        (pixels, _), profiles = frame_lines(image, camera, markings, np.inf)
        return sum(map(len, pixels.values())) >= LEAST_SHARE * max(profiles, 1)

    def _of(self, solved: _Solved, columns: FrameColumns) -> Calibration:
        """The calibration in columns of one frame."""
        one = replace(solved.sequence, frames=columns.frames)
        self._basis = one.basis[0]
        return one[0]

    def _extrapolated(self, index: int, solved: _Solved) -> _Own | None:
        """The camera that goes on moving as before, with errors that grow."""
        if not self._last or index - self._last[-1][0] > LOST_FOR:
            return None
        last, own = self._last[-1]
        before, other = self._last[0]
        gap, free = index - last, solved.tripod.options.layout.free
        motion = np.zeros_like(own.theta) if last == before else (own.theta - other.theta) / (last - before)
        spread = gap * (0.5 * np.abs(motion[free]) + STEP * gap)
        return _Own(own.theta + gap * np.where(free, motion, 0.0), own.E + np.diag(np.square(spread)), own.F)


def _thinned(tied: Tied, size: tuple[int, int]) -> dict[int, tuple[Array, Array]]:
    """Matches by their keyframe, averaged over cells; without those that tie nothing."""
    found = {key: thinned(matches.first, matches.second, size) for key, matches in tied.ties}
    return {key: both for key, both in found.items() if len(both[0]) >= LEAST_CELLS}
