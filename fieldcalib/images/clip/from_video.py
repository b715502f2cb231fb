"""Calibration of a video in stages, each a function from one frozen value to the next:

    frames                 -> Keyframes         read_keyframes     shots, matches of their frames, labels in keyframes
    Keyframes              -> SolvedShots       solve_shots        each shot, with the camera model that predicts best
    SolvedShots            -> SolvedTripods     solve_tripods      shots of one tripod together
    SolvedTripods, frames  -> ClipLines         find_clip_lines    lines near the projected markings of every frame
    ClipLines              -> VideoCalibration  finish_clip        all frames of each tripod together
    VideoCalibration       -> VideoCalibration  finish_clip_again  again, if more markings then lie on their paint

The video is read twice, and a third time to finish again: lines can be found in a frame only when its camera is known
to a few pixels, which takes the other frames. `Tracker` uses the same matches, labels of keyframes, problems and lines,
but keyframe by keyframe.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, islice
from typing import Protocol

from numpy.typing import ArrayLike

from fieldcalib._types import named
from fieldcalib.assess.video import Shape, VideoCalibration
from fieldcalib.fields.field import ObjectSegments, Side
from fieldcalib.images.background.keyframe_tracking import EVERY, TiedFrame, tied_frames
from fieldcalib.images.clip.clip_models import crown_notes
from fieldcalib.images.clip.clip_shape import ShapeEstimator
from fieldcalib.images.clip.finished_clip import find_clip_lines, finish_clip, finish_clip_again, off_paint
from fieldcalib.images.clip.keyframes import read_keyframes
from fieldcalib.images.clip.solved_shots import solve_shots, solve_tripods
from fieldcalib.images.from_images import How, Mount
from fieldcalib.images.shape.shape_of_picture import has_cameras, notes_without_camera
from fieldcalib.io.clips import clip_reader
from fieldcalib.io.image_files import Image, checked_image, read_ahead, size_of
from fieldcalib.io.videos import VideoReader
from fieldcalib.localize import Network
from fieldcalib.localize.network import Padded
from fieldcalib.problem.picture_shape import Placement
from fieldcalib.solve.request import GivenCamera, Task, check_of_clip
from fieldcalib.solve.solver_options import ALL, DEFAULT_FLAGS, CalibrationFlags, Prior

LOOK_AGAIN = 0.05  # share of frames with a marking beside its paint, above which lines are looked for once more
PART = 3000  # frames, two minutes, after which a new part begins at the next keyframe


class PartStore(Protocol):
    """Store of calibrations of parts of a video by their number: a dict, or another mapping."""

    def get(self, index: int, /) -> VideoCalibration | None:
        """The calibration of a part; None if there is none yet."""

    def __setitem__(self, index: int, part: VideoCalibration, /) -> None: ...


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
    parts: PartStore | None = None,
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
        Calibrations of parts of the video (`PART` frames) by their number, e.g. of an earlier call that was
        interrupted: these are not calibrated again, and the others are added when they are done.

    Returns
    -------
    VideoCalibration
        Each frame says what it rests on: lines, matches, both, or interpolation (`VideoCalibration.basis`). A camera is
        accepted as long as the field in view is known to its `Field.tolerance`, 1 m on a soccer pitch. After two
        minutes of video shots and tripods begin anew, and share nothing with those before, so that memory does not grow
        with the video.

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
    return calibrate_clip(how, source, parts)


def calibrate_clip(
    how: How, source: str | os.PathLike[str] | Iterable[Image], parts: PartStore | None = None
) -> VideoCalibration:
    """Calibrate the frames of a video together (`calibrate_video`)."""
    if parts is not None and not (hasattr(parts, "get") and hasattr(parts, "__setitem__")):
        raise ValueError(f"expected parts, a dict of calibrations by the number of the part, got {named(parts)}")
    check_of_clip(how.task.chosen_flags)
    if how.camera == "moving" and how.task.chosen_flags & CalibrationFlags.CALIB_FIX_POSITION:
        raise ValueError('CALIB_FIX_POSITION is for a camera on a tripod: leave camera="moving" out')
    network = how.with_network().network
    network = None if network is None else Padded(network)
    is_free = how.may_be_enlarged and how.task.given.is_empty and network is not None
    on, how = replace(how, network=network, may_be_enlarged=is_free).on_side()
    clip = _Clip(clip_reader(source))
    with clip.opened() as images:
        clip = replace(clip, shape=ShapeEstimator(how).shape(images))
    found = _calibrated_parts(clip, how, parts)
    of_shape = () if clip.shape is None else clip.shape.words
    without = network is not None and len(found) and not has_cameras(found)
    asked = notes_without_camera(how.task.object_segments, clip.image_size) if without else ()
    notes = (*found.notes, *crown_notes(found.tripods), *of_shape, *asked)
    return replace(found, shape=clip.shape, notes=notes, is_side_open=on.is_open)


@dataclass(frozen=True, eq=False)
class _Clip:
    """A clip that can be read repeatedly, with the shape of its frames."""

    opened: Callable[[], AbstractContextManager[Iterable[Image]]]
    shape: Shape | None = None

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of its first image."""
        with self.opened() as images:
            return size_of(next(iter(images)))

    def frames(self, images: Iterable[Image]) -> Iterator[Image]:
        """Cut the frames out of the images, reading ahead; a ValueError for an image of another size."""
        return read_ahead(images if self.shape is None else map(partial(_in_frame, self.shape.placement), images))


