"""Labels from annotation files as what a person has said of frames: an editor begins with them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field as attribute
from pathlib import Path

from fieldcalib.editor.label_files import SOCCERNET
from fieldcalib.editor.marks import Marks
from fieldcalib.fields.field import Field
from fieldcalib.io.annotation_files import AnnotatedFrame, frames_in, parse_frame, tool_of
from fieldcalib.io.files import BrokenFileError, FrameFile, named_in_errors
from fieldcalib.io.formats import ANNOTATIONS
from fieldcalib.run_folder.numbered_frames import NumberedFrames

MOST_NAMED = 5  # labels that the field does not have, in a message


class LabelWarning(UserWarning):
    """Something of annotation files that an editor does not show."""


@dataclass(frozen=True)
class GivenLabels:
    """Marks of frames, and the format of their files."""

    marks: Mapping[int, Marks] = attribute(default_factory=dict)
    """By the number of the frame."""
    format: str | None = None
    """As for `fieldcalib.editor.label_files.label_files`; None without labels."""
    files: tuple[Path, ...] = ()
    """Where they were read."""


def given_labels(path: Path, frames: NumberedFrames, field: Field) -> GivenLabels:
    """Read the labels of frames from annotations of SoccerNet, labelme, CVAT, Label Studio or COCO, by frame id.

    What the field does not have is left out, with a `LabelWarning`; so are frames that the source does not have.

    Raises
    ------
    FileNotFoundError
        If there are no annotations.
    BrokenFileError
        If one is broken, or of an image of another size.
    ValueError
        If nothing in them is of a frame of the source, with a label of the field.
    """
    numbers = {id: number for number, id in enumerate(frames.ids)}
    found = frames_in(ANNOTATIONS.find([path])).frames
    known = [one for one in found if one.id in numbers]
    marks: dict[int, Marks] = {}
    others: dict[str, None] = {}
    for file in known:
        number = numbers[file.id]
        try:
            size = frames.size(number)
        except BrokenFileError:  # it is said where the frame is looked at
            continue
        with named_in_errors(file.path):
            pixels = parse_frame(file, size).pixels
        others |= dict.fromkeys(label for label in pixels if label not in field)
        of_field = {label: xy for label, xy in pixels.items() if label in field}
        if of_field:
            marks[number] = Marks.of(of_field)
    if not marks:
        raise ValueError(_nothing(path, found, frames, list(others)))
    _warn(path, len(found) - len(known), list(others))
    formats = {_format(file) for file in {file.path: file for file in known}.values()}
    read = tuple(dict.fromkeys(file.on_disk for file in found))
    return GivenLabels(marks, formats.pop() if len(formats) == 1 else SOCCERNET, read)


def _format(file: FrameFile) -> str:
    """The format of the file of a frame."""
    return tool_of(file.read(), file.path) if isinstance(file, AnnotatedFrame) else SOCCERNET


def _nothing(path: Path, found: list[FrameFile], frames: NumberedFrames, others: list[str]) -> str:
    """The message about annotations of which nothing is shown."""
    if others:
        return f"{path}: expected labels of the field, got {_some(others)}: give the field, or rename the labels"
    came, expected = _some([one.id for one in found]), _some(list(frames.ids))
    return f"{path}: expected labels of frames named as those of the source ({expected}), got {came}"


def _warn(path: Path, frames: int, others: list[str]) -> None:
    if frames:
        warnings.warn(f"{path}: {frames} frames are not in the source, and left out", LabelWarning, stacklevel=3)
    if others:
        warnings.warn(f"{path}: the field has no {_some(others)}: left out", LabelWarning, stacklevel=3)


def _some(names: list[str]) -> str:
    more = ["..."] if len(names) > MOST_NAMED else []
    return ", ".join([*(repr(name) for name in names[:MOST_NAMED]), *more]) or "nothing"
