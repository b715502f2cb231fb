"""Sources of the pictures of results, to read them again: files, a video, or arrays.

If the user does not name the field (`auto_field`), it is recognised in the first pictures, or in some frames of the
first seconds of a clip.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path

from fieldcalib.fields.catalogue import AUTO, COMPARED
from fieldcalib.images.which_field import which_field
from fieldcalib.io.clips import in_order
from fieldcalib.io.files import FrameFile
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.frame_range import WHOLE, Cut
from fieldcalib.io.image_files import Image, checked_image
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.run_folder.frame_source import ArrayFrames, FileFrames, FrameSource, VideoFrames, ignored, in_cut

MOST = 3  # pictures that are searched for the field
STEP = 100  # frames of a clip from one searched frame to the next


@dataclass(frozen=True, eq=False)
class Pictures:
    """Access to pictures by the ids of their frames."""

    paths: Sequence[Path] = ()
    images: Sequence[Image] = ()
    """Images in memory, in place of paths."""
    cut: Cut = WHOLE
    is_clip: bool = False
    """Whether the images of files are in the order of the numbers in their names."""

    def __reduce__(self) -> tuple[type[Pictures], tuple[object, ...]]:
        """Pickle for other processes, which open files themselves."""
        return Pictures, (self.paths, self.images, self.cut, self.is_clip)

    @property
    def is_video(self) -> bool:
        """Whether the pictures are the frames of a video."""
        return bool(self.paths) and VIDEOS.recognises(self.paths[0])

    @cached_property
    def files(self) -> Sequence[FrameFile]:
        """Files of the pictures, or of the video."""
        if self.is_video:
            return [FrameFile(self.paths[0].stem, self.paths[0])]
        return in_cut(self._found, self.cut, ignored) if self._found else []

    @cached_property
    def _found(self) -> Sequence[FrameFile]:
        """Files of pictures, including those outside the cut."""
        found = IMAGES.find(self.paths) if self.paths else []
        return in_order(found) if self.is_clip else found

    def beyond(self) -> str:
        """Message if the end of the cut lies beyond the last picture; empty otherwise, and always for a video."""
        count = 0 if self.is_video else len(self.images) or len(self._found)
        said = self.cut.beyond(count) if count else ""
        return f"the input {said}" if said else ""

    @cached_property
    def _numbers(self) -> dict[str, int]:
        """Numbers of the files of pictures, by id."""
        return {file.id: number for number, file in enumerate(self.files)}

    def has(self, id: str) -> bool:
        """Whether the picture of a frame can be read again."""
        if len(self.images):
            return id.isdecimal() and int(id) < len(self.images)
        if self.is_video:
            return self.paths[0].is_file()
        try:
            return id in self._numbers
        except (OSError, ValueError):  # moved, or no pictures
            return False

    def image(self, id: str) -> Image:
        """Read the picture of a frame.

        Raises
        ------
        ValueError
            If its place is not known, or it is no longer there.
        BrokenFileError
            If it cannot be read.
        """
        if not isinstance(id, str) or not self.has(id):
            raise ValueError(f"it is not known where the picture of frame {id} is, or it is gone: give it as image=")
        if len(self.images):
            return checked_image(self.images[int(id)])
        if self.is_video:
            return self._video.frame(int(id))
        number = self._numbers[id]
        return next(self._files.each(number, number + 1))

    @cached_property
    def _files(self) -> FileFrames:
        return FileFrames(self.files, tell=ignored)

    @cached_property
    def _video(self) -> VideoFrames:
        """The video, which stays open to be read at any place."""
        return VideoFrames(self.paths[0], tell=ignored)

    def frames(self, tell: Callable[[str], object] = ignored) -> FrameSource:
        """Open the pictures for reading, repeatedly; `tell` is called with a message about lost frames of a video."""
        if len(self.images):
            return ArrayFrames(self.images, self.cut)
        if self.is_video:
            return VideoFrames(self.paths[0], self.cut, tell=tell).looked_at()
        return FileFrames(self.files, tell=ignored)


def auto_field(pictures: Pictures) -> str:
    """Recognise the field that pictures show; returns its name.

    Raises
    ------
    ValueError
        If they show no field, or several fields explain them equally well.
    """
    step = STEP if pictures.is_clip or pictures.is_video else 1
    frames = islice(pictures.frames(), 0, (MOST - 1) * step + 1, step)
    images = [frame.image for frame in frames if frame.image is not None]
    found = which_field(images, COMPARED, SegmentationNetwork.load())
    if found.name is None:
        raise ValueError(f'field "{AUTO}": {found.reason}')
    return found.name
