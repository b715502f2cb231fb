"""Calibration of a live video: each frame gets its camera as soon as it comes.

    frame -> matches with its keyframe -> predicted camera -> lines at its projected markings -> camera
    keyframe -> (in a thread) network -> (in another process) all keyframes of the shot together

No frame waits for the network: until the first keyframe of a shot is calibrated, its frames have no camera, and later
frames use the shared parameters from the last keyframe that is done.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

from numpy.typing import ArrayLike

from fieldcalib._types import iterable, truth, whole_number
from fieldcalib.assess.findings import Status
from fieldcalib.assess.frame_table import Basis
from fieldcalib.assess.result import Calibration, in_picture
from fieldcalib.fields.field import Field, ObjectSegments, Side
from fieldcalib.images.background.keyframe_tracking import CONFIRMED, EVERY, KeyframeTracker, TiedFrame
from fieldcalib.images.clip.clip_problem import Cells, cells_of
from fieldcalib.images.clip.clip_shape import LiveShape, ShapeEstimator
from fieldcalib.images.clip.finished_clip import PAINT_EVERY
from fieldcalib.images.clip.live_shot import (
    MOST_KEYS,
    MOST_TRIPODS,
    FollowedFrame,
    LiveShot,
    SegmentedImage,
    ShotProblem,
    ShotSolution,
    follow,
    prepare,
    solve_shot,
)
from fieldcalib.images.from_images import How
from fieldcalib.io.image_files import Image, Newest, checked_image, size_of
from fieldcalib.localize import Network
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.processes.other_process import OtherProcess, ProcessEndedError
from fieldcalib.solve.request import GivenCamera, Task, check_of_clip
from fieldcalib.solve.solver_options import ALL, DEFAULT_FLAGS, Prior

LOG = logging.getLogger(__name__)
TRIALS = 2  # attempts at a keyframe, if the process that solves it ends
NICENESS = 2  # of the process that solves keyframes: `update` has priority if there are few cores
PRELOADED = ("cv2", "fieldcalib.images.clip.live_shot")  # modules that this process imports at once
SEGMENTED = 4  # first keyframes of a shot: the network sees each of them, and all are solved again after each
SOLVE_AGAIN, SEGMENT_AGAIN = 3, 6  # later, one keyframe of so many is solved, and one is seen by the network
SOLVE_LATER = 12  # both once `MOST_KEYS` are known, which tell what keyframes share: solving them takes a second


@dataclass(frozen=True, eq=False)
class _Keyframe:
    """A keyframe that is to be calibrated."""

    shot: int
    """Identity of its shot."""
    index: int
    size: tuple[int, int]
    image: Image | None
    """The image, if the network is to see it."""


class LiveFrame(NamedTuple):
    """A frame of a camera that was calibrated as it came (`Tracker.live`)."""

    image: Image
    calibration: Calibration
    late: float
    """Seconds from the arrival of the image to its calibration."""
    dropped: int
    """Number of images dropped so far, as they came faster than they could be calibrated."""

    def __repr__(self) -> str:
        return f"LiveFrame({self.calibration}, late={self.late:.2f}, dropped={self.dropped})"


class Tracker:
    """Calibrates a live video: every image gets its camera as it comes, from the images before it.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object that the network was trained for, e.g. `soccer()`.
    network : Network, optional
        Finds the markings of keyframes; by default the one that comes with the package.
    camera_matrix, dist_coeffs, rvec, tvec, flags, prior
        As in `calibrate_video`.
    take_off_borders, estimate_aspect : bool
        As in `calibrate_video`, but from the images so far, and windows are not looked for. When the estimate changes,
        the tracker begins anew. Until it is known whether pictures of another shape than 16:9 were squashed, all
        cameras are to be checked.
    estimate_size : bool
        As in `calibrate_video`.
    every : int
        Frames from one keyframe to the next, at most.
    side : {"main", "opposite"}, optional
        The side of the field that the camera is on, as in `calibrate_from_images`.
    wait : bool
        Whether `update` waits until a keyframe is calibrated: for files, where each run is to give the same result.
        Otherwise a thread runs the network, and another Python process does the rest; the classes of `object_segments`
        and `prior` must then be defined in modules, not in the script.

    Raises
    ------
    ValueError
        If `object_segments` or `network` is invalid, or as `calibrate_video` for what is known of the camera.
    RuntimeError
        If no other process can be started (without `wait`).

    Examples
    --------
    >>> import numpy as np
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
        side: Side | None = None,
        wait: bool = False,
    ) -> None:
        wait, every = truth(wait, "wait"), whole_number(every, "every", 1)
        how = How(
            Task(object_segments, GivenCamera(camera_matrix, dist_coeffs, rvec, tvec), flags, prior=prior),
            network,
            side,
            take_off_borders=take_off_borders,
            estimate_aspect=estimate_aspect,
            estimate_size=estimate_size,
            every=every,
        )
        self._start(how, wait=wait)

    def _start(self, how: How, *, wait: bool) -> None:
        """Check the parameters, load the network, and begin."""
        check_of_clip(how.task.chosen_flags)
        self._side, how = how.on_paint().on_side()
        self._other = None if wait else OtherProcess(NICENESS, PRELOADED)  # it starts while the network is loaded
        self._thread = ThreadPoolExecutor(max_workers=1)
        # one core is left to `update`
        if how.network is None:
            network = SegmentationNetwork.load(threads=2 if wait else 1)
            how = replace(how, network=self._side.network(network, how.task.field))
        self._how = how
        if self._other is not None:
            self._other.run(prepare, replace(how, network=None))
        self._shape = LiveShape(ShapeEstimator(how), self._submit)
        self._size: tuple[int, int] | None = None  # of the images
        self._running: tuple[_Keyframe, tuple[LiveShot, ...], Future[ShotSolution]] | None = None
        self._is_closed = False
        self._basis = Basis.NOTHING
        self._tripods: tuple[LiveShot, ...] = ()  # earlier shots whose cameras were sure, the last one first
        self._pitch: Field | None = None  # of the size and with the ground that these determined
        self._shot = LiveShot()
        self._begin()

    def _begin(self) -> None:
        """Forget all images so far, but not the size and the ground of the field."""
        self._keyframes = KeyframeTracker(self._how.every, leave_pairs=True)
        self._untied: dict[int, Image] = {}  # the last frames, if nothing ties them: one may begin a shot
        self._new_shot(0)
        self._tripods = ()
        self._index = 0

    def _new_shot(self, piece: int) -> None:
        """Begin a new shot, or find the cameras of this one again; sure ones and their tripod are remembered."""
        shot = self._shot.remembered
        if shot.is_sure:
            others = [one for one in self._tripods if one.identity != shot.tripod]
            self._tripods = (shot, *others)[:MOST_TRIPODS]
            self._pitch = shot.told or self._pitch
        self._shot = LiveShot(shot.identity + 1, piece, pitch=self._pitch)
        self._next: _Keyframe | None = None

    def _submit(self, function: Callable[[Sequence[Image]], float], images: list[Image]) -> Future[float]:
        """Call a function on images, in the thread unless the tracker waits for results."""
        if self._other is not None:
            return self._thread.submit(function, images)
        done: Future[float] = Future()
        done.set_result(function(images))
        return done

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """End the thread and the process; what they have not done is dropped."""
        self._is_closed = True
        if self._other is not None:
            self._other.close()
        self._thread.shutdown(cancel_futures=True)

    @property
    def basis(self) -> Basis:
        """Data that the camera of the last image rests on."""
        return self._basis

    def update(self, image: Image) -> Calibration:
        """Calibrate the next image.

        Parameters
        ----------
        image : (height, width, 3) uint8 array
            Blue, green, red. With another size than that before, the tracker begins anew; what is known of the field
            stays.

        Returns
        -------
        Calibration
            While images cannot be tied to a keyframe, the camera is extrapolated with growing errors, as long as lines
            lie near its markings. After a cut there is no camera until the first keyframe of the new shot is
            calibrated.

        Raises
        ------
        ValueError
            If it is no uint8 image, or the tracker is closed. Errors of the network come as they are, with a later
            image.
        RuntimeError
            If the other process has ended, as for lack of memory, and no other one can be started.
        """
        if self._is_closed:
            raise ValueError("the tracker is closed: it takes no more images")
        image = checked_image(image)
        is_other, self._size = self._size not in (None, size_of(image)), size_of(image)
        if is_other:
            self._shape = LiveShape(ShapeEstimator(self._how), self._submit)
        if self._shape.update(image) or is_other:
            self._begin()
        image = self._shape.image_in_frame(image)
        calibration = self._side.with_alternatives(self._updated(image), self._how.task.field)
        shape = self._shape.shape
        return calibration if shape is None else in_picture(calibration, shape.placement, *shape.findings)

    def live(self, images: Iterable[Image]) -> Iterator[LiveFrame]:
        """Calibrate the images of a camera as they come; those that come faster than they are calibrated are dropped.

        A thread reads the images. Of those that wait, the last few are kept (`fieldcalib.io.image_files.Newest`), so
        that no camera is late by more than a fraction of a second. Of a file, which is read faster than it plays, most
        images are dropped: `update` each of them instead, or use `fieldcalib.calibrate`.

        Parameters
        ----------
        images : iterable of (height, width, 3) uint8 arrays
            Blue, green, red, e.g. the frames of a `cv2.VideoCapture`. Each is an array of its own.

        Returns
        -------
        iterator of LiveFrame
            Image and calibration, how late it is, and how many images were dropped so far.

        Raises
        ------
        ValueError
            If `images` cannot be iterated over; or, with a later image, as in `update`.

        Examples
        --------
        >>> import numpy as np
        >>> from fieldcalib import soccer
        >>> camera = (np.zeros((540, 960, 3), np.uint8) for _ in range(3))
        >>> with Tracker(soccer()) as tracker:
        ...     frames = list(tracker.live(camera))
        >>> len(frames) + frames[-1].dropped, frames[0].late < 30.0
        (3, True)
        """
        return self._live(Newest(iterable(images, "images")))

    def _live(self, newest: Newest[Image]) -> Iterator[LiveFrame]:
        """Calibrate images as they come."""
        for image, arrived in newest:
            calibration = self.update(image)
            yield LiveFrame(image, calibration, time.monotonic() - arrived, newest.dropped)

    def _updated(self, image: Image) -> Calibration:
        """Calibrate the next frame, cut out of its image."""
        index, self._index = self._index, self._index + 1
        now_tied = self._keyframes.update(image)
        tied = next((one for one in now_tied if one.index == index), None)
        is_key = tied is not None and tied.is_key
        if tied is None:
            self._untied = {**dict(list(self._untied.items())[1 - CONFIRMED :]), index: image.copy()}
        elif tied.piece != self._shot.piece or (is_key and self._shot.is_lost):
            self._new_shot(tied.piece)
            earlier = [one for one in now_tied[:-1] if one.is_key and one.index in self._untied]
            for one in earlier:
                self._shot = self._shot.with_keyframe(one.index, _cells(one, image), one.unmatched, None)
            if earlier:
                self._add(earlier[0].index, self._untied[earlier[0].index], has_lines=False)
        ties = {} if tied is None else _cells(tied, image)
        if tied is not None:
            self._untied = {}
        self._work()
        followed = self._follow(index, image, ties, is_key=is_key)
        if tied is not None and tied.is_key:
            self._shot = self._shot.with_keyframe(index, ties, tied.unmatched, followed)
            self._add(index, image, has_lines=followed is not None and bool(followed.lines.has_pixels.any()))
            if self._other is None and (followed is None or followed.camera is None):
                followed = self._follow(index, image, ties, is_key=True)
        if followed is None:
            self._basis = Basis.NOTHING
            return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no keyframe of this shot has a camera yet")
        self._basis = followed.basis
        return self._with_paint(followed, index, image)

    def _follow(self, index: int, image: Image, ties: Mapping[int, Cells], *, is_key: bool) -> FollowedFrame | None:
        """Calibrate a frame from keyframes; None as long as no keyframe has a camera."""
        shot = self._shot
        if shot.solved is None:
            return None
        # keyframes take longest: once the field is known, the paint is rather looked for in the next frame
        learns = is_key and shot.count < MOST_KEYS
        is_due = shot.paint is None or index - shot.paint[0] >= PAINT_EVERY + is_key
        looks = is_due or learns or shot.is_new or shot.is_beside
        found = follow(shot, shot.solved, index, image, ties, on_paint=looks)
        self._shot = shot.with_frame(index, found, ties)
        return found

    def _with_paint(self, followed: FollowedFrame, index: int, image: Image) -> Calibration:
        """Add the evidence of paint from this or one of the last images to a calibration."""
        calibration = followed.calibration
        if calibration.camera is None:
            return calibration
        if followed.markings is not None:
            self._shot = self._shot.with_paint(index, image, calibration.camera, followed.markings)
        return calibration if self._shot.paint is None else calibration.seen_in_image(self._shot.paint[1])

    def _add(self, index: int, image: Image, *, has_lines: bool) -> None:
        """Schedule the newest keyframe to be solved, if it is due; it replaces one that still waits."""
        shot, count = self._shot, self._shot.count - 1
        is_known = count >= MOST_KEYS
        solves_again, segments_again = (SOLVE_LATER, SOLVE_LATER) if is_known else (SOLVE_AGAIN, SEGMENT_AGAIN)
        segments = not has_lines or shot.is_beside or count % segments_again == 0
        segments = segments or (shot.segmented < SEGMENTED and not is_known)
        if not segments and count % solves_again:
            return
        self._shot = replace(shot, segmented=shot.segmented + segments)
        kept = image.copy() if segments else None  # the caller may use its image again
        self._next = _Keyframe(shot.identity, index, size_of(image), kept)
        self._work()

    def _work(self) -> None:
        """Take a solution that is done, and begin with the next keyframe."""
        if self._running is not None and self._running[-1].done():
            keyframe, tripods, done = self._running
            self._running = None
            self._take(keyframe, done.result(), tripods)
        if self._next is None or self._running is not None:
            return
        keyframe, self._next = self._next, None
        problem = self._shot.problem(replace(self._how, network=None), keyframe.size, keyframe.index, self._tripods)
        if self._other is None:
            self._take(keyframe, self._solution(problem, keyframe.image), self._tripods)
        else:
            self._running = keyframe, self._tripods, self._thread.submit(self._solution, problem, keyframe.image)

    def _solution(self, problem: ShotProblem, image: Image | None) -> ShotSolution:
        network = self._how.network
        assert network is not None
        seen = None if image is None else SegmentedImage(image, tuple(network.classes), network([image]))
        return solve_shot(problem, seen) if self._other is None else self._solution_there(problem, seen)

    def _solution_there(self, problem: ShotProblem, seen: SegmentedImage | None) -> ShotSolution:
        """Solve in the other process; if it ends, a new one tries again, and then the keyframe is left out."""
        for _ in range(TRIALS):
            assert self._other is not None
            try:
                return self._other.run(solve_shot, problem, seen)
            except ProcessEndedError as error:
                if self._is_closed:
                    raise
                LOG.warning(
                    "the process that solves keyframes has ended, with exit code %d: another one goes on",
                    error.exit_code,
                )
            self._other = OtherProcess(NICENESS, PRELOADED)
            if self._is_closed:  # in the meantime
                self._other.close()
        return ShotSolution({}, {}, (), None)

    def _take(self, keyframe: _Keyframe, solution: ShotSolution, tripods: tuple[LiveShot, ...]) -> None:
        """Take the solution of a keyframe, unless its shot is over."""
        if keyframe.shot == self._shot.identity:
            self._shot = self._shot.with_solution(solution, tripods)


def _cells(tied: TiedFrame, image: Image) -> dict[int, Cells]:
    """Matches of a frame with the keyframes that it is tied to, averaged over cells."""
    return {key: cells for key, one in tied.ties if (cells := cells_of(one, size_of(image))) is not None}


def tracker_of(how: How, *, wait: bool) -> Tracker:
    """Make a tracker from the value of its parameters."""
    tracker = Tracker.__new__(Tracker)
    tracker._start(how, wait=wait)
    return tracker
