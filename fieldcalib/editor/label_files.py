"""Files with the labels of a person, in the formats of SoccerNet and of other tools."""

from __future__ import annotations

from collections.abc import Sequence

from fieldcalib.io.annotations import Annotation
from fieldcalib.io.formats import ANNOTATIONS, OTHER_ANNOTATIONS

LABELS = "labels"  # folder of SoccerNet's files in a folder of results, and the first part of other names
SOCCERNET, LABELME = "soccernet", "labelme"  # these have a file for each frame


def label_file(id: str) -> str:
    """The name of SoccerNet's file with the labels of a frame, in a folder of results."""
    return f"{LABELS}/{ANNOTATIONS.file_name(id)}"


def soccernet_file(annotation: Annotation) -> bytes:
    """The content of SoccerNet's file with the labels of a frame."""
    assert annotation.image_size is not None
    return (ANNOTATIONS.write(annotation.pixels, annotation.image_size) + "\n").encode()


def label_files(format: str, annotations: Sequence[Annotation]) -> tuple[str, dict[str, bytes]]:
    """The contents of files in a format by their names, and the name of the file or of the folder of all.

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
    """The contents of the files in a format when some frames are saved; None removes one.

    Parameters
    ----------
    format : str
        One of `OTHER_ANNOTATIONS`.
    annotations : sequence of Annotation
        Those of all labelled frames.
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
