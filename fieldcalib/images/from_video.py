"""From a video to cameras: every frame of a shot follows from all of them.

    frames -> matches with keyframes -> markings in the keyframes -> cameras of the keyframes, one by one
           -> all frames of a tripod together -> lines at the markings of every frame -> all frames together again

The video is read twice: a line is found in a frame where the camera is known to some pixels, and that the other frames
tell. Keyframes and what ties frames to them come from `fieldcalib.images.keyframes`.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import Literal, Protocol

from numpy.typing import ArrayLike

from fieldcalib.assess.placement import Placement
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.clip_models import said_of_crown
from fieldcalib.images.clip_shape import LookedAt
from fieldcalib.images.clip_solver import ClipSolver, off_paint
from fieldcalib.images.keyframes import EVERY, Tied, tied_frames
from fieldcalib.io.clips import clip_reader
from fieldcalib.io.image import Image, checked_image
from fieldcalib.io.images import read_ahead
from fieldcalib.io.videos import VideoReader
from fieldcalib.localize import Network
from fieldcalib.localize.flow import check_network
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.problem.labelled_pixels import check_object
from fieldcalib.solve.given_camera import GivenCamera, check_of_clip
from fieldcalib.solve.options import ALL, DEFAULT_FLAGS, CalibrationFlags, Prior
from fieldcalib.solve.sequence_problem import SHARED, SHARED_IN_MOTION, SIZE

Mount = Literal["tripod", "moving"]
SHARED_BY: dict[Mount, tuple[str, ...]] = {"tripod": SHARED, "moving": SHARED_IN_MOTION}

LOOK_AGAIN = 0.05  # share of frames with a marking beside its paint, from which on lines are searched once more
PART = 3000  # frames, two minutes, after which the video is cut at a keyframe


class Parts(Protocol):
    """Calibrations of parts of a video by their number: a dict, or what keeps them elsewhere."""

    def get(self, index: int, /) -> VideoCalibration | None:
        """That of a part, None if it is not calibrated yet."""

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
    every: int = EVERY,
    camera: Mount = "tripod",
    parts: Parts | None = None,
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
        Finds the markings; by default the one that comes with the package.
    camera_matrix, dist_coeffs, rvec, tvec, flags, prior
        As in `calibrate_from_images`. A position is that of all frames, which then share no other; so is a focal
        length (no zoom). A rotation is of one frame, and cannot be given.
    take_off_borders : bool
        Whether black borders that all of some of its first frames have are left out, unless there is a `camera_matrix`.
        Cameras are in pixels of the whole pictures (`VideoCalibration.shape`).
    estimate_aspect : bool
        Whether frames of another shape than 16:9 may have been squashed from it: some of them are calibrated together
        as they are and as they would be shown, and what their lines make more likely is taken. Where they do not tell,
        all cameras are to be checked. Not with a `camera_matrix`, or without a prior.
    estimate_size : bool
        Whether length and width of a field that are not said to be known are estimated from the frames of a tripod
        together, as far as they tell them. Otherwise they stay as they are given, and what is not known of them is in
        the errors from the centre mark.
    every : int
        Frames from one keyframe to the next, at most.
    camera : {"tripod", "moving"}
        What takes the video. A camera that moves, a drone, one on wires, a hand, has a smooth path instead of one
        place, and its frames are tied by the ground alone; each of its shots is calibrated by itself.
    parts : mapping of int to VideoCalibration, optional
        Calibrations of parts of the video (`PART` frames) by their number, e.g. of an earlier call that was
        interrupted: these are not calibrated again, and the others are added when they are done.

    Returns
    -------
    VideoCalibration
        Each frame says what it rests on: lines, matches, both, or interpolation (`VideoCalibration.basis`). A camera is
        accepted as long as the field in view is known to 1 m. What frames share is that of two minutes of video, after
        which shots and tripods begin anew: so memory does not grow with the video.

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
    check_object(object_segments)
    if camera not in SHARED_BY:
        raise ValueError(f'camera must be "tripod" or "moving", got {camera!r}')
    given = GivenCamera(camera_matrix, dist_coeffs, rvec, tvec)
    check_of_clip(flags)
    if camera == "moving" and flags & CalibrationFlags.CALIB_FIX_POSITION:
        raise ValueError('CALIB_FIX_POSITION is of a camera on a tripod: leave camera="moving" out')
    network = SegmentationNetwork.load() if network is None else network
    check_network(network)
    shared = tuple(name for name in SHARED_BY[camera] if estimate_size or name != SIZE)
    opened, is_asked = clip_reader(source), camera_matrix is None
    asked = take_off_borders and is_asked, estimate_aspect and is_asked and prior is not None
    with opened() as images:
        shape = LookedAt(object_segments, network, flags, prior, given, *asked).shape(images)
    placed = _as_it_is if shape is None else partial(_in_frame, shape.placement)
    solver = partial(ClipSolver, object_segments, flags, prior, shared, given)
    tied = partial(tied_frames, every=every, moving="centre" not in shared)
    found = _calibrated(opened, network, solver, tied, placed, parts)
    of_shape = () if shape is None else filter(None, (shape.message, *shape.complaints))
    return replace(found, shape=shape, notes=(*found.notes, *said_of_crown(found.tripods), *of_shape))


def _as_it_is(image: Image) -> Image:
    return image


def _in_frame(placement: Placement, image: Image) -> Image:
    """The frame in a picture of the size that the others have, or a ValueError."""
    return placement.image_in_frame(checked_image(image, placement.size))


def _calibrated(
    opened: Callable[[], AbstractContextManager[Iterable[Image]]],
    network: Network,
    solver: Callable[[], ClipSolver],
    tied_frames: Callable[[Iterator[Image]], Iterator[tuple[Image, Tied]]],
    placed: Callable[[Image], Image],
    kept: Parts | None,
) -> VideoCalibration:
    """Part by part, so that matches and lines of a long video do not pile up; two readers go along with one another."""
    parts = []
    with opened() as images, opened() as again:
        tied = tied_frames(read_ahead(map(placed, images)))
        second = read_ahead(map(placed, again))
        for index, part in enumerate(_in_parts(tied)):
            before = None if kept is None else kept.get(index)
            if before is not None:
                count = sum(1 for _ in part)
                if count != len(before) or sum(1 for _ in islice(second, count)) != count:
                    raise ValueError(
                        f"part {index} has {len(before)} frames, that of the video {count}: another video?"
                    )
                parts.append(before)
                continue
            clip = solver()
            clip.read(part, network)
            tripods = clip.tripods()
            lines, ridges = clip.lines_in(islice(second, len(clip.piece)), tripods)
            parts.append(clip.finished(tripods, lines, ridges))
            if off_paint(parts[-1]) > LOOK_AGAIN:
                with opened() as third:
                    frames = islice(read_ahead(map(placed, third)), clip.begin, clip.begin + len(clip.piece))
                    parts[-1] = clip.looked_at_again(parts[-1], tripods, frames)
            if kept is not None:
                kept[index] = parts[-1]
        if isinstance(images, VideoReader) and (loss := images.loss()):
            warnings.warn(loss, stacklevel=3)
    return VideoCalibration.joined(parts)


def _in_parts(frames: Iterator[tuple[Image, Tied]]) -> Iterator[Iterator[tuple[Image, Tied]]]:
    """Frames in parts of `PART` or some more, each of which begins with a keyframe."""
    ahead = next(frames, None)
    while ahead is not None:
        count = 0

        def part() -> Iterator[tuple[Image, Tied]]:
            nonlocal ahead, count
            while ahead is not None and not (count >= PART and ahead[1].is_key):
                count += 1
                yield ahead
                ahead = next(frames, None)

        yield part()
