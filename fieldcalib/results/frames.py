"""Storage of the frames of results: in memory if they were just calibrated, or in the files of a run.

Their pictures are read again from files, a video, or arrays (`Pictures`). If the user does not name the field
(`auto_field`), it is recognised in the first pictures, or in some frames of the first seconds of a clip.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property, lru_cache, partial
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np

from fieldcalib._progress import Progress, solving
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.catalogue import AUTO, COMPARED
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.which_field import which_field
from fieldcalib.io.files import FrameFile
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.frame_range import WHOLE, Cut
from fieldcalib.io.frame_source import ArrayFrames, FileFrames, FrameSource, VideoFrames, ignored, in_cut, in_order
from fieldcalib.io.image_files import Image, checked_image
from fieldcalib.io.results import ResultFile, broken_line, split_line
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.run_folder.record import calibration_line

NO_PICTURE = "it is not known where the picture of frame {} is, or it is gone: give it as image="
EQ3 = "loss_ndc_eq3"  # key of TVCalib's loss
MOST_OPEN = 1000  # frames whose calibrations are kept as objects; further ones are packed
SHOWN, MOST_COMPARED = 3, 2000  # number of ids that errors list, and that are compared with an unknown id
CACHED = 256  # calibrations that are cached once they were computed or parsed: up to 100 kB each

Value = TypeVar("Value")
MOST = 3  # pictures that are searched for the field
STEP = 100  # frames of a clip from one searched frame to the next


class Cached(Generic[Value]):
    """Function of the numbers of frames whose last `CACHED` values are cached; they are left out of pickles."""

    def __init__(self, function: Callable[[int], Value]) -> None:
        self._function, self._cached = function, lru_cache(CACHED)(function)

    def __call__(self, number: int) -> Value:
        """The value of a frame."""
        return self._cached(number)

    def __reduce__(self) -> tuple[Callable[..., Cached[Value]], tuple[Callable[[int], Value]]]:
        return Cached, (self._function,)


class KeptFrames:
    """Frames in memory, as they were calibrated.

    Parameters
    ----------
    ids : sequence of str
        Ids of all frames in order.
    calibrations : sequence of Calibration or bytes
        Calibrations of the frames that could be read, in order; bytes if `packed`.
    broken : mapping of str to str
        Problems of the other frames, by id.
    details : mapping of str to mapping
        More keys of the lines of frames, by id.
    """

    def __init__(
        self,
        ids: Sequence[str],
        calibrations: Sequence[Calibration | bytes],
        broken: Mapping[str, str] = MappingProxyType({}),
        details: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    ) -> None:
        self.ids, self.broken, self._calibrations, self._details = ids, broken, calibrations, details
        readable = (number for number, id in enumerate(ids) if id not in broken)
        self._by_number = dict(zip(readable, range(len(calibrations)), strict=True))
        self.calibration = Cached(self._made_calibration)
        """The calibration of a frame that is not broken."""
        self.line = Cached(self._made_line)
        """Everything that is kept of a frame."""

    def changed(self, change: Callable[[Calibration], Calibration]) -> KeptFrames:
        """The same frames with other calibrations."""
        found = [change(self.calibration(number)) for number in self._by_number]
        return KeptFrames(self.ids, found, self.broken, self._details)

    def main(self, number: int) -> Mapping[str, Any]:
        """The line of a frame in ``cameras.jsonl``."""
        return split_line(self.line(number))[0]

    def mains(self) -> Iterator[Mapping[str, Any]]:
        """The lines of all frames in ``cameras.jsonl``, in order."""
        return map(self.main, range(len(self.ids)))

    def camera(self, number: int) -> Camera | None:
        """The best camera of such a frame; None where there is none."""
        return self.calibration(number).camera

    def _made_calibration(self, number: int) -> Calibration:
        kept = self._calibrations[self._by_number[number]]
        return kept if isinstance(kept, Calibration) else Calibration.from_dict(unpacked(kept))

    def _made_line(self, number: int) -> Mapping[str, Any]:
        id = self.ids[number]
        if id in self.broken:
            return broken_line(id, self.broken[id])
        kept = self._calibrations[self._by_number[number]]
        if not isinstance(kept, Calibration):
            return unpacked(kept)
        return unpacked(packed(id, self.calibration(number), self._details.get(id, {})))


def packed(id: str, calibration: Calibration, details: Mapping[str, Any] = MappingProxyType({})) -> bytes:
    """Compress the line of a frame to some kilobytes; a calibration takes a hundred in memory."""
    more = dict(details)
    line = calibration_line(id, calibration, more.pop(EQ3, None)) | more
    return zlib.compress(json.dumps(line).encode(), level=1)


def unpacked(content: bytes) -> dict[str, Any]:
    """Unpack a line: the inverse of `packed`, with the values that reading from a file would give."""
    return json.loads(zlib.decompress(content))  # type: ignore[no-any-return]


class Collected:
    """Collects calibrations of frames one after the other; after `MOST_OPEN` they are packed, to save memory."""

    def __init__(self) -> None:
        self.ids: list[str] = []
        self.broken: dict[str, str] = {}
        self._calibrations: list[Calibration | bytes] = []
        self._details: dict[str, Mapping[str, Any]] = {}

    def add(self, id: str, calibration: Calibration, **details: Any) -> None:
        """Add the next frame; `details` are more keys of its line."""
        self.ids.append(id)
        is_open = len(self._calibrations) < MOST_OPEN
        self._calibrations.append(calibration if is_open else packed(id, calibration, details))
        if is_open and details:
            self._details[id] = details

    def add_broken(self, id: str, problem: str) -> None:
        """Add a frame that could not be read."""
        self.ids.append(id)
        self.broken[id] = problem

    def frames(self) -> KeptFrames:
        """All frames that were added."""
        return KeptFrames(self.ids, self._calibrations, self.broken, self._details)


class StoredFrames(ResultFile):
    """Frames in the files of a run, parsed when they are accessed."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._calibration = Cached(partial(ResultFile.calibration, self))

    @cached_property
    def broken(self) -> Mapping[str, str]:
        """Problems of frames that could not be read, by id."""
        return {self.ids[number]: self.main(number)["message"] for number in sorted(self.unreadable)}

    def calibration(self, number: int) -> Calibration:
        """The calibration of a frame that is not broken."""
        return self._calibration(number)


