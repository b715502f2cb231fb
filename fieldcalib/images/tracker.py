"""The cameras of a live video, frame by frame as the frames come.

    frame -> matches with its keyframe -> predicted camera -> lines at its projected markings -> camera
    keyframe -> (in a thread) network -> (in another process) all keyframes of the shot together

Nothing waits for the network: until the first keyframe of a shot is calibrated its frames have no camera, and what the
keyframes share is as old as the last keyframe that is done.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.assess.frame_table import Basis, FrameTable
from fieldcalib.assess.interpolation import STEP
from fieldcalib.assess.markings import MarkingInView
from fieldcalib.assess.own_errors import OwnErrors, ground_errors
from fieldcalib.assess.result import Calibration, Status
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.clip_shape import LookedAt
from fieldcalib.images.clip_solver import LEAST_SHARE
from fieldcalib.images.frame_lines import frame_lines, per_pixel
from fieldcalib.images.frames_together import Cells, cells_of
from fieldcalib.images.keyframes import EVERY, KeyframePair, KeyframeTracker
from fieldcalib.images.line_profiles import Markings
from fieldcalib.images.live_shape import LiveShape
from fieldcalib.images.paint_evidence import paint_evidence
from fieldcalib.images.shot_solver import (
    MOST_KEYS,
    KeyframeOptions,
    KnownCamera,
    Seen,
    ShotProblem,
    ShotSolution,
    SolvedShot,
    prepare,
    solve_shot,
)
from fieldcalib.io.image import Image, checked_image
from fieldcalib.localize import Network
from fieldcalib.localize.flow import check_network
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.problem.labelled_pixels import check_object
from fieldcalib.processes.other_process import OtherProcess
from fieldcalib.solve.frame_rows import SolvedFrames, solved_rows, table_without_cameras
from fieldcalib.solve.given_camera import GivenCamera, check_of_clip
from fieldcalib.solve.options import ALL, DEFAULT_FLAGS, Prior
from fieldcalib.solve.sequence_problem import SHARED, SIZE
from fieldcalib.solve.ties import Ties, stepped, with_tied
from fieldcalib.solve.tripod import Labels

NICENESS = 2  # of the process that solves keyframes: `update` comes first where there are few cores
NEEDED = ("cv2", "fieldcalib.images.shot_solver")  # in that process
LOOKED_AT = 4  # keyframes of a shot that the network sees in any case,
SOLVE_AGAIN, LOOK_AGAIN = 3, 6  # then all are solved again, and the network sees one, every so many
PAINT_EVERY = 25  # frames, a second, after which paint beside the markings is looked for again: 5 ms
LOST_FOR = 12  # frames that nothing ties for which a camera is extrapolated: half a second


@dataclass
class _Shot:
    """Keyframes of a shot so far."""

    piece: int
    looked_at: int = 0
    """How many of them the network has seen."""
    labels: dict[int, Labels] = field(default_factory=dict)
    """Lines in them; empty where no camera is found."""
    matches: dict[tuple[int, int], Cells] = field(default_factory=dict)
    """Between them."""
    pairs: dict[tuple[int, int], KeyframePair] = field(default_factory=dict)
    """What is still to be matched."""
    solved: SolvedShot | None = None
    followed: dict[int, KnownCamera] = field(default_factory=dict)
    """Cameras of keyframes that are not solved yet, from those that are."""

    @property
    def known(self) -> dict[int, KnownCamera]:
        """The cameras of its keyframes."""
        return self.followed if self.solved is None else {**self.followed, **self.solved.keys}


@dataclass(frozen=True, eq=False)
class _Keyframe:
    """A keyframe that is to be calibrated."""

    shot: _Shot
    index: int
    size: tuple[int, int]
    image: Image | None
    """If the network is to look at it."""


class Tracker:
    """Calibrates a live video: every image gets its camera as it comes, from what came before.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object that the network was trained for, e.g. `soccer()`.
    network : Network, optional
        Finds the markings of keyframes; by default the one that comes with the package.
    camera_matrix, dist_coeffs, rvec, tvec, flags, prior
        As in `calibrate_video`.
    take_off_borders, estimate_aspect : bool
        As in `calibrate_video`, of the images so far. Where they turn out to lie elsewhere in the pictures, it begins
        anew. Until it is known whether pictures of another shape than 16:9 were squashed, all cameras are to be
        checked.
    estimate_size : bool
        As in `calibrate_video`.
    every : int
        Frames from one keyframe to the next, at most.
    wait : bool
        Whether `update` waits until a keyframe is calibrated: for files, where each run shall give the same. Otherwise
        a thread runs the network, and another Python process does the rest; the classes of `object_segments` and
        `prior` must then be those of modules, not of the script.

    Raises
    ------
    ValueError
        If the object or the network is none, or as `calibrate_video` for what is known of the camera.
    RuntimeError
        If no other process can be started, and it does not `wait`.

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
        camera_matrix: ArrayLike | None = None,
        dist_coeffs: ArrayLike | None = None,
        rvec: ArrayLike | None = None,
        tvec: ArrayLike | None = None,
        *,
        flags: int = DEFAULT_FLAGS,
        prior: Prior = ALL,
        take_off_borders: bool = True,
        estimate_aspect: bool = True,
        estimate_size: bool = True,
        every: int = EVERY,
        wait: bool = False,
    ) -> None:
        check_object(object_segments)
        if network is not None:
            check_network(network)
        check_of_clip(flags)
        given = GivenCamera(camera_matrix, dist_coeffs, rvec, tvec)
        self._other = None if wait else OtherProcess(NICENESS, NEEDED)  # it starts while the network is loaded
        self._thread = ThreadPoolExecutor(max_workers=1)
        shared = tuple(name for name in SHARED if estimate_size or name != SIZE)
        self._options = KeyframeOptions(object_segments, flags, prior, given, shared)
        # one core is left to `update`
        self._network = SegmentationNetwork.load(threads=2 if wait else 1) if network is None else network
        if self._other is not None:
            self._other.run(prepare, self._options)
        is_asked = camera_matrix is None
        asked = take_off_borders and is_asked, estimate_aspect and is_asked and prior is not None
        self._shape = LiveShape(LookedAt(object_segments, self._network, flags, prior, given, *asked), self._submit)
        self._size: tuple[int, int] | None = None  # of the images
        self._every = every
        self._running: tuple[_Keyframe, Future[ShotSolution]] | None = None
        self._is_closed = False
        self._basis = Basis.NOTHING
        self._begin()

    def _begin(self) -> None:
        """Forget all images so far."""
        self._keyframes = KeyframeTracker(self._every, leave_pairs=True)
        self._next: _Keyframe | None = None
        self._shot = _Shot(0)
        self._index = 0
        self._last: list[tuple[int, KnownCamera]] = []  # the last two frames that were tied, for the motion
        self._paint: tuple[int, tuple[MarkingInView, ...]] | None = None  # of the shot, when it was looked at

    def _submit(self, function: Callable[[Sequence[Image]], float], images: list[Image]) -> Future[float]:
        """Begin to work on images, in the thread unless it waits."""
        if self._other is not None:
            return self._thread.submit(function, images)
        done: Future[float] = Future()
        done.set_result(function(images))
        return done

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the thread and the process; what they have not done is dropped."""
        self._is_closed = True
        if self._other is not None:
            self._other.close()
        self._thread.shutdown(cancel_futures=True)

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
            If the image is not of the size of those before, or no uint8 image, or the tracker is closed. Errors of the
            network come as they are, with a later image.
        RuntimeError
            If the other process has ended.
        """
        if self._is_closed:
            raise ValueError("the tracker is closed: it takes no more images")
        image = checked_image(image)
        size = image.shape[1], image.shape[0]
        if self._size is None or size == self._size:  # what is of another size is named below
            self._size = size
            if self._shape.update(image):
                self._begin()
            image = self._shape.image_in_frame(image)
        calibration = self._updated(image)
        return calibration if self._shape.shape is None else self._shape.shape.in_picture(calibration)

    def _updated(self, image: Image) -> Calibration:
        """The camera of the next image, in its frame."""
        index, self._index = self._index, self._index + 1
        tied = next((one for one in self._keyframes.update(image) if one.index == index), None)
        if tied is not None and tied.piece != self._shot.piece:
            self._shot, self._last, self._paint = _Shot(tied.piece), [], None
        size = (image.shape[1], image.shape[0])
        found = {} if tied is None else {key: cells_of(matches, size) for key, matches in tied.ties}
        ties = {key: cells for key, cells in found.items() if cells is not None}
        self._work()
        self._basis = Basis.NOTHING
        calibration = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no keyframe of this shot has a camera yet")
        lines, own = None, None
        if self._shot.solved is not None:
            calibration, lines, own = self._followed(self._shot.solved, index, image, ties)
        if tied is not None and tied.is_key:
            self._shot.matches.update({(key, index): cells for key, cells in ties.items()})
            self._shot.pairs.update({pair.indices: pair for pair in tied.left})
            if own is not None:
                self._shot.followed[index] = own
            self._add(index, image, lines)
            if self._other is None and own is None and self._shot.solved is not None:
                calibration, _, _ = self._followed(self._shot.solved, index, image, ties)
        return self._with_paint(calibration, index, image)

    def _with_paint(self, calibration: Calibration, index: int, image: Image) -> Calibration:
        """A calibration with what this or one of the last images shows of the markings."""
        if calibration.camera is None or self._shot.solved is None:
            return calibration
        if self._paint is None or index - self._paint[0] >= PAINT_EVERY:
            self._paint = index, paint_evidence(image, calibration.camera, self._shot.solved.markings).markings
        return calibration.seen_in_image(self._paint[1])

    def _add(self, index: int, image: Image, lines: Labels | None) -> None:
        """A keyframe, which is calibrated if it is time to; one that is not begun yet gives way to it."""
        shot, count = self._shot, len(self._shot.labels)
        shot.labels[index] = ({}, {}) if lines is None else lines
        looks = lines is None or not lines[0] or shot.looked_at < LOOKED_AT or count % LOOK_AGAIN == 0
        if not looks and count % SOLVE_AGAIN:
            return
        shot.looked_at += looks
        size = (image.shape[1], image.shape[0])
        self._next = _Keyframe(shot, index, size, image.copy() if looks else None)  # the caller may use its image again
        self._work()

    def _work(self) -> None:
        """Take what is done, and begin with what is next."""
        if self._running is not None and self._running[1].done():
            keyframe, done = self._running
            self._running = None
            self._take(keyframe, done.result())
        if self._next is None or self._running is not None:
            return
        keyframe, self._next = self._next, None
        problem = self._problem(keyframe)
        if self._other is None:
            self._take(keyframe, self._solution(problem, keyframe.image))
        else:
            self._running = keyframe, self._thread.submit(self._solution, problem, keyframe.image)

    def _problem(self, keyframe: _Keyframe) -> ShotProblem:
        shot = keyframe.shot
        keys = set(sorted(shot.labels)[-MOST_KEYS:])
        solved = shot.solved
        return ShotProblem(
            self._options,
            keyframe.size,
            keyframe.index,
            {key: shot.labels[key] for key in keys},
            {both: cells for both, cells in shot.matches.items() if keys.issuperset(both)},
            tuple(shot.pairs.values()),
            None if solved is None else solved.tripod.options.layout,
            {key: one.theta for key, one in shot.known.items() if key in keys},
        )

    def _solution(self, problem: ShotProblem, image: Image | None) -> ShotSolution:
        seen = None if image is None else Seen(image, tuple(self._network.classes), self._network([image]))
        return solve_shot(problem, seen) if self._other is None else self._other.run(solve_shot, problem, seen)

    def _take(self, keyframe: _Keyframe, solution: ShotSolution) -> None:
        shot = keyframe.shot
        if solution.labels is not None:
            shot.labels[keyframe.index] = solution.labels
        shot.matches.update(solution.matches)
        for both in solution.tried:
            del shot.pairs[both]
        if solution.solved is not None:
            shot.solved = solution.solved
            shot.followed = {key: own for key, own in shot.followed.items() if key not in solution.solved.keys}
            if shot is self._shot:
                self._catch_up(solution.solved)

    def _catch_up(self, solved: SolvedShot) -> None:
        """Cameras of keyframes that came in the meantime, from what ties them to those that are solved."""
        shot = self._shot
        for key in sorted(key for key in shot.labels if key > max(solved.keys) and key not in shot.followed):
            ties = {i: cells for (i, j), cells in shot.matches.items() if j == key and i in shot.known}
            found = self._tied(solved, ties, None) if ties else None
            if found is not None:
                shot.followed[key] = _only(found[0])

    def _followed(
        self, solved: SolvedShot, index: int, image: Image, ties: Mapping[int, tuple[Array, Array]]
    ) -> tuple[Calibration, Labels | None, KnownCamera | None]:
        """The camera of an image from the keyframes that it is tied to, or from the motion of those before.

        With it come the lines in the image and the camera that others can be tied to, if it is tied itself.
        """
        known = self._shot.known
        keys = sorted(key for key in ties if key in known)
        tripod, layout = solved.tripod, solved.tripod.options.layout
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
            theta, errors = own.theta[None], OwnErrors(own.E[None], own.F[None])
            metres = ground_errors(theta, errors, tripod.considered, tripod.options.field)
            rows = table_without_cameras(tripod, 1).with_cameras(theta, errors, metres, basis)
            return self._of(solved, rows), None, None
        found = self._tied(solved, {key: ties[key] for key in keys}, image)
        if found is None:
            nothing = "what ties this frame contradicts its keyframes"
            return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, nothing), None, None
        rows, lines = found
        own = _only(rows)
        self._last = [*self._last[-1:], (index, own)]
        return self._of(solved, rows), lines, own

    def _tied(
        self, solved: SolvedShot, ties: Mapping[int, Cells], image: Image | None
    ) -> tuple[FrameTable, Labels] | None:
        """A frame that is tied to some keyframes, with its lines; None if these contradict what ties it."""
        known = self._shot.known
        keys, tripod, layout = sorted(ties), solved.tripod, solved.tripod.options.layout
        here, is_known = np.array([len(keys)]), np.arange(len(keys) + 1) < len(keys)
        pairs = {(k, len(keys)): ties[key] for k, key in enumerate(keys)}
        local = Ties.of(tripod.object_segments, pairs, len(keys) + 1, layout.image_size)
        near = image is not None and bool(self._last)
        last = self._last[-1][1] if near else known[keys[-1]]
        theta = np.where(layout.free, [*(known[key].theta for key in keys), last.theta], solved.shared)
        towards, first = local.towards(here, theta, is_known)
        if near:
            theta[-1:], (contradicted,) = stepped(towards, layout, theta[-1:])
        else:
            scale = tripod.options.scale
            theta, reached = with_tied(tripod.object_segments, local, theta, is_known, here, layout, scale)
            contradicted = not reached[-1]
        if contradicted:
            return None
        lines: Labels = ({}, {})
        if image is not None:
            lines, _ = frame_lines(image, layout.camera(theta[-1]), solved.markings)
        of_keys = [known[keys[k]] for k in first.tolist()]
        of_first = OwnErrors(np.array([one.E for one in of_keys]), np.array([one.F for one in of_keys]))
        followed = tripod.solved(theta[-1:], [per_pixel(lines)], towards, tripod.prior(theta[-1:]))
        tied = SolvedFrames(followed, tripod.errors(followed, of_first), np.array([True]))
        return solved_rows(tripod, tied), lines

    def _shows_lines(self, image: Image, camera: Camera, markings: Markings) -> bool:
        """Whether enough of the markings in view have a line in the image."""
        (pixels, _), profiles = frame_lines(image, camera, markings, np.inf)
        return sum(map(len, pixels.values())) >= LEAST_SHARE * max(profiles, 1)

    def _of(self, solved: SolvedShot, rows: FrameTable) -> Calibration:
        """The calibration in a table of one frame."""
        one = replace(solved.sequence, frames=rows)
        self._basis = one.basis[0]
        return one[0]

    def _extrapolated(self, index: int, solved: SolvedShot) -> KnownCamera | None:
        """The camera that goes on moving as before, with errors that grow."""
        if not self._last or index - self._last[-1][0] > LOST_FOR:
            return None
        last, own = self._last[-1]
        before, other = self._last[0]
        gap, free = index - last, solved.tripod.options.layout.free
        motion = np.zeros_like(own.theta) if last == before else (own.theta - other.theta) / (last - before)
        spread = gap * (0.5 * np.abs(motion[free]) + STEP * gap)
        return KnownCamera(own.theta + gap * np.where(free, motion, 0.0), own.E + np.diag(np.square(spread)), own.F)


def _only(rows: FrameTable) -> KnownCamera:
    """The camera of the only frame."""
    return KnownCamera(rows.theta[0], rows.own[0], rows.following[0])
