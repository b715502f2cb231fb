"""Calibration of frames, for results in memory (`fieldcalib.calibrate`) and in a folder (`fieldcalib run`).

    frames one by one    `calibrate_images`
    frames of a clip     `calibrate_clip`, all together
    frames of a stream   `live_tracker`, each when it comes

Each image lies in a whole frame with square pixels (`Placement`). The frames are calibrated, and their cameras are
converted to pixels of the images.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain, islice
from typing import Any, Protocol

from fieldcalib._progress import Progress, solving
from fieldcalib.assess.cropping_evidence import Declared
from fieldcalib.assess.placement import Placement
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.fields.field import Field
from fieldcalib.images.clip.from_video import Mount, PartStore, calibrate_video
from fieldcalib.images.clip.tracker import Tracker
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.images.search.place_search import Place
from fieldcalib.io.image import Image, size_of
from fieldcalib.io.streams import Stream, StreamReader
from fieldcalib.localize import Network
from fieldcalib.run_folder.frame_source import SOLVING, ClipInput, Frame, checked_frames
from fieldcalib.run_folder.work_units import in_groups

NO_SIZE = (0, 0)


class How(Protocol):
    """Options for the calibration of frames, from the command line or from Python."""

    @property
    def field(self) -> Field:
        """The field that the frames show."""

    @property
    def camera(self) -> Mount:
        """Mount of the camera of a clip: tripod or moving."""

    @property
    def refine(self) -> bool:
        """Whether single images are refined on their lines."""

    @property
    def may_be_enlarged(self) -> bool:
        """Whether pictures may be enlarged parts of frames."""

    @property
    def declared(self) -> Declared:
        """Whether the user has declared the shape of the pictures."""

    @property
    def depends_on_size(self) -> bool:
        """Whether the result of `keywords` depends on the size of the frames."""

    def placement(self, image: Image) -> Placement:
        """Placement of an image in its frame."""

    def keywords(self, frame_size: tuple[int, int]) -> dict[str, Any]:
        """Keyword arguments that `calibrate_from_images`, `calibrate_video` and `Tracker` share."""


def calibrate_images(
    how: How, network: Network | None, images: Sequence[Image], place: Place | None = None
) -> list[Calibration]:
    """Calibrate images one by one, from the `place` of their camera if that is known."""
    placements = [how.placement(image) for image in images]
    frames = [placement.image_in_frame(image) for placement, image in zip(placements, images, strict=True)]
    found = calibrate_frames(how, network, frames, place)
    return [placement.from_frame(one) for placement, one in zip(placements, found, strict=True)]


def calibrate_frames(
    how: How, network: Network | None, frames: Sequence[Image], place: Place | None = None
) -> list[Calibration]:
    """Calibrate whole frames with square pixels one by one."""

    def of_size(size: tuple[int, int], some: Sequence[Image]) -> list[Calibration]:
        return calibrate_from_images(
            how.field,
            some,
            network,
            refine=how.refine,
            may_be_enlarged=how.may_be_enlarged,
            place=place,
            **how.keywords(size),
        )

    found = in_groups(frames, lambda frame: size_of(frame) if how.depends_on_size else NO_SIZE, of_size)
    return found if how.declared is Declared.NOTHING else [replace(one, declared=how.declared) for one in found]


def clip_keywords(how: How, clip: ClipInput) -> dict[str, Any]:
    """Keywords for the frames of a clip; a BrokenFileError if the known values of the camera cannot hold for them."""
    return how.keywords(clip.frame_size() if how.depends_on_size else NO_SIZE)


def calibrate_clip(
    how: How, network: Network | None, clip: ClipInput, parts: PartStore | None = None, progress: Progress = True
) -> VideoCalibration:
    """Calibrate the frames of a clip together; `parts` keeps the parts that are done."""
    with solving(SOLVING, progress):
        return calibrate_video(
            how.field,
            clip,
            network,
            camera=how.camera,
            may_be_enlarged=how.may_be_enlarged,
            parts=parts,
            **clip_keywords(how, clip),
        )


@contextmanager
def live_tracker(
    how: How, network: Network, stream: Stream, reader: StreamReader
) -> Generator[tuple[Iterator[Frame], Tracker]]:
    """Open a stream: its frames as they come, and the tracker that calibrates them (`tracked`)."""
    frames, size = checked_frames(stream, reader, how.placement), NO_SIZE
    if how.depends_on_size:  # the size is that of the first frame
        first = list(islice(frames, 1))
        size = next((how.placement(frame.image).frame_size for frame in first if frame.image is not None), NO_SIZE)
        frames = chain(first, frames)
    with Tracker(how.field, network, wait=not stream.is_live, **how.keywords(size)) as tracker:
        yield frames, tracker


def tracked(how: How, tracker: Tracker, frame: Frame) -> Calibration:
    """Calibrate the next frame of a stream."""
    assert frame.image is not None
    placement = how.placement(frame.image)
    return placement.from_frame(tracker.update(placement.image_in_frame(frame.image)))