def _in_frame(placement: Placement, image: Image) -> Image:
    return placement.image_in_frame(checked_image(image, placement.size))


def _calibrated_parts(clip: _Clip, how: How, kept: PartStore | None) -> VideoCalibration:
    """Calibrate a clip part by part, so that memory does not grow with the video; both passes advance together."""
    parts = []
    with clip.opened() as images, clip.opened() as again:
        tied = tied_frames(clip.frames(images), every=how.every, moving=not how.is_on_tripod)
        second = clip.frames(again)
        for index, part in enumerate(_in_parts(tied)):
            before = None if kept is None else kept.get(index)
            if before is not None:
                count = sum(1 for _ in part)
                if count != len(before) or sum(1 for _ in islice(second, count)) != count:
                    raise ValueError(
                        f"part {index} has {len(before)} frames, but {count} in this video: is it of another one?"
                    )
                parts.append(before)
                continue
            parts.append(_calibrated_part(clip, how, part, second))
            if kept is not None:
                kept[index] = parts[-1]
        if isinstance(images, VideoReader) and (loss := images.loss()):
            warnings.warn(loss, stacklevel=3)
    return VideoCalibration.joined(parts)


def _calibrated_part(
    clip: _Clip, how: How, part: Iterable[tuple[Image, TiedFrame]], second: Iterator[Image]
) -> VideoCalibration:
    """Calibrate one part of a video, from its frames in the first pass and in the second."""
    keyframes = read_keyframes(part, how)
    solved = solve_tripods(solve_shots(keyframes))
    count = len(solved.pieces.number)
    lines = find_clip_lines(solved, islice(second, count))
    found = finish_clip(lines)
    if off_paint(found) <= LOOK_AGAIN:
        return found
    begin = keyframes.shots.begin
    with clip.opened() as third:
        return finish_clip_again(found, lines, islice(clip.frames(third), begin, begin + count))


def _in_parts(frames: Iterable[tuple[Image, TiedFrame]]) -> Iterator[Iterator[tuple[Image, TiedFrame]]]:
    """Group frames into parts of `PART` frames or slightly more, each of which begins with a keyframe."""
    begin = 0

    def first_of_part(frame: tuple[Image, TiedFrame]) -> int:
        nonlocal begin
        _, tied = frame
        if tied.is_key and tied.index - begin >= PART:
            begin = tied.index
        return begin

    return (part for _, part in groupby(frames, key=first_of_part))
