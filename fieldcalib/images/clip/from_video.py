"""Calibration of a video in stages, each a function from one frozen value to the next:

    frames                 -> Keyframes         read_keyframes     shots, matches of their frames, labels in keyframes
    Keyframes              -> SolvedShots       solve_shots        each shot, with the camera model that predicts best
    SolvedShots            -> SolvedTripods     solve_tripods      shots of one tripod together
    SolvedTripods, frames  -> ClipLines         find_clip_lines    lines near the projected markings of every frame
    ClipLines              -> VideoCalibration  finish_clip        all frames of each tripod together
    VideoCalibration       -> VideoCalibration  finish_clip_again  again, if more markings then lie on their paint

The video is read twice, and a third time to finish again: lines can be found in a frame only when its camera is known
to a few pixels, which takes the other frames. A long video is calibrated in parts, by several processes if there are
any, and what the parts share is joined in the end (`fieldcalib.images.clip.joined_parts`). `Tracker` uses the same
matches, labels of keyframes, problems and lines, but keyframe by keyframe.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, islice, pairwise
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._progress import progress_bar
from fieldcalib._types import named
from fieldcalib.assess.video import Shape, VideoCalibration
from fieldcalib.fields.field import ObjectSegments, Side
from fieldcalib.images.background.keyframe_tracking import EVERY, KeyframeTracker, tied_frames
from fieldcalib.images.camera_side import CameraSide
from fieldcalib.images.clip.clip_models import crown_notes
from fieldcalib.images.clip.clip_shape import ShapeEstimator
from fieldcalib.images.clip.finished_clip import find_clip_lines, finish_clip, finish_clip_again, off_paint
from fieldcalib.images.clip.joined_parts import joined_parts
from fieldcalib.images.clip.keyframes import read_keyframes
from fieldcalib.images.clip.solved_shots import solve_shots, solve_tripods
from fieldcalib.images.from_images import How, Mount
from fieldcalib.images.shape.shape_of_picture import has_cameras, notes_without_camera
from fieldcalib.io.clips import ClipInput, Reading, clip_input
from fieldcalib.io.image_files import Image, checked_image, read_ahead, size_of
from fieldcalib.localize import Network
from fieldcalib.localize.network import Padded
from fieldcalib.problem.picture_shape import Placement
from fieldcalib.processes.jobs import in_order
from fieldcalib.processes.other_process import ProcessEndedError
from fieldcalib.solve.request import GivenCamera, Task, check_of_clip
from fieldcalib.solve.solver_options import ALL, DEFAULT_FLAGS, CalibrationFlags, Prior

LOOK_AGAIN = 0.05  # share of frames with a marking beside its paint, above which lines are looked for once more
PART = 3000  # frames of a part of a long video, about: two minutes
TOGETHER = "calibrating"  # name of the work on all parts


Part = TypeVar("Part")


class Store(Protocol[Part]):
    """Parts of a video by their number: a dict, or another mapping."""

    def get(self, index: int, /) -> Part | None:
        """A part; None if it is not done yet."""

    def __setitem__(self, index: int, part: Part, /) -> None: ...


@dataclass(frozen=True, eq=False)
class _Calibrations:
    """Store of parts of which only the calibrations are kept."""

    store: Store[VideoCalibration]

    def get(self, index: int) -> FinishedPart | None:
        found = self.store.get(index)
        return None if found is None else FinishedPart(found, Reading((), {}, ""))

    def __setitem__(self, index: int, part: FinishedPart) -> None:
        self.store[index] = part.calibration


def calibrate_video(
    object_segments: ObjectSegments,
    source: str | os.PathLike[str] | Iterable[Image],
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
    may_be_enlarged: bool = True,
    every: int = EVERY,
    camera: Mount = "tripod",
    side: Side | None = None,
    parts: Store[VideoCalibration] | None = None,
    executor: Executor | None = None,
) -> VideoCalibration:
    """Calibrate the frames of a video together.

    The frames of a shot share the centre of the camera, the law by which its principal point and lens follow the zoom,
    and the size of the field; shots of the same tripod are recognised and share them too. The network looks at
    keyframes, and at a few more frames where these tell nothing. Matches of the static background tie every frame to
    these, and lines are searched at the projected markings of every frame.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object that the network was trained for, e.g. `soccer()`.
    source : path, or iterable of (height, width, 3) uint8 arrays
        A video, a folder or a zip of images, which are taken in the order of the numbers in their names; or the images:
        blue, green, red. All are of one size. It is read twice.
    network : Network, optional
        Finds the markings; by default the one that comes with the package. For a `Field` that this one was not trained
        for, courts are searched for in keyframes (`fieldcalib.images.find_courts`).
    camera_matrix, dist_coeffs, rvec, tvec, flags, prior
        As in `calibrate_from_images`. A position holds for all frames, and so does a focal length (no zoom). A rotation
        holds for one frame, and cannot be given.
    take_off_borders : bool
        Whether black borders, and the surroundings of a window, are left out, unless there is a `camera_matrix`. They
        are estimated from some of the first frames: borders that all of them have, a window that most of them have.
        Cameras are in pixels of the whole pictures (`VideoCalibration.shape`).
    estimate_aspect : bool
        Whether frames of another shape than 16:9 may have been squashed from it: some of them are calibrated together
        as they are and as they would be shown, and the shape that their lines make more likely is taken. Where the
        lines do not decide, all cameras are to be checked. Not with a `camera_matrix`, or without a prior.
    estimate_size : bool
        Whether length and width of a field, if not declared known (`size_known`), are estimated from the frames of a
        tripod together, as far as these determine them. Otherwise they stay as given, and their uncertainty is part of
        the errors of positions relative to the centre mark.
    may_be_enlarged : bool
        Whether frames with the shape of whole ones may be enlarged parts of larger ones (digital zoom), whose principal
        point is not in the middle. If the frames of a tripod do not show that they are whole, they are calibrated with
        a free principal point, or are to be checked (`fieldcalib.images.clip.clip_shape`). Only with a network and a
        prior, and if nothing of the camera is given.
    every : int
        Frames from one keyframe to the next, at most.
    camera : {"tripod", "moving"}
        How the camera is carried. One that moves (a drone, on wires, in a hand) has a smooth path instead of one place,
        and its frames are tied by the ground alone; each of its shots is calibrated by itself.
    side : {"main", "opposite"}, optional
        The side of the field that the camera is on, as in `calibrate_from_images`.
    parts : mapping of int to VideoCalibration, optional
        Calibrations of parts of the video (about `PART` frames) by their number, e.g. of an earlier call that was
        interrupted: these are not calibrated again, and the others are added when they are done.
    executor : concurrent.futures.Executor, optional
        Works on the parts of a long video, e.g. `Processes`, or the executor of a cluster (dask's
        ``Client.get_executor()``); other processes must be able to read the video, and to import the classes of the
        arguments. The results are the same.

    Returns
    -------
    VideoCalibration
        Each frame says what it rests on: lines, matches, both, or interpolation (`VideoCalibration.basis`). A camera is
        accepted as long as the field in view is known to its `Field.tolerance`, 1 m on a soccer pitch. A video of more
        than three minutes is calibrated in parts of about two, so that memory does not grow with it; what these tell of
        tripods, lens and field is then joined, by its uncertainty.

    Warns
    -----
    UserWarning
        If the file of a video announces more frames than can be read.

    Raises
    ------
    FileNotFoundError, BrokenFileError
        As `fieldcalib.io.videos.VideoReader`; if a folder has no image, or a broken one.
    ValueError
        If the frames are of several sizes or an iterator, which can be read once only, if `parts` are of another video,
        or as `calibrate_from_images`.

    Examples
    --------
    >>> import numpy as np
    >>> from fieldcalib import soccer
    >>> black = [np.zeros((540, 960, 3), np.uint8)] * 2
    >>> [str(frame.status) for frame in calibrate_video(soccer(), black)]
    ['too few segments', 'too few segments']
    """
    how = How(
        Task(object_segments, GivenCamera(camera_matrix, dist_coeffs, rvec, tvec), flags, prior=prior),
        network,
        side,
        take_off_borders=take_off_borders,
        estimate_aspect=estimate_aspect,
        estimate_size=estimate_size,
        may_be_enlarged=may_be_enlarged,
        camera=camera,
        every=every,
    )
    if parts is not None and not (hasattr(parts, "get") and hasattr(parts, "__setitem__")):
        raise ValueError(f"expected parts, a dict of calibrations by the number of the part, got {named(parts)}")
    return calibrate_clip(how, source, None if parts is None else _Calibrations(parts), executor)


def calibrate_clip(
    how: How,
    source: str | os.PathLike[str] | Iterable[Image] | ClipInput,
    kept: Store[FinishedPart] | None = None,
    executor: Executor | None = None,
) -> VideoCalibration:
    """Calibrate the frames of a video together (`calibrate_video`)."""
    clip = Clip.of(how, source)
    return clip.joined(list(clip.calibrated(range(len(clip.parts)), {} if kept is None else kept, executor)))


@dataclass(frozen=True, eq=False)
class Clip:
    """A clip whose parts can be calibrated, each by itself."""

    frames: ClipInput
    how: How
    on: CameraSide
    shape: Shape | None = None

    @classmethod
    def of(cls, how: How, source: str | os.PathLike[str] | Iterable[Image] | ClipInput) -> Clip:
        """Look at the first frames, and check the arguments of `calibrate_video`."""
        check_of_clip(how.task.chosen_flags)
        if how.camera == "moving" and how.task.chosen_flags & CalibrationFlags.CALIB_FIX_POSITION:
            raise ValueError('CALIB_FIX_POSITION is for a camera on a tripod: leave camera="moving" out')
        network = None if (found := how.with_network().network) is None else Padded(found)
        is_free = how.may_be_enlarged and how.task.given.is_empty and network is not None
        on, how = replace(how, network=network, may_be_enlarged=is_free).on_paint().on_side()
        how = how.on_part()
        frames = clip_input(source)
        return cls(frames, how, on, ShapeEstimator(how).shape(frames))

    @cached_property
    def parts(self) -> Sequence[ClipPart]:
        """The parts, of equal lengths near `PART`."""
        frames, count = self.frames, self.frames.count
        ends = np.linspace(0, count, max(round(count / PART), 1) + 1).round().astype(int).tolist()
        if len(ends) == 2:
            return [ClipPart(frames, self.how, self.shape, 0, count)]
        size = self.image_size
        return [ClipPart(frames.part(a, b), self.how, self.shape, a, b - a, size) for a, b in pairwise(ends)]

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of its first image."""
        return size_of(next(iter(self.frames)))

    def calibrated(
        self, numbers: Sequence[int], kept: Store[FinishedPart], executor: Executor | None = None
    ) -> Iterator[FinishedPart]:
        """Calibrate some of the parts, those that are not kept yet; these are kept as soon as they are done."""
        before = {number: found for number in numbers if (found := kept.get(number)) is not None}
        left = [self.parts[number] for number in numbers if number not in before]
        some = executor if len(self.parts) > 1 else None
        results = in_order(some, calibrated_part, left, ahead=len(left), rescue=partial(_once_more, executor))
        total, done = (sum(part.count for part in parts) for parts in ([self.parts[k] for k in numbers], left))
        with progress_bar(
            unit="frame",
            total=total,
            initial=total - done,
            desc=TOGETHER,
            progress=self.frames.progress if len(numbers) > 1 else False,
        ) as progress:
            for number in numbers:
                if number in before:
                    _check(number, before[number], self.parts[number])
                    yield before[number]
                    continue
                found = next(results)
                kept[number] = found
                yield found
                progress.update(self.parts[number].count)

    def joined(self, parts: Sequence[FinishedPart]) -> VideoCalibration:
        """Join all parts, and add what holds for all frames: their shape, and notes on the whole clip."""
        self.frames.learn(Reading.joined([part.reading for part in parts]))
        video = joined_parts([part.calibration for part in parts], self.how)
        of_shape = () if self.shape is None else self.shape.words
        without = self.how.network is not None and len(video) and not has_cameras(video)
        asked = notes_without_camera(self.how.task.object_segments, self.image_size) if without else ()
        notes = (*video.notes, *crown_notes(video.tripods), *of_shape, *asked)
        return replace(video, shape=self.shape, notes=notes, is_side_open=self.on.is_open)