FrameStore: TypeAlias = KeptFrames | StoredFrames  # frames by their numbers


class NoFrameError(KeyError):
    """Raised for a frame that does not exist: it says which ids there are, and which one may be meant."""

    def __init__(self, id: object, known: Collection[str], why: str = "") -> None:
        super().__init__(id)
        self._id, self._known, self._why = id, known, why

    def __str__(self) -> str:
        if self._why:
            return f"frame {self._id!r} {self._why}"
        if not self._known:
            return f"there is no frame {self._id!r}: no frame has a calibration"
        text = str(self._id)
        likely = [one for one in (f"{text:0>6}", Path(text).stem) if one in self._known]
        if isinstance(self._id, int) and 0 <= self._id < len(self._known):  # its place among them
            likely = likely or [next(islice(self._known, self._id, None))]
        likely = likely or get_close_matches(text, islice(self._known, MOST_COMPARED), n=1, cutoff=0.8)
        some = ", ".join(map(repr, islice(self._known, SHOWN)))
        more = f" and {len(self._known) - SHOWN} more" if len(self._known) > SHOWN else ""
        hint = f"did you mean {likely[0]!r}? " if likely else ""
        return f"there is no frame {self._id!r}: {hint}ids are {some}{more}"


class ById(dict[str, Value]):
    """Dict by the ids of frames, which raises a `NoFrameError` for an unknown id."""

    def __missing__(self, id: object) -> Value:
        raise NoFrameError(id, self.keys())


def number_of(numbers: Mapping[str, int], id: object, why: Callable[[str], str] = lambda id: "") -> int:
    """Number of a frame that a user names by its id, or by its place among these; a `NoFrameError` with the reason."""
    if isinstance(id, int | np.integer) and -len(numbers) <= id < len(numbers):
        return next(islice(numbers.values(), int(id) % len(numbers), None))
    if not isinstance(id, str) or id not in numbers:
        raise NoFrameError(id, numbers, why(id) if isinstance(id, str) else "")
    return numbers[id]


class Numbered(Mapping[str, Value]):
    """Mapping of the ids of frames, whose values are found by the frames' numbers."""

    _numbers: Mapping[str, int]

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    def __contains__(self, id: object) -> bool:
        return id in self._numbers


class Lazy(Numbered[Value]):
    """Mapping of ids to values that are computed when they are accessed; `why` says why a frame has none."""

    def __init__(
        self, numbers: Mapping[str, int], value: Callable[[int], Value], why: Callable[[str], str] = lambda id: ""
    ) -> None:
        self._numbers, self._value, self._why = numbers, value, why

    def __getitem__(self, id: str | int) -> Value:
        return self._value(number_of(self._numbers, id, self._why))

    def __repr__(self) -> str:
        ids = [repr(id) for id in islice(self, SHOWN)] + ["..."] * (len(self) > SHOWN)
        return f"<{len(self)} by id: {', '.join(ids)}>"


class LazyList(Sequence[Value]):
    """Sequence of values that are computed when they are accessed."""

    def __init__(self, count: int, value: Callable[[int], Value]) -> None:
        self._count, self._value = count, value

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self._value(number) for number in range(self._count)[index]]
        return self._value(range(self._count)[index])

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        return len(self) == len(other) and all(a == b for a, b in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]


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
            raise ValueError(NO_PICTURE.format(id))
        if len(self.images):
            return checked_image(self.images[int(id)])
        if self.is_video:
            return self._video.frame(int(id))
        number = self._numbers[id]
        return next(FileFrames(self.files, tell=ignored).each(number, number + 1))

    @cached_property
    def _video(self) -> VideoFrames:
        """The video, which stays open to be read at any place."""
        return VideoFrames(self.paths[0], tell=ignored)

    def frames(self, tell: Callable[[str], object] = ignored) -> FrameSource:
        """Open the pictures for reading, repeatedly; `tell` is called with a message about lost frames of a video."""
        if len(self.images):
            return ArrayFrames(in_cut(self.images, self.cut, ignored), self.cut.numbers())
        if self.is_video:
            return VideoFrames(self.paths[0], self.cut, tell=tell).looked_at()
        return FileFrames(self.files, tell=ignored)


def auto_field(pictures: Pictures, tell: Callable[[str], object] = ignored, progress: Progress = True) -> str:
    """Recognise the field that pictures show; returns its name, and tells which others it was compared with.

    Raises
    ------
    ValueError
        If they show no field, or several fields explain them equally well.
    """
    step = STEP if pictures.is_clip or pictures.is_video else 1
    images = [one.image for one in islice(pictures.frames(), 0, (MOST - 1) * step + 1, step) if one.image is not None]
    with solving("recognising the field", progress):
        found = which_field(images, COMPARED, SegmentationNetwork.load())
    if found.name is None:
        raise ValueError(f'field "{AUTO}": {found.reason}')
    others = sorted(found.scores.keys() - {found.name})
    tell(f"the pictures show {found.name}{', compared with ' * bool(others)}{', '.join(others)}")
    return found.name
