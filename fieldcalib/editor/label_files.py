"""Files with labels of a person, in the formats of SoccerNet and of other tools: written by the editor, and read."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as attribute
from pathlib import Path

from fieldcalib.editor.edit import Marks
from fieldcalib.fields.field import Field
from fieldcalib.io.annotations import Annotation
from fieldcalib.io.files import BrokenFileError, FrameFile, named_in_errors
from fieldcalib.io.formats import ANNOTATIONS, OTHER_ANNOTATIONS, AnnotatedFrame, frames_in, parse_frame, tool_of
from fieldcalib.io.frame_source import FrameSource

LABELS = "labels"  # folder of SoccerNet's files in a folder of results, and the first part of other names
SOCCERNET, LABELME = "soccernet", "labelme"  # formats with a file for each frame

MOST_NAMED = 5  # labels that the field does not have, in a message


def label_file(id: str) -> str:
    """Name of SoccerNet's file with the labels of a frame, in a folder of results."""
    return f"{LABELS}/{ANNOTATIONS.file_name(id)}"


def soccernet_file(annotation: Annotation) -> bytes:
    """Content of SoccerNet's file with the labels of a frame."""
    assert annotation.image_size is not None
    return (ANNOTATIONS.write(annotation.pixels, annotation.image_size) + "\n").encode()


def label_files(format: str, annotations: Sequence[Annotation]) -> tuple[str, dict[str, bytes]]:
    """Write labels in a format: returns the name of the file or folder, and the contents of all files by name.

    Raises
    ------
    ValueError
        If there is no such format, or nothing is labelled.

    Examples
    --------
    >>> import numpy as np
    >>> one = Annotation("7", {"Middle line": np.array([[10.0, 20.0], [10.5, 40.0]])}, (96, 54), "7.jpg")
    >>> label_files("soccernet", [one])[0], list(label_files("coco", [one])[1])
    ('labels', ['labels-coco.json'])
    """
    formats = (SOCCERNET, *OTHER_ANNOTATIONS)
    if format not in formats:
        raise ValueError(f"expected one of {', '.join(formats)}, got {format[:40]!r}")
    if not annotations:
        raise ValueError("expected labels by hand: there are none yet")
    if format == SOCCERNET:
        return LABELS, {label_file(one.id): soccernet_file(one) for one in annotations}
    name, tool = f"{LABELS}-{format}", OTHER_ANNOTATIONS[format]
    if format == LABELME:
        return name, {f"{name}/{tool.file_name(one.id)}": tool.write([one]).encode() for one in annotations}
    return tool.file_name(name), {tool.file_name(name): tool.write(annotations).encode()}


def saved_files(format: str, annotations: Sequence[Annotation], ids: Sequence[str]) -> dict[str, bytes | None]:
    """Contents of the label files in a format to be written when some frames are saved; None to remove a file.

    Parameters
    ----------
    format : str
        One of `OTHER_ANNOTATIONS`.
    annotations : sequence of Annotation
        Labels of all labelled frames.
    ids : sequence of str
        The frames that are saved.

    Examples
    --------
    >>> list(saved_files("coco", [], ["7"]).items()), list(saved_files("labelme", [], ["7"]))
    ([('labels-coco.json', None)], ['labels-labelme/7.json'])
    """
    tool, name = OTHER_ANNOTATIONS[format], f"{LABELS}-{format}"
    if format == LABELME:
        of_saved = [one for one in annotations if one.id in ids]
        removed: dict[str, bytes | None] = {f"{name}/{tool.file_name(id)}": None for id in ids}
        return {**removed, **(label_files(format, of_saved)[1] if of_saved else {})}
    return {tool.file_name(name): None, **(label_files(format, annotations)[1] if annotations else {})}


class LabelWarning(UserWarning):
    """Warns of labels or frames in annotation files that an editor does not show."""


@dataclass(frozen=True)
class GivenLabels:
    """Marks of frames, and the format of their files."""

    marks: Mapping[int, Marks] = attribute(default_factory=dict)
    """Marks by number of the frame."""
    format: str | None = None
    """Format, as for `fieldcalib.editor.label_files.label_files`; None without labels."""
    files: tuple[Path, ...] = ()
    """Files from which they were read."""


def given_labels(path: Path, frames: FrameSource, field: Field) -> GivenLabels:
    """Read the labels of frames from annotations of SoccerNet, labelme, CVAT, Label Studio or COCO, by frame id.

    Labels that the field does not have, and frames that the source does not have, are left out with a `LabelWarning`.

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
        except BrokenFileError:  # reported when the frame is opened
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
    """Format of the annotation file of a frame."""
    return tool_of(file.read(), file.path) if isinstance(file, AnnotatedFrame) else SOCCERNET


def _nothing(path: Path, found: list[FrameFile], frames: FrameSource, others: list[str]) -> str:
    """Message for annotations in which no label of the field is of a frame of the source."""
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