class FinishedPart(NamedTuple):
    """A part of a clip that is calibrated."""

    calibration: VideoCalibration
    reading: Reading


@dataclass(frozen=True, eq=False)
class ClipPart:
    """Frames of a clip that are calibrated without the others, perhaps by another process."""

    frames: ClipInput
    how: How
    shape: Shape | None
    begin: int
    """Number of its first frame in the clip."""
    count: int
    """Number of its frames, as far as it is known before they are read."""
    size: tuple[int, int] | None = None
    """Width and height that its images must have; None if it is the whole clip."""

    def cut_out(self) -> Iterator[Image]:
        """Cut the frames out of the images, reading ahead; a ValueError for an image of another size."""
        images = iter(self.frames)
        if self.shape is not None:
            return read_ahead(map(partial(_in_frame, self.shape.placement), images))
        return read_ahead(images if self.size is None else map(partial(checked_image, image_size=self.size), images))


def _in_frame(placement: Placement, image: Image) -> Image:
    return placement.image_in_frame(checked_image(image, placement.size))


def calibrated_part(part: ClipPart) -> FinishedPart:
    """Calibrate a part of a clip."""
    how = part.how
    frames = part.cut_out()
    first = list(islice(frames, 1))
    tracker = KeyframeTracker(how.every, moving=not how.is_on_tripod)
    tied = tied_frames(chain(first, frames), tracker=tracker)
    keyframes = read_keyframes(tied, how, part.begin, tracker) if first else None
    reading = part.frames.told()
    if keyframes is None:
        return FinishedPart(VideoCalibration.joined([]), reading)
    solved = solve_tripods(solve_shots(keyframes))
    count = len(solved.pieces.number)
    lines = find_clip_lines(solved, islice(part.cut_out(), count))
    found = finish_clip(lines)
    if off_paint(found) > LOOK_AGAIN:
        found = finish_clip_again(found, lines, islice(part.cut_out(), count))
    return FinishedPart(found, reading)


def _once_more(executor: Executor | None, part: ClipPart, _: ProcessEndedError) -> FinishedPart:
    """Calibrate a part whose process has ended."""
    assert executor is not None
    try:
        return executor.submit(calibrated_part, part).result()
    except ProcessEndedError as error:
        which = f"frames {part.begin} to {part.begin + part.count - 1}"
        raise OSError(f"{which}: the process that worked on them ended twice, with {error.exit_code}") from None


def _check(number: int, kept: FinishedPart, part: ClipPart) -> None:
    """Raise a ValueError if a part that was kept cannot be one of this clip."""
    if len(kept.calibration) > part.count:
        raise ValueError(
            f"part {number} has {len(kept.calibration)} frames, but {part.count} in this video: is it of another one?"
        )
